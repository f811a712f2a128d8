"""The effects that a twin lists, as an update takes them out of its runs.

Carried are those that are in every run and that a table over temperature cannot hold: what is a
function of the temperature alone is what the update itself learns, and a noise has no columns.
"""

from collections.abc import Sequence

import numpy as np

from infield.reports.documents.thermal import FoundEffectDocument, found_effect_document
from infield.table.thermal_table import ThermalTable
from infield.thermal.found_effects import FoundEffect, with_effect_sigma, without_effects
from ins.records import Run, TwinModel
from simreal.declared.generic import OF_RUN, OF_TEMPERATURE, OF_TIME
from simreal.declared.twin_effects import TwinEffect, parse_effects
from simreal.effects.base import ACCELS, GYROS
from simreal.effects.telemetry import Telemetry
from simreal.evidence.run_view import view_run

# of the temperature alone, or a constant of one power-on: the table's own subject, or none of it
LEFT_TO_THE_TABLE = frozenset(
    {
        "gyro_thermal_linear",
        "gyro_thermal_quadratic",
        "gyro_turn_on_bias",
        "compensation_misapplied",
        OF_TEMPERATURE,
        OF_TIME,
        OF_RUN,
    }
)


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
    return (
        not item.is_noise
        and not item.run_id
        and item.target in (*GYROS, *ACCELS)
        and item.effect.name not in LEFT_TO_THE_TABLE
    )


def _along(
    run: Run, listed: Sequence[TwinEffect], twin: TwinModel, table: ThermalTable
) -> list[FoundEffect]:
    """What each effect adds to a run; nothing where the run cannot be looked at."""
    view = view_run(run, 0, table, twin)
    return [] if isinstance(view, str) else [_found(item, view.telemetry) for item in listed]


def _found(item: TwinEffect, run: Telemetry) -> FoundEffect:
    trace = item.trace(run)
    zero = np.zeros((run.n, 3))
    columns = item.effect.traces(run, item.target, item.shape)
    squares = [
        (sigma * unit.gyro_rad_s) ** 2
        for unit, sigma in zip(columns, item.sigmas)
        if unit.gyro_rad_s is not None
    ]
    return FoundEffect(
        effect=item.effect.name,
        target=item.target,
        time_s=run.time_s,
        gyro_rad_s=zero if trace.gyro_rad_s is None else trace.gyro_rad_s,
        accel_m_s2=zero if trace.accel_m_s2 is None else trace.accel_m_s2,
        gyro_sigma_rad_s=np.sqrt(np.sum(squares, axis=0)) if squares else zero,
    )
