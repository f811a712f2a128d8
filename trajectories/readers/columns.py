"""Raw columns of a log to body-axis increments on run time.

Values are scaled to SI by their named unit, turned into body axes, cleaned of damaged rows (each listed), and shifted
so that run time starts at 0: the first row then ends the first interval.
"""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from ins.records import InputError, TemperatureLog
from trajectories.imu_stream import imu_log
from trajectories.readers.column_map import (
    ACCEL_INCREMENTS,
    ACCEL_RATES,
    CELSIUS,
    GYRO_INCREMENTS,
    GYRO_RATES,
    TIME_UNITS,
    AxesKeys,
    ColumnMap,
    SensorKeys,
    TemperatureKeys,
    axis_matrix,
    used_columns,
)
from trajectories.readers.gps_time import unix_seconds, utc_text
from trajectories.readers.registry import ConvertedLog
from trajectories.readers.text_columns import refuse_missing
from trajectories.run_check import MAX_GAP_S

PLAUSIBLE_RAD_S, PLAUSIBLE_M_S2 = 100.0, 2000.0  # beyond any sensor: 5700 deg/s, 200 g
MAX_DAMAGED = 0.01  # of all rows; beyond it the map is wrong, not the rows


def converted(columns: Mapping[str, NDArray], keys: ColumnMap, *, label: str, notes: list[str]) -> ConvertedLog:
    """The log of raw columns, each shape (n,). Everything dropped or repaired is in `faults` and `notes`."""
    refuse_missing(used_columns(keys), list(columns), label)
    M = axis_matrix(keys.axes)
    w, gyro_kind = _vector(columns, keys.gyro, M)
    f, accel_kind = _vector(columns, keys.accel, M)
    time_s = _times(columns, keys, len(w))
    nominal = _nominal(time_s, label)
    kept, spans = _whole_rows(time_s, w / _span(gyro_kind, nominal), f / _span(accel_kind, nominal), label)
    time_s, w, f = time_s[kept], w[kept], f[kept]
    end, cut = _up_to_gap(time_s, kept, label)
    time_s, w, f, kept, notes = time_s[:end], w[:end], f[:end], kept[:end], notes + cut
    nominal = _nominal(time_s, label)
    shift = float(time_s[0]) - nominal
    if "rates" in (gyro_kind, accel_kind) and gyro_kind != accel_kind:
        dt_s = np.concatenate([[nominal], np.diff(time_s)])[:, None]
        w, f = (w * dt_s, f) if gyro_kind == "rates" else (w, f * dt_s)
        gyro_kind = "increments"
    imu, dropouts = imu_log(time_s - shift, w, f, source=gyro_kind)
    return ConvertedLog(
        imu=imu, temperature=_temperature(columns, keys, kept, time_s - shift), time_shift_s=shift,
        faults=tuple(dropouts), notes=tuple(notes + spans), header={**_start(keys, shift), **keys.run},
    )  # fmt: skip


def _start(keys: ColumnMap, shift_s: float) -> dict[str, str]:
    """start_utc of a clock that counts from a known date."""
    if keys.time is None or keys.time.epoch is None:
        return {}
    return {"start_utc": utc_text(shift_s if keys.time.epoch == "unix" else float(unix_seconds(shift_s)))}


def _vector(columns: Mapping[str, NDArray], sensor: SensorKeys, M: NDArray) -> tuple[NDArray, str]:
    """SI values in body axes, shape (n, 3), and whether they are "rates" or "increments"."""
    rates = GYRO_RATES | ACCEL_RATES  # the unit's own dimension was checked with the map
    kind = "rates" if sensor.unit in rates else "increments"
    factor = (rates | GYRO_INCREMENTS | ACCEL_INCREMENTS)[sensor.unit] * sensor.scale
    raw = np.stack([columns[name] for name in sensor.columns], axis=1)
    out = np.empty_like(raw)
    for i, row in enumerate(M):  # exact: one product a value, no sums over unused axes
        k = int(np.argmax(np.abs(row)))
        out[:, i] = raw[:, k] * (factor * row[k])
    return out, kind


def _times(columns: Mapping[str, NDArray], keys: ColumnMap, n: int) -> NDArray:
    if keys.time is not None:
        return columns[keys.time.column] * TIME_UNITS[keys.time.unit]
    assert keys.rate_hz is not None  # column_map has refused a map with neither
    return np.arange(1, n + 1) / keys.rate_hz


def _nominal(time_s: NDArray, label: str) -> float:
    steps = np.diff(time_s)
    steps = steps[steps > 0]
    if not steps.size:
        raise InputError(f"{label}: {time_s.size} usable rows, needed at least 2 with rising times")
    return float(np.median(steps))


def _span(kind: str, nominal_s: float) -> float:
    return 1.0 if kind == "rates" else nominal_s


