"""A session that flies: one filter from the first rest to the end of the log.

The ground session comes first, as it is without a flight (`infield.session.navigated`); from its
start and biases the whole log is navigated, height from the receiver, and one filter of the
linear errors goes over it: parked and taxi as there, fixes throughout, rests after landing. The
errors hold no specific force (`ins.filters.error_model`), so that they stay linear for hours: after
the second pass the solution is off by hundreds of metres and 0.1 mrad.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from alignment.linearised import Course, RestedLog, Start, navigated
from alignment.motion.imu_faults import repair
from alignment.motion.kinds import AIRBORNE, STILL
from alignment.motion.seconds import seconds_of
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
from alignment.result import BiasPrior, Solution
from infield.session.bins import SessionBins, make_bins
from infield.session.estimate import RollingEvidence, SessionEstimate
from infield.session.flown.driving import Driving, body_motion
from infield.session.flown.fixes import Antenna, FixAid, Sigmas
from infield.session.flown.flight import Flight, flown_motion, joined_cruise
from infield.session.flown.priors import Layout, laid_out
from infield.session.log import compensated_imu
from infield.session.navigated.estimator import alignment_heading_error, nuisance_sigmas
from infield.session.navigated.nuisances import Assumed, priors_under
from infield.session.navigated.receiver import OF_RECEIVER
from infield.session.navigated.taxi_heading import (
    CentreLineAid,
    LateralAid,
    OdometerAid,
    SurveyedHeadingAid,
)
from infield.session.reasons import Nuisance
from infield.session.settings import FlightPriors, SessionSettings
from infield.table.thermal_table import ThermalTable
from infield.thermometer.gyro_temperature import GyroTemperature
from ins.attitude import dcm_from_rotation_vector
from ins.filters import error_model as em
from ins.filters.error_filter import ErrorFilter
from ins.filters.program import FilterProgram
from ins.records import GnssLog, NavHistory, Run, TwinModel
from ins.strapdown.mechanization import VerticalChannel
from ins.units import DEG_PER_HOUR

# as alignment.linearised: 2 or 3 as a rule; the first is about the ground session's result
FLIGHT_PASSES = 3


@dataclass(frozen=True)
class FlownEstimate:
    """A flown session: its estimate, and where the filter holds what only a flight has."""

    estimate: SessionEstimate
    layout: Layout
    priors: FlightPriors
    antenna: Antenna
    flying: NDArray  # (K,) bool, of the plan's steps


@dataclass(frozen=True)
class KnownRun:
    """A run, its temperatures, and what its update takes for known."""

    run: Run
    table: ThermalTable
    temperature: GyroTemperature
    twin: TwinModel
    settings: SessionSettings

    def with_shift(self, size_deg_h: float) -> "KnownRun":
        """The same with gyros that may read so much more in flight than at rest (1 sigma)."""
        return replace(
            self, settings=self.settings.with_shift(self.run.header.gyro_technology, size_deg_h)
        )

    def layout(self, bins: SessionBins, parked: ParkedConstraint) -> Layout:
        """Where the further states stand, after the bins and the states of a place that swings."""
        technology = self.run.header.gyro_technology
        return laid_out(
            self.settings.flight,
            technology,
            first=em.BASE + bins.table_deg_h.size + parked.swing_states,
            scale_ppm=self.settings.sigma_scale_factor_ppm[technology],
            accel_z_ug=max(self.twin.accel.turn_on_ug, 1.0),
        )


@dataclass(frozen=True)
class _Session:
    """What the passes over a session have in common."""

    known: KnownRun
    fixes: GnssLog
    ground: SessionEstimate
    flight: Flight
    log: RestedLog
    prior: BiasPrior
    course: Course
    layout: Layout


def estimate_flown(
    known: KnownRun, ground: SessionEstimate, flight: Flight, fixes: GnssLog
) -> FlownEstimate:
    """One filter over align, park, taxi, flight and what follows."""
    run, temperature, twin = known.run, known.temperature, known.twin
    solution = ground.navigated
    rest = float(solution.history.time_s[0]), solution.motion.parked_until_s
    repaired, faults = repair(run.imu, seconds_of(run.imu), rest[0], flight.start_s)
    imu = compensated_imu(replace(run, imu=repaired), known.table, temperature, twin)
    bins = make_bins(
        known.table, temperature, twin, known.settings, start_s=rest[0], end_s=run.imu.end_s
    )
    session = _Session(
        known=known,
        fixes=fixes,
        ground=ground,
        flight=flight,
        log=RestedLog(imu, run.header.site, rest, run.phases, faults),
        prior=BiasPrior(bins.edges_s, bins.prior * DEG_PER_HOUR**2),
        course=Course(
            until_s=run.imu.end_s,
            clone_at_s=solution.clone_s,
            hold_heading=known.settings.hold_heading,
            vertical=VerticalChannel(mode="aided", time_s=fixes.time_s, height_m=fixes.height_m),
        ),
        layout=known.layout(bins, solution.fitted.parked),
    )
    last, antenna = _solved(session, _first_start(session, bins))
    return _flown(session, bins, last, antenna)


@dataclass(frozen=True)
class _Pass:
    """A pass over the whole session: its solution, what it is a pass of, and the filter's end."""

    history: NavHistory
    start: Start
    last: FilterPass
    filter: ErrorFilter


