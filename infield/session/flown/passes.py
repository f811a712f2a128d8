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
from alignment.motion.kinds import STILL
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
from infield.session.flown.fixes import (
    OF_POSITION,
    OF_VELOCITY,
    FlightFixes,
    receiver_states,
    with_delays,
)
from infield.session.flown.flight import Flight, RunInputs, flown_motion, joined_cruise
from infield.session.flown.priors import Further, Layout
from infield.session.navigated.own_errors import OwnErrors
from infield.session.navigated.receiver import FixAid, Sigmas
from infield.session.settings import FIT, FlightPriors
from infield.thermometer.gyro_temperature import GyroTemperature
from ins.estimation import sensors
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


@dataclass(frozen=True)
class BodyMotion:
    """What each step (K) turned and was pushed by, body axes: (K, 3) [rad] and [m/s]; degrees
    (K,) [degC] above the session's mean temperature.
    """

    turned_rad: NDArray
    pushed_m_s: NDArray
    above_degC: NDArray


def body_motion(
    history: NavHistory, plan: StepPlan, views: StepViews, temperature: GyroTemperature
) -> BodyMotion:
    """Sums over the planned steps; the accelerometers are taken as warm as the gyros' mean."""
    last = plan.last[-1] + 1
    turned = np.add.reduceat(history.dtheta_b_rad[1:last], plan.first)
    pushed_n = np.add.reduceat(history.dv_f_n_m_s[1:last], plan.first)
    pushed = np.einsum("kji,kj->ki", views.C_mean, pushed_n)
    degC = temperature.at(0.5 * (views.start_s + views.end_s)).mean(axis=1)
    return BodyMotion(turned, pushed, degC - float(np.average(degC, weights=views.dt_s)))


@dataclass(frozen=True)
class Driving:
    """An aid that measures nothing: it lets the further states act."""

    layout: Layout
    priors: FlightPriors
    body: BodyMotion
    flying: NDArray  # (K,) bool

    def measure(self, tape: Tape, views: StepViews) -> None:
        """Lay down how the states fade and how they drive.

        A standing vehicle's gyros are taken as their bins have them: the table is of units at rest.
        """
        self._fade(tape, views)
        states, body = self.layout.indices, self.body
        still = (views.kind == STILL)[:, None]
        force_b = body.pushed_m_s / views.dt_s[:, None]
        turns_b = np.where(still, 0.0, body.turned_rad / views.dt_s[:, None])
        sensors.gyro_scales(tape, states(Further.GYRO_SCALE), turns_b)
        sensors.misalignments(tape, states(Further.MISALIGNMENT), turns_b)
        sensors.gyro_shifts(tape, states(Further.SHIFT), self.flying)
        pushed_b = np.where(still, sensors.REST_B, force_b)
        sensors.force_sensitivities(tape, states(Further.FORCE), pushed_b)
        sensors.accelerometer_biases(tape, states(Further.ACCEL_Z), first_axis=2)
        sensors.accelerometer_scales(tape, states(Further.ACCEL_SCALE), force_b)
        sensors.accelerometer_shifts(tape, states(Further.ACCEL_SHIFT), self.flying)
        sensors.accelerometer_slopes(tape, states(Further.ACCEL_SLOPE), body.above_degC)
        sensors.deflections(tape, states(Further.DEFLECTION))

    def _fade(self, tape: Tape, views: StepViews) -> None:
        """First-order Gauss-Markov processes over time, and over the way flown."""
        every, p = np.arange(len(views.kind)), self.priors
        way = np.linalg.norm(views.displacement_n_m[:, :2], axis=1)
        way = np.where(views.kind == STILL, 0.0, way)
        lengths = {
            Further.SLOW_POSITION: views.dt_s / p.slow_position_s,
            Further.SLOW_VELOCITY: views.dt_s / p.slow_velocity_s,
            Further.DEFLECTION: way / p.deflection_m,
        }
        for state, length in lengths.items():
            kept = np.exp(-length)
            for k in self.layout.indices(state):
                sigma = self.layout.sigma[k - self.layout.first]
                tape.assign(every, k, {k: kept}, sigma**2 * (1.0 - kept**2))
