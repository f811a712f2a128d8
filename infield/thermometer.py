"""Gyro temperatures of a run, smoothed on a one-second grid, with what is wrong with them."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import savgol_filter

from ins.records import AXES, TemperatureLog

SMOOTH_S = 121
STUCK_S = 600.0  # a thermometer that repeats one reading for so long, while another moves or noise is declared
STUCK_DEG_C = 1e-9


@dataclass(frozen=True)
class GyroTemperature:
    """time_s (n,), temperature (n, 3) [degC] and its rate [degC/min]; `stuck`: axes whose thermometer never moved."""

    time_s: NDArray
    temperature_degC: NDArray
    rate_degC_min: NDArray
    stuck: tuple[str, ...]

    def at(self, time_s: NDArray) -> NDArray:
        """Temperature (k, 3) at given times; the end values are held outside the log."""
        return np.stack([np.interp(time_s, self.time_s, self.temperature_degC[:, i]) for i in range(3)], axis=1)

    def between(self, start_s: float, end_s: float) -> slice:
        """Rows inside [start, end]; at least one."""
        a, b = np.searchsorted(self.time_s, [start_s, end_s])
        a = min(int(a), len(self.time_s) - 1)
        return slice(a, max(int(b), a + 1))


def gyro_temperature(log: TemperatureLog) -> GyroTemperature:
    """Local straight lines over two minutes (Savitzky-Golay, order 1): steps of a coarse thermometer become slopes.

    An axis is stuck where its reading never changed over more than ten minutes.
    """
    t = np.arange(np.ceil(log.time_s[0]), np.floor(log.time_s[-1]) + 0.5)
    if t.size < 5:
        t = np.linspace(log.time_s[0], log.time_s[-1], 5)
    grid = np.stack([np.interp(t, log.time_s, log.gyro_degC[:, i]) for i in range(3)], axis=1)
    window = min(SMOOTH_S, (t.size - 1) // 2 * 2 + 1)
    dt = float(t[1] - t[0])
    long = log.time_s[-1] - log.time_s[0] > STUCK_S
    stuck = tuple(a for i, a in enumerate(AXES) if long and np.ptp(log.gyro_degC[:, i]) <= STUCK_DEG_C)
    return GyroTemperature(
        time_s=t,
        temperature_degC=savgol_filter(grid, window, 1, axis=0),
        rate_degC_min=60.0 * savgol_filter(grid, window, 1, deriv=1, delta=dt, axis=0),
        stuck=stuck,
    )
