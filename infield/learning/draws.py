"""Weighed draws from a posterior that is slow to ask and far from normal.

So the posterior's logarithm is fitted by a Gaussian process (a quadratic bowl and a smooth
remainder, Rasmussen and Williams 2006, 2.7), the fit is sampled by many walkers (differential
evolution, ter Braak 2006), and the posterior is asked where the walkers end, which mends the fit;
in the end the draws are weighed by the posterior over what they were drawn from.

Decision: docs/decisions/0067-drawn-posterior.md.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

LogDensity = Callable[[NDArray], NDArray]
# of the first draws: from the curvature, and along the ridge of each parameter
FIRST_DRAWS, RIDGE_DRAWS = 150, 30
TAIL_FREEDOM = 5.0  # degrees of freedom of the first draws: 5 have heavier tails than a normal one
ROUND_DRAWS = 150  # asked in a round that mends the fit; 150 a round of 8 are 1,200 fits at most
UNUSED_ROUNDS, MOST_ROUNDS = 1, 8  # the first of 8 is not counted
GOOD_ROUND = (
    0.4  # effective draws of those asked; from 0.4 on a round more gains less than it costs
)
FINAL_DRAWS, MOST_FINAL = 600, 2  # asked in a round on the last fit, and so many rounds
# equal draws: four beyond each end of a 95 % interval, and so many that a median is known to
# MEDIAN_SIGMA, of which a normal distribution has 1.25 sigma / sqrt(draws)
LEAST_EFFECTIVE, MEDIAN_SIGMA, OF_MEDIAN = 160.0, 0.04, 1.2533
# what the walkers sample is the fit times this: tails a tenth wider than the posterior's, so that
# no weight grows large where the fit is low
FLATTENED = 0.8
WALKER_STEPS = 150  # of 0.3: ten times what a normal distribution needs
FINAL_STEPS = 60  # four times that
# of a logarithm: walkers stand on this grid, for a step doubles their rounding errors and 45 of 150
# steps are taken, so that 1e-16 of one machine would be another sample
GRID = 2.0**-10
DENSITY_DIGITS = 6  # of a log density, likewise: a millionth of a weight
# from this far below the largest log posterior on (the 99.99 % quantile of chi-square with 8
# degrees of freedom, halved) a value need not be fitted closely
DEEP = 16.0
DEEP_NOISE = 0.1  # of the depth beyond it
FIT_NOISE = 0.05  # of a log posterior: 5 % of a weight
LENGTHS_TRIED = (
    2.0,
    3.0,
    4.5,
    7.0,
)  # of the smooth remainder, in sigmas of the draws, that are tried
SIZES_TRIED = (1.0, 3.0, 10.0, 30.0)  # of the smooth remainder
LARGEST_EXPONENT = 60.0  # e^-60 counts for nothing, and its square is still a normal float64
# of the quadratic over half the squared distance in sigmas of the draws: far from all of them the
# fit must fall
LEAST_BOWL = 0.1


@dataclass(frozen=True)
class Draws:
    """theta (k, p) with weights (k,) that sum to one; asked: how often the posterior was."""

    theta: NDArray
    weight: NDArray
    asked: int

    @property
    def effective(self) -> float:
        """As many equal draws would say as much."""
        return _effective(self.weight)

    @property
    def are_enough(self) -> bool:
        """Whether the interval's ends and every median are known as well as is asked."""
        widest = max(self.sigma(k) for k in range(self.theta.shape[1]))
        needed = (OF_MEDIAN * widest / MEDIAN_SIGMA) ** 2
        return self.effective >= max(LEAST_EFFECTIVE, needed)

    def quantiles(self, k: int, levels: tuple[float, ...]) -> NDArray:
        """Of a parameter."""
        order = np.argsort(self.theta[:, k])
        reached = np.cumsum(self.weight[order]) - 0.5 * self.weight[order]
        return np.interp(levels, reached, self.theta[order, k])

    def sigma(self, k: int) -> float:
        """Of a parameter."""
        apart = self.theta[:, k] - self.weight @ self.theta[:, k]
        return float(np.sqrt(self.weight @ apart**2))


def draw(
    log_density: LogDensity,
    centre: NDArray,
    covariance: NDArray,
    widths: NDArray,
    rng: np.random.Generator,
) -> Draws:
    """Draws of a density whose largest value is about `centre` (p,), with the covariance (p, p) of
    its curvature there; widths (p,): of the prior, how far a tail can go.
    """
    theta = _on_grid(_first(centre, covariance, widths, rng))
    value = _rounded(log_density(theta))
    held: list[tuple[NDArray, NDArray]] = []
    for number in range(MOST_ROUNDS):
        fit = _Fit(theta, value)
        more = fit.walked(rng, ROUND_DRAWS, WALKER_STEPS)
        exact = _rounded(log_density(more))
        weight = _weights(exact - FLATTENED * fit(more))
        theta, value = np.concatenate([theta, more]), np.concatenate([value, exact])
        if number >= UNUSED_ROUNDS:
            held.append((more, weight))
            if _effective(weight) >= GOOD_ROUND * ROUND_DRAWS:
                break
    fit, found = _Fit(theta, value), _joined(held, len(value))
    for _ in range(MOST_FINAL):
        if found.are_enough:
            break
        more = fit.walked(rng, FINAL_DRAWS, FINAL_STEPS)
        exact = _rounded(log_density(more))
        held.append((more, _weights(exact - FLATTENED * fit(more))))
        found = _joined(held, found.asked + FINAL_DRAWS)
    return found


