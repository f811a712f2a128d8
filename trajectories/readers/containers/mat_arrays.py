"""Arrays of MATLAB files (version 5 to 7.2) out of their bytes: numbers, texts, cells and structs.

Every length is checked against the bytes that are there before anything is made of it (scipy's
reader, the yardstick of the tests, crashes on some damaged files). Sparse arrays, objects and
functions are passed over. Source: MathWorks, MAT-File Format (R2019b), chapter 1.

Decision: docs/decisions/0043-own-bounded-readers.md.
"""

import math
import struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trajectories.readers.containers.unpacking import Damaged
from trajectories.runs.limits import NUMBER_BYTES, Room

MATRIX = 14
STORED = {
    1: "i1",
    2: "u1",
    3: "i2",
    4: "u2",
    5: "i4",
    6: "u4",
    7: "f4",
    9: "f8",
    12: "i8",
    13: "u8",
}
CLASSES = {
    6: "f8",
    7: "f4",
    8: "i1",
    9: "u1",
    10: "i2",
    11: "u2",
    12: "i4",
    13: "u4",
    14: "i8",
    15: "u8",
}
# Classes of an array (MAT-File Format, table of array types).
CELL = 1
STRUCT = 2
CHAR = 4
ENCODINGS = {1: "latin-1", 2: "latin-1", 4: "utf-16", 16: "utf-8", 17: "utf-16", 18: "utf-32"}
COMPLEX = 0x0800
# of cells and structs in each other; chosen: above MAX_FIELD_DEPTH (4), far below Python's 1,000
# calls
MAX_ARRAY_DEPTH = 6
MAX_DIMENSIONS = 8  # of an array; series have 2
MAX_NAME = 200  # bytes; MATLAB's own names had at most 63 (namelengthmax)
OBJECT_BYTES = 200  # that an element of a cell or struct takes at least, be it empty
CHARACTER_BYTES = 8  # of a text, as a text and as a row of an array


