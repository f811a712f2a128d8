"""The navigation-mode filter: what a free-running solution shows while the vehicle stands and
rolls.

Decision: docs/decisions/0007-parked-position.md.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from alignment.mooring_motion import STATES, MooringMotion, lay
from alignment.motion.kinds import AIRBORNE, DISTURBED, ROLLING, STILL
from alignment.motion.stillness import Motion
from ins.attitude import euler_from_dcm, rotation_vector_from_dcm, wrap_pi
from ins.earth import SEMI_MAJOR_AXIS_M, gravity_magnitude, omega_ie_n, transport_by_speed
from ins.errors.catalogue import prior
from ins.estimation import error_model as em
from ins.estimation import sensors
from ins.estimation.error_filter import GATE_SIGMA, ErrorFilter
from ins.estimation.measurements import standstill
from ins.estimation.measurements.attitude import heading_error_row
from ins.estimation.measurements.wheels import PointWay
from ins.estimation.tape import Compiled, Row, Steps, Tape
from ins.noise import accel_densities, gyro_densities, walk_with_flicker
from ins.records import NavHistory, TwinModel
from ins.units import ARCSEC, MICRO_G, MICRO_G_PER_SQRT_HOUR

# the errors do not depend on the specific force (docs/decisions/0006-error-state-w.md), and 2.8
# periods of rocking at 0.28 Hz fit in
STILL_STEP_S = 10.0
PARKED = ("still", "stop", "heading held")  # what is measured of a vehicle that stands
LATERAL_TIME_S = prior("lateral_motion", "session").scale
MIN_DISPLACEMENT_SIGMA_M = 1e-4
# a sudden turn beyond this is a new parked heading: loading turns by up to 200 arcsec
# (docs/reliability.md), 0.97 mrad
NEW_HEADING_RAD = 1e-3
# wide beside a coarse heading, and at least 20 times what the gyro prior allows
DIFFUSE_HEADING_RAD = 0.05
DIFFUSE_TILT_RAD = 0.005


@dataclass(frozen=True)
class StepPlan:
    """K filter steps: epochs (first, last] of the history, their kind, bias bin and sudden turn
    [rad], (K,) each.

    velocity_jump_m_s, turn_jump_rad: sigma of what a repaired fault of the log may have left within
    the step; None: none.
    """

    first: NDArray
    last: NDArray
    kind: NDArray
    bin_index: NDArray
    jolt_rad: NDArray
    velocity_jump_m_s: NDArray | None = None
    turn_jump_rad: NDArray | None = None

    def until(self, count: int) -> "StepPlan":
        """The first steps alone."""
        columns: dict[str, Any] = {
            name: None if column is None else column[:count] for name, column in vars(self).items()
        }
        return StepPlan(**columns)


@dataclass(frozen=True)
class StepViews:
    """What each step (K) of a plan shows to an aid.

    Displacements (K, 3) of the solution in body axes and NED [m]; heading change relative to Earth,
    and turn about north and east (K, 2) [rad]; at the step's end C_nb (K, 3, 3), v_n, lat, lon,
    height, heading; C_mean (K, 3, 3) over it; turn_rad: by the vertical
    gyro, Earth rate included; kind as in `stillness`; jolt_rad and the jumps: as in the plan;
    jitter_m: sway of the vehicle's position; history: the solution.
    """

    kind: NDArray
    bin_index: NDArray
    jolt_rad: NDArray
    velocity_jump_m_s: NDArray
    turn_jump_rad: NDArray
    start_s: NDArray
    end_s: NDArray
    displacement_b_m: NDArray
    displacement_n_m: NDArray
    heading_change_rad: NDArray
    level_turn_rad: NDArray
    heading_rad: NDArray
    C_nb: NDArray
    C_mean: NDArray
    v_n: NDArray
    lat_rad: NDArray
    lon_rad: NDArray
    height_m: NDArray
    turn_rad: NDArray
    jitter_m: float
    history: NavHistory

    @property
    def dt_s(self) -> NDArray:
        return self.end_s - self.start_s

    @property
    def turned_n_rad(self) -> NDArray:
        """Turn of the body against Earth over each step (K, 3) about north, east and down [rad]."""
        return np.column_stack([self.level_turn_rad, self.heading_change_rad])

    def way_of(self, arm_b_m: ArrayLike, at: NDArray) -> PointWay:
        """Way of a point of the body over given steps; arm_b_m (3,): from the unit to the point.

        A unit 2 m above its wheels on a road that leans by 0.01 has them 2 cm beside it: turns
        show that as an arm.
        """
        turned_b = np.einsum("kji,kj->ki", self.C_mean[at], self.turned_n_rad[at])
        swung = np.cross(turned_b, np.asarray(arm_b_m, dtype=float))
        return PointWay(
            way_b_m=self.displacement_b_m[at] + swung,
            turn_rad=self.heading_change_rad[at],
            dt_s=self.dt_s[at],
            C_nb=self.C_mean[at],
        )

    @property
    def radius_m(self) -> NDArray:
        """The sphere of the error model."""
        return SEMI_MAJOR_AXIS_M + self.height_m


class Aid(Protocol):
    """Something that measures while the vehicle rolls or stands."""

    def measure(self, tape: Tape, views: StepViews) -> None:
        """Add what this aid saw, at the steps where it saw it."""


def bin_of(edges_s: NDArray, time_s: NDArray) -> NDArray:
    """Index of the bias bin that each epoch ending at time_s belongs to; the outer bins reach
    on.
    """
    return np.minimum(
        np.maximum(np.searchsorted(edges_s, time_s - 1e-6, side="right") - 1, 0), len(edges_s) - 2
    )


def plan_steps(motion: Motion, edges_s: NDArray, *, until_s: float = np.inf) -> StepPlan:
    """Steps of up to 10 s while standing, one epoch otherwise; ends at the first airborne epoch or
    `until_s`.

    A step never crosses a change of kind or of bias bin (edges_s, (N + 1,)).
    """
    t, kind = motion.time_s, motion.kind
    bins = bin_of(edges_s, t)
    stop = np.flatnonzero((kind[1:] == AIRBORNE) | (t[1:] > until_s))
    count = int(stop[0]) + 1 if stop.size else len(t)  # epochs 1 .. count - 1
    long = np.zeros(count, dtype=bool)  # may be joined with the next
    long[1:-1] = np.isin(kind[1 : count - 1], (STILL, DISTURBED))
    long[1:-1] &= (kind[2:count] == kind[1 : count - 1]) & (bins[2:count] == bins[1 : count - 1])
    first, edges = 0, [0]
    for k, (joins, time_s) in enumerate(zip(long[1:].tolist(), t[1:count].tolist()), start=1):
        if not joins or time_s - t[first] >= STILL_STEP_S - 1e-6:
            edges.append(k)
            first = k
    a, b = np.array(edges[:-1], dtype=np.int64), np.array(edges[1:], dtype=np.int64)

    def root_sum(sigma: NDArray | None) -> NDArray:
        if sigma is None or not len(a):
            return np.zeros(len(a))
        return np.asarray(np.sqrt(np.add.reduceat(sigma[1:count] ** 2, a)))

    jumps = (
        root_sum(sigma)
        for sigma in (motion.jolt_rad, motion.velocity_jump_m_s, motion.turn_jump_rad)
    )
    return StepPlan(a, b, kind[b], bins[b], *jumps)


def views_of(history: NavHistory, plan: StepPlan, jitter_m: float = 0.0) -> StepViews:
    """Means and sums of the planned steps."""
    a, b = plan.first, plan.last

    def summed(rows: NDArray) -> NDArray:
        return np.add.reduceat(rows[1 : b[-1] + 1], a) if len(b) else rows[:0]

    heading, none = euler_from_dcm(history.C_nb)[2], np.zeros(len(b))
    start_s, end_s = history.time_s[a], history.time_s[b]
    return StepViews(
        kind=plan.kind,
        bin_index=plan.bin_index,
        jolt_rad=plan.jolt_rad,
        velocity_jump_m_s=none if plan.velocity_jump_m_s is None else plan.velocity_jump_m_s,
        turn_jump_rad=none if plan.turn_jump_rad is None else plan.turn_jump_rad,
        start_s=start_s,
        end_s=end_s,
        displacement_b_m=summed(history.displacement_b_m),
        displacement_n_m=summed(history.displacement_n_m),
        heading_change_rad=wrap_pi(heading[b] - heading[a]),
        level_turn_rad=rotation_vector_from_dcm(
            history.C_nb[b] @ np.swapaxes(history.C_nb[a], 1, 2)
        )[:, :2],
        heading_rad=heading[b],
        C_nb=history.C_nb[b],
        C_mean=summed(history.C_nb_dt) / (end_s - start_s)[:, None, None],
        v_n=history.v_n_m_s[b],
        lat_rad=history.lat_rad[b],
        lon_rad=history.lon_rad[b],
        height_m=history.height_m[b],
        turn_rad=summed(history.dtheta_b_rad[:, 2]),
        jitter_m=jitter_m,
        history=history,
    )


def filter_steps(views: StepViews) -> Steps:
    """Steps for the filter. A vehicle known to stand has no velocity; for the others the filter's
    velocity error is taken off the computed one. (The computed velocity instead leaves v_error x
    theta in the position: 0.6 m an hour.)
    """
    dt, still = views.dt_s, views.kind == STILL
    v_n = np.where(still[:, None], 0.0, views.displacement_n_m / dt[:, None])
    return Steps(
        end_s=views.end_s,
        dt_s=dt,
        C_nb=views.C_mean,
        v_n=v_n,
        omega_ie_n=omega_ie_n(views.lat_rad),
        transport=transport_by_speed(views.lat_rad, views.height_m),
        gravity=gravity_magnitude(views.lat_rad, views.height_m),
        radius_m=views.radius_m,
        turn_rad=views.turn_rad,
        bin_index=views.bin_index,
        rolling=views.kind == ROLLING,
        keep=still & np.append(False, still[:-1]),
        moving=~still,
        jump_yaw=views.jolt_rad**2,
        jump_w=views.velocity_jump_m_s**2,
        jump_theta=views.turn_jump_rad**2,
    )


def process_noise(twin: TwinModel) -> em.ProcessNoise:
    """Densities of a twin in SI; the accelerometer flicker is carried by a random walk that reaches
    it in an hour.
    """
    accel = twin.accel
    walk = walk_with_flicker(accel.rate_random_walk_ug_sqrt_h, accel.bias_instability_ug)
    return em.ProcessNoise(
        arw=gyro_densities(twin.gyro).white,
        vrw=accel_densities(accel).white,
        accel_rrw=walk * MICRO_G_PER_SQRT_HOUR,
        yaw_creep=twin.vehicle.yaw_creep_arcsec_sqrt_h * ARCSEC / 60.0,
        lateral_rms=max(twin.vehicle.lateral_noise_m_s, 1e-3),
        lateral_time_s=LATERAL_TIME_S,
    )


def declared_sway_m(twin: TwinModel) -> float:
    """RMS of the parked vehicle's place [m], per axis, as the twin declares its sway."""
    return twin.vehicle.sway_m_s / (2.0 * np.pi * max(twin.vehicle.sway_hz, 1e-3))


