"""A run's flight: estimated, judged, and joined to its ground session or left out."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from infield.session.estimate import SessionEstimate
from infield.session.flown.estimator import KnownRun, estimate_flown
from infield.session.flown.fixes import usable
from infield.session.flown.flight import Flight, find_flight
from infield.session.flown.gates import Carried, against_joining, carried, uncovered
from infield.session.reasons import FlightReason
from infield.table.thermal_table import ThermalTable
from ins.verdicts import Reason, because


@dataclass(frozen=True)
class Worth:
    """Sigma of the table, RMS over the flight's temperatures, gyros x, y, z [deg/h]: before the
    session, after its ground part alone, after all of it.
    """

    before_deg_h: NDArray
    ground_deg_h: NDArray
    after_deg_h: NDArray


@dataclass(frozen=True)
class FlightEvidence:
    """What a session's flight was worth.

    joined: estimate of the session with its flight, None where it was left out, for these reasons.
    repeated: fixes that were left out as repetitions; carried: the flight's nuisances, empty where
    it was not estimated; worth: None where it was left out; heading_before_rad: sigma of the
    heading error by the ground session.
    """

    flight: Flight
    repeated: int
    heading_before_rad: float
    reasons: tuple[Reason, ...] = ()
    joined: SessionEstimate | None = None
    carried: tuple[Carried, ...] = ()
    worth: Worth | None = None


def fly(known: KnownRun, ground: SessionEstimate) -> FlightEvidence | None:
    """The flight after a ground session; None where the run does not fly with a receiver."""
    run, twin, table = known.run, known.twin, known.table
    if run.gnss is None or not known.settings.use_gnss or ground.solution is None:
        return None
    fixes, repeated = usable(run.gnss)
    flight = find_flight(run, fixes, twin, ground)
    if flight is None:
        return None
    before = ground.sigma_heading_rad
    if against := uncovered(flight):
        return FlightEvidence(flight, repeated, before, against)
    try:
        flown = estimate_flown(known, ground, flight, fixes)
    except ArithmeticError as lost:
        why = because(FlightReason.FILTER_LOST, fault=str(lost))
        return FlightEvidence(flight, repeated, before, (why,))
    states = carried(flown.estimate.navigated.filter, flown.layout)
    against = against_joining(flown, flight)
    joined = None if against else flown.estimate
    worth = None if joined is None else _worth(table, ground, joined, flight)
    return FlightEvidence(flight, repeated, before, against, joined, states, worth)


def _worth(
    table: ThermalTable, ground: SessionEstimate, joined: SessionEstimate, flight: Flight
) -> Worth:
    """What ground and flight do to the table at the temperatures of the flight."""
    bins = joined.bins
    flown = (bins.start_s >= flight.start_s) & (bins.end_s <= flight.end_s)
    H = bins.H.reshape(-1, 3, table.n_parameters)[flown]

    def sigma(covariance: NDArray) -> NDArray:
        return np.sqrt(np.einsum("kij,jl,kil->ki", H, covariance, H).mean(axis=0))

    return Worth(
        sigma(table.covariance),
        sigma(ground.merged_into(table).candidate.covariance),
        sigma(joined.merged_into(table).candidate.covariance),
    )
