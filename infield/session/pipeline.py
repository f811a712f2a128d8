"""The spine: runs of one unit and its stored table in, a judged update out.

Its steps, run by run::

    read temperature -> find the rest -> estimate the session -> judge it
        -> merge it -> judge the merge -> next run
    then over all runs: heating against cooling (hysteresis),
        sessions that agree against the table (disagreement)
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import datetime

from alignment.reasons import AlignmentVerdict
from infield.session.disagreement import BiasStep, SessionEvidence, find_steps, utc
from infield.session.hysteresis import ThermalTerm
from infield.session.identity.marks import UnitMarks
from infield.session.joint_update import Walk, find_flight_terms, with_thermal_terms
from infield.session.log import applied_table_of, with_applied_table_undone
from infield.session.one_run import OnRecord, take_run
from infield.session.points import session_evidence
from infield.session.reasons import SessionReason, ThermalAction
from infield.session.results import SessionResult, UpdateResult
from infield.session.settings import SessionSettings
from infield.table.thermal_table import AgeingModel, ThermalTable
from ins.records import InputError, Run, TwinModel
from ins.verdicts import Outcome, Reason, because


@dataclass(frozen=True, kw_only=True)
class UnitHistory:
    """What is on record of a unit before an update.

    parent_sha256: hash of the stored table. already_merged(run_sha256) tells whether the table
    holds a run; applied_table(sha256) gives the table that a unit had subtracted (InputError where
    unknown). remembered: earlier sessions that contradicted the table. marks: what identifies the
    unit, of the sessions that the table holds. now: when the update is made, None: no run is held
    against it.
    """

    parent_sha256: str | None = None
    already_merged: Callable[[str], bool] = lambda sha256: False
    applied_table: Callable[[str], ThermalTable] | None = None
    remembered: Sequence[SessionEvidence] = ()
    marks: Sequence[UnitMarks] = ()
    now: datetime | None = None


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
    history: UnitHistory | None = None,
    settings: SessionSettings | None = None,
    ageing: AgeingModel | None = None,
    accept_step: bool = False,
) -> UpdateResult:
    """Recalibrate one unit's table from its runs, taken in the order of their start.

    A run that contradicts model or table makes the whole update inconsistent; a refused run is left
    out with its reasons. With accept_step, a step that at least two sessions agree on is followed:
    the table is widened for it and the runs are taken again; so they are with a wider prior of what
    gyros read in flight beyond what they read at rest, where several flights show such a term.
    """
    history = history or UnitHistory()
    settings = settings or SessionSettings()
    ageing = ageing or AgeingModel()
    _check_unit(runs, table, twin)

    def take(steps: tuple[BiasStep, ...], wider: SessionSettings) -> _Taken:
        return _take(runs, table, twin, wider, Walk(ageing=ageing, steps=steps), history)

    taken = take((), settings)
    walk = Walk(ageing=ageing)
    flight_terms = find_flight_terms(taken.sessions, table, twin, settings, walk)
    found = [abs(term.value_deg_h) for term in flight_terms if term.found]
    if found:
        settings = settings.with_shift(table.gyro_technology, max(found))
        taken = take((), settings)
    evidence = _evidence(taken)
    steps = find_steps(taken.table, [*history.remembered, *evidence])
    accepted = accept_step and bool(steps)
    if accepted:
        taken = take(steps, settings)
    outcome, reasons = _overall(taken.sessions)
    after, merged_runs = table, []
    if outcome is Outcome.ACCEPTED:
        after, merged_runs = (
            _with_provenance(taken, table, history.parent_sha256, steps),
            taken.merged_runs,
        )
    else:
        reasons = (*reasons, *(step.reason for step in steps))
    if accept_step and not steps:
        reasons = (*reasons, because(SessionReason.NO_STEP))
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
        accepted and outcome is Outcome.ACCEPTED,
        evidence,
        flight_terms,
    )


def _take(
    runs: Sequence[Run],
    table: ThermalTable,
    twin: TwinModel,
    settings: SessionSettings,
    walk: Walk,
    history: UnitHistory,
) -> _Taken:
    """One run after the other, on the table as it went on until its start."""
    current = table
    sessions: list[SessionResult] = []
    merged_runs: list[Run] = []
    for run in sorted(runs, key=lambda r: utc(r.header.start_utc)):
        repeated = history.already_merged(run.sha256) or any(
            run.sha256 == m.sha256 for m in merged_runs
        )
        applied = applied_table_of(run, history.applied_table)
        raw = with_applied_table_undone(run, history.applied_table)
        agreeing = [s.marks for s in sessions if s.verdict.accepted and s.marks is not None]
        result = take_run(
            raw,
            walk.until(current, run, merged_runs[-1] if merged_runs else None),
            twin,
            settings,
            repeated,
            OnRecord(
                marks=(*history.marks, *agreeing),
                applied=applied,
                of_place=_of_place(run, runs),
                of_update=len({run.sha256 for run in runs}),
                now=history.now,
                stored=None if walk.steps else table,
            ),
        )
        sessions.append(result)
        if result.verdict.accepted and result.merged is not None:
            merged_runs.append(run)
            current = result.merged.table.replaced(
                created_utc=_later(current.created_utc, run.header.start_utc)
            )
    terms, judged, joint = with_thermal_terms(sessions, table, twin, settings, walk)
    if joint is not None:
        merged_runs = [s.run for s in judged if s.verdict.accepted and s.merged is not None]
        last = max((run.header.start_utc for run in merged_runs), key=utc)
        current = joint.replaced(created_utc=_later(table.created_utc, last))
    return _Taken(judged, current, merged_runs, terms)


def _of_place(run: Run, runs: Sequence[Run]) -> int:
    """How many different runs, itself among them, may have one latitude's error in common."""
    site = run.header.site
    near = [r for r in runs if abs(r.header.site.lat_rad - site.lat_rad) <= site.sigma_lat_rad]
    return len({r.sha256 for r in near})


def _evidence(taken: _Taken) -> tuple[SessionEvidence, ...]:
    """Of the sessions that contradict the table, what is remembered."""
    return tuple(
        session_evidence(s.run, taken.table, s.estimate, s.points)
        for s in taken.sessions
        if s.verdict.outcome is Outcome.INCONSISTENT
        and s.estimate is not None
        and s.points is not None
        and (s.merged is not None or s.estimate.alignment.verdict is AlignmentVerdict.INCONSISTENT)
    )


def _later(one_utc: str, other_utc: str) -> str:
    return other_utc if utc(other_utc) > utc(one_utc) else one_utc


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


def _overall(sessions: Sequence[SessionResult]) -> tuple[Outcome, tuple[Reason, ...]]:
    """One verdict for the update: inconsistent if any session is, accepted if any is, else
    refused.
    """
    outcomes = [s.verdict.outcome for s in sessions]
    weighed = (Outcome.INCONSISTENT, Outcome.ACCEPTED, Outcome.REFUSED)
    overall = next((outcome for outcome in weighed if outcome in outcomes), Outcome.REFUSED)
    reasons: list[Reason] = []
    for session in sessions:
        run_id = session.run.header.run_id
        reasons += [
            because(SessionReason.OF_RUN, run_id=run_id, reason=reason)
            for reason in session.verdict.reasons
        ]
    return overall, tuple(reasons)


def _with_provenance(
    taken: _Taken, before: ThermalTable, parent_sha256: str | None, steps: Sequence[BiasStep]
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
        if t.action is ThermalAction.RATE_TERM_FITTED
    }
    if fitted:
        said["rate_terms_deg_h_per_degC_min"] = fitted
    return taken.table.replaced(provenance=said)
