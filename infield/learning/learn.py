"""Parameters of a technology from the sessions of its units: the largest posterior, its curvature,
weighted draws of the posterior, then types and units.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from infield.learning.draws import Draws, draw
from infield.learning.likelihood import FleetEvidence, FleetLikelihood
from infield.learning.parameters import (
    OF_POINTS,
    TYPE_SPREAD,
    UNIT_SPREAD,
    WIDTHS,
    HyperPrior,
    PriorName,
    defaults_of,
    hyperprior_of,
    logs_of,
)
from infield.learning.stored_sessions import StoredUnit
from ins.documents import written

# share of the largest curvature below which a direction is taken for not seen: differences of
# float64 log likelihoods of 1e4 keep 1e-10
LEAST_CURVATURE = 1e-9


@dataclass(frozen=True)
class Normal:
    """Mean (p,) and covariance (p, p) of logarithms."""

    mean: NDArray
    covariance: NDArray

    @property
    def sigma(self) -> NDArray:
        """Of each logarithm, (p,)."""
        return np.sqrt(np.diag(self.covariance))


@dataclass(frozen=True)
class Information:
    """What data say: information (p, p) and its vector (p,), about the common point."""

    information: NDArray
    vector: NDArray

    def spread(self, sigma: float) -> "Information":
        """Of a parent whose child differs from it by `sigma` in each logarithm."""
        inner = np.linalg.inv(np.eye(len(self.vector)) + sigma**2 * self.information)
        return Information(self.information @ inner, inner.T @ self.vector)

    def __add__(self, other: "Information") -> "Information":
        return Information(self.information + other.information, self.vector + other.vector)

    def __sub__(self, other: "Information") -> "Information":
        return Information(self.information - other.information, self.vector - other.vector)


@dataclass(frozen=True)
class Tree:
    """What is known of a technology, of its types and of its units, by name."""

    technology: Normal
    types: Mapping[str, Normal]
    units: Sequence[Normal]


def said_by(gradient: NDArray, curvature: NDArray) -> Information:
    """Of a log likelihood with this gradient (p,) and curvature (p, p) at the common point; a
    direction in which it bends upwards says nothing.
    """
    values, vectors = np.linalg.eigh(-0.5 * (curvature + curvature.T))
    seen = values > LEAST_CURVATURE * max(float(np.max(np.abs(values))), 1e-300)
    V = vectors[:, seen]
    return Information((V * values[seen]) @ V.T, V @ (V.T @ gradient))


def solve(
    prior: Information,
    units: Sequence[Information],
    types: Sequence[str],
    *,
    type_spread: float,
    unit_spread: float,
    about: NDArray,
) -> Tree:
    """The tree given what each unit's sessions say; types: the type of each unit; about: the common
    point (p,), to which the means are added.
    """
    up = [said.spread(unit_spread) for said in units]
    zero = Information(np.zeros_like(prior.information), np.zeros_like(prior.vector))
    of_type = {
        name: sum((said for said, t in zip(up, types) if t == name), start=zero)
        for name in dict.fromkeys(types)
    }
    type_up = {name: said.spread(type_spread) for name, said in of_type.items()}
    everything = sum(type_up.values(), start=prior)
    known = {
        name: of_type[name] + (everything - type_up[name]).spread(type_spread) for name in of_type
    }
    found = [
        said + (known[t] - message).spread(unit_spread)
        for said, message, t in zip(units, up, types)
    ]
    return Tree(
        _normal(everything, about),
        {name: _normal(said, about) for name, said in known.items()},
        [_normal(said, about) for said in found],
    )


def _normal(said: Information, about: NDArray) -> Normal:
    covariance = np.linalg.inv(said.information)
    return Normal(about + covariance @ said.vector, 0.5 * (covariance + covariance.T))


STEP = 0.1  # of a logarithm, for differences: a tenth of what forty sessions can tell
LARGEST_MOVE = 1.0  # of a logarithm in one iteration: a factor e
SETTLED_SIGMAS = 0.03  # of a posterior sigma that the last iteration may move by: 3 % of it
MOST_ITERATIONS = 30
MOST_LOOKS = 3  # how often outliers are looked for anew
SAME_PLACE = 0.2  # move of a logarithm that changes none of them: the odds of one by 20 %
# effective draws below which the weights say little, and the curvature stands: one beyond each
# end of a 95 % interval
FEWEST_EFFECTIVE = 40.0
# of the hyperprior's sigma: a parameter that stays as uncertain was not shown by the sessions, as
# with sigmas of an axis (formats.md, section 5)
NOT_SHOWN = 0.9
TWO_SIDED_95 = 1.96  # sigmas of a normal distribution at the ends of its 95 % interval
# of a variance that is left where the tree says that a unit is better known than its technology:
# a sigma a fifth (0.2^2 = 0.04) of the technology's
LEFT_OF_VARIANCE = 0.05
CRAB_VALUES = 241  # values of the crab's sigma that are tried


@written("value sigma n interval_95 sigma_log default unit shown")
@dataclass(frozen=True)
class Learnt:
    """One parameter: value (median), sigma of its logarithm, 95 % interval; shown: the sessions
    said something of it, beyond what was believed before; n: sessions that it rests on. default,
    unit: of the value, in a document.
    """

    value: float
    sigma_log: float
    interval_95: tuple[float, float]
    shown: bool
    n: int
    default: float = float("nan")
    unit: str = ""

    @property
    def sigma(self) -> float:
        """Of the value, to first order."""
        return self.value * self.sigma_log

    @classmethod
    def normal(cls, value: float, sigma_log: float, *, shown: bool, n: int) -> "Learnt":
        """Of a logarithm that is normally distributed."""
        factor = float(np.exp(TWO_SIDED_95 * sigma_log))
        return cls(value, sigma_log, (value / factor, value * factor), shown, n)


Parameters = Mapping[PriorName, Learnt]


@dataclass(frozen=True)
class DrawCheck:
    """How well the posterior was drawn: asked `draws` times, for `effective` equal draws; used: the
    intervals are those of the draws.
    """

    draws: int
    effective: float
    used: bool


@dataclass(frozen=True)
class LearntFleet:
    """What the sessions of one technology say.

    evidence: at the technology's values; defaults: the same at the defaults; draws: of the
    technology's posterior, in the order of OF_POINTS. settled: the search ended within
    its tolerance.
    """

    technology: str
    units: tuple[StoredUnit, ...]
    parameters: Parameters
    types: Mapping[str, Parameters]
    of_units: Sequence[Parameters]
    evidence: FleetEvidence
    defaults: FleetEvidence
    draws: Draws
    check: DrawCheck
    settled: bool

    @property
    def sessions(self) -> int:
        """How many there are."""
        return sum(len(unit.sessions) for unit in self.units)


def learn(units: Sequence[StoredUnit], *, seed: int = 0) -> LearntFleet:
    """Parameters of the technology of some units, which must be one and the same."""
    (technology,) = {unit.gyro_technology for unit in units}
    likelihood, prior = FleetLikelihood(units), hyperprior_of(technology)
    found = _largest(likelihood, prior)
    laplace, draws = _drawn(likelihood, prior, found, np.random.default_rng(seed))
    # used as long as the draws say more than the curvature would
    used = draws.effective >= FEWEST_EFFECTIVE
    check = DrawCheck(draws.asked, draws.effective, used=used)
    about = found.theta
    information = np.diag(prior.sigma**-2.0)
    tree = solve(
        Information(information, information @ (prior.mean - about)),
        [said_by(g, h) for g, h in zip(found.gradients, found.curvatures)],
        [unit.kind for unit in units],
        type_spread=TYPE_SPREAD,
        unit_spread=UNIT_SPREAD,
        about=about,
    )
    count = sum(len(unit.sessions) for unit in units)
    crab = _crab(units, technology)
    extra = {} if crab is None else {PriorName.CRAB: crab}
    seen = UNIT_SPREAD / np.sqrt(len(units))
    whole = _of_technology(draws, laplace, used, seen)

    def child(normal: Normal, sessions: int) -> Parameters:
        return _learnt(_of_child(whole, tree.technology, normal), prior, sessions)

    values = _learnt(whole, prior, count)
    return LearntFleet(
        technology=technology,
        units=tuple(units),
        parameters={**values, **extra},
        types={name: child(normal, count) for name, normal in tree.types.items()},
        of_units=[child(normal, len(unit.sessions)) for normal, unit in zip(tree.units, units)],
        evidence=likelihood(logs_of({name: values[name].value for name in OF_POINTS})),
        defaults=likelihood(prior.mean),
        draws=draws,
        check=check,
        settled=found.settled,
    )


@dataclass(frozen=True)
class _Marginal:
    """A logarithm's median, the ends of its 95 % interval and its sigma."""

    middle: float
    low: float
    high: float
    sigma: float

    def wider(self, variance: float) -> "_Marginal":
        """With a further variance, negative: a smaller one; both sides alike."""
        sigma = float(np.sqrt(max(self.sigma**2 + variance, LEFT_OF_VARIANCE * self.sigma**2)))
        share = sigma / self.sigma
        return _Marginal(
            self.middle,
            self.middle - share * (self.middle - self.low),
            self.middle + share * (self.high - self.middle),
            sigma,
        )

    def shifted(self, by: float) -> "_Marginal":
        """Elsewhere."""
        return _Marginal(self.middle + by, self.low + by, self.high + by, self.sigma)


