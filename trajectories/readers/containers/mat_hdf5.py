"""Values of MATLAB files of version 7.3, which are HDF5, by h5py: for the child of
`readers.contained` alone.

The library hands on what a chunk's bytes are whatever their number, so chunks are unpacked here, to
their declared size; and it follows links and external values to other files, so only what lies in
the file itself is read. A dataset with the attribute MATLAB_class is turned round (MATLAB stores by
columns); one without, in a file of another program, is taken as it lies. Source: MathWorks,
MAT-File Versions; HDF5 File Format Specification.

Decision: docs/decisions/0087-libraries-in-a-child.md.
"""

import math
from collections.abc import Collection, Iterator
from itertools import product
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from ins.records import InputError
from trajectories.readers.contained import Contents
from trajectories.readers.containers.mat_file import MAX_ELEMENTS, MAX_FIELD_DEPTH
from trajectories.readers.containers.unpacking import Damaged, inflated
from trajectories.runs.limits import NUMBER_BYTES, Room
from trajectories.runs.notes import About, Note

MAX_NAME = 200  # characters; MATLAB's own names had at most 63 (namelengthmax)
# what the library raises for damaged files, whatever is wrong with them
DAMAGE = (OSError, RuntimeError, KeyError, ValueError, TypeError, AttributeError, Damaged)


def contents(path: Path, wanted: Collection[str] | None) -> Contents:
    """As `mat_level5.contents`; a group is a struct. Complex numbers are passed over."""
    notes: list[str] = []
    arrays: dict[str, NDArray] = {}
    try:
        with h5py.File(path, "r") as file:
            reader = _Reader(file, Room(path.stat().st_size, path.name))
            for name in _members(file):
                if wanted is not None and name not in wanted:
                    continue
                try:
                    arrays |= reader.leaves(name, file[name])
                except InputError:
                    raise
                except DAMAGE as error:
                    told = f"{path.name}: variable {name} damaged ({_short(error)}), not read"
                    notes.append(Note(told, About.DAMAGE))
    except InputError:
        raise
    except DAMAGE as error:
        raise InputError(f"{path.name}: HDF5 that cannot be opened: {_short(error)}") from None
    return arrays, notes


def _members(group: Any) -> Iterator[str]:
    """Names of what lies in the file itself, without MATLAB's own (#refs#, #subsystem#)."""
    for name in group:
        is_own = isinstance(group.get(name, getlink=True), h5py.HardLink)
        if is_own and not name.startswith("#") and len(name) <= MAX_NAME:
            yield name


