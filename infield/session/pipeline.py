"""The spine: runs of one unit and its stored table in, a judged update out.

read temperature -> find the rest -> estimate the session -> judge it -> merge it -> judge the
merge -> next run then over all runs: heating against cooling (hysteresis), sessions that agree
against the table (disagreement)
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from alignment.motion.standstill import speed_disagreement
from infield.session import acceptance
from infield.session.acceptance import Verdict
from infield.session.disagreement import (
    SessionEvidence,
    Step,
    find_steps,
    session_evidence,
    utc,
    widened_for,
)
from infield.session.hysteresis import ThermalTerm
from infield.session.joint_update import with_thermal_terms
from infield.session.navigated.claim_chain import ClaimChain, run_claim_chain
from infield.session.navigated.estimator import (
    SessionEstimate,
    SessionSettings,
    compensated_imu,
    estimate_session,
    find_rest,
    refuse_without_settled_part,
    session_end,
    table_series,
)
from infield.session.parked.rates import estimate_parked, no_heading
from infield.session.parked.stretches import find_rests
from infield.session.points import AxisObservability, observability, session_points
from infield.table.merge import MergeResult, SessionPoints, merge_posterior
from infield.table.thermal_table import AgeingModel, ThermalTable
from infield.thermometer.gyro_temperature import (
    GyroTemperature,
    gyro_temperature,
    no_thermometer,
    plausible_range,
    too_short,
    words,
)
from ins.compensation import compensate, corrected
from ins.records import ImuLog, InputError, Run, TwinModel
from ins.units import DEG_PER_HOUR

NEVER_RESTS = (
    "the run never rests for a minute; a parked alignment and 30 min in navigation are needed"
)
LEVEL_REMOVED = (
    "a constant of the session had been subtracted from the rates (an autopilot's start-up gyro"
    " offsets): their level is not the unit's; convert the log again with gyro_offsets ="
    ' "add_back" in the map'
)
LEAST_COVERED = 0.1  # of a session that needs a gyro temperature


@dataclass(frozen=True)
class SessionResult:
    """One run's part in an update; `estimate` and what follows are None where it was refused
    before.
    """

    run: Run
    verdict: Verdict
    temperature: GyroTemperature | None = None
    estimate: SessionEstimate | None = None
    seen: tuple[AxisObservability, ...] = ()
    points: SessionPoints | None = None
    merged: MergeResult | None = None
    chain: ClaimChain | None = None


@dataclass(frozen=True)
class UpdateResult:
    """outcome: "accepted", "refused" or "inconsistent"; `after` is `before` where nothing was
    merged.

    terms: heating against cooling, per axis; steps: where several sessions agree against the table;
    step_accepted: the table was widened for them; evidence: what is worth remembering of sessions
    that contradict the table.
    """

    outcome: str
    reasons: tuple[str, ...]
    before: ThermalTable
    after: ThermalTable
    sessions: tuple[SessionResult, ...]
    twin: TwinModel
    settings: SessionSettings
    ageing: AgeingModel
    merged_runs: tuple[Run, ...] = field(default_factory=tuple)
    terms: tuple[ThermalTerm, ...] = ()
    steps: tuple[Step, ...] = ()
    step_accepted: bool = False
    evidence: tuple[SessionEvidence, ...] = ()


@dataclass(frozen=True)
class _Taken:
    """Runs taken one after the other: their results, the table after them, those merged."""

    sessions: list[SessionResult]
    table: ThermalTable
    merged_runs: list[Run]
    terms: tuple[ThermalTerm, ...]


def update_calibration(
    runs: Sequence[Run],
    table: ThermalTable,
    twin: TwinModel,
    *,
    parent_sha256: str | None,
    settings: SessionSettings | None = None,
    ageing: AgeingModel | None = None,
    already_merged: Callable[[str], bool] = lambda sha256: False,
    applied_table: Callable[[str], ThermalTable] | None = None,
    remembered: Sequence[SessionEvidence] = (),
    accept_step: bool = False,
) -> UpdateResult:
    """Recalibrate one unit's table from its runs, taken in the order of their start.

    already_merged(run_sha256) tells whether the table holds a run; applied_table(sha256) gives the
    table that a unit had subtracted (InputError where unknown). A run that contradicts model or
    table makes the whole update inconsistent; a refused run is left out with its reasons.
    remembered: earlier sessions that contradicted the table. With accept_step, a step that at least
    two sessions agree on is followed: the table is widened for it and the runs are taken again.
    """
    settings, ageing = settings or SessionSettings(), ageing or AgeingModel()
    _check_unit(runs, table, twin)

    def take(steps: tuple[Step, ...]) -> _Taken:
        return _take(runs, table, twin, settings, ageing, already_merged, applied_table, steps)

    taken = take(())
    evidence = _evidence(taken)
    steps = find_steps(taken.table, [*remembered, *evidence])
    accepted = accept_step and bool(steps)
    if accepted:
        taken = take(steps)
    outcome, reasons = _overall(taken.sessions)
    after, merged_runs = table, []
    if outcome == "accepted":
        after, merged_runs = _with_provenance(taken, table, parent_sha256, steps), taken.merged_runs
    else:
        reasons = (*reasons, *(step.words() for step in steps))
    if accept_step and not steps:
        reasons = (
            *reasons,
            "no step to accept: at least two sessions must agree with each other against the table",
        )
    return UpdateResult(
        outcome,
        reasons,
        table,
        after,
        tuple(taken.sessions),
        twin,
        settings,
        ageing,
        tuple(merged_runs),
        taken.terms,
        steps,
        accepted and outcome == "accepted",
        evidence,
    )


def _take(
    runs: Sequence[Run],
    table: ThermalTable,
    twin: TwinModel,
    settings: SessionSettings,
    ageing: AgeingModel,
    already_merged: Callable[[str], bool],
    applied_table: Callable[[str], ThermalTable] | None,
    steps: tuple[Step, ...],
) -> _Taken:
    """One run after the other; the table is widened before the first run at or after each step's
    date.
    """
    current, waiting = table, list(steps)
    sessions: list[SessionResult] = []
    merged_runs: list[Run] = []
    for run in sorted(runs, key=lambda r: utc(r.header.start_utc)):
        due = [step for step in waiting if utc(step.since_utc) <= utc(run.header.start_utc)]
        current, waiting = widened_for(current, due), [step for step in waiting if step not in due]
        repeated = already_merged(run.sha256) or any(run.sha256 == m.sha256 for m in merged_runs)
        raw = with_applied_table_undone(run, applied_table)
        result = _one_session(
            raw,
            current.aged(_days_between(current.created_utc, run.header.start_utc), ageing),
            twin,
            settings,
            repeated,
        )
        sessions.append(result)
        if result.verdict.accepted and result.merged is not None:
            merged_runs.append(run)
            current = result.merged.table.replaced(
                created_utc=_later(current.created_utc, run.header.start_utc)
            )
    oldest = min(
        (_days_between(table.created_utc, s.run.header.start_utc) for s in sessions), default=0.0
    )
    base = widened_for(table, steps).aged(oldest, ageing)
    terms, judged, joint = with_thermal_terms(sessions, base, twin, settings)
    if joint is not None:
        merged_runs = [s.run for s in judged if s.verdict.accepted and s.merged is not None]
        last = max((run.header.start_utc for run in merged_runs), key=utc)
        current = joint.replaced(created_utc=_later(table.created_utc, last))
    return _Taken(judged, current, merged_runs, terms)


def _evidence(taken: _Taken) -> tuple[SessionEvidence, ...]:
    """Of the sessions that contradict the table, what is remembered; a gyro far off it shows as a
    wrong latitude too.
    """
    return tuple(
        session_evidence(s.run, taken.table, s.estimate, s.points)
        for s in taken.sessions
        if s.verdict.outcome == "inconsistent"
        and s.estimate is not None
        and s.points is not None
        and (s.merged is not None or s.estimate.alignment.verdict == "inconsistent")
    )


def _later(one_utc: str, other_utc: str) -> str:
    return other_utc if utc(other_utc) > utc(one_utc) else one_utc


def _one_session(
    run: Run, table: ThermalTable, twin: TwinModel, settings: SessionSettings, repeated: bool
) -> SessionResult:
    """One run against the table as it stands."""
    if repeated:
        return SessionResult(
            run, acceptance.refuse("the table already holds this run (same content hash)")
        )
    short = too_short(run.temperature)
    if run.temperature is None or short:
        return SessionResult(run, acceptance.refuse(short))
    temperature = gyro_temperature(run.temperature, plausible_degC=plausible_range(table))
    if len(temperature.unusable) == 3:
        return SessionResult(run, acceptance.refuse(*no_thermometer(temperature)), temperature)
    low, high = (
        temperature.temperature_degC.min(axis=0).min(),
        temperature.temperature_degC.max(axis=0).max(),
    )
    table, end_s = table.extended_to(float(low), float(high)), session_end(run)
    estimate = _estimated(run, table, temperature, twin, settings, end_s)
    if isinstance(estimate, Verdict):
        return SessionResult(run, estimate, temperature)
    seen = observability(
        estimate, hold_heading=settings.hold_heading, unusable=temperature.why_unusable()
    )
    points = session_points(run, estimate)
    chain = _claim_chain(run, table, temperature, twin, estimate, end_s)
    against = speed_disagreement(run, estimate.motion)
    verdict = acceptance.refuse(*against) if against else acceptance.judge_estimate(estimate, seen)
    if not verdict.accepted:
        return SessionResult(run, verdict, temperature, estimate, seen, points, None, chain)
    bins = estimate.bins
    merged = merge_posterior(
        table,
        bins.H,
        bins.table_deg_h,
        bins.prior,
        bins.table_deg_h + estimate.mean_deg_h,
        estimate.covariance,
        held_axes=[axis.axis for axis in seen if axis.verdict == "not_observable"],
    )
    return SessionResult(
        run,
        acceptance.judge_merge(merged, estimate),
        temperature,
        estimate,
        seen,
        points,
        merged,
        chain,
    )


def _estimated(
    run: Run,
    table: ThermalTable,
    temperature: GyroTemperature,
    twin: TwinModel,
    settings: SessionSettings,
    end_s: float,
) -> SessionEstimate | Verdict:
    """The session's biases: through navigation, or for gyros that find no heading from the parked
    rates themselves.
    """
    rests = find_rests(run) if no_heading(run, table, temperature, twin) else None
    rest, why = (
        (find_rest(run), NEVER_RESTS)
        if rests is None
        else (next(iter(rests.stretches), None), rests.why)
    )
    level = (LEVEL_REMOVED,) if run.header.level_removed else ()
    if rest is None or level:
        return acceptance.refuse(*level, *((why,) if rest is None else ()))
    spans = [(rest[0], end_s)] if rests is None else rests.stretches
    known = max(temperature.covered(*span).max() for span in spans)
    if known < LEAST_COVERED:
        reason = (
            f"gyro temperature is known for {100 * known:.0f} % of the session, needed"
            f" {100 * LEAST_COVERED:.0f} %"
        )
        return acceptance.refuse(reason, *map(words, temperature.faults))
    if rests is not None:
        found = estimate_parked(run, table, temperature, twin, settings, rests=rests)
        return acceptance.refuse(found) if isinstance(found, str) else found
    try:
        return estimate_session(run, table, temperature, twin, settings, rest=rest, end_s=end_s)
    except ArithmeticError as lost:
        return acceptance.refuse(f"the filter cannot follow this log: {lost}")


def _claim_chain(
    run: Run,
    table: ThermalTable,
    temperature: GyroTemperature,
    twin: TwinModel,
    estimate: SessionEstimate,
    end_s: float,
) -> ClaimChain | None:
    """The patent's own path on the same data, for the report."""
    aligned = estimate.alignment
    if aligned.C_nb is None or end_s - aligned.time_s < 600.0:
        return None
    imu = compensated_imu(run, table, temperature, twin)
    return run_claim_chain(
        imu,
        run.header.site,
        twin,
        aligned,
        temperature,
        phases=run.phases,
        until_s=end_s,
        prior_sigma_deg_h=float(np.sqrt(np.diag(estimate.bins.prior)[:2].max())),
    )


