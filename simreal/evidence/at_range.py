"""Rows that stand at a sensor's range: what the sensor felt beyond it is lost.

A sensor that is driven past its range reads the same value again and again, and never a larger one.
Rows that are not clipped have one largest value, and no second row that equals it.
"""

from itertools import product

import numpy as np
from numpy.typing import NDArray

from alignment.motion.seconds import SAME, seconds_of
from ins.records import ImuSource
from simreal.effects.base import ACCELS, AXIS, GYROS

# seconds that share the largest value of a log; chosen: a converter of few counts may read its
# largest value twice by chance (tests/simreal/test_saturation.py)
SECONDS_AT_RANGE = 3


def share_at_range(imu: ImuSource, end_s: NDArray, moving: NDArray) -> NDArray:
    """Share of each second's rows that stand at the range, (n, 6) gyros then accelerometers: above
    0 at the upper end, below at the lower; 0 for a sensor that is never clipped.

    end_s (n,): ends of the seconds. moving (n,): seconds in which the vehicle moves: at rest a
    coarse converter may repeat its largest value, and no sensor is at its range.
    """
    log = seconds_of(imu)
    sensors = (*GYROS, *ACCELS)
    out = np.zeros((end_s.size, len(sensors)))
    moves = np.interp(log.end_s, end_s, moving.astype(float)) > 0.5
    # the log has accelerometers first
    upper, lower = np.roll(log.high, 3, axis=1), np.roll(-log.low, 3, axis=1)
    for (place, sensor), sign in product(enumerate(sensors), (1.0, -1.0)):
        most = (upper if sign > 0 else lower)[:, place]
        limit = float(most.max()) * (1.0 - SAME)
        at = (most >= limit) & moves
        if limit > 0.0 and at.sum() >= SECONDS_AT_RANGE:
            out[:, place] += sign * _share(imu, end_s, sensor, sign, limit)
    return out * moving[:, None]


def _share(imu: ImuSource, end_s: NDArray, sensor: str, sign: float, limit: float) -> NDArray:
    """Share of the rows of each second (n,) at one end of a sensor's range."""
    there, rows = np.zeros(end_s.size), np.zeros(end_s.size)
    for piece in imu.pieces():
        columns = piece.dtheta_rad if sensor in GYROS else piece.dv_m_s
        rate = sign * columns[:, AXIS[sensor]] / piece.dt_s
        second = np.searchsorted(end_s, piece.time_s - 1e-9)
        inside = second < end_s.size
        rows += np.bincount(second[inside], minlength=end_s.size)
        there += np.bincount(second[inside], rate[inside] >= limit, minlength=end_s.size)
    return there / np.maximum(rows, 1.0)