class MatArray:
    """One array: its name and shape at once, its values on demand. `order` is "<" or ">"; `room`
    is asked before anything is made.
    """

    def __init__(self, body: memoryview, order: str, room: Room, depth: int = 0) -> None:
        self._data, self._order, self._at, self._depth = body, order, 0, depth
        self._room = room
        if depth > MAX_ARRAY_DEPTH:
            raise Damaged("nested too deeply")
        kind, flags = self._element()
        if STORED.get(kind) != "u4" or len(flags) != 8:
            raise Damaged("no array flags")
        self._flags = struct.unpack(order + "I", flags[:4])[0]
        self._class = self._flags & 0xFF
        self.shape = self._shape()
        self.name = bytes(self._element()[1]).decode("latin-1").rstrip("\0")[:MAX_NAME]

    @property
    def number_bytes(self) -> int:
        """What its numbers will take, as its shape says; 0 for other kinds."""
        return NUMBER_BYTES * math.prod(self.shape) if self._class in CLASSES else 0

    def value(self) -> NDArray | None:
        """As `scipy.io.loadmat` gives it: a matrix of numbers, texts by row, object arrays of
        cells, records of structs.

        None for a kind that is passed over.
        """
        if self._class in CLASSES:
            return self._numbers()
        if self._class == CHAR:
            return self._texts()
        if self._class == CELL:
            return self._filled(np.empty(self._count(), dtype=object)).reshape(
                self.shape, order="F"
            )
        return self._struct() if self._class == STRUCT else None

    def _element(self) -> tuple[int, memoryview]:
        """Type and bytes of the next element; small ones have both in eight bytes."""
        data, at = self._data, self._at
        if at + 8 > len(data):
            raise Damaged("an array cut off")
        kind, length = struct.unpack_from(self._order + "II", data, at)
        if kind >> 16:
            kind, length, start, end = kind & 0xFFFF, kind >> 16, at + 4, at + 8
        else:
            start = at + 8
            end = start + length + (-length % 8)
        if start + length > len(data) or (start == at + 4 and length > 4):
            raise Damaged("an element longer than its array")
        self._at = end
        return kind, data[start : start + length]

    def _shape(self) -> tuple[int, ...]:
        kind, data = self._element()
        if STORED.get(kind) != "i4" or len(data) % 4 or not 8 <= len(data) <= 4 * MAX_DIMENSIONS:
            raise Damaged("no dimensions")
        shape = tuple(int(n) for n in np.frombuffer(data, dtype=self._order + "i4"))
        if min(shape) < 0:
            raise Damaged(f"dimensions {shape}")
        return shape

    def _count(self) -> int:
        """How many arrays a cell or struct says it has; each takes eight bytes at least."""
        count = math.prod(self.shape)
        if count > len(self._data) // 8:
            raise Damaged(f"{count} elements in {len(self._data)} bytes")
        return count

    def _numbers(self) -> NDArray:
        values = self._part()
        if self._flags & COMPLEX:
            return values + 1j * self._part()
        return values

    def _part(self) -> NDArray:
        """The real or imaginary part: stored in as small a type as will do, given back in that of
        its class.
        """
        kind, data = self._element()
        dtype = np.dtype(self._order + STORED[kind]) if kind in STORED else None
        count = math.prod(self.shape)
        self._room.take(count * NUMBER_BYTES if count <= len(data) else 0)
        if dtype is None or len(data) != count * dtype.itemsize:
            raise Damaged(f"{len(data)} bytes for {count} numbers")
        with np.errstate(all="ignore"):
            values = np.frombuffer(data, dtype=dtype).astype(CLASSES[self._class])
        return values.reshape(self.shape, order="F")

    def _texts(self) -> NDArray:
        kind, data = self._element()
        self._room.take(len(data) * CHARACTER_BYTES)
        name = ENCODINGS.get(kind, "")
        if name in ("utf-16", "utf-32"):
            name += "-le" if self._order == "<" else "-be"
        text = bytes(data).decode(name or "latin-1", errors="replace")
        rows = self.shape[0]
        if not name or math.prod(self.shape) != len(text) or len(self.shape) != 2:
            return np.array([text] if text else [])
        return (
            np.array(["".join(text[k::rows]).rstrip(" ") for k in range(rows)])
            if text
            else np.array([], dtype="U1")
        )

    def _struct(self) -> NDArray:
        length_kind, length = self._element()
        _, names = self._element()
        size = (
            struct.unpack(self._order + "i", length)[0]
            if STORED.get(length_kind) == "i4" and len(length) == 4
            else 0
        )
        if not 0 < size <= MAX_NAME or len(names) % size:
            raise Damaged("no field names")
        fields = [
            bytes(names[k : k + size]).split(b"\0")[0].decode("latin-1")
            for k in range(0, len(names), size)
        ]
        count = self._count()
        if (
            len(set(fields)) != len(fields)
            or not all(fields)
            or count * len(fields) > len(self._data) // 8
        ):
            raise Damaged(f"{count} structs of {len(fields)} fields in {len(self._data)} bytes")
        values = self._filled(np.empty(count * len(fields), dtype=object)).reshape(
            count, len(fields)
        )
        out = np.empty(count, dtype=[(name, object) for name in fields])
        for k, name in enumerate(fields):
            out[name] = values[:, k]
        return out.reshape(self.shape, order="F")

    def _filled(self, out: NDArray) -> NDArray:
        """One array after the other; what is passed over, and an array of no bytes, is an empty
        matrix.
        """
        self._room.take(out.size * OBJECT_BYTES)
        for k in range(out.size):
            kind, body = self._element()
            if kind != MATRIX:
                raise Damaged(f"type {kind} where an array should be")
            value: Any = None
            if len(body):
                value = MatArray(body, self._order, self._room, self._depth + 1).value()
            out[k] = np.empty((0, 0)) if value is None else value
        return out