def _whole_rows(time_s: NDArray, w: NDArray, f: NDArray, label: str) -> tuple[NDArray, list[str]]:
    """Indices of the rows that are finite, plausible and later than all before them, and notes on the others."""
    finite = np.isfinite(time_s) & np.isfinite(w).all(axis=1) & np.isfinite(f).all(axis=1)
    with np.errstate(invalid="ignore"):
        sane = (np.abs(w) < PLAUSIBLE_RAD_S).all(axis=1) & (np.abs(f) < PLAUSIBLE_M_S2).all(axis=1)
    whole = np.flatnonzero(finite & sane)
    ahead = _ahead(time_s[whole])
    jumps, whole = whole[ahead], whole[~ahead]
    before = np.concatenate([[-np.inf], np.maximum.accumulate(time_s[whole])[:-1]])
    late = time_s[whole] > before
    kept = whole[late]
    faults = {
        "missing or not finite": np.flatnonzero(~finite),
        f"beyond {PLAUSIBLE_RAD_S:g} rad/s or {PLAUSIBLE_M_S2:g} m/s2": np.flatnonzero(finite & ~sane),
        "time jumps ahead and comes back": jumps,
        "time repeats or goes back": whole[~late],
    }
    dropped = len(time_s) - len(kept)
    if dropped > max(5, MAX_DAMAGED * len(time_s)):
        worst = max(faults, key=lambda key: len(faults[key]))
        row = int(faults[worst][0]) + 1
        raise InputError(
            f"{label}: {dropped} of {len(time_s)} rows are damaged (first row {row}: {worst}): wrong columns or units?"
        )
    notes = [f"{label}: {row_ranges(rows)} dropped: {why}" for why, rows in faults.items() if rows.size]
    return kept, notes


def _ahead(time_s: NDArray) -> NDArray:
    """Which times are later than the median of the five around them by more than a gap: garbled, one at a time.

    Left in, such a time would make all that follow it go back.
    """
    if time_s.size < 5:
        return np.zeros(time_s.size, dtype=bool)
    return time_s - median_filter(time_s, size=5, mode="mirror") > MAX_GAP_S


def row_ranges(rows: NDArray) -> str:
    """Rows by number, from 1: "row 7" or "rows 7, 9-12"; long lists are cut."""
    breaks = np.flatnonzero(np.diff(rows) > 1) + 1
    parts = [f"{p[0] + 1}" + (f"-{p[-1] + 1}" if len(p) > 1 else "") for p in np.split(rows, breaks)]
    text = ", ".join(parts[:10]) + (f" and {len(parts) - 10} more stretches" if len(parts) > 10 else "")
    return ("row " if rows.size == 1 else "rows ") + text


def _up_to_gap(time_s: NDArray, kept: NDArray, label: str) -> tuple[int, list[str]]:
    """How many rows come before the first gap that a run may not hold, and a note."""
    gaps = np.flatnonzero(np.diff(time_s) > MAX_GAP_S)
    if not gaps.size:
        return len(time_s), []
    k = int(gaps[0]) + 1
    length = time_s[k] - time_s[k - 1]
    rest = f"gap of {length:.3f} s, {len(time_s) - k} rows after it dropped"
    return k, [f"{label}: read up to row {kept[k - 1] + 1}: {rest}"]


def _temperature(columns: Mapping[str, NDArray], keys: ColumnMap, kept: NDArray, time_s: NDArray) -> TemperatureLog | None:
    """Means over whole seconds; seconds without a complete reading are left out."""
    if keys.temperature is None or keys.temperature.file is not None:
        return None
    body = body_temperatures(columns, keys.temperature, keys.axes)[kept]
    found = second_means(time_s, body)
    if found is None:
        raise InputError(f"map: temperature columns {' '.join(keys.temperature.columns)} hold no complete row")
    return found


def body_temperatures(columns: Mapping[str, NDArray], part: TemperatureKeys, axes: AxesKeys) -> NDArray:
    """Gyro temperatures [degC], shape (n, 3); a thermometer follows its gyro and has no sign."""
    factor, offset = CELSIUS[part.unit]
    names = part.columns * (3 if len(part.columns) == 1 else 1)
    raw = np.stack([columns[name] for name in names], axis=1) * part.scale * factor + offset
    return raw[:, np.argmax(np.abs(axis_matrix(axes)), axis=1)]


def second_means(time_s: NDArray, gyro_degC: NDArray) -> TemperatureLog | None:
    """Means over whole seconds of run time, gyro_degC (n, 3); rows with a NaN left out, None where no row is left."""
    rows = np.flatnonzero(np.isfinite(gyro_degC).all(axis=1))
    if not rows.size:
        return None
    starts = np.flatnonzero(np.diff(np.floor(time_s[rows]), prepend=-np.inf))
    count = np.diff(np.append(starts, rows.size))
    return TemperatureLog(
        time_s=np.add.reduceat(time_s[rows], starts) / count,
        gyro_degC=np.add.reduceat(gyro_degC[rows], starts) / count[:, None],
    )
