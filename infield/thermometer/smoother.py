"""The temperature behind rounded and noisy readings: a smoothing spline whose data are intervals,
not values.

A reading y of a thermometer with step r says y - r/2 < T + n < y + r/2, n ~ N(0, s^2): likelihood
Phi((y + r/2 - T)/s) - Phi((y - r/2 - T)/s) (Gaussian in T for r = 0). T is an integrated random
walk of the rate with density q, on nodes NODE_S apart, straight in between. The mode is found by
Newton's method on pentadiagonal equations (the problem is log-concave); q and s are where Laplace's
evidence is largest. A moving average of the readings instead follows the staircase: its rate is 0
on a step and r over the window at an edge. Source: Rauch, Tung, Striebel (1965) for the Gaussian
case, whose smoother this equals; Rasmussen and Williams (2006), sections 3.4 and 3.7.1 for mode and
evidence.

Decision: docs/decisions/0017-heating-cooling.md.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_solve_banded, cholesky_banded, solveh_banded
from scipy.special import ndtr

from ins.estimation.choice import Level, climb, with_sizes
from ins.robust import white_sigma
from ins.thermometer_faults import COARSE_degC

NODE_S = 5.0  # a rate that changes by 1 degC/min within a minute bends 0.9 mdegC off a line over it
# q [(degC/s)^2 / s]: a settled unit to a heated chip
DENSITIES = tuple(10.0**k for k in range(-11, -3))
FIRST_DENSITY = 3  # index above: 1e-8, a cold start
# of a coarse thermometer (COARSE_degC and more) only the first so many: faster motion cannot be
# told from its steps
COARSE_DENSITIES = 5
# s / r that are tried; above, a step is no more seen
NOISE_STEPS = (0.02, 0.035, 0.06, 0.1, 0.18, 0.32, 0.56, 1.0)
LEAST_NOISE_degC = 1e-3  # a tenth of the default thermometer's noise (formats.md section 3)
NEWTON_STEPS = 30
# least likelihood of an interval that is still computed as one: beyond 7 sigma (1.3e-12), whose
# square is 49
FAINT = 1e-12


@dataclass(frozen=True)
class SmoothTemperature:
    """value (n,) at the nodes [degC]; factor: banded Cholesky factor (upper, 3 rows) of its
    posterior precision; level_degC: sigma of what all of it may be off by; log_evidence: Laplace's,
    up to a constant.
    """

    value_degC: NDArray
    factor: NDArray
    noise_degC: float
    density: float
    level_degC: float = 0.0
    log_evidence: float = 0.0

    def covariance(self, rows: NDArray) -> NDArray:
        """Covariance (N, N) of linear functions rows (N, n) of the node values."""
        P = rows @ cho_solve_banded((self.factor, False), np.ascontiguousarray(rows.T))
        of_level = self.level_degC * rows.sum(axis=1)
        return 0.5 * (P + P.T) + np.outer(of_level, of_level)


def nodes_of(time_s: NDArray) -> NDArray:
    """Nodes from the first to the last reading or beyond it, at least three."""
    span = float(time_s[-1] - time_s[0])
    if span < 2 * NODE_S:
        return time_s[0] + np.linspace(0.0, max(span, 1.0), 3)
    return time_s[0] + NODE_S * np.arange(int(np.ceil(span / NODE_S - 1e-9)) + 1)


def smooth_readings(
    nodes_s: NDArray, time_s: NDArray, reading_degC: NDArray, step_degC: float
) -> SmoothTemperature:
    """Smooth readings (m,) taken within the nodes (n,); step_degC 0 where they are not rounded to a
    visible step.
    """
    if _noise_degC(reading_degC) > step_degC:
        step_degC = 0.0
    data = _Readings(nodes_s, time_s, reading_degC, step_degC)
    noises = _noises(reading_degC, step_degC)
    densities = DENSITIES[:COARSE_DENSITIES] if step_degC >= COARSE_degC else DENSITIES
    x = np.interp(nodes_s, time_s, reading_degC)
    noise = Level("noise_degC", noises, noises[len(noises) // 2])
    density = Level("density", densities, densities[FIRST_DENSITY])

    best = data.fit(SmoothTemperature(x, np.empty(0), noise.start, density.start))
    for level in (noise, density):
        best, _ = climb(
            best,
            [level],
            lambda sizes, at: data.fit(with_sizes(at, sizes)),
            lambda one, other: one.log_evidence - other.log_evidence,
        )
    return best


def _noises(reading: NDArray, step: float) -> list[float]:
    """Candidates for s, rising: from the readings' second differences where they have no step."""
    return [k * step for k in NOISE_STEPS] if step > 0.0 else [_noise_degC(reading)]


def _noise_degC(reading: NDArray) -> float:
    """White noise of readings without a visible step, from the median of their second
    differences.
    """
    if reading.size < 4:
        return LEAST_NOISE_degC
    return max(white_sigma(reading), LEAST_NOISE_degC)


