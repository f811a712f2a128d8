"""The likelihood of one triad's noise terms, and its highest point.

Bands of spectra are gamma (Whittle), slow contrasts Gaussian; both are linear in the variances of
the terms. The unknowns are the logarithms of these variances, and of the shape of the sway. Each
has a wide prior about what was believed before, which only holds those that the data say nothing
of.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from simreal.evidence.noise_model import oscillator
from simreal.twin.fit.rounding import LAGS
from simreal.twin.fit.slow import Covariance, SlowData
from simreal.twin.fit.spectra import Bands
from simreal.twin.fit.terms import NoiseTerm, Shape, sampled_psd

PRIOR_SIGMA = 2.0 * np.log(10.0)  # of a log variance: a factor 10 of the size, one sigma
SHAPE_SIGMA = np.log(3.0)  # of the frequency and the damping of the sway
MOST_STEPS = 60
LARGEST_STEP = 1.5  # of a log variance
CONVERGED, ROUGHLY = 1e-3, 0.03  # nats that a step still gains
SHAPE_STEP = 1e-3  # relative, of the numerical derivative
ABSENT = -80.0  # log variance of a term left out: e^-80 is 1e-35, below any square of a noise


@dataclass(frozen=True)
class TriadEvidence:
    """What a triad showed, over all runs. share (6,) of each channel's sway (the level part of its
    axis), by index of the run.
    """

    bands: tuple[tuple[int, Bands], ...]
    slow: tuple[tuple[int, SlowData], ...]
    share: tuple[NDArray, ...]

    def of(self, channels: Sequence[int]) -> "TriadEvidence":
        """Some of the channels."""
        bands = tuple((k, b) for k, b in self.bands if b.channel in channels)
        slow = tuple((k, s) for k, s in self.slow if s.channel in channels)
        return TriadEvidence(bands, slow, self.share)


@dataclass(frozen=True)
class TriadModel:
    """Terms of a triad in order; where a term enters one channel alone (CREEP), its channel.

    centre, width (p,): log variances believed before, and their sigma; shape: the same of the sway
    and the Markov time. ratios: variance of a channel's term over the triad's, where channels
    differ. on_grid: the quantum is that of the grid on which readings lie. unbelieved: terms that
    nobody believed in. hidden: rows are rounded one by one, to steps that hide their noise.
    """

    terms: tuple[NoiseTerm, ...]
    centre: NDArray
    shape: Shape
    width: NDArray
    ratios: Mapping[tuple[NoiseTerm, int], float] = field(default_factory=dict)
    creep_channel: int = 2
    on_grid: bool = False
    unbelieved: frozenset[NoiseTerm] = frozenset()
    hidden: bool = False

    @property
    def shapes(self) -> tuple[str, ...]:
        """Names of the shape parameters that are fitted."""
        sway = ("sway_w", "sway_zeta") if NoiseTerm.SWAY in self.terms else ()
        return (*sway, *(("tau_s",) if NoiseTerm.MARKOV in self.terms else ()))

    @property
    def size(self) -> int:
        return len(self.terms) + len(self.shapes)

    @property
    def start(self) -> NDArray:
        """All parameters as believed before."""
        believed = [np.log(getattr(self.shape, name)) for name in self.shapes]
        return np.concatenate([self.centre, believed])

    @property
    def prior_sigma(self) -> NDArray:
        return np.concatenate([self.width, np.full(len(self.shapes), SHAPE_SIGMA)])

    def shape_at(self, x: NDArray) -> Shape:
        """The shape of a parameter vector."""
        values = np.exp(x[len(self.terms) :])
        return replace(self.shape, **dict(zip(self.shapes, values.tolist())))

    def factor(self, term: NoiseTerm, channel: int, share: NDArray) -> float:
        """How much of a term's variance a channel has."""
        if term is NoiseTerm.SWAY:
            return float(share[channel])
        if term is NoiseTerm.CREEP:
            return float(channel == self.creep_channel)
        return self.ratios.get((term, channel), 1.0)

    def without(self, term: NoiseTerm) -> "TriadModel":
        """The model less one term."""
        keep = [k for k, t in enumerate(self.terms) if t is not term]
        return replace(
            self,
            on_grid=self.on_grid and term is not NoiseTerm.QUANTIZATION,
            terms=tuple(self.terms[k] for k in keep),
            centre=self.centre[keep],
            width=self.width[keep],
        )


