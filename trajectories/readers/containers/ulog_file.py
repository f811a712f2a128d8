"""ULog files (PX4) as tables: messages whose formats the file itself declares.

A message is its length (2 bytes), type (1 byte) and body. There is no checksum and no mark where
one begins: a message counts only where another one, or the end of the file, follows it, and after
damage three in a row must fit. Everything skipped is noted by its bytes. (pyulog is the yardstick
of the tests: it does not come back from some damaged files.) Source: PX4 user guide, "ULog File
Format".

Decision: docs/decisions/0087-libraries-in-a-child.md.
"""

import re
import struct
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ins.records import InputError
from ins.user_input import open_regular
from trajectories.readers.containers.dataflash import skipped_lines
from trajectories.readers.containers.unpacking import read_whole
from trajectories.runs.notes import About, Note, labelled

ULOG_HEAD = b"ULog\x01\x12\x35"
ULOG_HEAD_BYTES = 16
DATA = ord("D")
FLAGS = ord("B")
MESSAGE_TYPES = frozenset(b"FIMPQARSDOLCB")  # message types of the format's version 1
MAX_PLAIN_BYTES = 4096  # of anything but data; PX4's longest, a FORMAT message, has 1,500 to 1,600
MAX_TOPIC_BYTES = 65_535  # of a message: its length has two bytes; 2^16 - 1
MAX_NESTED = 5  # formats within formats
CLOCK_FIELD = "timestamp"  # a field of every topic
CHAIN = 3  # messages in a row that must fit where reading goes on after damage
ULOG_TYPES = {
    "int8_t": "<i1",
    "uint8_t": "<u1",
    "int16_t": "<i2",
    "uint16_t": "<u2",
    "int32_t": "<i4",
    "uint32_t": "<u4",
    "int64_t": "<i8",
    "uint64_t": "<u8",
    "float": "<f4",
    "double": "<f8",
    "bool": "<u1",
    "char": "S1",
}
FIELD = re.compile(r"^(\w+)(?:\[(\d{1,5})\])? (\w+)$")
Topic = Mapping[str, NDArray]


@dataclass(frozen=True, kw_only=True)
class UlogTables:
    """Topics by name and instance from 0, then by field: float64 columns, shape (n,), `name[k]` of
    an array.

    parameters: as the log began; information: texts by key.
    """

    topics: Mapping[tuple[str, int], Topic]
    parameters: Mapping[str, float]
    information: Mapping[str, str]
    notes: tuple[str, ...]


@dataclass
class _Walk:
    """What going through the messages finds; of data the places by message id, for the wanted
    topics.
    """

    formats: dict[str, str] = field(default_factory=dict)
    topics: dict[int, tuple[str, int, np.dtype]] = field(default_factory=dict)
    # of data bodies by message id, trailing padding not logged
    sizes: dict[int, int] = field(default_factory=dict)
    places: dict[int, list[int]] = field(default_factory=dict)
    parameters: dict[str, float] = field(default_factory=dict)
    information: dict[str, str] = field(default_factory=dict)
    dropouts_ms: list[int] = field(default_factory=list)
    skipped: list[tuple[int, int]] = field(default_factory=list)


def is_ulog(path: Path) -> bool:
    """Whether a file begins as the format says."""
    with open_regular(path) as file:
        return file.read(len(ULOG_HEAD)) == ULOG_HEAD


def read_ulog(path: Path, wanted: Collection[str]) -> UlogTables:
    """The wanted topics of a log. InputError where the file is no ULog, or of a kind that this
    cannot read.
    """
    data = read_whole(path)
    if not data.startswith(ULOG_HEAD):
        raise InputError(
            f"{path.name}: not a ULog: begins with {data[:7].hex(' ')}, needed {ULOG_HEAD.hex(' ')}"
        )
    walk, at, end = _Walk(), ULOG_HEAD_BYTES, len(data)
    while at < end:
        after = _end_of_message(walk, data, at)
        if not after or not (
            after == end or _begins(walk, data, after) or _first_of_topic(data, at, after)
        ):
            start, at = at, _next_message(walk, data, at + 1)
            walk.skipped.append((start, at))
            continue
        _take(walk, data, at, after, wanted, path.name)
        at = after
    topics = {
        walk.topics[k][:2]: _columns(data, walk.topics[k][2], found)
        for k, found in walk.places.items()
        if found
    }
    stray = sorted({name for (name, _), topic in topics.items() if CLOCK_FIELD not in topic})
    lost = sum(walk.dropouts_ms)
    notes = skipped_lines(walk.skipped, end) + (
        [f"the logger lost {lost} ms in {len(walk.dropouts_ms)} dropouts"] if lost else []
    )
    notes += [
        Note(f"topic {name} without {CLOCK_FIELD} (its format damaged?), not read", About.DAMAGE)
        for name in stray
    ]
    return UlogTables(
        topics={key: topic for key, topic in topics.items() if CLOCK_FIELD in topic},
        parameters=walk.parameters,
        information=walk.information,
        notes=tuple(labelled(path.name, line) for line in notes),
    )


def _begins(walk: _Walk, data: bytes, at: int) -> bool:
    """Whether a message may begin at `at`, be it cut off by the end of the file."""
    if at + 3 > len(data):
        return True
    size, kind = data[at] | data[at + 1] << 8, data[at + 2]
    if kind != DATA:
        return kind in MESSAGE_TYPES and 0 < size <= MAX_PLAIN_BYTES
    return at + 5 > len(data) or walk.sizes.get(data[at + 3] | data[at + 4] << 8) == size