def _check_unit(runs: Sequence[Run], table: ThermalTable, twin: TwinModel) -> None:
    """InputError unless runs, table and twin are of one unit."""
    for run in runs:
        header = run.header
        got = (header.imu_serial, header.gyro_technology, header.gyro_mode)
        need = (table.imu_serial, table.gyro_technology, table.gyro_mode)
        if got != need:
            raise InputError(
                f"run {header.run_id}: unit {_unit(got)}, the table is of {_unit(need)}"
            )
    if twin.imu_serial and twin.imu_serial != table.imu_serial:
        raise InputError(f"twin of unit {twin.imu_serial}, the run is of {table.imu_serial}")
    if twin.gyro_technology != table.gyro_technology:
        raise InputError(
            f"twin of a {twin.gyro_technology} unit, the run is of a {table.gyro_technology} unit"
        )


def _unit(key: tuple[str, str, str]) -> str:
    return " ".join(part for part in key if part)


def with_applied_table_undone(run: Run, applied_table: Callable[[str], ThermalTable] | None) -> Run:
    """The run with raw gyro output: a table that the unit had subtracted is added back; InputError
    where it cannot be.
    """
    refuse_without_settled_part(run)
    sha256 = run.header.applied_table_sha256
    if sha256 is None:
        return run
    if applied_table is None:
        raise InputError(
            f"run {run.header.run_id}: applied_table_sha256 {sha256[:12]} is unknown: no store to"
            " find it in"
        )
    table = applied_table(sha256)
    if run.temperature is None:
        raise InputError(
            f"run {run.header.run_id}: a table was applied but no temperature is logged: cannot be"
            " undone"
        )
    bias_at = table_series(
        table, gyro_temperature(run.temperature, plausible_degC=plausible_range(table))
    )

    def restored(piece: ImuLog) -> ImuLog:
        return compensate(piece, gyro_bias_rad_s=-bias_at(piece.time_s) * DEG_PER_HOUR)

    return replace(run, imu=corrected(run.imu, restored))


