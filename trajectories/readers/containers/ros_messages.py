"""The ROS messages that make a run, out of their bytes, and the topics of a bag.

The layouts are those of the standard definitions, the same in all distributions of ROS 1 and ROS 2:
what a bag itself says of its types is not used (a library would make code of it). ROS 1 packs
little-endian; ROS 2 has CDR (XCDR1), a head of four bytes and each number aligned to its size.
Units of ROS: REP-103 (rad/s, m/s2, m, m/s), degC, degrees of latitude. Source: docs.ros.org,
sensor_msgs and geometry_msgs; OMG CDR. (The tests take rosbags as their yardstick.)

Decision: docs/decisions/0087-libraries-in-a-child.md.
"""

import struct
from array import array
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from ins.records import InputError
from trajectories.runs.limits import Room
from trajectories.runs.text_rows import MAX_ROWS

IMU = "sensor_msgs/Imu"
TEMPERATURE = "sensor_msgs/Temperature"
NAVSATFIX = "sensor_msgs/NavSatFix"
TWIST = "geometry_msgs/TwistStamped"
TWIST_COVARIANCE = "geometry_msgs/TwistWithCovarianceStamped"
# Count and letter (struct) of each field after the header; "-": not kept. And the md5sum of ROS 1.
LAYOUTS = {
    # w, its covariance[0], f, its covariance[0]
    IMU: ("-4d -9d 3d 1d -8d 3d 1d -8d", "6a62c6daae103f4ff57a132d6f95cec2"),
    TEMPERATURE: ("1d -1d", "ff71b307acdbe7c871a5a6d7ed359100"),
    # status, place, diagonal, its kind
    NAVSATFIX: ("1b -1H 3d 1d -3d 1d -3d 1d 1B", "2d3a8cd499b9b4a0249fb98fd05cfa48"),
    TWIST: ("3d -3d", "98d34b0043a2093cf9d9345ab6eef12e"),
    TWIST_COVARIANCE: ("3d -3d 1d -6d 1d -6d 1d -21d", "8927a1a12fb2607ceea095b2dc440a96"),
}
CDR_HEAD_BYTES = 4
MAX_PADDING = 8  # bytes behind a message: CDR aligns to 8 at most
MAX_FRAME_ID = 1024  # bytes; chosen: names of frames have tens, a garbled length up to 4e9
MAX_TOPICS = 10_000  # chosen: a bag has up to hundreds; 10,000 still take megabytes only
NS = 1e-9


@dataclass
class Topic:
    """Messages of one topic in the order of the bag: stamps of header and receiver [ns], kept
    values one after another.
    """

    name: str
    kind: str
    encoding: str  # "ros1" or "cdr"
    frame_id: str = ""
    stamp_ns: array = field(default_factory=lambda: array("q"))
    receive_ns: array = field(default_factory=lambda: array("q"))
    kept: array = field(default_factory=lambda: array("d"))
    damaged: int = 0

    def take(self, receive_ns: int, data: bytes) -> None:
        """One message; one whose length or stamp cannot be is counted as damaged."""
        found = decoded(self.kind, data, self.encoding)
        if found is None or receive_ns >= 1 << 63:
            self.damaged += 1
            return
        stamp_ns, frame_id, values = found
        if not self.stamp_ns:
            text = frame_id.decode("utf-8", errors="replace")
            self.frame_id = text if text.isprintable() else ""
        self.stamp_ns.append(stamp_ns)
        self.receive_ns.append(receive_ns)
        self.kept.extend(values)
        if len(self.stamp_ns) > MAX_ROWS:
            raise InputError(
                f"topic {self.name}: more than {MAX_ROWS} messages, needed at most that"
            )

    @property
    def values(self) -> NDArray:
        """Shape (n, number of fields kept)."""
        return np.frombuffer(self.kept, dtype=np.float64).reshape(len(self.stamp_ns), -1)


@dataclass
class Bag:
    """Topics of the kinds in LAYOUTS by name, and notes on what was skipped; `room`: for what the
    file at hand unpacks to.
    """

    topics: dict[str, Topic] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    room: Room = field(default_factory=lambda: Room(0, "bag"))
    _noted: set[str] = field(default_factory=set)

    def topic(self, name: str, kind: str, encoding: str, *, md5: str | None = None) -> Topic | None:
        """Where messages of a connection go; None where nothing is wanted of them."""
        kind = kind.replace("/msg/", "/")
        if kind not in LAYOUTS or encoding not in ("ros1", "cdr"):
            return None
        shown = name[:200] if name.isprintable() else repr(name[:50])
        if md5 not in (None, "*", LAYOUTS[kind][1]):
            self.note(
                f"topic {shown}: another {kind} (md5sum {md5[:32]!r}), not read" if md5 else ""
            )
            return None
        if len(self.topics) >= MAX_TOPICS:
            raise InputError(f"more than {MAX_TOPICS} topics")
        found = self.topics.setdefault(shown, Topic(name=shown, kind=kind, encoding=encoding))
        return found if (found.kind, found.encoding) == (kind, encoding) else None

    def of_kind(self, *kinds: str) -> list[Topic]:
        """The topics that have messages, by name."""
        return [t for _, t in sorted(self.topics.items()) if t.kind in kinds and t.stamp_ns]

    def note(self, text: str) -> None:
        if text and text not in self._noted:
            self._noted.add(text)
            self.notes.append(text)


def decoded(kind: str, data: bytes, encoding: str) -> tuple[int, bytes, tuple[float, ...]] | None:
    """Stamp [ns], frame_id and the kept values of a message; None where the bytes are no such
    message.
    """
    aligned = encoding == "cdr"
    start = CDR_HEAD_BYTES if aligned else 4  # ROS 1: past the sequence number
    if len(data) < start + 12 or (aligned and (data[0] != 0 or data[1] > 1)):
        return None
    order = ">" if aligned and data[1] == 0 else "<"
    seconds, nanoseconds, length = struct.unpack_from(order + "iII", data, start)
    end = start + 12 + length
    if nanoseconds >= 10**9 or length > MAX_FRAME_ID or end > len(data):
        return None
    layout = _layout(kind, order, (end - CDR_HEAD_BYTES) % 8 if aligned else 0, aligned)
    beyond = len(data) - end - layout.size
    if beyond < 0 or beyond >= (MAX_PADDING if aligned else 1):
        return None
    return (
        seconds * 10**9 + nanoseconds,
        bytes(data[start + 12 : end]).rstrip(b"\0"),
        layout.unpack_from(data, end),
    )


@lru_cache
def _layout(kind: str, order: str, offset: int, aligned: bool) -> struct.Struct:
    """The fields after the header, which ends at `offset` (modulo 8) of the aligned body."""
    text = order
    for word in LAYOUTS[kind][0].split():
        count, letter = int(word.lstrip("-")[:-1]), word[-1]
        size = struct.calcsize(order + letter)
        pad = -offset % size if aligned else 0
        text += f"{pad}x{count * size}x" if word[0] == "-" else f"{pad}x{count}{letter}"
        offset += pad + count * size
    return struct.Struct(text)