def diffuse_heading_rad(bias_covariance: NDArray, level_earth_rate_rad_s: float) -> float:
    """Heading prior [rad] of a new filter; `solve` takes its information back at the end."""
    gyro_heading = np.sqrt(np.max(np.diag(bias_covariance))) / level_earth_rate_rad_s
    return float(min(max(DIFFUSE_HEADING_RAD, 20.0 * gyro_heading), 1.0))


def new_filter(
    twin: TwinModel,
    sigma0: Mapping[str, float],
    bias_mean: NDArray,
    bias_covariance: NDArray,
    level_earth_rate_rad_s: float,
    further_sigma: tuple[float, ...] = (),
) -> ErrorFilter:
    """A filter at the start of a parked solution: level and heading wide.

    Wider priors than these would cost digits (the parked heading is compared to 1e-12 rad^2); what
    the heading prior says is withdrawn after the sweep, so that it adds nothing at all.
    """
    base = {
        "W": 0.05,
        "POS": 100.0,
        "THETA": DIFFUSE_TILT_RAD,
        "ACCEL": max(twin.accel.turn_on_ug, 1.0) * MICRO_G,
        "LATERAL": max(twin.vehicle.lateral_noise_m_s, 1e-3),
    }
    flt = ErrorFilter(
        sigma0={**base, **sigma0},
        noise=process_noise(twin),
        bias_mean=bias_mean,
        bias_covariance=bias_covariance,
        further_sigma=further_sigma,
    )
    sigma = diffuse_heading_rad(bias_covariance, level_earth_rate_rad_s)
    flt.widen_prior(em.THETA.stop - 1, sigma)
    flt.clone_start()
    return flt


