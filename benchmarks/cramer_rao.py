"""Cramer-Rao bound of a session's gyro biases: no estimator that knows only what is seen does
better on average.

Bayesian form (Van Trees 1968, section 2.4): for jointly Gaussian unknowns and data linear in them
the bound is the posterior covariance (H' Sigma^-1 H + P0^-1)^-1; here by recursion over epochs of
one second.

Kept apart from the estimator on purpose, so that a common mistake cannot hide: nothing comes from
`ins.estimation`, `alignment` or `infield`. A solution's errors answer by finite differences of the
nonlinear mechanization (`benchmarks.navigation_response`); vehicle, sensors and unit are the
simulator's own (`trajectories`), second by second, sway as the oscillator it is. A filter sigma
below the bound is a defect of one of the two.

Random: gyro bias (common shift and smooth shape over temperature, turn-on, flicker, rate random
walk), white noise of the sensors, accelerometer turn-on and walk, start errors, crab, lever arm,
sway, side motion, yaw creep, satellite fixes. Seen: standing, the way and the turn since the stop;
rolling, the way to the side; satellite position and velocity; a surveyed heading. Not seen: speed,
course, roll and pitch, which no vehicle warrants. Accelerometer flicker is left out.

Decision: docs/decisions/0014-independent-bound.md.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from benchmarks.navigation_response import ERRORS, NavigationResponse
from ins.records import GyroNoise, TwinModel, VehicleNoise
from ins.units import ARCSEC, DEG_PER_HOUR, DEG_PER_SQRT_HOUR, HOUR, MICRO_G, MICRO_G_PER_SQRT_HOUR
from trajectories.simulator.imperfections import SLOW_RATE_HZ
from trajectories.simulator.sensors import IdealSensors
from trajectories.simulator.session import GNSS_HZ
from trajectories.simulator.unit_truth import SHAPE_LENGTH_DEGC
from trajectories.simulator.vehicle import ROLLING_M_S, SIDE_NOISE_TAU_S

# diffuse beside what a minute of rest shows
START_SIGMA = np.array([10.0, 10.0, 0.1, 0.1, 0.01, 0.01, 0.1])
# what is seen exactly gets this much noise, for the digits' sake
WAY_FLOOR_M, TURN_FLOOR_RAD = 1e-5, 3e-8
BIN_S = 60.0  # over which a gyro's bias is taken for constant
MODE_SHARE = 1e-5  # of the bias variance; smaller modes of its history are left out

# The state: errors of the solution, what the vehicle showed since the stop (or since the epoch
# began), and the unknowns.
NAV, HEADING = slice(0, ERRORS), ERRORS - 1
WAY, TURN = slice(7, 9), 9  # body x, y [m]; about down [rad]
SHOWN = slice(7, 10)
SWAY, SIDE = slice(10, 14), 14  # position and velocity north, then east; side velocity
ACCEL = slice(15, 18)
# lateral over forward velocity; along x; heading error when the alignment ended
CRAB, LEVER, HEADING_THEN = 18, 19, 20
MODES = 21  # of the gyro biases, to the end


@dataclass(frozen=True, kw_only=True)
class Sights:
    """What a session sees besides the wheels. surveyed_sigma_rad: of a parked heading surveyed at
    the start.

    velocity_noise_m_s (standing, rolling): white noise of the velocity over each second, instead of
    what sway and side motion of the twin leave of the way: the measurements that physics.md 6.7
    assumes.
    """

    gnss: bool = False
    hold_heading: bool = True
    surveyed_sigma_rad: float | None = None
    velocity_noise_m_s: tuple[float, float] | None = None


@dataclass(frozen=True, kw_only=True)
class Spread:
    """One sigma of the unit against its table (common shift, smooth shape over temperature), of
    crab and lever arm.
    """

    common_deg_h: float
    shape_deg_h: float
    crab_rad: float = 0.010
    lever_arm_m: float = 5.0


@dataclass(frozen=True)
class Bound:
    """Covariance (3, 3) [(deg/h)^2] of the session-mean bias of gyros x, y, z, before and after the
    session; sigma of the heading error at the alignment's end [rad].
    """

    covariance: NDArray
    prior: NDArray
    sigma_heading_rad: float

    @property
    def sigma_deg_h(self) -> NDArray:
        return np.sqrt(np.diag(self.covariance))

    @property
    def sigma_prior_deg_h(self) -> NDArray:
        return np.sqrt(np.diag(self.prior))


@dataclass(frozen=True)
class Epoch:
    """x+ = F x + w, cov(w) = Q; then rows H of the state are seen with independent errors of
    variance R (m,).
    """

    F: NDArray
    Q: NDArray
    H: NDArray
    R: NDArray


def posterior_covariance(P0: NDArray, epochs: Iterable[Epoch]) -> NDArray:
    """Covariance (n, n) of the last state given all that was seen; for its static unknowns, the
    Bayesian bound.
    """
    P = np.array(P0, dtype=float)
    for epoch in epochs:
        P = epoch.F @ P @ epoch.F.T + epoch.Q
        for row, variance in zip(epoch.H, epoch.R):
            seen = P @ row
            total = row @ seen + variance
            gain = seen / total
            P += total * np.outer(gain, gain) - np.outer(gain, seen) - np.outer(seen, gain)
        P = 0.5 * (P + P.T)
    return P


def bias_bound(
    ideal: IdealSensors,
    response: NavigationResponse,
    gyro_degC: NDArray,
    twin: TwinModel,
    spread: Spread,
    sights: Sights,
    *,
    alignment_s: float = 600.0,
) -> Bound:
    """Bound of the session-mean gyro biases over one noise-free run.

    gyro_degC (n, 3): temperatures at the middles of the response's n epochs.
    """
    modes = bias_modes(gyro_degC, twin.gyro, spread, epoch_s=_epoch_s(response))
    P0 = session_prior(twin, spread, modes.shape[2])
    P = posterior_covariance(P0, session_epochs(ideal, response, modes, twin, sights, alignment_s))
    mean = modes.mean(axis=0) / DEG_PER_HOUR
    return Bound(
        covariance=mean @ P[MODES:, MODES:] @ mean.T,
        prior=mean @ mean.T,
        sigma_heading_rad=float(np.sqrt(P[HEADING_THEN, HEADING_THEN])),
    )


def bias_modes(gyro_degC: NDArray, gyro: GyroNoise, spread: Spread, *, epoch_s: float) -> NDArray:
    """Gyro bias histories (n, 3, m) [rad/s] of m independent unknowns of unit variance:
    eigenvectors of its covariance.
    """
    n = len(gyro_degC)
    size = max(round(BIN_S / epoch_s), 1)
    of = np.arange(n) // size
    count, per_axis = of[-1] + 1, []
    for k in range(3):
        T = np.bincount(of, gyro_degC[:, k]) / np.bincount(of)
        shape = np.exp(-((T[:, None] - T) ** 2) / (2 * SHAPE_LENGTH_DEGC**2))
        C = spread.common_deg_h**2 + spread.shape_deg_h**2 * shape + gyro.turn_on_deg_h**2
        C = C + _session_covariance(gyro, count, size * epoch_s)
        value, vector = np.linalg.eigh(C)
        kept = value > MODE_SHARE * value.sum()
        per_axis.append((vector * np.sqrt(np.maximum(value, 0.0)))[:, kept][of] * DEG_PER_HOUR)
    out, first = np.zeros((n, 3, sum(a.shape[1] for a in per_axis))), 0
    for k, columns in enumerate(per_axis):
        out[:, k, first : first + columns.shape[1]] = columns
        first += columns.shape[1]
    return out


def _session_covariance(gyro: GyroNoise, count: int, bin_s: float) -> NDArray:
    """Flicker and rate random walk of one gyro, averaged over bins: (count, count) [(deg/h)^2].

    Flicker as the simulator draws it: lines at multiples of 1 / (4 run lengths) with PSD B^2 / (2
    pi f).
    """
    if not gyro.bias_instability_deg_h and not gyro.rate_random_walk_deg_h_sqrt_h:
        return np.zeros((count, count))
    centre = (np.arange(count) + 0.5) * bin_s
    # mean of min(u, v) over a bin: centre - bin/6
    walk = np.minimum(centre[:, None], centre) - np.eye(count) * bin_s / 6.0
    step_hz = 0.25 / (count * bin_s)
    f = step_hz * np.arange(1, int(0.5 * SLOW_RATE_HZ / step_hz))
    power = 2 * gyro.bias_instability_deg_h**2 / (2 * np.pi * f) * step_hz * np.sinc(f * bin_s) ** 2
    lag = np.array([np.sum(power * np.cos(2 * np.pi * f * k * bin_s)) for k in range(count)])
    flicker = lag[np.abs(np.subtract.outer(np.arange(count), np.arange(count)))]
    return flicker + gyro.rate_random_walk_deg_h_sqrt_h**2 / HOUR * walk


def session_prior(twin: TwinModel, spread: Spread, modes: int) -> NDArray:
    sway, vehicle = np.zeros(4), twin.vehicle
    sway[0::2], sway[1::2] = vehicle.sway_m_s / (2 * np.pi * vehicle.sway_hz), vehicle.sway_m_s
    sigma = np.concatenate(
        [
            START_SIGMA,
            np.zeros(3),
            sway,
            [vehicle.lateral_noise_m_s],
            np.full(3, twin.accel.turn_on_ug * MICRO_G),
            [spread.crab_rad, spread.lever_arm_m, 0.0],
            np.ones(modes),
        ]
    )
    return np.diag(sigma**2)


def session_epochs(
    ideal: IdealSensors,
    response: NavigationResponse,
    modes: NDArray,
    twin: TwinModel,
    sights: Sights,
    alignment_s: float,
) -> Iterator[Epoch]:
    """The session second by second: transition, noise and what is seen."""
    dt, vehicle = _epoch_s(response), twin.vehicle
    size = MODES + modes.shape[2]
    standing, fade = _standing_and_fade(ideal, response)
    align = round(alignment_s / dt) - 1
    for k in range(len(response.Phi)):
        keep = standing[k] and k > 0 and standing[k - 1] and not sights.velocity_noise_m_s
        F, Q = np.eye(size), np.zeros((size, size))
        F[SHOWN, SHOWN] = np.eye(3) * keep
        F[SHOWN, NAV], F[NAV, NAV] = response.shown_Phi[k], response.Phi[k]
        gamma = np.concatenate([response.Gamma[k], response.shown_Gamma[k]])
        F[:10, ACCEL], F[:10, MODES:] = gamma[:, 3:], gamma[:, :3] @ modes[k]
        Q[:10, :10] = _sensor_noise(gamma, twin, dt)
        Q[ACCEL, ACCEL] = (
            np.eye(3) * (twin.accel.rate_random_walk_ug_sqrt_h * MICRO_G_PER_SQRT_HOUR) ** 2 * dt
        )
        moved, noise = _vehicle_step(vehicle, _level(response.nominal.C_nb[k]), float(fade[k]), dt)
        F[10:15, 10:15], F[WAY, 10:15] = moved[:5, :5], moved[5:, :5]
        block = np.r_[10:15, 7:9]
        Q[np.ix_(block, block)] += noise
        if standing[k]:
            Q[TURN, TURN] += (vehicle.yaw_creep_arcsec_sqrt_h * ARCSEC / 60.0) ** 2 * dt
        else:
            F[WAY.start + 1, CRAB] = response.nominal.displacement_b_m[k + 1, 0]
            F[WAY.start + 1, LEVER] = _turned(response, k)
        if k == align:
            F[HEADING_THEN] = F[HEADING]
            Q[HEADING_THEN], Q[:, HEADING_THEN] = Q[HEADING], Q[:, HEADING]
            Q[HEADING_THEN, HEADING_THEN] = Q[HEADING, HEADING]
        fix = np.isclose(response.nominal.time_s[k + 1] * GNSS_HZ % 1.0, [0.0, 1.0]).any()
        yield Epoch(
            F, Q, *_seen(size, bool(standing[k]), twin, sights, first=k == 0, fix=bool(fix))
        )


def _seen(
    size: int, standing: bool, twin: TwinModel, sights: Sights, *, first: bool, fix: bool
) -> tuple[NDArray, NDArray]:
    """Rows (m, size) of the state that are seen at an epoch's end, and their variances (m,)."""
    stand_m, roll_m = sights.velocity_noise_m_s or (WAY_FLOOR_M, WAY_FLOOR_M)
    seen = [(WAY.start + 1, stand_m if standing else roll_m)]
    if standing:
        seen.append((WAY.start, stand_m))
        if sights.hold_heading:
            seen.append((TURN, TURN_FLOOR_RAD))
    if sights.gnss and fix:
        seen += [(k, twin.gnss.sigma_horizontal_m) for k in (0, 1)] + [
            (k, twin.gnss.sigma_velocity_m_s) for k in (2, 3)
        ]
    if first and sights.surveyed_sigma_rad:
        seen.append((HEADING, sights.surveyed_sigma_rad))
    index, sigma = zip(*seen)
    return np.eye(size)[list(index)], np.square(sigma)


