"""Which terms of a triad's noise the data show, how well, and what recording would show the
rest.

Decision: docs/decisions/0034-flicker-walk.md.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ins.robust import chi2
from ins.units import HOUR
from simreal.twin.fit.gear import GEAR_BELOW_HZ, Gear, flat_above, rocked, without_gear
from simreal.twin.fit.model import (
    PRIOR_SIGMA,
    ROUGHLY,
    NoiseEstimate,
    TriadEvidence,
    TriadModel,
    band_model,
    climb,
    derivatives,
    rounding_power,
)
from simreal.twin.fit.rounding import SIGMA_OF_GRID
from simreal.twin.fit.spectra import Bands, below_hz
from simreal.twin.fit.terms import NoiseTerm, sampled_psd, sway_folded

# of a log variance, 0.25 of the size: beyond, normal limits hold the truth in less than 92 %
# (chi-square with fewer than 8 degrees of freedom)
IDENTIFIED_SIGMA = 0.5
# of a log variance, at its lower 99.5 % limit: with IDENTIFIED_SIGMA at its value a term would be
# unknown (sigma 1) there, where its bound says that nobody can tell it
SMALLEST_SIGMAS, STILL_SIGMA = 2.58, 0.8
BELIEVED_SIGMA = 2.0 * np.log(3.0)  # of what the data do not tell: a factor 3 of the size
# of the log likelihood at the upper end of a two-sided 95 % interval. A one-sided 95 % limit would
# do for a term that is never told; but where chance makes it small it is not told, where chance
# makes it large it has a two-sided interval: both together would hold 92.5 %
LIMIT_DROP = 0.5 * float(chi2.ppf(0.95, 1))
LIMIT_STEPS, LIMIT_WITHIN = 10, 0.3  # of a log variance: 15 % of a limit
SCORE = 2.5  # sigmas: below, a Markov process cannot win 2 nats and more
LITTLE = 1e-3  # of the flicker
# relative: runs whose quanta differ by more are not of one grid, which 32-bit readings tell to 1e-7
ONE_GRID = 1e-4
# of the errors of neighbouring rows: beyond, 4 quanta in 22 row sigmas, they are no normal noise
COMB_ALIKE = 0.5
# Markov processes of gyros are no faster than 50 s (docs/reference/effects.md, G25), filters of
# rows no slower than a second
FILTERED_S = 5.0
# chosen: a filter below takes more than a tenth out of the means of seconds (0.8 of one pole at
# 1 Hz is left at 0.5 Hz), which no narrower band of rows would mend
LOWEST_BAND_HZ = 1.0
# of its power, from a band to its half; what a filter takes out of a band goes with the square of
# its width, so that a third of it is still missing: 1.7 % of a random walk
WHITE_STAYS = 0.1
# of the expected power in the upper half of the rows' band: a pole at twice the highest frequency
# leaves 0.87 there, one at the highest 0.65
FALLS = 0.8
COMB = 0.1  # of a band's power: what a comb may leave there is 10 % off at worst, of 10 %
# times the power expected of a comb, whose bands scatter more than noise; of rows rounded one by
# one less than 0.5 is there (tests/simreal/test_twin_rounding.py)
SUMS_WITHIN = 1.5
COARSE_ROUNDS = 3  # the white noise says which bands are combs, and these what it is
FEW_DOF = 20.0  # of a band whose power is known to 0.22
DISAGREES = 8.0  # nats: 4 sigmas of a quantum that the spectra see otherwise
TAUS_S = (30.0, 300.0, 2000.0)  # where a Markov process is looked for
PARKED_HOURS = (0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0, 128.0)
NEVER_S = float("inf")
LOWEST_CYCLES = 1.5  # in a recording: what is slower went with its constant
BOUND_POINTS = 400  # frequencies
# of a log variance: a factor e^500 of the size, with which a term is nowhere in the spectrum
NOWHERE_SIGMA = 1e3
# of a correlation of two terms short of 1, to which round-off leaves a matrix its inverse
LEAST_APART = 1e-10
# probability that like axes are called unlike: 1 fit in 10,000, for the triad is then not one
AXES_DIFFER_P = 1e-4
AXIS_SIGMA = 0.2  # of an axis's own log variance: beyond 0.1 of its size the triad's is taken
# chosen: a white floor over 8 times its lowest frequency, above the slow noise of 1 s and longer
PLATEAU_OCTAVES, PLATEAU_ABOVE_HZ = 3, 1.0
# of the power, from the lowest to the highest octave: flicker of a tenth of the white noise in the
# first changes it by 0.07, a pole at twice the last by 0.2
PLATEAU_LEANS = 0.2


@dataclass(frozen=True)
class TermEstimate:
    """What the data say of one term, in log variance.

    value, sigma: of the twin that is written; low, high: 95 %; nats: log likelihood against none of
    it; upper: 97.5 % limit; needed_s: parked seconds in one run that would identify it;
    hidden: by the rounding of rows.
    """

    term: NoiseTerm
    value: float
    sigma: float
    low: float
    high: float
    nats: float
    identified: bool
    upper: float
    needed_s: float
    hidden: bool = False


@dataclass(frozen=True)
class TriadFit:
    """The terms of a triad, its best model, and the fit behind it; differ: p-value that its axes
    are alike; axes: of each axis, fitted alone; band_hz: up to which the rows were read, where a
    filter takes noise out of them above; gear: the channels of which nothing below
    GEAR_BELOW_HZ was read, for the vehicle moved on its gear; contradicted: by the data, by far.
    """

    told: tuple[TermEstimate, ...]
    fitted: NoiseEstimate
    differ_p: float
    axes: Mapping[int, NoiseEstimate]
    used_s: float
    band_hz: float | None = None
    gear: Gear = frozenset()
    contradicted: bool = False

    def of(self, term: NoiseTerm) -> TermEstimate | None:
        return next((t for t in self.told if t.term is term), None)

    def read(self, evidence: TriadEvidence) -> TriadEvidence:
        """The bands that the fit has read count, no others."""
        return without_gear(below(evidence, self.band_hz or np.inf), self.gear)


def fit_triad(
    evidence: TriadEvidence,
    model: TriadModel,
    dt_s: float,
    used_s: float,
    contradicted: Callable[[NoiseEstimate, TriadEvidence], bool],
) -> TriadFit:
    """The noise of a triad. dt_s: of its rows; used_s: parked seconds, all runs; contradicted:
    whether the data contradict a fit by far. No term of such a fit is asked for: its numbers would
    say nothing.
    """

    def unlike(best: NoiseEstimate, evidence: TriadEvidence) -> bool:
        return not best.model.hidden and (
            _like_a_filter(best) or contradicted(best, evidence) or _falls(evidence, model)
        )

    best, used, differ_p, axes = _best(evidence, model)
    band_hz, gear = None, rocked(used, best)
    moved = bool(gear)
    if moved:
        quiet = without_gear(evidence, gear)
        at_rest = _best(quiet, model)
        if unlike(at_rest[0], quiet):
            gear = Gear()
        else:
            best, used, differ_p, axes = at_rest
    if not gear and (moved or unlike(best, evidence)):
        band_hz = _unfiltered_band(evidence, model)
        if band_hz is not None:
            best, used, differ_p, axes = _best(below(evidence, band_hz), model)
        if (
            band_hz is None
            or contradicted(best, evidence)
            or _like_a_filter(best)
            or rocked(used, best)
        ):
            unsaid = tuple(_unsaid(best, term) for term in best.model.terms)
            return TriadFit(unsaid, best, differ_p, axes, used_s, contradicted=True)
    evidence = used
    count = max(sum(s.y.size for _, s in evidence.slow), 8)
    channels = len({b.channel for _, b in evidence.bands}) or 1
    told = []
    for term in best.model.terms:
        told.append(_tell(evidence, best, term, 0.5 * float(np.log(count))))
    kept = {t.term for t in told if t.identified}
    last = _last_model(best.model, kept)
    final = climb(evidence, last, _carried(best, last))
    told = [_final(t, final, dt_s=dt_s, used_s=used_s, channels=channels) for t in told]
    if band_hz is not None or (gear and _only_above_gear(evidence)):
        told = [_beside_filter(t) if t.term is NoiseTerm.WHITE else t for t in told]
    return TriadFit(tuple(told), final, differ_p, axes, used_s, band_hz, gear)


def _best(
    evidence: TriadEvidence, model: TriadModel
) -> tuple[NoiseEstimate, TriadEvidence, float, Mapping[int, NoiseEstimate]]:
    """The best model with all terms, what it was fitted to, the p-value that the axes are alike,
    and each axis alone.
    """
    first = climb(evidence, model)
    if NoiseTerm.SWAY in model.terms:
        evidence = _counted_once(evidence, first)
        first = climb(evidence, model, first.x)
    best, evidence = _counted(evidence, first)
    best = _with_markov(evidence, best)
    differ_p, axes, ratios = _axes(evidence, best)
    if ratios:
        told_apart = replace(best.model, ratios=ratios)
        if NoiseTerm.CREEP in told_apart.terms:
            told_apart = told_apart.without(NoiseTerm.CREEP)
        best = climb(evidence, told_apart)
    return best, evidence, differ_p, axes


def _like_a_filter(best: NoiseEstimate) -> bool:
    """Whether a Markov process stands for noise that was white before a filter."""
    if NoiseTerm.MARKOV not in best.model.terms:
        return False
    tau_s = best.model.shape_at(best.x).tau_s
    plateau = best.log_variance(NoiseTerm.MARKOV) + np.log(2.0 * tau_s)
    return bool(tau_s < FILTERED_S and plateau > best.log_variance(NoiseTerm.WHITE))


def _unfiltered_band(evidence: TriadEvidence, model: TriadModel) -> float | None:
    """The frequency up to which the rows show white noise where a filter takes it away above, by
    halves of the whole band; None where nothing falls below what the rest of the data explain.
    """
    top_hz = _top_hz(evidence)
    if top_hz < 4.0 * LOWEST_BAND_HZ or not _falls_below(evidence, model, LOWEST_BAND_HZ):
        return None
    white, band_hz = -np.inf, 0.5 * top_hz
    while band_hz >= LOWEST_BAND_HZ:
        found = climb(below(evidence, band_hz), model).log_variance(NoiseTerm.WHITE)
        if found - white < np.log(1.0 + WHITE_STAYS):
            return band_hz
        white, band_hz = found, 0.5 * band_hz
    return None


def _top_hz(evidence: TriadEvidence) -> float:
    """The highest frequency of the rows."""
    return max((float(b.hz.max()) for _, b in evidence.bands), default=0.0)


def _falls(evidence: TriadEvidence, model: TriadModel) -> bool:
    """Whether a filter has taken noise out of the upper half of the rows' band."""
    if _only_above_gear(evidence):
        return not flat_above(evidence)
    return _falls_below(evidence, model, 0.25 * _top_hz(evidence))


