"""A found effect in words and numbers: probability, what it cannot be told from, coefficients with
sigma and usual size.

Decision: docs/decisions/0084-table-error-state.md.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from ins.documents import OMIT_NONE
from ins.errors.base import ACCELS, GYROS, SLOW_NAME, Effect
from ins.errors.catalogue import effects_named
from ins.errors.gyro.noise import NOISE_OF_TIME
from ins.errors.table import TABLE_AGED
from ins.errors.telemetry import Telemetry
from ins.errors.unnamed import FREE_FUNCTIONS, OF_RATE, OF_TEMPERATURE, OF_TIME, UNKNOWN_MOTION
from ins.records import EffectDocument
from ins.units import DEG_PER_HOUR, MICRO_G
from simreal.declared.generic import OF_TELEMETRY, OF_UNNAMED_MOTION
from simreal.declared.twin_effects import leaves_the_log
from simreal.inference.addback import Shrink
from simreal.inference.attribute import Attribution, Slot, columns_of
from simreal.inference.bank import Bank, Hypothesis, unit_scale
from simreal.inference.noise_hypotheses import NoiseHypothesis, Term, log_bf, term_of
from simreal.inference.scoring import Conditioned, Scorer, fit
from simreal.inference.verdict import KeptOut

CREDIBLE = 0.95  # of a set: 19 of 20 hold what is true
# whitened signatures closer than this cannot be told apart with these runs; what is not shared is 1
# - 0.95^2, 10 % of the energy
SAME_COSINE = 0.95
# the same of a table's curves, which are several; chosen: 0.99, beyond which an effect of 12 sigma
# has 1.7 of its own
TABLE_COSINE = 0.99
UNLISTED = (UNKNOWN_MOTION, "")  # a cause outside the catalogue
MOST_BARS = 8  # answers of a cause that a page draws
OUTSIDE, ROOM_SIGMA = 0.15, 25.0
TIME_NODES = (
    4  # of the free function of time, the coarsest of the bank: what is no smooth drift is left
)
# of noise that changes with time, lowest, highest and count: the square of a temperature's rate
# falls by e^-6 over three time constants of a warm-up; twice that
SLOPES, BENDS = (-6.0, 6.0, 13), (-4.0, 4.0, 9)
# of free functions of motion
FREE_UNITS = {"gnss": ("m", 1.0), "odometer": ("m/s", 1.0), "vehicle": ("m/s", 1.0)}
# probability below which an answer is not listed, nor worth a recording; chosen: all that is left
# out is less than 0.05, what a set of 0.95 may miss
LEAST_PROBABILITY = 0.01  # of an answer that is listed, or worth a recording; chosen: 1 in 100
# times the upper end of the usual range, and the value is flagged; chosen: about half a power of
# ten (3.2), as usual sizes are given to one digit
ABSURD = 3.0


@dataclass(frozen=True)
class CauseParameter:
    """A parameter of a cause.

    usual: its usual size, None: no such thing. unusual: larger than such an effect is as a rule.
    sigma_from: "fit", "bounds" (of a shape that the data do not narrow) or None. below_declared: of
    a noise, that much less than the twin declares.
    """

    value: float
    sigma: float | None
    unit: str
    usual: tuple[float, float] | None
    unusual: bool
    sigma_from: str | None
    below_declared: bool


@dataclass(frozen=True)
class Answer:
    """An answer of a slot, with its probability."""

    effect: str
    target: str
    probability: float


@dataclass(frozen=True)
class Rival(Answer):
    """Another answer than the one taken; cosine: |cos| of the two signatures, None for noise."""

    cosine: float | None


@dataclass(frozen=True)
class ParkedRms:
    """RMS of an effect on a channel while parked."""

    value: float
    unit: str


@dataclass(frozen=True, kw_only=True)
class Cause:
    """One found effect.

    probability: of this name on this target. rivals: the rest of the 95 % credible set and what
    cannot be told apart; confounded_with: their names, of a slow variation the processes first.
    posterior: the most probable answers. id: which of the effects of that name. repeats: the class
    of effects.md, section 1. run_id: of an event. size: norm of the whitened effect. rms: by
    channel. nodes, values: of a free function. twin_effects: its items in the twin that the
    diagnosis writes; kept_out: why there are none. advice: the command that mends it.
    """

    effect: str
    target: str
    probability: float
    confounded_with: tuple[str, ...] = ()
    parameters: Mapping[str, CauseParameter]
    shrink: Shrink | None = None
    id: str
    named: bool = True
    resolved: bool = True
    repeats: str = "R"
    run_id: str | None
    size: float
    rivals: tuple[Rival, ...] = ()
    posterior: tuple[Answer, ...] = ()
    rms: Mapping[str, ParkedRms] = field(default_factory=dict)
    nodes: tuple[float, ...] = ()
    values: tuple[float, ...] = ()
    twin_effects: tuple[EffectDocument, ...] = ()
    kept_out: KeptOut | None = field(default=None, metadata=OMIT_NONE)
    advice: str | None = field(default=None, metadata=OMIT_NONE)


def parameter_of(
    value: float,
    sigma: float,
    unit: str,
    usual: tuple[float, float] | None = None,
    *,
    bounds: tuple[float, float] | None = None,
    below_declared: bool = False,
) -> CauseParameter:
    """A parameter of a fit. sigma: NaN where the data do not narrow it: then that of anything
    between the bounds, where it has some.
    """
    sigma_from = "fit" if np.isfinite(sigma) else None
    if sigma_from is None and bounds is not None:
        sigma, sigma_from = float((bounds[1] - bounds[0]) / np.sqrt(12.0)), "bounds"
    return CauseParameter(
        value=value,
        sigma=sigma if sigma_from else None,
        unit=unit,
        usual=usual,
        unusual=usual is not None and abs(value) > ABSURD * usual[1],
        sigma_from=sigma_from,
        below_declared=below_declared,
    )


def judged(cause: Cause) -> Cause:
    """The cause with what follows from its numbers: whether it stands alone, what it is confounded
    with, and whether a twin may take it.
    """
    resolved = cause.probability >= CREDIBLE * (1.0 - unlisted(cause.size)) or not cause.rivals
    names = [r.effect for r in cause.rivals if r.effect != cause.effect]
    confounded_with = tuple(dict.fromkeys([*_processes_of(cause), *names]))
    seen = replace(cause, resolved=resolved, confounded_with=confounded_with)
    return replace(seen, kept_out=_kept_out(seen))


def _processes_of(cause: Cause) -> tuple[str, ...]:
    """Names of the processes that a slow variation may be on its target, the found one first."""
    if cause.effect != SLOW_NAME:
        return ()
    others = [
        e.id for e in effects_named(SLOW_NAME) if cause.target in e.targets and e.id != cause.id
    ]
    return (cause.id, *others)


def _kept_out(cause: Cause) -> KeptOut | None:
    """Why a cause is not written into the twin; None: it is.

    A named effect has a form that physics gives it. A free function, of a mean or of a noise, has
    the form of the data that it is drawn through, and beyond them it is a guess: it must lessen
    the gap of data that it was not fitted to, at 95 %. On halves of real logs, guesses made the
    other half's gap as much as 17 times as large (docs/gap.md). What an update would
    take out of its log must be of a size that is usual, and no other answer of the set may leave
    another table. So must what takes any form, a value of its own in each run or a slow variation.
    """
    if cause.effect in OF_UNNAMED_MOTION:
        return KeptOut.OF_MOTION
    if cause.effect == TABLE_AGED:
        return KeptOut.TABLE_AGED
    low, high = (-1.0, 1.0)
    if cause.shrink is not None and cause.shrink.held_out:
        low, high = cause.shrink.interval_95
    if high < 0.0:
        return KeptOut.MADE_WORSE
    free = cause.effect in OF_TELEMETRY or cause.effect == NOISE_OF_TIME
    if free and low <= 0.0:
        return KeptOut.NOT_SHOWN
    taken_out = cause.repeats == "R" and leaves_the_log(cause.effect, cause.target)
    judged_by_size = taken_out or of_any_form(cause.effect, cause.repeats)
    if judged_by_size and beyond_usual(cause.parameters.values()) > 1.0:
        return KeptOut.IMPLAUSIBLE
    if not taken_out:
        return None
    return KeptOut.NOT_UNIQUE if _another_table(cause) else None


def _another_table(cause: Cause) -> bool:
    """Whether an answer of the set would leave another table in an update than this one. Two that
    leave the log alike, each the same trace, leave the same; a table that may be off in the same
    form always leaves another.
    """
    alike = [
        r.target == cause.target
        and (r.cosine or 0.0) > SAME_COSINE
        and leaves_the_log(r.effect, r.target)
        for r in cause.rivals
    ]
    aged = any(r.effect == TABLE_AGED for r in cause.rivals)
    return aged or not (cause.resolved or all(alike))


def cause_of(
    attribution: Attribution,
    number: int,
    shares: Mapping[tuple[str, str], float],
    shrink: Shrink | None,
) -> Cause:
    """The slot as a cause; shares: of the slot, as `shares_of` has them."""
    slot = attribution.slots[number]
    h = slot.hypothesis
    probability = min(shares.get((h.name, h.target), 0.0), 1.0)
    bars = list(shares.items())[:MOST_BARS]
    views = attribution.evidence.views
    run_id = None if h.run is None else views[h.run].name
    effect = h.effect
    parameters, nodes, values = _parameters(attribution, slot)
    cause = Cause(
        effect=h.name,
        target=h.target,
        probability=probability,
        parameters=parameters,
        shrink=shrink,
        id=h.name if effect is None else effect.id,
        named=h.named,
        repeats="R" if effect is None else effect.repeats,
        run_id=run_id,
        size=_size(attribution, slot),
        rivals=_rivals(attribution, slot, shares),
        posterior=tuple(Answer(name, target, p) for (name, target), p in bars),
        rms=_rms(attribution, slot),
        nodes=nodes,
        values=values,
    )
    return judged(cause)


def shares_of(attribution: Attribution, slot: Slot) -> dict[tuple[str, str], float]:
    """Posterior by name and target, largest first."""
    shares: dict[tuple[str, str], float] = {}
    for hypothesis, p in zip(attribution.hypotheses, slot.posterior):
        key = hypothesis.name, hypothesis.target
        shares[key] = shares.get(key, 0.0) + float(p)
    shares = shared_with_time(attribution, slot, shares)
    # what it adds to the others: two may cancel
    size = float(np.sqrt(2.0 * max(slot.log_odds, 0.0)))
    h = slot.hypothesis
    repeats = "" if h.effect is None else h.effect.repeats
    beyond = beyond_usual(_parameters(attribution, slot)[0].values())
    alien = unlisted(size, beyond, any_form=of_any_form(h.name, repeats))
    shares = {key: (1.0 - alien) * p for key, p in shares.items()}
    shares[UNLISTED] = alien
    return dict(sorted(shares.items(), key=lambda item: -item[1]))


def unlisted(size: float, beyond: float = 0.0, *, any_form: bool = False) -> float:
    """Probability that the cause is none of the catalogue's and only looks like one of them.

    No catalogue is complete: a share of OUTSIDE is kept for what is not in it. An effect of many
    sigmas leaves less room for a look-alike, whose difference would show. Where what was found may
    take any form, no difference would, and size alone speaks: what is not listed may have any, as
    likely in each decade; a listed effect beyond ABSURD times the upper end of its usual range is
    as rare as the inverse square.
    """
    share = OUTSIDE / (1.0 + (size / ROOM_SIGMA) ** 2)
    odds = share / (1.0 - share)
    if any_form:
        odds += OUTSIDE / (1.0 - OUTSIDE) * (max(beyond, 1.0) ** 2 - 1.0)
    return odds / (1.0 + odds)


def of_any_form(name: str, repeats: str) -> bool:
    """Whether an effect takes any form: a value of its own in each run, or a slow variation."""
    return name == SLOW_NAME or repeats == "P"


def beyond_usual(parameters: Iterable[CauseParameter]) -> float:
    """The largest of the parameters over what is still usual, two sigmas taken off; 0: none has a
    usual size.
    """
    beyond = [
        (abs(p.value) - 2.0 * (p.sigma or 0.0)) / (ABSURD * p.usual[1])
        for p in parameters
        if p.usual is not None
    ]
    return max(beyond, default=0.0)


def _rivals(
    attribution: Attribution, slot: Slot, shares: Mapping[tuple[str, str], float]
) -> tuple[Rival, ...]:
    own, total, out = (slot.hypothesis.name, slot.hypothesis.target), 0.0, []
    cosines = _cosines(attribution, slot)
    total = shares.get(own, 0.0) + shares.get(UNLISTED, 0.0)
    if shares.get(UNLISTED, 0.0) > shares.get(own, 0.0):
        out.append(Rival(*UNLISTED, shares[UNLISTED], None))
    for key, p in shares.items():
        if key in (own, UNLISTED):
            continue
        cosine = cosines.get(key)
        if total < CREDIBLE and p > LEAST_PROBABILITY:
            out.append(Rival(*key, p, cosine))
            total += p
            continue
        same = TABLE_COSINE if key[0] == TABLE_AGED else SAME_COSINE
        if cosine is not None and cosine > same and key[0] not in FREE_FUNCTIONS:
            out.append(Rival(*key, p, cosine))
    return tuple(out)


def _cosines(attribution: Attribution, slot: Slot) -> dict[tuple[str, str], float]:
    """Largest |cos| of the slot's fitted signature with each other hypothesis's span, the other
    slots projected out; a table's span is that of its curves at any size.
    """
    if slot.group is None:
        return {}
    bank, target = attribution.bank, slot.hypothesis.target
    others = columns_of(
        s
        for s in attribution.every
        if s is not slot and not (s.of_table and s.hypothesis.target == target)
    )
    left = Conditioned(bank.gram, bank.score, others)
    own = slot.columns
    own_gram = left.gram_of(own)
    beta = np.linalg.pinv(own_gram, hermitian=True) @ left.score[own]
    norm = float(beta @ own_gram @ beta) - slot.group.precision * float(beta @ beta)
    out: dict[tuple[str, str], float] = {}
    for h in bank.hypotheses:
        for group in h.groups:
            c = group.columns
            # a wider effect holds many others; its probability says whether it is one, but for a
            # table, which is off in every unit
            if c.size > own.size and not h.of_table:
                continue
            cross = left.gram_of(c, own) @ beta
            G = left.gram_of(c) - group.precision * np.eye(c.size)
            if norm <= 0 or np.diag(G).max() <= 1e-9 * max(np.diag(bank.gram)[c].max(), 1e-300):
                continue
            seen = np.diag(G) > 0.0
            scale = np.where(seen, 1.0 / np.sqrt(np.where(seen, np.diag(G), 1.0)), 0.0)
            inner = (
                (cross * scale)
                @ np.linalg.pinv(G * np.outer(scale, scale), rcond=1e-6, hermitian=True)
                @ (cross * scale)
            )
            key = h.name, h.target
            out[key] = max(out.get(key, 0.0), float(np.sqrt(np.clip(inner / norm, 0.0, 1.0))))
    return out


def _parameters(
    attribution: Attribution, slot: Slot
) -> tuple[dict[str, CauseParameter], tuple[float, ...], tuple[float, ...]]:
    h = slot.hypothesis
    if isinstance(h, NoiseHypothesis):
        return _noise_parameters(attribution, slot), (), ()
    columns = attribution.columns
    beta, covariance = fit(attribution.bank, columns)
    at = np.flatnonzero(np.isin(columns, slot.columns))
    value, sigma = beta[at], np.sqrt(np.maximum(np.diag(covariance)[at], 0.0))
    if h.effect is None:
        assert slot.group is not None and h.generic is not None
        unit, si = FREE_UNITS.get(
            h.target, ("deg/h", DEG_PER_HOUR) if h.target in GYROS else ("ug", MICRO_G)
        )
        generic = attribution.bank.generic_of(h, slot.group)
        curves = (np.eye(value.size) if generic.curves is None else generic.curves) / si
        values = curves @ value
        out = {"rms": parameter_of(float(np.sqrt(np.mean(values**2))), float("nan"), unit)}
        if h.of_table:
            mean = curves.mean(axis=0)
            spread = float(np.sqrt(mean @ covariance[np.ix_(at, at)] @ mean))
            out["shift"] = parameter_of(float(mean @ value), spread, unit)
        return out, generic.nodes, tuple(values.tolist())
    scale = unit_scale(h.effect, h.target, attribution.evidence)
    out = {}
    for k, c in enumerate(h.effect.coefficients):
        usual = (scale * c.low, scale * c.high)
        if h.effect.repeats == "P":
            for r, view in enumerate(attribution.evidence.views):
                out[f"{c.name}[{view.name}]"] = parameter_of(
                    float(value[r]), float(sigma[r]), c.unit, usual
                )
        else:
            out[c.name] = parameter_of(float(value[k]), float(sigma[k]), c.unit, usual)
    assert slot.group is not None
    for p in h.effect.shape:
        v = float(slot.group.shape[p.name])
        spread = _shape_sigma(attribution, slot, h.effect, p.name)
        out[p.name] = parameter_of(v, spread, p.unit, bounds=(p.low, p.high))
    return out, (), ()


def _shape_sigma(attribution: Attribution, slot: Slot, effect: Effect, name: str) -> float:
    """From the curvature of the fit about its best: three points, two of them a few per cent
    away.
    """
    assert isinstance(slot.hypothesis, Hypothesis) and slot.group is not None
    bank, h = attribution.bank, slot.hypothesis
    centre = float(slot.group.shape[name])
    of_time = next(p for p in effect.shape if p.name == name).of_time
    step = 15.0 if of_time else 0.05 * abs(centre)
    if step <= 0:
        return float("nan")
    shapes = [{**slot.group.shape, name: centre + k * step} for k in (-1, 0, 1)]
    groups = bank.append(effect, h.target, shapes, h.run)
    others = attribution.others(slot)
    scorer = Scorer(bank, [Hypothesis(h.name, h.target, effect, run=h.run, groups=groups)])
    f = scorer.groups_log_bf(others, bank.score[:, None])[:, 0]
    curvature = (2.0 * f[1] - f[0] - f[2]) / step**2
    return float(1.0 / np.sqrt(curvature)) if curvature > 0 else float("nan")


def _noise_parameters(attribution: Attribution, slot: Slot) -> dict[str, CauseParameter]:
    h, extra = slot.hypothesis, slot.extra
    assert isinstance(h, NoiseHypothesis) and extra is not None
    squares = attribution.plain_squares
    term = _plain_terms(attribution, h, [dict(extra.shape)])[0]
    s = 1.0 + extra.square * term.factor
    information = (
        float(np.sum(0.5 * squares.dof[term.index] * (term.factor / s) ** 2))
        if term.index.size
        else 0.0
    )
    value = float(np.sign(extra.square) * np.sqrt(abs(extra.square)))
    sigma = 0.5 / max(abs(value), 1e-30) / np.sqrt(information) if information > 0 else float("nan")
    c = h.effect.coefficients[-1]
    scale = unit_scale(h.effect, h.target, attribution.evidence)
    usual = (scale * c.low, scale * c.high)
    out = {c.name: parameter_of(value, float(sigma), c.unit, usual, below_declared=value < 0)}
    for p in h.effect.shape:
        bounds = (p.low, p.high)
        out[p.name] = parameter_of(float(extra.shape[p.name]), np.nan, p.unit, bounds=bounds)
    return out


def _size(attribution: Attribution, slot: Slot) -> float:
    """Norm of the whitened effect as fitted; for noise that of equal information."""
    if slot.group is None:
        return float(np.sqrt(2.0 * max(slot.log_odds, 0.0)))
    columns = attribution.columns
    beta, _ = fit(attribution.bank, columns)
    at = np.isin(columns, slot.columns)
    G = attribution.bank.gram[np.ix_(slot.columns, slot.columns)]
    own = slot.group.precision * float(beta[at] @ beta[at])
    return float(np.sqrt(max(beta[at] @ G @ beta[at] - own, 0.0)))


def _rms(attribution: Attribution, slot: Slot) -> dict[str, ParkedRms]:
    """RMS of the effect on the gyros and accelerometers over all parked seconds, where it is not
    zero.
    """
    if slot.group is None:
        return {}
    columns = attribution.columns
    beta, _ = fit(attribution.bank, columns)
    total = np.zeros((6,))
    count = 0
    for r, view in enumerate(attribution.evidence.views):
        series = np.zeros((view.telemetry.n, 6))
        for c in slot.columns:
            trace = attribution.bank.traces_of(int(c), r)
            value = beta[int(np.flatnonzero(columns == c)[0])]
            if trace is not None and trace.gyro_rad_s is not None:
                series[:, :3] += value * trace.gyro_rad_s
            if trace is not None and trace.accel_m_s2 is not None:
                series[:, 3:] += value * trace.accel_m_s2
        parked = view.telemetry.parked
        total += np.sum(series[parked] ** 2, axis=0)
        count += int(parked.sum())
    rms = np.sqrt(total / max(count, 1))
    gyros = {n: ParkedRms(float(v) / DEG_PER_HOUR, "deg/h") for n, v in zip(GYROS, rms[:3])}
    accels = {n: ParkedRms(float(v) / MICRO_G, "ug") for n, v in zip(ACCELS, rms[3:])}
    return {n: r for n, r in (gyros | accels).items() if r.value > 0}


def shared_with_time(
    attribution: Attribution, slot: Slot, shares: Mapping[tuple[str, str], float]
) -> dict[tuple[str, str], float]:
    """Shares by name and target, those of causes of temperature shared with time where one start
    shows both.

    Within one rest the temperature is a smooth curve of time, and so is a drift that has nothing to
    do with it: a temperature of another log, backwards, was named in 5 of 15 real rests
    (docs/gap.md). Where the fitted signature is one of time as well, both keep half of
    the probability; a second start tells them apart. So it is with noise that changes.
    """
    out = dict(shares)
    target = slot.hypothesis.target
    if slot.group is None:
        shared, rival = _is_smooth_noise(attribution, slot), NOISE_OF_TIME
    else:
        shared, rival = _is_smooth_drift(attribution, slot), OF_TIME
    if not shared:
        return out
    run = attribution.evidence.views[0].telemetry
    key = rival, target
    for h in {(h.name, h.target): h for h in attribution.hypotheses}.values():
        own = h.name, h.target
        if own in out and goes_with_temperature(h.name, h.effect, run, h.target):
            out[own] *= 0.5
            out[key] = out.get(key, 0.0) + out[own]
    return out


def goes_with_temperature(name: str, effect: Effect | None, run: Telemetry, target: str) -> bool:
    """Whether an answer needs a temperature in the log."""
    if effect is None:
        return name in (OF_TEMPERATURE, OF_RATE)
    cold = replace(
        run,
        temperature_degC=None,
        temperature_rate_degC_min=None,
        accel_degC=None,
        gradient_degC=None,
        table_deg_h=None,
    )
    return not effect.needs([run], target) and bool(effect.needs([cold], target))


def _is_smooth_drift(attribution: Attribution, slot: Slot) -> bool:
    """Whether the only start shows a cause of temperature that a free function of time is too."""
    h = slot.hypothesis
    views = attribution.evidence.views
    if slot.group is None or len(views) != 1:
        return False
    if not goes_with_temperature(h.name, h.effect, views[0].telemetry, h.target):
        return False
    bank = attribution.bank
    times = {
        int(g.shape["nodes"]): g.columns
        for other in bank.hypotheses
        if (other.name, other.target) == (OF_TIME, h.target)
        for g in other.groups
    }
    # a free function of temperature is judged against the one of time that is as free
    time = times.get(TIME_NODES if h.effect is not None else max(times, default=0))
    others = attribution.others(slot)
    return time is not None and _cosine(bank, slot.columns, time, others) > SAME_COSINE


def _is_smooth_noise(attribution: Attribution, slot: Slot) -> bool:
    """Whether the only start shows a noise of temperature that changes with time as smoothly.

    As for a drift, time must say at least SAME_COSINE^2 of what the temperature does: of the log
    likelihood ratio here, each at the best of its profiles.
    """
    h, views = slot.hypothesis, attribution.evidence.views
    if not isinstance(h, NoiseHypothesis) or len(views) != 1:
        return False
    if not goes_with_temperature(h.name, h.effect, views[0].telemetry, h.target):
        return False
    noises = [n for n in attribution.hypotheses if isinstance(n, NoiseHypothesis)]
    time = next((n for n in noises if (n.name, n.target) == (NOISE_OF_TIME, h.target)), None)
    if time is None:
        return False
    squares, z = attribution.plain_squares, attribution.plain_residual[:, None]
    ratio = squares.ratio(z)
    own, other = (
        float(log_bf(replace(n, terms=_plain_terms(attribution, n, s)), squares, ratio, z)[0].max())
        for n, s in ((h, h.shapes), (time, _smooth_profiles()))
    )
    return other > SAME_COSINE**2 * own


def _smooth_profiles() -> list[dict[str, float]]:
    """Ramps of noise and their bends, closer together than the scan has them, and steeper."""
    slopes, bends = np.linspace(*SLOPES), np.linspace(*BENDS)
    return [{"slope": float(a), "bend": float(b)} for a in slopes for b in bends]


def _plain_terms(
    attribution: Attribution, noise: NoiseHypothesis, shapes: Sequence[dict[str, float]]
) -> list[Term]:
    """Where a noise shows under the twin's own noise: that of a slot may be in the whitening."""
    evidence, squares = attribution.plain_evidence, attribution.plain_squares
    return [
        term_of(evidence, squares, noise.effect, noise.target, shape, noise.run) for shape in shapes
    ]


def _cosine(bank: Bank, own: NDArray, span: NDArray, others: NDArray) -> float:
    """|cos| of the fitted signature of some columns with the span of others, a third set projected
    out.
    """
    left = Conditioned(bank.gram, bank.score, others)
    G = left.gram_of(own)
    beta = np.linalg.pinv(G, hermitian=True) @ left.score[own]
    norm = float(beta @ G @ beta)
    if norm <= 0.0:
        return 0.0
    cross = left.gram_of(span, own) @ beta
    within = float(cross @ np.linalg.pinv(left.gram_of(span), hermitian=True) @ cross)
    return float(np.sqrt(np.clip(within / norm, 0.0, 1.0)))
