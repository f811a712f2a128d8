"""Excursions of the computed velocity from what it does at rest: a shake, a tug's push, or a taxi.

A parked inertial solution drifts slowly (Schuler), so rest is judged against a baseline that
follows the computed velocity while the vehicle stands.
"""

from math import hypot

import numpy as np
from numpy.typing import NDArray

from alignment.motion.disturbed_epochs import EXCESS_MOTION_M_S, SMALLEST_GATE_M_S
from alignment.motion.kinds import DISTURBED, ROLLING, STILL, Disturbance
from ins.robust import white_sigma

GUARD_S = 30.0  # after excess motion the alignment restarts 30 s later
# an event begins before it passes the limit, and falls below it before it ends
LEAD_S, TAIL_S = 5.0, 5.0
# net way after which an excursion is a movement, not a shake: people and gusts sway a vehicle by
# centimetres, a moored ship surges by 1 m; at twice of it tests/alignment/test_stillness.py fails
ROLLED_M = 2.0
# net way after which the parked heading is a new one: people and gusts sway a vehicle by
# centimetres, the shortest push of docs/reliability.md is 0.5 m (at twice of it
# tests/alignment/test_stillness.py fails)
PUSHED_M = 0.3
# a tug's push; what is farther, faster or longer is a taxi: pushes of docs/reliability.md go 0.5
# to 10 m at 0.1 to 0.7 m/s; at half of way and speed, and at twice the way,
# tests/alignment/test_stillness.py fails
PUSH_M, PUSH_SPEED_M_S, PUSH_S = 15.0, 1.0, 90.0
# epochs of rest before the line through them may have a slope (0.02 of an epoch's noise a second,
# sqrt(12 / 30^3)), and of the line: over 90 s Schuler motion bends by 0.2 % of its size
FRESH, LONGEST_LINE = 30, 90
FIRST_EPOCHS = 20  # of a solution, whose mean is its first baseline
# more within them than the end of a braking that a first rest may hold: on either axis
# REST_FORCE_M_S2 over its first block (alignment.motion.inertial)
LEAVES_M_S = 2.0**0.5 * 0.3
# two periods of rocking at 0.28 Hz, 7.1 s; at 16 tests/alignment/test_stillness.py fails
STOP_WINDOW_S = 8
# slower is drift, no start: twice an accelerometer's bias of 0.25 mg, turned with the body
DRIFT_M_S2 = 5e-3
DRIFT_EPOCHS = 10  # over which a slope is seen
# gates off that line: one epoch beyond the gate at the end of quiet ones is 0.65 of it off theirs
DRIFT_OFF = 0.5
# baseline uncertainty after rolling: 0.25 mg of an accelerometer, turned with the body, in 100 s
STOP_SPEED_M_S = 0.25
STOP_DRIFT_M_S2 = 5e-4


def velocity_noise(v: NDArray) -> float:
    return white_sigma(v) + 1e-6


class _Baseline:
    """Straight line through the velocity of the last still epochs, refitted every fifth. In floats:
    numpy's calls on two numbers would take most of the time.
    """

    def __init__(self, t: NDArray, v: NDArray) -> None:
        self._t, self._v = t, v
        self._time, self._north, self._east = t.tolist(), v[:, 0].tolist(), v[:, 1].tolist()
        self._first = self._end = 0  # the still epochs that count
        self._misses: list[float] = []
        self._mean, self._slope, self._centre = (0.0, 0.0), (0.0, 0.0), 0.0
        # eight times the median miss of the line's own predictions, kept over restarts
        self.gate = 0.0
        self._drifting = False  # a slope is known though the still epochs are few

    @property
    def fresh(self) -> bool:
        return self._end - self._first < FRESH

    def miss(self, k: int) -> float:
        """Distance of epoch k's velocity from the line [m/s]."""
        s = self._time[k] - self._centre
        (north, east), (slope_n, slope_e) = self._mean, self._slope
        return hypot(self._north[k] - north - slope_n * s, self._east[k] - east - slope_e * s)

    def add(self, k: int, miss: float) -> None:
        """Count epoch k, the one after the last."""
        if not self.fresh:
            self._misses.append(miss)
            if len(self._misses) % 30 == 0 and len(self._misses) >= 60:
                self.gate = 8.0 * float(np.median(self._misses[-300:]))
        self._end = k + 1
        self._first = max(self._first, self._end - LONGEST_LINE)
        count = self._end - self._first
        if k % 5 == 0 or count < 10 or count == FRESH:
            self._fit(self._v[self._first : self._end])

    def restart(self, k: int, v: NDArray) -> None:
        """Begin anew at epoch k with v (m, 2) as what rest looks like."""
        self._first, self._end, self._drifting = k, k + 1, False
        self._fit(v)

    def drifts(self, k: int, most_off: float) -> bool:
        """Whether the still velocity ran off along a line too gentle for a vehicle that leaves; it
        is the baseline then.
        """
        first = k + 1 - DRIFT_EPOCHS
        if first < self._first:
            return False
        T, v = self._t[first : k + 1], self._v[first : k + 1]
        s = T - T.mean()
        slope = s @ v / (s @ s)
        off = v - v.mean(axis=0) - s[:, None] * slope
        if hypot(*slope) > DRIFT_M_S2 or np.abs(off).max() > most_off:
            return False
        self._first, self._end, self._drifting = first, k + 1, True
        self._fit(v)
        return True

    def _fit(self, v: NDArray) -> None:
        T = self._t[self._first : self._end]
        # the means of numpy without the half of their time that checks what is asked
        self._centre = float(np.add.reduce(T) / T.size)
        self._mean = tuple((np.add.reduce(v, axis=0) / len(v)).tolist())
        self._slope = (0.0, 0.0)
        if self._drifting or not self.fresh:
            s = T - self._centre
            self._slope = tuple((s @ v / (s @ s)).tolist())

    def at(self, t: NDArray) -> NDArray:
        return np.array(self._mean) + np.array(self._slope) * (t[:, None] - self._centre)