def _only_above_gear(evidence: TriadEvidence) -> bool:
    """Whether nothing is read below the frequencies of a vehicle on its gear."""
    lowest = min((float(b.centre_hz[b.dof > 0].min(initial=np.inf)) for _, b in evidence.bands))
    return lowest > GEAR_BELOW_HZ


def _falls_below(evidence: TriadEvidence, model: TriadModel, hz: float) -> bool:
    """Whether most channels show less noise in the upper half of the rows' band than a fit to what
    lies below a frequency leads one to expect.
    """
    fitted = climb(below(evidence, hz), model)
    ratios: dict[int, list[tuple[float, float]]] = {}
    for k, b in evidence.bands:
        upper = (b.centre_hz > 0.5 * b.hz.max()) & (b.dof > 0) & (b.dt_s < 1.0)
        if upper.any():
            S, _ = band_model(fitted.model, fitted.x, (), b, evidence.share[k])
            freedom = float(b.dof[upper].sum())
            ratio = float(b.dof[upper] @ (b.power[upper] / S[upper])) / freedom
            ratios.setdefault(b.channel, []).append((ratio, freedom))
    falls = [np.average([r for r, _ in of], weights=[n for _, n in of]) for of in ratios.values()]
    return bool(falls) and float(np.median(falls)) < FALLS


