"""The navigation-mode filter: what a free-running solution shows while the vehicle stands and rolls.

One sweep over a navigation solution: errors propagate by `ins.error_model`; a standing vehicle has no velocity
(its displacement since the stop) and keeps its heading up to a slow creep (parked-attitude
constraint); what a rolling vehicle shows is added by aids (lateral motion, odometer, GNSS: `infield.taxi_heading`).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from alignment.stillness import AIRBORNE, DISTURBED, ROLLING, STILL, Motion
from ins import error_model as em
from ins.attitude import euler_from_dcm, rotation_vector_from_dcm, wrap_pi
from ins.earth import SEMI_MAJOR_AXIS_M, gravity_magnitude, omega_en_n, omega_ie_n
from ins.error_filter import ErrorFilter
from ins.records import NavHistory, TwinModel
from ins.units import ARCSEC, DEG_PER_SQRT_HOUR, MICRO_G, MICRO_G_PER_SQRT_HOUR

STILL_STEP_S = 10.0
LATERAL_TIME_S = 2.0  # formats.md: side velocity while rolling is first-order Gauss-Markov, 2 s
MIN_DISPLACEMENT_SIGMA_M = 1e-4
NEW_HEADING_RAD = 1e-3  # a sudden turn beyond this is a new parked heading
DIFFUSE_HEADING_RAD = 0.05  # wide beside a coarse heading, and at least 20 times what the gyro prior allows
DIFFUSE_TILT_RAD = 0.005


@dataclass(frozen=True)
class PlannedStep:
    """One filter step: epochs (first, last] of the history, its kind, bias bin and sudden turn [rad]."""

    first: int
    last: int
    kind: int
    bin_index: int
    jolt_rad: float


@dataclass(frozen=True)
class StepView:
    """What a step shows to an aid.

    Displacements of the solution in body axes and NED [m]; heading change relative to Earth [rad]; C_nb, v_n, lat, lon,
    height at the step's end, v_start_n at its start; `kind` as in `stillness`; jitter_m: sway of the vehicle's position.
    """

    kind: int
    jitter_m: float
    step: em.Step
    start_s: float
    end_s: float
    displacement_b_m: NDArray
    displacement_n_m: NDArray
    heading_change_rad: float
    C_nb: NDArray
    v_n: NDArray
    v_start_n: NDArray
    lat_rad: float
    lon_rad: float
    height_m: float


class Aid(Protocol):
    """Something that measures while the vehicle rolls (or at any time, if `always`)."""

    always: bool

    def measure(self, flt: ErrorFilter, view: StepView) -> None:
        """Use what this aid saw within the step."""


def bin_of(edges_s: NDArray, time_s: NDArray) -> NDArray:
    """Index of the bias bin that each epoch ending at time_s belongs to; the outer bins reach on."""
    return np.minimum(np.maximum(np.searchsorted(edges_s, time_s - 1e-6, side="right") - 1, 0), len(edges_s) - 2)


def plan_steps(motion: Motion, edges_s: NDArray, *, until_s: float = np.inf) -> list[PlannedStep]:
    """Steps of up to 10 s while standing, one epoch otherwise; ends at the first airborne epoch or `until_s`.

    A step never crosses a change of kind or of bias bin (edges_s, (N + 1,)).
    """
    t, kind = motion.time_s, motion.kind
    bins = bin_of(edges_s, t)
    plan: list[PlannedStep] = []
    first = 0
    for k in range(1, len(t)):
        if kind[k] == AIRBORNE or t[k] > until_s:
            break
        here = (kind[k], bins[k])
        later = (kind[k + 1], bins[k + 1]) if k + 1 < len(t) and t[k + 1] <= until_s else None
        long = kind[k] in (STILL, DISTURBED) and later == here and t[k] - t[first] < STILL_STEP_S - 1e-6
        if not long:
            jolt = float(np.sqrt(np.sum(motion.jolt_rad[first + 1 : k + 1] ** 2)))
            plan.append(PlannedStep(first, k, int(kind[k]), int(bins[k]), jolt))
            first = k
    return plan


def view_of(
    history: NavHistory, planned: PlannedStep, velocity_error_m_s: NDArray | None = None, jitter_m: float = 0.0
) -> StepView:
    """Means and sums of a planned step.

    velocity_error_m_s (2,): estimate of w, taken off the velocity about which the errors are linearised; a vehicle
    known to stand has none. (The computed velocity instead leaves v_error x theta in the position: 0.6 m an hour.)
    """
    a, b = planned.first, planned.last
    rows = slice(a + 1, b + 1)
    dt = float(history.time_s[b] - history.time_s[a])
    lat, height = float(history.lat_rad[b]), float(history.height_m[b])
    v_mean = history.displacement_n_m[rows].sum(axis=0) / dt
    if planned.kind == STILL:
        v_mean = np.zeros(3)
    elif velocity_error_m_s is not None:
        v_mean[:2] -= velocity_error_m_s
    C_mean = history.C_nb_dt[rows].sum(axis=0) / dt
    heading_a, heading_b = (euler_from_dcm(history.C_nb[i])[2] for i in (a, b))
    step = em.Step(
        dt_s=dt,
        C_nb=C_mean,
        v_n=v_mean,
        omega_ie_n=omega_ie_n(lat),
        omega_en_n=omega_en_n(lat, height, v_mean),
        gravity=float(gravity_magnitude(lat, height)),
        radius_m=SEMI_MAJOR_AXIS_M + height,
        turn_rad=float(history.dtheta_b_rad[rows, 2].sum()),
    )
    return StepView(
        kind=planned.kind,
        jitter_m=jitter_m,
        step=step,
        start_s=float(history.time_s[a]),
        end_s=float(history.time_s[b]),
        displacement_b_m=history.displacement_b_m[rows].sum(axis=0),
        displacement_n_m=history.displacement_n_m[rows].sum(axis=0),
        heading_change_rad=float(wrap_pi(heading_b - heading_a)),
        C_nb=history.C_nb[b],
        v_n=history.v_n_m_s[b],
        v_start_n=history.v_n_m_s[a],
        lat_rad=lat,
        lon_rad=float(history.lon_rad[b]),
        height_m=height,
    )


def process_noise(twin: TwinModel) -> em.ProcessNoise:
    """Densities of a twin in SI; the accelerometer flicker is carried by a random walk that reaches it in an hour."""
    accel = twin.accel
    walk = np.hypot(accel.rate_random_walk_ug_sqrt_h, accel.bias_instability_ug)
    return em.ProcessNoise(
        arw=twin.gyro.arw_deg_sqrt_h * DEG_PER_SQRT_HOUR,
        vrw=accel.vrw_ug_sqrt_hz * MICRO_G,
        accel_rrw=walk * MICRO_G_PER_SQRT_HOUR,
        yaw_creep=twin.vehicle.yaw_creep_arcsec_sqrt_h * ARCSEC / 60.0,
        lateral_rms=max(twin.vehicle.lateral_noise_m_s, 1e-3),
        lateral_time_s=LATERAL_TIME_S,
    )


def diffuse_heading_rad(bias_covariance: NDArray, level_earth_rate_rad_s: float) -> float:
    """Heading prior [rad] of a new filter; `solve` takes its information back at the end."""
    gyro_heading = np.sqrt(np.max(np.diag(bias_covariance))) / level_earth_rate_rad_s
    return float(min(max(DIFFUSE_HEADING_RAD, 20.0 * gyro_heading), 1.0))


def new_filter(
    twin: TwinModel,
    sigma0: dict[str, float],
    bias_mean: NDArray,
    bias_covariance: NDArray,
    level_earth_rate_rad_s: float,
) -> ErrorFilter:
    """A filter at the start of a parked solution: level and heading wide.

    Wider priors than these would cost digits (the parked heading is compared to 1e-12 rad^2); what the heading prior
    says is withdrawn after the sweep, so that it adds nothing at all.
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
    )
    sigma = diffuse_heading_rad(bias_covariance, level_earth_rate_rad_s)
    flt.assign(em.THETA.stop - 1, np.zeros(flt.x.size), sigma)
    flt.clone(em.THETA_START)
    return flt


