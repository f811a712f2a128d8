"""MATLAB files, a variable at a time, so that a damaged or cut-off one costs no other.

Version 7.3 is HDF5 (`trajectories.readers.containers.mat_hdf5`). A file of version 5 to 7.2 is a
head of 128 bytes and elements: type and length (4 bytes each), then that many bytes.
"""

import struct
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from ins.records import InputError
from ins.user_input import open_regular
from trajectories.readers.containers import mat_hdf5
from trajectories.readers.containers.file_bytes import read_whole
from trajectories.readers.containers.mat_arrays import MatArray
from trajectories.readers.containers.unpacking import Damaged, inflated
from trajectories.runs.limits import NUMBER_BYTES, Room
from trajectories.runs.notes import About, Note

MAT_HEAD_BYTES = 128
ELEMENT_HEAD_BYTES = 8  # kind and length, 4 bytes each (MAT-File Level 5)
HEAD_BYTES = 4096  # of a packed variable: flags, dimensions and name have 300 at most
# Types of an element that holds a variable.
ARRAY = 14
COMPRESSED = 15
VERSION_5, VERSION_7_3 = b"MATLAB 5.0 MAT-file", b"MATLAB 7.3 MAT-file"
HDF5 = b"\x89HDF"


def is_mat(path: Path) -> bool:
    """Whether a file is MATLAB's, of a version that can be read here: 5 to 7.2, and 7.3 where the
    library for HDF5 is there.
    """
    return _head(path).startswith(VERSION_5) or (_is_hdf5(path) and mat_hdf5.library() is not None)


def is_matlab(path: Path) -> bool:
    """Whether a file is of version 5 or later, or HDF5 of another program."""
    return _head(path).startswith(VERSION_5) or _is_hdf5(path)


def _is_hdf5(path: Path) -> bool:
    """Version 7.3 has a head of its own before that of HDF5."""
    return _head(path).startswith((VERSION_7_3, HDF5))


def _head(path: Path) -> bytes:
    with open_regular(path) as file:
        return file.read(MAT_HEAD_BYTES)


def variable_names(path: Path) -> set[str]:
    """Names of the variables that can be read."""
    if _is_hdf5(path):
        return mat_hdf5.variable_names(path)
    return {variable.name for variable in _variables(path, [])}


def read_variables(path: Path, wanted: Callable[[str], bool]) -> tuple[dict[str, Any], list[str]]:
    """Variables by name as `scipy.io.loadmat` gives them, and notes on damaged ones. InputError for
    another format, or where they unpack to more than they may.
    """
    if _is_hdf5(path):
        return mat_hdf5.read_variables(path, wanted)
    if not is_mat(path):
        raise InputError(f"{path.name}: no MATLAB file, needed version 5 or later")
    notes: list[str] = []
    found: dict[str, Any] = {}
    for variable in _variables(path, notes):
        try:
            value = variable.value() if wanted(variable.name) else None
        except Damaged as error:
            notes.append(_told(path, variable.at, error))
            continue
        if value is not None:
            found[variable.name] = value
    return found, notes


class _Variable:
    """A variable of a file: place and name at once, its values on demand. A packed one is not
    unpacked for its name beyond its head.
    """

    def __init__(self, at: int, body: memoryview, kind: int, order: str, room: Room) -> None:
        self.at, self._body, self._kind, self._order, self._room = at, body, kind, order, room
        head = body if kind == ARRAY else _matrix(inflated(body, HEAD_BYTES, whole=False), order)
        array = MatArray(head, order, room)
        self.name, self._number_bytes = array.name, array.number_bytes

    def value(self) -> NDArray | None:
        """As `MatArray.value` gives it."""
        body = self._body
        if self._kind != ARRAY:
            declared = _declared(inflated(body, HEAD_BYTES, whole=False), self._order)
            if self._number_bytes <= NUMBER_BYTES * declared:  # else the dimensions lie
                self._room.check(self._number_bytes)
            self._room.take(declared)
            body = _matrix(inflated(body, declared + ELEMENT_HEAD_BYTES), self._order)
        return MatArray(body, self._order, self._room).value()


def _variables(path: Path, notes: list[str]) -> Iterator[_Variable]:
    """The variables whose head can be read."""
    data = memoryview(read_whole(path))
    size = len(data)
    room = Room(size, path.name)
    order = ">" if bytes(data[126:128]) == b"MI" else "<"
    at = MAT_HEAD_BYTES
    while at + ELEMENT_HEAD_BYTES <= size:
        kind, length = struct.unpack_from(order + "II", data, at)
        after = at + ELEMENT_HEAD_BYTES + length
        if after > size or kind not in (ARRAY, COMPRESSED):
            break
        try:
            yield _Variable(at, data[at + ELEMENT_HEAD_BYTES : after], kind, order, room)
        except Damaged as error:
            notes.append(_told(path, at, error))
        at = after
    if at < size:
        left = size - at
        known = left < ELEMENT_HEAD_BYTES or kind in (ARRAY, COMPRESSED)
        what = "cut off" if known else "damaged"
        told = f"{path.name}: {what} at byte {at}: the last {left} bytes dropped"
        notes.append(Note(told, About.DAMAGE))


def _declared(plain: bytes, order: str) -> int:
    """The length of the array that an unpacked element says it is."""
    if len(plain) < ELEMENT_HEAD_BYTES or struct.unpack_from(order + "I", plain)[0] != ARRAY:
        raise Damaged("no array in it")
    return int(struct.unpack_from(order + "I", plain, 4)[0])


def _matrix(plain: bytes, order: str) -> memoryview:
    """The array within an unpacked element, or as much of it as there is."""
    end = ELEMENT_HEAD_BYTES + _declared(plain, order)
    return memoryview(plain)[ELEMENT_HEAD_BYTES:end]


def _told(path: Path, at: int, error: Damaged) -> str:
    told = f"{path.name}: variable at byte {at} damaged ({error}), not read"
    return Note(told, About.DAMAGE)
