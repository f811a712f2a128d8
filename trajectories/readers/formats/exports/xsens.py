"""Xsens text as MT Manager and Xsens DOT export it: PacketCounter, SampleTimeFine, Acc_X, Gyr_X.

Axes are those marked on the unit, taken as x forward, y left, z up. Acc is in m/s2. Gyr is in rad/s
(MT Manager) or deg/s (DOT); where the orientation stands beside it, its own turns tell which. Time
is SampleTimeFine, 32 bits of 0.1 ms (MTi) or of microseconds (DOT); without it PacketCounter, 16
bits, at the `Update Rate` of the head. UTC is of the columns UTC_Year to UTC_Nano, wherever in the
log the receiver knew it. Latitude, Longitude and Altitude are the unit's own solution: the site,
and no fixes. Source: Xsens, MT Low Level Communication Protocol (SampleTimeFine, UtcTime, LatLon);
MT Manager User Manual; exports in the tests of opensim-org/opensim-core (OpenSim/Tests/shared).
"""

import datetime
import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from ins.records import InputError
from ins.units import DEG
from trajectories.readers.columns.imu_columns import converted
from trajectories.readers.columns.layouts import read_columns
from trajectories.readers.columns.text_columns import Heading, heading
from trajectories.readers.registry import ConvertedLog, Reader
from trajectories.readers.rows.clocks import UNIX_S, going_on, utc_text
from trajectories.readers.rows.column_map import (
    AxesKeys,
    LogOptions,
    StretchKeys,
    column_map,
    stretch_of,
)
from trajectories.runs.checks import MAX_RATE_HZ, MIN_RATE_HZ

COUNTER, FINE_CLOCK = "PacketCounter", "SampleTimeFine"
GYR = [f"Gyr_{a}" for a in "XYZ"]
ACC = [f"Acc_{a}" for a in "XYZ"]
QUATERNION = ["Quat_q0", "Quat_q1", "Quat_q2", "Quat_q3"]
DOT_QUATERNION = ["Quat_W", "Quat_X", "Quat_Y", "Quat_Z"]
TURN_MATRIX = [f"Mat[{row}][{column}]" for column in (1, 2, 3) for row in (1, 2, 3)]
PLACE_COLUMNS = ["Latitude", "Longitude", "Altitude"]
UTC_COLUMNS = [f"UTC_{part}" for part in ("Year", "Month", "Day", "Hour", "Minute", "Second")]
UTC_NANO = "UTC_Nano"
UPDATE_RATE = re.compile(r"(?i)(?:update|output)\s*rate:?[\s,;]*([0-9.]{1,12})\s*(?:Hz)?")
DEVICE = re.compile(r"(?i)device\s*id:?\s*([0-9A-F]{8})\b")
PACKETS = 1 << 16  # of PacketCounter: 16 bits
MTI_TICK_S, DOT_TICK_S = 1e-4, 1e-6
# of 0.1 ms: an MTi at the slowest rate of a run, 10 Hz, makes 1,000; DOT at 120 Hz 8,333
FEWEST_DOT_TICKS = 2000.0
# of turns between rows: what orientations show above their own rounding, 1e-6; chosen
SEEN_TURN_RAD = 1e-3
# of a long log that are looked at; chosen: the median of 200 has 0.09 of one's scatter
UTC_ROWS = 200
FEWEST_TURNS = 50  # rows: the median has 0.18 of one row's scatter, 1.25 / sqrt(50)
# of the ratio of gyros to turns: units are 57.3 apart, and an onboard filter is 10 % off
TURN_TOLERANCE = 0.3


class XsensKeys(StretchKeys):
    """Map keys of an Xsens text. `gyro_unit`: where no orientation tells it; `rate_hz`: where the
    text has neither SampleTimeFine nor an update rate.
    """

    format: str | None = None
    gyro_unit: Literal["rad/s", "deg/s"] | None = None
    rate_hz: Annotated[float, Field(ge=MIN_RATE_HZ, le=MAX_RATE_HZ)] | None = None
    axes: AxesKeys = AxesKeys(x="x", y="-y", z="-z")


def _are_names(names: Sequence[str]) -> bool:
    return {ACC[0], GYR[0]} <= set(names) and bool({COUNTER, FINE_CLOCK} & set(names))


