"""A temperature model of a unit, whatever it was fitted with: what each gyro has at a temperature,
and what rates and gradients add.

A thermal table and an autopilot's cubics hold the first part alone, that of a settled unit; a FOG's
curves and a ring laser's terms hold both.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ins.records import AXES


class GyroCurves(Protocol):
    """One gyro: temperatures and rates (n,) [degC, degC/min], gradient lines (n, 3) [degC] in, bias
    (n,) [deg/h] out. Beyond the fitted temperatures the end values are held.
    """

    @property
    def range_degC(self) -> tuple[float, float]:
        """Temperatures that the curves were fitted to."""
        ...

    def settled_deg_h(self, T: NDArray) -> NDArray: ...

    def rates_deg_h(self, T: NDArray, rate_degC_min: NDArray, gradient_degC: NDArray) -> NDArray:
        """What rates and gradients add."""
        ...

    def rates_sigma_deg_h(
        self, T: NDArray, rate_degC_min: NDArray, gradient_degC: NDArray
    ) -> NDArray:
        """What is not known of `rates_deg_h`, 1 sigma."""
        ...


@dataclass(frozen=True)
class SettledCurve:
    """One gyro whose bias follows its temperature alone: rates and gradients add nothing."""

    range_degC: tuple[float, float]
    value_deg_h: Callable[[NDArray], NDArray]

    def settled_deg_h(self, T: NDArray) -> NDArray:
        return self.value_deg_h(T)

    def rates_deg_h(self, T: NDArray, rate_degC_min: NDArray, gradient_degC: NDArray) -> NDArray:
        """None."""
        return np.zeros(np.shape(T))

    def rates_sigma_deg_h(
        self, T: NDArray, rate_degC_min: NDArray, gradient_degC: NDArray
    ) -> NDArray:
        """None."""
        return np.zeros(np.shape(T))


class TemperatureModel(ABC):
    """The gyros of a unit: temperatures, rates and lines (n, 3) in, bias (n, 3) [deg/h] out; 0 for
    a gyro without a model, which is left as it is.
    """

    @property
    @abstractmethod
    def curves(self) -> Mapping[str, GyroCurves]:
        """Of each gyro with a model."""

    @property
    def axes(self) -> tuple[str, ...]:
        return tuple(self.curves)

    @property
    def lines(self) -> tuple[str, ...]:
        """Gradient lines that the model needs."""
        return ()

    @property
    def lags_s(self) -> NDArray:
        """By how much (3, 2) [s] each gyro's thermometer, and the lines for it, read late."""
        return np.zeros((len(AXES), 2))

    def settled_deg_h(self, temperature_degC: NDArray) -> NDArray:
        """Of a unit whose temperature stands."""
        return self._by_gyro(lambda c, k: c.settled_deg_h(temperature_degC[:, k]), temperature_degC)

    def rates_deg_h(
        self, temperature_degC: NDArray, rate_degC_min: NDArray, gradient_degC: NDArray
    ) -> NDArray:
        """What rates and gradients add."""

        def value(c: GyroCurves, k: int) -> NDArray:
            return c.rates_deg_h(temperature_degC[:, k], rate_degC_min[:, k], gradient_degC)

        return self._by_gyro(value, temperature_degC)

    def rates_sigma_deg_h(
        self, temperature_degC: NDArray, rate_degC_min: NDArray, gradient_degC: NDArray
    ) -> NDArray:
        """What is not known of `rates_deg_h`, 1 sigma."""

        def value(c: GyroCurves, k: int) -> NDArray:
            return c.rates_sigma_deg_h(temperature_degC[:, k], rate_degC_min[:, k], gradient_degC)

        return self._by_gyro(value, temperature_degC)

    def inside(self, temperature_degC: NDArray) -> NDArray:
        """Where (n, 3) the temperatures are within what a gyro's model was fitted to."""
        ok = np.zeros(np.shape(temperature_degC), dtype=bool)
        for axis, curves in self.curves.items():
            k = AXES.index(axis)
            low, high = curves.range_degC
            ok[:, k] = (low <= temperature_degC[:, k]) & (temperature_degC[:, k] <= high)
        return ok

    def _by_gyro(self, value: Callable[[GyroCurves, int], NDArray], like: NDArray) -> NDArray:
        out = np.zeros(np.shape(like))
        for axis, curves in self.curves.items():
            k = AXES.index(axis)
            out[:, k] = value(curves, k)
        return out
