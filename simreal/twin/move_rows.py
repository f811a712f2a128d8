"""What a moving stretch shows of the errors of its navigation solution: linear rows for `move_fit`.

Errors are computed - true. Per unknown: attitude at the start (3), gyro biases at K knots (3 K),
accelerometer biases (3 K), crab, odometer scale. Each block of rows says z = H x + noise, z being
computed less observed.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ins.attitude import dcm_from_euler, euler_from_dcm, rotation_vector_from_dcm, skew
from ins.earth import SEMI_MAJOR_AXIS_M, displacement_ned, omega_en_n, omega_ie_n
from ins.records import GnssLog, NavHistory, OdometerLog, Run, TwinModel
from ins.units import MILLIRADIAN

LATERAL_S = 2.0  # correlation of the side velocity (formats.md, section 3)
ROLLING_M_S = 1.0
STOP_SIGMA_M_S, LEAST_LATERAL_M_S = 3e-3, 3e-3
NODE_S = 1.0


@dataclass(frozen=True)
class Rows:
    """z (r,) = H (r, P) x + noise of sigma (r,)."""

    H: NDArray
    z: NDArray
    sigma: NDArray


@dataclass(frozen=True)
class Sensitivity:
    """Errors per unknown at nodes (m): phi (m, 3, P) [rad]; dv [m/s], dp [m], north and east, (m,
    2, P).

    at: rows of the history at the nodes.
    """

    history: NavHistory
    at: NDArray
    phi: NDArray
    dv: NDArray
    dp: NDArray

    @property
    def time_s(self) -> NDArray:
        return self.history.time_s[self.at]


def hats(time_s: NDArray, knots_s: NDArray) -> NDArray:
    """Straight lines between knots (K,) as weights (n, K); the ends are held."""
    place = np.interp(time_s, knots_s, np.arange(knots_s.size))
    return np.asarray(np.maximum(1.0 - np.abs(place[:, None] - np.arange(knots_s.size)), 0.0))


def sensitivity(history: NavHistory, knots_s: NDArray) -> Sensitivity:
    """The errors along a solution, step by step of about a second, for each unknown.

    phi' = -omega_in x phi + C_nb b_g - d omega_en,  dv' = phi x f + C_nb b_a - (2 omega_ie +
    omega_en) x dv,  dp' = dv; d omega_en = (dv_E, -dv_N, -dv_E tanL) / R. Level velocity and
    position only: the height is held or aided. Source: Groves (2013), eq. (14.63) without the terms
    of position in gravity and Earth rate.
    """
    t, K = history.time_s, knots_s.size
    every = max(round(NODE_S / np.median(np.diff(t))), 1)
    at = np.unique(np.append(np.arange(0, t.size, every), t.size - 1))
    dt = np.diff(t[at])
    A = _dynamics(history, at) * dt[:, None, None]
    Phi = np.eye(7) + A + 0.5 * A @ A
    turned = np.add.reduceat(history.C_nb_dt, at[:-1] + 1)
    into = np.zeros((dt.size, 7, 6))
    into[:, :3, :3], into[:, 3:5, 3:] = turned, turned[:, :2]
    into += 0.5 * A @ into
    weight = hats(t[at[:-1]] + 0.5 * dt, knots_s)
    X = np.zeros((at.size, 7, 3 + 6 * K + 2))
    X[0, :3, :3] = np.eye(3)
    for j, first in enumerate(np.argmax(weight > 0.0, axis=1).tolist()):
        X[j + 1] = Phi[j] @ X[j]
        for k in range(first, min(first + 2, K)):
            for unknown, columns in ((3 + 3 * k, slice(0, 3)), (3 + 3 * (K + k), slice(3, 6))):
                X[j + 1, :, unknown : unknown + 3] += weight[j, k] * into[j, :, columns]
    return Sensitivity(history, at, X[:, :3], X[:, 3:5], X[:, 5:])


def _dynamics(history: NavHistory, at: NDArray) -> NDArray:
    """Matrices (m - 1, 7, 7) of phi, dv_N, dv_E, dp_N, dp_E between the nodes."""
    rows, dt = at[:-1], np.diff(history.time_s[at])
    force = np.add.reduceat(history.dv_f_n_m_s, rows + 1) / dt[:, None]
    lat, height = history.lat_rad[rows], history.height_m[rows]
    earth, transport = omega_ie_n(lat), omega_en_n(lat, height, history.v_n_m_s[rows])
    radius = SEMI_MAJOR_AXIS_M + height
    A = np.zeros((dt.size, 7, 7))
    A[:, :3, :3] = -skew(earth + transport)
    A[:, 0, 4], A[:, 1, 3], A[:, 2, 4] = -1.0 / radius, 1.0 / radius, np.tan(lat) / radius
    A[:, 3:5, :3] = -skew(force)[:, :2]
    A[:, 3:5, 3:5] = -skew(2.0 * earth + transport)[:, :2, :2]
    A[:, 5, 3] = A[:, 6, 4] = 1.0
    return A


def stop_rows(s: Sensitivity, C_nb_stop: NDArray, sigma_tilt_rad: float) -> list[Rows]:
    """At the next stand: no velocity, and its level (C_nb_stop (3, 3), of which the heading is not
    used).
    """
    history = s.history
    rest = history.v_n_m_s[history.time_s > history.time_s[-1] - 2.0].mean(axis=0)
    roll, pitch, _ = euler_from_dcm(C_nb_stop)
    computed = history.C_nb[-1]
    level = dcm_from_euler(roll, pitch, euler_from_dcm(computed)[2])
    tilt = rotation_vector_from_dcm(computed @ level.T)[:2]
    return [
        Rows(s.dv[-1], rest[:2], np.full(2, STOP_SIGMA_M_S)),
        Rows(s.phi[-1, :2], tilt, np.full(2, sigma_tilt_rad)),
    ]


def wheel_velocity(history: NavHistory, lever_b_m: NDArray) -> NDArray:
    """Velocity of the wheel reference point in body axes at each epoch (n, 3): C_bn v + omega x
    lever.
    """
    dt = np.diff(history.time_s, prepend=history.time_s[0] - 1.0)
    spin = history.dtheta_b_rad / dt[:, None]
    return np.einsum("nji,nj->ni", history.C_nb, history.v_n_m_s) + np.cross(spin, lever_b_m)


def wheel_rows(s: Sensitivity, run: Run, twin: TwinModel, on_wheels: NDArray) -> list[Rows]:
    """No side slip but the twin's crab (what is beyond it is an unknown) and side noise; the
    odometer along body x.

    on_wheels (n,): epochs of the history on the ground.
    """
    v_b = wheel_velocity(s.history, np.asarray(run.header.wheel_reference_m, dtype=float))[s.at]
    rolls = np.flatnonzero(on_wheels[s.at] & (np.abs(v_b[:, 0]) > ROLLING_M_S))
    if not rolls.size:
        return []
    side = _body_row(s, rolls, 1)
    side[:, -2] = -v_b[rolls, 0]
    slip = v_b[rolls, 1] + v_b[rolls, 0] * np.tan(twin.vehicle.crab_mrad * MILLIRADIAN)
    white = max(twin.vehicle.lateral_noise_m_s, LEAST_LATERAL_M_S) * np.sqrt(
        2.0 * LATERAL_S / NODE_S
    )
    rows = [Rows(side, slip, np.full(rolls.size, white))]
    if run.odometer is not None:
        rows += _odometer_rows(s, rolls, v_b[rolls, 0], run.odometer, twin)
    return rows


def _odometer_rows(
    s: Sensitivity, rolls: NDArray, v_x: NDArray, log: OdometerLog, twin: TwinModel
) -> list[Rows]:
    nearest = np.clip(np.searchsorted(log.time_s, s.time_s[rolls]), 1, log.time_s.size - 1)
    near = (np.abs(log.time_s[nearest] - s.time_s[rolls]) < NODE_S) & (
        np.diff(log.time_s)[nearest - 1] < 2 * NODE_S
    )
    speed = np.interp(s.time_s[rolls[near]], log.time_s, log.speed_m_s)
    along = _body_row(s, rolls[near], 0)
    along[:, -1] = -speed
    # braking between two samples
    sigma = np.hypot(twin.odometer.noise_m_s, twin.vehicle.sway_m_s) + 5e-3
    return [Rows(along, v_x[near] - speed, np.full(speed.size, sigma))]


def gnss_rows(s: Sensitivity, gnss: GnssLog, lever_b_m: NDArray, twin: TwinModel) -> list[Rows]:
    """North and east velocity and position of the antenna at the fixes within the stretch."""
    history, nodes = s.history, s.time_s
    fixes = np.flatnonzero((gnss.time_s > nodes[0]) & (gnss.time_s < nodes[-1]))
    if not fixes.size:
        return []
    t = gnss.time_s[fixes]
    spot = np.clip(np.searchsorted(history.time_s, t), 1, history.time_s.size - 1)
    arm_n = history.C_nb[spot] @ lever_b_m
    dt = history.time_s[spot] - history.time_s[spot - 1]
    swing = np.einsum(
        "nij,nj->ni",
        history.C_nb[spot],
        np.cross(history.dtheta_b_rad[spot] / dt[:, None], lever_b_m),
    )
    v_n = np.stack([np.interp(t, history.time_s, v) for v in history.v_n_m_s.T], axis=1) + swing
    lat, lon = (
        np.interp(t, history.time_s, x) for x in (history.lat_rad, np.unwrap(history.lon_rad))
    )
    way = displacement_ned(
        gnss.lat_rad[fixes],
        gnss.lon_rad[fixes],
        lat0_rad=lat,
        lon0_rad=lon,
        height0_m=history.height_m[spot],
    )
    j = np.clip(np.searchsorted(nodes, t) - 1, 0, nodes.size - 2)
    a = ((t - nodes[j]) / (nodes[j + 1] - nodes[j]))[:, None]
    sigma_v = _sigma(gnss.sigma_velocity_m_s, fixes, twin.gnss.sigma_velocity_m_s)
    sigma_p = _sigma(gnss.sigma_horizontal_m, fixes, twin.gnss.sigma_horizontal_m)
    return [
        Rows((1 - a) * values[j, axis] + a * values[j + 1, axis], z[:, axis], sigma)
        for axis in range(2)
        for values, z, sigma in (
            (s.dv, v_n - gnss.v_n_m_s[fixes], sigma_v),
            (s.dp, arm_n[:, :2] - way[:, :2], sigma_p),
        )
    ]


def _sigma(logged: NDArray | None, fixes: NDArray, declared: float) -> NDArray:
    """The larger of what the receiver says and the twin declares; the twin's where it says
    nothing.
    """
    if logged is None:
        return np.full(fixes.size, declared)
    return np.fmax(np.where(logged[fixes] > 0, logged[fixes], np.nan), declared)


def _body_row(s: Sensitivity, at: NDArray, axis: int) -> NDArray:
    """Rows (r, P) of the velocity along a body axis: C_bn (dv - phi x v)."""
    e, v = s.history.C_nb[s.at[at]][:, :, axis], s.history.v_n_m_s[s.at[at]]
    return np.einsum("mi,mip->mp", e[:, :2], s.dv[at]) + np.einsum(
        "mi,mip->mp", np.cross(e, v), s.phi[at]
    )
