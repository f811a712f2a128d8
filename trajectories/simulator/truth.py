"""Truth as functions of time: a quintic spline of Earth-fixed velocity and of roll, pitch, heading
IS the truth.

Position, latitude, north-east-down velocity and acceleration all come back from that one spline
(position is its integral), so they agree to rounding. No navigation-frame equation is used but to
draw the path the spline is fitted to. At rest everything is constant.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline, CubicHermiteSpline, PPoly, make_interp_spline

from ins.attitude import dcm_from_euler
from ins.earth import (
    dcm_en,
    ecef_from_geodetic,
    geodetic_from_ecef,
    gravity_magnitude,
    radii_of_curvature,
)
from ins.records import Site
from ins.units import DEG
from trajectories.simulator.motions import SimulatedMotion

KNOT_S = 0.1  # spline knots while moving
TAIL_S = 3.0  # knots beyond a run that ends while moving
FLIGHT_INCIDENCE_RAD = 3.0 * DEG  # pitch above the flight path, in the air
VEL = slice(0, 3)
EULER = slice(3, 6)


@dataclass(frozen=True)
class Kinematics:
    """Truth at n times, each (n, 3): Earth-fixed position, velocity, acceleration of the IMU; roll,
    pitch, heading.
    """

    time_s: NDArray
    r_e: NDArray
    v_e: NDArray
    a_e: NDArray
    euler_rad: NDArray
    euler_rate_rad_s: NDArray


@dataclass(frozen=True)
class TruthSpan:
    """One span at rest (spline None) or moving; `r_e` and `euler_rad` are those at its start."""

    start_s: float
    r_e: NDArray
    euler_rad: NDArray
    spline: BSpline | None = None
    path: BSpline | None = None  # integral of the spline

    def at(self, t: NDArray) -> tuple[NDArray, NDArray, NDArray, NDArray, NDArray]:
        if self.spline is None or self.path is None:
            still = np.zeros((t.size, 3))
            return self.r_e + still, still, still, self.euler_rad + still, still
        value, rate = self.spline(t), self.spline(t, 1)
        r_e = self.r_e + (self.path(t) - self.path(self.start_s))[:, VEL]
        return r_e, value[:, VEL], rate[:, VEL], value[:, EULER], rate[:, EULER]


@dataclass(frozen=True)
class Truth:
    """A whole run. `wheel_reference_m`: from the IMU to the point P that does not slip, body
    axes.
    """

    site: Site
    motion: SimulatedMotion
    wheel_reference_m: tuple[float, float, float]
    stretches: tuple[TruthSpan, ...]

    @property
    def breaks_s(self) -> NDArray:
        """Where a stretch at rest or moving starts, and the end of the run."""
        return np.array([*(s.start_s for s in self.stretches), self.motion.end_s])

    def kinematics(self, time_s: NDArray) -> Kinematics:
        """Truth at any times within the run, in any order, shape (n,)."""
        t = np.atleast_1d(np.asarray(time_s, dtype=float))
        out = np.empty((5, t.size, 3))
        index = self._index(t)
        for k in np.unique(index):
            rows = index == k
            for channel, values in zip(out, self.stretches[k].at(t[rows])):
                channel[rows] = values
        return Kinematics(t, *out)

    def _index(self, t: NDArray) -> NDArray:
        return np.clip(
            np.searchsorted(self.breaks_s, t, side="right") - 1, 0, len(self.stretches) - 1
        )


def build_truth(
    motion: SimulatedMotion,
    site: Site,
    *,
    heading_rad: float = 0.0,
    roll_rad: float = 0.0,
    pitch_rad: float = 0.0,
    wheel_reference_m: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> Truth:
    """The truth of a motion that starts at a site on a heading; roll and pitch are those of the IMU
    on the wheels.
    """
    start = np.array([roll_rad, pitch_rad, heading_rad])
    lever_p_b = np.asarray(wheel_reference_m, dtype=float)
    r_e = ecef_from_geodetic(site.lat_rad, site.lon_rad, site.height_m)
    stretches: list[TruthSpan] = []
    for start_s, end_s, at_rest in _spans(motion):
        if at_rest:
            euler = start + [0.0, 0.0, float(motion.course_rad(start_s))]
            stretches.append(TruthSpan(start_s, r_e, euler))
            continue
        stretch = _moving(motion, r_e, start, lever_p_b, start_s, end_s)
        stretches.append(stretch)
        r_e = stretch.at(np.array([end_s]))[0][0]
    return Truth(site, motion, wheel_reference_m, tuple(stretches))


def _spans(motion: SimulatedMotion) -> list[tuple[float, float, bool]]:
    """(start, end, at rest), without holes; neighbouring rests are one."""
    spans: list[tuple[float, float, bool]] = []
    reached = 0.0
    for start_s, end_s in motion.rest:
        if start_s > reached:
            spans.append((reached, start_s, False))
        if spans and spans[-1][2]:
            spans[-1] = (spans[-1][0], end_s, True)
        else:
            spans.append((start_s, end_s, True))
        reached = end_s
    if motion.end_s > reached:
        spans.append((reached, motion.end_s, False))
    return spans


def _moving(
    motion: SimulatedMotion,
    r_e: NDArray,
    start: NDArray,
    lever_p_b: NDArray,
    start_s: float,
    end_s: float,
) -> TruthSpan:
    at_rest_after = any(a <= end_s < b for a, b in motion.rest)
    n = max(12, int(np.ceil((end_s - start_s) / KNOT_S)))
    step_s = (end_s - start_s) / n
    tail = 0 if at_rest_after else int(np.ceil(TAIL_S / step_s))
    t = start_s + step_s * np.arange(n + tail + 1)
    gravity = float(gravity_magnitude(geodetic_from_ecef(r_e)[0], 0.0))
    attitude = _attitude(motion, t, start, gravity)
    euler = make_interp_spline(t, attitude, k=5, bc_type=spline_ends(3, at_rest_after))
    v_n = imu_velocity_n(motion, euler, t, lever_p_b)
    return moving_span(t, r_e, euler, v_n, stops=at_rest_after)


def spline_ends(columns: int, stops: bool) -> tuple[list, list]:
    """Conditions of a quintic spline: rest is left and reached with no rate and no acceleration."""
    rest = [(1, np.zeros(columns)), (2, np.zeros(columns))]
    return rest, rest if stops else [(3, np.zeros(columns)), (4, np.zeros(columns))]


def moving_span(
    t: NDArray, r_e: NDArray, euler: BSpline, v_n: NDArray, *, stops: bool
) -> TruthSpan:
    """The span of a motion from rest that is given at times (m,); stops: it ends at rest."""
    v_e = np.einsum("nij,nj->ni", frames_along(r_e, v_n, t), v_n)
    spline = make_interp_spline(t, np.hstack([v_e, euler(t)]), k=5, bc_type=spline_ends(6, stops))
    return TruthSpan(float(t[0]), r_e, euler(t[0]), spline, spline.antiderivative())


def _attitude(motion: SimulatedMotion, t: NDArray, start: NDArray, gravity_m_s2: float) -> NDArray:
    """Roll, pitch, heading (n, 3): heading is the course; in the air bank balances the turn, pitch
    follows the path.
    """
    speed, airborne = motion.speed_m_s(t), motion.airborne(t)
    bank = airborne * np.arctan(speed * motion.course_rate_rad_s(t) / gravity_m_s2)
    path = np.arctan2(motion.climb_rate_m_s(t), np.maximum(speed, 1.0))
    pitch = airborne * (path + FLIGHT_INCIDENCE_RAD)
    return start + np.stack([bank, pitch, motion.course_rad(t)], axis=-1)


def imu_velocity_n(
    motion: SimulatedMotion, euler: BSpline, t: NDArray, lever_p_b: NDArray
) -> NDArray:
    """Velocity of the IMU: P follows the course, the IMU is at -lever from it: v_imu = v_P - omega
    x lever.

    omega is that of body to navigation axes; the turning of those axes (below 1e-5 rad/s on wheels)
    is left out of the arm's motion: 10 micrometres a second at 5 m.
    """
    heading = euler(t)[:, 2]
    speed = motion.speed_m_s(t)
    v_p_n = np.stack(
        [speed * np.cos(heading), speed * np.sin(heading), -motion.climb_rate_m_s(t)], axis=-1
    )
    if not np.any(lever_p_b):
        return v_p_n
    C_nb = dcm_from_euler(*euler(t).T)
    omega_nb_b = rate_from_euler(euler(t), euler(t, 1))
    return v_p_n - np.einsum("nij,nj->ni", C_nb, np.cross(omega_nb_b, lever_p_b))


def rate_from_euler(euler_rad: NDArray, euler_rate_rad_s: NDArray) -> NDArray:
    """omega_nb_b [rad/s] (n, 3) of roll, pitch, heading and their rates.  Source: Groves (2013),
    eq. (2.57).
    """
    r, p = euler_rad[:, 0], euler_rad[:, 1]
    dr, dp, dh = euler_rate_rad_s.T
    return np.stack(
        [
            dr - dh * np.sin(p),
            dp * np.cos(r) + dh * np.sin(r) * np.cos(p),
            -dp * np.sin(r) + dh * np.cos(r) * np.cos(p),
        ],
        axis=-1,
    )


def frames_along(r_e: NDArray, v_n: NDArray, t: NDArray) -> NDArray:
    """C_en (n, 3, 3) along a path, by Picard iteration on latitude and height; only draws the path
    (see the module).
    """
    lat0, lon0, height0 = (float(a) for a in geodetic_from_ecef(r_e))
    height = height0 - _integral(v_n[:, 2], t)
    lat = np.full(t.size, lat0)
    for _ in range(50):
        before = lat
        meridian, transverse = radii_of_curvature(before)
        lat = lat0 + _integral(v_n[:, 0] / (meridian + height), t)
        if np.max(np.abs(lat - before)) < 1e-14:
            break
    lon = lon0 + _integral(v_n[:, 1] / ((transverse + height) * np.cos(lat)), t)
    return dcm_en(lat, lon)


def _integral(values: NDArray, t: NDArray) -> NDArray:
    """Running integral of samples, fourth order."""
    slope = np.gradient(values, t)
    curve: PPoly = CubicHermiteSpline(t, values, slope)
    return curve.antiderivative()(t)
