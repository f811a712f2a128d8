"""Parameters of a technology from the sessions of its units: the largest posterior, its curvature,
a check of the curvature by weighed draws, then types and units.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from infield.learning.hierarchy import Normal, Said, said_by, solve
from infield.learning.kept import KeptUnit
from infield.learning.likelihood import Evidence, FleetLikelihood
from infield.learning.parameters import (
    OF_POINTS,
    TYPE_SPREAD,
    UNIT_SPREAD,
    WIDTHS,
    HyperPrior,
    PriorName,
    defaults_of,
    hyperprior_of,
)

STEP = 0.1  # of a logarithm, for differences: a tenth of what forty sessions can tell
LARGEST_MOVE = 1.0  # of a logarithm in one iteration: a factor e
SETTLED_SIGMAS = 0.01  # of a posterior sigma that the last iteration may move by: 1 % of it
MOST_ITERATIONS = 30
# of the check: from the curvature and in each further round, and along the ridge of each parameter
FIRST_DRAWS, RIDGE_DRAWS, MOST_ROUNDS = 150, 30, 6
ENOUGH_EFFECTIVE = 120.0  # effective draws: three beyond each end of a 95 % interval
LARGEST_WEIGHT = 0.05  # of one draw as a round is laid out: else the next stands about it alone
LEAST_SPREAD = 0.1  # of the curvature's covariance that every round keeps
TAIL_FREEDOM = 5.0  # degrees of freedom of the draws: 5 have heavier tails than a normal one
# effective draws below which the weights say little, and the curvature stands: one beyond each
# end of a 95 % interval
FEWEST_EFFECTIVE = 40.0
# of the hyperprior's sigma: a parameter that stays as uncertain was not shown by the sessions, as
# with sigmas of an axis (formats.md, section 5)
NOT_SHOWN = 0.9
CRAB_VALUES = 241  # values of the crab's sigma that are tried


@dataclass(frozen=True)
class Learnt:
    """One parameter: value (median), sigma of its logarithm, 95 % interval; shown: the sessions
    said something of it, beyond what was believed before; n: sessions that it rests on.
    """

    value: float
    sigma_log: float
    interval_95: tuple[float, float]
    shown: bool
    n: int

    @property
    def sigma(self) -> float:
        """Of the value, to first order."""
        return self.value * self.sigma_log


Parameters = Mapping[PriorName, Learnt]


@dataclass(frozen=True)
class Check:
    """How well the curvature describes the posterior: effective ones of `draws`; used: the
    intervals are those of the draws; largest_change: of an end of an interval, in sigmas.
    """

    draws: int
    effective: float
    used: bool
    largest_change: float


@dataclass(frozen=True)
class LearntFleet:
    """What the sessions of one technology say.

    evidence: at the technology's values; defaults: the same at the defaults; laplace: of the
    technology, the order of OF_POINTS. settled: the search ended within its tolerance.
    """

    technology: str
    units: tuple[KeptUnit, ...]
    parameters: Parameters
    types: Mapping[str, Parameters]
    of_units: Sequence[Parameters]
    evidence: Evidence
    defaults: Evidence
    laplace: Normal
    check: Check
    settled: bool

    @property
    def sessions(self) -> int:
        """How many there are."""
        return sum(len(unit.sessions) for unit in self.units)


def learn(units: Sequence[KeptUnit], *, seed: int = 0) -> LearntFleet:
    """Parameters of the technology of some units, which must be one and the same."""
    (technology,) = {unit.gyro_technology for unit in units}
    likelihood, prior = FleetLikelihood(units), hyperprior_of(technology)
    found = _Search(likelihood, prior).run()
    laplace, check, draws = _checked(likelihood, prior, found, np.random.default_rng(seed))
    about = found.theta
    information = np.diag(prior.sigma**-2.0)
    tree = solve(
        Said(information, information @ (prior.mean - about)),
        [said_by(g, h) for g, h in zip(found.gradients, found.curvatures)],
        [unit.kind for unit in units],
        type_spread=TYPE_SPREAD,
        unit_spread=UNIT_SPREAD,
        about=about,
    )
    count = sum(len(unit.sessions) for unit in units)
    crab = _crab(units, technology)
    extra = {} if crab is None else {PriorName.CRAB: crab}
    return LearntFleet(
        technology=technology,
        units=tuple(units),
        parameters={**_from_draws(draws, prior, UNIT_SPREAD / np.sqrt(len(units)), count), **extra},
        types={name: _from_normal(normal, prior, count) for name, normal in tree.types.items()},
        of_units=[
            _from_normal(normal, prior, len(unit.sessions))
            for normal, unit in zip(tree.units, units)
        ],
        evidence=likelihood(about),
        defaults=likelihood(prior.mean),
        laplace=laplace,
        check=check,
        settled=found.settled,
    )


@dataclass(frozen=True)
class _Found:
    """The largest posterior: theta (p,), gradient (u, p) and curvature (u, p, p) of each unit's log
    likelihood there.
    """

    theta: NDArray
    gradients: NDArray
    curvatures: NDArray
    settled: bool


class _Search:
    """Newton's way to the largest posterior, by differences."""

    def __init__(self, likelihood: FleetLikelihood, prior: HyperPrior) -> None:
        self._likelihood = likelihood
        self._prior = prior

    def run(self) -> _Found:
        theta, best = self._prior.mean.copy(), self._value(self._prior.mean)
        settled = False
        for _ in range(MOST_ITERATIONS):
            gradients, curvatures = self._differences(theta)
            information = np.diag(self._prior.sigma**-2.0)
            g = gradients.sum(axis=0) - information @ (theta - self._prior.mean)
            A = information + _positive(-curvatures.sum(axis=0))
            move = np.linalg.solve(A, g)
            size = np.abs(move) * np.sqrt(np.diag(A))
            if np.max(size) < SETTLED_SIGMAS:
                settled = True
                break
            move *= min(1.0, LARGEST_MOVE / float(np.max(np.abs(move))))
            theta, better = self._along(theta, move, best)
            if better <= best:
                settled = bool(np.max(size) < 10.0 * SETTLED_SIGMAS)
                break
            best = better
        gradients, curvatures = self._differences(theta)
        return _Found(theta, gradients, curvatures, settled)

    def _value(self, theta: NDArray) -> float:
        return float(self._units(theta).sum()) + self._prior.log_density(theta)

    def _units(self, theta: NDArray) -> NDArray:
        return self._likelihood.log_likelihood(theta)

    def _along(self, theta: NDArray, move: NDArray, best: float) -> tuple[NDArray, float]:
        """The step, halved until the posterior grows; no step where it does not."""
        for halving in range(6):
            tried = theta + move * 0.5**halving
            value = self._value(tried)
            if value > best:
                return tried, value
        return theta, best

    def _differences(self, theta: NDArray) -> tuple[NDArray, NDArray]:
        """Gradient (u, p) and curvature (u, p, p) of each unit's log likelihood."""
        p, units = len(theta), len(self._likelihood.units)
        at = self._units(theta)
        up, down = np.zeros((p, units)), np.zeros((p, units))
        steps = STEP * np.eye(p)
        for i in range(p):
            up[i], down[i] = self._units(theta + steps[i]), self._units(theta - steps[i])
        H = np.zeros((units, p, p))
        for i in range(p):
            H[:, i, i] = (up[i] + down[i] - 2.0 * at) / STEP**2
            for j in range(i):
                both = self._units(theta + steps[i] + steps[j])
                H[:, i, j] = H[:, j, i] = (both - up[i] - up[j] + at) / STEP**2
        return ((up - down) / (2.0 * STEP)).T, H