def _first_of_topic(data: bytes, at: int, after: int) -> bool:
    """Whether the message at `at` declares the topic of the data that follow, whose length is not
    known before.
    """
    return (
        data[at + 2 : at + 3] == b"A"
        and data[after + 2 : after + 3] == b"D"
        and data[at + 4 : at + 6] == data[after + 3 : after + 5]
    )


def _end_of_message(walk: _Walk, data: bytes, at: int) -> int:
    """Where the message at `at` ends; 0 where there is no whole one."""
    after = at + 3 + int.from_bytes(data[at : at + 2], "little")
    return after if at + 3 < after <= len(data) and _begins(walk, data, at) else 0


def _next_message(walk: _Walk, data: bytes, start: int) -> int:
    """The next place from `start` on where messages follow each other; the end of the data where
    there is none.
    """
    for at in range(start, len(data) - 3):
        place = at
        for _ in range(CHAIN):
            place = _end_of_message(walk, data, place)
            if not place or place == len(data):
                break
        if place:
            return at
    return len(data)


def _take(
    walk: _Walk, data: bytes, at: int, after: int, wanted: Collection[str], label: str
) -> None:
    """Take up one whole message."""
    kind, body = data[at + 2], data[at + 3 : min(after, at + 3 + MAX_PLAIN_BYTES)]
    if kind == DATA:
        message = data[at + 3] | data[at + 4] << 8
        if message in walk.places:
            walk.places[message].append(at + 5)
    elif kind == FLAGS:
        if any(body[9:16]) or body[8:9] > b"\x01":
            raise InputError(
                f"{label}: incompatible flags {body[8:16].hex(' ')}, this reader knows appended"
                " data only"
            )
    elif take := TAKE.get(chr(kind)):
        take(walk, body, wanted)


def _format(walk: _Walk, body: bytes, wanted: Collection[str]) -> None:
    name, _, fields = body.decode("ascii", errors="replace").partition(":")
    walk.formats.setdefault(name, fields)


def _subscribe(walk: _Walk, body: bytes, wanted: Collection[str]) -> None:
    """Instance, message id, name of a topic; one without a usable format, or of a known id, is
    passed over.
    """
    if len(body) < 4:
        return
    instance, message = body[0], body[1] | body[2] << 8
    name = body[3:].decode("ascii", errors="replace")
    dtype = _dtype(walk.formats, name, MAX_NESTED)
    if dtype is None or message in walk.topics:
        return
    walk.topics[message] = (name, instance, dtype)
    walk.sizes[message] = 2 + dtype.itemsize
    if name in wanted:
        walk.places[message] = []


def _parameter(walk: _Walk, body: bytes, wanted: Collection[str]) -> None:
    kind, name, value = _keyed(body)
    if kind in ("float", "int32_t") and len(value) == 4:
        walk.parameters.setdefault(
            name, float(struct.unpack("<f" if kind == "float" else "<i", value)[0])
        )


def _information(walk: _Walk, body: bytes, wanted: Collection[str]) -> None:
    kind, name, value = _keyed(body)
    if kind.startswith("char["):
        text = value.decode("ascii", errors="replace").strip("\0 ")
        walk.information.setdefault(name, text if text.isprintable() else "")


def _dropout(walk: _Walk, body: bytes, wanted: Collection[str]) -> None:
    walk.dropouts_ms.append(int.from_bytes(body[:2], "little"))


TAKE: dict[str, Callable[[_Walk, bytes, Collection[str]], None]] = {
    "F": _format,
    "A": _subscribe,
    "P": _parameter,
    "I": _information,
    "O": _dropout,
}


def _keyed(body: bytes) -> tuple[str, str, bytes]:
    """Type, name and value of an information or parameter message."""
    end = 1 + (body[0] if body else 0)
    kind, _, name = body[1:end].decode("ascii", errors="replace").partition(" ")
    return kind, name, body[end:]


def _dtype(formats: Mapping[str, str], name: str, depth: int) -> np.dtype | None:
    """The numpy type of a topic without its trailing padding; None where its format is missing or
    garbled.
    """
    parts: list[tuple[str, object, tuple[int, ...]]] = []
    fields = [text for text in formats.get(name, "").split(";") if text]
    while fields and depth == MAX_NESTED and fields[-1].rpartition(" ")[2].startswith("_padding"):
        fields.pop()
    for text in fields:
        found = FIELD.match(text)
        kind = (
            None
            if found is None or not depth
            else ULOG_TYPES.get(found[1]) or _dtype(formats, found[1], depth - 1)
        )
        if found is None or kind is None or found[3] in [p[0] for p in parts]:
            return None
        parts.append((found[3], kind, (int(found[2]),) if found[2] else ()))
        if np.dtype(parts[-1:]).itemsize > MAX_TOPIC_BYTES:
            return None
    dtype = np.dtype(parts)
    return dtype if parts and dtype.itemsize <= MAX_TOPIC_BYTES else None


def _columns(data: bytes, dtype: np.dtype, places: list[int]) -> dict[str, NDArray]:
    """The numbers of messages whose values begin at the given places; texts and nested topics are
    left out.
    """
    rows = np.frombuffer(b"".join(data[at : at + dtype.itemsize] for at in places), dtype=dtype)
    columns: dict[str, NDArray] = {}
    with np.errstate(invalid="ignore"):  # damaged floats
        for name in dtype.names or ():
            values = rows[name]
            if values.dtype.kind in "iuf" and values.ndim == 1:
                columns[name] = values.astype(np.float64)
            elif values.dtype.kind in "iuf":
                columns |= {
                    f"{name}[{k}]": values[:, k].astype(np.float64) for k in range(values.shape[1])
                }
    return columns
