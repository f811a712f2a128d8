"""ArduPilot logs as MATLAB files: for each message an array `IMU` (rows, columns) and its column
names `IMU_label`.

Mission Planner writes the first column as the line in the log. Messages of several instances are
`IMU_0`, `IMU_1`, ...; they are handed on as `IMU`, `IMU2`, ... as old firmware names them.
"""

import re
from collections.abc import Collection
from pathlib import Path

from ins.records import InputError
from trajectories.readers.containers.dataflash import Tables
from trajectories.readers.containers.mat_file import is_matlab, read_arrays, variable_names

INSTANCE = re.compile(r"^([A-Z][A-Z0-9]*)_(\d)$")


def is_ardupilot_mat(path: Path) -> bool:
    """Whether a MATLAB file holds IMU messages with their labels."""
    return is_matlab(path) and {"IMU_label", "IMU_0_label"} & variable_names(path) != set()


def read_tables(path: Path, wanted: Collection[str]) -> tuple[Tables, list[str]]:
    """The wanted messages of a log, and notes on what was skipped. InputError where none of them
    can be read.
    """
    arrays, notes = read_arrays(path, _variables(wanted))
    tables: Tables = {}
    for name, values in arrays.items():
        message = _message(name)
        if message not in wanted or values.dtype.kind != "f":
            continue
        labels = arrays.get(f"{name}_label", arrays.get(f"{name.split('_')[0]}_label"))
        columns = [] if labels is None else [str(label) for label in labels]
        if values.shape[1] != len(columns):
            notes.append(
                f"{path.name}: {name} has shape {values.shape} and {len(columns)} labels, not read"
            )
            continue
        tables[message] = dict(zip(columns, values.T.copy()))
    if not tables:
        raise InputError(
            f"{path.name}: holds none of the messages {' '.join(sorted(wanted))}{_told(notes)}"
        )
    return tables, notes


def _message(name: str) -> str:
    """IMU_0 -> IMU, IMU_1 -> IMU2; GPS_0 -> GPS; other names as they are."""
    found = INSTANCE.match(name)
    return name if found is None else f"{found[1]}{int(found[2]) + 1 if found[2] != '0' else ''}"


def _variables(wanted: Collection[str]) -> set[str]:
    """Names that the variables of some messages may have, with those of their labels."""
    numbers = ("", *(f"_{k}" for k in range(10)))
    names = {f"{message}{number}" for message in wanted for number in numbers}
    return names | {f"{name}_label" for name in names}


def _told(notes: list[str]) -> str:
    return f" ({notes[0]})" if notes else ""
