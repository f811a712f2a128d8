"""ROS bags to a log: one IMU, its temperature, fixes with their velocity, and UTC from the stamps.

ROS 1 (.bag), ROS 2 in SQLite or MCAP (a file, or the folder of a bag) and plain MCAP, known by
content. Body axes are those of REP-103 (x forward, y left, z up) unless the map has [axes]; times
are the stamps of the headers.
"""

import mmap
import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from ins.records import AXES, InputError, TemperatureLog
from ins.units import STANDARD_GRAVITY
from ins.user_input import open_regular
from trajectories.readers.columns.fix_types import ROS, fix_types
from trajectories.readers.columns.fixes import MATCH_S, RawFixes, good_fixes
from trajectories.readers.columns.imu_columns import PLAUSIBLE_DEGC, converted, second_means
from trajectories.readers.columns.side_streams import with_fixes
from trajectories.readers.containers import mcap_file, ros1_bag, ros2_sqlite
from trajectories.readers.containers.ros_messages import (
    IMU,
    NAVSATFIX,
    NS,
    TEMPERATURE,
    TWIST,
    TWIST_COVARIANCE,
    Bag,
    Topic,
)
from trajectories.readers.registry import ConvertedLog, Reader
from trajectories.readers.rows.clocks import UNIX_S, utc_text
from trajectories.readers.rows.column_map import (
    AxesKeys,
    LogOptions,
    StretchKeys,
    axis_matrix,
    column_map,
    stretch_of,
)
from trajectories.runs.limits import Room
from trajectories.runs.notes import About, Note

FLU = AxesKeys(x="x", y="-y", z="-z")  # REP-103: x forward, y left, z up
MAP = {
    "time": {"column": "time"},
    "gyro": {"columns": [f"w{a}" for a in AXES], "unit": "rad/s"},
    "accel": {"columns": [f"f{a}" for a in AXES], "unit": "m/s2"},
}
UNKNOWN = -1.0  # first element of a covariance: the message has no such value
MAX_FILES = 10_000
TEMPERATURE_MATCH_S = 1.0  # between the readings of three thermometers
Clock = Callable[[Topic], NDArray]
Chosen = tuple[Topic | None, Topic | None]


class RosKeys(StretchKeys):
    """Map keys of a bag. `stamp`: whose time stamps; `temperature_topics`: one, or three in the
    order of the IMU's axes.
    """

    format: str | None = None
    imu: Annotated[int, Field(ge=1, le=99)] | None = None
    imu_topic: str | None = None
    temperature_topics: Annotated[list[str], Field(max_length=3)] | None = None
    fix_topic: str | None = None
    velocity_topic: str | None = None
    stamp: Literal["header", "receive"] = "header"
    axes: AxesKeys = FLU


def read(path: Path, options: LogOptions) -> ConvertedLog:
    """The log of one Imu topic. InputError where there is none, several and none chosen, or its
    values are no rates.
    """
    keys = options.parsed(RosKeys)
    bag = read_bag(path)
    topic = _imu_topic(bag, keys, path.name)
    label = f"{path.name}: {topic.name}"
    clock = _Clock(topic, keys.stamp, label, bag)
    columns = {"time": clock.seconds(topic)} | _columns(topic, label)
    keys_of_columns = {**MAP, "axes": vars(keys.axes), **stretch_of(keys)}
    log = converted(
        columns, column_map(LogOptions(keys_of_columns)), label=label, notes=[], base_s=clock.base_s
    )
    gyro_degC = temperature(
        bag, keys.temperature_topics, topic, keys.axes, clock.seconds, log, path.name
    )
    topics = chosen(bag, keys.fix_topic, keys.velocity_topic, path.name)
    log = replace(
        log,
        temperature=gyro_degC,
        notes=(*bag.notes, *log.notes, *_frame_notes(topic, keys, log, label)),
    )
    log = with_gnss(log, bag, topics, clock.seconds, clock.base_s, path.name)
    shift_s = log.time_shift_s + clock.base_s
    header = {"run_id": path.name.split(".")[0], **log.header, **_start(shift_s), **keys.run}
    return replace(log, time_shift_s=shift_s, header=header)


