"""Values of MATLAB files of version 5 to 7.2, by scipy: for the child of `readers.contained` alone.

scipy ends its process on some damaged files, and gives up at the first damaged variable; so each
variable is handed to it as a file of its own.

Decision: docs/decisions/0087-libraries-in-a-child.md.
"""

from collections.abc import Collection
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.io import loadmat

from ins.user_input import open_regular
from trajectories.readers.contained import Contents
from trajectories.readers.containers.mat_file import (
    MAT_HEAD_BYTES,
    MAX_ELEMENTS,
    MAX_FIELD_DEPTH,
    Variable,
    damaged,
    variables,
)
from trajectories.runs.limits import GROWTH_SHARE, NUMBER_BYTES, Room, most_growth


def contents(path: Path, wanted: Collection[str] | None) -> Contents:
    """The matrices of numbers and cells of texts in the wanted variables, by their full name.

    Parameters
    ----------
    path : Path
        The file.
    wanted : collection of str or None
        Names of variables; None is all.

    Returns
    -------
    arrays : dict
        `imu.wb`, of a struct array `imu(2).wb`: float64, shape (rows, columns). Of a cell array of
        texts: the first row of each, shape (n,). Other kinds are passed over.
    notes : list of str
        Variables that are damaged, and where the file is cut off.

    Raises
    ------
    InputError
        Where they unpack to more than they may.
    """
    notes: list[str] = []
    arrays: dict[str, NDArray] = {}
    room = Room(path.stat().st_size, path.name)
    for variable in variables(path, notes):
        if wanted is not None and variable.name not in wanted:
            continue
        room.take(variable.unpacked)
        try:
            found = loadmat(_alone(path, variable))
        except Exception as error:  # scipy has many for damaged bytes
            is_large = variable.unpacked * GROWTH_SHARE > most_growth()
            if isinstance(error, MemoryError) and is_large:
                raise
            notes.append(damaged(path, variable.at, error))
            continue
        for name, value in found.items():
            if not name.startswith("__"):  # scipy's own: __header__, __version__, __globals__
                _collect(arrays, variable.name, value, room)
    return arrays, notes


def _alone(path: Path, variable: Variable) -> BytesIO:
    """A file of one variable."""
    alone = BytesIO()
    with open_regular(path) as file:
        alone.write(file.read(MAT_HEAD_BYTES))
        file.seek(variable.at)
        alone.write(file.read(variable.size))
    alone.seek(0)
    return alone


def _collect(out: dict[str, NDArray], name: str, value: Any, room: Room, depth: int = 0) -> None:
    """What is below a variable: structs by field, struct arrays by element from 1. Objects and
    functions are arrays of other classes.
    """
    if type(value) is not np.ndarray or depth > MAX_FIELD_DEPTH:
        return
    if value.dtype.names:
        elements = value.ravel()[:MAX_ELEMENTS]
        for k, element in enumerate(elements):
            label = name if elements.size == 1 else f"{name}({k + 1})"
            for field in value.dtype.names:
                _collect(out, f"{label}.{field}", element[field], room, depth + 1)
    elif value.dtype.kind in "fiu" and value.ndim == 2 and value.size:
        room.take(value.size * NUMBER_BYTES)
        out[name] = np.asarray(value, dtype=np.float64)
    elif value.dtype == object and value.size:
        texts = [_first_row(cell) for cell in value.ravel()]
        if any(texts):
            out[name] = np.array(texts)


def _first_row(cell: Any) -> str:
    is_text = isinstance(cell, np.ndarray) and cell.dtype.kind == "U" and cell.size
    return str(cell.ravel()[0]) if is_text else ""