def _positive(A: NDArray) -> NDArray:
    """The matrix without the directions in which it bends the wrong way."""
    values, vectors = np.linalg.eigh(0.5 * (A + A.T))
    return np.asarray((vectors * np.maximum(values, 0.0)) @ vectors.T)


@dataclass(frozen=True)
class _Proposal:
    """A distribution with heavy tails (Student's, TAIL_FREEDOM degrees of freedom) to draw from."""

    mean: NDArray
    covariance: NDArray

    def draw(self, rng: np.random.Generator, count: int) -> NDArray:
        L = np.linalg.cholesky(self.covariance)
        z = rng.standard_normal((count, len(self.mean)))
        return (
            self.mean
            + (z * np.sqrt(TAIL_FREEDOM / rng.chisquare(TAIL_FREEDOM, count))[:, None]) @ L.T
        )

    def log_density(self, draws: NDArray) -> NDArray:
        """Up to a constant that all proposals share."""
        L = np.linalg.cholesky(self.covariance)
        z = np.linalg.solve(L, (draws - self.mean).T)
        p = len(self.mean)
        return np.asarray(
            -0.5 * (TAIL_FREEDOM + p) * np.log1p(np.sum(z**2, axis=0) / TAIL_FREEDOM)
            - np.sum(np.log(np.diag(L)))
        )


