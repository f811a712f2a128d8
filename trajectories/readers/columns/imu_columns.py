"""Raw columns of a log to body-axis increments on run time.

Values are scaled to SI by their named unit, turned into body axes, cleaned of damaged rows (each
listed), and shifted so that run time starts at 0: the first row then ends the first interval.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ins.records import InputError, TemperatureLog
from trajectories.readers.columns.text_columns import refuse_missing
from trajectories.readers.registry import ConvertedLog
from trajectories.readers.rows.clocks import dated, evened, unix_seconds
from trajectories.readers.rows.column_map import (
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
    other_columns,
    used_columns,
)
from trajectories.readers.rows.row_cleaning import CleanRows, LogSpan, are_all, clean_rows
from trajectories.runs.checks import MAX_GAP_S, MAX_RATE_HZ, MIN_RATE_HZ
from trajectories.runs.imu_stream import imu_log
from trajectories.runs.notes import About, Note

# parts of military grade are rated for -55 to 125 degC; docs/log_formats.md
PLAUSIBLE_DEGC = (-60.0, 125.0)
USUAL_DEGC = (-40.0, 85.0)  # parts of industrial grade are rated for -40 to 85 degC
# Beyond these two no message on rates or gaps says it better.
LEAST_STEP_S = 1e-5  # 100 kHz, fifty times the fastest unit
MOST_STEP_S = MAX_GAP_S


def converted(
    columns: dict[str, NDArray],
    keys: ColumnMap,
    *,
    label: str,
    notes: list[str],
    base_s: float = 0.0,
) -> ConvertedLog:
    """The log of raw columns, each shape (n,). Everything dropped or repaired is in `faults` and
    `notes`. The columns that nothing else needs are taken out of `columns`: a long log is held once
    where it can be.

    base_s: what the log's own clock shows at time 0 of the columns [s].
    """
    refuse_missing(used_columns(keys), list(columns), label)
    M = axis_matrix(keys.axes)
    w, gyro_kind = sensor_vectors(columns, keys.gyro, M)
    f, accel_kind = sensor_vectors(columns, keys.accel, M)
    time_s = _times(columns, keys, len(w))
    for name in {*keys.gyro.columns, *keys.accel.columns} - set(other_columns(keys)):
        del columns[name]
    # the others are rows of other streams
    held = np.isfinite(w).any(axis=1) | np.isfinite(f).any(axis=1)
    nominal = _nominal(time_s[held], label, keys)
    stretch = LogSpan(from_s=keys.from_s, to_s=keys.to_s, base_s=base_s)
    with np.errstate(over="ignore", invalid="ignore"):  # damaged values, dropped there
        clean = clean_rows(
            time_s,
            _per_second(w, gyro_kind, nominal),
            _per_second(f, accel_kind, nominal),
            stretch,
            label,
        )
    kept, time_s, notes = clean.rows, clean.time_s, notes + clean.notes
    if not are_all(kept, len(w)):
        w, f = w[kept], f[kept]
    even = evened(time_s)
    if even is not None:
        notes = [*notes, _bursts_note(time_s, even, label)]
        time_s = even
    nominal = _nominal(time_s, label, keys)
    shift = float(time_s[0]) - nominal
    if "rates" in (gyro_kind, accel_kind) and gyro_kind != accel_kind:
        dt_s = np.concatenate([[nominal], np.diff(time_s)])[:, None]
        w, f = (w * dt_s, f) if gyro_kind == "rates" else (w, f * dt_s)
        gyro_kind = "increments"
    imu, dropouts = imu_log(time_s - shift, w, f, source=gyro_kind)
    start, told = _start(keys, shift, label)
    log = ConvertedLog(
        imu=imu,
        time_shift_s=shift,
        wraps_s=clean.wraps_s,
        faults=tuple(dropouts),
        notes=(*notes, *told),
        header={**start, **keys.run},
    )
    return (
        log
        if keys.temperature is None or keys.temperature.file is not None
        else _with_own(log, columns, keys, clean, label)
    )


def _bursts_note(time_s: NDArray, even: NDArray, label: str) -> str:
    off = time_s - even
    return (
        f"{label}: the host stamped the rows in bursts (median interval"
        f" {1e3 * np.median(np.diff(time_s)):.2g} ms): spread evenly at"
        f" {1.0 / np.median(np.diff(even)):.4g} Hz, the stamps jitter by {1e3 * np.std(off):.2g} ms"
        f" about that (RMS), {1e3 * np.abs(off).max():.2g} ms at most"
    )


def _start(keys: ColumnMap, shift_s: float, label: str) -> tuple[dict[str, str], list[str]]:
    """start_utc of a clock that counts from a known date, and a note where it cannot be that."""
    if keys.time is None or keys.time.epoch is None:
        return {}, []
    return dated(shift_s if keys.time.epoch == "unix" else float(unix_seconds(shift_s)), label)


def sensor_vectors(
    columns: Mapping[str, NDArray], sensor: SensorKeys, M: NDArray
) -> tuple[NDArray, str]:
    """SI values in body axes, shape (n, 3), and whether they are "rates" or "increments"."""
    rates = GYRO_RATES | ACCEL_RATES  # the unit's own dimension was checked with the map
    kind = "rates" if sensor.unit in rates else "increments"
    factor = (rates | GYRO_INCREMENTS | ACCEL_INCREMENTS)[sensor.unit] * sensor.scale
    raw = [columns[name] for name in sensor.columns]
    out = np.empty((raw[0].size, 3))
    for i, row in enumerate(M):  # exact: one product a value, no sums over unused axes
        k = int(np.argmax(np.abs(row)))
        with np.errstate(over="ignore", invalid="ignore"):  # damaged values, dropped later
            np.multiply(raw[k], factor * row[k], out=out[:, i])
    return out, kind


def _times(columns: Mapping[str, NDArray], keys: ColumnMap, n: int) -> NDArray:
    if keys.time is not None:
        with np.errstate(over="ignore", invalid="ignore"):  # damaged values, dropped later
            return columns[keys.time.column] * TIME_UNITS[keys.time.unit]
    assert keys.rate_hz is not None  # column_map has refused a map with neither
    return np.arange(1, n + 1) / keys.rate_hz


def _nominal(time_s: NDArray, label: str, keys: ColumnMap) -> float:
    with np.errstate(over="ignore"):
        steps = np.diff(time_s[np.isfinite(time_s)])
    steps = steps[steps > 0]
    if not steps.size:
        raise InputError(f"{label}: {time_s.size} usable rows, needed at least 2 with rising times")
    nominal_s = float(np.median(steps))
    if not LEAST_STEP_S <= nominal_s <= MOST_STEP_S:
        needed = f"{1 / MAX_RATE_HZ:g} to {1 / MIN_RATE_HZ:g}"
        raise InputError(
            f"{label}: rows {nominal_s:.4g} s apart (median), needed {needed} s:"
            f" {_time_unit(nominal_s, keys)}?"
        )
    return nominal_s


def _time_unit(nominal_s: float, keys: ColumnMap) -> str:
    """Which unit the time stamps may have, in the map's words."""
    if keys.time is None:
        return "rate_hz"
    said = keys.time.unit
    rates = {u: TIME_UNITS[said] / (nominal_s * factor) for u, factor in TIME_UNITS.items()}
    fits = [unit for unit, rate in rates.items() if MIN_RATE_HZ <= rate <= MAX_RATE_HZ]
    if not fits:
        return "unit of the time stamps"
    return f'time.unit = "{fits[0]}" in the map, not "{said}"'


