"""A run's flight: estimated, judged, and joined to its ground session or left out."""

from infield.session.estimate import SessionEstimate
from infield.session.flown.estimator import KnownRun, estimate_flown
from infield.session.flown.fixes import usable
from infield.session.flown.flight import find_flight
from infield.session.flown.gates import against_joining, carried, doubted, uncovered
from infield.session.flown.without_heading import fly_without_heading
from infield.session.flown.worth import FlightEvidence, worth_of
from infield.session.reasons import FlightReason
from ins.verdicts import Reason, because


def fly(known: KnownRun, ground: SessionEstimate) -> FlightEvidence | None:
    """The flight after a ground session; None where the run does not fly with a receiver."""
    run, twin, table = known.run, known.twin, known.table
    if ground.parked is not None:
        return fly_without_heading(known, ground)
    if run.gnss is None or not known.settings.use_gnss or ground.solution is None:
        return None
    fixes, repeated = usable(run.gnss)
    flight = find_flight(run, fixes, twin, ground)
    if flight is None:
        return None
    before = ground.sigma_heading_rad
    if against := uncovered(flight):
        return FlightEvidence(flight, repeated, before, against)
    notes: tuple[Reason, ...] = ()
    as_usual: SessionEstimate | None = None
    try:
        flown = estimate_flown(known, ground, flight, fixes)
        states = carried(flown.estimate.navigated.filter, flown.layout)
        notes = doubted(states) if not against_joining(flown, flight) else ()
        if notes:
            as_usual = flown.estimate
            size = max(abs(float(note.values["size_deg_h"])) for note in notes)
            flown = estimate_flown(known.with_shift(size), ground, flight, fixes)
    except ArithmeticError as lost:
        why = because(FlightReason.FILTER_LOST, fault=str(lost))
        return FlightEvidence(flight, repeated, before, (why,))
    states = carried(flown.estimate.navigated.filter, flown.layout)
    against = against_joining(flown, flight)
    joined = None if against else flown.estimate
    worth = None if joined is None else worth_of(table, ground, joined, flight)
    return FlightEvidence(flight, repeated, before, against, joined, states, worth, notes, as_usual)
