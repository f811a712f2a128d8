"""What differs from one power-on to the next: the spread of constant biases over several runs."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq, minimize_scalar

from ins.earth import EARTH_RATE_RAD_S, gravity_magnitude
from ins.robust import chi2
from simreal.twin.fit.streams import ParkedStream

CONSTANT_OVER_S = 900.0  # of rest: the constant of a run is taken here, before it drifts
# how far a variance may lie from what was believed, in its sigmas: 2e-9 of it is beyond
REACH_SIGMAS, REACH_POINTS = 6.0, 241


@dataclass(frozen=True, eq=False)
class RunToRunVariance:
    """A variance between runs: its maximum of likelihood, 95 % limits, and degrees of freedom.

    cost: minus twice the log-likelihood of the logarithm of a variance.
    """

    variance: float
    low: float
    high: float
    freedom: float
    cost: Callable[[float], float]

    def weighed(self, believed: float, sigma: float) -> float:
        """The variance by its mean logarithm, where it was believed with this sigma of the
        logarithm. A maximum at zero bounds the variance from above and says no more.
        """
        off = np.linspace(-REACH_SIGMAS, REACH_SIGMAS, REACH_POINTS)
        logs = np.log(believed) + sigma * off
        nats = -0.5 * (np.array([self.cost(value) for value in logs]) + off**2)
        weight = np.exp(nats - nats.max())
        return float(np.exp(np.sum(weight * logs) / np.sum(weight)))


def gyro_constants(stream: ParkedStream, *, finds_north: bool) -> NDArray:
    """Constant gyro biases of a run (k,) [rad/s], as far as nobody needs to know its heading.

    A unit that finds north: about the vertical, and along the level Earth rate that it finds (its
    heading took the rest). Another one: all three axes, less the vertical Earth rate.
    """
    rate = _first_mean(stream)[:3]
    up = stream.up_b
    lat = stream.run.header.site.lat_rad
    down_rate = float(-up @ rate)
    vertical = down_rate + EARTH_RATE_RAD_S * np.sin(lat)
    level = rate - (up @ rate) * up
    if finds_north:
        return np.array([vertical, np.linalg.norm(level) - EARTH_RATE_RAD_S * np.cos(lat)])
    return np.asarray(level - vertical * up)


def accel_constants(stream: ParkedStream) -> NDArray:
    """The constant accelerometer bias along gravity of a run (1,) [m/s^2]; level hides the rest."""
    site = stream.run.header.site
    force = _first_mean(stream)[3:]
    return np.array([np.linalg.norm(force) - gravity_magnitude(site.lat_rad, site.height_m)])


def _first_mean(stream: ParkedStream) -> NDArray:
    seconds = np.flatnonzero(stream.still)[: int(CONSTANT_OVER_S)]
    return np.asarray(stream.seconds.mean[seconds].mean(axis=0))


def spread_between(values: Sequence[NDArray], noise: NDArray) -> RunToRunVariance | None:
    """Variance (one number for all columns) of values (k,) of each run about their means over runs,
    beyond the noise (k,) [variance] that each has; None with one run.
    """
    rows = np.stack(list(values))
    runs, columns = rows.shape
    if runs < 2:
        return None
    off = rows - rows.mean(axis=0)
    square = np.sum(off**2, axis=0)
    freedom = runs - 1

    def cost(log_variance: float) -> float:
        total = np.exp(log_variance) + noise
        return float(np.sum(freedom * np.log(total) + square / total))

    rough = float(np.mean(square) / freedom)
    if rough <= 0:
        return None
    bounds = (np.log(rough) - 20.0, np.log(rough) + 8.0)
    best = minimize_scalar(cost, bounds=bounds, method="bounded")
    drop = float(chi2.ppf(0.95, 1))

    def beyond(log_variance: float) -> float:
        return cost(log_variance) - best.fun - drop

    low = 0.0
    if beyond(bounds[0]) > 0:
        low = float(np.exp(brentq(beyond, bounds[0], best.x)))
    high = np.inf
    if beyond(bounds[1]) > 0:
        high = float(np.exp(brentq(beyond, best.x, bounds[1])))
    return RunToRunVariance(float(np.exp(best.x)), low, high, float(freedom * columns), cost)
