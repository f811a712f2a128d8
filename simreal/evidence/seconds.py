"""A log by seconds: mean rate and specific force, and how much the rows scatter within each
second.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from alignment.motion.seconds import LogSeconds
from ins.records import InputError

SHORTEST_REST_S = 60.0  # six blocks of PARKED_MEAN_S (10 s), in which the evidence comes


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


def seconds_of(log: LogSeconds) -> Seconds:
    """The seconds of a log on an even grid. InputError where it is shorter than a minute."""
    start_s = float(np.floor(log.first_s[0] - 0.5 / log.rate_hz))
    count = int(np.floor(log.end_s[-1] - start_s + 1e-6))
    if count < SHORTEST_REST_S:
        raise InputError(
            f"imu: {log.end_s[-1] - log.first_s[0]:.0f} s, needed at least {SHORTEST_REST_S:.0f} s"
        )
    at = np.maximum(np.rint(log.start_s - start_s), 0).astype(int)
    known = log.where(at < count)
    at = at[at < count]
    rows = np.zeros(count, int)
    rows[at] = known.rows
    scatter, mean = np.zeros((count, 6)), np.zeros((count, 6))
    scatter[at] = np.roll(known.scatter, 3, axis=1)
    mean[at] = np.roll(known.mean, 3, axis=1)
    last = np.maximum.accumulate(np.where(rows > 0, np.arange(count), -1))
    mean = mean[np.maximum(last, 0)]
    dead = ~np.isfinite(mean).all(axis=0) | (np.ptp(mean, axis=0) == 0.0)
    return Seconds(
        start_s + 1.0 + np.arange(count),
        np.where(dead, 0.0, mean),
        scatter,
        rows,
        1.0 / log.rate_hz,
        dead,
    )
