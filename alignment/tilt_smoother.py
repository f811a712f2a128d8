"""Tilt rate of the computed platform by a Kalman filter over the parked phase, smoothed over the
whole of it.

The same tilt rates as `alignment.tilt_rate`, from a filter (US 5,527,003, abstract) instead of
windows cut out of the velocity, and with what came afterwards: nothing here is real-time. Per 10 s
step, errors of a parked solution (physics.md 6.2, drift-angle form; theta' = u is autonomous)::

    v_N' = -g (theta_E + p_N / R_N) - 2 Omega sinL v_E     p' = v     theta' = u + angle random walk
    v_E' =  g (theta_N - p_E / R_E) + 2 Omega sinL v_N                u' = random walk

A point is the turn of theta between two window edges over the time between them: theta at both
edges is known from the Schuler motion on both sides. Two more states, a clone of theta at the
window's start and the angle random walk since then, give that turn and the sigma of what it says of
the gyros.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from alignment.tilt_rate import RATE_WINDOW_S, TiltRate, enough_still
from ins import kalman
from ins.earth import EARTH_RATE_RAD_S, gravity_magnitude, radii_of_curvature
from ins.records import NavHistory
from ins.units import DEG_PER_HOUR

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
