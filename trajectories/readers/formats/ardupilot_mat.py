"""ArduPilot logs as MATLAB files: for each message an array `IMU` (rows, columns) and its column
names `IMU_label`.

Mission Planner writes the first column as the line in the log. Messages of several instances are
`IMU_0`, `IMU_1`, ...; they are handed on as `IMU`, `IMU2`, ... as old firmware names them.
"""

import re
from collections.abc import Collection
from pathlib import Path
from typing import Any

import numpy as np

from ins.records import InputError
from trajectories.readers.containers.dataflash import Tables
from trajectories.readers.containers.mat_file import is_mat, read_variables, variable_names

INSTANCE = re.compile(r"^([A-Z][A-Z0-9]*)_(\d)$")


def is_ardupilot_mat(path: Path) -> bool:
    """Whether a MATLAB file holds IMU messages with their labels."""
    return is_mat(path) and {"IMU_label", "IMU_0_label"} & variable_names(path) != set()


def read_tables(path: Path, wanted: Collection[str]) -> tuple[Tables, list[str]]:
    """The wanted messages of a log, and notes on what was skipped. InputError where none of them
    can be read.
    """
    variables, notes = read_variables(
        path, lambda name: _message(name.removesuffix("_label")) in wanted
    )
    tables: Tables = {}
    for name, values in variables.items():
        labels = _labels(
            variables.get(f"{name}_label", variables.get(f"{name.split('_')[0]}_label"))
        )
        if name.endswith("_label"):
            continue
        if values.ndim != 2 or values.dtype.kind not in "fiu" or values.shape[1] != len(labels):
            notes += _not_read(path, name, values, labels)
            continue
        tables[_message(name)] = {
            k: np.array(values[:, i], dtype=np.float64) for i, k in enumerate(labels)
        }
    if not tables:
        raise InputError(
            f"{path.name}: holds none of the messages {' '.join(sorted(wanted))}{_told(notes)}"
        )
    return tables, notes


def _message(name: str) -> str:
    """IMU_0 -> IMU, IMU_1 -> IMU2; GPS_0 -> GPS; other names as they are."""
    found = INSTANCE.match(name)
    return name if found is None else f"{found[1]}{int(found[2]) + 1 if found[2] != '0' else ''}"


def _labels(cells: Any) -> list[str]:
    """Texts of a cell array of names; empty where it is anything else."""
    if not isinstance(cells, np.ndarray) or cells.dtype != object:
        return []
    return [str(np.ravel(cell)[0]) if np.size(cell) else "" for cell in np.ravel(cells)]


def _not_read(path: Path, name: str, values: Any, labels: list[str]) -> list[str]:
    """A note on a message that is no table of numbers; parameters and texts (cells) are passed
    over.
    """
    if values.dtype == object or not values.size:
        return []
    return [f"{path.name}: {name} has shape {values.shape} and {len(labels)} labels, not read"]


def _told(notes: list[str]) -> str:
    return f" ({notes[0]})" if notes else ""
