"""A climatic chamber: soaks and steady ramps between two temperatures, felt by the unit through its
own lag.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ins.records import InputError
from trajectories.simulator.thermal import Temperatures, first_order_rise


@dataclass(frozen=True, kw_only=True)
class ChamberProfile:
    """`cycles` times from start_degC to end_degC and, with there_and_back, back again, a soak
    before and after each ramp.

    The unit follows the chamber with one time constant (unit_tau_s), each gyro follows the unit
    with its own; on a steady ramp every gyro therefore trails by unit_tau_s + gyro_tau_s and Tdiff
    is a fraction of what it trails the unit.

    A heater on one side, on for the first half of every side_period_s, holds side_degC across the
    unit with the time constant side_tau_s: side_gradient of it shows at each gyro's Tdiff,
    side_warming of it in the gyro's temperature.
    """

    start_degC: float = -20.0
    end_degC: float = 40.0
    rate_degC_min: float = 0.5
    soak_s: float = 1800.0
    there_and_back: bool = True
    cycles: int = 1
    unit_tau_s: float = 600.0
    gyro_tau_s: tuple[float, float, float] = (120.0, 150.0, 100.0)
    gyro_rise_degC: tuple[float, float, float] = (1.5, 2.5, 0.8)
    gradient_fraction: tuple[float, float, float] = (0.3, -0.2, 0.25)
    side_degC: float = 0.0
    side_period_s: float = 5400.0
    side_tau_s: float = 900.0
    side_gradient: tuple[float, float, float] = (0.6, -0.35, 0.5)
    side_warming: tuple[float, float, float] = (0.15, 0.1, 0.12)

    def __post_init__(self) -> None:
        taus = (self.unit_tau_s, self.side_tau_s, self.side_period_s, *self.gyro_tau_s)
        if not min(taus) > 0 or self.unit_tau_s in self.gyro_tau_s:
            raise InputError(
                "thermal: time constants must be above 0, gyro_tau_s other than unit_tau_s"
            )
        if (
            not self.rate_degC_min > 0
            or self.soak_s < 0
            or self.cycles < 1
            or self.start_degC == self.end_degC
        ):
            raise InputError(
                "thermal: chamber: needed rate_degC_min above 0, soak_s not below 0, cycles of at"
                " least 1, two temperatures"
            )

    @property
    def duration_s(self) -> float:
        """Until the last soak ends."""
        return float(self._corners()[0][-1])

    def at(self, time_s: ArrayLike) -> Temperatures:
        """Temperatures at times (n,) since power-on; the last chamber temperature is held."""
        t = np.asarray(time_s, dtype=float)
        corner_s, chamber_degC = self._corners()
        slope = np.diff(chamber_degC) / np.diff(corner_s)
        change = np.diff(slope, prepend=0.0, append=0.0)
        chamber, unit = np.interp(t, corner_s, chamber_degC), np.full(t.shape, self.start_degC)
        gyro = np.repeat(unit[:, None], 3, axis=1) + np.asarray(self.gyro_rise_degC)
        for at_s, bend in zip(corner_s, change):
            since = np.maximum(t - at_s, 0.0)
            unit = unit + bend * _trail(since, self.unit_tau_s)
            for k, tau in enumerate(self.gyro_tau_s):
                a, b = self.unit_tau_s, tau
                gyro[:, k] += bend * (a * _trail(since, a) - b * _trail(since, b)) / (a - b)
        gradient = np.asarray(self.gradient_fraction) * (
            unit[:, None] + np.asarray(self.gyro_rise_degC) - gyro
        )
        side = self._side(t)[:, None]
        gradient, gyro = (
            gradient + side * np.asarray(self.side_gradient),
            gyro + side * np.asarray(self.side_warming),
        )
        return Temperatures(
            gyro_degC=gyro,
            accel_degC=np.repeat(gyro.mean(axis=1)[:, None], 3, axis=1),
            gradient_degC=gradient,
            block_degC=unit,
            ambient_degC=chamber,
        )

    def _side(self, t: NDArray) -> NDArray:
        """Temperature difference that the heater makes across the unit (n,)."""
        out = np.zeros(t.shape)
        if self.side_degC:
            for k in range(int(2 * t.max() / self.side_period_s) + 1):
                out += (
                    (-1.0) ** k
                    * self.side_degC
                    * first_order_rise(t - 0.5 * k * self.side_period_s, self.side_tau_s)
                )
        return out

    def _corners(self) -> tuple[NDArray, NDArray]:
        """Times [s] and chamber temperatures at which a soak or a ramp begins or ends."""
        ramp_s = 60.0 * abs(self.end_degC - self.start_degC) / self.rate_degC_min
        time, value = [0.0, max(self.soak_s, 1.0)], [self.start_degC, self.start_degC]
        way = [self.end_degC, self.start_degC] if self.there_and_back else [self.end_degC]
        for target in way * self.cycles:
            jump_s = ramp_s if value[-1] != target else 1.0
            time += [time[-1] + jump_s, time[-1] + jump_s + max(self.soak_s, 1.0)]
            value += [target, target]
        return np.array(time), np.array(value)


def _trail(since_s: NDArray, tau_s: float) -> NDArray:
    """Response of a first-order lag to a ramp of slope 1 that began so long ago."""
    return since_s + tau_s * np.expm1(-since_s / tau_s)
