"""Which terms of a triad's noise the data show, how well, and what recording would show the
rest."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from ins.units import HOUR
from simreal.twin.fit.model import PRIOR_SIGMA, ROUGHLY, Evidence, Fitted, Model, climb, derivatives
from simreal.twin.fit.terms import Term, sampled_psd

# of a log variance, 0.25 of the size: beyond, normal limits hold the truth in less than 92 %
# (chi-square with fewer than 8 degrees of freedom)
IDENTIFIED_SIGMA = 0.5
BELIEVED_SIGMA = 2.0 * np.log(3.0)  # of what the data do not tell: a factor 3 of the size
LIMIT_DROP = 0.5 * float(chi2.ppf(0.90, 1))  # of the log likelihood at a one-sided 95 % limit
LIMIT_STEPS, LIMIT_WITHIN = 10, 0.3  # of a log variance: 15 % of a limit
SCORE = 2.5  # sigmas: below, a Markov process cannot win 2 nats and more
LITTLE = 1e-3  # of the flicker
TAUS_S = (30.0, 300.0, 2000.0)  # where a Markov process is looked for
PARKED_HOURS = (0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0, 128.0)
NEVER_S = float("inf")
LOWEST_CYCLES = 1.5  # in a recording: what is slower went with its constant
BOUND_POINTS = 400  # frequencies
# probability that like axes are called unlike: 1 fit in 10,000, for the triad is then not one
AXES_DIFFER_P = 1e-4
AXIS_SIGMA = 0.2  # of an axis's own log variance: beyond 0.1 of its size the triad's is taken


@dataclass(frozen=True)
class Told:
    """What the data say of one term, in log variance.

    value, sigma: of the twin that is written; low, high: 95 %; nats: log likelihood against none of
    it; upper: one-sided 95 % limit; needed_s: parked seconds in one run that would identify it.
    """

    term: Term
    value: float
    sigma: float
    low: float
    high: float
    nats: float
    identified: bool
    upper: float
    needed_s: float


@dataclass(frozen=True)
class TriadFit:
    """The terms of a triad, its best model, and the fit behind it; differ: p-value that its axes
    are alike; axes: of each axis, fitted alone.
    """

    told: tuple[Told, ...]
    fitted: Fitted
    differ_p: float
    axes: Mapping[int, Fitted]
    used_s: float

    def of(self, term: Term) -> Told | None:
        return next((t for t in self.told if t.term is term), None)


def fit_triad(evidence: Evidence, model: Model, dt_s: float, used_s: float) -> TriadFit:
    """The noise of a triad. dt_s: of its rows; used_s: parked seconds, all runs."""
    best = climb(evidence, model)
    best = _with_markov(evidence, best)
    differ_p, axes, ratios = _axes(evidence, best)
    if ratios:
        told_apart = replace(best.model, ratios=ratios)
        if Term.CREEP in told_apart.terms:
            told_apart = told_apart.without(Term.CREEP)
        best = climb(evidence, told_apart)
    count = max(sum(s.y.size for _, s in evidence.slow), 8)
    channels = len({b.channel for _, b in evidence.bands}) or 1
    told = []
    for term in best.model.terms:
        told.append(_tell(evidence, best, term, 0.5 * float(np.log(count))))
    kept = {t.term for t in told if t.identified}
    width = np.array([PRIOR_SIGMA if t in kept else BELIEVED_SIGMA for t in best.model.terms])
    final = climb(evidence, replace(best.model, width=width), best.x)
    told = [_final(t, final, dt_s=dt_s, used_s=used_s, channels=channels) for t in told]
    return TriadFit(tuple(told), final, differ_p, axes, used_s)


def _with_markov(evidence: Evidence, best: Fitted) -> Fitted:
    """The fit with a Markov process, where its two parameters are worth it."""
    slow = sum(s.y.size for _, s in evidence.slow)
    if slow == 0:
        return best
    model = best.model
    flicker = model.terms.index(Term.FLICKER) if Term.FLICKER in model.terms else 0
    penalty = float(np.log(slow)) + 2.0
    found = best
    for tau_s in TAUS_S:
        wider = replace(
            model,
            terms=(*model.terms, Term.MARKOV),
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


def _score(evidence: Evidence, model: Model, x: NDArray) -> float:
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
    evidence: Evidence, best: Fitted
) -> tuple[float, dict[int, Fitted], dict[tuple[Term, int], float]]:
    """Whether the axes are alike (p-value), each axis fitted alone, and the ratios of their white
    noise where they are not.
    """
    channels = sorted({b.channel for _, b in evidence.bands})
    creep = best.model.creep_channel if Term.CREEP in best.model.terms else None
    judged = [c for c in channels if c != creep]
    if len(judged) < 2:
        return 1.0, {}, {}
    alone: dict[int, Fitted] = {}
    for c in channels:
        model = best.model.without(Term.CREEP) if creep is not None else best.model
        keep = [k for k, t in enumerate(best.model.terms) if t is not Term.CREEP]
        keep += range(len(best.model.terms), best.model.size)
        alone[c] = climb(evidence.of((c,)), model, best.x[keep])
    together = climb(evidence.of(judged), alone[judged[0]].model, alone[judged[0]].x)
    gain = sum(alone[c].log_likelihood for c in judged) - together.log_likelihood
    freedom = (len(judged) - 1) * len(together.model.terms)
    p = float(chi2.sf(max(2.0 * gain, 0.0), freedom))
    if p > AXES_DIFFER_P:
        return p, alone, {}
    ratios: dict[tuple[Term, int], float] = {}
    for term in (Term.WHITE, Term.QUANTIZATION):
        if term not in together.model.terms:
            continue
        known = {c: f.log_variance(term) for c, f in alone.items() if f.sigma(term) < AXIS_SIGMA}
        if len(known) < 2:
            continue
        level = float(np.mean(np.exp(list(known.values()))))
        ratios |= {(term, c): float(np.exp(v)) / level for c, v in known.items()}
    return p, alone, ratios


def _tell(evidence: Evidence, best: Fitted, term: Term, penalty: float) -> Told:
    """One term against its absence."""
    k = best.model.terms.index(term)
    value, sigma = float(best.x[k]), best.sigma(term)
    nats = np.inf
    if term is not Term.WHITE and not (sigma < 0.1 * IDENTIFIED_SIGMA):
        keep = np.delete(np.arange(best.x.size), k)
        less = best.model.without(term)
        if less.size == keep.size:
            nats = (
                best.log_likelihood
                - climb(evidence, less, best.x[keep], within=ROUGHLY).log_likelihood
            )
    identified = nats > penalty and sigma < IDENTIFIED_SIGMA
    upper = value + 1.645 * sigma if identified else _upper(evidence, best, k)
    return Told(
        term=term,
        value=value,
        sigma=sigma,
        low=value - 1.96 * sigma,
        high=value + 1.96 * sigma,
        nats=float(nats),
        identified=bool(identified),
        upper=upper,
        needed_s=NEVER_S,
    )


def _upper(evidence: Evidence, best: Fitted, k: int) -> float:
    """The log variance at which the profile likelihood has fallen to its one-sided 95 % limit."""
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


def _final(told: Told, final: Fitted, *, dt_s: float, used_s: float, channels: int) -> Told:
    """What the twin is given, and the recording that would tell what these did not."""
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
    needed = needed_s(final, told.term, dt_s, channels=channels)
    return replace(told, value=value, sigma=sigma, low=-np.inf, high=told.upper, needed_s=needed)


def needed_s(fitted: Fitted, term: Term, dt_s: float, *, channels: int = 3) -> float:
    """The shortest of PARKED_HOURS, in seconds, in which the bound on this term's sigma passes;
    infinite where none does.
    """
    for hours in PARKED_HOURS:
        bound = bound_sigma(fitted.model, fitted.x, dt_s, hours * HOUR, channels=channels)
        if bound[fitted.model.terms.index(term)] < 0.8 * IDENTIFIED_SIGMA:
            return hours * HOUR
    return NEVER_S


def bound_sigma(
    model: Model, x: NDArray, dt_s: float, parked_s: float, *, channels: int = 3
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
            if term is Term.CREEP and own != model.creep_channel:
                rows[j] = 0.0
            if term is Term.SWAY and own == 2:
                rows[j] = 0.0
        relative = rows / rows.sum(axis=0)
        total += (relative * df) @ relative.T * parked_s
    bound = np.linalg.pinv(total + 1e-12 * np.eye(len(total)))
    return np.asarray(np.sqrt(np.maximum(np.diag(bound), 0.0)))