class _Readings:
    """Readings on their nodes: j (m,) the node before, a (m,) the share of the next; equal readings
    of a second are one.
    """

    def __init__(self, nodes_s: NDArray, time_s: NDArray, reading: NDArray, step: float) -> None:
        self.dt, self.n = float(nodes_s[1] - nodes_s[0]), nodes_s.size
        second = np.floor(time_s - time_s[0]).astype(np.int64)
        level = (
            np.unique(reading, return_inverse=True)[1]
            if step > 0.0
            else np.zeros(reading.size, dtype=np.int64)
        )
        _, group = np.unique(second * (int(level.max()) + 1) + level, return_inverse=True)
        self.count = np.bincount(group).astype(float)
        t = np.bincount(group, time_s) / self.count
        self.y, self.half = np.bincount(group, reading) / self.count, 0.5 * step
        self.j = np.clip(((t - nodes_s[0]) / self.dt).astype(int), 0, self.n - 2)
        self.a = (t - nodes_s[self.j]) / self.dt

    def fit(self, guess: SmoothTemperature) -> SmoothTemperature:
        """The mode under the noise and density of a first guess."""
        x, noise, density = guess.value_degC, guess.noise_degC, guess.density
        penalty = _penalty(self.n, self.dt) / density
        for _ in range(NEWTON_STEPS):
            _, gradient, weight = self._likelihood(x, noise)
            H, b = self._equations(penalty, weight, weight * self._at(x) + gradient)
            before, x = x, solveh_banded(H, b)
            if np.max(np.abs(x - before)) < 1e-3 * max(noise, LEAST_NOISE_degC):
                break
        log_likelihood, _, weight = self._likelihood(x, noise)
        H, _ = self._equations(penalty, weight, weight)
        factor = cholesky_banded(H)
        bend = np.diff(x, 2) / self.dt**1.5
        evidence = (
            log_likelihood - 0.5 * (bend @ bend) / density - 0.5 * (self.n - 2) * np.log(density)
        )
        evidence -= float(np.sum(np.log(factor[2])))
        return replace(guess, value_degC=x, factor=factor, log_evidence=evidence)

    def _at(self, x: NDArray) -> NDArray:
        return (1.0 - self.a) * x[self.j] + self.a * x[self.j + 1]

    def _equations(
        self, penalty: NDArray, weight: NDArray, target: NDArray
    ) -> tuple[NDArray, NDArray]:
        """Banded precision (3, n) and right-hand side (n,)."""
        j, a, n, H = self.j, self.a, self.n, penalty.copy()
        H[2] += (
            np.bincount(j, weight * (1.0 - a) ** 2, n) + np.bincount(j + 1, weight * a**2, n) + 1e-9
        )
        H[1] += np.bincount(j + 1, weight * a * (1.0 - a), n)
        return H, np.bincount(j, target * (1.0 - a), n) + np.bincount(j + 1, target * a, n)

    def _likelihood(self, x: NDArray, noise: float) -> tuple[float, NDArray, NDArray]:
        """Log likelihood, its slope (m,) and its negative curvature (m,) in T at each reading."""
        off = self._at(x) - self.y
        if self.half == 0.0:
            total = -0.5 * float(np.sum(self.count * (off / noise) ** 2)) - float(
                np.sum(self.count)
            ) * np.log(noise)
            return total, -self.count * off / noise**2, self.count / noise**2
        upper, lower = (self.half - off) / noise, (-self.half - off) / noise
        left = lower > 0.0  # both bounds on the side where 1 - Phi keeps its digits
        mass = ndtr(np.where(left, -lower, upper)) - ndtr(np.where(left, -upper, lower))
        far = mass < FAINT
        mass = np.where(far, 1.0, mass)
        p, q = (np.exp(-0.5 * z**2) / np.sqrt(2.0 * np.pi) for z in (upper, lower))
        slope = np.where(far, np.where(off > 0, upper, lower), -(p - q) / mass) / noise
        curvature = (upper * p - lower * q) / mass + ((p - q) / mass) ** 2
        curvature = np.where(far, 1.0, np.clip(curvature, 1e-9, 1.0)) / noise**2
        beyond = np.where(off > 0, upper, lower)
        log_mass = np.where(
            far, np.log(FAINT) - 0.5 * np.maximum(beyond**2 - 49.0, 0.0), np.log(mass)
        )
        return float(np.sum(self.count * log_mass)), self.count * slope, self.count * curvature


def _penalty(n: int, dt: float) -> NDArray:
    """D'D, banded upper form (3, n), D the second differences over dt^1.5."""
    d = np.array([1.0, -2.0, 1.0]) / dt**1.5
    bands = np.zeros((3, n))
    for i in range(3):
        bands[2, i : n - 2 + i] += d[i] ** 2
    for i in range(2):
        bands[1, i + 1 : n - 1 + i] += d[i] * d[i + 1]
    bands[0, 2:] += d[0] * d[2]
    return bands
