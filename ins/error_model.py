"""Errors of a strapdown solution, linear, in a form that is regular and free of the specific force.

States are errors computed - true of a free-running navigation solution, NED, horizontal channels:

    w      velocity error against the true velocity resolved in the computed frame, w = dv - theta x v
    p      position error [m]
    theta  attitude error less the rotation that belongs to p ("drift angle", psi-angle)

With omega_ie, omega_en at the computed position, g down and eps = C_nb (gyro bias), del = C_nb (accelerometer bias):

    w'     = -theta x g - g p/R + del - (2 omega_ie + omega_en) x w + v x (omega_ie x theta) + v x eps
    p'     = w + theta x v - omega_en x p
    theta' = -(omega_ie + omega_en) x theta + eps

Derived from the psi-angle error equations (Benson 1975; Groves 2013, ch. 14) by w = dv - theta x v; physics.md 6.2
and 6.5 are the parked and level-taxi cases. A heading error does not enter w: that is the cancellation of 6.5, exact
here by construction, and the measured velocity in body axes is C_bn w.

Ground-vehicle nuisances ride along: displacement error S over the current step, or since the vehicle stopped, in body x, y,
accelerometer biases, crab ratio, lever arm along x, lateral velocity (Gauss-Markov), parked heading, odometer scale,
vertical-gyro scale factor, centre-line azimuth, and two clones of theta (at the start and at a time the caller chooses).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ins.attitude import skew

W = slice(0, 2)
POS = slice(2, 4)
THETA = slice(4, 7)
S = slice(7, 9)
ACCEL = slice(9, 11)
KAPPA = 11  # lateral over forward velocity at the no-slip point (-crab) [rad]
LEVER_X = 12  # error of the lever arm from the no-slip point to the IMU along body x [m]
LATERAL = 13  # lateral velocity of the vehicle beyond crab and lever arm [m/s]
YAW = 14  # parked heading less its nominal value [rad]
ODOMETER = 15  # odometer scale error, reads high [-]
SCALE_Z = 16  # vertical gyro scale factor error [-]
CENTRE_LINE = 17  # error of the surveyed centre-line azimuth [rad]
THETA_START = slice(18, 21)
THETA_CLONE = slice(21, 24)
BASE = 24  # gyro bias bins follow, three to a bin


@dataclass(frozen=True)
class Step:
    """One filter step along the navigation solution: means over dt_s, except where named otherwise.

    C_nb (3, 3), v_n (3,), omega_ie_n (3,), omega_en_n (3,); gravity [m/s^2]; radius [m];
    turn_rad: rotation seen by the vertical gyro over the step, Earth rate included.
    """

    dt_s: float
    C_nb: NDArray
    v_n: NDArray
    omega_ie_n: NDArray
    omega_en_n: NDArray
    gravity: float
    radius_m: float
    turn_rad: float


@dataclass(frozen=True)
class ProcessNoise:
    """White-noise densities driving the errors, SI: arw [rad/sqrt(s)], vrw [m/s/sqrt(s)],
    accel_rrw [m/s^2/sqrt(s)], yaw_creep [rad/sqrt(s)], lateral RMS [m/s] with its correlation time [s]."""

    arw: float
    vrw: float
    accel_rrw: float
    yaw_creep: float
    lateral_rms: float
    lateral_time_s: float


def system_matrix(step: Step, lateral_time_s: float) -> tuple[NDArray, NDArray]:
    """Continuous F (24, 24) of the base states and B (24, 3) from gyro bias in body axes."""
    F, B = np.zeros((BASE, BASE)), np.zeros((BASE, 3))
    C_nb, v = step.C_nb, step.v_n
    g, R = step.gravity, step.radius_m
    omega_w = 2 * step.omega_ie_n + step.omega_en_n
    V = skew(v)
    F[W, W] = -skew(omega_w)[:2, :2]
    F[W, POS] = -g / R * np.eye(2)
    F[W, THETA] = (skew([0.0, 0.0, g]) + V @ skew(step.omega_ie_n))[:2]
    F[W, ACCEL] = C_nb[:2, :2]
    F[POS, W] = np.eye(2)
    F[POS, POS] = -skew(step.omega_en_n)[:2, :2]
    F[POS, THETA] = -V[:2]
    F[THETA, THETA] = -skew(step.omega_ie_n + step.omega_en_n)
    F[S, W] = C_nb[:2, :2].T
    F[S.stop - 1, LATERAL] = 1.0
    F[LATERAL, LATERAL] = -1.0 / lateral_time_s
    B[THETA] = C_nb
    B[W] = (V @ C_nb)[:2]
    rate_z = step.turn_rad / step.dt_s
    F[:, SCALE_Z] = B[:, 2] * rate_z
    return F, B


def discretize(
    step: Step, noise: ProcessNoise, *, rolling: bool, keep_displacement: bool = False
) -> tuple[NDArray, NDArray, NDArray]:
    """Transition Phi (24, 24), bias input Gamma (24, 3), process noise Q (24, 24) over the step.

    Phi and Gamma to third order in dt (largest remainder: theta into p, (omega_s dt)^2 / 12 = 1.3e-5 of it at 10 s),
    Q by Simpson's rule.
    keep_displacement: S goes on from the step before (a standing vehicle) instead of starting at zero.
    While not rolling the lateral velocity takes no part and is held at its stationary spread.
    """
    F, B = system_matrix(step, noise.lateral_time_s)
    dt = step.dt_s
    A = np.zeros((BASE + 3, BASE + 3))
    A[:BASE, :BASE], A[:BASE, BASE:] = F, B
    half, full = _exponential(A * (0.5 * dt)), _exponential(A * dt)
    q = _density(step, noise, rolling)
    h, f = half[:BASE, :BASE], full[:BASE, :BASE]
    Q = dt / 6.0 * (q + 4.0 * h @ q @ h.T + f @ q @ f.T)
    Phi, Gamma = full[:BASE, :BASE].copy(), full[:BASE, BASE:]
    if not keep_displacement:
        Phi[:, S] = 0.0  # the displacement of a step starts at zero
    if not rolling:
        Phi[LATERAL, LATERAL] = 0.0
        Phi[S.stop - 1, LATERAL] = 0.0
        Q[LATERAL, LATERAL] = noise.lateral_rms**2
    return Phi, Gamma, Q


def _exponential(A: NDArray) -> NDArray:
    A2 = A @ A
    return np.eye(len(A)) + A + A2 / 2.0 + A2 @ A / 6.0


def _density(step: Step, noise: ProcessNoise, rolling: bool) -> NDArray:
    """Spectral density matrix (24, 24): gyro noise enters theta and, through v x C_nb, w."""
    G = np.zeros((BASE, 3))
    G[THETA] = step.C_nb
    G[W] = (skew(step.v_n) @ step.C_nb)[:2]
    q = noise.arw**2 * (G @ G.T)
    for index, value in ((W.start, noise.vrw), (W.start + 1, noise.vrw), (ACCEL.start, noise.accel_rrw),
                         (ACCEL.start + 1, noise.accel_rrw), (YAW, noise.yaw_creep)):  # fmt: skip
        q[index, index] += value**2
    if rolling:
        q[LATERAL, LATERAL] = 2.0 * noise.lateral_rms**2 / noise.lateral_time_s
    return q