def _beside_filter(white: TermEstimate) -> TermEstimate:
    """White noise with what a filter may still take out of the band that was read."""
    sigma = float(np.hypot(white.sigma, WHITE_STAYS / 3.0))
    wider = 1.96 * (sigma - white.sigma)
    return replace(white, sigma=sigma, low=white.low - wider, high=white.high + wider)


def below(evidence: TriadEvidence, hz: float) -> TriadEvidence:
    """The evidence less the bands above a frequency."""
    return replace(evidence, bands=tuple((k, below_hz(b, hz)) for k, b in evidence.bands))


def _counted_once(evidence: TriadEvidence, fitted: NoiseEstimate) -> TriadEvidence:
    """The evidence with bands of means counting for less by what folds into them of a quick sway:
    the rows have shown that part already.
    """
    model, x = fitted.model, fitted.x
    at, shape = model.terms.index(NoiseTerm.SWAY), model.shape_at(fitted.x)
    finest = min((b.dt_s for _, b in evidence.bands), default=0.0)
    kept = []
    for k, bands in evidence.bands:
        if bands.dt_s > finest:
            S, parts = band_model(model, x, (), bands, evidence.share[k])
            folded = bands.mean(sway_folded(bands.hz, bands.dt_s, shape))
            bands = replace(bands, dof=bands.dof * (1.0 - parts[at] / S * folded))
        kept.append((k, bands))
    return replace(evidence, bands=tuple(kept))


