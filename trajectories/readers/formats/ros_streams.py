"""Fixes and temperatures of a bag: which topics they are, and how their messages make streams.

Nothing is chosen that might belong to something else: a velocity counts only where its frame is
that of the fixes.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ins.records import InputError, TemperatureLog
from trajectories.readers.columns.fix_types import ROS, fix_types
from trajectories.readers.columns.fixes import MATCH_S, RawFixes, good_fixes
from trajectories.readers.columns.imu_columns import PLAUSIBLE_DEGC, second_means
from trajectories.readers.columns.side_streams import with_fixes
from trajectories.readers.containers.ros_messages import (
    NAVSATFIX,
    TEMPERATURE,
    TWIST,
    TWIST_COVARIANCE,
    Bag,
    Topic,
)
from trajectories.readers.registry import ConvertedLog
from trajectories.readers.rows.column_map import AxesKeys, axis_matrix
from trajectories.runs.notes import About, Note

TEMPERATURE_MATCH_S = 1.0  # between the readings of three thermometers
Clock = Callable[[Topic], NDArray]
Chosen = tuple[Topic | None, Topic | None]


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
