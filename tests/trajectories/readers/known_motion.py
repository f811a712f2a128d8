"""Motions whose truth is known by hand, for the readers' tests: what a perfect unit puts out, body
x forward, y right, z down.

Written from textbook formulas, sharing nothing with the readers: at rest f = -g down, w = Earth
rate, both turned to body.
"""

from dataclasses import dataclass

import numpy as np

EARTH_RATE = 7.292115e-5  # [rad/s]
LAT_DEG, LON_DEG, HEIGHT_M = 34.25, 108.9, 380.0
G = 9.79570  # [m/s^2], normal gravity there, within 1e-4
SITE = {"lat_deg": LAT_DEG, "lon_deg": LON_DEG, "height_m": HEIGHT_M}
GIVEN = {
    "imu_serial": "SN-1",
    "gyro_technology": "rlg",
    "start_utc": "2026-03-01T05:00:00Z",
    **SITE,
}
PLACELESS = {k: v for k, v in GIVEN.items() if k not in SITE}
# all different, so that no exchange of axes goes unseen
ROLL_DEG, PITCH_DEG, HEADING_DEG = 3.0, -2.0, 40.0
# Right, forward, up from forward, right, down and back: (x, y, z) -> (y, x, -z).
RFU = (1, 0, 2), np.array([1.0, 1.0, -1.0])


@dataclass(frozen=True)
class Output:
    """Increments (n, 3) over the interval that ends at time_s (n,)."""

    time_s: np.ndarray
    dtheta: np.ndarray
    dv: np.ndarray

    @property
    def rows(self) -> int:
        return self.time_s.size

    def rfu(self) -> tuple[np.ndarray, np.ndarray]:
        """The same in axes right, forward, up."""
        order, sign = RFU
        return self.dtheta[:, order] * sign, self.dv[:, order] * sign


def body_from_ned(roll_deg: float, pitch_deg: float, heading_deg: float) -> np.ndarray:
    """C_bn: about down by the heading, about right by the pitch, then about forward by the roll."""
    r, p, h = np.radians([roll_deg, pitch_deg, heading_deg])
    about_z = np.array([[np.cos(h), np.sin(h), 0], [-np.sin(h), np.cos(h), 0], [0, 0, 1]])
    about_y = np.array([[np.cos(p), 0, -np.sin(p)], [0, 1, 0], [np.sin(p), 0, np.cos(p)]])
    about_x = np.array([[1, 0, 0], [0, np.cos(r), np.sin(r)], [0, -np.sin(r), np.cos(r)]])
    return about_x @ about_y @ about_z


def at_rest(
    roll_deg=ROLL_DEG, pitch_deg=PITCH_DEG, heading_deg=HEADING_DEG
) -> tuple[np.ndarray, np.ndarray]:
    """w_b [rad/s] and f_b [m/s^2]."""
    C_bn, L = body_from_ned(roll_deg, pitch_deg, heading_deg), np.radians(LAT_DEG)
    return C_bn @ (EARTH_RATE * np.array([np.cos(L), 0, -np.sin(L)])), C_bn @ [0, 0, -G]


def parked(*, seconds=60.0, dt=0.01, start_s=0.0, **attitude) -> Output:
    w, f = at_rest(**attitude)
    n = round(seconds / dt)
    return Output(
        start_s + dt * np.arange(1, n + 1), np.tile(w * dt, (n, 1)), np.tile(f * dt, (n, 1))
    )


def parked_and_turned(*, dt=0.01, start_s=0.0) -> Output:
    """40 s level with heading 0, a right turn on the spot by 90 deg in 10 s, 10 s on heading 90."""
    n = round(60.0 / dt)
    time_s = dt * np.arange(1, n + 1)
    heading = np.clip(9.0 * (time_s - dt / 2 - 40.0), 0.0, 90.0)
    dtheta, dv = np.empty((n, 3)), np.empty((n, 3))
    for k in range(n):
        w, f = at_rest(0.0, 0.0, heading[k])
        dtheta[k], dv[k] = w * dt, f * dt
    turning = (time_s - dt / 2 > 40.0) & (time_s - dt / 2 < 50.0)
    dtheta[turning, 2] += np.radians(9.0) * dt
    return Output(start_s + time_s, dtheta, dv)


def check_parked(run, output: Output, **attitude) -> None:
    """Gravity and Earth rate on the body axes they belong on, row by row."""
    w, f = at_rest(**attitude)
    assert run.imu.rows == output.rows
    dt = run.imu.dt_s[:, None]
    np.testing.assert_allclose(run.imu.dtheta_rad / dt, np.tile(w, (output.rows, 1)), atol=1e-8)
    np.testing.assert_allclose(run.imu.dv_m_s / dt, np.tile(f, (output.rows, 1)), atol=1e-4)


def check_right_turn(run) -> None:
    """The turn of `parked_and_turned`: 90 deg about down, clockwise seen from above, nothing about
    the other axes.
    """
    turned = np.degrees(run.imu.between(39.999, 50.001).dtheta_rad.sum(axis=0))
    np.testing.assert_allclose(turned, [0, 0, 90], atol=0.1)
