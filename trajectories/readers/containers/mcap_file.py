"""MCAP files with ROS messages, read from the front: no index or footer is needed, so that an
unfinished file reads too.

A record is its kind (1 byte), length (8 bytes) and body. Chunks hold further records, perhaps
packed, with a checksum. A damaged chunk costs itself; a damaged record ends what can be read.
Source: mcap.dev/spec.
"""

import struct
import zlib
from enum import IntEnum

from ins.records import InputError
from trajectories.readers.containers.ros_messages import Bag, Topic
from trajectories.readers.containers.unpacking import Damaged, unpacked
from trajectories.runs.notes import About, Note

MCAP_MAGIC = b"\x89MCAP0\r\n"
# mcap.dev/spec: kinds 1 to 15 are defined, up to 0x7F reserved, from 0x80 on anybody's
LAST_KNOWN = 15
FIRST_FREE = 0x80  # 128, of the same specification


class Record(IntEnum):
    """Kinds of records (MCAP specification, "Opcodes")."""

    FOOTER = 2
    SCHEMA = 3
    CHANNEL = 4
    MESSAGE = 5
    CHUNK = 6
    DATA_END = 15


RECORD_HEAD = struct.Struct("<BQ")
MESSAGE_HEAD = struct.Struct("<HIQQ")
CHUNK_HEAD = struct.Struct("<QQQI")


class _Walk:
    """What going through a file knows: schemas, and where messages of a channel go."""

    def __init__(self, bag: Bag, label: str) -> None:
        self.bag, self.label = bag, label
        self.schemas: dict[int, str] = {}
        self.channels: dict[int, Topic | None] = {}


def read_mcap(data: memoryview, bag: Bag, label: str) -> None:
    """Take up the messages of a file in memory; what cannot be read goes to the bag's notes.
    InputError for another format.
    """
    if bytes(data[: len(MCAP_MAGIC)]) != MCAP_MAGIC:
        raise InputError(f"{label}: not an MCAP file of version 0")
    walk = _Walk(bag, label)
    at, kind = len(MCAP_MAGIC), 0
    try:
        while at < len(data) and kind not in (Record.FOOTER, Record.DATA_END):
            kind, after = _record(walk, data, at, nested=False)
            at = after
    except Damaged as error:
        left = len(data) - at
        bag.note(
            f"{label}: {error} at byte {at}: read up to there, the last {left} of {len(data)} bytes"
            " dropped"
        )
        return
    if kind not in (Record.FOOTER, Record.DATA_END):
        bag.note(f"{label}: recording not finished (no end of data)")


def _record(walk: _Walk, data: memoryview, at: int, *, nested: bool) -> tuple[int, int]:
    """Take up the record at `at`: its kind, and where the next one begins. Damaged where there is
    no whole one.
    """
    if at + RECORD_HEAD.size > len(data):
        raise Damaged("a record cut off")
    kind, length = RECORD_HEAD.unpack_from(data, at)
    start = at + RECORD_HEAD.size
    if kind == Record.CHUNK and not nested:
        return kind, _chunk(walk, data, start, length)
    if length > len(data) - start:
        raise Damaged("a record cut off or damaged")
    body = data[start : start + length]
    if kind == Record.MESSAGE:
        _message(walk, body)
    elif kind == Record.SCHEMA:
        name, _ = _text(body, 2)
        walk.schemas[_number(body, 0)] = name
    elif kind == Record.CHANNEL:
        _channel(walk, body)
    elif kind == 0 or LAST_KNOWN < kind < FIRST_FREE:
        walk.bag.note(f"{walk.label}: record of unknown kind {kind} passed over")
    return kind, start + length


def _message(walk: _Walk, body: memoryview) -> None:
    if len(body) < MESSAGE_HEAD.size:
        raise Damaged("a message too short")
    channel, _, log_ns, _ = MESSAGE_HEAD.unpack_from(body)
    topic = walk.channels.get(channel)
    if topic is not None:
        topic.take(log_ns, bytes(body[MESSAGE_HEAD.size :]))


def _channel(walk: _Walk, body: memoryview) -> None:
    name, at = _text(body, 4)
    encoding, _ = _text(body, at)
    if (number := _number(body, 0)) not in walk.channels:
        walk.channels[number] = walk.bag.topic(
            name, walk.schemas.get(_number(body, 2), ""), encoding
        )


def _chunk(walk: _Walk, data: memoryview, start: int, length: int) -> int:
    """Take up the records of the chunk whose body begins at `start`; where the chunk ends.

    One that is not packed is read as far as it goes where the file ends within it.
    """
    body, place, records = data[start : start + length], 0, memoryview(b"")
    try:
        if len(body) < CHUNK_HEAD.size + 12:
            raise Damaged("cut off")
        _, _, size, checksum = CHUNK_HEAD.unpack_from(body)
        name, at = _text(body, CHUNK_HEAD.size)
        records = body[at + 8 :]
        if len(body) == length:
            records = records[: int.from_bytes(body[at : at + 8], "little")]
            if name:
                walk.bag.room.take(size)
                records = memoryview(unpacked(records, name, size))
            if checksum and zlib.crc32(records) != checksum:
                raise Damaged("wrong checksum")
        elif name:
            raise Damaged("cut off")
        while place < len(records):
            _, place = _record(walk, records, place, nested=True)
    except Damaged as error:
        lost = f"{len(records) - place} of {len(records)} bytes" if place else "it is"
        begin = start - RECORD_HEAD.size
        told = f"{walk.label}: chunk at byte {begin} damaged ({error}), {lost} dropped"
        walk.bag.note(Note(told, About.DAMAGE))
    if len(body) < length:
        raise Damaged("a chunk cut off")
    return start + length


def _number(body: memoryview, at: int) -> int:
    if at + 2 > len(body):
        raise Damaged("a record too short")
    return int.from_bytes(body[at : at + 2], "little")


def _text(body: memoryview, at: int) -> tuple[str, int]:
    """A text after its length of 4 bytes, and where it ends."""
    end = at + 4 + int.from_bytes(body[at : at + 4], "little")
    if at + 4 > len(body) or end > len(body):
        raise Damaged("a text cut off")
    return bytes(body[at + 4 : end]).decode("utf-8", errors="replace"), end
