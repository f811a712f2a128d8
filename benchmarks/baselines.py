"""What people use today in place of a Bayesian merge: five rules that turn session points into a
table.

All rules get the same points and the same factory table; each is told only what it uses. Every rule
but the cubic works on departures from the factory table, so that the thermal curve between two
nodes costs it nothing.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from infield.table.thermal_table import ThermalTable
from ins.records import AXES

CUBIC = 3


@dataclass(frozen=True, kw_only=True)
class Points:
    """Bias points of one session in the order of time, each (m,): axis 0, 1, 2; bias above the
    truth; its own sigma.
    """

    axis_index: NDArray
    temperature_degC: NDArray
    bias_deg_h: NDArray
    sigma_deg_h: NDArray

    def of(self, axis: int) -> tuple[NDArray, NDArray, NDArray]:
        """Temperature, bias and sigma of one axis."""
        rows = self.axis_index == axis
        return self.temperature_degC[rows], self.bias_deg_h[rows], self.sigma_deg_h[rows]


class DoNothing:
    """The factory table as it is; held constant beyond its ends."""

    def __init__(self, factory: ThermalTable) -> None:
        self.factory = factory

    def update(self, points: Points) -> None:
        """Nothing is learnt."""

    def bias_deg_h(self, axis: int, temperature_degC: NDArray) -> NDArray:
        """Bias at each temperature, shape (k,) [deg/h]."""
        return self.factory.bias_deg_h(axis, temperature_degC)


class SessionMean(DoNothing):
    """Kind: autopilot learning in use, one number an axis, replaced by each session.

    The number is the plain mean of the session's departures from the factory table.
    """

    def __init__(self, factory: ThermalTable) -> None:
        super().__init__(factory)
        self.offset_deg_h = np.zeros(len(AXES))

    def update(self, points: Points) -> None:
        """The new offset of every axis that has points."""
        for axis in range(len(AXES)):
            T, bias, _ = points.of(axis)
            if T.size:
                self.offset_deg_h[axis] = np.mean(bias - self.factory.bias_deg_h(axis, T))

    def bias_deg_h(self, axis: int, temperature_degC: NDArray) -> NDArray:
        """Factory table and offset."""
        return super().bias_deg_h(axis, temperature_degC) + self.offset_deg_h[axis]


class GlobalCubic(DoNothing):
    """Kind: autopilot thermal calibration, one cubic an axis through the session's points,
    unweighted.

    It replaces what was there; outside the session's temperatures the end value is held, silently.
    """

    def __init__(self, factory: ThermalTable) -> None:
        super().__init__(factory)
        self.fits: dict[int, tuple[np.polynomial.Polynomial, float, float]] = {}

    def update(self, points: Points) -> None:
        """A new cubic for every axis that has points (a lower degree where these are fewer than
        four).
        """
        for axis in range(len(AXES)):
            T, bias, _ = points.of(axis)
            if T.size:
                degree = min(CUBIC, T.size - 1)
                self.fits[axis] = (
                    np.polynomial.Polynomial.fit(T, bias, degree),
                    float(T.min()),
                    float(T.max()),
                )

    def bias_deg_h(self, axis: int, temperature_degC: NDArray) -> NDArray:
        """The cubic, clamped; the factory table before the first session."""
        if axis not in self.fits:
            return super().bias_deg_h(axis, temperature_degC)
        cubic, low, high = self.fits[axis]
        return cubic(np.clip(temperature_degC, low, high))


class NewestPerBin(DoNothing):
    """Kind: phone sensor hub, temperature bins that keep their newest point.

    The bins are centred on the nodes of the factory table; straight lines in between.
    """

    def __init__(self, factory: ThermalTable) -> None:
        super().__init__(factory)
        self.departure_deg_h = [np.zeros(nodes.size) for nodes in factory.temperature_degC]

    def update(self, points: Points) -> None:
        """Each point in turn replaces what its bin held."""
        for axis, nodes in enumerate(self.factory.temperature_degC):
            T, bias, _ = points.of(axis)
            for t, departure in zip(T, bias - self.factory.bias_deg_h(axis, T)):
                self.departure_deg_h[axis][np.argmin(np.abs(nodes - t))] = departure

    def bias_deg_h(self, axis: int, temperature_degC: NDArray) -> NDArray:
        """Factory table and the bins' departures."""
        nodes = self.factory.temperature_degC[axis]
        return super().bias_deg_h(axis, temperature_degC) + np.interp(
            temperature_degC, nodes, self.departure_deg_h[axis]
        )


class IndependentVariance(DoNothing):
    """Kind: cells weighted by inverse variance, every point as if its errors were its own; no
    covariance kept.

    A point between two nodes gives each the share of its information that its distance says (hat
    weights); the nodes start with the variance of the factory table.
    """

    def __init__(self, factory: ThermalTable) -> None:
        super().__init__(factory)
        variance = np.diag(factory.covariance)
        self.information = [1.0 / variance[factory.values_of(axis)] for axis in AXES]
        self.weighted = [np.zeros(nodes.size) for nodes in factory.temperature_degC]

    def update(self, points: Points) -> None:
        """Sums of weights and of weighted departures, node by node."""
        for axis in range(len(AXES)):
            T, bias, sigma = points.of(axis)
            share = (
                self.factory.basis(axis, T)[:, self.factory.values_of(axis)] / sigma[:, None] ** 2
            )
            self.information[axis] = self.information[axis] + share.sum(axis=0)
            self.weighted[axis] = self.weighted[axis] + share.T @ (
                bias - self.factory.bias_deg_h(axis, T)
            )

    def bias_deg_h(self, axis: int, temperature_degC: NDArray) -> NDArray:
        """Factory table and the nodes' weighted mean departures."""
        nodes = self.factory.temperature_degC[axis]
        mean = self.weighted[axis] / self.information[axis]
        return super().bias_deg_h(axis, temperature_degC) + np.interp(temperature_degC, nodes, mean)

    def sigma_deg_h(self, axis: int, temperature_degC: NDArray) -> NDArray:
        """What this rule believes of itself: sigma of the nodes, straight lines in between."""
        return np.interp(
            temperature_degC, self.factory.temperature_degC[axis], self.information[axis] ** -0.5
        )


BASELINES: dict[str, type[DoNothing]] = {
    "do nothing": DoNothing,
    "overwrite with the session mean": SessionMean,
    "global cubic": GlobalCubic,
    "newest per bin": NewestPerBin,
    "independent-variance merge": IndependentVariance,
}