@dataclass(frozen=True)
class ParkedConstraint:
    """How the standing vehicle is held: noise of its place [m] and heading [rad] at the end of a
    step, whether its heading holds, and by what place and heading go elsewhere within a step; RMS
    of a place that swings [m], and how.

    One value for all steps, or one each (K,); walks that are one value for all must be zero.
    """

    displacement_sigma_m: NDArray | float
    yaw_jitter_rad: NDArray | float
    hold_heading: bool = True
    place_walk_m: NDArray | float = 0.0
    yaw_walk_rad: NDArray | float = 0.0
    gate: float = GATE_SIGMA
    mooring: MooringMotion | None = None
    swing_m: float = 0.0

    @property
    def swing_states(self) -> int:
        """How many states behind all others hold a place that swings; zero until it is laid."""
        return STATES if self.mooring is not None else 0

    def until(self, count: int) -> "ParkedConstraint":
        """The same of the first steps."""

        def cut(value: NDArray | float) -> NDArray | float:
            return value[:count] if isinstance(value, np.ndarray) and value.ndim else value

        return self.mapped(cut)

    def mapped(self, value_of: Callable[[NDArray | float], NDArray | float]) -> "ParkedConstraint":
        """The same with other sizes of place, heading and their walks, by what they are here."""
        return replace(
            self,
            displacement_sigma_m=value_of(self.displacement_sigma_m),
            yaw_jitter_rad=value_of(self.yaw_jitter_rad),
            place_walk_m=value_of(self.place_walk_m),
            yaw_walk_rad=value_of(self.yaw_walk_rad),
        )