def _per_second(values: NDArray, kind: str, nominal_s: float) -> NDArray:
    return values if kind == "rates" else values / nominal_s


def _with_own(
    log: ConvertedLog, columns: Mapping[str, NDArray], keys: ColumnMap, clean: CleanRows, label: str
) -> ConvertedLog:
    """The log with the temperatures in its own rows."""
    part = keys.temperature
    assert part is not None
    rows = np.concatenate([clean.rows, clean.others])
    time_s = clean.clock_s - log.time_shift_s
    rows = rows[(time_s[rows] >= 0) & (time_s[rows] <= log.imu.end_s)]
    rows = rows[np.argsort(time_s[rows], kind="stable")]
    degC = body_temperatures(columns, part, keys.axes)[rows]
    body, notes = plausible_degC(degC, label, unit=part.unit)
    found = second_means(time_s[rows], body)
    if found is None:
        raise InputError(f"{label}: {_no_temperature(part.columns, columns)}")
    return replace(log, temperature=found, notes=(*log.notes, *notes))


def plausible_degC(
    gyro_degC: NDArray, label: str, *, asked_for: bool = True, unit: str = "degC"
) -> tuple[NDArray, list[str]]:
    """Readings (n,) or (n, 3) with NaN where no sensor shows such a value, and notes on those, and
    on one that never changes.

    unit: the one that the map declares. InputError where half of them or more are such and a map
    asked for them: a wrong unit, which is named where one would fit.
    """
    with np.errstate(invalid="ignore"):
        sane = (gyro_degC >= PLAUSIBLE_DEGC[0]) & (gyro_degC <= PLAUSIBLE_DEGC[1])
    read = np.isfinite(gyro_degC)
    wild = gyro_degC[read & ~sane]
    notes: list[str] = []
    all_rows, wild_rows = (
        int(np.count_nonzero(v if v.ndim == 1 else v.any(axis=1))) for v in (read, read & ~sane)
    )
    if wild.size:
        told = (
            f"{label}: {wild_rows} of {all_rows} temperatures are {wild.min():g} to {wild.max():g}"
            " degC"
        )
        needed = f"needed {PLAUSIBLE_DEGC[0]:g} to {PLAUSIBLE_DEGC[1]:g}"
        if asked_for and 2 * wild_rows >= all_rows:
            raise InputError(f"{told}, {needed}: {_other_unit(float(np.median(wild)), unit)}")
        notes.append(Note(f"{told}, {needed}: left out", About.TEMPERATURE))
    good = gyro_degC[sane]
    if good.size > 100 and np.ptp(good) == 0.0:
        notes.append(
            f"{label}: all {all_rows} temperatures are {good[0]:g} degC: a thermometer that is"
            " stuck, or missing?"
        )
    return np.where(sane, gyro_degC, np.nan), notes


