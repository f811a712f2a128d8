"""Frames of a NovAtel binary log: a head of 28 bytes, or a short one of 12, a body, and its check.

Everything is little-endian. A long head is the signs AA 44 12, its length (28), the number of the
log (2 bytes at 4), the kind of message (1 at 6), the length of the body (2 at 8), the GPS week (2
at 14) and its milliseconds (4 at 16); a short one AA 44 13, the length of the body (1 at 3), number
(2 at 4), week (2 at 6), milliseconds (4 at 8). The check is that of the lines
(`trajectories.readers.containers.novatel_lines.crc32`), over head and body. In the kind of
message, bits 0 to 4 name the antenna (0: the first), bits 5 and 6 the encoding (0: binary), bit 7
a reply. Source: OEM7 documentation, Binary; Description of ASCII and Binary Logs with Short
Headers; 32-Bit CRC; and the page of each log.
"""

import re
import struct
from array import array
from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trajectories.readers.containers.novatel_lines import crc32

# of a long head, of a short one, of the check behind the body: 28, 12, 4 (OEM7, Binary)
LONG_BYTES, SHORT_BYTES, CHECK_BYTES = 28, 12, 4
SIGN = re.compile(rb"\xaa\x44(?:\x12\x1c|\x13)")
LONG_HEAD = struct.Struct("<4xHBxH4xHI")  # number, kind, length of the body, week, milliseconds
SHORT_HEAD = struct.Struct("<3xBHHI")  # length of the body, number, week, milliseconds
OTHER_ANTENNA = 0x1F
NOT_BINARY = 0xE0  # another encoding, or a reply to a command
# INSCONFIG with ten translations and ten rotations of 36 bytes each is 788; chosen
MAX_CONFIG_BYTES = 1000

_COUNTS = [(name, "<i4") for name in ("accel_z", "accel_-y", "accel_x")]
_COUNTS += [(name, "<i4") for name in ("gyro_z", "gyro_-y", "gyro_x")]
_RAW = [("week", "<u4"), ("seconds", "<f8"), ("imu_status", "<u4"), *_COUNTS]
_EXTENDED = [("info", "u1"), ("type", "u1"), ("week", "<u2"), *_RAW[1:]]
_LLA = [(name, "<f8") for name in ("lat", "lon", "height")]
_SPEED = [(name, "<f8") for name in ("north", "east", "up")]
_ANGLES = [(name, "<f8") for name in ("roll", "pitch", "heading")]
_POSITION = [
    ("status", "<u4"),
    ("type", "<u4"),
    *_LLA,
    ("undulation", "<f4"),
    ("datum", "<u4"),
    ("north", "<f4"),
    ("east", "<f4"),
    ("up", "<f4"),
    ("rest", "V20"),
]
_VELOCITY = [
    ("status", "<u4"),
    ("type", "<u4"),
    ("latency", "<f4"),
    ("age", "<f4"),
    ("speed", "<f8"),
    ("track", "<f8"),
    ("up", "<f8"),
    ("rest", "<f4"),
]
_SOLUTION = [("week", "<u4"), ("seconds", "<f8"), *_LLA, *_SPEED, *_ANGLES, ("status", "<u4")]
_SOLUTION_X = [
    ("status", "<u4"),
    ("type", "<u4"),
    *_LLA,
    ("undulation", "<f4"),
    *_SPEED,
    *_ANGLES,
    ("rest", "V42"),
]
# Of each log its number and its body.
BODIES = {
    "RAWIMU": (268, np.dtype(_RAW)),
    "RAWIMUS": (325, np.dtype(_RAW)),
    "RAWIMUX": (1461, np.dtype(_EXTENDED)),
    "RAWIMUSX": (1462, np.dtype(_EXTENDED)),
    "BESTPOS": (42, np.dtype(_POSITION)),
    "BESTVEL": (99, np.dtype(_VELOCITY)),
    "BESTGNSSPOS": (1429, np.dtype(_POSITION)),
    "BESTGNSSVEL": (1430, np.dtype(_VELOCITY)),
    "INSPVA": (507, np.dtype(_SOLUTION)),
    "INSPVAS": (508, np.dtype(_SOLUTION)),
    "INSPVAX": (1465, np.dtype(_SOLUTION_X)),
}
CONFIG, CONFIG_NUMBER = "INSCONFIG", 1945
LOG_NAMES = {CONFIG_NUMBER: CONFIG} | {number: name for name, (number, _) in BODIES.items()}


