"""dT/dt in real time: temperature and its rate from past readings only, by a fading-memory straight
line.

Steady gains a = 1 - w^2, b = (1 - w)^2 with w = exp(-dt / tau): critically damped, no error on a
steady ramp, late by 2 tau when the rate changes. White noise s of readings dt apart becomes s
sqrt(2 ((1 - w) / (1 + w))^3) / dt of the rate. Source: Morrison (1969), Introduction to Sequential
Smoothing and Prediction, chapter 13.
"""

from math import exp, isfinite

import numpy as np
from numpy.typing import NDArray

TAU_S = 60.0  # where readings step: as long as it takes a ramp of 0.1 degC/min to the next step
SHORTEST_TAU_S = 10.0  # ten readings of an ordinary logger (1 Hz)
# noise of a rate [degC/min] that a shorter time constant may leave: with 0.3 deg/h per degC/min of
# a fibre coil 0.0015 deg/h, a tenth of a minute's white noise (0.0155 deg/h, physics.md 6.3)
QUIET_RATE_degC_min = 0.005
FEWEST_JUDGED = 60  # readings: a noise of 60 is known to 10 %
JUDGED_S = (
    300.0  # of a log as it begins, by which the time constant is chosen; chosen: 300 readings
)
# of readings that differ from the one before; with fewer the thermometer shows stairs: 1/2
STAIRS = 0.5


class CausalRate:
    """Feed one reading of one thermometer after the other; gives temperature [degC] and rate
    [degC/min]; NaN is passed over.
    """

    def __init__(self, tau_s: float = TAU_S) -> None:
        if not tau_s > 0:
            raise ValueError(f"tau_s = {tau_s}, needed more than 0")
        self._tau_s, self._time_s, self._count = tau_s, 0.0, 0
        self._value, self._rate = float("nan"), 0.0

    def feed(self, time_s: float, reading_degC: float) -> tuple[float, float]:
        """The filtered temperature and rate at this reading; the gains start wide, so that no guess
        lingers.
        """
        if not isfinite(reading_degC):
            ahead = self._rate * (time_s - self._time_s) if self._count else 0.0
            return self._value + ahead, 60.0 * self._rate
        if self._count == 0:
            self._value, self._time_s, self._count = reading_degC, time_s, 1
            return self._value, 0.0
        dt, n = time_s - self._time_s, self._count
        if dt <= 0:
            raise ValueError(f"time_s = {time_s}, needed later than {self._time_s}")
        w = exp(-dt / self._tau_s)
        # gains of a line through n + 1 readings
        first = (2.0 * (2 * n + 1) / ((n + 1) * (n + 2)), 6.0 / ((n + 1) * (n + 2)))
        a, b = max(1.0 - w * w, first[0]), max((1.0 - w) ** 2, first[1])
        error = reading_degC - (self._value + self._rate * dt)
        self._value += self._rate * dt + a * error
        self._rate += b * error / dt
        self._time_s, self._count = time_s, n + 1
        return self._value, 60.0 * self._rate


def time_constant_s(time_s: NDArray, reading_degC: NDArray) -> float:
    """The shortest time constant whose rates are quiet, for readings (n, m) as they begin: the
    filter is late by twice it, and a chamber that ripples asks for little.
    """
    begun = time_s <= time_s[0] + JUDGED_S
    t, values = time_s[begun], reading_degC[begun]
    if len(t) < FEWEST_JUDGED:
        return TAU_S
    dt = float(np.median(np.diff(t)))
    change = np.diff(values, axis=0)
    known = np.isfinite(change)
    if np.mean(change[known] != 0.0) < STAIRS:
        return TAU_S
    second = np.diff(change, axis=0)
    second = second[np.isfinite(second)]
    if not second.size:
        return TAU_S
    # second differences of white noise s have 6 s^2
    noise = float(np.sqrt(np.mean(second**2) / 6.0))
    quiet = 0.5 * dt * (60.0 * np.sqrt(2.0) * noise / (dt * QUIET_RATE_degC_min)) ** (2.0 / 3.0)
    return float(np.clip(quiet, SHORTEST_TAU_S, TAU_S))


def causal_rates(
    time_s: NDArray, reading_degC: NDArray, tau_s: float = TAU_S
) -> tuple[NDArray, NDArray]:
    """Temperature and rate (n, m) after each row of readings (n, m), each column by itself, from
    rows up to it alone.
    """
    filters = [CausalRate(tau_s) for _ in range(reading_degC.shape[1])]
    found = np.array(
        [
            [f.feed(t, value) for f, value in zip(filters, row)]
            for t, row in zip(time_s.tolist(), reading_degC.tolist())
        ]
    )
    return found[..., 0], found[..., 1]