@dataclass(frozen=True)
class ParkedConstraint:
    """How the standing vehicle is held: displacement noise [m], whether its heading holds, heading jitter [rad]."""

    displacement_sigma_m: float
    yaw_jitter_rad: float
    hold_heading: bool = True


def sweep(
    history: NavHistory,
    plan: Sequence[PlannedStep],
    flt: ErrorFilter,
    parked: ParkedConstraint,
    *,
    aids: Sequence[Aid] = (),
    clone_at_s: float = np.inf,
) -> None:
    """Run the filter over the plan, in place. theta is cloned at the end of the step that reaches `clone_at_s`."""
    C_ref: NDArray | None = None
    moved: NDArray | None = None  # way of the solution since the vehicle stopped, body axes
    cloned, rolled = False, False
    for planned in plan:
        view = view_of(history, planned, flt.x[em.W], parked.displacement_sigma_m)
        rolling, still = planned.kind == ROLLING, planned.kind == STILL
        moved = moved if still else None
        flt.advance(
            view.step, planned.bin_index, rolling=rolling, keep_displacement=moved is not None,
            extra_yaw_rad=planned.jolt_rad,
        )  # fmt: skip
        rolled = rolled or rolling
        if rolling or planned.jolt_rad > NEW_HEADING_RAD:
            C_ref = None
        if still:
            moved = _hold_position(flt, view, parked, moved, "stop" if rolled else "still")
            if parked.hold_heading:
                C_ref = _hold_heading(flt, view, parked, C_ref)
        for aid in aids:
            if rolling or aid.always:
                aid.measure(flt, view)
        if not cloned and view.end_s >= clone_at_s - 0.5 * STILL_STEP_S:
            flt.clone(em.THETA_CLONE)
            cloned = True


