"""A navigation solution from a rest on, linearised about its own result: navigate, estimate the
errors, correct the start and the biases, and again until the solution stands.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from alignment import level_fit
from alignment.inertial_start import start_attitude
from alignment.mooring_motion import MooringMotion
from alignment.motion import imu_faults, level, stillness
from alignment.motion.disturbed_epochs import DisturbedEpochs
from alignment.motion.inertial import Where
from alignment.motion.kinds import ROLLING
from alignment.navigation_filter import (
    Aid,
    FilterPass,
    LaidDown,
    ParkedConstraint,
    bin_of,
    declared_sway_m,
    plan_steps,
)
from alignment.reasons import AlignmentReason
from alignment.result import BiasPrior, Solution
from ins.attitude import dcm_from_rotation_vector
from ins.earth import EARTH_RATE_RAD_S, omega_ie_n_by_lat
from ins.estimation import error_model as em
from ins.estimation.error_filter import ErrorFilter
from ins.records import ImuLog, ImuSource, InputError, NavHistory, NavState, Phase, Site, TwinModel
from ins.strapdown.compensation import compensate
from ins.strapdown.mechanization import VerticalChannel, navigate
from ins.verdicts import because, sentence

CONVERGED_RAD = 1e-4  # what is left is of second order: 1e-8 rad
MAX_PASSES = 4
PARKED_HEIGHT = VerticalChannel(mode="hold")


@dataclass(frozen=True)
class RestedLog:
    """A log as the filter takes it: compensated with everything known (table, scale factors).

    rest: (start, end) of its first rest [s]; faults: what was repaired in it.
    """

    imu: ImuSource
    site: Site
    rest: Where
    phases: tuple[Phase, ...] = ()
    faults: Sequence[imu_faults.ImuFault] = ()


@dataclass(frozen=True, kw_only=True)
class Course:
    """How far a log is followed, and how its vehicle is held.

    until_s: end of the filter; parked_only: it ends where the vehicle first rolls. clone_at_s: when
    the attitude error is kept for later. hold_heading: the parked vehicle keeps its heading.
    noise_scales: of the unit's own noise, tried in turn where the residuals exceed the model.
    level: how the parked vehicle moves, where that is not to be searched for.
    """

    until_s: float = np.inf
    parked_only: bool = False
    clone_at_s: float = np.inf
    hold_heading: bool = True
    noise_scales: tuple[float, ...] = (1.0,)
    vertical: VerticalChannel = PARKED_HEIGHT
    level: level_fit.LevelFound | None = None


TO_THE_END = Course()


class NothingStands(InputError):
    """No step of the rest stands still, so that there is nothing to estimate from."""

    def __init__(self, rest_s: float, source: str) -> None:
        self.reason = because(AlignmentReason.NOTHING_STANDS, rest_s=rest_s, source=source)
        super().__init__(sentence(self.reason))


@dataclass(frozen=True)
class Start:
    """Where a pass starts from: attitude, and what is taken out of the rows: gyro biases (N, 3)
    over the bins [rad/s], accelerometer biases (3,) [m/s^2]; v_n_m_s (3,): of a start in motion.
    """

    C_nb: NDArray
    gyro_rad_s: NDArray
    accel_m_s2: NDArray
    v_n_m_s: NDArray = field(default_factory=lambda: np.zeros(3))

    def corrected(self, flt: ErrorFilter) -> "Start":
        """The start less the errors that a filter found."""
        accel_m_s2 = self.accel_m_s2.copy()
        accel_m_s2[:2] += flt.x[em.ACCEL]
        return Start(
            dcm_from_rotation_vector(-flt.x[em.THETA_START]) @ self.C_nb,
            self.gyro_rad_s + flt.bias[0].reshape(-1, 3),
            accel_m_s2,
            self.v_n_m_s,
        )


@dataclass(frozen=True)
class _Judged:
    """What a pass made of the motion; disturbed: what the rows showed; settled: the kinds are those
    of the pass before.
    """

    motion: stillness.Motion
    level: level.ParkedLevel
    disturbed: DisturbedEpochs | None
    settled: bool


def solve(
    log: RestedLog,
    twin: TwinModel,
    prior: BiasPrior,
    *,
    course: Course = TO_THE_END,
    sigma0: dict[str, float] | None = None,
    aids: Sequence[Aid] = (),
    further_sigma: tuple[float, ...] = (),
) -> Solution:
    """Navigate from the rest, estimate the errors, correct the start and the biases, and again
    until it stands: two or three passes as a rule.

    prior: of the gyro biases, over time bins; sigma0: priors of the nuisances by their names; aids:
    what else measures; further_sigma: of constant states behind the bins. Raises NothingStands.
    """
    bins = len(prior.edges_s) - 1
    start = Start(start_attitude(log.imu, log.site, log.rest), np.zeros((bins, 3)), np.zeros(3))
    before: _Judged | None = None
    near = level_fit.QUIET
    for number in range(MAX_PASSES):
        history = navigated(log, prior, course, start)
        final = number == MAX_PASSES - 1
        judged = before if before is not None and final else _judge(history, log, before, number)
        last, stretch = _laid_out(log, twin, prior, course, (history, judged), start)
        last = replace(last, further_sigma=further_sigma)
        run = _runner(last, sigma0 or {}, aids)
        if course.level is None:
            fitted = level_fit.fit(run, stretch, course.noise_scales, rough=number == 0, near=near)
        else:
            fitted = level_fit.under_given(course.level, run, stretch)
        small = np.linalg.norm(fitted.filter.x[em.THETA_START]) < CONVERGED_RAD
        if final or (small and judged.settled):
            break
        before, near = judged, fitted.scale
        start = start.corrected(fitted.filter)
    last = replace(last, parked=fitted.parked, twin=scaled_noise(twin, fitted.scale.unit))
    return Solution(
        history,
        judged.motion,
        last.plan,
        prior,
        start.gyro_rad_s,
        course.clone_at_s,
        fitted,
        level_fit.found(fitted, run, stretch),
        last,
    )


def navigated(log: RestedLog, prior: BiasPrior, course: Course, start: Start) -> NavHistory:
    """The free solution from a start on."""
    state = NavState(
        time_s=float(log.rest[0]), site=log.site, v_n_m_s=start.v_n_m_s, C_nb=start.C_nb
    )
    rows = _less_found(log, prior.edges_s, course, start)
    return navigate(rows, state, epoch_s=1.0, vertical=course.vertical)


def _less_found(log: RestedLog, edges_s: NDArray, course: Course, start: Start) -> Iterator[ImuLog]:
    """The pieces of a log less the biases that were found."""
    for piece in log.imu.pieces(log.rest[0], min(course.until_s, log.imu.end_s)):
        bias = start.gyro_rad_s[bin_of(edges_s, piece.time_s)]
        yield compensate(piece, gyro_bias_rad_s=bias, accel_bias_m_s2=start.accel_m_s2)


def mean_attitudes(history: NavHistory, start_s: NDArray, end_s: NDArray) -> NDArray:
    """C_bn (N, 3, 3), the mean over each bin; of a bin beyond the solution, its last one."""
    first, last = np.searchsorted(history.time_s, [start_s, end_s])
    first = np.minimum(first, len(history.time_s) - 1)
    return np.array(
        [history.C_nb[a : max(b, a + 1)].mean(axis=0).T for a, b in zip(first, last, strict=True)]
    )


def latitude_covariance(history: NavHistory, edges_s: NDArray, sigma_lat_rad: float) -> NDArray:
    """What an error of the latitude leaves of Earth rate in the gyros: covariance (3N, 3N)
    [(rad/s)^2] over bins, one error of them all.
    """
    C_bn = mean_attitudes(history, edges_s[:-1], edges_s[1:])
    left = (C_bn @ omega_ie_n_by_lat(history.lat_rad[0])).ravel() * sigma_lat_rad
    return np.outer(left, left)


def _judge(history: NavHistory, log: RestedLog, before: _Judged | None, number: int) -> _Judged:
    """When the vehicle stands, and how much it moves about its place."""
    # from the second pass on the solution is close enough to keep what the rows showed
    known = before.disturbed if before is not None and number > 1 else None
    seen = stillness.classify(history, log.phases, log.imu, log.faults, known)
    motion = level.standing(history, seen)
    if number == 0:  # what a first solution makes of rest is its own drift
        motion = level.believed(motion, log.rest[1])
    settled = before is not None and np.array_equal(before.motion.kind, motion.kind)
    return _Judged(motion, level.parked_level(history, motion), seen.disturbed, settled)


def _laid_out(
    log: RestedLog,
    twin: TwinModel,
    prior: BiasPrior,
    course: Course,
    flown: tuple[NavHistory, _Judged],
    start: Start,
) -> tuple[FilterPass, level_fit.SearchInputs]:
    """A pass of the filter over a solution, and what the search for its level needs."""
    history, judged = flown
    until_s = judged.motion.parked_until_s if course.parked_only else course.until_s
    plan = plan_steps(judged.motion, prior.edges_s, until_s=until_s)
    if not plan.kind.size:
        raise NothingStands(log.rest[1] - log.rest[0], twin.source)
    stretch = level_fit.SearchInputs(
        plan, judged.level, history.time_s, course.hold_heading, declared_sway_m(twin)
    )
    last = FilterPass(
        history=history,
        plan=plan,
        twin=twin,
        parked=stretch.constraint(level_fit.QUIET),
        bias_covariance=prior.covariance
        + latitude_covariance(history, prior.edges_s, log.site.sigma_lat_rad),
        applied_rad_s=start.gyro_rad_s,
        applied_accel_m_s2=start.accel_m_s2,
        level_earth_rate_rad_s=EARTH_RATE_RAD_S * float(np.cos(log.site.lat_rad)),
        clone_at_s=course.clone_at_s,
    )
    return last, stretch


def _runner(last: FilterPass, sigma0: dict[str, float], aids: Sequence[Aid]) -> level_fit.FilterRun:
    """A pass of the filter under any level and any scale of the unit's noise."""
    rolls = np.flatnonzero(last.plan.kind >= ROLLING)
    until = int(rolls[0]) if rolls.size else len(last.plan.kind)
    first = replace(last, plan=last.plan.until(until)) if until else last
    laid: dict[tuple[bool, MooringMotion | None], LaidDown] = {}

    def run(parked: ParkedConstraint, unit: float, *, first_stand: bool = False) -> ErrorFilter:
        part = first if first_stand else last
        held = parked.until(len(part.plan.kind))
        key = (part is first, parked.mooring)
        if key not in laid:
            laid[key] = replace(part, parked=held).lay_down(aids)
        under = replace(part, parked=held, twin=scaled_noise(last.twin, unit))
        return under.over(laid[key], sigma0)

    return run


def scaled_noise(twin: TwinModel, scale: float) -> TwinModel:
    """The twin with white noise and random walks `scale` times as large."""
    gyro, accel = twin.gyro, twin.accel
    return replace(
        twin,
        gyro=replace(gyro, arw_deg_sqrt_h=scale * gyro.arw_deg_sqrt_h),
        accel=replace(
            accel,
            vrw_ug_sqrt_hz=scale * accel.vrw_ug_sqrt_hz,
            rate_random_walk_ug_sqrt_h=scale * accel.rate_random_walk_ug_sqrt_h,
        ),
    )
