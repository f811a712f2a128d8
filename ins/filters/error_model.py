"""Errors of a strapdown solution, linear, in a form that is regular and free of the specific force.

States are errors computed - true of a free-running navigation solution, NED, horizontal channels::

    w      velocity error against the true velocity resolved in the computed frame,
           w = dv - theta x v
    p      position error [m]
    theta  attitude error less the rotation that belongs to p ("drift angle", psi-angle)

With omega_ie, omega_en at the computed position, g down and eps = C_nb (gyro bias), del = C_nb
(accelerometer bias)::

    w'     = -theta x g - g p/R + del - (2 omega_ie + omega_en) x w
             + v x (omega_ie x theta) + v x eps
    p'     = w + theta x v - omega_en x p
    theta' = -(omega_ie + omega_en) x theta + eps

Derived from the psi-angle error equations (Benson 1975; Groves 2013, ch. 14) by w = dv - theta x v;
physics.md 6.2 and 6.5 are the parked and level-taxi cases. A heading error does not enter w: that
is the cancellation of 6.5, exact here by construction, and the measured velocity in body axes is
C_bn w.

Ground-vehicle nuisances ride along (the states from S on, CONVENTIONS.md). Of these, only the
accelerometer biases and the vertical gyro's scale drive w and theta. How the others enter a
measurement stands with the aids (`infield.session.navigated`).

Decision: docs/decisions/0006-error-state-w.md.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ins.filters.states import (
    ACCEL,
    BASE,
    CENTRE_LINE,
    CRAB_GUST,
    CRAB_TURN,
    GNSS_ARM,
    GNSS_DELAY,
    GNSS_SLOW_POS,
    GNSS_SLOW_VEL,
    GNSS_VELOCITY_DELAY,
    KAPPA,
    LATERAL,
    LEVER_X,
    ODOMETER,
    ODOMETER_DELAY,
    POS,
    SCALE_Z,
    SLIP,
    THETA,
    THETA_CLONE,
    THETA_START,
    WHEEL_Y,
    WIND,
    YAW,
    S,
    W,
)

__all__ = [
    "ACCEL",
    "BASE",
    "CENTRE_LINE",
    "CRAB_GUST",
    "CRAB_TURN",
    "GNSS_ARM",
    "GNSS_DELAY",
    "GNSS_SLOW_POS",
    "GNSS_SLOW_VEL",
    "GNSS_VELOCITY_DELAY",
    "KAPPA",
    "LATERAL",
    "LEVER_X",
    "ODOMETER",
    "ODOMETER_DELAY",
    "POS",
    "SCALE_Z",
    "SLIP",
    "THETA",
    "THETA_CLONE",
    "THETA_START",
    "WHEEL_Y",
    "WIND",
    "YAW",
    "ProcessNoise",
    "S",
    "Step",
    "W",
    "discretize",
    "system_matrix",
]


@dataclass(frozen=True)
class Step:
    """One filter step along the navigation solution: means over dt_s, except where named otherwise.

    Parameters
    ----------
    dt_s : float
    C_nb : ndarray, shape (3, 3)
    v_n, omega_ie_n, omega_en_n : ndarray, shape (3,)
        In m/s and rad/s, NED.
    gravity : float
        In m/s^2, positive down.
    radius_m : float
        Of the Earth at the place.
    turn_rad : float
        Rotation seen by the vertical gyro over the step, Earth rate included.
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
    """White-noise densities that drive the errors, SI.

    Parameters
    ----------
    arw : float
        Angle random walk [rad/sqrt(s)].
    vrw : float
        Velocity random walk [m/s/sqrt(s)].
    accel_rrw : float
        Rate random walk of the accelerometers [m/s^2/sqrt(s)].
    yaw_creep : float
        Of the parked heading [rad/sqrt(s)].
    lateral_rms, lateral_time_s : float
        RMS [m/s] and correlation time of the lateral velocity while rolling.
    """

    arw: float
    vrw: float
    accel_rrw: float
    yaw_creep: float
    lateral_rms: float
    lateral_time_s: float

    def values(self) -> NDArray:
        """The six densities in the order above, as the kernel takes them.

        Returns
        -------
        values : ndarray, shape (6,)
        """
        return np.array(
            [
                self.arw,
                self.vrw,
                self.accel_rrw,
                self.yaw_creep,
                self.lateral_rms,
                self.lateral_time_s,
            ]
        )