def lay_down(
    history: NavHistory,
    plan: StepPlan,
    parked: ParkedConstraint,
    *,
    aids: Sequence[Aid] = (),
    clone_at_s: float = np.inf,
    beside: int = em.BASE,
) -> "LaidDown":
    """The filter's tape over the plan, ready for any level of the parked vehicle's motion.

    theta is cloned at the end of the step that reaches `clone_at_s`; beside: the first state of
    a place that swings.
    """
    views = views_of(history, plan, float(np.median(parked.displacement_sigma_m)))
    tape = Tape(filter_steps(views))
    sensors.usual(tape)
    places = hold_position(tape, views, parked, beside)
    headings = hold_heading(tape, views, parked) if parked.hold_heading else ()
    for aid in aids:
        aid.measure(tape, views)
    tape.clone(np.flatnonzero(views.end_s >= clone_at_s - 0.5 * STILL_STEP_S)[:1], em.THETA_CLONE)
    return LaidDown(tape.compiled(), (*places, *headings))


@dataclass(frozen=True, kw_only=True)
class FilterPass:
    """All of one pass of the filter but what aids it: the solution that it is linearised about and
    what was taken off before. It can be run again under other aids on the same solution.

    applied_rad_s (N, 3): gyro biases taken off over the bias bins; applied_accel_m_s2 (3,).
    further_sigma: priors of states behind the bins, before those of a place that swings.
    """

    history: NavHistory
    plan: StepPlan
    twin: TwinModel
    parked: ParkedConstraint
    bias_covariance: NDArray
    applied_rad_s: NDArray
    applied_accel_m_s2: NDArray
    level_earth_rate_rad_s: float
    clone_at_s: float
    further_sigma: tuple[float, ...] = ()

    def run(self, sigma0: Mapping[str, float], aids: Sequence[Aid]) -> ErrorFilter:
        """The filter after its sweep, the heading prior withdrawn.

        sigma0: prior sigmas of nuisance states by their names in `ins.estimation.states`.
        """
        return self.over(self.lay_down(aids), sigma0)

    def lay_down(self, aids: Sequence[Aid]) -> "LaidDown":
        """The pass's tape, ready for any level of the parked vehicle's motion."""
        return lay_down(
            self.history,
            self.plan,
            self.parked,
            aids=aids,
            clone_at_s=self.clone_at_s,
            beside=em.BASE + len(self.bias_covariance) + len(self.further_sigma),
        )

    def over(self, laid: "LaidDown", sigma0: Mapping[str, float]) -> ErrorFilter:
        """The filter after a tape that was laid down, the heading prior withdrawn."""
        flt = new_filter(
            self.twin,
            sigma0,
            -self.applied_rad_s.ravel(),
            self.bias_covariance,
            self.level_earth_rate_rad_s,
            self.further_sigma + (0.0,) * self.parked.swing_states,
        )
        flt.x[em.ACCEL] = -self.applied_accel_m_s2[:2]
        flt.run(laid.under(self.parked))
        flt.withdraw_prior(
            em.THETA_START.stop - 1,
            diffuse_heading_rad(self.bias_covariance, self.level_earth_rate_rad_s),
        )
        return flt


@dataclass(frozen=True)
class ConstrainedRows:
    """Rows of a tape whose variance is the parked vehicle's: of which steps, and of what (a
    field of `ParkedConstraint`); each step has so many of them on end. share: of that variance.
    """

    rows: slice
    steps: NDArray
    of: str
    each: int = 1
    share: NDArray | float = 1.0


@dataclass(frozen=True)
class LaidDown:
    """A tape, and which of its rows are the parked vehicle's noise."""

    tape: Compiled
    held: tuple[ConstrainedRows, ...]

    def under(self, parked: ParkedConstraint) -> Compiled:
        """The tape with the parked vehicle's noise as given."""
        variance = self.tape.variance.copy()
        for part in self.held:
            value = variance_of(parked, part.of)
            of_steps = value[part.steps] if value.ndim else np.full(part.steps.shape, value)
            variance[part.rows] = np.repeat(part.share * of_steps, part.each)
        return self.tape.under(variance, dict.fromkeys(PARKED, parked.gate))


