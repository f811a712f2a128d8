"""MATLAB files (version 5 to 7.2), a variable at a time, so that a damaged or cut-off one costs no
other.

A file is a head of 128 bytes and elements: type and length (4 bytes each), then that many bytes.
"""

import struct
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from ins.records import InputError
from trajectories.readers.containers.file_bytes import read_whole
from trajectories.readers.containers.mat_arrays import MatArray
from trajectories.readers.containers.unpacking import Damaged, inflated
from trajectories.runs.notes import About, Note

MAT_HEAD_BYTES = 128
# Types of an element that holds a variable.
ARRAY = 14
COMPRESSED = 15
HDF5 = b"\x89HDF"


def is_mat(path: Path) -> bool:
    """Whether a file is of version 5 to 7.2, which can be read."""
    with path.open("rb") as file:
        return file.read(MAT_HEAD_BYTES).startswith(b"MATLAB 5.0 MAT-file")


def is_matlab(path: Path) -> bool:
    """Whether a file is of version 5 or later; 7.3 is HDF5 behind a head of its own, and refused
    when read.
    """
    with path.open("rb") as file:
        head = file.read(MAT_HEAD_BYTES)
    return head.startswith((b"MATLAB 5.0 MAT-file", b"MATLAB 7.3 MAT-file", HDF5))


def variable_names(path: Path) -> set[str]:
    """Names of the variables that can be read."""
    return {array.name for _, array in _arrays(path, [])}


def read_variables(path: Path, wanted: Callable[[str], bool]) -> tuple[dict[str, Any], list[str]]:
    """Variables by name as `scipy.io.loadmat` gives them, and notes on damaged ones. InputError for
    another format.
    """
    if not is_mat(path):
        what = "a MATLAB file of version 7.3 (HDF5)" if is_matlab(path) else "no MATLAB file"
        raise InputError(f"{path.name}: {what}, needed version 5 to 7.2: in MATLAB save with -v7")
    notes: list[str] = []
    found: dict[str, Any] = {}
    for at, array in _arrays(path, notes):
        try:
            value = array.value() if wanted(array.name) else None
        except Damaged as error:
            notes.append(_told(path, at, error))
            continue
        if value is not None:
            found[array.name] = value
    return found, notes


def _arrays(path: Path, notes: list[str]) -> Iterator[tuple[int, MatArray]]:
    """Place and array of each variable whose head can be read."""
    data = memoryview(read_whole(path))
    size = len(data)
    order = ">" if bytes(data[126:128]) == b"MI" else "<"
    at = MAT_HEAD_BYTES
    while at + 8 <= size:
        kind, length = struct.unpack_from(order + "II", data, at)
        after = at + 8 + length
        if after > size or kind not in (ARRAY, COMPRESSED):
            break
        try:
            yield at, _array(data[at + 8 : after], kind, order)
        except Damaged as error:
            notes.append(_told(path, at, error))
        at = after
    if at < size:
        what = "cut off" if size - at < 8 or kind in (ARRAY, COMPRESSED) else "damaged"
        told = f"{path.name}: {what} at byte {at}: the last {size - at} bytes dropped"
        notes.append(Note(told, About.DAMAGE))


def _array(body: memoryview, kind: int, order: str) -> MatArray:
    if kind == ARRAY:
        return MatArray(body, order)
    plain = memoryview(inflated(body))
    if len(plain) < 8 or struct.unpack_from(order + "I", plain)[0] != ARRAY:
        raise Damaged("no array in it")
    return MatArray(plain[8 : 8 + struct.unpack_from(order + "I", plain, 4)[0]], order)


def _told(path: Path, at: int, error: Damaged) -> str:
    told = f"{path.name}: variable at byte {at} damaged ({error}), not read"
    return Note(told, About.DAMAGE)