@dataclass(frozen=True)
class NoiseEstimate:
    """The highest point x (p,) of a model: log likelihood there without the prior, its information
    (p, p) without the prior.
    """

    model: TriadModel
    x: NDArray
    log_likelihood: float
    information: NDArray

    @property
    def covariance(self) -> NDArray:
        """Of the parameters, prior included."""
        return np.linalg.inv(self.information + np.diag(self.model.prior_sigma**-2.0))

    def log_variance(self, term: NoiseTerm) -> float:
        return float(self.x[self.model.terms.index(term)])

    def sigma(self, term: NoiseTerm) -> float:
        """Of a term's log variance."""
        k = self.model.terms.index(term)
        return float(np.sqrt(self.covariance[k, k]))


def climb(
    evidence: TriadEvidence,
    model: TriadModel,
    x: NDArray | None = None,
    *,
    fixed: Sequence[int] = (),
    within: float = CONVERGED,
) -> NoiseEstimate:
    """The highest point of likelihood times prior, by damped Fisher scoring; `fixed` parameters
    stay where x has them.
    """
    x = model.start.copy() if x is None else x.copy()
    weight = model.prior_sigma**-2.0
    start = model.start
    free = np.setdiff1d(np.arange(x.size), fixed)
    value, gradient, information = derivatives(evidence, model, x)
    best = value - 0.5 * float(np.sum(weight * (x - start) ** 2))
    damping = 0.0
    for _ in range(MOST_STEPS):
        slope = (gradient - weight * (x - start))[free]
        curve = (information + np.diag(weight))[np.ix_(free, free)]
        step = np.linalg.solve(curve + damping * np.diag(np.diag(curve)), slope)
        step *= min(1.0, LARGEST_STEP / max(float(np.abs(step).max(initial=0.0)), 1e-12))
        trial = x.copy()
        trial[free] += step
        found = derivatives(evidence, model, trial)
        now = found[0] - 0.5 * float(np.sum(weight * (trial - start) ** 2))
        if now < best - 1e-9:
            damping = max(4.0 * damping, 0.1)
            if damping > 1e6:
                break
            continue
        gain, best, x = now - best, now, trial
        value, gradient, information = found
        damping = 0.0 if damping < 0.1 else damping / 4.0
        if gain < within:
            break
    return NoiseEstimate(model, x, value, information)


def derivatives(
    evidence: TriadEvidence, model: TriadModel, x: NDArray
) -> tuple[float, NDArray, NDArray]:
    """Log likelihood, its gradient (p,) and expected information (p, p)."""
    value, gradient = 0.0, np.zeros(x.size)
    information = np.zeros((x.size, x.size))
    moved = [_moved(model, x, k) for k in range(len(model.terms), x.size)]
    for k, bands in evidence.bands:
        S, slopes = band_model(model, x, moved, bands, evidence.share[k])
        used = bands.dof > 0
        ratio = bands.power[used] / S[used]
        nu = bands.dof[used]
        value -= float(np.sum(nu * (np.log(S[used]) + ratio)))
        relative = slopes[:, used] / S[used]
        gradient += relative @ (nu * (ratio - 1.0))
        information += (relative * nu) @ relative.T
    for k, slow in evidence.slow:
        v, g, F = _gaussian(model, x, slow, evidence.share[k])
        value, gradient, information = value + v, gradient + g, information + F
    return value, gradient, information


def _moved(model: TriadModel, x: NDArray, k: int) -> NDArray:
    found = x.copy()
    found[k] += SHAPE_STEP
    return found


