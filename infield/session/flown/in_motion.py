"""A session that flies and has no first rest: one filter from where it is first known in motion to
the end of the log; a rest after landing is evidence of the same session.

Passes, further states, gates and merge are those of a session that begins parked
(`infield.session.flown.estimator`). The filter's velocity error `w = dv - theta x v` begins as wide
as the heading's prior makes it at that speed; what it says is of the fixes alone. No wheels are
heard: nobody stood beside them.
"""

import numpy as np
from numpy.typing import NDArray

from alignment.level_fit import QUIET, LevelFit, LevelFound
from alignment.linearised import Course, RestedLog, Start
from alignment.motion.inertial import Where
from alignment.motion.kinds import STILL
from alignment.motion.stillness import Motion
from alignment.navigation_filter import ParkedConstraint, StepPlan, diffuse_heading_rad
from alignment.reasons import AlignmentReason, AlignmentVerdict
from alignment.result import Alignment, BiasPrior, Solution
from infield.session.bins import make_bins
from infield.session.estimate import BegunInMotion, SessionEstimate
from infield.session.flown.estimator import FlownEstimate, reported_motion
from infield.session.flown.flight import Flight, RunInputs, covered_share, flown_motion
from infield.session.flown.passes import Beginning, FlownPass, FlownSession, solved
from infield.session.flown.start import MovingStart
from infield.session.log import compensated_imu
from infield.session.navigated.estimator import nuisance_sigmas
from ins.attitude import euler_from_dcm, wrap_pi
from ins.earth import EARTH_RATE_RAD_S
from ins.estimation import error_model as em
from ins.records import AIRBORNE_PHASES, GnssLog, Run
from ins.strapdown.mechanization import VerticalChannel
from ins.units import DEG_PER_HOUR, MILLIRADIAN
from ins.verdicts import because

# of a standing vehicle where no ground session tells: wide beside what a calm one shows
# (`alignment.motion.level`), and asked of no run that has no rest
CALM = ParkedConstraint(displacement_sigma_m=0.01, yaw_jitter_rad=1e-5)
NOT_MEASURED = LevelFound(
    place_m=float("nan"),
    largest_place_m=float("nan"),
    place_walk_m=float("nan"),
    yaw_rad=float("nan"),
    largest_yaw_rad=float("nan"),
    yaw_walk_rad=float("nan"),
    unit_noise=1.0,
    sigma_cost=float("nan"),
)


def flight_from(
    run: Run, fixes: GnssLog, start_s: float, fast: NDArray, rest: Where | None
) -> Flight:
    """The flight of a run that is first known in motion at start_s: in the air from there, or from
    where its fixes are fast; fast (n,): those.
    """
    after = fixes.time_s[fast]
    logged = [p.start_s for p in run.phases if p.phase in AIRBORNE_PHASES]
    first_s = max(min([*logged, float(after[0])]), start_s)
    end_s = float(after[-1])
    return Flight(
        start_s=first_s,
        end_s=end_s,
        stands=() if rest is None else (rest,),
        covered=covered_share(fixes, first_s, end_s),
    )


