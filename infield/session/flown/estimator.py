"""A session that flies: one filter from the first rest to the end of the log.

The ground session comes first, as it is without a flight (`infield.session.navigated`); from its
start and biases the whole log is navigated, height from the receiver, and one filter of the
linear errors goes over it: parked and taxi as there, fixes throughout, rests after landing. The
errors hold no specific force (`ins.estimation.error_model`), so that they stay linear for hours:
after the second pass the solution is off by hundreds of metres and 0.1 mrad.

Decision: docs/decisions/0006-error-state-w.md.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from alignment.linearised import Course, RestedLog, Start
from alignment.motion.imu_faults import repair
from alignment.motion.kinds import AIRBORNE, STILL
from alignment.motion.seconds import seconds_of
from alignment.motion.stillness import Motion
from alignment.navigation_filter import Aid, ParkedConstraint, StepPlan
from alignment.result import BiasPrior, Solution
from infield.session.bins import SessionBins, make_bins
from infield.session.estimate import RollingEvidence, SessionEstimate
from infield.session.flown.flight import Flight, RunInputs, flown_motion
from infield.session.flown.passes import Beginning, FlownPass, FlownSession, solved
from infield.session.flown.priors import Layout
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
from infield.session.settings import FlightPriors
from ins.attitude import dcm_from_rotation_vector
from ins.estimation import error_model as em
from ins.estimation.measurements.antenna import Antenna
from ins.records import GnssLog, NavHistory
from ins.strapdown.mechanization import VerticalChannel
from ins.units import DEG_PER_HOUR


@dataclass(frozen=True)
class FlownEstimate:
    """A flown session: its estimate, where the filter holds what only a flight has, and the priors
    that it ended with.
    """

    estimate: SessionEstimate
    layout: Layout
    antenna: Antenna
    priors: FlightPriors


def estimate_flown(
    known: RunInputs, ground: SessionEstimate, flight: Flight, fixes: GnssLog
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
    layout, start = known.layout(bins), _first_start(ground, flight, bins)
    airborne = flight.start_s, flight.end_s
    session = FlownSession(
        known=known,
        fixes=fixes,
        flight=flight,
        beginning=_rested(known, ground, solution.clone_s),
        log=RestedLog(imu, run.header.site, rest, run.phases, faults),
        prior=BiasPrior(bins.edges_s, bins.prior * DEG_PER_HOUR**2),
        course=Course(
            until_s=run.imu.end_s,
            clone_at_s=solution.clone_s,
            hold_heading=known.settings.hold_heading,
            vertical=VerticalChannel(mode="aided", time_s=fixes.time_s, height_m=fixes.height_m),
        ),
        layout=layout,
        own=known.own_errors(layout, airborne, rest, start.C_nb),
    )
    done, antenna = solved(session, start)
    estimate = _flown(session, ground, bins, done)
    return FlownEstimate(estimate, done.session.layout, antenna, done.session.priors)


def _rested(known: RunInputs, ground: SessionEstimate, clone_s: float) -> Beginning:
    """What the passes take from a ground session."""
    solution = ground.navigated
    return Beginning(
        motion=ground.motion,
        twin=solution.last.twin,
        level_earth_rate_rad_s=solution.last.level_earth_rate_rad_s,
        sigmas=_sigmas(known, ground.rolling),
        aids=_aids(known, ground.rolling, clone_s),
        parked=lambda plan, history: _parked(solution, plan, history),
    )


def _first_start(ground: SessionEstimate, flight: Flight, bins: SessionBins) -> Start:
    """Where the ground session ended: its corrected start, its biases held over the flight."""
    solution = ground.navigated
    flt = solution.filter
    mean = ground.mean_deg_h.reshape(-1, 3) * DEG_PER_HOUR
    centre = ground.bins.centre_s
    held = np.minimum(bins.centre_s, flight.start_s)
    gyro = np.stack([np.interp(held, centre, column) for column in mean.T], axis=1)
    accel = solution.last.applied_accel_m_s2.copy()
    accel[:2] += flt.x[em.ACCEL]
    C_nb = dcm_from_rotation_vector(-flt.x[em.THETA_START]) @ solution.history.C_nb[0]
    return Start(C_nb, gyro, accel)


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

    return held.mapped(continued)


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


def _sigmas(known: RunInputs, rolling: RollingEvidence | None) -> Mapping[str, float]:
    """Prior sigmas of the base states' nuisances."""
    declared = nuisance_sigmas(known.run, known.settings)
    return priors_under(declared, _assumed(rolling))


def _aids(known: RunInputs, rolling: RollingEvidence | None, clone_s: float) -> Sequence[Aid]:
    """What the ground session heard of wheels and surveys."""
    run, assumed, survey = known.run, _assumed(rolling), known.run.header.survey
    aids: list[Aid] = [LateralAid(run.header.wheel_reference_m, assumed)]
    if run.odometer is not None and known.settings.use_odometer:
        noise_m_s = known.twin.odometer.noise_m_s
        aids.append(OdometerAid(run.odometer, noise_m_s, run.header.wheel_reference_m))
    if survey.heading_rad is not None and survey.sigma_heading_rad:
        aids.append(SurveyedHeadingAid(survey.heading_rad, survey.sigma_heading_rad, clone_s))
    if survey.centre_line_rad is not None and survey.sigma_centre_line_rad:
        aids.append(CentreLineAid(survey.centre_line_rad))
    return aids


def reported_motion(motion: Motion, flight: Flight) -> Motion:
    """The motion as a report names it: what flies is airborne."""
    t, kind = motion.time_s, motion.kind.copy()
    kind[(t > flight.start_s) & (t <= flight.end_s)] = AIRBORNE
    return replace(motion, kind=kind)


def _flown(
    session: FlownSession, ground: SessionEstimate, bins: SessionBins, done: FlownPass
) -> SessionEstimate:
    """The session's estimate from its last pass."""
    before, flt = ground.navigated, done.filter
    motion = flown_motion(done.history, before.motion, session.flight)
    solution = replace(
        before,
        history=done.history,
        motion=reported_motion(motion, session.flight),
        plan=done.last.plan,
        prior=session.prior,
        applied_bias_rad_s=done.start.gyro_rad_s,
        fitted=replace(before.fitted, filter=flt, parked=done.last.parked),
        last=done.last,
    )
    mean, covariance = solution.bias
    error, sigma = alignment_heading_error(ground.alignment, solution)
    dof = sum(flt.tally.dof.values())
    return SessionEstimate(
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
        own=session.own.found(solution, bins),
    )