def _days_between(earlier_utc: str, later_utc: str) -> float:
    return max((utc(later_utc) - utc(earlier_utc)).total_seconds() / 86400.0, 0.0)


def _overall(sessions: Sequence[SessionResult]) -> tuple[str, tuple[str, ...]]:
    """One verdict for the update: inconsistent if any session is, accepted if any is, else
    refused.
    """
    outcomes = [s.verdict.outcome for s in sessions]
    name = (
        "inconsistent"
        if "inconsistent" in outcomes
        else "accepted"
        if "accepted" in outcomes
        else "refused"
    )
    reasons = [f"{s.run.header.run_id}: {r}" for s in sessions for r in s.verdict.reasons]
    return name, tuple(reasons)


def _with_provenance(
    taken: _Taken, before: ThermalTable, parent_sha256: str | None, steps: Sequence[Step]
) -> ThermalTable:
    old = [dict(r) if isinstance(r, dict) else r for r in before.provenance.get("runs", [])]
    new = [{"run_id": run.header.run_id, "sha256": run.sha256} for run in taken.merged_runs]
    said = {**before.provenance, "parent_sha256": parent_sha256, "runs": old + new}
    if steps:
        said["accepted_steps"] = [
            *before.provenance.get("accepted_steps", []),
            *(
                {
                    "axis": s.axis,
                    "shift_deg_h": s.shift_deg_h,
                    "sigma_deg_h": s.sigma_deg_h,
                    "since_utc": s.since_utc,
                    "sessions": list(s.run_sha256),
                }
                for s in steps
            ),
        ]
    fitted = {
        t.axis: {"value": t.value, "sigma": t.sigma}
        for t in taken.terms
        if t.action == "rate term fitted"
    }
    if fitted:
        said["rate_terms_deg_h_per_degC_min"] = fitted
    return taken.table.replaced(provenance=said)
