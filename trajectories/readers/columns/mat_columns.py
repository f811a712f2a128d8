"""Columns of a MATLAB file by expressions: a vector, a column of a matrix, a field of a struct.

`imu.wb[0]` counts columns from 0, `imu.wb(:,1)` from 1 as MATLAB does; a vector needs neither. An
element of a struct array is `imu(2).wb`. Version 7.3 is HDF5; an HDF5 file of another program is
read too, with its groups as structs.
"""

import re
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ins.records import InputError
from trajectories.readers.containers.mat_file import arrays_at_once, read_arrays
from trajectories.readers.rows.column_map import LayoutKeys, MapError

EXPRESSION = re.compile(
    r"^(?P<name>[A-Za-z]\w*(?:\(\d+\))?(?:\.[A-Za-z]\w*(?:\(\d+\))?)*)(?:\[(?P<from0>\d+)\]|\(:,"
    r" ?(?P<from1>\d+)\))?$"
)
SHOWN_NAMES = 12  # names of a message; 12 of about 15 characters are three lines of a terminal

Leaves = dict[str, NDArray]


def mat_columns(
    path: Path, layout: LayoutKeys, used: Sequence[str]
) -> tuple[dict[str, NDArray], list[str]]:
    """The used columns by their expressions, shape (n,) each; InputError lists what the file
    holds.
    """
    roots = {name.split(".")[0].split("(")[0].split("[")[0] for name in used}
    values, notes = leaves(path, roots)
    try:
        return {name: _column(values, name, path) for name in used}, notes
    except InputError as error:
        raise InputError(f"{error} ({notes[0]})" if notes else str(error)) from None


def leaves(path: Path, wanted: Collection[str] | None = None) -> tuple[Leaves, list[str]]:
    """All real matrices in a file, or in some of its variables, by their full name (`imu.wb`),
    two-dimensional float64, and notes on damaged variables.
    """
    arrays, notes = read_arrays(path, wanted)
    return _matrices(arrays), notes


def leaves_at_once(path: Path) -> Leaves:
    """`leaves` of a file whose format is sought; none where it cannot be read."""
    return _matrices(arrays_at_once(path))


def _matrices(arrays: Mapping[str, NDArray]) -> Leaves:
    return {name: values for name, values in arrays.items() if values.dtype.kind == "f"}


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