def read(path: Path, options: LogOptions) -> ConvertedLog:
    """The log of one unit. InputError where its rate is not known."""
    keys = options.parsed(XsensKeys)
    found = heading(path, _are_names)
    if found is None:
        raise InputError(f"{path.name}: no line with PacketCounter or SampleTimeFine, Acc_X, Gyr_X")
    wanted = [
        COUNTER,
        FINE_CLOCK,
        *GYR,
        *ACC,
        *QUATERNION,
        *DOT_QUATERNION,
        *TURN_MATRIX,
        *PLACE_COLUMNS,
    ]
    wanted += ["Temperature", *UTC_COLUMNS, UTC_NANO]
    columns, notes = read_columns(path, found.layout, [n for n in wanted if n in found.names])
    columns["time"], told = _times(columns, found, keys, path.name)
    unit, more = _unit(columns, keys, path.name)
    shape = {
        "time": {"column": "time"},
        "gyro": {"columns": GYR, "unit": unit},
        "accel": {"columns": ACC, "unit": "m/s2"},
        "axes": keys.axes.model_dump(),
        **stretch_of(keys),
    }
    if np.isfinite(columns.get("Temperature", np.empty(0))).any():
        shape["temperature"] = {"columns": ["Temperature"]}
    beside = {
        name: columns[name]
        for name in (*PLACE_COLUMNS, *UTC_COLUMNS, UTC_NANO, "time")
        if name in columns
    }
    log = converted(
        columns, column_map(LogOptions(shape)), label=path.name, notes=[*notes, *told, *more]
    )
    site, placed = _site(beside, path.name)
    header = {**_serial(found), **site, **_start(beside, log.time_shift_s), **keys.run}
    axes = f"{path.name}: axes taken as x forward, y left, z up; otherwise: axes in the map"
    return replace(log, header=header, notes=(*log.notes, axes, *placed))


def _times(
    columns: dict[str, NDArray], found: Heading, keys: XsensKeys, label: str
) -> tuple[NDArray, list[str]]:
    """Seconds by SampleTimeFine; else by PacketCounter and the rate."""
    fine = columns.get(FINE_CLOCK, np.empty(0))
    steps = np.diff(fine[np.isfinite(fine)])
    steps = steps[steps > 0]
    if steps.size and np.count_nonzero(np.isfinite(fine)) > fine.size / 2:
        tick_s = DOT_TICK_S if np.median(steps) >= FEWEST_DOT_TICKS else MTI_TICK_S
        return fine * tick_s, [f"{label}: a tick of SampleTimeFine is {tick_s:g} s"]
    stated = [m for m in map(UPDATE_RATE.search, found.before) if m is not None]
    rate = keys.rate_hz or (_rate(stated[0][1]) if stated else None)
    if rate is None:
        raise InputError(
            f"{label}: no SampleTimeFine and no update rate in the head: needed rate_hz in the map"
        )
    count = columns.get(COUNTER)
    if count is None or not np.isfinite(count).any():
        return np.arange(1, columns[GYR[0]].size + 1) / rate, [f"{label}: rows at {rate:g} Hz"]
    out = np.full(count.size, np.nan)
    whole = np.flatnonzero(np.isfinite(count) & (np.abs(count) < PACKETS))
    steps = np.mod(np.diff(count[whole]), PACKETS)
    # a count that went back is one step back, not 65,535 ahead
    steps = np.where(steps > PACKETS / 2, steps - PACKETS, steps)
    out[whole] = np.concatenate([[1.0], 1.0 + np.cumsum(steps)])[: whole.size] / rate
    return out, [f"{label}: times by PacketCounter at {rate:g} Hz"]


def _rate(text: str) -> float | None:
    try:
        rate = float(text)
    except ValueError:
        return None
    return rate if MIN_RATE_HZ <= rate <= MAX_RATE_HZ else None


