"""ROS 1 bags (version 2.0), read from the front: no index is needed, so that an unfinished or
cut-off bag reads as well.

A record is a header (length, then fields `name=value` each with its length) and data (length,
bytes). Chunks hold further records, perhaps packed. A damaged chunk costs itself; a damaged record
ends what can be read of its chunk, or of the file. Source: wiki.ros.org/Bags/Format/2.0.

Decision: docs/decisions/0087-libraries-in-a-child.md.
"""

import struct
from collections.abc import Mapping
from enum import IntEnum

from ins.records import InputError
from trajectories.readers.containers.ros_messages import Bag, Topic
from trajectories.readers.containers.unpacking import Damaged, unpacked
from trajectories.runs.notes import About, Note

BAG_MAGIC = b"#ROSBAG V2.0\n"
MAX_HEADER_BYTES = 1 << 20  # of a record, with the definition of a message


class BagRecord(IntEnum):
    """Kinds of records (ROS bag format 2.0, "op")."""

    MESSAGE = 2
    BAG_HEADER = 3
    INDEX = 4
    CHUNK = 5
    CHUNK_INFO = 6
    CONNECTION = 7


U32 = struct.Struct("<I")
Fields = Mapping[bytes, bytes]


def read_ros1(data: memoryview, bag: Bag, label: str) -> None:
    """Take up the messages of a bag in memory; what cannot be read goes to the bag's notes.
    InputError for another format.
    """
    if bytes(data[: len(BAG_MAGIC)]) != BAG_MAGIC:
        raise InputError(f"{label}: not a ROS 1 bag of version 2.0")
    connections: dict[int, Topic | None] = {}
    at = len(BAG_MAGIC)
    try:
        while at < len(data):
            at = _record(data, at, connections, bag, label, nested=False)
    except Damaged as error:
        left = len(data) - at
        bag.note(
            f"{label}: {error} at byte {at}: read up to there, the last {left} of {len(data)} bytes"
            " dropped"
        )


def _record(
    data: memoryview,
    at: int,
    connections: dict[int, Topic | None],
    bag: Bag,
    label: str,
    *,
    nested: bool,
) -> int:
    """Take up the record at `at`; where the next one begins. Damaged where there is no whole
    one.
    """
    header, body = _part(data, at, MAX_HEADER_BYTES)
    content, after = _part(data, body, len(data))
    fields = _fields(header)
    kind = _number(fields, b"op", 1)
    if kind == BagRecord.MESSAGE:
        topic = connections.get(_number(fields, b"conn", 4))
        if topic is not None:
            seconds, nanoseconds = struct.unpack("<II", _value(fields, b"time", 8))
            topic.take(seconds * 10**9 + nanoseconds, bytes(content))
    elif kind == BagRecord.CONNECTION:
        _connect(fields, _fields(content), connections, bag)
    elif kind == BagRecord.CHUNK and not nested:
        _chunk(fields, content, connections, bag, label, at)
    elif kind == BagRecord.BAG_HEADER:
        if not _number(fields, b"index_pos", 8):
            bag.note(f"{label}: recording not finished (no index)")
        if fields.get(b"encryptor"):
            raise InputError(f"{label}: an encrypted bag, needed one in the clear")
    elif kind not in (BagRecord.INDEX, BagRecord.CHUNK_INFO):
        raise Damaged(f"no record of kind {kind}")
    return after


def _chunk(
    fields: Fields,
    content: memoryview,
    connections: dict[int, Topic | None],
    bag: Bag,
    label: str,
    at: int,
) -> None:
    """Take up the records of a chunk; a damaged one is noted, and what follows it in the chunk is
    lost.
    """
    place, records = 0, content
    try:
        name = fields.get(b"compression", b"none").decode("ascii", errors="replace")
        if name != "none":
            size = _number(fields, b"size", 4)
            bag.room.take(size)
            records = memoryview(unpacked(content, name, size))
        while place < len(records):
            place = _record(records, place, connections, bag, label, nested=True)
    except Damaged as error:
        lost = (
            f"{len(records) - place} of {len(records)} bytes"
            if records is not content or place
            else "it is"
        )
        told = f"{label}: chunk at byte {at} damaged ({error}), {lost} dropped"
        bag.note(Note(told, About.DAMAGE))


def _connect(fields: Fields, said: Fields, connections: dict[int, Topic | None], bag: Bag) -> None:
    number, name, kind, md5 = (
        _number(fields, b"conn", 4),
        fields.get(b"topic"),
        said.get(b"type"),
        said.get(b"md5sum", b"*"),
    )
    if name is None or kind is None:
        raise Damaged("a connection without topic or type")
    if number not in connections:
        texts = (text.decode("utf-8", errors="replace") for text in (name, kind, md5))
        topic, type_name, md5_text = texts
        connections[number] = bag.topic(topic, type_name, "ros1", md5=md5_text)


def _part(data: memoryview, at: int, most: int) -> tuple[memoryview, int]:
    """The bytes after a length of 4 bytes, and where they end."""
    end = at + 4
    if end <= len(data):
        end += U32.unpack_from(data, at)[0]
        if end <= len(data) and end - at - 4 <= most:
            return data[at + 4 : end], end
    raise Damaged("a record cut off or damaged")


def _fields(header: memoryview) -> Fields:
    fields, at = {}, 0
    while at < len(header):
        text, at = _part(header, at, len(header))
        name, found, value = bytes(text).partition(b"=")
        if not found:
            raise Damaged("a header field without =")
        fields[name] = value
    return fields


def _number(fields: Fields, name: bytes, size: int) -> int:
    return int.from_bytes(_value(fields, name, size), "little")


def _value(fields: Fields, name: bytes, size: int) -> bytes:
    value = fields.get(name, b"")
    if len(value) != size:
        raise Damaged(f"a record without {name.decode()}")
    return value
