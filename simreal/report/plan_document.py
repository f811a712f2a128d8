"""plan.json (`recal.plan/1`) of a study, a field a key, and the same in a few lines for people.

Computes nothing but units and sizes.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ins.documents import OMIT_NONE, MadeOf, made, written
from simreal.plan.flights import PromisedFlight
from simreal.plan.gram import ODDS_NATS, Contender, PairSeparation
from simreal.plan.pairs import INSEPARABLE, Inseparable, Pair, PairAssessment, PairVerdict
from simreal.plan.recordings import Recording
from simreal.plan.study import NULL_NATS, Plan, Study

SCHEMA = "recal.plan/1"
of = MadeOf[Study]()
of_plan = MadeOf[Plan]()
of_pair = MadeOf[PairAssessment]()
ODDS, ALPHA = 0.95, 0.01  # what ODDS_NATS and NULL_NATS stand for
ALIKE_COS = 0.95  # members of a credible set above this cannot be told apart (effects.md, 3.4)


@dataclass(frozen=True, kw_only=True)
class PlanCriteria:
    """When two effects are told apart (odds), and when one is seen (alpha)."""

    odds: float
    odds_nats: float
    alpha: float
    null_nats: float


CRITERIA = PlanCriteria(odds=ODDS, odds_nats=ODDS_NATS, alpha=ALPHA, null_nats=NULL_NATS)


@dataclass(frozen=True, kw_only=True)
class CoefficientSizes:
    """The sizes of a coefficient: usual, and those from which it is seen and told from its rival
    (inf: never).
    """

    name: str
    unit: str
    usual: tuple[float, ...]
    seen_from: float
    told_from: float


@dataclass(frozen=True, kw_only=True)
class EffectSizes:
    """An effect in the runs; `delta_*`: norms of the whitened effect."""

    effect: str
    target: str
    delta_usual: tuple[float, ...]
    delta_seen: float
    delta_needed: float
    coefficients: tuple[CoefficientSizes, ...]


@dataclass(frozen=True, kw_only=True)
class JudgedPair:
    """A pair in a plan; what follows `lacks` only where the runs can show both.

    special_case : "a" or "b" where that one is a special case of the other, else empty.
    """

    label: str = of_pair(lambda j: j.pair.label)
    verdict: PairVerdict = of_pair(lambda j: j.verdict)
    lacks: str = of_pair(lambda j: j.lacks)
    cos: float | None = of_pair(lambda j: j.cos if j.both else None, OMIT_NONE)
    delta_needed: float | None = of_pair(lambda j: j.delta_needed if j.both else None, OMIT_NONE)
    cos_typical: float | None = of_pair(lambda j: j.cos_typical if j.both else None, OMIT_NONE)
    delta_needed_typical: float | None = of_pair(
        lambda j: j.delta_needed_typical if j.both else None, OMIT_NONE
    )
    special_case: str | None = of_pair(lambda j: j.special if j.both else None, OMIT_NONE)
    a: EffectSizes | None = field(default=None, metadata=OMIT_NONE)
    b: EffectSizes | None = field(default=None, metadata=OMIT_NONE)

    @property
    def members(self) -> tuple[EffectSizes, ...]:
        """Both effects where the runs can show them, else none."""
        return tuple(m for m in (self.a, self.b) if m is not None)

    @property
    def special(self) -> EffectSizes | None:
        """The one that is a special case of the other."""
        return {"a": self.a, "b": self.b}.get(self.special_case or "")


@written("recording=name words start heading_deg hours taxi gnss odometer score separates")
@dataclass(frozen=True, kw_only=True)
class PlanStep(Recording):
    """A recording added to a plan, and the pairs that it separates."""

    score: float
    separates: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class PlanOfRecordings:
    """A set of recordings, and every pair in it. run_ids: of the runs at hand."""

    name: str = of_plan(lambda plan: plan.name)
    score: float = of_plan(lambda plan: plan.score)
    hours: float = of_plan(lambda plan: plan.hours)
    recordings: tuple[Recording, ...] = of_plan(lambda plan: plan.recordings)
    pairs: tuple[JudgedPair, ...]
    run_ids: tuple[str, ...] | None = field(default=None, metadata=OMIT_NONE)

    @property
    def separated(self) -> int:
        """Pairs that are told apart, at least where the effect is large."""
        return sum(p.verdict.separates for p in self.pairs)


@dataclass(frozen=True, kw_only=True)
class NeverSeparated:
    """A pair that no recording separates."""

    label: str
    why: str


@dataclass(frozen=True, kw_only=True)
class PlanReport:
    """The document of a study."""

    schema: str = SCHEMA
    verdict: str = "planned"
    version: str
    noise_model: str = of(lambda study: study.twin.source)
    imu_serial: str = of(lambda study: study.twin.imu_serial)
    gyro_technology: str = of(lambda study: study.twin.gyro_technology)
    lat_deg: float
    without: tuple[str, ...]
    criteria: PlanCriteria = CRITERIA
    pairs: tuple[Pair, ...] = of(lambda study: study.pairs)
    given: PlanOfRecordings | None = of(lambda study: _given(study))
    compared: tuple[PlanOfRecordings, ...] = of(
        lambda study: tuple(_plan(p, study) for p in study.compared)
    )
    steps: tuple[PlanStep, ...] = of(lambda study: _steps(study))
    recommended: PlanOfRecordings = of(lambda study: _plan(study.chosen, study))
    next: tuple[PlanStep, ...] = of(
        lambda study: tuple(_step(p, study.given) for p in study.next_best)
    )
    never: tuple[NeverSeparated, ...] = of(
        lambda study: tuple(_never(j) for j in study.reach.judged if j.margin_high < 1.0)
    )
    inseparable: tuple[Inseparable, ...] = INSEPARABLE
    flights: tuple[PromisedFlight, ...] | None = field(default=None, metadata=OMIT_NONE)


def plan_document(
    study: Study, *, lat_deg: float, without: Sequence[str], version: str
) -> PlanReport:
    """The document of a study."""
    return made(PlanReport, study, lat_deg=lat_deg, without=tuple(without), version=version)


def _given(study: Study) -> PlanOfRecordings | None:
    if study.given is None:
        return None
    return replace(_plan(study.given, study), run_ids=study.run_ids)


def _steps(study: Study) -> tuple[PlanStep, ...]:
    steps = study.steps
    return tuple(_step(p, before) for before, p in zip((study.given, *steps), steps))


def summary(document: PlanReport) -> list[str]:
    """The plan in a few lines for people."""
    best, given, lines = document.recommended, document.given, []
    pairs = len(best.pairs)
    if given is not None:
        lines.append(f"the given runs separate {given.separated} of {pairs} pairs")
        if document.next and document.steps:
            first = document.steps[0]
            lines.append(f"the one recording that helps most: {first.words}{_separates(first)}")
    n = len(best.recordings)
    many = "s" if n > 1 else ""
    lines.append(
        f"{n} recording{many}, {best.hours:g} h: {best.separated} of {pairs} pairs separated"
        if best.recordings
        else "no recording of the list separates more"
    )
    lines += [f"  {k + 1}. {r.words}" for k, r in enumerate(best.recordings)]
    lines += [f"  {_pair_line(p)}" for p in best.pairs]
    lines += [f"  not with any of these recordings: {n.label} ({n.why})" for n in document.never]
    lines += [f"  {_flight_line(flight)}" for flight in document.flights or ()]
    return lines


def _flight_line(flight: PromisedFlight) -> str:
    """What a flight would bring, for people."""
    sigmas = ", ".join(f"{g.axis} {g.sigma_after_deg_h:.4f}" for g in flight.gyros)
    best = f"; best for {', '.join(flight.best_for)}" if flight.best_for else ""
    return (
        f"flight, {flight.words}: {flight.from_degC:.0f} to {flight.to_degC:.0f} degC, sigma of the"
        f" gyros' means {sigmas} deg/h{best}"
    )


def _step(plan: Plan, before: Plan | None) -> PlanStep:
    last = plan.recordings[-1]
    return PlanStep(**vars(last), score=plan.score, separates=_gained(before, plan))


def _plan(plan: Plan, study: Study) -> PlanOfRecordings:
    return made(PlanOfRecordings, plan, pairs=tuple(_judged(j, study) for j in plan.judged))


def _judged(j: PairAssessment, study: Study) -> JudgedPair:
    if not j.both:
        return made(JudgedPair, j)
    assert j.a is not None and j.b is not None
    return made(
        JudgedPair,
        j,
        a=_sizes(j.pair.a, j.a, study, special=j.special == "a"),
        b=_sizes(j.pair.b, j.b, study, special=j.special == "b"),
    )


def _sizes(e: Contender, t: PairSeparation, study: Study, *, special: bool) -> EffectSizes:
    """Size of an effect in the runs, and the coefficients from which it is seen and told from its
    rival.

    special : a special case of its rival; where both fit, the simpler is preferred, so that it is
    told once it is seen.
    """
    seen = study.seen[e.key]
    needed = np.zeros_like(t.delta) if special else t.delta_needed
    told = np.maximum(needed, seen)
    with np.errstate(divide="ignore", invalid="ignore"):
        seen_factor = float(np.median(seen / t.delta))
        told_factor = float(np.median(told / t.delta))
    return EffectSizes(
        effect=e.effect.name,
        target=e.target,
        delta_usual=(float(np.median(t.delta_low)), float(np.median(t.delta_high))),
        delta_seen=seen,
        delta_needed=float(np.median(needed)),
        coefficients=tuple(
            CoefficientSizes(
                name=c.name,
                unit=c.unit,
                usual=(float(usual / reach), float(usual * reach)),
                seen_from=float(usual * seen_factor),
                told_from=float(usual * told_factor),
            )
            for c, usual, reach in zip(e.effect.coefficients, study.usual[e.key], e.reach)
        ),
    )


def _gained(before: Plan | None, after: Plan) -> tuple[str, ...]:
    """Pairs that the last recording separates, at least where the effect is large."""
    old = [0.0] * len(after.judged) if before is None else [j.margin_high for j in before.judged]
    return tuple(j.pair.label for j, b in zip(after.judged, old) if j.margin_high >= 1.0 > b)


def _never(j: PairAssessment) -> NeverSeparated:
    if j.lacks:
        why = f"needs {j.lacks}"
    elif j.cos > ALIKE_COS:
        why = f"similarity {j.cos:.3f} (1: identical) over all of the recordings"
    else:
        why = "too small to be seen at their usual size, even in all of the recordings together"
    return NeverSeparated(label=j.pair.label, why=why)


def _separates(step: PlanStep) -> str:
    return f" (separates {', '.join(step.separates)})" if step.separates else ""


def _pair_line(p: JudgedPair) -> str:
    """One pair: verdict, how alike the two are, and from which size each is told."""
    verdict = p.verdict.replace("_", " ")
    if p.cos is None:
        return f"{p.label}: {verdict}, needs {p.lacks}"
    told = "; ".join(f"{m.effect} above {_told_from(m)}" for m in p.members)
    return (
        f"{p.label}: {verdict}, similarity {p.cos:.3f} (1: identical), separable above"
        f" {p.delta_needed_typical:.1f} sigmas over the whole plan: {told}"
    )


def _told_from(member: EffectSizes) -> str:
    """The size of its first coefficient from which it is told."""
    return ", ".join(f"{c.told_from:.2g} {c.unit}" for c in member.coefficients[:1])
