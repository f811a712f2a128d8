"""MATLAB files of version 7.3, which are HDF5, read by h5py: values as those of older versions.

Libraries of HDF5 unpack a chunk to whatever its bytes make of it and follow links to other files;
so chunks are unpacked here, within their declared size, and only what lies in the file itself is
read. A dataset with the attribute MATLAB_class is turned round (MATLAB stores by columns); one
without, in a file of another program, is taken as it lies. Passed over: objects, functions, sparse
arrays, complex numbers. Source: MathWorks, MAT-File Versions; HDF5 File Format Specification.

Decision: docs/decisions/0082-hdf5-chunks.md.
"""

import importlib
import math
from collections.abc import Callable, Iterator
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ins.records import InputError
from trajectories.readers.containers.mat_arrays import (
    CHARACTER_BYTES,
    MAX_ARRAY_DEPTH,
    MAX_DIMENSIONS,
    MAX_NAME,
    OBJECT_BYTES,
)
from trajectories.readers.containers.unpacking import Damaged, inflated
from trajectories.runs.limits import NUMBER_BYTES, Room
from trajectories.runs.notes import About, Note

HDF5_EXTRA = "pip install strapdown-recal[hdf5]"
# of a dataset; chosen: a MATLAB chunk has some thousand numbers, 100,000 of them are a long log
MAX_CHUNKS = 100_000
# of groups, datasets, cells that are looked at; chosen: logs have some 100
MAX_OBJECTS = 20_000
# what the library raises for damaged files, whatever is wrong with them
DAMAGE = (OSError, RuntimeError, KeyError, ValueError, TypeError, AttributeError)


def library() -> Any:
    """The module h5py; None where it is not installed."""
    try:
        return importlib.import_module("h5py")
    except ImportError:
        return None


def variable_names(path: Path) -> set[str]:
    """Names of the variables of a file; empty where it cannot be opened."""
    h5py = library()
    try:
        with h5py.File(path, "r") as file:
            return set(_members(h5py, file))
    except DAMAGE:
        return set()


def read_variables(
    path: Path, wanted: Callable[[str], bool]
) -> tuple[dict[str, NDArray], list[str]]:
    """Variables by name, and notes on damaged ones. InputError where the file is no HDF5, or
    unpacks to more than it may.
    """
    h5py = library()
    if h5py is None:
        raise InputError(
            f"{path.name}: a MATLAB file of version 7.3 (HDF5): needed the library of"
            f" {HDF5_EXTRA}, or in MATLAB save with -v7"
        )
    notes: list[str] = []
    found: dict[str, NDArray] = {}
    try:
        with h5py.File(path, "r") as file:
            reader = _Reader(h5py, file, Room(path.stat().st_size, path.name))
            for name in filter(wanted, _members(h5py, file)):
                try:
                    value = reader.value(file[name], 0)
                except InputError:
                    raise
                except (Damaged, *DAMAGE) as error:
                    notes.append(_told(path, name, error))
                    continue
                if value is not None:
                    found[name] = value
    except InputError:
        raise
    except DAMAGE as error:
        raise InputError(f"{path.name}: HDF5 that cannot be opened: {_short(error)}") from None
    return found, notes


def _members(h5py: Any, group: Any) -> Iterator[str]:
    """Names of what lies in the file itself, without MATLAB's own (#refs#, #subsystem#)."""
    for name in group:
        is_own = isinstance(group.get(name, getlink=True), h5py.HardLink)
        if is_own and not name.startswith("#") and len(name) <= MAX_NAME:
            yield name