def _solved(session: _Session, start: Start) -> tuple[_Pass, Antenna]:
    """Navigate, estimate, correct start and biases, and again."""
    antenna = Antenna(np.asarray(session.known.run.header.gnss_lever_arm_m, dtype=float))
    done: _Pass | None = None
    for number in range(FLIGHT_PASSES):
        if number and done is not None:
            start, antenna = (
                start.corrected(done.filter),
                antenna.found(done.filter, session.layout),
            )
        history = navigated(session.log, session.prior, session.course, start)
        last = _pass_over(session, history, start)
        flt = last.run(_sigmas(session), _aids(session, last, antenna))
        done = _Pass(history, start, last, flt)
    assert done is not None
    return done, antenna


def _first_start(session: _Session, bins: SessionBins) -> Start:
    """Where the ground session ended: its corrected start, its biases held over the flight."""
    ground, solution = session.ground, session.ground.navigated
    flt = solution.filter
    mean = ground.mean_deg_h.reshape(-1, 3) * DEG_PER_HOUR
    centre = ground.bins.centre_s
    held = np.minimum(bins.centre_s, session.flight.start_s)
    gyro = np.stack([np.interp(held, centre, column) for column in mean.T], axis=1)
    accel = solution.last.applied_accel_m_s2.copy()
    accel[:2] += flt.x[em.ACCEL]
    C_nb = dcm_from_rotation_vector(-flt.x[em.THETA_START]) @ solution.history.C_nb[0]
    return Start(C_nb, gyro, accel)


def _pass_over(session: _Session, history: NavHistory, start: Start) -> FilterPass:
    """The plan of a pass and all that it needs but its aids."""
    ground = session.ground.navigated
    motion = flown_motion(history, ground.motion, session.flight)
    plan = plan_steps(motion, session.prior.edges_s)
    plan = joined_cruise(plan, history, session.flight)
    return replace(
        ground.last,
        history=history,
        plan=plan,
        parked=_parked(ground, plan, history),
        bias_covariance=session.prior.covariance,
        applied_rad_s=start.gyro_rad_s,
        applied_accel_m_s2=start.accel_m_s2,
        further_sigma=tuple(session.layout.sigma),
    )


def _parked(ground: Solution, plan: StepPlan, history: NavHistory) -> ParkedConstraint:
    """How the standing vehicle is held: before take-off at the level that was found, after it at
    the middle of that.
    """
    held, before = ground.fitted.parked, ground.plan
    middle = 0.5 * (history.time_s[plan.first] + history.time_s[plan.last])
    ends = ground.history.time_s[before.last]
    step = np.searchsorted(ends, middle)
    known = step < ends.size
    still = before.kind == STILL

    def continued(values: NDArray | float) -> NDArray:
        of_steps = np.broadcast_to(np.asarray(values, dtype=float), ends.shape)
        after = float(np.median(of_steps[still]))
        return np.where(known, of_steps[np.minimum(step, ends.size - 1)], after)

    return replace(
        held,
        displacement_sigma_m=continued(held.displacement_sigma_m),
        yaw_jitter_rad=continued(held.yaw_jitter_rad),
        place_walk_m=continued(held.place_walk_m),
        yaw_walk_rad=continued(held.yaw_walk_rad),
    )


def _assumed(rolling: RollingEvidence | None) -> Assumed:
    """What the taxi was found to need, but for the receiver's: the flight shows that better."""
    assumed = Assumed()
    for found in rolling.found if rolling is not None else ():
        if found.nuisance in OF_RECEIVER:
            continue
        assumed = replace(assumed, free=assumed.free | {found.nuisance})
        if found.nuisance is Nuisance.TURNING_CRAB:
            assumed = replace(assumed, turning_crab_rad=float(found.value[0]))
        if found.nuisance is Nuisance.GUSTS:
            assumed = replace(assumed, gust_crab_rad=float(found.value[0]))
    return assumed


