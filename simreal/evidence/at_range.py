"""Rows that stand at a sensor's range: what the sensor felt beyond it is lost.

A sensor that is driven past its range reads the same value again and again, and never a larger one.
Rows that are not clipped have one largest value, and no second row that equals it; where they do,
a coarse converter reads many values twice, not the largest alone.
"""

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from alignment.motion.seconds import SAME, LogSeconds, seconds_of
from ins.errors.base import ACCELS, AXIS, GYROS
from ins.records import ImuLog, ImuSource

# seconds that share the largest value of a log; chosen: a converter of few counts may read its
# largest value twice by chance (tests/simreal/test_saturation.py)
SECONDS_AT_RANGE = 3
# rows that share the largest value, where none of as many below it as NEXT_ROWS share theirs: those
# 30 differ, so that a step of the converter is some 1/450 of their spread (30^2 / 2 pairs), and
# three rows read one value by chance in less than 1 of 1,000 logs
TIED_ROWS, NEXT_ROWS = 3, 30


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
        if not (limit > 0.0 and at.any()):
            continue
        of = _Sensor(sensor, sign)
        if at.sum() >= SECONDS_AT_RANGE or of.tied(imu, log, np.where(moves, most, -np.inf)):
            out[:, place] += sign * of.share(imu, end_s, limit)
    return out * moving[:, None]


@dataclass(frozen=True)
class _Sensor:
    """One end of a sensor's range; sign: 1 for the upper one."""

    name: str
    sign: float

    def rates(self, imu: ImuLog) -> NDArray:
        """Of the rows, towards this end."""
        columns = imu.dtheta_rad if self.name in GYROS else imu.dv_m_s
        return np.asarray(self.sign * columns[:, AXIS[self.name]] / imu.dt_s)

    def share(self, imu: ImuSource, end_s: NDArray, limit: float) -> NDArray:
        """Share of the rows of each second (n,) that stand at the end."""
        there, rows = np.zeros(end_s.size), np.zeros(end_s.size)
        for piece in imu.pieces():
            second = np.searchsorted(end_s, piece.time_s - 1e-9)
            inside = second < end_s.size
            at = self.rates(piece)[inside] >= limit
            rows += np.bincount(second[inside], minlength=end_s.size)
            there += np.bincount(second[inside], at, minlength=end_s.size)
        return there / np.maximum(rows, 1.0)

    def tied(self, imu: ImuSource, log: LogSeconds, most: NDArray) -> bool:
        """Whether rows share the largest value that share no other: a landing may drive a sensor
        to its end in a second or two only. most (m,): largest rates of the log's seconds.
        """
        seconds = np.argsort(-most)[: TIED_ROWS + NEXT_ROWS]
        top = self._rows(imu, log, seconds[:TIED_ROWS])
        if not top.size or np.sum(top >= top.max() * (1.0 - SAME)) < TIED_ROWS:
            return False
        rates = np.sort(self._rows(imu, log, seconds))[::-1]
        below = rates[rates < rates[0] * (1.0 - SAME)][:NEXT_ROWS]
        return bool(below.size == NEXT_ROWS and np.all(-np.diff(below) > SAME * rates[0]))

    def _rows(self, imu: ImuSource, log: LogSeconds, seconds: NDArray) -> NDArray:
        """Rates of the rows of some seconds of the log."""
        spans = zip(log.start_s[seconds], log.end_s[seconds])
        pieces = [self.rates(imu.between(float(a), float(b))) for a, b in spans]
        return np.concatenate([np.zeros(0), *pieces])
