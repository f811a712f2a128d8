"""Columns of a MATLAB file by expressions: a vector, a column of a matrix, a field of a struct.

`imu.wb[0]` counts columns from 0, `imu.wb(:,1)` from 1 as MATLAB does; a vector needs neither. An
element of a struct array is `imu(2).wb`. Version 7.3 is HDF5, which needs the extra `hdf5`; an HDF5
file of another program is read too, with its groups as structs.
"""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ins.records import InputError
from trajectories.readers.containers.mat_file import read_variables
from trajectories.readers.rows.column_map import LayoutKeys, MapError

EXPRESSION = re.compile(
    r"^(?P<name>[A-Za-z]\w*(?:\(\d+\))?(?:\.[A-Za-z]\w*(?:\(\d+\))?)*)(?:\[(?P<from0>\d+)\]|\(:,"
    r" ?(?P<from1>\d+)\))?$"
)
MAX_FIELD_DEPTH = 4  # of fields within fields; chosen: those of NaveGo and PSINS lie 1 deep
MAX_ELEMENTS = 100  # of an array of structs that are looked at
SHOWN_NAMES = 12  # names of a message; 12 of about 15 characters are three lines of a terminal

Leaves = dict[str, NDArray]


def mat_columns(
    path: Path, layout: LayoutKeys, used: Sequence[str]
) -> tuple[dict[str, NDArray], list[str]]:
    """The used columns by their expressions, shape (n,) each; InputError lists what the file
    holds.
    """
    roots = {name.split(".")[0].split("(")[0].split("[")[0] for name in used}
    values, notes = leaves(path, lambda name: name in roots)
    try:
        return {name: _column(values, name, path) for name in used}, notes
    except InputError as error:
        raise InputError(f"{error} ({notes[0]})" if notes else str(error)) from None


def leaves(path: Path, wanted: Any = None) -> tuple[Leaves, list[str]]:
    """All real matrices in a file by their full name (`imu.wb`), two-dimensional float64, and notes
    on damaged variables.
    """
    found, notes = read_variables(path, wanted or (lambda name: True))
    out: Leaves = {}
    for name, value in found.items():
        _collect(out, name, value, 0)
    return out, notes


def leaves_at_once(path: Path, wanted: Any = None) -> Leaves:
    """`leaves` of a file whose format is sought; none where it cannot be read."""
    try:
        return leaves(path, wanted)[0]
    except InputError:
        return {}


def shapes(values: Mapping[str, NDArray]) -> str:
    """What there is, for a message: "imu.wb 1000x3, imu.t 1000x1"."""
    shown = [f"{name} {v.shape[0]}x{v.shape[1]}" for name, v in values.items()]
    return (
        ", ".join(shown[:SHOWN_NAMES])
        + (f" and {len(shown) - SHOWN_NAMES} more" if len(shown) > SHOWN_NAMES else "")
        or "no matrix of numbers"
    )


def vector(matrix: NDArray) -> NDArray | None:
    """The values of a 1xn or nx1 matrix, else None."""
    return matrix.ravel() if 1 in matrix.shape else None


def _collect(out: Leaves, name: str, value: Any, depth: int) -> None:
    """Matrices of numbers below a variable: structs by field, struct arrays by element from 1."""
    if not isinstance(value, np.ndarray) or depth > MAX_FIELD_DEPTH:
        return
    if value.dtype.names:
        elements = value.ravel()[:MAX_ELEMENTS]
        for k, element in enumerate(elements):
            label = name if elements.size == 1 else f"{name}({k + 1})"
            for field in value.dtype.names:
                _collect(out, f"{label}.{field}", element[field], depth + 1)
    elif value.dtype.kind in "fiu" and value.ndim == 2 and value.size:
        out[name] = np.asarray(value, dtype=np.float64)


def _column(values: Leaves, text: str, path: Path) -> NDArray:
    found = EXPRESSION.match(text)
    if found is None:
        raise MapError(
            f"map: column {text!r}, needed a name such as time, imu.wb[0] or imu.wb(:,1)"
        )
    matrix = values.get(found["name"])
    if matrix is None:
        held = values or leaves(path)[0]
        raise InputError(f"{path.name}: no matrix {found['name']}, has {shapes(held)}")
    k = (
        int(found["from0"])
        if found["from0"]
        else int(found["from1"]) - 1
        if found["from1"]
        else None
    )
    if k is None:
        alone = vector(matrix)
        if alone is None:
            raise InputError(
                f"{path.name}: {text} is {shapes({text: matrix})}, needed which column: {text}[0]"
                " is the first"
            )
        return alone
    if not 0 <= k < matrix.shape[1]:
        raise InputError(f"{path.name}: {text}: {found['name']} has {matrix.shape[1]} columns")
    return np.ascontiguousarray(matrix[:, k])