def estimate_in_motion(
    known: RunInputs,
    parked_after: SessionEstimate | None,
    flight: Flight,
    fixes: GnssLog,
    start: MovingStart,
) -> FlownEstimate:
    """One filter from the start to the end of the log. parked_after: the ground session that the
    rest after landing makes by itself, None where there is none.
    """
    run, settings = known.run, known.settings
    begin_s, end_s = start.state.time_s, run.imu.end_s
    bins = make_bins(
        known.table, known.temperature, known.twin, settings, start_s=begin_s, end_s=end_s
    )
    prior = BiasPrior(bins.edges_s, bins.prior * DEG_PER_HOUR**2)
    held = CALM if parked_after is None else _middle(parked_after.navigated)
    level_rate = EARTH_RATE_RAD_S * float(np.cos(start.state.site.lat_rad))
    heading = diffuse_heading_rad(prior.covariance, level_rate)
    speed = float(np.linalg.norm(start.state.v_n_m_s))
    twin = known.twin if parked_after is None else parked_after.navigated.last.twin
    layout, airborne = known.layout(bins), (flight.start_s, flight.end_s)
    session = FlownSession(
        known=known,
        fixes=fixes,
        flight=flight,
        beginning=Beginning(
            motion=_NO_MOTION,
            twin=twin,
            level_earth_rate_rad_s=level_rate,
            sigmas={**nuisance_sigmas(run, settings), "W": 1.0 + heading * speed},
            aids=(),
            parked=lambda plan, history: _each_step(held, plan),
        ),
        log=RestedLog(
            compensated_imu(run, known.table, known.temperature, known.twin),
            start.state.site,
            (begin_s, begin_s),
            run.phases,
        ),
        prior=prior,
        course=Course(
            until_s=end_s,
            clone_at_s=begin_s,
            hold_heading=settings.hold_heading,
            vertical=VerticalChannel(mode="aided", time_s=fixes.time_s, height_m=fixes.height_m),
        ),
        layout=layout,
        own=known.own_errors(layout, airborne, (begin_s, begin_s), start.state.C_nb),
    )
    level = np.array([*start.accel_m_s2[:2], 0.0])
    of_bins = np.tile(start.gyro_rad_s, (bins.start_s.size, 1))
    first = Start(start.state.C_nb, of_bins, level, start.state.v_n_m_s)
    done, antenna = solved(session, first)
    solution = _solution(session, done, parked_after)
    mean, covariance = solution.bias
    tally = done.filter.tally
    dof = sum(tally.dof.values())
    down = em.THETA_START.stop - 1
    heading_rad = euler_from_dcm(done.history.C_nb[0])[2] - done.filter.x[down]
    first_heading_rad = euler_from_dcm(start.state.C_nb)[2]
    sigma_rad = float(np.sqrt(done.filter.P[down, down]))
    # the filter that found the start knows no scale errors and misalignments
    found_rad = max(start.sigma_heading_rad, sigma_rad)
    estimate = SessionEstimate(
        bins=bins,
        mean_deg_h=mean / DEG_PER_HOUR,
        covariance=covariance / DEG_PER_HOUR**2,
        alignment=Alignment(AlignmentVerdict.REFUSED, (because(AlignmentReason.BEGINS_IN_MOTION),)),
        solution=solution,
        heading_error_rad=float(wrap_pi(first_heading_rad - heading_rad)),
        sigma_heading_rad=sigma_rad,
        sigma_heading_before_rad=found_rad,
        nis_mean=sum(tally.nis.values()) / max(dof, 1),
        dof=dof,
        begun=BegunInMotion(
            time_s=begin_s,
            method=start.method.value,
            sigma_heading_mrad=found_rad / MILLIRADIAN,
            parked_s=float(solution.motion.seconds(STILL)),
        ),
        own=session.own.found(solution, bins),
    )
    return FlownEstimate(estimate, done.session.layout, antenna, done.session.priors)


_NO_MOTION = Motion(
    time_s=np.zeros(0),
    kind=np.zeros(0, dtype=np.int64),
    jolt_rad=np.zeros(0),
    sigma_v_m_s=float("nan"),
)


def _middle(ground: Solution) -> ParkedConstraint:
    """How a vehicle was held where it stood, at the middle of it."""
    held, still = ground.fitted.parked, ground.plan.kind == STILL

    def middle(values: NDArray | float) -> float:
        of_steps = np.broadcast_to(np.asarray(values, dtype=float), still.shape)
        return float(np.median(of_steps[still]))

    return held.mapped(middle)


def _each_step(held: ParkedConstraint, plan: StepPlan) -> ParkedConstraint:
    """The same at each step of a plan."""
    return held.mapped(lambda value: np.full(plan.kind.shape, float(value)))


def _solution(
    session: FlownSession, done: FlownPass, parked_after: SessionEstimate | None
) -> Solution:
    """The session's solution; how the vehicle moved where it stood: as the ground session found."""
    motion = flown_motion(done.history, session.beginning.motion, session.flight)
    ground = None if parked_after is None else parked_after.navigated
    fitted = LevelFit(
        done.filter, done.last.parked, QUIET if ground is None else ground.fitted.scale
    )
    return Solution(
        history=done.history,
        motion=reported_motion(motion, session.flight),
        plan=done.last.plan,
        prior=session.prior,
        applied_bias_rad_s=done.start.gyro_rad_s,
        clone_s=session.course.clone_at_s,
        fitted=fitted,
        level=NOT_MEASURED if ground is None else ground.level,
        last=done.last,
    )