def _sensor_noise(gamma: NDArray, twin: TwinModel, dt: float) -> NDArray:
    """White gyro and accelerometer noise as mean rates over the epoch, of variance density / dt."""
    arw, vrw = twin.gyro.arw_deg_sqrt_h * DEG_PER_SQRT_HOUR, twin.accel.vrw_ug_sqrt_hz * MICRO_G
    loaded = gamma * np.repeat([arw, vrw], 3) / np.sqrt(dt)
    return loaded @ loaded.T


@lru_cache(maxsize=4096)
def _vehicle_step(
    vehicle: VehicleNoise, level: tuple[float, float, float, float], fade: float, dt: float
) -> tuple[NDArray, NDArray]:
    """Transition and noise (7, 7) of sway, side velocity and the body way they make, exact over dt
    for constant coefficients; `level` is C_nb[:2, :2] by rows.

    Source: Van Loan, IEEE Trans. Automatic Control 23(3), 1978.
    """
    nx, ny, ex, ey = level
    sway, damping = vehicle.sway_m_s, vehicle.sway_damping
    side = vehicle.lateral_noise_m_s
    w, A, q = 2 * np.pi * vehicle.sway_hz, np.zeros((7, 7)), np.zeros(7)
    for x in (0, 2):
        A[x, x + 1], A[x + 1, x], A[x + 1, x + 1] = 1.0, -(w**2), -2 * damping * w
        q[x + 1] = 4 * damping * w * sway**2
    A[4, 4], q[4] = -1 / SIDE_NOISE_TAU_S, 2 * side**2 / SIDE_NOISE_TAU_S
    A[5, [1, 3]], A[6, [1, 3]], A[6, 4] = (nx, ex), (ny, ey), fade
    zero = np.zeros((7, 7))
    both = expm(np.block([[-A, np.diag(q)], [zero, A.T]]) * dt)
    Phi = both[7:, 7:].T
    Q = Phi @ both[:7, 7:]
    return Phi, 0.5 * (Q + Q.T)


