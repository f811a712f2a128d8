"""Gates: may a session change the table? A verdict with reasons, never a bare yes or no."""

from dataclasses import dataclass, field

from scipy.stats import chi2

from alignment.gyrocompass import nis_verdict, rejected_share
from alignment.motion.stillness import DISTURBED, STILL
from infield.session.estimate import SessionEstimate
from infield.session.points import AxisObservability
from infield.table.merge import AXIS_Z_LIMIT, CONFIDENCE, MergeResult
from ins.records import AXES

MIN_REST_S = 300.0
MAX_REJECTED_SHARE = 0.25
PLAIN_NIS = 10.0  # by so much the better of two explanations explains a session: odds of 150 to 1

DECISION_RULE = (
    "A session is merged when the unit was at rest for at least 5 min, gyro temperatures were"
    " logged and moved or were live, the filter's NIS is not above its 99.9 % band, the session"
    " agrees with the stored table within 99.9 %, the run was not merged before, and at least one"
    " gyro's mean bias became better known by 10 % or more."
)


PARKED_RULE = (
    "A session of gyros that find no heading (MEMS) is merged when it holds a parked stretch of at"
    " least 60 s, judged by the raw seconds in sigmas of this unit, gyro temperatures were logged"
    " and moved or were live, the rates change along it as table and noise model allow (NIS not"
    " above its 99.9 % band), the session agrees with the stored table within 99.9 %, the run was"
    " not merged before, and at least one gyro's mean bias became better known by 10 % or more."
)


@dataclass(frozen=True)
class Verdict:
    """`outcome`: "accepted", "refused" or "inconsistent"; reasons in words, each with what was got
    and needed.
    """

    outcome: str
    reasons: tuple[str, ...] = field(default_factory=tuple)

    @property
    def accepted(self) -> bool:
        return self.outcome == "accepted"


def refuse(*reasons: str) -> Verdict:
    return Verdict("refused", reasons)


def judge_estimate(estimate: SessionEstimate, seen: tuple[AxisObservability, ...]) -> Verdict:
    """Is the session sound and does it say anything?"""
    aligned = estimate.alignment
    if estimate.parked is not None:
        return _judge_parked(estimate, seen)
    if aligned.verdict == "inconsistent":
        return Verdict("inconsistent", aligned.reasons)
    if aligned.verdict != "aligned":
        return refuse(*aligned.reasons)
    rest = estimate.motion.seconds(STILL)
    if rest < MIN_REST_S:
        dropped = estimate.motion.seconds(DISTURBED)
        return refuse(
            f"{rest:.0f} s at rest, needed {MIN_REST_S:.0f} s; {dropped:.0f} s were dropped for"
            " motion (listed as excluded)"
        )
    excess = nis_verdict(estimate.nis_mean, estimate.dof)
    if excess:
        return Verdict(
            "inconsistent",
            (excess + "; the twin's noise is too small or an effect is not modelled",),
        )
    share = rejected_share(estimate.navigated)
    if share > MAX_REJECTED_SHARE:
        return Verdict(
            "inconsistent",
            (
                (
                    f"{100 * share:.0f} % of the measurements lie beyond the gate, needed below"
                    f" {100 * MAX_REJECTED_SHARE:.0f} %"
                ),
            ),
        )
    return _judge_gain(seen)


def _judge_parked(estimate: SessionEstimate, seen: tuple[AxisObservability, ...]) -> Verdict:
    """The same for zero-rate biases of a parked unit: its rest was judged before, its noise is
    judged here.
    """
    excess = nis_verdict(estimate.nis_mean, estimate.dof) if estimate.dof else None
    if excess:
        return Verdict(
            "inconsistent",
            (
                excess
                + "; the rates change along the session by more than table and twin allow: a table"
                " that does not fit, a wrong thermometer, or a noise model that is too small",
                *_compensated_before(estimate),
            ),
        )
    return _judge_gain(seen)


def _compensated_before(estimate: SessionEstimate) -> tuple[str, ...]:
    """A reason where the session would agree with the table had the log had it subtracted already;
    by its shape alone.
    """
    p = estimate.parked
    if p is None or p.shape_nis_compensated > min(
        chi2.ppf(CONFIDENCE, max(p.shape_dof, 1)), p.shape_nis - PLAIN_NIS
    ):
        return ()
    return (
        (
            "the rates would agree with the table had it been subtracted already (NIS"
            f" {p.shape_nis_compensated:.0f} instead of {p.shape_nis:.0f}): was this log"
            " compensated? Then run.json needs applied_table_sha256"
        ),
    )


def _judge_gain(seen: tuple[AxisObservability, ...]) -> Verdict:
    if all(axis.verdict == "not_observable" for axis in seen):
        best = min(axis.sigma_after_deg_h / axis.sigma_before_deg_h for axis in seen)
        return refuse(
            f"no gyro gains: the best keeps {100 * best:.0f} % of its prior sigma, needed below"
            " 90 %"
        )
    return Verdict("accepted")


def judge_merge(merged: MergeResult, estimate: SessionEstimate | None = None) -> Verdict:
    """Does the session agree with the stored table? Where it would if the log had it subtracted
    already, that is said.
    """
    if merged.consistent:
        return Verdict("accepted")
    found = []
    if merged.nis > merged.band[1]:
        found.append(
            f"NIS {merged.nis:.1f} for {merged.dof} degrees of freedom, 99.9 % lie below"
            f" {merged.band[1]:.1f}"
        )
    for axis, z in zip(AXES, merged.axis_z):
        if abs(z) > AXIS_Z_LIMIT:
            found.append(
                f"gyro {axis} shifted by {z:+.1f} sigma, 99.9 % of sessions lie within"
                f" {AXIS_Z_LIMIT:.1f}"
            )
    reasons = [f"the session contradicts the stored table: {'; '.join(found)}"]
    if estimate is not None and estimate.parked is not None:
        before = _compensated_before(estimate)
        reasons += before or (
            (
                "its shape over temperature agrees, its level does not: power-ons of this unit may"
                " differ by more than the turn-on of its noise model says (--twin)"
            ),
        )
    return Verdict("inconsistent", tuple(reasons))
