"""A twin for the unit that made runs, and the table that lies beside its file."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from infield.table.file import read_table_dict, table_from_dict, table_sha256
from infield.table.thermal_table import ThermalTable
from ins.records import InputError, Run, TableDocument, TwinModel
from ins.twin_file import table_path
from recal.service.inputs.records import AnyTwin, twin_of


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