@dataclass
class Frames:
    """The good frames of a file.

    logs: by name, an array of bodies with `head_week` and `head_seconds`; configs: bodies of
    INSCONFIG; bad: how many wanted ones had a wrong check or were cut off; other_antenna: how many
    came from another antenna than the first.
    """

    logs: dict[str, NDArray] = field(default_factory=dict)
    configs: list[bytes] = field(default_factory=list)
    bad: int = 0
    other_antenna: int = 0


class _Head(NamedTuple):
    """What a head says; `start`, `body_at` and `end` are places in the file, `end` behind the
    check.
    """

    start: int
    body_at: int
    length: int
    number: int
    kind: int
    week: int
    milliseconds: int

    @property
    def body_end(self) -> int:
        return self.body_at + self.length

    @property
    def end(self) -> int:
        return self.body_end + CHECK_BYTES


def read_frames(data: bytes, wanted: Collection[str]) -> Frames:
    """The good frames of the wanted logs. Only the length that a log has is believed, so that
    damage costs the frame that it hit.
    """
    out = Frames()
    places = {name: array("q") for name in wanted if name in BODIES}
    times = {name: array("d") for name in places}
    free = 0  # where the last good frame ended
    for head in _heads(data):
        name = LOG_NAMES.get(head.number, "")
        if head.start < free or name not in wanted or not _has_length(name, head.length):
            continue
        if not _is_whole(data, head):
            out.bad += 1
            continue
        free = head.end
        if head.kind & NOT_BINARY:
            continue
        if head.kind & OTHER_ANTENNA:
            out.other_antenna += 1
        elif name == CONFIG:
            out.configs.append(data[head.body_at : head.body_end])
        else:
            places[name].append(head.body_at)
            times[name].extend((head.week, head.milliseconds * 1e-3))
    tables = {name: _bodies(data, name, places[name], times[name]) for name in places}
    out.logs = {name: rows for name, rows in tables.items() if rows.size}
    return out


def has_frame(data: bytes) -> bool:
    """Whether there is a whole frame of any log, with a right check, in the beginning of a file."""
    return any(_is_whole(data, head) for head in _heads(data))


def _heads(data: bytes) -> Iterator[_Head]:
    for found in SIGN.finditer(data):
        at, signs = found.start(), found.end() - found.start()
        if signs == 4 and at + LONG_BYTES <= len(data):
            number, kind, length, week, ms = LONG_HEAD.unpack_from(data, at)
            yield _Head(at, at + LONG_BYTES, length, number, kind, week, ms)
        elif signs == 3 and at + SHORT_BYTES <= len(data):
            length, number, week, ms = SHORT_HEAD.unpack_from(data, at)
            yield _Head(at, at + SHORT_BYTES, length, number, 0, week, ms)


def _has_length(name: str, length: int) -> bool:
    return length <= MAX_CONFIG_BYTES if name == CONFIG else length == BODIES[name][1].itemsize


def _is_whole(data: bytes, head: _Head) -> bool:
    """Whether a frame is all there and its check is right."""
    if head.end > len(data):
        return False
    found = int.from_bytes(data[head.body_end : head.end], "little")
    return crc32(data[head.start : head.body_end]) == found


def _bodies(data: bytes, name: str, places: array, times: array) -> NDArray:
    """The bodies at given places, with the time in their heads."""
    body = BODIES[name][1]
    starts = np.frombuffer(places, dtype=np.int64) if places else np.empty(0, dtype=np.int64)
    # one row of bytes a frame, read as the record that it is
    raw = np.frombuffer(data, dtype=np.uint8)[starts[:, None] + np.arange(body.itemsize)]
    stamps = np.frombuffer(times, dtype=float).reshape(-1, 2) if times else np.empty((0, 2))
    whole = np.dtype([*body.descr, ("head_week", "<f8"), ("head_seconds", "<f8")])
    out = np.empty(starts.size, dtype=whole)
    bodies = raw.reshape(starts.size, body.itemsize).view(body).ravel()
    for key in body.names or ():
        out[key] = bodies[key]
    out["head_week"], out["head_seconds"] = stamps.T
    return out
