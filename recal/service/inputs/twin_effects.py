"""The effects that a twin lists, as an update takes them out of its runs.

Carried are those that are in every run and that a table over temperature cannot hold: what is a
function of the temperature alone is what the update itself learns, and a noise has no columns.
"""

from collections.abc import Sequence

from infield.reports.documents.thermal import FoundEffectDocument, found_effect_document
from infield.table.thermal_table import ThermalTable
from infield.thermal.found_effects import FoundEffect, with_effect_sigma, without_effects
from ins.records import Run, TwinModel
from simreal.declared.twin_effects import TwinEffect, leaves_the_log, parse_effects
from simreal.evidence.run_view import view_run
from simreal.predict.carried import along


def without_found_effects(
    runs: Sequence[Run], twin: TwinModel, table: ThermalTable
) -> tuple[list[Run], TwinModel, list[FoundEffectDocument] | None]:
    """The runs less the effects that the twin lists, the twin with what is not known of them, and
    what to say; all as it was where it lists none that can be carried.
    """
    listed = [item for item in parse_effects(twin) if _carried(item)]
    if not listed:
        return list(runs), twin, None
    found = [_along(run, listed, twin, table) for run in runs]
    said = [
        found_effect_document(run.header.run_id, effect)
        for run, effects in zip(runs, found)
        for effect in effects
    ]
    less = [without_effects(run, effects) for run, effects in zip(runs, found)]
    return less, with_effect_sigma(twin, found), said


def _carried(item: TwinEffect) -> bool:
    lasting = not item.is_noise and not item.run_id
    return lasting and leaves_the_log(item.effect.name, item.target)


def _along(
    run: Run, listed: Sequence[TwinEffect], twin: TwinModel, table: ThermalTable
) -> list[FoundEffect]:
    """What each effect adds to a run; nothing where the run cannot be looked at."""
    view = view_run(run, 0, table, twin)
    return [] if isinstance(view, str) else [along(item, view.telemetry) for item in listed]
