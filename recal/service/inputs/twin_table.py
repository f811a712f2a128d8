"""The table that lies beside a twin file."""

from dataclasses import dataclass
from pathlib import Path

from infield.table.file import read_table_dict, table_from_dict, table_sha256
from infield.table.thermal_table import ThermalTable
from ins.records import InputError, TableDocument, TwinModel
from ins.twin_file import table_path


@dataclass(frozen=True)
class TwinTable:
    """The table as written, as record, and its hash; empty where the twin names none."""

    data: TableDocument | None = None
    table: ThermalTable | None = None
    sha256: str = ""


def twin_table(twin_path: Path, twin: TwinModel) -> TwinTable:
    """The twin's table; its path is relative to the twin file's folder."""
    path = table_path(twin, twin_path.parent)
    if path is None:
        return TwinTable()
    data = read_table_dict(path)
    table = table_from_dict(data, name=str(path))
    if twin.imu_serial and table.imu_serial != twin.imu_serial:
        raise InputError(
            f"{path}: imu_serial {table.imu_serial}, the twin {twin_path} is of {twin.imu_serial}"
        )
    return TwinTable(data, table, table_sha256(data))
