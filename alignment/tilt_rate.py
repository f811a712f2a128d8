"""Tilt rate of the computed platform from the velocity of a parked solution: claim 1 of US
5,527,003, steps (e) to (g).

The rate of the acceleration is the tilt rate times g only for minutes; over an hour the Schuler and
Coriolis terms are as large. The bracket of physics.md 6.3 removes them::

    u_N = +[ v_E'' + ws^2 v_E - 2 Omega sinL v_N' ] / g
    u_E = -[ v_N'' + ws^2 v_N + 2 Omega sinL v_E' ] / g
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ins import kalman
from ins.earth import EARTH_RATE_RAD_S, gravity_magnitude, radii_of_curvature
from ins.records import NavHistory
from ins.units import DEG_PER_HOUR

RATE_WINDOW_S = 300.0
# variance of a parabola's rate over ARW^2 / window: 6/5 for a random walk of the angle
WALK_FACTOR = 1.2


@dataclass(frozen=True)
class TiltRate:
    """Tilt rate of one window: centre [s], north and east rates [rad/s] with the sigma of each, and
    the window [s].
    """

    time_s: float
    window_s: float
    u_north_rad_s: float
    u_east_rad_s: float
    sigma_rad_s: float


def tilt_rates(
    history: NavHistory,
    still: NDArray,
    *,
    arw: float,
    velocity_sigma_m_s: float,
    window_s: float = RATE_WINDOW_S,
) -> list[TiltRate]:
    """Tilt rates over successive windows of a parked solution, epochs that are not `still` left
    out.

    still: (k,) bool per epoch; arw [rad/sqrt(s)]; velocity_sigma: noise of the one-second velocity
    [m/s]. A window with less than three quarters of its epochs still is skipped.
    """
    found = []
    for start in np.arange(history.time_s[0], history.time_s[-1] - window_s + 1.0, window_s):
        if not enough_still(history, still, start, window_s):
            continue
        rows = _inside(history, start, window_s) & still
        found.append(
            _window(history, rows, start + 0.5 * window_s, window_s, arw, velocity_sigma_m_s)
        )
    return found


def enough_still(history: NavHistory, still: NDArray, start_s: float, window_s: float) -> bool:
    """Three quarters of the window's epochs, and at least thirty, are still."""
    inside = _inside(history, start_s, window_s)
    return bool((inside & still).sum() >= max(0.75 * inside.sum(), 30))


def _inside(history: NavHistory, start_s: float, window_s: float) -> NDArray:
    return (history.time_s > start_s) & (history.time_s <= start_s + window_s)


def _window(
    history: NavHistory, rows: NDArray, centre: float, window_s: float, arw: float, sigma_v: float
) -> TiltRate:
    """Parabola through both velocities; velocity, acceleration (e) and acceleration rate (f) at the
    centre, then (g).
    """
    t = history.time_s[rows] - centre
    v, a, jerk = _parabola(t, history.v_n_m_s[rows, :2])
    lat, height = float(history.lat_rad[rows][0]), float(history.height_m[rows][0])
    g = float(gravity_magnitude(lat, height))
    meridian, transverse = (float(radius) + height for radius in radii_of_curvature(lat))
    coriolis = 2.0 * EARTH_RATE_RAD_S * np.sin(lat)
    u_north = (jerk[1] + g / transverse * v[1] - coriolis * a[0]) / g
    u_east = -(jerk[0] + g / meridian * v[0] + coriolis * a[1]) / g
    from_velocity = sigma_v * np.sqrt(720.0 / rows.sum()) / (g * window_s**2)
    sigma = np.sqrt(WALK_FACTOR * arw**2 / window_s + from_velocity**2)
    return TiltRate(float(centre), float(window_s), float(u_north), float(u_east), float(sigma))


def _parabola(t: NDArray, v: NDArray) -> tuple[NDArray, NDArray, NDArray]:
    """Value, slope and second derivative at t = 0 of the least-squares parabola of v (n, 2)."""
    A = np.stack([np.ones_like(t), t, 0.5 * t**2], axis=1)
    value, slope, second = np.linalg.lstsq(A, v, rcond=None)[0]
    return value, slope, second


TILT_STEP_S = 10.0
V, P, THETA, U, CLONE, WALK = (slice(k, k + 2) for k in range(0, 12, 2))
SIZE = 12
# of the states: m/s, m, rad, rad/s, rad, rad
STATE_UNITS = np.repeat([1e-2, 1.0, 1e-5, 0.01 * DEG_PER_HOUR, 1e-5, 1e-5], 2)
START_SIGMA = np.repeat([0.05, 1e-2, 1e-3, 1.0, 0.0, 1e-6], 2)  # SI; u and the clone are set below
VAGUE_RATE = 10.0  # prior sigma of the rate over what is expected of it
DRIFT_TIME_S = 1800.0  # time in which the rate changes by what is expected of it: a warm-up


@dataclass(frozen=True)
class SmoothedTiltRate(TiltRate):
    """A tilt rate given all of the parked phase; sigma_filtered: of the same window given nothing
    after its end.
    """

    sigma_filtered_rad_s: float