def _on_grid(theta: NDArray) -> NDArray:
    return np.asarray(np.round(theta / GRID) * GRID)


def _rounded(log_density: NDArray) -> NDArray:
    return np.asarray(np.round(log_density, DENSITY_DIGITS))


def _effective(weight: NDArray) -> float:
    """As many equal draws would say as much."""
    return float(1.0 / np.sum(weight**2))


def _joined(held: list[tuple[NDArray, NDArray]], asked: int) -> Draws:
    """Rounds together, each as heavy as it is effective."""
    share = np.array([_effective(weight) for _, weight in held])
    share /= share.sum()
    theta = np.concatenate([draws for draws, _ in held])
    weight = np.concatenate([s * weight for s, (_, weight) in zip(share, held)])
    return Draws(theta, weight, asked)


def _weights(log_weight: NDArray) -> NDArray:
    weight = np.exp(log_weight - log_weight.max())
    return np.asarray(weight / weight.sum())


def _first(
    centre: NDArray, covariance: NDArray, widths: NDArray, rng: np.random.Generator
) -> NDArray:
    """Draws with heavy tails from the curvature, and from the curvature stretched along the ridge
    of each parameter by its prior.
    """

    def students(P: NDArray, count: int) -> NDArray:
        z = rng.standard_normal((count, len(centre)))
        scale = np.sqrt(TAIL_FREEDOM / rng.chisquare(TAIL_FREEDOM, count))
        return np.asarray(centre + scale[:, None] * z @ np.linalg.cholesky(P).T)

    found = [students(covariance, FIRST_DRAWS)]
    for k, width in enumerate(widths):
        ridge = covariance[:, k] / covariance[k, k] * width
        found.append(students(covariance + np.outer(ridge, ridge), RIDGE_DRAWS))
    return np.concatenate(found)


class _Fit:
    """The log density between the places where it was asked."""

    def __init__(self, theta: NDArray, value: NDArray) -> None:
        usable = np.isfinite(value)
        self._theta, value = theta[usable], value[usable]
        self._top = float(value.max())
        depth = self._top - value
        near = np.exp(-np.minimum(depth, 2.0 * DEEP) / 4.0)  # a posterior four times as flat
        near /= near.sum()
        self._mean = near @ self._theta
        apart = self._theta - self._mean
        self._root = np.linalg.cholesky((near[:, None] * apart).T @ apart)
        self._weight_of = near
        self._z = self._whitened(self._theta)
        far = np.sum(self._z**2, axis=1)
        self._bowl = max(float(near @ (depth * far)) / float(near @ far**2), LEAST_BOWL)
        remainder = depth - self._bowl * far
        noise = (FIT_NOISE + DEEP_NOISE * np.maximum(depth - DEEP, 0.0)) ** 2
        found = [self._solved(remainder, noise, a, b) for a in LENGTHS_TRIED for b in SIZES_TRIED]
        _, self._length, self._size, self._alpha = max(found, key=lambda f: f[0])

    def __call__(self, theta: NDArray) -> NDArray:
        """The fit, (k,)."""
        z = self._whitened(theta)
        K = self._kernel(z, self._length, self._size)
        return np.asarray(self._top - self._bowl * np.sum(z**2, axis=1) - K @ self._alpha)

    def walked(self, rng: np.random.Generator, walkers: int, steps: int) -> NDArray:
        """Where walkers end that sample the flattened fit, (walkers, p)."""
        p = self._theta.shape[1]
        x = self._theta[rng.choice(len(self._theta), walkers, p=self._weight_of)].copy()
        at = FLATTENED * self(x)
        for step in range(steps):
            pairs = rng.integers(1, walkers, (2, walkers))
            own = np.arange(walkers)
            a, b = ((own + shift) % walkers for shift in pairs)
            far = 1.0 if step % 10 == 0 else 2.38 / np.sqrt(2.0 * p) * rng.choice([0.5, 1.0])
            small = 0.05 * rng.standard_normal(x.shape) @ self._root.T
            tried = _on_grid(x + far * (x[a] - x[b]) + small)
            there = FLATTENED * self(tried)
            taken = np.log(rng.random(walkers)) < there - at
            x[taken], at[taken] = tried[taken], there[taken]
        return x

    def _whitened(self, theta: NDArray) -> NDArray:
        return np.linalg.solve(self._root, (theta - self._mean).T).T

    def _solved(
        self, remainder: NDArray, noise: NDArray, length: float, size: float
    ) -> tuple[float, float, float, NDArray]:
        """Log likelihood of the fit with this length and size, both, and the fit's weights."""
        K = self._kernel(self._z, length, size) + np.diag(noise)
        L = np.linalg.cholesky(K)
        half = np.linalg.solve(L, remainder)
        alpha = np.linalg.solve(L.T, half)
        likely = -0.5 * float(half @ half) - float(np.sum(np.log(np.diag(L))))
        return likely, length, size, alpha

    def _kernel(self, z: NDArray, length: float, size: float) -> NDArray:
        """Covariance of the fit at whitened places (k, p) and at those that were asked."""
        squared = np.sum(z**2, axis=1)[:, None] + np.sum(self._z**2, axis=1) - 2.0 * z @ self._z.T
        exponent = np.clip(squared / (2.0 * length**2), 0.0, LARGEST_EXPONENT)
        return np.asarray(size**2 * np.exp(-exponent))
