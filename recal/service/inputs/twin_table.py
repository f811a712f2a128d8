"""A twin for the unit that made runs, and the table that lies beside its file."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from infield.reports.documents.thermal import FoundEffectDocument, found_effect_document
from infield.table.file import read_table_dict, table_from_dict, table_sha256
from infield.table.thermal_table import ThermalTable
from infield.thermal.found_effects import FoundEffect, with_effect_sigma, without_effects
from ins.records import InputError, Run, TableDocument, TwinModel
from ins.twin_file import table_path
from recal.service.inputs.records import AnyTwin, twin_of
from simreal.declared.twin_effects import TwinEffect, leaves_the_log, parse_effects
from simreal.evidence.run_view import view_run
from simreal.predict.carried import along


@dataclass(frozen=True)
class TwinTable:
    """The table as written, as record, and its hash; empty where the twin names none."""

    data: TableDocument | None = None
    table: ThermalTable | None = None
    sha256: str = ""


def twin_and_table(given: AnyTwin, runs: Sequence[Run] = ()) -> tuple[TwinModel, TwinTable]:
    """A twin, which must be of the unit that made the runs, and the table that its file names;
    InputError where twin, runs and table are of different units.
    """
    twin = twin_of_unit(twin_of(given), *runs)
    path = None if isinstance(given, TwinModel) else table_path(twin, Path(given).parent)
    if path is None:
        return twin, TwinTable()
    data = read_table_dict(path)
    table = table_from_dict(data, name=str(path))
    if twin.imu_serial and table.imu_serial != twin.imu_serial:
        raise InputError(
            f"{path}: imu_serial {table.imu_serial}, the twin {given} is of {twin.imu_serial}"
        )
    return twin, TwinTable(data, table, table_sha256(data))


def twin_of_unit(twin: TwinModel, *runs: Run) -> TwinModel:
    """The twin, which must be of the unit that made the runs; InputError where it is not."""
    for header in (run.header for run in runs):
        for key in ("imu_serial", "gyro_technology"):
            declared, own = getattr(twin, key), getattr(header, key)
            if declared and declared != own:
                raise InputError(
                    f"twin {twin.source}: {key} {declared}, run {header.run_id} is of {own}"
                )
    return twin


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
