"""MATLAB files: which they are, and what is in them, read by libraries in a child.

Version 5 to 7.2 are MATLAB's own layout (`mat_elements`, `mat_level5`), version 7.3 is HDF5
(`mat_hdf5`).
"""

import os
import struct
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from io import BufferedReader
from pathlib import Path

from numpy.typing import NDArray

from ins.records import InputError
from ins.user_input import open_regular
from trajectories.readers.contained import Contents, read_contained
from trajectories.readers.containers.unpacking import Damaged, inflated
from trajectories.runs.notes import About, Note

VERSION_5, VERSION_7_3 = b"MATLAB 5.0 MAT-file", b"MATLAB 7.3 MAT-file"
HDF5 = b"\x89HDF"

_sought: dict[tuple[str, int, int], Contents | InputError] = {}
"""The contents of the last file whose format was sought, until its reader takes them."""
MAT_HEAD_BYTES = 128
ELEMENT_HEAD_BYTES = 8  # kind and length, 4 bytes each (MAT-File Level 5)
HEAD_BYTES = 4096  # of a variable: flags, dimensions and name have 300 at most
MAX_FIELD_DEPTH = 4  # of fields within fields; chosen: those of NaveGo and PSINS lie 1 deep
MAX_ELEMENTS = 100  # of an array of structs that are looked at
# Types of an element that holds a variable.
ARRAY = 14
COMPRESSED = 15
# Types of the first three elements of an array: flags (uint32), dimensions (int32), name (int8).
FIRST_TYPES = (6, 5, 1)


def is_matlab(path: Path) -> bool:
    """Whether a file is MATLAB's, of version 5 or later, or HDF5 of another program."""
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
        return {name.split(".")[0].split("(")[0] for name in arrays_at_once(path)}
    return {variable.name for variable in variables(path, [])}


def read_arrays(path: Path, wanted: Collection[str] | None = None) -> Contents:
    """Arrays by full name, and notes on damaged variables, as `mat_level5.contents` gives them.

    Parameters
    ----------
    path : Path
        The file.
    wanted : collection of str, optional
        Names of variables; None is all. More may be given.

    Raises
    ------
    InputError
        For another format, or where they unpack to more than they may.
    """
    kept = _sought.pop(_identity(path), None)
    if isinstance(kept, InputError) and wanted is None:
        raise kept
    if kept is not None and not isinstance(kept, InputError):
        return kept
    return _read(path, wanted)


def arrays_at_once(path: Path) -> dict[str, NDArray]:
    """All arrays of a file whose format is sought; none where it cannot be read."""
    identity = _identity(path)
    kept = _sought.get(identity)
    if kept is None:
        try:
            kept = _read(path, None)
        except InputError as error:
            kept = error
        _sought.clear()
        _sought[identity] = kept
    return {} if isinstance(kept, InputError) else kept[0]


def _read(path: Path, wanted: Collection[str] | None) -> Contents:
    if not is_matlab(path):
        raise InputError(f"{path.name}: no MATLAB file, needed version 5 or later")
    name = "mat_hdf5" if _is_hdf5(path) else "mat_level5"
    return read_contained(f"{__package__}.{name}", path, wanted)


def _identity(path: Path) -> tuple[str, int, int]:
    stat = path.stat()
    return str(path.resolve()), stat.st_size, stat.st_mtime_ns


@dataclass(frozen=True)
class Variable:
    """Where the element of a variable begins, its bytes with its head, its name, and the bytes that
    it has unpacked.
    """

    at: int
    size: int
    name: str
    unpacked: int


def variables(path: Path, notes: list[str]) -> Iterator[Variable]:
    """The variables whose head can be read; notes: of the others, and of where the file ends."""
    with open_regular(path) as file:
        size = os.fstat(file.fileno()).st_size
        order = byte_order(file.read(MAT_HEAD_BYTES))
        at = MAT_HEAD_BYTES
        while at + ELEMENT_HEAD_BYTES <= size:
            file.seek(at)
            kind, length = struct.unpack(order + "II", file.read(ELEMENT_HEAD_BYTES))
            after = at + ELEMENT_HEAD_BYTES + length
            if after > size or kind not in (ARRAY, COMPRESSED):
                break
            try:
                yield _variable(file, at, after, kind, order)
            except Damaged as error:
                notes.append(damaged(path, at, error))
            at = after
    if at < size:
        left = size - at
        known = left < ELEMENT_HEAD_BYTES or kind in (ARRAY, COMPRESSED)
        what = "cut off" if known else "damaged"
        told = f"{path.name}: {what} at byte {at}: the last {left} bytes dropped"
        notes.append(Note(told, About.DAMAGE))


def byte_order(head: bytes) -> str:
    """ "<" or ">", by the last two bytes of a file's head."""
    return ">" if head[126:128] == b"MI" else "<"


def damaged(path: Path, at: int, error: Exception) -> str:
    """The note on a variable that cannot be read."""
    why = " ".join(str(error).split())[:120] or type(error).__name__
    return Note(f"{path.name}: variable at byte {at} damaged ({why}), not read", About.DAMAGE)


def _variable(file: BufferedReader, at: int, after: int, kind: int, order: str) -> Variable:
    """The variable whose element ends before byte `after`; the file stands behind its head."""
    head = file.read(min(HEAD_BYTES, after - at - ELEMENT_HEAD_BYTES))
    unpacked = after - at
    if kind == COMPRESSED:
        head = inflated(memoryview(head), HEAD_BYTES, whole=False)
        inner, unpacked = struct.unpack_from(order + "II", head) if len(head) >= 8 else (0, 0)
        if inner != ARRAY:
            raise Damaged("no array in it")
        head = head[ELEMENT_HEAD_BYTES:]
    return Variable(at=at, size=after - at, name=_variable_name(head, order), unpacked=unpacked)


def _variable_name(body: bytes, order: str) -> str:
    """The name of an array; a small element has its type, length and bytes in eight."""
    at, found = 0, b""
    for needed in FIRST_TYPES:
        if at + ELEMENT_HEAD_BYTES > len(body):
            raise Damaged("an array cut off")
        kind, length = struct.unpack_from(order + "II", body, at)
        start, end = at + 8, at + 8 + length + (-length % 8)
        if kind >> 16:
            kind, length, start, end = kind & 0xFFFF, kind >> 16, at + 4, at + 8
        if kind != needed or start + length > len(body):
            raise Damaged("no flags, dimensions and name")
        found, at = body[start : start + length], end
    return found.decode("latin-1").rstrip("\0")