def _last_model(model: TriadModel, kept: set[NoiseTerm]) -> TriadModel:
    """The model that a twin is written from: what is not told is held to what was believed, and
    left out where nobody believed in it, for its share would be missing elsewhere.
    """
    for term in model.unbelieved - kept:
        if term in model.terms and not model.on_grid:
            model = model.without(term)
    believed = [PRIOR_SIGMA if t in kept else BELIEVED_SIGMA for t in model.terms]
    return replace(model, width=np.minimum(model.width, believed))


def _carried(found: NoiseEstimate, model: TriadModel) -> NDArray:
    """Parameters of a model with fewer terms where another was highest: from what was believed a
    large sway leads to another summit.
    """
    terms = [found.log_variance(term) for term in model.terms]
    return np.concatenate([terms, found.x[len(found.model.terms) :]])


def _counted(evidence: TriadEvidence, free: NoiseEstimate) -> tuple[NoiseEstimate, TriadEvidence]:
    """The fit with the quantum of the grid on which all channels lie, where their noise agrees that
    it is their sums that are rounded; else the fit as it was. Where steps are far above the noise,
    without the bands that rounding makes: its error is a comb there, and no normal one.
    """
    quanta = _quanta(evidence)
    if not quanta:
        return free, evidence
    model = free.model
    k, white = model.terms.index(NoiseTerm.QUANTIZATION), model.terms.index(NoiseTerm.WHITE)
    level = float(np.mean(np.square(list(quanta.values()))))
    centre, width = model.centre.copy(), model.width.copy()
    centre[k] = np.log(level / 12.0)
    width[k] = SIGMA_OF_GRID
    ratios = {(NoiseTerm.QUANTIZATION, c): q**2 / level for c, q in quanta.items()}
    grid = replace(model, centre=centre, width=width, ratios=ratios, on_grid=True)
    start = free.x.copy()
    start[k] = centre[k]
    start[white] = min(start[white], np.log(_lowest_power(evidence)))
    found, kept = climb(evidence, grid, start), evidence
    if _steps_alike(kept, start[white]):
        start[white] = np.log(_lowest_power(evidence))
        for _ in range(COARSE_ROUNDS):
            kept = _without_combs(evidence, grid, start)
            found = climb(kept, grid, start)
            start = found.x
        free = climb(kept, model, free.x)
    agrees = found.log_likelihood > free.log_likelihood - DISAGREES
    if agrees and (kept is evidence or _shows_sums(evidence, found)):
        return found, kept
    hidden = any(b.rounding is not None and b.rounding.hides_rows for _, b in evidence.bands)
    return replace(free, model=replace(model, hidden=hidden)), evidence


