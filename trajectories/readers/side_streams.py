"""What a log holds beside its imu, by a column map: fixes, temperatures, wheel speed, in the log's columns or another file.

All share the log's clock: its run time is the clock less `time_shift_s` of the imu.
"""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ins.json_file import StrictModel
from ins.records import InputError, OdometerLog, ReferenceLog
from ins.units import DEG
from trajectories.readers.column_map import (
    SPEEDS,
    TIME_UNITS,
    ColumnMap,
    FileKeys,
    GnssKeys,
    LayoutKeys,
    OdometerKeys,
    TemperatureKeys,
    TimeKeys,
    side_columns,
)
from trajectories.readers.columns import body_temperatures, second_means
from trajectories.readers.fix_velocity import with_velocities
from trajectories.readers.fixes import RawFixes, chosen, good_fixes
from trajectories.readers.gps_time import unix_seconds
from trajectories.readers.layouts import read_columns, side_file
from trajectories.readers.registry import ConvertedLog

Columns = Mapping[str, NDArray]


class GnssFile(StrictModel):
    """[gnss] of a format that has its fixes in a file of their own, relative to the log's folder."""

    file: str


def with_side_streams(log: ConvertedLog, columns: Columns, keys: ColumnMap, path: Path) -> ConvertedLog:
    """The log with the streams that the map names, read from its own columns or from another file."""
    if keys.temperature is not None and keys.temperature.file is not None:
        log = _with_temperature(log, keys.temperature, keys, path)
    if keys.odometer is not None:
        log = _with_odometer(log, keys.odometer, columns, keys, path)
    if keys.gnss is not None:
        log, label, found = _columns_of(log, keys.gnss, "gnss", columns, path)
        raw, clock = _fixes(found, keys.gnss, keys), keys.gnss.time or keys.time
        log = with_fixes(log, replace(raw, unix_s=_unix(raw.log_s, clock)), label=label)
    return log


def with_fixes(log: ConvertedLog, raw: RawFixes, *, label: str) -> ConvertedLog:
    """The log with the good fixes beside it, where it started, and when; what the log's header says already stays."""
    notes: list[str] = []
    if raw.log_s.size and not np.isfinite(raw.v_n_m_s).any():
        raw, notes = with_velocities(raw, label=label)
    found, more = good_fixes(raw, label=label)
    notes += more
    gnss = found.on_run_time(log) if found is not None else None
    if found is not None and gnss is None:
        a, b = found.gnss.time_s[0], found.gnss.time_s[-1]
        end_s = log.time_shift_s + log.imu.end_s
        notes += [f"{label}: fixes at {a:.3f} to {b:.3f} s, imu {log.time_shift_s:.3f} to {end_s:.3f} s: no gnss stream"]
    header = found.header(log) if gnss is not None and found is not None else {}
    return replace(log, gnss=gnss, notes=(*log.notes, *notes), header={**header, **log.header})


def reference_on_run_time(log: ConvertedLog, columns: dict[str, NDArray]) -> ReferenceLog | None:
    """A reference of columns named as in `ReferenceLog`, time_s on the log's clock; rows in order beside the imu."""
    time_s = columns["time_s"] - log.time_shift_s
    with np.errstate(invalid="ignore"):
        ahead = time_s > np.concatenate([[-np.inf], np.maximum.accumulate(time_s)[:-1]])
        rows = ahead & (time_s >= 0) & (time_s <= log.imu.end_s)
    rows &= np.all([np.isfinite(v).reshape(v.shape[0], -1).all(axis=1) for v in columns.values()], axis=0)
    return ReferenceLog(**{**{k: v[rows] for k, v in columns.items()}, "time_s": time_s[rows]}) if rows.any() else None


def _columns_of(log: ConvertedLog, part: Any, key: str, columns: Columns, path: Path) -> tuple[ConvertedLog, str, Columns]:
    """The columns of a stream and their label, and the log with the other file that they come from and what was dropped there.

    Of the log's own columns, the rows with anything of this stream.
    """
    names = side_columns(part)
    if part.file is not None:
        other = side_file(path, part.file, f"map: {key}.file")
        found, notes = read_columns(other, part.layout or LayoutKeys(), names)
        return replace(log, other_files=(*log.other_files, other), notes=(*log.notes, *notes)), other.name, found
    values = [name for name in names if part.time is None or name != part.time.column]
    rows = np.any([np.isfinite(columns[name]) for name in values], axis=0)
    return log, path.name, {name: columns[name][rows] for name in columns}


