"""Noise beyond (or below) what the twin declares, as hypotheses on sums of squares.

Each kind of noise multiplies the expected squares of the whitened data by 1 + q a: a from the
twin's own covariance, q the square of the coefficient, unknown, log-uniform over the usual range
and beyond, or negative where the twin declares more than there is.

Decision: docs/decisions/0024-null-replicates.md.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.fft import dct
from scipy.linalg import solve_triangular

from ins.errors.base import SLOW_NAME, AddedNoise, Effect
from simreal.declared.declared_noise import declared_square
from simreal.evidence.noise_model import ChannelNoise
from simreal.evidence.parked import PARKED_MEAN_S, cholesky_of
from simreal.evidence.whitened import (
    BANDS,
    CHANNELS,
    SENSORS,
    Evidence,
    RunEvidence,
    block_spectrum,
)
from simreal.inference.bank import shapes_of, unit_scale

NOISE_LEVELS = 28
BELOW = (0.05, 0.1, 0.2, 0.4, 0.7, 0.95)  # of the declared noise that is not there
SLOW_LOG_PRIOR = -1.0  # a slow noise is a description, not a cause
# of a slow noise; what is beyond is as small as a hundredth of the first for all of them
SLOW_COMPONENTS = 120
SAME_DIGITS = 3  # of a channel's noise: factors that are the same to a thousandth do as well
# of the length of a run, which is where its flicker ends, an hour's at a frequency of four hours:
# to a digit, so that runs of one plan share what follows; a length 10 % off moves the variance of
# what is constant by 3 % of the flicker's
LENGTH_DIGITS = 1
# of a noise, of which the level is told more finely; chosen: the best and its two neighbours
LIKELIEST_SHAPES = 3
SUMMED_BLOCKS = 12  # blocks of ten seconds that are summed for noise that is not steady


@dataclass(frozen=True)
class Basis:
    """Principal components of a slow noise in a channel's whitened parked rows: first row, vectors
    (bins, k), values (k,).
    """

    first: int
    vectors: NDArray
    values: NDArray


@dataclass(frozen=True)
class Term:
    """Where a noise shows: indices into the squares of an evidence (`Squares`) and the factor a of
    each.

    bases: of a slow noise, whose own principal components see more of it than the cosine transform
    does; they stand for the entries marked `slow` (k,).
    """

    index: NDArray
    factor: NDArray
    slow: NDArray
    bases: tuple[Basis, ...] = ()


@dataclass
class NoiseHypothesis:
    """A noise effect on a target; one term set for each grid point of its shape."""

    name: str
    target: str
    effect: Effect
    log_prior: float
    shapes: list[dict[str, float]]
    terms: list[Term]
    levels: NDArray  # q tried
    run: int | None = None
    named: bool = True
    usual: float = np.inf  # upper end of the usual coefficient, squared
    # what the twin declares of this noise, squared: the most that can be missing
    declared: float = 0.0
    most: float = np.inf  # the largest coefficient that these rows can have, squared

    @property
    def key(self) -> tuple[str, str, int | None]:
        return self.effect.id, self.target, self.run

    def tried(self) -> tuple[NDArray, NDArray]:
        """Squares of the coefficient tried and their log weights; beyond the usual size they fall
        as its inverse.
        """
        below = -self.declared * np.array(BELOW) if self.declared > 0 else np.zeros(0)
        up = len(self.levels)
        weights = np.log((0.8 if below.size else 1.0) / up) - 0.5 * np.log(
            np.maximum(self.levels / self.usual, 1.0)
        )
        return np.concatenate([self.levels, below]), np.concatenate(
            [weights, np.full(below.size, np.log(0.2 / len(BELOW)))]
        )


class Squares:
    """All sums of squares of an evidence: `ratio` (k,) over expectation with `dof` (k,).

    First the cosine transform of each sensor's whitened parked rows, run after run, then scatter
    within ten seconds summed over SUMMED_BLOCKS blocks, then single rows of odometer, GNSS and
    vehicle.
    """

    def __init__(self, evidence: Evidence) -> None:
        self.evidence = evidence
        self.slow: dict[tuple[int, int], NDArray] = {}
        self.quick: dict[tuple[int, int, int], NDArray] = {}
        self.single: dict[tuple[int, int], tuple[NDArray, NDArray]] = {}
        dof, at = [], 0
        for r, run in enumerate(evidence.runs):
            bins = run.parked.bins
            for c in range(SENSORS):
                if run.parked.steady[c]:
                    self.slow[r, c] = at + np.arange(bins)
                    dof.append(np.ones(bins))
                    at += bins
            for c in range(SENSORS + 1):
                for b in range(len(BANDS) + 1):
                    freedom = _coarse(run.scatter.dof[c, b])
                    if freedom.sum() > 0:
                        self.quick[r, c, b] = at + np.arange(freedom.size)
                        dof.append(freedom)
                        at += freedom.size
            own = np.arange(run.z.size) + int(evidence.offsets[r])
            rest = own[SENSORS * bins :]
            for c in range(SENSORS + 1, len(CHANNELS)):
                rows = rest[(evidence.rows.channel[rest] == c) & evidence.rows.steady[rest]]
                if rows.size:
                    self.single[r, c] = (at + np.arange(rows.size), rows)
                    dof.append(np.ones(rows.size))
                    at += rows.size
        self.dof = np.concatenate(dof) if dof else np.zeros(0)
        self.place = self._places()

    def _places(self) -> NDArray:
        """Number of the channel of each entry (k,), what is within ten seconds and single rows
        beyond those of the parked transform.
        """
        out, count = np.zeros(self.dof.size, dtype=int), len(CHANNELS)
        for (_, c), index in self.slow.items():
            out[index] = c
        for (_, c, _), index in self.quick.items():
            out[index] = c + count
        for (_, c), (index, _) in self.single.items():
            out[index] = c + 2 * count
        return out

    def ratio(self, z: NDArray, rng: np.random.Generator | None = None) -> NDArray:
        """Ratios (k, reps) of rows (rows, reps); the scatter is the data's, or drawn where an rng
        is given.
        """
        out = np.ones((self.dof.size, z.shape[1]))
        for (r, c), index in self.slow.items():
            first = int(self.evidence.offsets[r]) + c * index.size
            out[index] = dct(z[first : first + index.size], axis=0, norm="ortho") ** 2
        for (r, c, b), index in self.quick.items():
            if rng is None:
                scatter = self.evidence.runs[r].scatter
                total = _coarse(scatter.ratio[c, b] * scatter.dof[c, b])
                out[index] = (total / np.maximum(self.dof[index], 1e-9))[:, None]
            else:
                freedom = self.dof[index][:, None]
                out[index] = rng.chisquare(
                    np.maximum(freedom, 1e-9), (index.size, z.shape[1])
                ) / np.maximum(freedom, 1e-9)
        for index, rows in self.single.values():
            out[index] = z[rows] ** 2
        return out


def _coarse(values: NDArray) -> NDArray:
    starts = np.arange(0, values.size, SUMMED_BLOCKS)
    return np.asarray(np.add.reduceat(values, starts)) if values.size else values


def _alike(noise: ChannelNoise) -> ChannelNoise:
    """The noise to SAME_DIGITS, so that channels that differ by less share what follows."""
    return replace(
        noise,
        white=_digits(noise.white),
        flicker=_digits(noise.flicker),
        walk=_digits(noise.walk),
        turn_on=_digits(noise.turn_on),
        markov=_digits(noise.markov),
        bounded=_digits(noise.bounded),
        sway=_digits(noise.sway),
        run_s=_digits(noise.run_s, LENGTH_DIGITS),
    )


def _digits(value: float, digits: int = SAME_DIGITS) -> float:
    return float(f"{value:.{digits - 1}e}")


def slow_basis(
    noise: ChannelNoise, added: AddedNoise, bins: int, start_s: float
) -> tuple[NDArray, NDArray]:
    """Principal components (bins, k) and values (k,) of unit added noise in whitened ten-second
    means.
    """
    return _components(_alike(noise), added, bins, start_s)


def slow_factor(noise: ChannelNoise, added: AddedNoise, bins: int, start_s: float) -> NDArray:
    """a (bins,): what unit added noise does to the squares of the transform of whitened ten-second
    means.
    """
    return _squares(_alike(noise), added, bins, start_s)


@lru_cache(maxsize=128)
def _components(
    noise: ChannelNoise, added: AddedNoise, bins: int, start_s: float
) -> tuple[NDArray, NDArray]:
    C = _whitened(noise, added, bins, start_s)
    values, vectors = np.linalg.eigh(0.5 * (C + C.T))
    last = slice(None, -SLOW_COMPONENTS - 1, -1)
    return np.ascontiguousarray(vectors[:, last]), np.maximum(values[last], 0.0)


@lru_cache(maxsize=512)
def _squares(noise: ChannelNoise, added: AddedNoise, bins: int, start_s: float) -> NDArray:
    if added == AddedNoise(added.channel, white=added.white):  # independent from bin to bin
        DM = _whitened_cosines(noise, bins, start_s)
        return np.asarray(added.white / PARKED_MEAN_S * np.sum(DM**2, axis=1))
    D = _cosines(bins)
    return np.asarray(np.sum((D @ _whitened(noise, added, bins, start_s)) * D, axis=1))


@lru_cache(maxsize=16)
def _whitened_cosines(noise: ChannelNoise, bins: int, start_s: float) -> NDArray:
    return np.asarray(_cosines(bins) @ _inverse_root(noise, bins, start_s))


@lru_cache(maxsize=8)
def _cosines(bins: int) -> NDArray:
    """The cosine transform as a matrix."""
    return np.asarray(dct(np.eye(bins), axis=0, norm="ortho"))


@lru_cache(maxsize=16)
def _inverse_root(noise: ChannelNoise, bins: int, start_s: float) -> NDArray:
    L = cholesky_of(noise, bins, start_s)
    return np.asarray(solve_triangular(L, np.eye(bins), lower=True, check_finite=False))


@lru_cache(maxsize=16)
def _whitened(noise: ChannelNoise, added: AddedNoise, bins: int, start_s: float) -> NDArray:
    M = _inverse_root(noise, bins, start_s)
    return np.asarray(M @ noise.only(added).covariance(bins, PARKED_MEAN_S, start_s) @ M.T)


@lru_cache(maxsize=512)
def quick_factor(noise: ChannelNoise, added: AddedNoise, rows: int, row_dt_s: float) -> NDArray:
    """a (bands,) of the scatter within ten seconds."""
    more, base = block_spectrum(noise.only(added)), block_spectrum(noise)
    bands = [float((more[a:b] / base[a:b]).mean()) for a, b in BANDS]
    scatter, _ = noise.scatter(rows, row_dt_s)
    return np.array(
        [*bands, noise.only(added).scatter(rows, row_dt_s)[0] / scatter if scatter > 0 else 0.0]
    )


def noise_hypotheses(
    evidence: Evidence, squares: Squares, effects: Sequence[Effect]
) -> list[NoiseHypothesis]:
    """All stochastic effects that these runs can show."""
    out = []
    telemetry = [view.telemetry for view in evidence.views]
    row_dt_s = max(view.seconds.row_dt_s for view in evidence.views)
    for effect in effects:
        most = float(getattr(effect, "most", lambda _: np.inf)(row_dt_s)) ** 2
        for target in effect.targets:
            if effect.needs(telemetry, target):
                continue
            if not effect.noise(telemetry[0], target, shapes_of(effect, telemetry[0])[0]):
                continue
            coefficient = effect.coefficients[-1]
            scale = unit_scale(effect, target, evidence)
            levels = (
                np.geomspace(
                    0.02 * scale * coefficient.low, 100.0 * scale * coefficient.high, NOISE_LEVELS
                )
                ** 2
            )
            event = effect.repeats == "E"
            prior = (SLOW_LOG_PRIOR if effect.name == SLOW_NAME else 0.0) - event * np.log(
                len(telemetry)
            )
            for run in range(len(telemetry)) if event else (None,):
                shapes = shapes_of(effect, telemetry[run or 0])
                terms = [term_of(evidence, squares, effect, target, shape, run) for shape in shapes]
                usual = float((scale * coefficient.high) ** 2)
                declared = declared_square(evidence.twin, effect.id)
                out.append(
                    NoiseHypothesis(
                        effect.name,
                        target,
                        effect,
                        float(prior),
                        shapes,
                        terms,
                        levels[levels <= most],
                        run,
                        most=most,
                        usual=usual,
                        declared=declared,
                    )
                )
    return out


def term_of(
    evidence: Evidence,
    squares: Squares,
    effect: Effect,
    target: str,
    shape: dict[str, float],
    only: int | None = None,
) -> Term:
    """Where a noise effect shows and how much, per unit of its coefficient squared; only: the run
    of an event.
    """
    index, factor, slow, bases = [], [], [], []
    for r, run in enumerate(evidence.runs):
        for added in (
            () if only not in (None, r) else effect.noise(run.view.telemetry, target, shape)
        ):
            basis = _basis(evidence, squares, r, added)
            bases += [] if basis is None else [basis]
            for part, (where, a) in enumerate(_factors(squares, r, run, added)):
                index.append(where)
                factor.append(a)
                slow.append(np.full(where.size, basis is not None and part == 0))
    if not index:
        return Term(np.zeros(0, int), np.zeros(0), np.zeros(0, bool))
    return Term(np.concatenate(index), np.concatenate(factor), np.concatenate(slow), tuple(bases))


def _basis(evidence: Evidence, squares: Squares, r: int, added: AddedNoise) -> Basis | None:
    """Principal components of noise that is slow: flicker, random walk, Markov."""
    c, parked = CHANNELS.index(added.channel), evidence.runs[r].parked
    if not (added.flicker or added.walk or added.markov) or (r, c) not in squares.slow:
        return None
    vectors, values = slow_basis(parked.noise[c], added, parked.bins, parked.start_s)
    return Basis(int(evidence.offsets[r]) + c * parked.bins, vectors, values)


def observed(
    term: Term, squares: Squares, ratio: NDArray, z: NDArray
) -> tuple[NDArray, NDArray, NDArray]:
    """Degrees of freedom (k,), squares over expectation (k, reps) and factors (k,) of a noise; z
    (rows, reps).
    """
    rest = ~term.slow if term.bases else np.ones(term.index.size, bool)
    n, y, a = [squares.dof[term.index[rest]]], [ratio[term.index[rest]]], [term.factor[rest]]
    for basis in term.bases:
        rows = z[basis.first : basis.first + len(basis.vectors)]
        y.append((basis.vectors.T @ rows) ** 2)
        a.append(basis.values)
        n.append(np.ones(basis.values.size))
    return np.concatenate(n), np.concatenate(y), np.concatenate(a)


def _factors(
    squares: Squares, r: int, run: RunEvidence, added: AddedNoise
) -> list[tuple[NDArray, NDArray]]:
    c = CHANNELS.index(added.channel)
    out = []
    if c >= SENSORS:
        if (r, c) in squares.single and not squares.evidence.parked_only:
            index, rows = squares.single[r, c]
            variance = run.rows(r).variance[rows - int(squares.evidence.offsets[r])]
            out.append((index, added.sample / (_samples(run, added.channel) * variance)))
        if (r, c, 0) in squares.quick:  # the thermometer
            read = run.twin.temperature
            a = added.sample / (read.noise_degC**2 + read.resolution_degC**2 / 12.0)
            index = squares.quick[r, c, 0]
            out.append((index, np.full(index.size, a)))
        return out
    noise, steady = run.parked.noise[c], AddedNoise(**{**added.__dict__, "profile": None})
    start_s = run.parked.start_s
    mean_profile, coarse = 1.0, None
    if added.profile is not None:
        blocks = added.profile[run.parked.seconds].reshape(run.parked.bins, -1).mean(axis=1)
        mean_profile = float(blocks.mean())
        coarse = _coarse(blocks) / np.maximum(_coarse(np.ones(blocks.size)), 1)
    if (r, c) in squares.slow:
        index = squares.slow[r, c]
        out.append((index, mean_profile * slow_factor(noise, steady, index.size, start_s)))
    bands = quick_factor(
        noise, steady, int(np.median(run.view.seconds.rows)), run.view.seconds.row_dt_s
    )
    for b, a in enumerate(bands):
        if (r, c, b) in squares.quick:
            index = squares.quick[r, c, b]
            out.append((index, a * (np.ones(index.size) if coarse is None else coarse)))
    return out


def _samples(run: RunEvidence, channel: str) -> float:
    """Samples of a stream in a second: a row of the odometer is a way over one."""
    log = run.view.run.odometer if channel == "odometer" else None
    return 1.0 if log is None else max(1.0 / float(np.median(np.diff(log.time_s))), 1.0)


def log_bf(
    hypothesis: NoiseHypothesis, squares: Squares, ratio: NDArray, z: NDArray
) -> tuple[NDArray, NDArray]:
    """Log Bayes factors (shapes, reps) and the best q (shapes, reps) of a noise; ratio (k, reps), z
    (rows, reps).
    """
    scores, best = np.zeros((2, len(hypothesis.terms), ratio.shape[1]))
    tried, weights = hypothesis.tried()
    last, seen = None, {}
    for k, term in enumerate(hypothesis.terms):
        if last is not None and not term.bases and np.array_equal(term.index, last.index):
            a = term.factor  # what is seen is the same, as much of it is not
        else:
            n, y, a = observed(term, squares, ratio, z)
        last = None if term.bases else term
        if not a.size or hypothesis.levels[-1] * float(a.max()) < 1e-3:
            continue
        fits = _fits(n, y, 1.0 + np.outer(tried, a))
        scores[k] = np.logaddexp.reduce(fits + weights[:, None], axis=0)
        best[k] = tried[np.argmax(fits, axis=0)]
        seen[k] = n, y, a, fits[:, 0]
    if ratio.shape[1] == 1:
        for k in sorted(seen, key=lambda k: -scores[k, 0])[:LIKELIEST_SHAPES]:
            finer = _between(*seen[k], tried[: hypothesis.levels.size], weights)
            scores[k, 0], best[k, 0] = finer or (scores[k, 0], best[k, 0])
    return scores, best


def _between(
    n: NDArray, y: NDArray, a: NDArray, fits: NDArray, levels: NDArray, weights: NDArray
) -> tuple[float, float] | None:
    """Log Bayes factor and best level of one set of data, on finer grids about the best level until
    its neighbours do as well to a nat: what is loud knows its level better than the scan has it.
    None where the scan is fine enough.
    """
    at, found = int(np.argmax(fits)), None
    if not 0 < at < levels.size - 1:
        return None
    step, level, weight = float(np.log(levels[1] / levels[0])), float(levels[at]), weights[at]
    while fits[at] - max(fits[max(at - 1, 0)], fits[min(at + 1, fits.size - 1)]) > 1.0:
        step, weight = step / 4.0, weight - np.log(4.0)
        finer = level * np.exp(step * np.arange(-4.0, 5.0))
        fits = _fits(n, y, 1.0 + np.outer(finer, a))[:, 0]
        at = int(np.argmax(fits))
        level = float(finer[at])
        found = float(np.logaddexp.reduce(fits + weight)), level
    return found


def _fits(n: NDArray, y: NDArray, s: NDArray) -> NDArray:
    """Log likelihood ratios (levels, reps) of scaling the expected squares by s (levels, k): n/2 (y
    (1 - 1/s) - ln s).
    """
    s = np.maximum(s, 1e-3)
    return np.asarray((0.5 * n * (1.0 - 1.0 / s)) @ y - 0.5 * (np.log(s) @ n)[:, None])