def _shows_sums(evidence: TriadEvidence, found: NoiseEstimate) -> bool:
    """Whether the rows show, in the upper half of their frequencies, the power of rounded sums:
    rows that are rounded one by one show as much everywhere, and too little there.
    """
    finest = min(b.dt_s for _, b in evidence.bands)
    for k, bands in evidence.bands:
        upper = bands.centre_hz > 0.25 / bands.dt_s
        if bands.dt_s == finest and upper.any():
            model = band_model(found.model, found.x, (), bands, evidence.share[k])[0]
            ratio = float(bands.power[upper].sum() / model[upper].sum())
            if not 1.0 / SUMS_WITHIN < ratio < SUMS_WITHIN:
                return False
    return True


def _quanta(evidence: TriadEvidence) -> dict[int, float]:
    """The quantum of each channel; empty where one lies on no grid, or runs differ."""
    quanta: dict[int, float] = {}
    for _, bands in evidence.bands:
        if bands.rounding is None:
            return {}
        first = quanta.setdefault(bands.channel, bands.rounding.quantum)
        if abs(bands.rounding.quantum / first - 1.0) > ONE_GRID:
            return {}
    return quanta


def _lowest_power(evidence: TriadEvidence) -> float:
    """The least that a band shows: white noise is hardly above it."""
    shown = [b.power[b.dof > FEW_DOF] for _, b in evidence.bands]
    lowest = [float(p.min()) for p in shown if p.size]
    return min(lowest) if lowest else min(float(b.power.min()) for _, b in evidence.bands)


def _steps_alike(evidence: TriadEvidence, white: float) -> bool:
    """Whether the errors of counting are alike from row to row."""
    return any(_alike(b, white) > COMB_ALIKE for _, b in evidence.bands)


def _alike(bands: Bands, white: float) -> float:
    return bands.rounding.alike(np.exp(white) * bands.dt_s) if bands.rounding else 0.0


def _without_combs(evidence: TriadEvidence, model: TriadModel, x: NDArray) -> TriadEvidence:
    """The evidence less the bands that counting makes."""
    kept = [(k, without_comb(b, model, x, evidence.share[k])) for k, b in evidence.bands]
    return replace(evidence, bands=tuple(kept))


def without_comb(bands: Bands, model: TriadModel, x: NDArray, share: NDArray) -> Bands:
    """The bands less those that counting makes, where its errors are alike from row to row."""
    if _alike(bands, float(x[model.terms.index(NoiseTerm.WHITE)])) <= COMB_ALIKE:
        return bands
    part = rounding_power(model, x, bands, share) / band_model(model, x, (), bands, share)[0]
    return replace(bands, dof=np.where(part > COMB, 0.0, bands.dof))


def _with_markov(evidence: TriadEvidence, best: NoiseEstimate) -> NoiseEstimate:
    """The fit with a Markov process, where its two parameters are worth it."""
    slow = sum(s.y.size for _, s in evidence.slow)
    if slow == 0:
        return best
    model = best.model
    flicker = model.terms.index(NoiseTerm.FLICKER) if NoiseTerm.FLICKER in model.terms else 0
    penalty = float(np.log(slow)) + 2.0
    found = best
    for tau_s in TAUS_S:
        wider = replace(
            model,
            terms=(*model.terms, NoiseTerm.MARKOV),
            centre=np.append(model.centre, model.centre[flicker]),
            width=np.append(model.width, PRIOR_SIGMA),
            shape=replace(model.shape, tau_s=tau_s),
        )
        start = np.concatenate(
            [
                best.x[: len(model.terms)],
                [best.x[flicker]],
                best.x[len(model.terms) :],
                [np.log(tau_s)],
            ]
        )
        if _score(evidence, wider, start) < SCORE:
            continue
        trial = climb(evidence, wider, start)
        if trial.log_likelihood > max(best.log_likelihood + penalty, found.log_likelihood):
            found = trial
    return found


