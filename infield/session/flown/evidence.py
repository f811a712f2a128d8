"""A run's flight: estimated, judged, and joined to its ground session or left out."""

from collections.abc import Callable
from dataclasses import replace

from alignment.motion.inertial import Where
from infield.session.estimate import SessionEstimate
from infield.session.flown.estimator import FlownEstimate, estimate_flown
from infield.session.flown.fixes import usable
from infield.session.flown.flight import RunInputs, find_flight
from infield.session.flown.gates import (
    SuspectedShift,
    against_joining,
    carried,
    deflected,
    rested,
    suspected_shift,
    uncovered,
)
from infield.session.flown.in_motion import estimate_in_motion, flight_from
from infield.session.flown.information_gain import FlightEvidence, information_gain
from infield.session.flown.start import begins_in_motion, fast_before, find_moving_start
from infield.session.flown.without_heading import fly_without_heading
from infield.session.log import compensated_imu
from infield.session.reasons import FlightReason
from ins.verdicts import Reason, because

Estimator = Callable[[RunInputs], FlownEstimate]


def fly(known: RunInputs, ground: SessionEstimate) -> FlightEvidence | None:
    """The flight after a ground session; None where the run does not fly with a receiver."""
    run, twin = known.run, known.twin
    if ground.parked is not None:
        return fly_without_heading(known, ground)
    if run.gnss is None or not known.settings.use_gnss or ground.solution is None:
        return None
    fixes, repeated = usable(run.gnss)
    flight = find_flight(run, fixes, twin, ground)
    if flight is None:
        return None
    left_out = FlightEvidence(flight, repeated, ground.sigma_heading_rad)
    return _judged(
        known, left_out, ground, lambda known: estimate_flown(known, ground, flight, fixes)
    )


def fly_in_motion(
    known: RunInputs, rest: Where | None, parked_after: SessionEstimate | None
) -> FlightEvidence | None:
    """The flight that a log begins with, before its first rest; None where it begins with none.

    parked_after: the session that this rest makes by itself, None where it makes none.
    """
    run = known.run
    if not known.settings.use_gnss or run.gnss is None or not begins_in_motion(run, rest):
        return None
    fixes, repeated = usable(run.gnss)
    if parked_after is None or parked_after.solution is None:
        rest, parked_after = None, None
    fast = fast_before(fixes, rest)

    def left_out(start_s: float) -> FlightEvidence:
        before = float("nan") if parked_after is None else parked_after.sigma_heading_rad
        flight = flight_from(run, fixes, start_s, fast, rest)
        return FlightEvidence(flight, repeated, before)

    imu = compensated_imu(run, known.table, known.temperature, known.twin)
    start = find_moving_start(known, imu, fixes)
    if isinstance(start, Reason):
        return replace(left_out(run.imu.start_s), reasons=(start,))
    evidence = left_out(start.state.time_s)
    return _judged(
        known,
        evidence,
        parked_after,
        lambda known: estimate_in_motion(known, parked_after, evidence.flight, fixes, start),
    )


def _judged(
    known: RunInputs, left_out: FlightEvidence, ground: SessionEstimate | None, estimated: Estimator
) -> FlightEvidence:
    """A flight estimated, once more with a wider prior where gyros hardly read as at rest, and
    joined where nothing speaks against it; of two estimates their mean, each as it is believed.
    ground: the session without it, None where there is none.
    """
    flight = left_out.flight
    if against := uncovered(flight):
        return replace(left_out, reasons=against)
    doubt: SuspectedShift | None = None
    as_usual: SessionEstimate | None = None
    try:
        flown = estimated(known)
        states = carried(flown.estimate.navigated.filter, flown.layout)
        sound = rested(flown) and not against_joining(flown, flight)
        doubt = suspected_shift(states) if sound else None
        if doubt is not None:
            as_usual = flown.estimate
            flown = estimated(known.with_shift(doubt.size_deg_h))
    except ArithmeticError as lost:
        return replace(left_out, reasons=(because(FlightReason.FILTER_LOST, fault=str(lost)),))
    states = carried(flown.estimate.navigated.filter, flown.layout)
    against = against_joining(flown, flight)
    joined = None if against else flown.estimate
    if joined is not None and as_usual is not None and doubt is not None:
        joined = as_usual.averaged(joined, doubt.belief)
    worth = None if joined is None else information_gain(known.table, ground, joined, flight)
    return replace(
        left_out,
        reasons=against,
        joined=joined,
        carried=states,
        worth=worth,
        notes=(*deflected(flown.priors), *(() if doubt is None else doubt.notes)),
        as_usual=as_usual,
    )