@dataclass(frozen=True)
class _Found:
    """The largest posterior: theta (p,), gradient (u, p) and curvature (u, p, p) of each unit's log
    likelihood there.
    """

    theta: NDArray
    gradients: NDArray
    curvatures: NDArray
    settled: bool


def _largest(likelihood: FleetLikelihood, prior: HyperPrior) -> _Found:
    """The largest posterior, summed over the histories that are likely there."""
    search = _Search(likelihood, prior)
    found = search.run(prior.mean)
    for _ in range(MOST_LOOKS):
        likelihood.look_again(found.theta)
        before, found = found, search.run(found.theta)
        if np.max(np.abs(found.theta - before.theta)) < SAME_PLACE:
            break
    return found


class _Search:
    """Newton's way to the largest posterior, by differences."""

    def __init__(self, likelihood: FleetLikelihood, prior: HyperPrior) -> None:
        self._likelihood = likelihood
        self._prior = prior

    def run(self, start: NDArray) -> _Found:
        """From a first guess."""
        theta, best = start.copy(), self._value(start)
        gradients, curvatures = self._differences(theta)
        settled = False
        for _ in range(MOST_ITERATIONS):
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


def _drawn(
    likelihood: FleetLikelihood, prior: HyperPrior, found: _Found, rng: np.random.Generator
) -> tuple[Normal, Draws]:
    """The normal distribution of the curvature, and draws of the posterior."""
    A = np.diag(prior.sigma**-2.0) + _positive(-found.curvatures.sum(axis=0))
    laplace = Normal(found.theta, np.linalg.inv(A))

    def log_posterior(draws: NDArray) -> NDArray:
        likely = [float(likelihood.log_likelihood(d).sum()) + prior.log_density(d) for d in draws]
        return np.array(likely)

    return laplace, draw(log_posterior, found.theta, laplace.covariance, prior.sigma, rng)