def _checked(
    likelihood: FleetLikelihood, prior: HyperPrior, found: _Found, rng: np.random.Generator
) -> tuple[Normal, Check, tuple[NDArray, NDArray]]:
    """The normal distribution of the curvature, the draws that check it, and these draws with their
    weights.

    A variance that the sessions hardly show has a long tail towards zero, which no curvature sees.
    So draws come from the curvature, and from the curvature stretched along the ridge of each
    parameter by its hyperprior; further rounds come from the moments of those before. All are
    weighed by the posterior over the mixture of all proposals (Cornuet and others 2012, AMIS).
    """
    A = np.diag(prior.sigma**-2.0) + _positive(-found.curvatures.sum(axis=0))
    laplace = Normal(found.theta, np.linalg.inv(A))
    proposals = [(_Proposal(found.theta, laplace.covariance), FIRST_DRAWS)]
    for k, width in enumerate(prior.sigma):
        ridge = laplace.covariance[:, k] / laplace.covariance[k, k] * width
        stretched = laplace.covariance + np.outer(ridge, ridge)
        proposals.append((_Proposal(found.theta, stretched), RIDGE_DRAWS))

    def posterior(draws: NDArray) -> NDArray:
        likely = [float(likelihood.log_likelihood(d).sum()) + prior.log_density(d) for d in draws]
        return np.array(likely)

    draws = np.concatenate([proposal.draw(rng, count) for proposal, count in proposals])
    log_posterior = posterior(draws)
    for _ in range(MOST_ROUNDS):
        weight = _weights(draws, log_posterior, proposals)
        if 1.0 / np.sum(weight**2) >= ENOUGH_EFFECTIVE:
            break
        weight = np.minimum(weight, LARGEST_WEIGHT)
        weight /= weight.sum()
        mean = weight @ draws
        spread = (weight[:, None] * (draws - mean)).T @ (draws - mean)
        again = _Proposal(mean, spread + LEAST_SPREAD * laplace.covariance)
        proposals.append((again, FIRST_DRAWS))
        more = again.draw(rng, FIRST_DRAWS)
        draws = np.concatenate([draws, more])
        log_posterior = np.concatenate([log_posterior, posterior(more)])
    weight = _weights(draws, log_posterior, proposals)
    effective = float(1.0 / np.sum(weight**2))
    used = effective >= FEWEST_EFFECTIVE
    count = len(draws)
    if not used:
        L = np.linalg.cholesky(laplace.covariance)
        draws = found.theta + rng.standard_normal(draws.shape) @ L.T
        weight = np.full(count, 1.0 / count)
    ends = np.array([_quantiles(column, weight, (0.025, 0.975)) for column in draws.T])
    normal = found.theta[:, None] + np.outer(laplace.sigma, [-1.96, 1.96])
    change = float(np.max(np.abs(ends - normal) / laplace.sigma[:, None]))
    return laplace, Check(count, effective, used, change), (draws, weight)