def _score(evidence: TriadEvidence, model: TriadModel, x: NDArray) -> float:
    """How many sigmas the likelihood rises with a little of the last term, all others following."""
    k = len(model.terms) - 1
    x = x.copy()
    x[k] += np.log(LITTLE)
    _, gradient, information = derivatives(evidence, model, x)
    others = np.setdiff1d(np.arange(len(model.terms) + len(model.shapes) - 1), [k])
    cross = information[k, others]
    gain = np.linalg.pinv(information[np.ix_(others, others)])
    slope = gradient[k] - cross @ gain @ gradient[others]
    curve = information[k, k] - cross @ gain @ cross
    return float(slope / np.sqrt(max(float(curve), 1e-300)))


def _axes(
    evidence: TriadEvidence, best: NoiseEstimate
) -> tuple[float, dict[int, NoiseEstimate], dict[tuple[NoiseTerm, int], float]]:
    """Whether the axes are alike (p-value), each axis fitted alone, and the ratios of their white
    noise where they are not.
    """
    channels = sorted({b.channel for _, b in evidence.bands})
    creep = best.model.creep_channel if NoiseTerm.CREEP in best.model.terms else None
    judged = [c for c in channels if c != creep]
    if len(judged) < 2:
        return 1.0, {}, {}
    alone: dict[int, NoiseEstimate] = {}
    for c in channels:
        model = best.model.without(NoiseTerm.CREEP) if creep is not None else best.model
        keep = [k for k, t in enumerate(best.model.terms) if t is not NoiseTerm.CREEP]
        keep += range(len(best.model.terms), best.model.size)
        alone[c] = climb(evidence.of((c,)), model, best.x[keep])
    together = climb(evidence.of(judged), alone[judged[0]].model, alone[judged[0]].x)
    gain = sum(alone[c].log_likelihood for c in judged) - together.log_likelihood
    freedom = (len(judged) - 1) * len(together.model.terms)
    p = float(chi2.sf(max(2.0 * gain, 0.0), freedom))
    if p > AXES_DIFFER_P:
        return p, alone, {}
    ratios: dict[tuple[NoiseTerm, int], float] = {}
    for term in (NoiseTerm.WHITE, NoiseTerm.QUANTIZATION):
        if term not in together.model.terms:
            continue
        known = {c: f.log_variance(term) for c, f in alone.items() if f.sigma(term) < AXIS_SIGMA}
        if len(known) < 2:
            continue
        level = float(np.mean(np.exp(list(known.values()))))
        ratios |= {(term, c): float(np.exp(v)) / level for c, v in known.items()}
    return p, alone, ratios


def _unsaid(best: NoiseEstimate, term: NoiseTerm) -> TermEstimate:
    """A term of a fit that the data contradict."""
    value, sigma = best.log_variance(term), best.sigma(term)
    return TermEstimate(
        term=term,
        value=value,
        sigma=sigma,
        low=-np.inf,
        high=value + 1.96 * sigma,
        nats=0.0,
        identified=False,
        upper=value + 1.96 * sigma,
        needed_s=NEVER_S,
    )