def _no_temperature(names: Sequence[str], columns: Mapping[str, NDArray]) -> str:
    """What keeps the columns of temperatures from a row in which all of them have a value."""
    empty = [name for name in names if not np.isfinite(columns[name]).any()]
    if not empty:
        return f"temperature columns {' '.join(names)} hold no complete row, needed one"
    told = f"temperature column {' '.join(empty)} has no value"
    if len(empty) == len(names):
        return f"{told}, needed one"
    return f"{told}, needed one beside {' '.join(n for n in names if n not in empty)}"


def _other_unit(degC: float, unit: str) -> str:
    """The unit in which a value that was taken for degC, as the map's unit has it, would be a usual
    temperature.
    """
    raw = (degC - CELSIUS[unit][1]) / CELSIUS[unit][0]
    usual = [
        (degC - 273.15, 'kelvin? unit = "K"'),
        (degC + 273.15, 'degC taken for kelvin? unit = "degC"'),
        (0.1 * degC, "tenths? scale = 0.1"),
        (0.01 * degC, "hundredths? scale = 0.01"),
        (1e-3 * degC, "thousandths? scale = 0.001"),
    ]
    if unit == "K":  # 91 degF taken for kelvin are -182 degC: no tenth of a kelvin is such
        usual[2:] = [((raw - 32.0) / 1.8, 'degF taken for kelvin? unit = "degF"')]
    return next(
        (told for value, told in usual if USUAL_DEGC[0] <= value <= USUAL_DEGC[1]),
        "counts? unit and scale in the map",
    )


def body_temperatures(
    columns: Mapping[str, NDArray], part: TemperatureKeys, axes: AxesKeys
) -> NDArray:
    """Gyro temperatures [degC], shape (n, 3); a thermometer follows its gyro and has no sign."""
    factor, offset = CELSIUS[part.unit]
    names = part.columns * (3 if len(part.columns) == 1 else 1)
    raw = np.stack([columns[name] for name in names], axis=1) * part.scale * factor + offset
    return raw[:, np.argmax(np.abs(axis_matrix(axes)), axis=1)]


def second_means(time_s: NDArray, gyro_degC: NDArray) -> TemperatureLog | None:
    """Means over whole seconds of run time, gyro_degC (n, 3); rows with a NaN left out, None where
    no row is left.
    """
    rows = np.flatnonzero(np.isfinite(gyro_degC).all(axis=1))
    if not rows.size:
        return None
    starts = np.flatnonzero(np.diff(np.floor(time_s[rows]), prepend=-np.inf))
    count = np.diff(np.append(starts, rows.size))
    return TemperatureLog(
        time_s=np.add.reduceat(time_s[rows], starts) / count,
        gyro_degC=np.add.reduceat(gyro_degC[rows], starts) / count[:, None],
    )
