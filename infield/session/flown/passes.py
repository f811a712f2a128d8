"""Passes of one filter over a whole session that flies, however it begins: navigate, estimate the
errors, correct the start and the biases, and again.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from alignment.linearised import Course, RestedLog, Start, navigated
from alignment.motion.stillness import Motion
from alignment.navigation_filter import (
    Aid,
    FilterPass,
    ParkedConstraint,
    StepPlan,
    StepViews,
    plan_steps,
    views_of,
)
from alignment.result import BiasPrior
from infield.session.flown.driving import Driving, body_motion
from infield.session.flown.fixes import (
    OF_POSITION,
    OF_VELOCITY,
    FlightFixes,
    receiver_states,
    with_delays,
)
from infield.session.flown.flight import Flight, flown_motion, joined_cruise
from infield.session.flown.priors import Further, Layout
from infield.session.flown.run_inputs import RunInputs
from infield.session.navigated.fixes import FixAid, Sigmas
from infield.session.navigated.own_errors import OwnErrors
from infield.session.settings import FIT, FlightPriors
from ins.estimation.choice import SURE_NATS, Level, climb, powers_of_two, with_sizes
from ins.estimation.error_filter import ErrorFilter
from ins.estimation.measurements.antenna import Antenna, RowSums
from ins.estimation.tape import Tape
from ins.records import GnssLog, NavHistory, TwinModel

# as alignment.linearised: 2 or 3 as a rule; the first is about the ground session's result
FLIGHT_PASSES = 3
VERTICAL_PASS = 1  # in which the deflection is sought: about a solution that was corrected once
# Of deflections: plains have 2 to 5 arcsec, the Alps 20 to 30, over 10 to 60 km. A Markov process
# is rough: one that changes over a kilometre by as much as a smooth field of 60 km is four times as
# long. That change, size^2 / length, is what a flight shows best: it stays where the length is
# moved. How smooth the field is hardly shows: the filter believes in LONGEST_KM at most.
DEFLECTIONS = {
    "deflection_arcsec": powers_of_two(2.5, 40.0, fineness=2),
    "deflection_km": powers_of_two(15.0, 240.0),
}
LONGEST_KM = 60.0


@dataclass(frozen=True, kw_only=True)
class Beginning:
    """What the passes take from how a session begins.

    motion: as it was found up to the flight; twin, level_earth_rate_rad_s: of the filter; sigmas:
    priors of the base states' nuisances; aids: what else measures up to take-off; parked(plan,
    history): how the vehicle is held where it stands.
    """

    motion: Motion
    twin: TwinModel
    level_earth_rate_rad_s: float
    sigmas: Mapping[str, float]
    aids: Sequence[Aid]
    parked: Callable[[StepPlan, NavHistory], ParkedConstraint]


@dataclass(frozen=True, kw_only=True)
class FlownSession:
    """What the passes over a session have in common."""

    known: RunInputs
    fixes: GnssLog
    flight: Flight
    beginning: Beginning
    log: RestedLog
    prior: BiasPrior
    course: Course
    layout: Layout
    own: OwnErrors

    @property
    def further_sigma(self) -> tuple[float, ...]:
        """Priors of all states behind the bins."""
        return (*self.layout.sigma, *self.own.sigma)

    @property
    def priors(self) -> FlightPriors:
        return self.known.settings.flight

    def under(self, priors: FlightPriors) -> "FlownSession":
        """The same with another deflection of the vertical."""
        settings = replace(self.known.settings, flight=priors)
        return replace(
            self,
            known=replace(self.known, settings=settings),
            layout=self.layout.with_sigma(Further.DEFLECTION, priors.deflection_rad),
        )


@dataclass(frozen=True)
class FlownPass:
    """A pass over the whole session: of what, its solution, and the filter's end."""

    session: FlownSession
    history: NavHistory
    start: Start
    last: FilterPass
    filter: ErrorFilter


def solved(session: FlownSession, start: Start) -> tuple[FlownPass, Antenna]:
    """Navigate, estimate, correct start and biases, and again."""
    antenna = Antenna(np.asarray(session.known.run.header.gnss_lever_arm_m, dtype=float))
    done: FlownPass | None = None
    for number in range(FLIGHT_PASSES):
        if number and done is not None:
            start, antenna = (
                start.corrected(done.filter),
                with_delays(antenna, done.filter, session.layout),
            )
        history = navigated(session.log, session.prior, session.course, start)
        last = _pass_over(session, history, start)
        fixes = _fixes(session, history, antenna)
        flt = _swept(session, last, fixes)
        if number == VERTICAL_PASS:
            flt, session = _with_vertical(session, last, fixes, flt)
        done = FlownPass(session, history, start, last, flt)
    assert done is not None
    return done, antenna