class _Clock:
    """Time stamps as seconds after `base_s`, a whole second [s since 1970, or of a simulated
    clock].

    Seconds since 1970 have 0.2 microseconds as float64; what is left has a thousandth of that.
    """

    def __init__(self, topic: Topic, stamp: str, label: str, bag: Bag) -> None:
        if stamp == "header" and not any(topic.stamp_ns):
            bag.note(f"{label}: headers without stamps: times are those of the receiver")
            stamp = "receive"
        self._name = "stamp_ns" if stamp == "header" else "receive_ns"
        self._base_ns = (
            int(np.median(np.frombuffer(getattr(topic, self._name), dtype=np.int64)))
            // 10**9
            * 10**9
        )
        self.base_s = self._base_ns / 10**9

    def seconds(self, topic: Topic) -> NDArray:
        return (np.frombuffer(getattr(topic, self._name), dtype=np.int64) - self._base_ns) * NS


def _imu_topic(bag: Bag, keys: RosKeys, label: str) -> Topic:
    """The Imu topic asked for, or the only one."""
    held = bag.of_kind(IMU)
    shown = ", ".join(f"{k} {t.name}" for k, t in enumerate(held, start=1))[:200]
    if keys.imu_topic is not None:
        held = [t for t in held if t.name == keys.imu_topic]
    elif keys.imu is not None:
        held = held[keys.imu - 1 : keys.imu]
    if not held:
        asked = keys.imu_topic or (f"IMU {keys.imu}" if keys.imu else "topic of sensor_msgs/Imu")
        told = f" ({bag.notes[0]})" if bag.notes and not shown else ""
        raise InputError(f"{label}: no {asked}, has {shown or 'none'}{told}"[:400])
    if len(held) > 1:
        raise InputError(
            f"{label}: several topics of sensor_msgs/Imu: {shown}: needed --imu or imu_topic in"
            " the map"
        )
    return held[0]


def _columns(topic: Topic, label: str) -> dict[str, NDArray]:
    values = topic.values
    for name, column in (("angular velocity", 3), ("linear acceleration", 7)):
        if np.all(values[:, column] == UNKNOWN):
            raise InputError(
                f"{label}: has no {name} (its covariance begins with -1), needed both sensors in"
                " one topic"
            )
    names = [f"{kind}{a}" for kind in "wf" for a in AXES]
    return dict(zip(names, values[:, [0, 1, 2, 4, 5, 6]].T))


def _frame_notes(topic: Topic, keys: RosKeys, log: ConvertedLog, label: str) -> list[str]:
    """What the axes were taken for. InputError where the unit would not stand upright in the axes
    of REP-103.
    """
    told = (
        "as REP-103 (x forward, y left, z up)" if keys.axes == FLU else "as [axes] of the map says"
    )
    lines = [f"{label}: frame_id {topic.frame_id!r:.80}: axes taken {told}"]
    f = np.median(log.imu.whole().dv_m_s / log.imu.whole().dt_s[:, None], axis=0)
    k = int(np.argmax(np.abs(f)))
    if keys.axes == FLU and abs(f[k]) > 0.8 * STANDARD_GRAVITY and not (k == 2 and f[2] < 0):
        raw = f[k] * axis_matrix(FLU)[k, k]
        told = ' (forward, right, down is x = "x", y = "y", z = "z")' if k == 2 else ""
        raise InputError(
            f"{label}: the messages (frame_id {topic.frame_id!r:.80}) read {raw:+.2f} m/s2 on"
            f" {AXES[k]}, REP-103 has +9.8 on z: needed [axes] in the map{told}"
        )
    return lines


def _start(start_s: float) -> dict[str, str]:
    """UTC of the stamps where they can be that (no simulated clock, no time since boot)."""
    return {"start_utc": utc_text(start_s)} if UNIX_S[0] < start_s < UNIX_S[1] else {}


def read_bag(path: Path) -> Bag:
    """All messages of the kinds that make a run, of a file or of the files of a folder."""
    bag = Bag()
    for file in _files(path):
        label = file.name if file == path else f"{path.name}/{file.name}"
        read_file = format_of(file)
        if read_file is None:
            bag.note(f"{label}: not a bag, not read")
            continue
        read_file(file, bag, label)
    for topic in bag.topics.values():
        if topic.damaged:
            told = f"{path.name}: {topic.name}: {topic.damaged} messages damaged, dropped"
            bag.note(Note(told, About.DAMAGE))
    return bag


def _files(path: Path) -> list[Path]:
    """The files of a bag in the order of their numbers; the file itself where it is one."""
    if not path.is_dir():
        return [path]
    names = [
        p for p in path.iterdir() if p.suffix in (".db3", ".mcap", ".bag", ".zstd") and p.is_file()
    ]
    if packed := [p.name for p in names if p.suffix == ".zstd"]:
        raise InputError(f"{path}: {packed[0]} is packed as a whole: unpack it first (zstd -d)")
    if outside := [p.name for p in names if not p.resolve().is_relative_to(path.resolve())]:
        raise InputError(f"{path}: {outside[0]}: a link that leaves the folder of the bag")
    return sorted(names[:MAX_FILES], key=lambda p: [int(n) for n in re.findall(r"\d{1,9}", p.name)])


