"""Raw columns of a log to body-axis increments on run time.

Values are scaled to SI by their named unit, turned into body axes, cleaned of damaged rows (each listed), and shifted
so that run time starts at 0: the first row then ends the first interval.
"""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

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
from trajectories.readers.row_cleaning import Stretch, clean_rows
from trajectories.readers.text_columns import refuse_missing

PLAUSIBLE_DEGC = (-60.0, 125.0)


def converted(
    columns: Mapping[str, NDArray], keys: ColumnMap, *, label: str, notes: list[str], base_s: float = 0.0
) -> ConvertedLog:
    """The log of raw columns, each shape (n,). Everything dropped or repaired is in `faults` and `notes`.

    base_s: what the log's own clock shows at time 0 of the columns [s].
    """
    refuse_missing(used_columns(keys), list(columns), label)
    M = axis_matrix(keys.axes)
    w, gyro_kind = _vector(columns, keys.gyro, M)
    f, accel_kind = _vector(columns, keys.accel, M)
    time_s = _times(columns, keys, len(w))
    nominal = _nominal(time_s, label)
    stretch = Stretch(from_s=keys.from_s, to_s=keys.to_s, base_s=base_s)
    with np.errstate(over="ignore", invalid="ignore"):  # damaged values, dropped there
        clean = clean_rows(time_s, w / _span(gyro_kind, nominal), f / _span(accel_kind, nominal), stretch, label)
    kept, time_s, notes = clean.rows, clean.time_s, notes + clean.notes
    w, f = w[kept], f[kept]
    nominal = _nominal(time_s, label)
    shift = float(time_s[0]) - nominal
    if "rates" in (gyro_kind, accel_kind) and gyro_kind != accel_kind:
        dt_s = np.concatenate([[nominal], np.diff(time_s)])[:, None]
        w, f = (w * dt_s, f) if gyro_kind == "rates" else (w, f * dt_s)
        gyro_kind = "increments"
    imu, dropouts = imu_log(time_s - shift, w, f, source=gyro_kind)
    return ConvertedLog(
        imu=imu, temperature=_temperature(columns, keys, kept, time_s - shift), time_shift_s=shift,
        faults=tuple(dropouts), notes=tuple(notes), header={**_start(keys, shift), **keys.run},
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
        with np.errstate(over="ignore", invalid="ignore"):  # damaged values, dropped later
            out[:, i] = raw[:, k] * (factor * row[k])
    return out, kind


def _times(columns: Mapping[str, NDArray], keys: ColumnMap, n: int) -> NDArray:
    if keys.time is not None:
        with np.errstate(over="ignore", invalid="ignore"):  # damaged values, dropped later
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