def _level(C_nb: NDArray) -> tuple[float, float, float, float]:
    """C_nb[:2, :2] by rows, rounded so that standing epochs share one step."""
    nx, ny, ex, ey = np.round(C_nb[:2, :2], 6).ravel()
    return float(nx), float(ny), float(ex), float(ey)


def _standing_and_fade(
    ideal: IdealSensors, response: NavigationResponse
) -> tuple[NDArray, NDArray]:
    """Per epoch: wholly at rest; the share of the side motion that the vehicle's speed lets
    through.
    """
    of = np.searchsorted(response.nominal.time_s[1:], ideal.time_s - 0.5 * ideal.dt_s)
    inside = of < len(response.Phi)
    of, count = of[inside], np.bincount(of[inside])
    standing = np.bincount(of, ideal.at_rest[inside]) == count
    low, high = ROLLING_M_S
    u = np.clip((ideal.speed_m_s[inside] - low) / (high - low), 0.0, 1.0)
    return standing, np.round(np.bincount(of, u**3 * (10 - 15 * u + 6 * u**2)) / count, 6)


def _turned(response: NavigationResponse, k: int) -> float:
    """Heading change of the nominal over epoch k [rad]."""
    C = response.nominal.C_nb[k].T @ response.nominal.C_nb[k + 1]
    return float(np.arctan2(C[1, 0], C[0, 0]))


def _epoch_s(response: NavigationResponse) -> float:
    return float(response.nominal.time_s[1] - response.nominal.time_s[0])