def band_model(
    model: TriadModel, x: NDArray, moved: Sequence[NDArray], bands: Bands, share: NDArray
) -> tuple[NDArray, NDArray]:
    """Expected power (b,) and its derivatives (p, b)."""
    shape = model.shape_at(x)
    parts = np.zeros((x.size, bands.power.size))
    for j, term in enumerate(model.terms):
        factor = model.factor(term, bands.channel, share)
        if factor and x[j] > ABSENT:
            parts[j] = factor * np.exp(x[j]) * bands.expected(term, shape)
            if term is NoiseTerm.SWAY:
                parts[j, bands.own] = 0.0
    power = parts[: len(model.terms)].sum(axis=0)
    if model.on_grid and bands.rounding is not None:
        at, white = model.terms.index(NoiseTerm.QUANTIZATION), model.terms.index(NoiseTerm.WHITE)
        counted = rounding_power(model, x, bands, share)
        power += counted - parts[at]
        there = rounding_power(model, _moved(model, x, white), bands, share)
        parts[white] += (there - counted) / SHAPE_STEP
        parts[at] = counted
    for j, other in enumerate(moved):
        name = model.shapes[j]
        term = NoiseTerm.MARKOV if name == "tau_s" else NoiseTerm.SWAY
        at = model.terms.index(term)
        factor = model.factor(term, bands.channel, share)
        if factor:
            there = factor * np.exp(x[at]) * bands.expected(term, model.shape_at(other))
            if term is NoiseTerm.SWAY:
                there[bands.own] = 0.0
            parts[len(model.terms) + j] = (there - parts[at]) / SHAPE_STEP
    return power, parts


def rounding_power(model: TriadModel, x: NDArray, bands: Bands, share: NDArray) -> NDArray:
    """Expected power (b,) of the errors of counting, on the noise beneath it."""
    if bands.rounding is None:
        return np.zeros(bands.power.size)
    lag = bands.dt_s * np.arange(LAGS + 1)
    structure = np.zeros(LAGS + 1)
    shape = model.shape_at(x)
    for j, term in enumerate(model.terms):
        size = model.factor(term, bands.channel, share) * float(np.exp(x[j]))
        if term in (NoiseTerm.WHITE, NoiseTerm.CREEP):
            structure += size * lag
        elif term is NoiseTerm.SWAY and size:
            structure += 2.0 * size * (1.0 - oscillator(lag, shape.sway_w, shape.sway_zeta))
    colour = bands.rounding.colour(bands.hz, bands.dt_s, structure)
    flat = sampled_psd(NoiseTerm.QUANTIZATION, bands.hz, bands.dt_s, shape)
    return bands.rounding.variance * bands.mean(colour * flat)


def _gaussian(
    model: TriadModel, x: NDArray, slow: SlowData, share: NDArray
) -> tuple[float, NDArray, NDArray]:
    """The same of slow contrasts; the shape of the sway is left to the bands."""
    shape, w = model.shape_at(x), slow.whole
    parts: dict[int, Covariance] = {}
    for j, term in enumerate(model.terms):
        size = model.factor(term, slow.channel, share) * float(np.exp(x[j]))
        if size and x[j] > ABSENT:
            unit = slow.covariance(*slow.kind(term, shape))
            parts[j] = Covariance(size * unit.slow, size * unit.quick)
    if NoiseTerm.MARKOV in model.terms and model.terms.index(NoiseTerm.MARKOV) in parts:
        at, tau = model.terms.index(NoiseTerm.MARKOV), model.size - 1
        size = model.factor(NoiseTerm.MARKOV, slow.channel, share) * float(np.exp(x[at]))
        there = slow.covariance(NoiseTerm.MARKOV, model.shape_at(_moved(model, x, tau)), keep=False)
        parts[tau] = Covariance(
            (size * there.slow - parts[at].slow) / SHAPE_STEP,
            (size * there.quick - parts[at].quick) / SHAPE_STEP,
        )
    terms = [parts[j] for j in parts if j < len(model.terms)]
    V = np.sum([part.slow for part in terms], axis=0)
    v = np.sum([part.quick for part in terms], axis=0)
    factor, lower = cho_factor(V, lower=True, check_finite=False)
    inverse = cho_solve((factor, lower), np.eye(w), check_finite=False)
    alpha = inverse @ slow.y[:w]
    square = slow.y[w:] ** 2
    value = -float(np.sum(np.log(np.diag(factor)))) - 0.5 * float(slow.y[:w] @ alpha)
    value -= 0.5 * float(np.sum(np.log(v) + square / v))
    gradient, information = np.zeros(x.size), np.zeros((x.size, x.size))
    products = {j: inverse @ part.slow for j, part in parts.items()}
    for j, part in parts.items():
        gradient[j] = 0.5 * float(alpha @ part.slow @ alpha - np.trace(products[j]))
        gradient[j] += 0.5 * float(np.sum(part.quick / v * (square / v - 1.0)))
        for i, other in parts.items():
            both = np.sum(products[i] * products[j].T) + np.sum(part.quick * other.quick / v**2)
            information[i, j] = 0.5 * float(both)
    return value, gradient, information