class _Reader:
    """Values of one file; `room` is asked before anything is made."""

    def __init__(self, h5py: Any, file: Any, room: Room) -> None:
        self._h5py, self._file, self._room = h5py, file, room
        self._objects = 0
        self._file_bytes = file.id.get_filesize()

    def value(self, item: Any, depth: int) -> NDArray | None:
        """A matrix of numbers, texts by row, an object array of cells, a record of a struct; None
        for what is passed over.
        """
        self._objects += 1
        self._room.take(OBJECT_BYTES)
        if depth > MAX_ARRAY_DEPTH or self._objects > MAX_OBJECTS:
            raise Damaged("nested too deeply, or too many parts")
        if isinstance(item, self._h5py.Group):
            return self._struct(item, depth)
        if not isinstance(item, self._h5py.Dataset):
            return None
        kind = _class_of(item)
        if item.dtype == self._h5py.ref_dtype:
            return self._referred(item, depth)
        if item.dtype.kind not in "fiu" or kind == "function_handle":
            return None
        values = self._numbers(item)
        if kind == "char":
            return self._texts(values)
        return values

    def _struct(self, group: Any, depth: int) -> NDArray:
        """A record of one element; a field that refers to others is one of an array of structs."""
        names = list(_members(self._h5py, group))
        values = [self.value(group[name], depth + 1) for name in names]
        sizes = {_elements(group[name]) for name in names}
        count = sizes.pop() if len(sizes) == 1 else 0
        is_array = count > 0 and all(_is_field(self._h5py, group[name]) for name in names)
        out = np.empty(count if is_array else 1, dtype=[(name, object) for name in names])
        for name, value in zip(names, values):
            kept = np.empty((0, 0)) if value is None else value
            for k in range(out.size):
                out[name][k] = kept.ravel()[k] if is_array else kept
        return out.reshape(-1, 1)

    def _referred(self, item: Any, depth: int) -> NDArray:
        """The cells that a dataset of references names."""
        self._room.take(_elements(item) * OBJECT_BYTES)
        if _elements(item) > MAX_OBJECTS:
            raise Damaged(f"{_elements(item)} cells")
        found = self._stored(item)
        out = np.empty(found.size, dtype=object)
        for k, reference in enumerate(found.ravel()):
            value = self.value(self._file[reference], depth + 1) if reference else None
            out[k] = np.empty((0, 0)) if value is None else value
        return out.reshape(found.shape).T

    def _numbers(self, item: Any) -> NDArray:
        """Numbers of any type, in MATLAB's order of rows and columns."""
        count = _elements(item)
        if len(item.shape) > MAX_DIMENSIONS:
            raise Damaged(f"{len(item.shape)} dimensions")
        if "MATLAB_empty" in item.attrs:
            return np.empty((0, 0))
        self._room.take(count * max(NUMBER_BYTES, item.dtype.itemsize))
        values = self._stored(item)
        if values.ndim < 2:
            return values.reshape(-1, 1)
        return values.T if _class_of(item) else values

    def _texts(self, codes: NDArray) -> NDArray:
        self._room.take(codes.size * CHARACTER_BYTES)
        if codes.ndim != 2 or not codes.size:
            return np.array([], dtype="U1")
        rows = codes.astype(np.uint16)
        return np.array([row.tobytes().decode("utf-16-le", errors="replace") for row in rows])

    def _stored(self, item: Any) -> NDArray:
        """The values of a dataset as they lie in the file: in one piece, or by chunks."""
        if item.external or item.is_virtual:
            raise Damaged("its values are in another file")
        if item.chunks is None or not item.size:
            return np.asarray(item[()])
        return self._chunked(item)

    def _chunked(self, item: Any) -> NDArray:
        chunk_bytes = math.prod(item.chunks) * item.dtype.itemsize
        self._room.check(chunk_bytes)
        counts = [-(-size // step) for size, step in zip(item.shape, item.chunks)]
        if math.prod(counts) > MAX_CHUNKS:
            raise Damaged(f"{math.prod(counts)} chunks")
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
            values = _unpacked(item, mask, memoryview(packed), chunk_bytes)
            here = tuple(slice(a, a + step) for a, step in zip(start, item.chunks))
            part = out[here]
            part[...] = values[tuple(slice(0, n) for n in part.shape)]
        return out


def _unpacked(item: Any, mask: int, packed: memoryview, chunk_bytes: int) -> NDArray:
    """One chunk; mask: which filters of the dataset were not applied to it, in their order."""
    filters = [name for name in ("shuffle", "gzip") if _has(item, name)]
    applied = [name for k, name in enumerate(filters) if not mask >> k & 1]
    data = bytes(packed)
    if "gzip" in applied:
        data = inflated(packed, chunk_bytes)
    if len(data) != chunk_bytes:
        raise Damaged(f"{len(data)} bytes in a chunk, needed {chunk_bytes}")
    if "shuffle" in applied:
        size = item.dtype.itemsize
        data = np.frombuffer(data, dtype=np.uint8).reshape(size, -1).T.tobytes()
    return np.frombuffer(data, dtype=item.dtype).reshape(item.chunks)


def _has(item: Any, name: str) -> bool:
    return bool(item.shuffle) if name == "shuffle" else item.compression == "gzip"


def _elements(item: Any) -> int:
    return math.prod(getattr(item, "shape", None) or (0,))


def _class_of(item: Any) -> str:
    """MATLAB's class of a dataset; empty where another program wrote it."""
    named = item.attrs.get("MATLAB_class", b"")
    return named.decode("ascii", errors="replace") if isinstance(named, bytes) else str(named)


def _is_field(h5py: Any, item: Any) -> bool:
    """Whether a dataset refers to the values of one field of an array of structs: references
    without a class of their own, where cells have one.
    """
    refers = isinstance(item, h5py.Dataset) and item.dtype == h5py.ref_dtype
    return refers and not _class_of(item)


def _short(error: Exception) -> str:
    return " ".join(str(error).split())[:120] or type(error).__name__


def _told(path: Path, name: str, error: Exception) -> str:
    told = f"{path.name}: variable {name} damaged ({_short(error)}), not read"
    return Note(told, About.DAMAGE)
