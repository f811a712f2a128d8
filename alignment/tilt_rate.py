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

from ins.earth import EARTH_RATE_RAD_S, gravity_magnitude, radii_of_curvature
from ins.records import NavHistory

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