def _unit(columns: dict[str, NDArray], keys: XsensKeys, label: str) -> tuple[str, list[str]]:
    """Of the gyros: as the map says, else as the orientation beside them turns."""
    if keys.gyro_unit is not None:
        return keys.gyro_unit, []
    turn = _turns(columns)
    if turn is not None:
        step_s = np.diff(columns["time"])
        w = np.stack([columns[name] for name in GYR])
        swept = np.linalg.norm(w[:, 1:], axis=0) * step_s
        with np.errstate(invalid="ignore"):
            rows = (turn > SEEN_TURN_RAD) & (turn < 1.0) & (step_s > 0) & np.isfinite(swept)
        if np.count_nonzero(rows) >= FEWEST_TURNS:
            ratio = float(np.median(swept[rows] / turn[rows]))
            for unit, factor in (("rad/s", 1.0), ("deg/s", 1 / DEG)):
                if abs(ratio / factor - 1) < TURN_TOLERANCE:
                    return unit, [f"{label}: gyros in {unit}, as the orientation turns"]
    return "rad/s", [f"{label}: gyros taken in rad/s (DOT: deg/s); gyro_unit in the map otherwise"]


def _turns(columns: dict[str, NDArray]) -> NDArray | None:
    """Angles between the orientations of rows [rad], shape (n - 1,); None where there is none."""
    for names in (QUATERNION, DOT_QUATERNION):
        if set(names) <= set(columns):
            q = np.stack([columns[name] for name in names])
            return 2 * np.arccos(np.clip(np.abs(np.sum(q[:, 1:] * q[:, :-1], axis=0)), 0.0, 1.0))
    if set(TURN_MATRIX) <= set(columns):
        C = np.stack([columns[name] for name in TURN_MATRIX])
        cosine = (np.sum(C[:, 1:] * C[:, :-1], axis=0) - 1.0) / 2.0
        return np.arccos(np.clip(cosine, -1.0, 1.0))
    return None


def _serial(found: Heading) -> dict[str, str]:
    named = [m for m in map(DEVICE.search, found.before) if m is not None]
    return {"gyro_technology": "mems", **({"imu_serial": named[0][1]} if named else {})}


def _site(columns: dict[str, NDArray], label: str) -> tuple[dict[str, dict[str, float]], list[str]]:
    """The first place that the unit's own solution shows."""
    if not set(PLACE_COLUMNS) <= set(columns):
        return {}, []
    lat, lon, height = (columns[name] for name in PLACE_COLUMNS)
    with np.errstate(invalid="ignore"):
        good = (np.abs(lat) <= 90) & (np.abs(lon) <= 180) & ((lat != 0) | (lon != 0))
        rows = np.flatnonzero(good & (np.abs(height) < 30_000))
    if not rows.size:
        return {}, []
    k = rows[0]
    place = {"lat_deg": float(lat[k]), "lon_deg": float(lon[k]), "height_m": float(height[k])}
    told = f"{label}: Latitude, Longitude, Altitude are the unit's solution: the site, and no fixes"
    return {"site": place}, [told]


def _start(columns: dict[str, NDArray], shift_s: float) -> dict[str, str]:
    """start_utc by the median of what the rows with UTC say; none where no row has it."""
    if not set(UTC_COLUMNS) <= set(columns):
        return {}
    parts = np.stack([columns[name] for name in UTC_COLUMNS])
    nano = columns.get(UTC_NANO, np.zeros(parts.shape[1]))
    time_s, _ = going_on(columns["time"])
    rows = np.flatnonzero(np.isfinite(parts).all(axis=0) & np.isfinite(time_s))
    if rows.size > UTC_ROWS:
        rows = rows[np.linspace(0, rows.size - 1, UTC_ROWS).astype(int)]
    starts = [_unix(parts[:, k]) + np.nan_to_num(nano[k]) * 1e-9 - time_s[k] for k in rows]
    start_s = float(np.nanmedian(starts)) + shift_s if np.isfinite(starts).any() else np.nan
    return {"start_utc": utc_text(start_s)} if UNIX_S[0] < start_s < UNIX_S[1] else {}


def _unix(parts: NDArray) -> float:
    try:
        year, month, day, hour, minute, second = map(int, parts.tolist())
        utc = datetime.datetime(year, month, day, hour, minute, second, tzinfo=datetime.UTC)
        return utc.timestamp()
    except (ValueError, OverflowError):
        return float("nan")


def detect(path: Path) -> bool:
    """A line that names PacketCounter or SampleTimeFine beside Acc_X and Gyr_X."""
    return heading(path, _are_names) is not None


READERS = (Reader(name="xsens", about="Xsens text of MT Manager or DOT", detect=detect, read=read),)
