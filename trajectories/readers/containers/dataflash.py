"""ArduPilot DataFlash logs (.bin): messages that describe themselves, cut into tables of columns.

A message is A3 95, its type (one byte) and a body of fixed length; messages of type 128 (FMT) say
what a type holds. There is no checksum: a message counts only where another one, or the end of the
file, follows it at once, so that one with bytes lost or added never passes. Everything skipped is
noted by its bytes.

Decision: docs/decisions/0087-libraries-in-a-child.md.
"""

import struct
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ins.records import InputError
from ins.user_input import open_regular
from trajectories.readers.containers.unpacking import read_whole
from trajectories.runs.notes import About, Note, labelled
from trajectories.runs.text_rows import LISTED_ROWS

SYNC = b"\xa3\x95"
FMT_TYPE = 128  # of the message that describes the others
FMT_LENGTH = 89  # bytes of it, head and body
# type, length with head, name, one letter a field, names of the fields
FMT_BODY = struct.Struct("<BB4s16s64s")
# Letter of a field -> type in the file and factor to the plain unit (ArduPilot,
# AP_Logger/LogStructure.h).
FIELDS: dict[str, tuple[str, float]] = {
    "a": ("<32i2", 1.0),
    "b": ("<i1", 1.0),
    "B": ("<u1", 1.0),
    "h": ("<i2", 1.0),
    "H": ("<u2", 1.0),
    "i": ("<i4", 1.0),
    "I": ("<u4", 1.0),
    "f": ("<f4", 1.0),
    "d": ("<f8", 1.0),
    "g": ("<f2", 1.0),
    "n": ("S4", 1.0),
    "N": ("S16", 1.0),
    "Z": ("S64", 1.0),
    "M": ("<u1", 1.0),
    "q": ("<i8", 1.0),
    "Q": ("<u8", 1.0),
    "c": ("<i2", 1e-2),
    "C": ("<u2", 1e-2),
    "e": ("<i4", 1e-2),
    "E": ("<u4", 1e-2),
    "L": ("<i4", 1e-7),
}
TEXT_FIELDS = "nNZ"
ARRAY_FIELDS = "a"

Tables = dict[str, dict[str, NDArray]]
"""Messages by name, then by field: float64 or text columns, shape (n,), in the order of the log."""


@dataclass(frozen=True)
class MessageFormat:
    """What an FMT message says of a type: `length` counts the three bytes of the head."""

    name: str
    length: int
    letters: str
    columns: tuple[str, ...]

    @property
    def dtype(self) -> np.dtype:
        return np.dtype([(str(k), FIELDS[letter][0]) for k, letter in enumerate(self.letters)])


@dataclass
class _Walk:
    """What going through the messages finds: offsets of the wanted ones by type, and the stretches
    skipped.
    """

    formats: dict[int, MessageFormat] = field(default_factory=dict)
    lengths: list[int] = field(
        default_factory=lambda: [FMT_LENGTH if k == FMT_TYPE else 0 for k in range(256)]
    )
    offsets: dict[int, list[int]] = field(default_factory=dict)
    skipped: list[tuple[int, int]] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


def is_dataflash(path: Path) -> bool:
    """Whether a file begins with the FMT message that describes FMT messages."""
    with open_regular(path) as file:
        return file.read(4) == SYNC + bytes([FMT_TYPE, FMT_TYPE])


def read_tables(path: Path, wanted: Collection[str]) -> tuple[Tables, list[str]]:
    """The wanted messages of a log with FMT (Type, Name), and notes on what was skipped. InputError
    where none is read.
    """
    data = read_whole(path)
    walk = _walk(data, wanted)
    tables: Tables = {}
    for kind, offsets in walk.offsets.items():
        tables[walk.formats[kind].name] = _columns(data, walk.formats[kind], offsets)
    if not tables:
        raise InputError(f"{path.name}: holds none of the messages {' '.join(sorted(wanted))}")
    names = {kind: form.name for kind, form in walk.formats.items()}
    tables["FMT"] = {
        "Type": np.array(list(names), dtype=np.float64),
        "Name": np.array(list(names.values())),
    }
    notes = [
        labelled(path.name, line) for line in walk.notes + skipped_lines(walk.skipped, len(data))
    ]
    return tables, notes


