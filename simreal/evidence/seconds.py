"""A log by seconds: mean rate and specific force, and how much the rows scatter within each
second.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from alignment.motion.imu_seconds import whole_seconds
from ins.records import ImuSource, InputError

SHORTEST_S = 60.0


@dataclass(frozen=True)
class Seconds:
    """Seconds (n) of a log: `end_s` (n,), `rows` (n,) and, columns gyro x y z [rad/s] then accel x
    y z [m/s^2]:

    mean (n, 6); scatter (n, 6): sum of squared deviations of the rows from the second's mean.
    Seconds without rows hold the mean of the one before (rows 0). dead (6,): columns without any
    variation or not finite.
    """

    end_s: NDArray
    mean: NDArray
    scatter: NDArray
    rows: NDArray
    row_dt_s: float
    dead: NDArray

    @property
    def middle_s(self) -> NDArray:
        return self.end_s - 0.5


def seconds_of(imu: ImuSource) -> Seconds:
    """Read the log once, piece by piece. InputError where it is shorter than a minute."""
    start_s = float(np.floor(imu.start_s - 0.5 / imu.rate_hz))
    count = int(np.floor(imu.end_s - start_s + 1e-6))
    if count < SHORTEST_S:
        raise InputError(
            f"imu: {imu.end_s - imu.start_s:.0f} s, needed at least {SHORTEST_S:.0f} s"
        )
    sums, squares, length, rows = (
        np.zeros((count, 6)),
        np.zeros((count, 6)),
        np.zeros(count),
        np.zeros(count, int),
    )
    for time_s, dt_s, increments in whole_seconds(imu, start_s - 1.0, start_s + count):
        at = np.ceil(time_s - start_s - 1e-6).astype(int) - 1
        keep = (at >= 0) & (at < count)
        at, dt, values = at[keep], dt_s[keep], np.roll(increments[keep], 3, axis=1)
        if not at.size:
            continue
        first = np.flatnonzero(np.diff(at, prepend=-1))
        second = at[first]
        step = np.add.reduceat(dt, first)
        total = np.add.reduceat(values, first, axis=0)
        mean = total / step[:, None]
        group = np.repeat(np.arange(first.size), np.diff(np.append(first, at.size)))
        off = values / dt[:, None] - mean[group]
        sums[second] += total
        length[second] += step
        rows[second] += np.bincount(group)
        squares[second] += np.add.reduceat(off**2, first, axis=0)
    empty = length <= 0
    mean = sums / np.where(empty, 1.0, length)[:, None]
    last = np.maximum.accumulate(np.where(empty, -1, np.arange(count)))
    mean = mean[np.maximum(last, 0)]
    dead = ~np.isfinite(mean).all(axis=0) | (np.ptp(mean, axis=0) == 0.0)
    return Seconds(
        start_s + 1.0 + np.arange(count),
        np.where(dead, 0.0, mean),
        squares,
        rows,
        1.0 / imu.rate_hz,
        dead,
    )
