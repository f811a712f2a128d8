"""Faults put into a finished run, for tests of the gates: each returns a new run, the given one is
untouched.

Row spans are half open, [start_s, end_s). Raises InputError where a span holds no row.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ins.records import AXES, ImuLog, InputError, Run


def stuck_thermometer(run: Run, *, axis: str, start_s: float, end_s: float = np.inf) -> Run:
    """The gyro thermometer of an axis repeats its first reading of the span."""
    if run.temperature is None:
        raise InputError(f"run {run.header.run_id}: no temperature stream to be stuck")
    rows = _rows(run.temperature.time_s, start_s, end_s)
    gyro = run.temperature.gyro_degC.copy()
    column = gyro[:, AXES.index(axis)]
    column[rows] = column[rows][0]
    return replace(run, temperature=replace(run.temperature, gyro_degC=gyro))


def clipped_gyro(
    run: Run, *, axis: str, limit_rad_s: float, start_s: float = -np.inf, end_s: float = np.inf
) -> Run:
    """The gyro of an axis saturates at +-limit."""
    imu = run.imu.whole()
    return _with(
        run,
        imu,
        "dtheta_rad",
        _clipped(imu, imu.dtheta_rad, axis, limit_rad_s, _rows(imu.time_s, start_s, end_s)),
    )


def clipped_accelerometer(
    run: Run, *, axis: str, limit_m_s2: float, start_s: float = -np.inf, end_s: float = np.inf
) -> Run:
    """The accelerometer of an axis saturates at +-limit."""
    imu = run.imu.whole()
    return _with(
        run,
        imu,
        "dv_m_s",
        _clipped(imu, imu.dv_m_s, axis, limit_m_s2, _rows(imu.time_s, start_s, end_s)),
    )


def stuck_at_full_scale(
    run: Run, *, sensor: str, axis: str, at_s: float, rows: int, total: float
) -> Run:
    """For some rows a "gyro" or an "accelerometer" reads one extreme value, `total` [rad or m/s]
    over all of them.
    """
    imu = run.imu.whole()
    first = int(np.searchsorted(imu.time_s, at_s))
    name = {"gyro": "dtheta_rad", "accelerometer": "dv_m_s"}[sensor]
    increments = getattr(imu, name).copy()
    increments[first : first + rows, AXES.index(axis)] = total / rows
    return _with(run, imu, name, increments)


def _clipped(imu: ImuLog, increments: NDArray, axis: str, limit: float, rows: NDArray) -> NDArray:
    clipped = increments.copy()
    column, most = clipped[:, AXES.index(axis)], limit * imu.dt_s[rows]
    column[rows] = np.clip(column[rows], -most, most)
    return clipped


def _with(run: Run, imu: ImuLog, name: str, increments: NDArray) -> Run:
    changed = (
        replace(imu, dtheta_rad=increments)
        if name == "dtheta_rad"
        else replace(imu, dv_m_s=increments)
    )
    return replace(run, imu=changed)


def shock(run: Run, *, axis: str, at_s: float, dv_m_s: float) -> Run:
    """One sample of the accelerometer of an axis is off by dv."""
    imu = run.imu.whole()
    row = int(np.searchsorted(imu.time_s, at_s))
    dv = imu.dv_m_s.copy()
    dv[row, AXES.index(axis)] += dv_m_s
    return replace(run, imu=replace(imu, dv_m_s=dv))


def dropout(run: Run, *, start_s: float, end_s: float) -> Run:
    """The IMU rows of the span are missing; the intervals of the others stay as they were."""
    imu = run.imu.whole()
    keep = ~_rows(imu.time_s, start_s, end_s)
    return replace(
        run,
        imu=ImuLog(
            time_s=imu.time_s[keep],
            dt_s=imu.dt_s[keep],
            dtheta_rad=imu.dtheta_rad[keep],
            dv_m_s=imu.dv_m_s[keep],
            source=imu.source,
        ),
    )


def time_jump(run: Run, *, at_s: float, by_s: float) -> Run:
    """The clock of the IMU jumps forward; temperature and the other streams keep theirs."""
    if not by_s > 0:
        raise InputError(f"time jump by {by_s} s, needed more than 0")
    imu = run.imu.whole()
    late = _rows(imu.time_s, at_s, np.inf)
    return replace(run, imu=replace(imu, time_s=imu.time_s + by_s * late))


def _rows(time_s: NDArray, start_s: float, end_s: float) -> NDArray:
    rows = (time_s >= start_s) & (time_s < end_s)
    if not rows.any():
        raise InputError(f"no rows in {start_s:g} to {end_s:g} s")
    return rows
