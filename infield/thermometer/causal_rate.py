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

TAU_S = 60.0


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
