"""Gates: may a session change the table? A verdict with reasons, never a bare yes or no.

Decision: docs/decisions/0016-contradicting-sessions.md.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

from alignment.gyrocompass import nis_verdict, rejected_share
from alignment.motion.kinds import DISTURBED, STILL
from alignment.reasons import LATITUDE_REASONS, AlignmentVerdict
from alignment.result import Solution
from infield.session.estimate import SessionEstimate
from infield.session.points import AxisObservability
from infield.session.reasons import SessionReason, WrongFact
from infield.session.wrong_facts import Suspicion
from infield.table.merge import AXIS_Z_LIMIT, CONFIDENCE, MergeResult
from ins.records import AXES
from ins.robust import chi2
from ins.verdicts import Observability, Outcome, Reason, because

# requirements.md: white noise alone leaves 0.0069 deg/h of 5 min, and a default ring-laser table
# has 0.01
MIN_MERGED_REST_S = 300.0
# of all measurements, and of each source beside the unit: a reversed wheel loses 98 % of its own
# ways, 17 % of all (docs/decisions/0016-contradicting-sessions.md)
MAX_REJECTED_SHARE = 0.25
SOURCES_BESIDE_UNIT = ("lateral", "odometer", "gnss", "centre line")
# A stop after the first roll is judged by itself too: with a latitude entered 1 deg wrong and a
# turn of 90 deg, the gate left out 58 of the 66 measurements at the second stop, 7 % of all, and
# the rest taught the table a bias 27 sigma wrong (tests/infield/test_pipeline.py)
JUDGED_ALONE = ("stop", *SOURCES_BESIDE_UNIT)
PLAIN_NIS = 10.0  # by so much the better of two explanations explains a session: odds of 150 to 1


@dataclass(frozen=True)
class Verdict:
    """`outcome`: accepted, refused or inconsistent; reasons, each with what was got and needed."""

    outcome: Outcome
    reasons: tuple[Reason, ...] = ()

    @property
    def accepted(self) -> bool:
        return self.outcome is Outcome.ACCEPTED


def refuse(*reasons: Reason) -> Verdict:
    return Verdict(Outcome.REFUSED, reasons)


def contradict(*reasons: Reason) -> Verdict:
    return Verdict(Outcome.INCONSISTENT, reasons)


def assess_estimate(estimate: SessionEstimate, seen: tuple[AxisObservability, ...]) -> Verdict:
    """Is the session sound and does it say anything?"""
    if estimate.parked is not None:
        return _judge_parked(estimate, seen)
    unrested = None if estimate.begun is not None else _judge_rest(estimate)
    if unrested is not None:
        return unrested
    excess = nis_verdict(estimate.nis_mean, estimate.dof)
    if excess is not None:
        return contradict(because(SessionReason.EXCESS_RESIDUALS, excess=excess))
    share = rejected_share(estimate.navigated)
    if share > MAX_REJECTED_SHARE:
        beyond = because(
            SessionReason.BEYOND_GATE,
            share_percent=100 * share,
            needed_percent=100 * MAX_REJECTED_SHARE,
        )
        return contradict(beyond)
    disagree = _kinds_beyond_gate(estimate.navigated)
    return contradict(*disagree) if disagree else _judge_gain(seen)


def _judge_rest(estimate: SessionEstimate) -> Verdict | None:
    """What speaks against the first rest of a session; None where nothing does."""
    aligned = estimate.alignment
    if aligned.verdict is AlignmentVerdict.INCONSISTENT:
        return contradict(*aligned.reasons)
    if aligned.verdict is not AlignmentVerdict.ALIGNED:
        return refuse(*aligned.reasons)
    rest_s = estimate.motion.seconds(STILL)
    if rest_s >= MIN_MERGED_REST_S:
        return None
    short = because(
        SessionReason.SHORT_REST,
        rest_s=rest_s,
        needed_s=MIN_MERGED_REST_S,
        dropped_s=estimate.motion.seconds(DISTURBED),
    )
    return refuse(short)


def _kinds_beyond_gate(solution: Solution) -> tuple[Reason, ...]:
    """A reason for each kind that says something else than the rest most of the time."""
    tally = solution.filter.tally
    rejected = Counter(kind for _, kind in tally.rejected)
    shares = {
        kind: rejected[kind] / (rejected[kind] + len(tally.normalised.get(kind, ())))
        for kind in JUDGED_ALONE
        if rejected[kind]
    }
    return tuple(
        because(
            SessionReason.KIND_BEYOND_GATE,
            kind=kind,
            share_percent=100 * share,
            needed_percent=100 * MAX_REJECTED_SHARE,
        )
        for kind, share in shares.items()
        if share > MAX_REJECTED_SHARE
    )


def _judge_parked(estimate: SessionEstimate, seen: tuple[AxisObservability, ...]) -> Verdict:
    """The same for zero-rate biases of a parked unit: its rest was judged before, its noise is
    judged here.
    """
    excess = nis_verdict(estimate.nis_mean, estimate.dof) if estimate.dof else None
    if excess is not None:
        change = because(SessionReason.RATES_CHANGE, excess=excess)
        return contradict(change, *_compensated_before(estimate))
    return _judge_gain(seen)


def _compensated_before(estimate: SessionEstimate) -> tuple[Reason, ...]:
    """A reason where the session would agree with the table had the log had it subtracted already;
    by its shape alone.
    """
    p = estimate.parked
    if p is None:
        return ()
    band = float(chi2.ppf(CONFIDENCE, max(p.shape_dof, 1)))
    if p.shape_nis_compensated > min(band, p.shape_nis - PLAIN_NIS):
        return ()
    before = because(
        SessionReason.COMPENSATED_BEFORE, nis_compensated=p.shape_nis_compensated, nis=p.shape_nis
    )
    return (before,)


def with_likeness(verdict: Verdict, suspected: Sequence[Suspicion]) -> Verdict:
    """A contradiction with the wrong fact that the session resembles most, where there is one.

    Where the alignment found the latitude wrong, that is its cause: another must explain the
    session plainly better, and one that the session does not show the latitude against does not.
    """
    if verdict.outcome is not Outcome.INCONSISTENT:
        return verdict
    if any(reason.code in LATITUDE_REASONS for reason in verdict.reasons):
        nis = [s.sigmas**2 for s in suspected if s.fact is WrongFact.LATITUDE]
        least = max(nis, default=float("inf")) + PLAIN_NIS
        suspected = [s for s in suspected if s.sigmas**2 > least]
    return contradict(*verdict.reasons, *_likeness(suspected))


def _likeness(suspected: Sequence[Suspicion]) -> tuple[Reason, ...]:
    """The wrong fact that convicts a session; a latitude and gyros turned by as much, which a unit
    on one heading does not tell apart, in one sentence.
    """
    found = [s for s in suspected if s.convicts]
    if not found:
        return ()
    alike = [s for s in found if found[0].sigmas ** 2 - s.sigmas**2 < PLAIN_NIS]
    latitude = next((s for s in alike if s.fact is WrongFact.LATITUDE), None)
    turned = next((s for s in alike if s.fact is WrongFact.GYRO_AXES), None)
    if latitude is None:
        return (found[0].reason,)
    if turned is None:
        return (latitude.reason,)
    both = replace(latitude, fact=WrongFact.LATITUDE_OR_AXES, axis=turned.axis)
    return (both.reason,)


def _judge_gain(seen: tuple[AxisObservability, ...]) -> Verdict:
    if all(axis.verdict is Observability.NOT_OBSERVABLE for axis in seen):
        best = min(axis.sigma_after_deg_h / axis.sigma_before_deg_h for axis in seen)
        return refuse(because(SessionReason.NO_GAIN, kept_percent=100 * best))
    return Verdict(Outcome.ACCEPTED)


def assess_merge(
    merged: MergeResult,
    estimate: SessionEstimate | None = None,
    suspected: Sequence[Suspicion] = (),
) -> Verdict:
    """Does the session agree with the stored table? Where it would if the log had it subtracted
    already, that is said; so is the wrong fact that it resembles most.
    """
    found = list(_likeness(suspected))
    if merged.consistent and not found:
        return Verdict(Outcome.ACCEPTED)
    if merged.nis > merged.band[1]:
        found.append(
            because(
                SessionReason.MERGE_RESIDUALS, nis=merged.nis, dof=merged.dof, limit=merged.band[1]
            )
        )
    for axis, z in zip(AXES, merged.axis_z):
        if abs(z) > AXIS_Z_LIMIT:
            found.append(
                because(
                    SessionReason.AXIS_SHIFTED, axis=axis, shift_sigmas=z, limit_sigmas=AXIS_Z_LIMIT
                )
            )
    against = because(SessionReason.AGAINST_TABLE, found=tuple(found))
    if estimate is None or estimate.parked is None:
        return contradict(against)
    before = _compensated_before(estimate)
    return contradict(against, *(before or (because(SessionReason.LEVEL_OFF),)))
