"""May a flight be joined to the session that it began with? Reasons, where it may not.

With no prior at all it would be x S0 / (S0 - S), of variance S S0 / (S0 - S) (information form;
Bar-Shalom (2001), section 5.2): that is the size that is told.
"""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

from alignment.gyrocompass import nis_verdict
from infield.session.acceptance import MAX_REJECTED_SHARE
from infield.session.estimate import SessionEstimate
from infield.session.flown.estimator import FlownEstimate
from infield.session.flown.flight import LEAST_WITH_FIXES, OF_POSITION, OF_VELOCITY, Flight
from infield.session.flown.priors import CONSTANT, SHOWN_IN, Further, Layout
from infield.session.reasons import FlightReason
from infield.session.settings import FlightPriors
from infield.table.merge import CONFIDENCE
from infield.table.thermal_table import ThermalTable
from ins.estimation.error_filter import ErrorFilter, Tally
from ins.records import AXES
from ins.robust import norm
from ins.units import ARCSEC, DEG_PER_HOUR
from ins.verdicts import Reason, because

# of a prior's variance that the flight must have removed for a state to be judged: below, what is
# left is rounding (1e-3 of a variance is 5e-4 of a sigma)
JUDGED_SHARE = 1e-3
# of what a sound flight shows between flight and rest, beyond which a shift of the size that shows
# is weighed against none; one of 3 gyros exceeds it in 13 % of sound flights, measured 45 of 298
# (docs/flight_update.md)
DOUBTED_SIGMAS = 2.0


@dataclass(frozen=True)
class Carried:
    """A further state as a flight leaves it, SI: posterior value and sigma, prior sigma (k,).

    sigmas (k,): value over what it may be of a sound flight; 0 where the flight shows nothing.
    """

    state: Further
    value: NDArray
    sigma: NDArray
    prior: NDArray
    sigmas: NDArray

    def by_itself(self) -> tuple[NDArray, NDArray]:
        """Value and sigma (k,) had there been no prior; sigma is inf where nothing shows."""
        removed = self.prior**2 - self.sigma**2
        shown = removed > JUDGED_SHARE * self.prior**2
        factor = np.divide(self.prior**2, removed, out=np.zeros(len(removed)), where=shown)
        value = self.value * factor
        sigma = np.where(shown, self.sigma * np.sqrt(factor), np.inf)
        return value, sigma


@dataclass(frozen=True)
class FlightEnd:
    """A flight's filter at its end: state x (n,), covariance P (n, n), its measurements."""

    x: NDArray
    P: NDArray
    tally: Tally


def carried(flt: ErrorFilter | FlightEnd, layout: Layout) -> tuple[Carried, ...]:
    """Every further state as the filter leaves it."""
    found = []
    for state, where in layout.at.items():
        index = np.arange(where.start, where.stop)
        prior = layout.sigma[index - layout.first]
        x, sigma = flt.x[index], np.sqrt(np.diag(flt.P)[index])
        removed = prior**2 - sigma**2
        shown = removed > JUDGED_SHARE * prior**2
        spread = np.sqrt(np.where(shown, removed, np.inf))
        found.append(Carried(state, x, sigma, prior, x / spread))
    return tuple(found)


def against_joining(flown: FlownEstimate, flight: Flight) -> tuple[Reason, ...]:
    """Why a flight may not be joined to its session; empty where it may."""
    flt = flown.estimate.navigated.filter
    return (*uncovered(flight), *against(flt, flown.layout, rested=rested(flown)))


def rested(flown: FlownEstimate) -> bool:
    """Whether a session stood as well as flew: else nothing tells what its gyros read in flight
    from what the table has wrong.
    """
    begun = flown.estimate.begun
    return begun is None or begun.parked_s > 0.0


def against(
    flt: ErrorFilter | FlightEnd, layout: Layout, *, rested: bool = True
) -> tuple[Reason, ...]:
    """What a flight's filter says against it. rested: of a session that stood as well."""
    states = carried(flt, layout)
    moved = _moved(states) if rested else ()
    return (*_residuals(flt), *_beyond_prior(states), *moved)


def uncovered(flight: Flight) -> tuple[Reason, ...]:
    """A reason where too little of the flight has fixes."""
    if flight.covered >= LEAST_WITH_FIXES:
        return ()
    return (
        because(
            FlightReason.UNCOVERED,
            covered_percent=100 * flight.covered,
            needed_percent=100 * LEAST_WITH_FIXES,
        ),
    )


def _residuals(flt: ErrorFilter | FlightEnd) -> tuple[Reason, ...]:
    """Positions and velocities that the noise model does not explain, or that lie beyond the
    gate.
    """
    tally, found = flt.tally, []
    rejected = Counter(kind for _, kind in tally.rejected)
    for kind in (OF_POSITION, OF_VELOCITY):
        dof = tally.dof.get(kind, 0)
        excess = nis_verdict(tally.nis[kind] / dof, dof) if dof else None
        if excess is not None:
            found.append(because(FlightReason.EXCESS_RESIDUALS, kind=kind, excess=excess))
        used = len(tally.normalised.get(kind, ()))
        share = rejected[kind] / max(rejected[kind] + used, 1)
        if share > MAX_REJECTED_SHARE:
            beyond = because(
                FlightReason.BEYOND_GATE,
                kind=kind,
                share_percent=100 * share,
                needed_percent=100 * MAX_REJECTED_SHARE,
            )
            found.append(beyond)
    return tuple(found)