def variance_of(parked: ParkedConstraint, name: str) -> NDArray:
    """Variance of one of the parked vehicle's noises."""
    least = MIN_DISPLACEMENT_SIGMA_M if name == "displacement_sigma_m" else 0.0
    return np.asarray(np.maximum(getattr(parked, name), least) ** 2)


def hold_position(
    tape: Tape, views: StepViews, parked: ParkedConstraint, beside: int = em.BASE
) -> tuple[ConstrainedRows, ...]:
    """The vehicle stays at its place (`standstill.place`); beside: the first state behind the bins,
    for a place that swings.
    """
    variance = _each(variance_of(parked, "displacement_sigma_m"), views)
    walk = _each(variance_of(parked, "place_walk_m"), views)
    still = views.kind == STILL
    at = np.flatnonzero(still)
    stops = np.flatnonzero(still & ~np.append(False, still[:-1]))
    held = []
    for index in (em.S.start, em.S.start + 1):
        # where in its jitter the vehicle was at the stop, and where its place went since
        held.append(_held(tape, stops, "displacement_sigma_m"))
        tape.widen(stops, index, variance[stops])
        if np.ndim(parked.place_walk_m):
            held.append(_held(tape, at, "place_walk_m"))
            tape.widen(at, index, walk[at])
    swung = None
    if parked.mooring is not None:
        swung = lay(tape, parked.mooring, still, (em.S.start, em.S.start + 1), beside)
        for part in swung.noise:
            rows_of = slice(part.first_row, part.first_row + part.steps.size)
            held.append(ConstrainedRows(rows_of, part.steps, "swing_m", share=part.share))
    moved = standstill.way_since_stop(views.displacement_b_m, still)
    rolled = np.cumsum(views.kind == ROLLING)[at] > 0
    for name, where in (("still", ~rolled), ("stop", rolled)):
        mooring: Sequence[Row] = ({}, {})
        if swung is not None:
            mooring = [swung.place(axis, at[where]) for axis in range(2)]
        held.append(_held(tape, at[where], "displacement_sigma_m", each=2))
        measured = standstill.place(moved[where], variance[at[where]], mooring)
        tape.measure(name, at[where], *measured, gate=parked.gate)
    return tuple(part for part in held if part.steps.size)


def _held(tape: Tape, steps: NDArray, of: str, *, each: int = 1) -> ConstrainedRows:
    """The rows that the next call lays down for some steps."""
    return ConstrainedRows(slice(tape.rows, tape.rows + each * len(steps)), steps, of, each)


def _each(value: NDArray | float, views: StepViews) -> NDArray:
    """A value of the parked constraint at each step (K,)."""
    return np.broadcast_to(np.asarray(value, dtype=float), views.kind.shape)


def hold_heading(
    tape: Tape, views: StepViews, parked: ParkedConstraint
) -> tuple[ConstrainedRows, ...]:
    """The vehicle keeps its heading (`standstill.heading`) until it rolls or turns suddenly."""
    still = np.flatnonzero(views.kind == STILL)
    stay = np.cumsum((views.kind == ROLLING) | (views.jolt_rad > NEW_HEADING_RAD))[still]
    _, first, number = np.unique(stay, return_index=True, return_inverse=True)
    references, held = still[first], np.setdiff1d(still, still[first])
    variance = _each(variance_of(parked, "yaw_jitter_rad"), views)
    walk = _each(variance_of(parked, "yaw_walk_rad"), views)
    assigned = heading_error_row(views.lat_rad[references], views.radius_m[references], -1.0)
    # the heading at the stop is the reference
    noise = [_held(tape, references, "yaw_jitter_rad")]
    tape.assign(references, em.YAW, assigned, variance[references])
    if np.ndim(parked.yaw_walk_rad):
        noise.append(_held(tape, held, "yaw_walk_rad"))
        tape.widen(held, em.YAW, walk[held])
    C_ref = views.C_nb[references[number[np.isin(still, held)]]]
    noise.append(_held(tape, held, "yaw_jitter_rad"))
    measured = standstill.heading(
        views.C_nb[held],
        C_ref,
        variance[held],
        lat_rad=views.lat_rad[held],
        radius_m=views.radius_m[held],
    )
    tape.measure("heading held", held, *measured, gate=parked.gate)
    return tuple(part for part in noise if part.steps.size)
