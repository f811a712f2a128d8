"""What a log holds beside its imu, by a column map: fixes, temperatures, wheel speed, in the log's
columns or another file.

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
from trajectories.readers.columns.fix_types import BY_NAME, fix_types
from trajectories.readers.columns.fixes import (
    MAX_SPEED_M_S,
    RawFixes,
    chosen,
    good_fixes,
    may_be_radians,
    with_velocities,
)
from trajectories.readers.columns.imu_columns import body_temperatures, plausible_degC, second_means
from trajectories.readers.columns.layouts import read_columns, side_file
from trajectories.readers.registry import ConvertedLog
from trajectories.readers.rows.clocks import gps_of_unix, unix_seconds, unwrapped
from trajectories.readers.rows.column_map import (
    ANGLES_DEG,
    HEIGHTS,
    SPEEDS,
    TIME_UNITS,
    ColumnMap,
    FileKeys,
    GnssKeys,
    LayoutKeys,
    OdometerKeys,
    TemperatureKeys,
    side_columns,
)
from trajectories.runs.notes import About, Note

Columns = Mapping[str, NDArray]


class GnssFile(StrictModel):
    """[gnss] of a format that has its fixes in a file of their own, relative to the log's
    folder.
    """

    file: str


def with_side_streams(
    log: ConvertedLog, columns: Columns, keys: ColumnMap, path: Path
) -> ConvertedLog:
    """The log with the streams that the map names, read from its own columns or from another
    file.
    """
    if keys.temperature is not None and keys.temperature.file is not None:
        log = _with_temperature(log, keys.temperature, keys, path)
    if keys.odometer is not None:
        log = _with_odometer(log, keys.odometer, columns, keys, path)
    if keys.gnss is not None:
        log, label, found, rows = _columns_of(log, keys.gnss, "gnss", columns, path)
        raw = _fixes(found, keys.gnss, keys, label)
        raw, notes = (raw, []) if rows is None else _each_once(raw, rows, label)
        log = replace(log, notes=(*log.notes, *notes))
        log = with_fixes(log, replace(raw, unix_s=_unix(raw.log_s, keys.gnss, keys)), label=label)
    return log


def with_fixes(log: ConvertedLog, raw: RawFixes, *, label: str) -> ConvertedLog:
    """The log with the good fixes beside it, where it started, and when; what the log's header says
    already stays.
    """
    notes: list[str] = []
    raw = replace(
        raw,
        log_s=unwrapped(raw.log_s, log.time_shift_s, log.time_shift_s + log.imu.end_s, log.wraps_s),
    )
    if raw.log_s.size and not np.isfinite(raw.v_n_m_s).any():
        raw, notes = with_velocities(raw, label=label)
    found, more = good_fixes(raw, label=label)
    notes += more
    gnss = found.on_run_time(log) if found is not None else None
    if found is not None and gnss is None:
        a, b = found.gnss.time_s[0], found.gnss.time_s[-1]
        end_s = log.time_shift_s + log.imu.end_s
        told = (
            f"{label}: fixes at {a:.3f} to {b:.3f} s, imu {log.time_shift_s:.3f} to {end_s:.3f} s:"
            " no gnss stream"
        )
        notes += [Note(told, About.FIXES)]
    elif (
        found is not None
        and gnss is not None
        and (out := found.gnss.time_s.size - gnss.time_s.size)
    ):
        notes += [
            f"{label}: {out} of {found.gnss.time_s.size} fixes lie before or after the imu:"
            " left out"
        ]
    header = found.header(log) if gnss is not None and found is not None else {}
    return replace(log, gnss=gnss, notes=(*log.notes, *notes), header={**header, **log.header})


def with_reference(
    log: ConvertedLog, columns: dict[str, NDArray], *, label: str, rows_of: str = "rows"
) -> ConvertedLog:
    """The log with a reference of columns named as in `ReferenceLog`, time_s on the log's clock:
    the rows in order beside the imu. rows_of: what they are, for the note.
    """
    time_s = columns["time_s"] - log.time_shift_s
    with np.errstate(invalid="ignore"):
        ahead = time_s > np.concatenate([[-np.inf], np.maximum.accumulate(time_s)[:-1]])
        rows = ahead & (time_s >= 0) & (time_s <= log.imu.end_s)
    rows &= np.all(
        [np.isfinite(v).all(axis=tuple(range(1, v.ndim))) for v in columns.values()], axis=0
    )
    note = f"{label}: {np.count_nonzero(rows)} {rows_of} as reference, for scoring only"
    log = replace(log, notes=(*log.notes, note))
    if not rows.any():
        return log
    kept = {k: v[rows] for k, v in columns.items()}
    return replace(log, reference=ReferenceLog(**{**kept, "time_s": time_s[rows]}))


def _columns_of(
    log: ConvertedLog, part: Any, key: str, columns: Columns, path: Path
) -> tuple[ConvertedLog, str, Columns, NDArray | None]:
    """The columns of a stream and their label, and the log with the other file that they come from
    and what was dropped there.

    Of the log's own columns, the rows with anything of this stream, and their indices (None:
    another file).
    """
    names = side_columns(part)
    if part.file is not None:
        other = side_file(path, part.file, f"map: {key}.file")
        found, notes = read_columns(other, part.layout or LayoutKeys(), names)
        return (
            replace(log, other_files=(*log.other_files, other), notes=(*log.notes, *notes)),
            other.name,
            found,
            None,
        )
    values = [name for name in names if part.time is None or name != part.time.column]
    rows = np.flatnonzero(np.any([np.isfinite(columns[name]) for name in values], axis=0))
    return log, path.name, {name: columns[name][rows] for name in columns}, rows


def _clock(columns: Columns, part: FileKeys, keys: ColumnMap) -> NDArray:
    """Times of a stream on the clock of the imu [s]: where both count from a known date, UTC and
    GPS time may differ.
    """
    time = part.time or keys.time
    assert time is not None  # column_map has refused a map without
    with np.errstate(over="ignore", invalid="ignore"):
        time_s = columns[time.column] * TIME_UNITS[time.unit]
        if time.epoch and keys.time and keys.time.epoch not in (None, time.epoch):
            return unix_seconds(time_s) if time.epoch == "gps" else gps_of_unix(time_s)
    return np.asarray(time_s)


def _fixes(columns: Columns, part: GnssKeys, keys: ColumnMap, label: str) -> RawFixes:
    """The fixes as logged. InputError where the unit of the positions cannot be right."""
    place = part.position
    lat, lon, height = (columns[name] for name in place.columns)
    _refuse_unit(lat, lon, part, label)
    v_n = np.full((lat.size, 3), np.nan)
    if part.velocity is not None:
        a, b, c = (columns[name] * SPEEDS[part.velocity.unit] for name in part.velocity.columns)
        v_n = np.column_stack([a, b, c] if part.velocity.frame == "ned" else [b, a, -c])
    is_3d = (
        columns[part.fix.column] >= part.fix.at_least if part.fix else np.ones(lat.size, dtype=bool)
    )
    types = None
    if part.fix is not None and part.fix.scale is not None:
        types = fix_types(columns[part.fix.column], BY_NAME[part.fix.scale])
    factor = ANGLES_DEG[place.unit]
    return RawFixes(
        log_s=_clock(columns, part, keys),
        is_3d=is_3d,
        lat_deg=lat * factor,
        lon_deg=lon * factor,
        height_m=height * HEIGHTS[place.height_unit],
        v_n_m_s=v_n,
        unix_s=np.full(lat.size, np.nan),
        sigmas=_sigmas(columns, part),
        fix_type=types,
    )


def _refuse_unit(lat: NDArray, lon: NDArray, part: GnssKeys, label: str) -> None:
    """InputError where latitudes are beyond a quarter turn, or where degrees that nobody wrote down
    look like radians.
    """
    seen = np.isfinite(lat) & np.isfinite(lon) & ((lat != 0.0) | (lon != 0.0))
    if not seen.any():
        return
    place, typical = part.position, float(np.median(np.abs(lat[seen])))
    most = 90.0 / ANGLES_DEG[place.unit]
    told = f"{label}: latitudes of {typical:g} (median)"
    if typical > most:
        raise InputError(f"{told}, needed at most {most:g} {place.unit}: {_place_unit(typical)}")
    if "unit" not in place.model_fields_set and may_be_radians(lat, lon):
        raise InputError(
            f'{told}, longitudes within 3.142: degrees or radians? unit = "rad" or "deg" in [gnss]'
            " position"
        )


def _place_unit(latitude: float) -> str:
    """What a latitude may be that is too large for its unit."""
    if latitude <= 90.0:
        return 'unit = "deg"?'
    if latitude > 1e5:
        return 'unit = "1e-7 deg"?'
    return (
        "latitude and longitude exchanged?"
        if latitude <= 180.0
        else "degrees and minutes? needed decimal degrees"
    )


def _each_once(raw: RawFixes, rows: NDArray, label: str) -> tuple[RawFixes, list[str]]:
    """Where the log repeats the last fix in every row, the first of each run of rows counts; and a
    note.
    """
    if rows.size < 2:
        return raw, []
    same = np.column_stack([raw.lat_deg, raw.lon_deg, raw.height_m, np.nan_to_num(raw.v_n_m_s)])
    new = np.concatenate([[True], np.any(same[1:] != same[:-1], axis=1) | (np.diff(rows) > 1)])
    held = rows.size - int(new.sum())
    notes = (
        [f"{label}: {held} rows repeat the fix of the row before: each fix counts once"]
        if held
        else []
    )
    return chosen(raw, new), notes


def _sigmas(columns: Columns, part: GnssKeys) -> NDArray | None:
    """Horizontal and vertical [m], velocity [m/s], shape (3, n): of one axis, so the root mean
    square of north and east.
    """
    place, speed = part.position.sigma, part.velocity.sigma if part.velocity else None
    if place is None and speed is None:
        return None
    n = columns[part.position.columns[0]].size
    out = np.full((3, n), np.nan)
    if place is not None:
        out[0] = np.sqrt(np.mean([_positive(columns[name]) ** 2 for name in place[:-1]], axis=0))
        out[1] = columns[place[-1]]
    if speed is not None and part.velocity is not None:
        factor = SPEEDS[part.velocity.unit]
        out[2] = factor * np.sqrt(
            np.mean([_positive(columns[name]) ** 2 for name in speed], axis=0)
        )
    return out


def _positive(values: NDArray) -> NDArray:
    """NaN for what is no sigma."""
    return np.where(values > 0, values, np.nan)


def _unix(log_s: NDArray, part: FileKeys, keys: ColumnMap) -> NDArray:
    """UTC [s] of a clock that counts from a known date, else NaN; `_clock` has brought it to that
    of the imu.
    """
    epochs = [
        time.epoch for time in (keys.time, part.time) if time is not None and time.epoch is not None
    ]
    if not epochs:
        return np.full(log_s.size, np.nan)
    return log_s if epochs[0] == "unix" else unix_seconds(log_s)


def _with_temperature(
    log: ConvertedLog, part: TemperatureKeys, keys: ColumnMap, path: Path
) -> ConvertedLog:
    log, label, columns, _ = _columns_of(log, part, "temperature", {}, path)
    time_s = _run_time(log, _clock(columns, part, keys))
    rows = np.flatnonzero((time_s >= 0) & (time_s <= log.imu.end_s))
    rows = rows[np.argsort(time_s[rows], kind="stable")]
    body = body_temperatures(columns, part, keys.axes)[rows]
    degC, notes = plausible_degC(body, label, unit=part.unit)
    found = second_means(time_s[rows], degC)
    if found is None:
        raise InputError(
            f"{label}: no temperature between the first and the last imu row: another clock?"
        )
    return replace(log, temperature=found, notes=(*log.notes, *notes))


def _run_time(log: ConvertedLog, clock_s: NDArray) -> NDArray:
    return (
        unwrapped(clock_s, log.time_shift_s, log.time_shift_s + log.imu.end_s, log.wraps_s)
        - log.time_shift_s
    )


def _with_odometer(
    log: ConvertedLog, part: OdometerKeys, columns: Columns, keys: ColumnMap, path: Path
) -> ConvertedLog:
    """Speeds beside the imu, in order of time; rows out of order or beyond any vehicle are dropped
    and noted.
    """
    log, label, found, _ = _columns_of(log, part, "odometer", columns, path)
    time_s = _run_time(log, _clock(found, part, keys))
    speed = found[part.column] * (part.scale * SPEEDS[part.unit])
    with np.errstate(invalid="ignore"):
        inside = np.isfinite(speed) & (time_s >= 0) & (time_s <= log.imu.end_s)
        wild = inside & (np.abs(speed) >= MAX_SPEED_M_S)
    beside_it = np.flatnonzero(inside & ~wild)
    before = (
        np.concatenate([[-np.inf], np.maximum.accumulate(time_s[beside_it])[:-1]])
        if beside_it.size
        else np.empty(0)
    )
    rows = beside_it[time_s[beside_it] > before]
    if not rows.size:
        raise InputError(
            f"{label}: no speed between the first and the last imu row: another clock?"
        )
    dropped = {
        "time repeats or goes back": beside_it.size - rows.size,
        f"beyond {MAX_SPEED_M_S:g} m/s": int(wild.sum()),
        "no speed": int(np.count_nonzero(~np.isfinite(speed))),
    }
    notes = [
        f"{label}: {count} odometer rows dropped: {why}" for why, count in dropped.items() if count
    ]
    odometer = OdometerLog(time_s=time_s[rows], speed_m_s=speed[rows])
    return replace(log, odometer=odometer, notes=(*log.notes, *notes))
