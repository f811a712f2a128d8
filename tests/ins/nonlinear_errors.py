"""Errors of the nonlinear navigation, exactly: perturb a solution and read the states of
`ins.estimation.error_model` back.

Independent of the linear model: attitude and position errors are taken in the Earth frame, the
velocity error in body axes, so that theta, p and w need no small-angle formula.
"""

from dataclasses import dataclass, replace

import numpy as np

from ins.attitude import dcm_from_rotation_vector, rotation_vector_from_dcm
from ins.earth import (
    dcm_en,
    ecef_from_geodetic,
    geodetic_from_ecef,
    gravity_magnitude,
    omega_en_n,
    omega_ie_n,
    radii_of_curvature,
)
from ins.records import ImuLog, NavState, Site
from ins.strapdown.mechanization import navigate

STATES = (
    "w_N",
    "w_E",
    "w_D",
    "p_N",
    "p_E",
    "p_D",
    "theta_N",
    "theta_E",
    "theta_D",
    "accel_x",
    "accel_y",
    "accel_z",
    "scale_z",
    "gyro_x",
    "gyro_y",
    "gyro_z",
)


@dataclass(frozen=True)
class Errors:
    """Initial errors in NED (w, p, theta) and constant sensor errors in body axes, SI."""

    w: tuple = (0.0, 0.0, 0.0)
    p: tuple = (0.0, 0.0, 0.0)
    theta: tuple = (0.0, 0.0, 0.0)
    accel: tuple = (0.0, 0.0, 0.0)
    gyro: tuple = (0.0, 0.0, 0.0)
    scale_z: float = 0.0

    @classmethod
    def of(cls, state: str, size: float) -> "Errors":
        kind, _, axis = state.partition("_")
        if kind == "scale":
            return cls(scale_z=size)
        row = {"N": 0, "E": 1, "D": 2, "x": 0, "y": 1, "z": 2}[axis]
        return cls(**{kind: tuple(size * np.eye(3)[row])})


def perturbed_state(start: NavState, errors: Errors) -> NavState:
    """The start: C_eb turned by theta, position moved by p, body velocity moved by C_bn w."""
    C_en = dcm_en(start.site.lat_rad, start.site.lon_rad)
    r_e = (
        ecef_from_geodetic(start.site.lat_rad, start.site.lon_rad, start.site.height_m)
        + C_en @ errors.p
    )
    lat, lon, height = (float(a) for a in geodetic_from_ecef(r_e))
    C_eb = C_en @ dcm_from_rotation_vector(np.array(errors.theta)) @ start.C_nb
    C_nb = dcm_en(lat, lon).T @ C_eb
    v_b = start.C_nb.T @ (start.v_n_m_s + np.array(errors.w))
    site = Site(lat_rad=lat, lon_rad=lon, height_m=height)
    return NavState(time_s=start.time_s, site=site, v_n_m_s=C_nb @ v_b, C_nb=C_nb)


def perturbed_imu(imu: ImuLog, errors: Errors) -> ImuLog:
    dtheta = imu.dtheta_rad + np.array(errors.gyro) * imu.dt_s[:, None]
    dtheta[:, 2] += errors.scale_z * imu.dtheta_rad[:, 2]
    return replace(
        imu, dtheta_rad=dtheta, dv_m_s=imu.dv_m_s + np.array(errors.accel) * imu.dt_s[:, None]
    )


def error_states(true, computed, row: int = -1) -> np.ndarray:
    """[w (3), p (3), theta (3)] at a row of two histories, NED of the true one."""
    C_en, C_en_c = (dcm_en(h.lat_rad[row], h.lon_rad[row]) for h in (true, computed))
    r, r_c = (
        ecef_from_geodetic(h.lat_rad[row], h.lon_rad[row], h.height_m[row])
        for h in (true, computed)
    )
    turned = (C_en_c @ computed.C_nb[row]) @ (C_en @ true.C_nb[row]).T
    v_b, v_b_c = (h.C_nb[row].T @ h.v_n_m_s[row] for h in (true, computed))
    w = true.C_nb[row] @ (v_b_c - v_b)
    return np.concatenate([w, C_en.T @ (r_c - r), C_en.T @ rotation_vector_from_dcm(turned)])


def run_errors(
    imu: ImuLog, start: NavState, errors: Errors, *, epoch_s: float | None = None, vertical=None
):
    """The computed history of a perturbed run."""
    return navigate(
        perturbed_imu(imu, errors),
        perturbed_state(start, errors),
        epoch_s=epoch_s,
        vertical=vertical,
    )


def constant_imu(rate_b, force_b, *, duration_s: float, dt: float) -> ImuLog:
    n = round(duration_s / dt)
    return ImuLog(
        time_s=dt * np.arange(1, n + 1),
        dt_s=np.full(n, dt),
        dtheta_rad=np.tile(np.multiply(rate_b, dt), (n, 1)),
        dv_m_s=np.tile(np.multiply(force_b, dt), (n, 1)),
    )


def straight_roll(start: NavState, *, duration_s: float, dt: float = 0.1) -> ImuLog:
    """What a perfect unit reads at constant velocity and heading from `start`, level, midpoints of
    each interval.
    """
    n = round(duration_s / dt)
    lat0, height, v = start.site.lat_rad, start.site.height_m, start.v_n_m_s
    middle = dt * (np.arange(n) + 0.5)
    lat = lat0 + middle * v[0] / (radii_of_curvature(lat0)[0] + height)
    earth, transport = omega_ie_n(lat), omega_en_n(lat, height, np.tile(v, (n, 1)))
    gravity = gravity_magnitude(lat, height)[:, None] * [0.0, 0.0, 1.0]
    rate_b = (earth + transport) @ start.C_nb
    force_b = (np.cross(2 * earth + transport, v) - gravity) @ start.C_nb
    return ImuLog(
        time_s=dt * np.arange(1, n + 1),
        dt_s=np.full(n, dt),
        dtheta_rad=rate_b * dt,
        dv_m_s=force_b * dt,
    )
