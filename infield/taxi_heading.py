"""What a rolling vehicle shows of heading and gyro bias: aids for the navigation-mode filter.

Without an outside reference the body-lateral velocity of a straight taxi does not show a heading error: the filter's
velocity error w is taken against the true velocity in the computed frame, and the lateral row has no heading in it
(physics.md 6.5). Heading becomes visible after a turn, at a stop on another heading, or against GNSS, a surveyed
heading or a centre line. Cross-track position enters as the displacement over each step (US 5,574,650).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from alignment.navigation_filter import StepView, heading_error_row
from alignment.stillness import ROLLING
from ins import error_model as em
from ins.attitude import euler_from_dcm, wrap_pi
from ins.earth import displacement_ned, radii_of_curvature
from ins.error_filter import ErrorFilter
from ins.records import GnssLog, OdometerLog
from ins.units import DEG

LATERAL_FLOOR_M = 5e-4  # displacement noise of a step beyond crab, lever arm and lateral motion
CENTRE_LINE_WANDER_M = 0.01  # per square root of a second about the painted line, beyond side motion: 0.2 m in 5 min
TURN_CHANGE = 0.6  # how far the turn rate at a fix may be from the step's mean, as a share of it (entering a turn)
CENTRE_LINE_NEAR_RAD = 5 * DEG
CENTRE_LINE_TURN_RAD_S = 0.01


@dataclass
class LateralAid:
    """No side slip at the wheels: the lateral displacement is crab, lever arm and a bounded transient.

    wheel_reference_m: from the IMU to the no-slip point, body axes.
    """

    wheel_reference_m: tuple[float, float, float]
    always: bool = False

    def measure(self, flt: ErrorFilter, view: StepView) -> None:
        lever_x = -self.wheel_reference_m[0]  # from the no-slip point to the IMU
        forward, turn = view.displacement_b_m[0], view.heading_change_rad
        z = np.array([view.displacement_b_m[1] - lever_x * turn])
        H = flt.row({em.S.start + 1: 1.0, em.KAPPA: forward, em.LEVER_X: turn})
        flt.measure("lateral", z, H[None], np.array([[_way_variance(view)]]), view.end_s)


@dataclass
class OdometerAid:
    """Way along body x by the wheels, with a scale error as a state."""

    log: OdometerLog
    noise_m_s: float
    wheel_reference_m: tuple[float, float, float]
    always: bool = False

    def measure(self, flt: ErrorFilter, view: StepView) -> None:
        inside = (self.log.time_s > view.start_s) & (self.log.time_s < view.end_s)
        edges = np.array([view.start_s, view.end_s])
        if edges[0] < self.log.time_s[0] or edges[1] > self.log.time_s[-1] or not np.any(inside):
            return
        t = np.concatenate((edges[:1], self.log.time_s[inside], edges[1:]))
        way = float(np.trapezoid(np.interp(t, self.log.time_s, self.log.speed_m_s), t))
        lever_y = -self.wheel_reference_m[1]
        z = np.array([view.displacement_b_m[0] - way + view.heading_change_rad * lever_y])
        H = flt.row({em.S.start: 1.0, em.ODOMETER: -way})
        wheels = self.noise_m_s * view.step.dt_s / np.sqrt(inside.sum())
        flt.measure("odometer", z, H[None], np.array([[wheels**2 + _way_variance(view)]]), view.end_s)


@dataclass
class GnssAid:
    """Satellite position and velocity; while parked one fix a step is used."""

    log: GnssLog
    lever_arm_m: tuple[float, float, float]
    sigma_horizontal_m: float
    sigma_velocity_m_s: float
    always: bool = True

    def measure(self, flt: ErrorFilter, view: StepView) -> None:
        a, b = np.searchsorted(self.log.time_s, [view.start_s + 1e-9, view.end_s + 1e-9])
        for k in range(max(a, b - 2) if view.kind == ROLLING else max(a, b - 1), b):
            self._fix(flt, view, k)

    def _fix(self, flt: ErrorFilter, view: StepView, k: int) -> None:
        ago = view.end_s - float(self.log.time_s[k])
        arm_n = view.C_nb @ np.asarray(self.lever_arm_m)
        spin_n = np.array([0.0, 0.0, view.heading_change_rad / view.step.dt_s])
        acceleration = (view.v_n - view.v_start_n) / view.step.dt_s
        v_n = view.v_n - ago * acceleration
        z_v = (v_n + np.cross(spin_n, arm_n) - self.log.v_n_m_s[k])[:2]
        way = displacement_ned(
            self.log.lat_rad[k], self.log.lon_rad[k],
            lat0_rad=view.lat_rad, lon0_rad=view.lon_rad, height0_m=view.height_m,
        )  # fmt: skip
        z_p = arm_n[:2] - ago * (v_n[:2] + 0.5 * ago * acceleration[:2]) - way
        flt.measure("gnss", z_p, _rows(flt, {em.POS.start: 1.0}, {em.POS.start + 1: 1.0}),
                    np.eye(2) * self._sigma(self.log.sigma_horizontal_m, k, self.sigma_horizontal_m) ** 2,
                    view.end_s)  # fmt: skip
        sigma_v = self._sigma(self.log.sigma_velocity_m_s, k, self.sigma_velocity_m_s)
        sigma_arm = TURN_CHANGE * np.linalg.norm(np.cross(spin_n, arm_n))
        flt.measure("gnss", z_v, _velocity_rows(flt, view, v_n), np.eye(2) * (sigma_v**2 + sigma_arm**2), view.end_s)

    @staticmethod
    def _sigma(logged: NDArray | None, k: int, declared: float) -> float:
        return float(logged[k]) if logged is not None and np.isfinite(logged[k]) and logged[k] > 0 else declared


@dataclass
class SurveyedHeadingAid:
    """A surveyed parked heading, used once: in the standing step that holds the time `at_s`."""

    heading_rad: float
    sigma_rad: float
    at_s: float
    always: bool = True

    def measure(self, flt: ErrorFilter, view: StepView) -> None:
        if view.kind == ROLLING or not view.start_s < self.at_s <= view.end_s:
            return
        z = wrap_pi(euler_from_dcm(view.C_nb)[2] - self.heading_rad)
        R = np.array([[self.sigma_rad**2]])
        flt.measure("survey", np.atleast_1d(z), heading_error_row(flt, view)[None], R, view.end_s)


@dataclass
class CentreLineAid:
    """A surveyed centre line that the taxi follows: cross-track displacement against its azimuth."""

    azimuth_rad: float
    always: bool = False

    def measure(self, flt: ErrorFilter, view: StepView) -> None:
        heading = euler_from_dcm(view.C_nb)[2]
        off = wrap_pi(heading - self.azimuth_rad)
        backward = abs(off) > np.pi / 2
        chi = self.azimuth_rad + (np.pi if backward else 0.0)
        turning = abs(view.heading_change_rad) > CENTRE_LINE_TURN_RAD_S * view.step.dt_s
        if turning or abs(wrap_pi(heading - chi)) > CENTRE_LINE_NEAR_RAD:
            return
        along, cross = np.array([np.cos(chi), np.sin(chi)]), np.array([-np.sin(chi), np.cos(chi)])
        way_n = view.displacement_n_m[:2]
        D = float(along @ way_n)
        body = cross @ view.step.C_nb[:2, :2]  # the step's displacement error lives in body axes
        H = D * heading_error_row(flt, view)
        H[em.S] += body
        H[em.CENTRE_LINE] = -D
        R = np.array([[CENTRE_LINE_WANDER_M**2 * view.step.dt_s]])
        flt.measure("centre line", np.array([float(cross @ way_n)]), H[None], R, view.end_s)


def _way_variance(view: StepView) -> float:
    """Variance of a step's way by sway, which the wheels do not see: the vehicle's jitter at both ends [m^2]."""
    return LATERAL_FLOOR_M**2 + 2.0 * view.jitter_m**2


def _rows(flt: ErrorFilter, *entries: dict[int, float]) -> NDArray:
    return np.stack([flt.row(e) for e in entries])


def _velocity_rows(flt: ErrorFilter, view: StepView, v_n: NDArray) -> NDArray:
    """Rows of computed less true velocity in NED: w + phi x v, phi = theta + position part."""
    H = _rows(flt, {em.W.start: 1.0}, {em.W.start + 1: 1.0})
    cross_v = -np.array([[0.0, -v_n[2], v_n[1]], [v_n[2], 0.0, -v_n[0]]])  # (phi x v) = -v x phi
    meridian, transverse = radii_of_curvature(view.lat_rad)
    radius = 0.5 * float(meridian + transverse) + view.height_m
    phi_of_p = np.array([[0.0, -1.0 / radius], [1.0 / radius, 0.0], [0.0, np.tan(view.lat_rad) / radius]])
    H[:, em.THETA] += cross_v
    H[:, em.POS] += cross_v @ phi_of_p
    return H


def heading_source(gains: dict[str, float]) -> str | None:
    """Which evidence found the heading error: formats.md words, `combined` where no one kind gave 80 %."""
    words = {"lateral": "turns", "stop": "stops", "odometer": "odometer", "gnss": "gnss", "survey": "survey",
             "centre line": "survey"}  # fmt: skip
    total: dict[str, float] = {}
    for kind, gain in gains.items():
        if kind in words and gain > 0:
            total[words[kind]] = total.get(words[kind], 0.0) + gain
    if not total:
        return None
    best = max(total, key=lambda k: total[k])
    return best if total[best] >= 0.8 * sum(total.values()) else "combined"
