"""What a flight adds to a session: its evidence, and the sigma of the table without and with it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from infield.session.estimate import SessionEstimate
from infield.session.flown.flight import Flight
from infield.session.flown.gates import Carried
from infield.table.thermal_table import ThermalTable
from ins.records import AXES
from ins.verdicts import Reason


@dataclass(frozen=True, kw_only=True)
class InformationGain:
    """Sigma of a gyro's table, RMS over the flight's temperatures: before the session, after its
    ground part alone, after all of it.
    """

    axis: str
    before_deg_h: float
    ground_alone_deg_h: float
    after_deg_h: float


@dataclass(frozen=True)
class FlightEvidence:
    """Evidence of the flight of a session.

    joined: estimate of the session with its flight, None where it was left out, for these reasons.
    repeated: fixes that were left out as repetitions; carried: the flight's nuisances, empty where
    it was not estimated; worth: None where it was left out; heading_before_rad: sigma of the
    heading error by the ground session; notes: what the flight was estimated again for;
    as_usual: the estimate before that, None where it was not.
    """

    flight: Flight
    repeated: int
    heading_before_rad: float
    reasons: tuple[Reason, ...] = ()
    joined: SessionEstimate | None = None
    carried: tuple[Carried, ...] = ()
    worth: tuple[InformationGain, ...] | None = None
    notes: tuple[Reason, ...] = ()
    as_usual: SessionEstimate | None = None


@dataclass(frozen=True, kw_only=True)
class FlightTerm:
    """What gyro `axis` reads in flight beyond what it reads at rest, and its sigma, had there been
    no prior for it; of so many flights. found: beyond doubt, so that the runs were taken again with
    a difference of that size.
    """

    axis: str
    value_deg_h: float
    sigma_deg_h: float
    flights: int
    found: bool


def information_gain(
    table: ThermalTable, ground: SessionEstimate | None, joined: SessionEstimate, flight: Flight
) -> tuple[InformationGain, ...]:
    """What ground and flight do to the table at the temperatures of the flight. ground: None of a
    session that has no part without the flight.
    """
    bins = joined.bins
    flown = (bins.start_s >= flight.start_s) & (bins.end_s <= flight.end_s)
    H = bins.H.reshape(-1, 3, table.n_parameters)[flown]

    def sigma(covariance: NDArray) -> NDArray:
        return np.sqrt(np.einsum("kij,jl,kil->ki", H, covariance, H).mean(axis=0))

    alone = table.covariance
    if ground is not None:
        alone = ground.merged_into(table).candidate.covariance
    before, ground_alone = sigma(table.covariance), sigma(alone)
    after = sigma(joined.merged_into(table).candidate.covariance)
    return tuple(
        InformationGain(
            axis=axis,
            before_deg_h=float(before[k]),
            ground_alone_deg_h=float(ground_alone[k]),
            after_deg_h=float(after[k]),
        )
        for k, axis in enumerate(AXES)
    )
