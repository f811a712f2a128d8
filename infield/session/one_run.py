"""One run against the table as it stands: estimated, judged and merged."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import datetime

import numpy as np

from alignment.linearised import NothingStands
from alignment.motion.inertial import Where
from alignment.motion.speeds import speed_disagreement, steady_roll
from infield.session import acceptance
from infield.session.acceptance import Verdict
from infield.session.estimate import SessionEstimate
from infield.session.flown.evidence import fly, fly_in_motion
from infield.session.flown.flight import RunInputs
from infield.session.flown.information_gain import FlightEvidence
from infield.session.flown.without_heading import fly_never_at_rest
from infield.session.identity.history import likeness
from infield.session.identity.marks import UnitMarks, unit_marks
from infield.session.log import compensated_imu, find_rest, session_end
from infield.session.navigated.claim_chain import ChainSpan, ClaimChain, run_claim_chain
from infield.session.navigated.estimator import AlignmentRefused, estimate_session
from infield.session.navigated.own_errors import not_estimated
from infield.session.parked.rates import estimate_parked, no_heading
from infield.session.parked.stretches import StationarySegments, stationary_segments
from infield.session.points import observability, session_points, unseen_axes
from infield.session.reasons import OwnErrorState, SessionReason
from infield.session.results import SessionResult
from infield.session.settings import SessionSettings
from infield.session.wrong_facts import (
    doubtful_compensation,
    force_off_gravity,
    suspicions,
    widened_by,
    widened_for_own_errors,
    widened_for_place,
    with_suspicions,
)
from infield.table.thermal_table import ThermalTable
from infield.thermometer.gyro_temperature import (
    GyroTemperature,
    fault_reason,
    gyro_temperature,
    no_thermometer,
    plausible_range,
    too_short,
)
from ins.records import Run, TwinModel
from ins.thermometer_faults import of_another_run
from ins.verdicts import Outcome, Reason, because

LEAST_COVERED = 0.1  # of a session that needs a gyro temperature; chosen: of an hour 6 min, one bin


@dataclass(frozen=True)
class OnRecord:
    """What is on record for one run. marks: of the unit's earlier sessions; applied: the table that
    the log says it had subtracted, None of a raw one; of_place: how many runs of the update were
    made at its place, of_update: of all; now: when the update is made, None: nobody asks; stored:
    the table as it was before the update, which a unit may have applied, None where a step from it
    is followed.
    """

    marks: Sequence[UnitMarks] = ()
    applied: ThermalTable | None = None
    of_place: int = 1
    of_update: int = 1
    now: datetime | None = None
    stored: ThermalTable | None = None


def take_run(
    run: Run,
    table: ThermalTable,
    twin: TwinModel,
    settings: SessionSettings,
    repeated: bool,
    on_record: OnRecord | None = None,
) -> SessionResult:
    """One run against the table as it stands."""
    on_record = on_record or OnRecord()
    if repeated:
        return SessionResult(run, acceptance.refuse(because(SessionReason.ALREADY_MERGED)))
    amiss = _ahead_of(run, on_record.now) or too_short(run.temperature) or _outlasted(run)
    if amiss is not None:
        return SessionResult(run, acceptance.refuse(amiss))
    assert run.temperature is not None
    temperature = gyro_temperature(run.temperature, plausible_degC=plausible_range(table))
    if len(temperature.unusable) == 3:
        return SessionResult(run, acceptance.refuse(*no_thermometer(temperature)), temperature)
    low, high = (
        temperature.temperature_degC.min(axis=0).min(),
        temperature.temperature_degC.max(axis=0).max(),
    )
    table, end_s = table.extended_to(float(low), float(high)), session_end(run)
    begun = _begun(RunInputs(run, table, temperature, twin, settings))
    if isinstance(begun.estimate, Verdict):
        return SessionResult(run, begun.estimate, temperature, flight=begun.flight)
    estimate, flight = begun.estimate, begun.flight
    chain = None
    if settings.claim_chain:
        chain = _claim_chain(run, table, temperature, twin, estimate, end_s)
    marks = unit_marks(run, twin, estimate)
    alike = likeness(marks, on_record.marks) if settings.check_unit else None
    if flight is None:
        flight = fly(RunInputs(run, table, temperature, twin, settings), estimate)
    joined = None if flight is None else flight.joined
    estimate = joined or estimate
    if estimate.own is None:
        own = not_estimated(run, OwnErrorState.NO_HEADING)
        estimate = replace(estimate, own=own)
    seen = observability(
        estimate,
        hold_heading=settings.hold_heading,
        flown=joined is not None,
        unusable=temperature.why_unusable(),
    )
    points = session_points(run, estimate)
    against = speed_disagreement(run, estimate.motion)
    verdict = acceptance.refuse(*against) if against else acceptance.assess_estimate(estimate, seen)
    off = force_off_gravity(run, twin, estimate)
    declared = doubtful_compensation(estimate, on_record.stored, on_record.applied)
    against_it = [
        off,
        None if alike is None or alike.same else alike.reason,
        declared.reason if declared is not None and declared.convicts else None,
    ]
    wrong = [reason for reason in against_it if reason is not None]
    if wrong and verdict.outcome is not Outcome.REFUSED:
        verdict = acceptance.contradict(*wrong, *verdict.reasons)
    told = SessionResult(
        run,
        verdict,
        temperature,
        estimate,
        seen,
        points,
        None,
        chain,
        flight=flight,
        marks=marks,
        likeness=alike,
    )
    if not verdict.accepted:
        return replace(told, verdict=acceptance.with_likeness(verdict, suspicions(estimate)))
    held = unseen_axes(seen)
    merged = estimate.merged_into(table, held)
    verdict = acceptance.assess_merge(merged, estimate, suspicions(estimate))
    if not verdict.accepted:
        return replace(told, verdict=verdict, merged=merged)
    wider = estimate if declared is None else widened_by(estimate, declared.pattern)
    wider = widened_for_place(wider, run.header.site, on_record.of_place)
    wider = widened_for_own_errors(wider, on_record.of_update)
    wider, doubted = with_suspicions(wider)
    if wider is not estimate:
        merged = wider.merged_into(table, held)
        verdict = acceptance.assess_merge(merged, wider, suspicions(wider))
    return replace(
        told,
        verdict=verdict,
        estimate=wider,
        merged=merged,
        doubted=doubted if declared is None else (declared, *doubted),
    )


def _ahead_of(run: Run, now: datetime | None) -> Reason | None:
    """A reason where the run starts in the future."""
    if now is None or not run.header.starts_after(now):
        return None
    return because(
        SessionReason.STARTS_IN_FUTURE,
        start_utc=run.header.start_utc,
        now_utc=f"{now:%Y-%m-%dT%H:%M:%SZ}",
    )


def _outlasted(run: Run) -> Reason | None:
    """A reason where the temperatures are hardly of this run: they go on long after it."""
    log, imu = run.temperature, run.imu
    if log is None or not of_another_run(log.time_s, imu.start_s, imu.end_s):
        return None
    until_s = float(log.time_s[-1])
    return because(SessionReason.OTHER_TEMPERATURES, until_s=until_s, end_s=imu.end_s)


@dataclass(frozen=True)
class _Begun:
    """A session without what follows its take-off, or why there is none. flight: of a log that
    begins in motion; where it was joined the estimate holds it.
    """

    estimate: SessionEstimate | Verdict
    flight: FlightEvidence | None = None


def _begun(known: RunInputs) -> _Begun:
    """The session's biases: through navigation, or for gyros that find no heading from the parked
    rates themselves; with the flight that a log begins with.
    """
    run = known.run
    rests = None
    if no_heading(run, known.table, known.temperature, known.twin):
        rests = stationary_segments(run)
    rest, why = _first_rest(run, rests)
    if run.header.level_removed:
        removed = because(SessionReason.LEVEL_REMOVED)
        return _Begun(acceptance.refuse(removed, *([] if why is None else [why])))
    parked: SessionEstimate | Verdict = acceptance.refuse(*([] if why is None else [why]))
    if rest is not None and why is None:
        parked = _estimated(known, rest, rests)
    if rests is not None:
        return _unrested(known, rests, parked) if isinstance(parked, Verdict) else _Begun(parked)
    after = None if isinstance(parked, Verdict) else parked
    flight = fly_in_motion(known, rest, after)
    if flight is None:
        return _Begun(parked)
    if isinstance(parked, Verdict):
        parked = flight.joined or acceptance.refuse(*parked.reasons, *flight.reasons)
    return _Begun(parked, flight)


def _unrested(known: RunInputs, rests: StationarySegments, refused: Verdict) -> _Begun:
    """A unit that finds no heading and of which no rest was taken: what it shows under way."""
    imu = known.run.imu
    against = _uncovered(known.temperature, [(imu.start_s, imu.end_s)])
    flight = None if against is not None else fly_never_at_rest(known, rests)
    if flight is None:
        return _Begun(refused)
    joined = flight.joined or acceptance.refuse(*refused.reasons, *flight.reasons)
    return _Begun(joined, flight)


def _estimated(
    known: RunInputs, rest: Where, rests: StationarySegments | None
) -> SessionEstimate | Verdict:
    """The session from its first rest on. rests: of a unit that finds no heading."""
    end_s = session_end(known.run, rest[0])
    spans = [(rest[0], end_s)] if rests is None else rests.stretches
    against = _uncovered(known.temperature, spans)
    if against is not None:
        return against
    of_run = known.run, known.table, known.temperature, known.twin, known.settings
    if rests is not None:
        found = estimate_parked(*of_run, rests=rests)
        return acceptance.refuse(found) if isinstance(found, Reason) else found
    try:
        return estimate_session(*of_run, rest=rest, end_s=end_s)
    except AlignmentRefused as refused:
        return acceptance.refuse(*refused.reasons)
    except NothingStands as moves:
        return acceptance.refuse(
            because(
                SessionReason.REST_MOVES,
                **moves.reason.values,
                needed_s=acceptance.MIN_MERGED_REST_S,
            )
        )
    except ArithmeticError as lost:
        return acceptance.refuse(because(SessionReason.FILTER_LOST, fault=str(lost)))


def _uncovered(temperature: GyroTemperature, spans: Sequence[Where]) -> Verdict | None:
    """What speaks against a session whose gyros have no temperature; None where they have."""
    known = max(temperature.covered(*span).max() for span in spans)
    if known >= LEAST_COVERED:
        return None
    uncovered = because(
        SessionReason.TEMPERATURE_UNCOVERED,
        known_percent=100 * known,
        needed_percent=100 * LEAST_COVERED,
    )
    return acceptance.refuse(uncovered, *map(fault_reason, temperature.faults))


def _first_rest(run: Run, rests: StationarySegments | None) -> tuple[Where | None, Reason | None]:
    """The first rest of the log, or why there is none; rests: of a unit without a heading."""
    if rests is not None:
        return (rests.stretches[0] if rests.stretches else None), rests.why
    rest = find_rest(run)
    if rest is not None:
        return rest, None
    return None, steady_roll(run) or because(SessionReason.NEVER_RESTS)


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
    if estimate.solution is None or aligned.C_nb is None or end_s - aligned.time_s < 600.0:
        return None
    imu = compensated_imu(run, table, temperature, twin)
    return run_claim_chain(
        imu,
        ChainSpan(run.header.site, aligned, end_s),
        twin,
        temperature,
        motion=estimate.solution.motion,
        prior_sigma_deg_h=float(np.sqrt(np.diag(estimate.bins.prior)[:2].max())),
    )