def system_matrix(step: Step, lateral_time_s: float) -> tuple[NDArray, NDArray]:
    """Continuous system of the base states: x' = F x + B (gyro bias).

    Parameters
    ----------
    step : Step
    lateral_time_s : float
        Correlation time of the lateral velocity.

    Returns
    -------
    F : ndarray, shape (39, 39)
    B : ndarray, shape (39, 3)
        From the gyro bias in body axes.
    """
    from ins.filters import error_kernel as fk

    A = np.zeros((fk.CORE, fk.CORE))
    fk.system_alone(_row(step), lateral_time_s, A)
    return _in_full(A, np.zeros((BASE, BASE)))


def discretize(
    step: Step, noise: ProcessNoise, *, rolling: bool, keep_displacement: bool = False
) -> tuple[NDArray, NDArray, NDArray]:
    """Transition, bias input and process noise of the base states over a step.

    Parameters
    ----------
    step : Step
    noise : ProcessNoise
    rolling : bool
        While not rolling the lateral velocity takes no part and is held at its stationary spread.
    keep_displacement : bool
        S goes on from the step before (a standing vehicle) instead of starting at zero.

    Returns
    -------
    Phi : ndarray, shape (39, 39)
    Gamma : ndarray, shape (39, 3)
        From the gyro bias in body axes.
    Q : ndarray, shape (39, 39)

    Notes
    -----
    Phi and Gamma are to third order in dt (largest remainder: theta into p, (omega_s dt)^2 / 12 =
    1.3e-5 of it at 10 s), Q is by Simpson's rule.
    """
    from ins.filters import error_kernel as fk

    square = np.zeros((6, fk.CORE, fk.CORE))
    Phi, Q_noisy = square[4], np.zeros((fk.NOISY, fk.NOISY))
    flags = np.array([0, rolling, keep_displacement, 0], dtype=np.int64)
    fk.transition_alone(
        _row(step),
        flags,
        noise.values(),
        square[0],
        square[1],
        square[2],
        square[3],
        Phi,
        np.zeros((fk.NOISY, fk.NOISY)),
        Q_noisy,
    )
    Phi_full, Gamma = _in_full(Phi, np.eye(BASE))
    at = np.array(fk.POSITIONS[: fk.NOISY])
    Q = np.zeros((BASE, BASE))
    Q[np.ix_(at, at)] = np.tril(Q_noisy) + np.tril(Q_noisy, -1).T
    Q[YAW, YAW] = noise.yaw_creep**2 * step.dt_s
    return Phi_full, Gamma, Q


def _in_full(core: NDArray, full: NDArray) -> tuple[NDArray, NDArray]:
    """The core states' matrix (16, 16) placed in the base states' (39, 39), and the part (39, 3) of
    the bias.
    """
    from ins.filters import error_kernel as fk

    at, bias = np.array(fk.POSITIONS), len(fk.POSITIONS)
    full[np.ix_(at, at)] = core[:bias, :bias]
    B = np.zeros((BASE, 3))
    B[at] = core[:bias, bias:]
    return full, B


def _row(step: Step) -> NDArray:
    """The step as `filter_kernel` takes it. The transport rate is given, not worked out from v_n:
    east and north rates over v_E and v_N, where there is a velocity.
    """
    v_n, (north, east, down) = step.v_n, step.omega_en_n
    over = [
        a / b if b != 0.0 else 0.0 for a, b in ((north, v_n[1]), (-east, v_n[0]), (-down, v_n[1]))
    ]
    parts = (
        [step.dt_s],
        np.ravel(step.C_nb),
        v_n,
        step.omega_ie_n,
        over,
        [step.gravity, step.radius_m, step.turn_rad],
    )
    return np.concatenate([*parts, np.zeros(3)]).astype(float)