def _clock(columns: Columns, part: FileKeys, keys: ColumnMap) -> NDArray:
    time = part.time or keys.time
    assert time is not None  # column_map has refused a map without
    return columns[time.column] * TIME_UNITS[time.unit]


def _fixes(columns: Columns, part: GnssKeys, keys: ColumnMap) -> RawFixes:
    """The fixes as logged, each once: where the log repeats the last one in every row, the first of them counts."""
    factor = 1.0 if part.position.unit == "deg" else 1.0 / DEG
    lat, lon, height = (columns[name] for name in part.position.columns)
    v_n = np.full((lat.size, 3), np.nan)
    if part.velocity is not None:
        a, b, c = (columns[name] * SPEEDS[part.velocity.unit] for name in part.velocity.columns)
        v_n = np.column_stack([a, b, c] if part.velocity.frame == "ned" else [b, a, -c])
    is_3d = columns[part.fix.column] >= part.fix.at_least if part.fix else np.ones(lat.size, dtype=bool)
    raw = RawFixes(
        log_s=_clock(columns, part, keys), is_3d=is_3d, lat_deg=lat * factor, lon_deg=lon * factor, height_m=height,
        v_n_m_s=v_n, unix_s=np.full(lat.size, np.nan), sigmas=_sigmas(columns, part),
    )  # fmt: skip
    if part.file is not None or lat.size < 2:
        return raw
    same = np.column_stack([lat, lon, height, np.nan_to_num(v_n)])
    return chosen(raw, np.concatenate([[True], np.any(same[1:] != same[:-1], axis=1)]))


def _sigmas(columns: Columns, part: GnssKeys) -> NDArray | None:
    """Horizontal and vertical [m], velocity [m/s], shape (3, n): of one axis, so the root mean square of north and east."""
    place, speed = part.position.sigma, part.velocity.sigma if part.velocity else None
    if place is None and speed is None:
        return None
    n = columns[part.position.columns[0]].size
    out = np.full((3, n), np.nan)
    if place is not None:
        out[0] = np.sqrt(np.mean([columns[name] ** 2 for name in place[:-1]], axis=0))
        out[1] = columns[place[-1]]
    if speed is not None and part.velocity is not None:
        factor = SPEEDS[part.velocity.unit]
        out[2] = factor * np.sqrt(np.mean([columns[name] ** 2 for name in speed], axis=0))
    return out


def _unix(log_s: NDArray, time: TimeKeys | None) -> NDArray:
    """UTC [s] of a clock that counts from a known date, else NaN."""
    if time is None or time.epoch is None:
        return np.full(log_s.size, np.nan)
    return log_s if time.epoch == "unix" else unix_seconds(log_s)


def _with_temperature(log: ConvertedLog, part: TemperatureKeys, keys: ColumnMap, path: Path) -> ConvertedLog:
    log, label, columns = _columns_of(log, part, "temperature", {}, path)
    time_s = _clock(columns, part, keys) - log.time_shift_s
    rows = np.flatnonzero((time_s >= 0) & (time_s <= log.imu.end_s))
    rows = rows[np.argsort(time_s[rows], kind="stable")]
    found = second_means(time_s[rows], body_temperatures(columns, part, keys.axes)[rows])
    if found is None:
        raise InputError(f"{label}: no temperature between the first and the last imu row: another clock?")
    return replace(log, temperature=found)


def _with_odometer(log: ConvertedLog, part: OdometerKeys, columns: Columns, keys: ColumnMap, path: Path) -> ConvertedLog:
    """Speeds beside the imu, in order of time; rows out of order are dropped and noted."""
    log, label, found = _columns_of(log, part, "odometer", columns, path)
    time_s = _clock(found, part, keys) - log.time_shift_s
    speed = found[part.column] * (part.scale * SPEEDS[part.unit])
    beside = np.flatnonzero(np.isfinite(speed) & (time_s >= 0) & (time_s <= log.imu.end_s))
    before = np.concatenate([[-np.inf], np.maximum.accumulate(time_s[beside])[:-1]]) if beside.size else np.empty(0)
    rows = beside[time_s[beside] > before]
    if not rows.size:
        raise InputError(f"{label}: no speed between the first and the last imu row: another clock?")
    late = beside.size - rows.size
    notes = [f"{label}: {late} odometer rows dropped: time repeats or goes back"] if late else []
    odometer = OdometerLog(time_s=time_s[rows], speed_m_s=speed[rows])
    return replace(log, odometer=odometer, notes=(*log.notes, *notes))