def _of_technology(draws: Draws, laplace: Normal, used: bool, spread: float) -> list[_Marginal]:
    """By the quantiles of the draws, widened by `spread`."""
    found = []
    for k, (mean, sigma) in enumerate(zip(laplace.mean, laplace.sigma)):
        low, middle, high = mean - TWO_SIDED_95 * sigma, mean, mean + TWO_SIDED_95 * sigma
        if used:
            low, middle, high = draws.quantiles(k, (0.025, 0.5, 0.975))
            sigma = draws.sigma(k)
        found.append(_Marginal(middle, low, high, sigma).wider(spread**2))
    return found


def _of_child(technology: Sequence[_Marginal], parent: Normal, child: Normal) -> list[_Marginal]:
    """A type's or a unit's: the technology's, shifted and widened by what the tree says sets the
    child apart from it.
    """
    apart = child.mean - parent.mean
    more = child.sigma**2 - parent.sigma**2
    return [m.shifted(shift).wider(v) for m, shift, v in zip(technology, apart, more)]


def _learnt(marginals: Sequence[_Marginal], prior: HyperPrior, n: int) -> dict[PriorName, Learnt]:
    return {
        name: Learnt(
            value=float(np.exp(m.middle)),
            sigma_log=m.sigma,
            interval_95=(float(np.exp(m.low)), float(np.exp(m.high))),
            shown=bool(m.sigma < NOT_SHOWN * before),
            n=n,
        )
        for name, m, before in zip(OF_POINTS, marginals, prior.sigma)
    }


def _crab(units: Sequence[StoredUnit], technology: str) -> Learnt | None:
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
    sigma = float(np.sqrt(weight @ (theta - mean) ** 2))
    shown = sigma < NOT_SHOWN * width
    return Learnt.normal(float(np.exp(mean)), sigma, shown=shown, n=len(seen))