class _Reader:
    """Values of one file; `room` is asked before anything is made."""

    def __init__(self, file: Any, room: Room) -> None:
        self._file, self._room = file, room
        self._file_bytes = file.id.get_filesize()

    def leaves(self, name: str, item: Any, depth: int = 0) -> dict[str, NDArray]:
        """What is below a group or dataset, by full name."""
        if depth > MAX_FIELD_DEPTH:
            return {}
        if isinstance(item, h5py.Group):
            return self._struct(name, item, depth)
        if not isinstance(item, h5py.Dataset):
            return {}
        if item.external or item.is_virtual:
            raise Damaged("its values are in another file")
        if item.dtype == h5py.ref_dtype:
            texts = [self._first_row(cell) for cell in self._referred(item)]
            return {name: np.array(texts)} if any(texts) else {}
        if item.dtype.kind not in "fiu" or _class_of(item) in ("char", "function_handle"):
            return {}
        return self._matrix(name, item)

    def _struct(self, name: str, group: Any, depth: int) -> dict[str, NDArray]:
        """Fields; where each refers to as many values, the struct is an array of so many."""
        found: dict[str, NDArray] = {}
        fields = {field: group[field] for field in _members(group)}
        sizes = {_elements(item) for item in fields.values()}
        is_array = len(sizes) == 1 and all(_is_field(item) for item in fields.values())
        for field, item in fields.items():
            if not is_array:
                found |= self.leaves(f"{name}.{field}", item, depth + 1)
                continue
            for k, value in enumerate(self._referred(item)[:MAX_ELEMENTS]):
                label = name if sizes == {1} else f"{name}({k + 1})"
                found |= self.leaves(f"{label}.{field}", value, depth + 1)
        return found

    def _referred(self, item: Any) -> list[Any]:
        """What the cells of a dataset refer to, in MATLAB's order."""
        references = self._stored(item).ravel()
        return [self._file[reference] if reference else None for reference in references]

    def _matrix(self, name: str, item: Any) -> dict[str, NDArray]:
        """Numbers of any type, in MATLAB's order of rows and columns."""
        count = _elements(item)
        if "MATLAB_empty" in item.attrs or len(item.shape) > 2 or not count:
            return {}
        self._room.take(count * max(NUMBER_BYTES, item.dtype.itemsize))
        values = self._stored(item).astype(np.float64, copy=False)
        if values.ndim < 2:
            return {name: values.reshape(-1, 1)}
        return {name: values.T if _class_of(item) else values}

    def _first_row(self, cell: Any) -> str:
        """Of a text; empty for any other cell."""
        if not isinstance(cell, h5py.Dataset) or _class_of(cell) != "char":
            return ""
        if cell.external or cell.is_virtual or len(cell.shape) != 2 or not _elements(cell):
            return ""
        self._room.take(_elements(cell) * NUMBER_BYTES)
        row = self._stored(cell).T[0].astype("<u2")
        return row.tobytes().decode("utf-16-le", errors="replace")

    def _stored(self, item: Any) -> NDArray:
        """The values of a dataset as they lie in the file: in one piece, or by chunks."""
        if item.chunks is None or not item.size:
            return np.asarray(item[()])
        chunk_bytes = math.prod(item.chunks) * item.dtype.itemsize
        counts = [-(-size // step) for size, step in zip(item.shape, item.chunks)]
        if item.compression not in (None, "gzip") or item.fletcher32 or item.scaleoffset:
            raise Damaged(f"packed by {item.compression or 'a filter'}: needed gzip")
        out = np.zeros(item.shape, dtype=item.dtype)
        for place in product(*(range(n) for n in counts)):
            start = tuple(k * step for k, step in zip(place, item.chunks))
            stored = item.id.get_chunk_info_by_coord(start).size
            if not stored:
                continue
            if stored > self._file_bytes:
                raise Damaged(f"a chunk of {stored} bytes in a file of {self._file_bytes}")
            mask, packed = item.id.read_direct_chunk(start)
            values = _unpacked(item, mask, bytes(packed), chunk_bytes)
            part = out[tuple(slice(a, a + step) for a, step in zip(start, item.chunks))]
            part[...] = values[tuple(slice(0, n) for n in part.shape)]
        return out


def _unpacked(item: Any, mask: int, data: bytes, chunk_bytes: int) -> NDArray:
    """One chunk; mask: which filters of the dataset were not applied to it, in their order."""
    filters = {"shuffle": bool(item.shuffle), "gzip": item.compression == "gzip"}
    present = [name for name, is_set in filters.items() if is_set]
    applied = [name for k, name in enumerate(present) if not mask >> k & 1]
    if "gzip" in applied:
        data = inflated(memoryview(data), chunk_bytes)
    if len(data) != chunk_bytes:
        raise Damaged(f"{len(data)} bytes in a chunk, needed {chunk_bytes}")
    if "shuffle" in applied:
        size = item.dtype.itemsize
        data = np.frombuffer(data, dtype=np.uint8).reshape(size, -1).T.tobytes()
    return np.frombuffer(data, dtype=item.dtype).reshape(item.chunks)


def _elements(item: Any) -> int:
    return math.prod(getattr(item, "shape", None) or (0,))


def _class_of(item: Any) -> str:
    """MATLAB's class of a dataset; empty where another program wrote it."""
    named = item.attrs.get("MATLAB_class", b"")
    return named.decode("ascii", errors="replace") if isinstance(named, bytes) else str(named)


def _is_field(item: Any) -> bool:
    """Whether a dataset refers to the values of one field of an array of structs: references
    without a class of their own, where cells have one.
    """
    refers = isinstance(item, h5py.Dataset) and item.dtype == h5py.ref_dtype
    return refers and not _class_of(item)


def _short(error: Exception) -> str:
    return " ".join(str(error).split())[:120] or type(error).__name__