def smoothed_tilt_rates(
    history: NavHistory,
    still: NDArray,
    *,
    arw: float,
    vrw: float,
    velocity_sigma_m_s: float,
    rate_sigma_rad_s: float,
    window_s: float = RATE_WINDOW_S,
) -> list[SmoothedTiltRate]:
    """Tilt rates over successive windows of a parked solution, epochs that are not `still` not
    measured.

    still: (k,) bool per epoch; arw [rad/sqrt(s)], vrw [m/s/sqrt(s)]; velocity_sigma: noise of the
    computed velocity as a measurement of its error (sway) [m/s]; rate_sigma: what the tilt rate may
    be and may change by in a warm-up [rad/s]. Each sigma holds the angle random walk over its
    window. A window with less than three quarters of its epochs still is skipped. Left out: drift
    of the accelerometers, which counts as tilt rate (1 ug/min: 0.0034 deg/h).
    """
    edges = np.arange(history.time_s[0], history.time_s[-1] + 0.5, TILT_STEP_S)
    rows = np.minimum(np.searchsorted(history.time_s, edges - 1e-6), len(history.time_s) - 1)
    steps_a_window = round(window_s / TILT_STEP_S)
    # this step's clone is theta at its beginning
    starts = np.arange(len(edges)) % steps_a_window == 1
    F, Q = _steps(history, len(edges), starts, arw, vrw, rate_sigma_rad_s)
    x, cov = _filter(
        history.v_n_m_s[rows, :2], still[rows], F, Q, velocity_sigma_m_s, rate_sigma_rad_s
    )
    x_s, cov_s = kalman.rts_smooth(x, cov, F, Q)
    turned, walked = np.zeros((2, SIZE)), np.zeros((2, SIZE))
    turned[:, THETA], turned[:, CLONE], walked[:, WALK] = np.eye(2), -np.eye(2), np.eye(2)
    turned, walked = turned * STATE_UNITS, walked * STATE_UNITS
    found = []
    for end in range(steps_a_window, len(edges), steps_a_window):
        if not enough_still(history, still, float(edges[end] - window_s), window_s):
            continue
        turn = turned @ x_s[end]
        sigma, filtered = (
            _sigma(c[end], turned, walked, arw**2 * window_s) / window_s for c in (cov_s, cov)
        )
        centre = float(edges[end]) - 0.5 * window_s
        north, east = turn / window_s
        found.append(
            SmoothedTiltRate(
                centre, float(window_s), float(north), float(east), float(sigma), float(filtered)
            )
        )
    return found


def _sigma(cov: NDArray, turned: NDArray, walked: NDArray, walk_variance: float) -> float:
    """Sigma of the estimated turn as a measure of the rate's own."""
    error, both = turned @ cov @ turned.T, turned @ cov @ walked.T
    return float(np.sqrt(np.mean(np.diag(error - 2.0 * both)) + walk_variance))


def _steps(
    history: NavHistory, count: int, starts: NDArray, arw: float, vrw: float, rate_sigma: float
) -> tuple[NDArray, NDArray]:
    """F and Q (count, 12, 12) in the units of the states."""
    lat, height = float(history.lat_rad[0]), float(history.height_m[0])
    g = float(gravity_magnitude(lat, height))
    meridian, transverse = (float(radius) + height for radius in radii_of_curvature(lat))
    coriolis = 2.0 * EARTH_RATE_RAD_S * np.sin(lat)
    A = np.zeros((SIZE, SIZE))
    A[0, 1], A[1, 0] = -coriolis, coriolis
    A[0, 2], A[1, 3] = -g / meridian, -g / transverse
    A[0, 5], A[1, 4] = -g, g
    A[P, V], A[THETA, U] = np.eye(2), np.eye(2)
    q = np.diag(np.repeat([vrw**2, 0.0, arw**2, rate_sigma**2 / DRIFT_TIME_S, 0.0, arw**2], 2))
    q[THETA, WALK] = q[WALK, THETA] = arw**2 * np.eye(2)
    A, q = A * STATE_UNITS / STATE_UNITS[:, None], q / np.outer(STATE_UNITS, STATE_UNITS)
    half, full = (_exponential(A * dt) for dt in (0.5 * TILT_STEP_S, TILT_STEP_S))
    Q_step = TILT_STEP_S / 6.0 * (q + 4.0 * half @ q @ half.T + full @ q @ full.T)  # Simpson
    F, Q = np.repeat(full[None], count, axis=0), np.repeat(Q_step[None], count, axis=0)
    F[starts, CLONE.start :] = 0.0
    for k in range(2):
        F[starts, CLONE.start + k, THETA.start + k] = (
            STATE_UNITS[THETA.start] / STATE_UNITS[CLONE.start]
        )
    return F, Q


def _exponential(A: NDArray) -> NDArray:
    A2 = A @ A
    return np.eye(len(A)) + A + A2 / 2.0 + A2 @ A / 6.0 + A2 @ A2 / 24.0


def _filter(
    v_n_m_s: NDArray,
    still: NDArray,
    F: NDArray,
    Q: NDArray,
    velocity_sigma: float,
    rate_sigma: float,
) -> tuple[NDArray, NDArray]:
    """Estimates and covariances after each step's update, in the units of the states."""
    start = START_SIGMA.copy()
    start[U], start[CLONE] = VAGUE_RATE * rate_sigma, start[THETA]
    x, cov = np.zeros(SIZE), np.diag((start / STATE_UNITS) ** 2)
    H = np.eye(SIZE)[V]
    R = np.eye(2) * (velocity_sigma / STATE_UNITS[0]) ** 2
    kept_x, kept_cov = np.empty((len(still), SIZE)), np.empty((len(still), SIZE, SIZE))
    for k in range(len(still)):
        if k:
            x, cov = kalman.predict(x, cov, F[k], Q[k])
        if still[k]:
            x, cov, _ = kalman.update(x, cov, v_n_m_s[k] / STATE_UNITS[V], H, R)
        kept_x[k], kept_cov[k] = x, cov
    return kept_x, kept_cov