def _hold_position(
    flt: ErrorFilter, view: StepView, parked: ParkedConstraint, moved: NDArray | None, kind: str
) -> NDArray:
    """Zero velocity as a way: what the solution moved in body x, y since the stop is error, but for the jitter of the
    standing vehicle about its place. (A zero mean velocity over each step says the same but counts the jitter twice.)
    """
    sigma = max(parked.displacement_sigma_m, MIN_DISPLACEMENT_SIGMA_M)
    if moved is None:
        moved = np.zeros(2)
        for index in (em.S.start, em.S.start + 1):  # where in its jitter the vehicle was at the stop
            flt.P[index, index] += sigma**2
    moved = moved + view.displacement_b_m[:2]
    H = np.stack([flt.row({em.S.start: 1.0}), flt.row({em.S.start + 1: 1.0})])
    flt.measure(kind, moved, H, np.eye(2) * sigma**2, view.end_s)
    return moved


def heading_error_row(flt: ErrorFilter, view: StepView) -> NDArray:
    """Row of phi_D = theta_D + p_E tanL / R (physics.md 6.2)."""
    tan_over_R = np.tan(view.lat_rad) / view.step.radius_m
    return flt.row({em.THETA.stop - 1: 1.0, em.POS.start + 1: tan_over_R})


def _hold_heading(flt: ErrorFilter, view: StepView, parked: ParkedConstraint, C_ref: NDArray | None) -> NDArray:
    """Parked-attitude constraint: the computed turn about down since the stop is error plus creep."""
    H = heading_error_row(flt, view)
    if C_ref is None:
        flt.assign(em.YAW, -H, parked.yaw_jitter_rad)  # the heading at the stop is the reference
        return view.C_nb
    turn = rotation_vector_from_dcm(view.C_nb @ C_ref.T)[2]
    H[em.YAW] = 1.0
    flt.measure("heading held", np.array([turn]), H[None], np.array([[parked.yaw_jitter_rad**2]]), view.end_s)
    return C_ref