def _beyond_prior(states: Sequence[Carried]) -> tuple[Reason, ...]:
    """The nuisance that lies furthest beyond what is taken for possible, where one does."""
    held = [c for c in states if c.state in CONSTANT]
    limit = _limit(sum(c.sigmas.size for c in held))
    worst = max(held, key=lambda c: float(np.abs(c.sigmas).max()), default=None)
    if worst is None or np.abs(worst.sigmas).max() <= limit:
        return ()
    k = int(np.argmax(np.abs(worst.sigmas)))
    unit, size = SHOWN_IN[worst.state]
    return (
        because(
            FlightReason.BEYOND_PRIOR,
            state=worst.state,
            value=float(worst.value[k] / size),
            prior=float(worst.prior[k] / size),
            unit=unit,
            sigmas=float(worst.sigmas[k]),
            limit_sigmas=limit,
        ),
    )


def _moved(states: Sequence[Carried]) -> tuple[Reason, ...]:
    """Gyros that read in flight what they do not read at rest, by more than is taken for
    possible.
    """
    limit = _limit(len("xyz"))
    return tuple(
        because(FlightReason.UNLIKE_AT_REST, **told._asdict(), limit_sigmas=limit)
        for told in _shifted(states, limit)
    )


def deflected(priors: FlightPriors) -> tuple[Reason, ...]:
    """A note where a flight was estimated under a larger deflection of the vertical than is usual:
    as it shows, or as was given.
    """
    assumed = FlightPriors()
    if priors.deflection_rad <= assumed.deflection_rad:
        return ()
    return (
        because(
            FlightReason.DEFLECTED,
            arcsec=priors.deflection_rad / ARCSEC,
            km=priors.deflection_m / 1e3,
            assumed_arcsec=assumed.deflection_rad / ARCSEC,
            assumed_km=assumed.deflection_m / 1e3,
        ),
    )


@dataclass(frozen=True)
class SuspectedShift:
    """Gyros that hardly read in flight what they read at rest: told by notes; size_deg_h: of the
    largest difference; belief: probability that it is one, see `suspected_shift`.
    """

    notes: tuple[Reason, ...]
    size_deg_h: float
    belief: float


def suspected_shift(states: Sequence[Carried]) -> SuspectedShift | None:
    """Gyros whose bias in flight differs from that at rest by what the prior hardly explains; None
    where none does.

    Beforehand a difference is as likely as not. What each gyro shows by itself is then N(0, size^2
    + sigma^2) with one and N(0, prior^2 + sigma^2) without: the odds are the quotient of the two
    densities over all gyros.
    """
    shift = next((c for c in states if c.state is Further.SHIFT), None)
    if shift is None or not (found := tuple(_shifted(states, DOUBTED_SIGMAS))):
        return None
    size = max(abs(told.size_deg_h) for told in found)
    value, sigma = shift.by_itself()
    shown = np.isfinite(sigma)
    with_one = np.square(size * DEG_PER_HOUR) + sigma[shown] ** 2
    without = shift.prior[shown] ** 2 + sigma[shown] ** 2
    square = value[shown] ** 2
    nats = 0.5 * np.sum(square / without - square / with_one + np.log(without / with_one))
    belief = float(expit(nats))
    prior = float(shift.prior[0]) / DEG_PER_HOUR
    notes = tuple(
        because(
            FlightReason.SHIFT_WIDENED,
            **told._asdict(),
            prior_deg_h=prior,
            belief_percent=100.0 * belief,
        )
        for told in found
    )
    return SuspectedShift(notes, size, belief)


class _Shifted(NamedTuple):
    """What a gyro reads in flight beyond what it reads at rest; sigmas: over what is usual."""

    axis: str
    size_deg_h: float
    sigma_deg_h: float
    sigmas: float


def _shifted(states: Sequence[Carried], limit: float) -> Iterator[_Shifted]:
    """The gyros whose shift is beyond a limit of sigmas."""
    shift = next((c for c in states if c.state is Further.SHIFT), None)
    if shift is None:
        return
    size, sigma = (v / DEG_PER_HOUR for v in shift.by_itself())
    for k in np.flatnonzero(np.abs(shift.sigmas) > limit):
        yield _Shifted("xyz"[k], float(size[k]), float(sigma[k]), float(shift.sigmas[k]))


def _limit(count: int) -> float:
    """Sigmas that one of so many values exceeds in one sound flight of a thousand."""
    return float(norm.isf((1.0 - CONFIDENCE) / 2.0 / max(count, 1)))


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