def _walk(data: bytes, wanted: Collection[str]) -> _Walk:
    walk, at, end = _Walk(), 0, len(data)
    lengths, offsets = walk.lengths, walk.offsets
    while at < end:
        after = _end_of_message(data, at, lengths)
        if not after:
            start, at = at, _next_message(data, at + 1, lengths)
            walk.skipped.append((start, at))
            continue
        kind = data[at + 2]
        if kind == FMT_TYPE:
            _learn(walk, data, at, wanted)
        elif kind in offsets:
            offsets[kind].append(at)
        at = after
    walk.offsets = {kind: found for kind, found in offsets.items() if found}
    return walk


def _end_of_message(data: bytes, at: int, lengths: list[int]) -> int:
    """Where the message at `at` ends; 0 where there is none, it is of unknown type, or no other
    follows it.
    """
    if at + 3 > len(data) or data[at] != SYNC[0] or data[at + 1] != SYNC[1]:
        return 0
    after = at + lengths[data[at + 2]]
    if after == at or after > len(data) or (after < len(data) and data[after] != SYNC[0]):
        return 0
    return 0 if after + 1 < len(data) and data[after + 1] != SYNC[1] else after


def _next_message(data: bytes, start: int, lengths: list[int]) -> int:
    """The next place from `start` on where a whole message begins; the end of the data where there
    is none.
    """
    at = data.find(SYNC, start)
    while at >= 0:
        if _end_of_message(data, at, lengths):
            return at
        at = data.find(SYNC, at + 1)
    return len(data)


def _learn(walk: _Walk, data: bytes, at: int, wanted: Collection[str]) -> None:
    """Take up what an FMT message says; a garbled or contradicting one is noted and not used."""
    kind, length, *texts = FMT_BODY.unpack_from(data, at + 3)
    name, letters, labels = (
        text.split(b"\0")[0].decode("ascii", errors="replace") for text in texts
    )
    columns = tuple(labels.split(",")) if labels else ()  # STRT of old firmware has no field
    found = MessageFormat(name=name, length=length, letters=letters, columns=columns)
    known = (
        set(letters) <= set(FIELDS) and len(letters) == len(set(columns)) and name.isidentifier()
    )
    if kind == FMT_TYPE:
        return
    if not known or length != 3 + found.dtype.itemsize or kind == 0:
        told = f"byte {at}: format of message type {kind} garbled, its messages are not read"
        walk.notes.append(Note(told, About.DAMAGE))
    elif walk.formats.setdefault(kind, found) != found:
        walk.notes.append(
            f"byte {at}: another format for message type {kind} ({name}), the first one kept"
        )
    else:
        walk.lengths[kind] = length
        if name in wanted:
            walk.offsets.setdefault(kind, [])


def _columns(data: bytes, form: MessageFormat, offsets: list[int]) -> dict[str, NDArray]:
    """The fields of messages at the given offsets, scaled to plain units; arrays within a message
    are left out.
    """
    rows = np.frombuffer(
        b"".join(data[at + 3 : at + form.length] for at in offsets), dtype=form.dtype
    )
    columns: dict[str, NDArray] = {}
    for k, (name, letter) in enumerate(zip(form.columns, form.letters)):
        if letter in TEXT_FIELDS:
            columns[name] = np.array(
                [text.decode("ascii", errors="replace") for text in rows[str(k)].tolist()]
            )
        elif letter not in ARRAY_FIELDS:
            with np.errstate(invalid="ignore"):  # damaged floats
                columns[name] = rows[str(k)].astype(np.float64) * FIELDS[letter][1]
    return columns


def skipped_lines(skipped: Sequence[tuple[int, int]], size: int) -> list[str]:
    """One line for all damaged stretches (first byte, byte after), one for a file that ends within
    a message.
    """
    lines: list[str] = []
    damaged = list(skipped)
    if damaged and damaged[-1][1] == size:
        start, _ = damaged.pop()
        told = f"ends within a message, the last {size - start} bytes (from byte {start}) dropped"
        lines.append(Note(told, About.DAMAGE))
    if damaged:
        total = sum(b - a for a, b in damaged)
        shown = ", ".join(f"{a}-{b - 1}" for a, b in damaged[:LISTED_ROWS])
        more = (
            f" and {len(damaged) - LISTED_ROWS} more stretches"
            if len(damaged) > LISTED_ROWS
            else ""
        )
        told = f"{total} of {size} bytes damaged, skipped: bytes {shown}{more}"
        lines.append(Note(told, About.DAMAGE))
    return lines