def _tell(
    evidence: TriadEvidence, best: NoiseEstimate, term: NoiseTerm, penalty: float
) -> TermEstimate:
    """One term against its absence."""
    k = best.model.terms.index(term)
    value, sigma = float(best.x[k]), best.sigma(term)
    nats = np.inf
    counted = term is NoiseTerm.QUANTIZATION and best.model.on_grid
    if counted or (term is not NoiseTerm.WHITE and not (sigma < 0.1 * IDENTIFIED_SIGMA)):
        keep = np.delete(np.arange(best.x.size), k)
        less = best.model.without(term)
        if less.size == keep.size:
            nats = (
                best.log_likelihood
                - climb(evidence, less, best.x[keep], within=ROUGHLY).log_likelihood
            )
    hidden = best.model.hidden and term in (NoiseTerm.WHITE, NoiseTerm.QUANTIZATION)
    identified = nats > penalty and sigma < IDENTIFIED_SIGMA and not hidden
    identified = identified and _holds(evidence, best, k, sigma)
    upper = value + 1.96 * sigma if identified else _upper(evidence, best, k)
    return TermEstimate(
        term=term,
        value=value,
        sigma=sigma,
        low=value - 1.96 * sigma,
        high=value + 1.96 * sigma,
        nats=float(nats),
        identified=bool(identified),
        upper=upper,
        needed_s=NEVER_S,
        hidden=hidden,
    )


def _holds(evidence: TriadEvidence, best: NoiseEstimate, k: int, sigma: float) -> bool:
    """Whether a term would be known as well where it is as small as it may be: what chance makes
    large looks better known than it is.
    """
    if sigma < 0.1 * IDENTIFIED_SIGMA:
        return True
    x = best.x.copy()
    x[k] -= SMALLEST_SIGMAS * sigma
    _, _, information = derivatives(evidence, best.model, x)
    smaller = replace(best, x=x, information=information)
    return smaller.sigma(best.model.terms[k]) < STILL_SIGMA


def _upper(evidence: TriadEvidence, best: NoiseEstimate, k: int) -> float:
    """The log variance at which the profile likelihood has fallen to its 97.5 % limit."""
    x = best.x.copy()
    step = 2.0
    low, high = float(x[k]), np.inf
    top = best.log_likelihood
    for _ in range(LIMIT_STEPS):
        trial = low + step if not np.isfinite(high) else 0.5 * (low + high)
        x[k] = trial
        found = climb(evidence, best.model, x, fixed=(k,), within=ROUGHLY)
        top = max(top, found.log_likelihood)
        if top - found.log_likelihood > LIMIT_DROP:
            high = trial
        else:
            low, x = trial, found.x.copy()
        if high - low < LIMIT_WITHIN:
            break
    return float(high if np.isfinite(high) else low)


def _final(
    told: TermEstimate, final: NoiseEstimate, *, dt_s: float, used_s: float, channels: int
) -> TermEstimate:
    """What the twin is given, and the recording that would tell what these did not."""
    if told.term not in final.model.terms:
        return replace(told, low=-np.inf, high=told.upper, value=min(told.value, told.upper))
    value, sigma = final.log_variance(told.term), final.sigma(told.term)
    if told.identified:
        return replace(
            told,
            value=value,
            sigma=sigma,
            low=value - 1.96 * sigma,
            high=value + 1.96 * sigma,
            needed_s=used_s,
        )
    value = min(value, told.upper)
    needed = needed_s(final, told.term, dt_s, channels=channels, longer_s=used_s)
    return replace(told, value=value, sigma=sigma, low=-np.inf, high=told.upper, needed_s=needed)


def needed_s(
    fitted: NoiseEstimate, term: NoiseTerm, dt_s: float, *, channels: int = 3, longer_s: float = 0.0
) -> float:
    """The shortest of PARKED_HOURS, in seconds, in which the bound on this term's sigma passes;
    infinite where none does. longer_s: of recordings that did not tell it.
    """
    for hours in PARKED_HOURS:
        if hours * HOUR <= longer_s:
            continue
        bound = bound_sigma(fitted.model, fitted.x, dt_s, hours * HOUR, channels=channels)
        if bound[fitted.model.terms.index(term)] < 0.8 * IDENTIFIED_SIGMA:
            return hours * HOUR
    return NEVER_S