def _weights(
    draws: NDArray, log_posterior: NDArray, proposals: Sequence[tuple[_Proposal, int]]
) -> NDArray:
    """Of draws from several proposals, which count as draws from their mixture."""
    parts = [np.log(count) + proposal.log_density(draws) for proposal, count in proposals]
    log_weight = log_posterior - np.logaddexp.reduce(parts, axis=0)
    weight = np.exp(log_weight - log_weight.max())
    return np.asarray(weight / weight.sum())


def _quantiles(values: NDArray, weight: NDArray, levels: tuple[float, ...]) -> NDArray:
    """Of weighed draws."""
    order = np.argsort(values)
    reached = np.cumsum(weight[order]) - 0.5 * weight[order]
    return np.interp(levels, reached, values[order])


def _from_draws(
    draws: tuple[NDArray, NDArray], prior: HyperPrior, spread: float, n: int
) -> dict[PriorName, Learnt]:
    """The technology's parameters by the quantiles of the weighed draws, widened by `spread`: the
    units that were seen are some of many.
    """
    theta, weight = draws
    found: dict[PriorName, Learnt] = {}
    for k, name in enumerate(OF_POINTS):
        low, middle, high = _quantiles(theta[:, k], weight, (0.025, 0.5, 0.975))
        sigma = np.sqrt(weight @ (theta[:, k] - weight @ theta[:, k]) ** 2)
        wider = float(np.hypot(sigma, spread))
        ends = middle + (np.array([low, high]) - middle) * wider / sigma
        found[name] = Learnt(
            float(np.exp(middle)),
            wider,
            (float(np.exp(ends[0])), float(np.exp(ends[1]))),
            bool(wider < NOT_SHOWN * prior.sigma[k]),
            n,
        )
    return found


def _from_normal(normal: Normal, prior: HyperPrior, n: int) -> dict[PriorName, Learnt]:
    return _learnt(normal, prior, n)


def _learnt(normal: Normal, prior: HyperPrior, n: int) -> dict[PriorName, Learnt]:
    return {
        name: _one(float(mean), float(sigma), float(before), n)
        for name, mean, sigma, before in zip(OF_POINTS, normal.mean, normal.sigma, prior.sigma)
    }


def _one(mean: float, sigma: float, before: float, n: int) -> Learnt:
    low, high = np.exp(mean - 1.96 * sigma), np.exp(mean + 1.96 * sigma)
    return Learnt(
        float(np.exp(mean)), sigma, (float(low), float(high)), sigma < NOT_SHOWN * before, n
    )


def _crab(units: Sequence[KeptUnit], technology: str) -> Learnt | None:
    """Sigma of the crab over sessions, from what each taxi measured of it; None where none did."""
    seen = [s.crab_mrad for unit in units for s in unit.sessions if s.crab_mrad is not None]
    if not seen:
        return None
    value, sigma = np.array(seen).T
    width = WIDTHS[PriorName.CRAB]
    theta = np.log(defaults_of(technology)[PriorName.CRAB]) + np.linspace(-4.0, 4.0, CRAB_VALUES)
    variance = np.exp(2.0 * theta)[:, None] + sigma**2
    log_posterior = -0.5 * np.sum(value**2 / variance + np.log(variance), axis=1)
    log_posterior -= 0.5 * (np.linspace(-4.0, 4.0, CRAB_VALUES) / width) ** 2
    weight = np.exp(log_posterior - log_posterior.max())
    weight /= weight.sum()
    mean = float(weight @ theta)
    return _one(mean, float(np.sqrt(weight @ (theta - mean) ** 2)), width, len(seen))
