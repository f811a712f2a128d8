"""What `update.json` and the report say of a session's flight."""

import numpy as np

from infield.reports.documents.session_records import (
    CarriedNuisance,
    FlightAgainstRest,
    FlightDocument,
)
from infield.session.flown.gates import Carried, FlightEvidence
from infield.session.flown.priors import CONSTANT, SHOWN_IN, Further
from infield.session.results import SessionResult
from ins.documents import made
from ins.records import AXES
from ins.units import DEG_PER_HOUR, MILLIRADIAN
from ins.verdicts import because, sentence


def flight_document(session: SessionResult) -> FlightDocument | None:
    """The flight of a run; None where it does not fly with a receiver."""
    e = session.flight
    if e is None:
        return None
    joined = e.joined
    return made(
        FlightDocument,
        e,
        sigma_heading_ground_mrad=_in_mrad(e.heading_before_rad),
        sigma_heading_mrad=None if joined is None else _in_mrad(joined.sigma_heading_rad),
        against_rest=_against_rest(e),
        nuisances=[_nuisance(state) for state in e.carried],
    )


def _in_mrad(angle_rad: float) -> float | None:
    """None of a unit that finds no heading at rest."""
    return angle_rad / MILLIRADIAN if np.isfinite(angle_rad) else None


def _against_rest(e: FlightEvidence) -> list[FlightAgainstRest]:
    shift = next((state for state in e.carried if state.state is Further.SHIFT), None)
    if shift is None:
        return []
    value, sigma = (v / DEG_PER_HOUR for v in shift.by_itself())
    return [
        FlightAgainstRest(
            axis=axis,
            size_deg_h=float(value[k]) if np.isfinite(sigma[k]) else None,
            sigma_deg_h=float(sigma[k]) if np.isfinite(sigma[k]) else None,
        )
        for k, axis in enumerate(AXES)
    ]


def _nuisance(found: Carried) -> CarriedNuisance:
    unit, size = SHOWN_IN[found.state]
    stands = found.state in (*CONSTANT, Further.SHIFT)
    return CarriedNuisance(
        nuisance=found.state.value,
        text=sentence(because(found.state)),
        value=(found.value / size).tolist() if stands else None,
        sigma=(found.sigma / size).tolist() if stands else None,
        prior_sigma=(found.prior / size).tolist(),
        unit=unit,
    )