def format_of(path: Path) -> Callable[[Path, Bag, str], None] | None:
    """The reader for the content of a file; None where it is no bag."""
    with open_regular(path) as file:
        head = file.read(16)
    if head.startswith(ros1_bag.BAG_MAGIC):
        return lambda p, bag, label: _mapped(p, bag, label, ros1_bag.read_ros1)
    if head.startswith(mcap_file.MCAP_MAGIC):
        return lambda p, bag, label: _mapped(p, bag, label, mcap_file.read_mcap)
    return ros2_sqlite.read_sqlite if head == ros2_sqlite.SQLITE_MAGIC else None


def _mapped(path: Path, bag: Bag, label: str, read: Callable[[memoryview, Bag, str], None]) -> None:
    """A file read through a map of memory: of a long bag, only what is looked at. The map ends with
    its last reader.
    """
    with open_regular(path) as file:
        data = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
    bag.room = Room(len(data), label)
    read(memoryview(data), bag, label)


def is_bag(path: Path) -> bool:
    """Whether a file, or the files of a folder, are bags."""
    files: Sequence[Path] = (
        [path]
        if path.is_file()
        else [p for p in path.iterdir() if p.suffix in (".db3", ".mcap", ".zstd")]
    )
    return any(p.suffix == ".zstd" or format_of(p) is not None for p in files if p.is_file())


def chosen(bag: Bag, fix_topic: str | None, velocity_topic: str | None, label: str) -> Chosen:
    """The topics of fixes and of their velocity; notes say why there is none. InputError where one
    asked for is absent.
    """
    fix = _only(bag, fix_topic, bag.of_kind(NAVSATFIX), "NavSatFix", "fix_topic", label)
    twists = bag.of_kind(TWIST, TWIST_COVARIANCE)
    if velocity_topic is None and fix is not None:
        same = [t for t in twists if t.frame_id == fix.frame_id]
        if twists and not same:
            bag.note(
                f"{label}: {twists[0].name} has frame_id {twists[0].frame_id!r:.60}, the fixes"
                f" {fix.frame_id!r:.60}: not taken for their velocity (velocity_topic in the map)"
            )
        twists = same
    return fix, _only(bag, velocity_topic, twists, "velocity", "velocity_topic", label)


def _only(
    bag: Bag, name: str | None, held: Sequence[Topic], what: str, key: str, label: str
) -> Topic | None:
    if name is not None:
        held = [t for t in held if t.name == name]
        if not held:
            raise InputError(f"{label}: no {what} topic {name[:100]} ({key} in the map)")
    if len(held) > 1:
        names = ", ".join(t.name for t in held)[:150]
        bag.note(f"{label}: several {what} topics: {names}: none taken ({key} in the map)")
    return held[0] if len(held) == 1 else None


def with_gnss(
    log: ConvertedLog, bag: Bag, topics: Chosen, clock: Clock, base_s: float, label: str
) -> ConvertedLog:
    """The log with the good fixes beside it. Velocities are east, north, up in the messages, one
    sigma an axis by covariance.

    Where no velocity was recorded, differences of the positions take its place (`fix_velocity`);
    with neither, the fixes say where the run starts, and make no stream.
    """
    fix, velocity = topics
    if fix is None:
        told = f"{label}: no gnss stream: no topic of sensor_msgs/NavSatFix taken"
        return replace(log, notes=(*log.notes, Note(told, About.FIXES)))
    status, lat, lon, height, *variance = fix.values.T
    v_n, sigma_v = _velocity(velocity, clock(fix), clock)
    known = variance[3] > 0
    with np.errstate(invalid="ignore"):
        sigmas = np.sqrt([(variance[0] + variance[1]) / 2, variance[2]])
    raw = RawFixes(
        log_s=clock(fix),
        is_3d=status >= 0,
        lat_deg=lat,
        lon_deg=lon,
        height_m=height,
        v_n_m_s=v_n,
        unix_s=clock(fix) + base_s,
        sigmas=np.stack([*np.where(known, sigmas, np.nan), sigma_v]),
        fix_type=fix_types(status, ROS),
    )
    log = with_fixes(log, raw, label=f"{label}: {fix.name}")
    if log.gnss is not None:
        return log
    place, _ = good_fixes(replace(raw, v_n_m_s=np.zeros_like(v_n)), label=label)
    header = {} if place is None else {"site": place.header(log)["site"]}
    return replace(
        log,
        header={**header, **log.header},
        notes=(*log.notes, f"{label}: the fixes give the site only"),
    )


