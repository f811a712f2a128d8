"""What differs from one power-on to the next: the spread of constant biases over several runs."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq, minimize_scalar

from ins.earth import EARTH_RATE_RAD_S, gravity_magnitude
from ins.robust import chi2
from simreal.twin.fit.streams import ParkedStream

# shorter places are left out; chosen: with 0.05 deg/sqrt(h) they know the level rate to 1 deg/h
PLACE_S = 10
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
    lat = stream.run.header.site.lat_rad
    places, found = _first_means(stream), []
    for mean in places.mean:
        rate, up = mean[:3], _up(mean)
        vertical = EARTH_RATE_RAD_S * np.sin(lat) - float(up @ rate)
        level = rate - (up @ rate) * up
        if finds_north:
            north = np.linalg.norm(level) - EARTH_RATE_RAD_S * np.cos(lat)
            found.append(np.array([vertical, north]))
        else:
            found.append(level - vertical * up)
    return np.asarray(np.average(found, axis=0, weights=places.seconds))


def accel_constants(stream: ParkedStream) -> NDArray:
    """The constant accelerometer bias along gravity of a run (1,) [m/s^2]; level hides the rest."""
    site, places = stream.run.header.site, _first_means(stream)
    force = np.average(np.linalg.norm(places.mean[:, 3:], axis=1), weights=places.seconds)
    return np.array([force - gravity_magnitude(site.lat_rad, site.height_m)])


class _Places(NamedTuple):
    """Means (k, 6) of gyros and accelerometers on each place of the vehicle, and seconds there."""

    mean: NDArray
    seconds: NDArray


def _first_means(stream: ParkedStream) -> _Places:
    """Over the first seconds at rest. Each place has a heading and a tilt of its own: a mean over
    two headings is no rate of the Earth (0.85 deg/h were missing after a turn by 90 deg).
    """
    seconds = np.flatnonzero(stream.still)[: int(CONSTANT_OVER_S)]
    of_place = stream.place[seconds]
    places, count = np.unique(of_place, return_counts=True)
    long = count >= min(PLACE_S, int(count.max()))
    places, count = places[long], count[long]
    means = [stream.seconds.mean[seconds[of_place == place]].mean(axis=0) for place in places]
    return _Places(np.stack(means), count)


def _up(mean: NDArray) -> NDArray:
    """The vertical in body axes, as the specific force shows it."""
    return np.asarray(mean[3:] / np.linalg.norm(mean[3:]))


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