def find_excursions(t: NDArray, v: NDArray, sigma: float) -> tuple[NDArray, NDArray, list[int]]:
    """Sequential classification of the epochs into still, disturbed, rolling; cause; ends of
    pushes.
    """
    kind, cause, pushed = np.full(len(t), STILL), np.full(len(t), "", dtype=object), []
    gate = max(min(8.0 * sigma, EXCESS_MOTION_M_S), 5.0 * sigma, SMALLEST_GATE_M_S)
    base = _Baseline(t, v)
    first = v[:FIRST_EPOCHS]
    # a solution begins at rest; of one whose vehicle leaves at once only the first epoch is
    leaves = np.linalg.norm(np.ptp(first, axis=0)) > LEAVES_M_S
    base.restart(0, first[:1] if leaves else first)
    k, guard_until, name = 0, -np.inf, ""
    while k < len(t):
        limit = max(gate, base.gate) + (0.03 if base.fresh else 0.0)
        miss = base.miss(k)
        if miss <= limit:
            if t[k] < guard_until:
                kind[k], cause[k] = DISTURBED, name
            base.add(k, miss)
            k += 1
            continue
        if base.drifts(k, DRIFT_OFF * gate):
            if t[k] < guard_until:
                kind[k], cause[k] = DISTURBED, name
            k += 1
            continue
        end, way, rolled = _excursion(t, v, k, base, limit, sigma)
        if way > PUSHED_M and not rolled:
            pushed.append(min(end, len(t) - 1))
        name = Disturbance.PUSH if pushed and pushed[-1] == end else "motion"
        kind[max(k - 2, 0) : end] = ROLLING if rolled else DISTURBED
        cause[max(k - 2, 0) : end] = "" if rolled else name
        if not rolled:
            begun = slice(max(k - round(LEAD_S), 0), k)
            cause[begun] = np.where(kind[begun] == STILL, name, cause[begun])
            kind[begun] = np.maximum(kind[begun], DISTURBED)
        if end < len(t):
            base.restart(end, v[end : end + STOP_WINDOW_S])
        guard_until = t[min(end, len(t) - 1)] + (2.0 if rolled else GUARD_S + TAIL_S)
        k = end
    return kind, cause, pushed


def _excursion(
    t: NDArray, v: NDArray, k: int, base: _Baseline, gate: float, sigma: float
) -> tuple[int, float, bool]:
    """End of the excursion that begins at epoch k, its net way [m], and whether it is a taxi (not a
    shake or a push).
    """
    rest = base.at(t[k:])
    deviation = v[k:] - rest
    way = np.linalg.norm(np.cumsum(deviation * np.gradient(t)[k:, None], axis=0), axis=1)
    fastest = np.maximum.accumulate(np.linalg.norm(deviation, axis=1))
    last = len(deviation) - 1
    for j in range(1, last + 1):
        elapsed = t[k + j] - t[k]
        window = v[k + j : k + j + STOP_WINDOW_S]
        if len(window) < STOP_WINDOW_S:
            break
        slow = elapsed <= PUSH_S and fastest[j] <= PUSH_SPEED_M_S
        near = (gate if slow else STOP_SPEED_M_S) + STOP_DRIFT_M_S2 * elapsed
        if way[j] <= ROLLED_M and elapsed <= PUSH_S:
            near = gate
        level = np.linalg.norm(window.mean(axis=0) - rest[j]) <= near
        if level and np.ptp(window, axis=0).max() <= max(8.0 * sigma, 0.03):
            shaken = way[j] <= ROLLED_M and elapsed <= PUSH_S
            return k + j, float(way[j]), not (shaken or (slow and way[j] <= PUSH_M))
    short = t[-1] - t[k] <= PUSH_S and way[last] <= ROLLED_M
    return len(t), float(way[last]), not short