def _velocity(topic: Topic | None, time_s: NDArray, clock: Clock) -> tuple[NDArray, NDArray]:
    """North, east, down (n, 3) and their sigma (n,) of the message nearest to each time."""
    if topic is None:
        return np.full((time_s.size, 3), np.nan), np.full(time_s.size, np.nan)
    nearest, near = _nearest(clock(topic), time_s, MATCH_S)
    values = topic.values
    enu = values[nearest, :3]
    v_n = np.where(near[:, None], np.stack([enu[:, 1], enu[:, 0], -enu[:, 2]], axis=1), np.nan)
    with np.errstate(invalid="ignore"):
        sigma = (
            np.sqrt(values[nearest, 3:].mean(axis=1))
            if values.shape[1] > 3
            else np.full(time_s.size, np.nan)
        )
    return v_n, sigma


def _nearest(clock_s: NDArray, time_s: NDArray, within_s: float) -> tuple[NDArray, NDArray]:
    """Index of the reading nearest to each time, and whether it is near."""
    order = np.argsort(clock_s, kind="stable")
    ascending = clock_s[order]
    after = np.clip(np.searchsorted(ascending, time_s), 1, max(ascending.size - 1, 1))
    before = after - 1
    after = np.minimum(after, ascending.size - 1)
    k = np.where(time_s - ascending[before] < ascending[after] - time_s, before, after)
    return order[k], np.abs(ascending[k] - time_s) <= within_s


def temperature(
    bag: Bag,
    names: Sequence[str] | None,
    imu: Topic,
    axes: AxesKeys,
    clock: Clock,
    log: ConvertedLog,
    label: str,
) -> TemperatureLog | None:
    """Temperatures of the gyros: one topic for all, or three in the order of the IMU's axes. None
    where none is taken.
    """
    held = {t.name: t for t in bag.of_kind(TEMPERATURE)}
    if names is not None:
        topics = [held[name] for name in names if name in held]
        if len(topics) != len(names) or len(names) == 2:
            told = ", ".join(held)[:150] or "none"
            raise InputError(
                f"{label}: temperature_topics: needed one or three of the topics of Temperature:"
                f" {told}"
            )
    else:
        topics = [t for t in held.values() if len(held) == 1 or t.frame_id == imu.frame_id]
        if len(topics) > 1 or (held and not topics):
            bag.note(
                f"{label}: several Temperature topics: {', '.join(held)[:150]}: none taken"
                " (temperature_topics in the map)"
            )
            return None
    if not topics:
        bag.note(f"{label}: no temperature stream: no topic of sensor_msgs/Temperature")
        return None
    return _gyro_temperatures(bag, topics, axes, clock, log, label)


def _gyro_temperatures(
    bag: Bag, topics: Sequence[Topic], axes: AxesKeys, clock: Clock, log: ConvertedLog, label: str
) -> TemperatureLog | None:
    time_s = clock(topics[0])
    raw = np.empty((time_s.size, 3))
    for k in range(3):
        topic = topics[k % len(topics)]
        nearest, near = _nearest(clock(topic), time_s, TEMPERATURE_MATCH_S)
        raw[:, k] = np.where(near, topic.values[nearest, 0], np.nan)
    with np.errstate(invalid="ignore"):
        sane = (raw >= PLAUSIBLE_DEGC[0]) & (raw <= PLAUSIBLE_DEGC[1])
    if not sane.all():
        least, most = np.nanmin(raw[~sane]), np.nanmax(raw[~sane])
        bag.note(
            f"{label}: {topics[0].name}: {int((~sane).any(axis=1).sum())} readings of {least:g} to"
            f" {most:g} left out, needed {PLAUSIBLE_DEGC[0]:g} to {PLAUSIBLE_DEGC[1]:g} degC"
        )
    body = np.where(sane, raw, np.nan)[:, np.argmax(np.abs(axis_matrix(axes)), axis=1)]
    run_s = time_s - log.time_shift_s
    rows = np.flatnonzero((run_s >= 0) & (run_s <= log.imu.end_s))
    rows = rows[np.argsort(run_s[rows], kind="stable")]
    return second_means(run_s[rows], body[rows])


READERS = (
    Reader(
        name="ros",
        about="ROS 1 .bag, ROS 2 .db3 or .mcap, a file or a folder",
        detect=is_bag,
        read=read,
        folder=True,
    ),
)
