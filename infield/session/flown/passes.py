"""Passes of one filter over a whole session that flies, however it begins: navigate, estimate the
errors, correct the start and the biases, and again.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

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
from infield.session.flown.fixes import Antenna, FixAid, Sigmas
from infield.session.flown.flight import Flight, flown_motion, joined_cruise
from infield.session.flown.known import KnownRun
from infield.session.flown.priors import Layout
from ins.filters.error_filter import ErrorFilter
from ins.filters.program import FilterProgram
from ins.records import GnssLog, NavHistory, TwinModel

# as alignment.linearised: 2 or 3 as a rule; the first is about the ground session's result
FLIGHT_PASSES = 3


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

    known: KnownRun
    fixes: GnssLog
    flight: Flight
    beginning: Beginning
    log: RestedLog
    prior: BiasPrior
    course: Course
    layout: Layout


@dataclass(frozen=True)
class FlownPass:
    """A pass over the whole session: its solution, what it is a pass of, and the filter's end."""

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
                antenna.found(done.filter, session.layout),
            )
        history = navigated(session.log, session.prior, session.course, start)
        last = _pass_over(session, history, start)
        flt = last.run(session.beginning.sigmas, _aids(session, last, antenna))
        done = FlownPass(history, start, last, flt)
    assert done is not None
    return done, antenna


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
        further_sigma=tuple(session.layout.sigma),
    )


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


def _aids(session: FlownSession, last: FilterPass, antenna: Antenna) -> Sequence[Aid]:
    """The wheels and surveys up to take-off, the fixes throughout."""
    known, history = session.known, last.history
    views = views_of(history, last.plan)
    before = int(np.searchsorted(views.end_s, session.flight.start_s + 1e-6))
    gnss = known.twin.gnss
    return [
        Driving(
            session.layout,
            known.settings.flight,
            body_motion(history, last.plan, views, known.temperature),
            flying(session.flight, views),
        ),
        *(_Before(aid, before) for aid in session.beginning.aids),
        FixAid(
            session.fixes,
            Sigmas(gnss.sigma_horizontal_m, gnss.sigma_velocity_m_s),
            antenna,
            session.layout,
            history,
        ),
    ]