def _with_vertical(
    session: FlownSession, last: FilterPass, fixes: FlightFixes, flt: ErrorFilter
) -> tuple[ErrorFilter, FlownSession]:
    """The session under the likeliest deflection of the vertical, and the filter."""
    usual = session.priors.assumed
    levels = [
        Level(name, grid, getattr(usual, name))
        for name, grid in DEFLECTIONS.items()
        if getattr(session.priors, name) == FIT
    ]
    if len(levels) == len(DEFLECTIONS):
        levels[-1] = replace(levels[-1], along=tuple(levels[:-1]))
    if not levels or Further.DEFLECTION not in session.layout.at:
        return flt, session
    free = replace(session, layout=session.layout.freed())

    @cache
    def run(**sizes: Any) -> ErrorFilter:
        return _swept(free.under(replace(usual, **sizes)), last, fixes)

    assumed = run()
    best, sizes = climb(
        assumed,
        levels,
        lambda sizes, _: run(**sizes),
        lambda one, other: one.tally.loglik - other.tally.loglik,
    )
    if best.tally.loglik - assumed.tally.loglik < SURE_NATS:
        return flt, session
    found = with_sizes(usual, sizes)
    session = session.under(replace(found, deflection_km=min(found.deflection_km, LONGEST_KM)))
    return _swept(session, last, fixes), session


def _swept(session: FlownSession, last: FilterPass, fixes: FlightFixes) -> ErrorFilter:
    """The filter of a pass under the priors of a session."""
    under = replace(last, further_sigma=session.further_sigma)
    return under.run(session.beginning.sigmas, _aids(session, last, fixes))


def flying(flight: Flight, views: StepViews) -> NDArray:
    """Steps in the air (K,)."""
    return np.asarray((views.start_s >= flight.start_s) & (views.end_s <= flight.end_s + 1.0))


def _pass_over(session: FlownSession, history: NavHistory, start: Start) -> FilterPass:
    """The plan of a pass and all that it needs but its aids."""
    beginning = session.beginning
    motion = flown_motion(history, beginning.motion, session.flight)
    plan = plan_steps(motion, session.prior.edges_s)
    plan = joined_cruise(plan, history, session.flight)
    return FilterPass(
        history=history,
        plan=plan,
        twin=beginning.twin,
        parked=beginning.parked(plan, history),
        bias_covariance=session.prior.covariance,
        applied_rad_s=start.gyro_rad_s,
        applied_accel_m_s2=start.accel_m_s2,
        level_earth_rate_rad_s=beginning.level_earth_rate_rad_s,
        clone_at_s=session.course.clone_at_s,
        further_sigma=session.further_sigma,
    )


@dataclass(frozen=True)
class _Before:
    """An aid that hears only the first steps."""

    aid: Aid
    steps: int

    def measure(self, tape: Tape, views: StepViews) -> None:
        arrays = {
            name: value[: self.steps] for name, value in vars(views).items() if np.ndim(value)
        }
        self.aid.measure(tape, replace(views, **arrays))


def _fixes(session: FlownSession, history: NavHistory, antenna: Antenna) -> FlightFixes:
    gnss = session.known.twin.gnss
    return FlightFixes(
        FixAid(
            log=session.fixes,
            sigmas=Sigmas(gnss.sigma_horizontal_m, gnss.sigma_velocity_m_s),
            antenna=antenna,
            states=receiver_states(session.layout),
            history=history,
            rows=RowSums(session.log.imu),
            names=(OF_POSITION, OF_VELOCITY),
        )
    )


def _aids(session: FlownSession, last: FilterPass, fixes: FlightFixes) -> Sequence[Aid]:
    """The wheels and surveys up to take-off, the fixes throughout."""
    known, history = session.known, last.history
    views = views_of(history, last.plan)
    before = int(np.searchsorted(views.end_s, session.flight.start_s + 1e-6))
    return [
        Driving(
            session.layout,
            session.priors,
            body_motion(history, last.plan, views, known.temperature),
            flying(session.flight, views),
        ),
        *(_Before(aid, before) for aid in session.beginning.aids),
        session.own,
        fixes,
    ]