def bound_sigma(
    model: TriadModel, x: NDArray, dt_s: float, parked_s: float, *, channels: int = 3
) -> NDArray:
    """Cramer-Rao bound (p,) on the sigma of each log variance from one parked run, by the integral
    of Whittle's information; terms of one channel count once.
    """
    shape = model.shape_at(x)
    f = np.geomspace(LOWEST_CYCLES / parked_s, 0.5 / dt_s, BOUND_POINTS)
    df = np.gradient(f)
    parts = np.stack([sampled_psd(t, f, dt_s, shape) for t in model.terms])
    parts *= np.exp(x[: len(model.terms)])[:, None]
    total = np.zeros((len(model.terms), len(model.terms)))
    for own in range(channels):
        rows = parts.copy()
        for j, term in enumerate(model.terms):
            if term is NoiseTerm.CREEP and own != model.creep_channel:
                rows[j] = 0.0
            if term is NoiseTerm.SWAY and own == 2:
                rows[j] = 0.0
        relative = rows / rows.sum(axis=0)
        total += (relative * df) @ relative.T * parked_s
    size = np.sqrt(np.diag(total))
    shown = size > 1.0 / NOWHERE_SIGMA
    bound = np.full(len(total), np.inf)
    alike = total[np.ix_(shown, shown)] / np.outer(size[shown], size[shown])
    inverse = np.linalg.inv(alike + LEAST_APART * np.eye(len(alike)))
    bound[shown] = np.sqrt(np.diag(inverse)) / size[shown]
    return bound


def plateau(evidence: TriadEvidence) -> tuple[TermEstimate, float] | None:
    """The white noise of a triad and the frequency up to which it was read [Hz], where its rows'
    spectra are flat.

    A table that warms up, a line that swings and a filter of the logger can contradict every model
    of the whole band. Over three octaves between them the power of the rows may still be the same,
    and nothing but white noise is: what a vehicle adds falls there as the square of the frequency,
    and flicker halves from one octave to the next.

    Parameters
    ----------
    evidence : TriadEvidence
        Of one triad; its fastest layer is read.

    Returns
    -------
    white, top_hz : TermEstimate, float
        Log variance, whose sigma holds a third of what a plateau may still lean; None where the
        channels have no plateau in common.
    """
    dt_s = min((b.dt_s for _, b in evidence.bands), default=np.inf)
    rows = [b for _, b in evidence.bands if b.dt_s < 1.5 * dt_s]
    top_hz = max((float(b.centre_hz.max()) for b in rows), default=0.0)
    best: tuple[float, float, float, float] | None = None
    low_hz = PLATEAU_ABOVE_HZ
    while low_hz * 2.0**PLATEAU_OCTAVES <= top_hz:
        found = np.array([_octaves(b, low_hz) for b in rows])
        lean = float(np.max(found[:, :, 0].max(axis=1) / found[:, :, 0].min(axis=1) - 1.0))
        if lean < PLATEAU_LEANS and (best is None or lean < best[0]):
            power = float(np.mean(np.average(found[:, :, 0], axis=1, weights=found[0, :, 1])))
            best = lean, power, float(found[:, :, 1].sum()), low_hz * 2.0**PLATEAU_OCTAVES
        low_hz *= 2.0**0.5
    if best is None:
        return None
    _, power, dof, read_hz = best
    value, sigma = float(np.log(power)), float(np.hypot(dof**-0.5, PLATEAU_LEANS / 3.0))
    high = value + 1.96 * sigma
    white = TermEstimate(
        term=NoiseTerm.WHITE,
        value=value,
        sigma=sigma,
        low=value - 1.96 * sigma,
        high=high,
        nats=np.inf,
        identified=True,
        upper=high,
        needed_s=0.0,
    )
    return white, read_hz


def _octaves(bands: Bands, low_hz: float) -> NDArray:
    """Mean power and values of each octave (PLATEAU_OCTAVES, 2); NaN where one is empty."""
    found = np.full((PLATEAU_OCTAVES, 2), np.nan)
    for k in range(PLATEAU_OCTAVES):
        inside = (bands.centre_hz >= low_hz * 2.0**k) & (bands.centre_hz < low_hz * 2.0 ** (k + 1))
        dof = bands.dof[inside]
        if dof.sum() > 0:
            found[k] = dof @ bands.power[inside] / dof.sum(), dof.sum()
    return found