def _sigmas(session: _Session) -> Mapping[str, float]:
    """Prior sigmas of the base states' nuisances."""
    declared = nuisance_sigmas(session.known.run, session.known.twin, session.known.settings)
    return priors_under(declared, _assumed(session.ground.rolling))


@dataclass(frozen=True)
class _Before:
    """An aid that hears only the first steps."""

    aid: Aid
    steps: int

    def measure(self, program: FilterProgram, views: StepViews) -> None:
        arrays = {
            name: value[: self.steps] for name, value in vars(views).items() if np.ndim(value)
        }
        self.aid.measure(program, replace(views, **arrays))


def _aids(session: _Session, last: FilterPass, antenna: Antenna) -> Sequence[Aid]:
    """The wheels and surveys up to take-off, the fixes throughout."""
    run, twin, history = session.known.run, session.known.twin, last.history
    assumed, survey = _assumed(session.ground.rolling), run.header.survey
    views = views_of(history, last.plan)
    before = int(np.searchsorted(views.end_s, session.flight.start_s + 1e-6))
    ground: list[Aid] = [LateralAid(run.header.wheel_reference_m, assumed)]
    if run.odometer is not None and session.known.settings.use_odometer:
        noise_m_s = twin.odometer.noise_m_s
        ground.append(OdometerAid(run.odometer, noise_m_s, run.header.wheel_reference_m, assumed))
    if survey.heading_rad is not None and survey.sigma_heading_rad:
        at_s = session.course.clone_at_s
        ground.append(SurveyedHeadingAid(survey.heading_rad, survey.sigma_heading_rad, at_s))
    if survey.centre_line_rad is not None and survey.sigma_centre_line_rad:
        ground.append(CentreLineAid(survey.centre_line_rad))
    flying = _flying(session, views)
    sigmas = Sigmas(twin.gnss.sigma_horizontal_m, twin.gnss.sigma_velocity_m_s)
    return [
        Driving(
            session.layout,
            session.known.settings.flight,
            body_motion(history, last.plan, views, session.known.temperature),
            flying,
        ),
        *(_Before(aid, before) for aid in ground),
        FixAid(session.fixes, sigmas, antenna, session.layout, history),
    ]


def _flying(session: _Session, views: StepViews) -> NDArray:
    """Steps in the air (K,)."""
    flight = session.flight
    return np.asarray((views.start_s >= flight.start_s) & (views.end_s <= flight.end_s + 1.0))


def _told(motion: Motion, flight: Flight) -> Motion:
    """The motion as a report names it: what flies is airborne."""
    t, kind = motion.time_s, motion.kind.copy()
    kind[(t > flight.start_s) & (t <= flight.end_s)] = AIRBORNE
    return replace(motion, kind=kind)


def _flown(session: _Session, bins: SessionBins, done: _Pass, antenna: Antenna) -> FlownEstimate:
    """The session's estimate from its last pass."""
    ground = session.ground
    before, flt = ground.navigated, done.filter
    motion = flown_motion(done.history, before.motion, session.flight)
    solution = replace(
        before,
        history=done.history,
        motion=_told(motion, session.flight),
        plan=done.last.plan,
        prior=session.prior,
        applied_bias_rad_s=done.start.gyro_rad_s,
        fitted=replace(before.fitted, filter=flt, parked=done.last.parked),
        last=done.last,
    )
    mean, covariance = solution.bias
    error, sigma = alignment_heading_error(ground.alignment, solution)
    dof = sum(flt.tally.dof.values())
    estimate = SessionEstimate(
        bins=bins,
        mean_deg_h=mean / DEG_PER_HOUR,
        covariance=covariance / DEG_PER_HOUR**2,
        alignment=ground.alignment,
        solution=solution,
        heading_error_rad=error,
        sigma_heading_rad=sigma,
        sigma_heading_before_rad=ground.sigma_heading_before_rad,
        nis_mean=sum(flt.tally.nis.values()) / max(dof, 1),
        dof=dof,
        rolling=ground.rolling,
    )
    views = views_of(done.history, done.last.plan)
    return FlownEstimate(
        estimate, session.layout, session.known.settings.flight, antenna, _flying(session, views)
    )
