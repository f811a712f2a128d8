"""Errors of a strapdown solution, linear, in a form that is regular and free of the specific force.

States are errors computed - true of a navigation solution, NED::

    w      velocity error against the true velocity resolved in the computed frame,
           w = dv - theta x v
    p      position error [m]
    theta  attitude error less the rotation that belongs to p ("drift angle", psi-angle)

With omega_ie, omega_en at the computed position, g down and eps = C_nb (gyro bias), del = C_nb
(accelerometer bias)::

    w'     = -theta x g + g/R (-p_N, -p_E, 2 p_D) + del - (2 omega_ie + omega_en) x w
             + v x (omega_ie x theta) + v x eps
    p'     = w + theta x v - omega_en x p
    theta' = -(omega_ie + omega_en) x theta + eps

The solution need not be a free one: where it is set anew, by d_v, d_p and the rotation vector
d_theta, its errors grow by as much (`Steps.shift`, w by d_v - d_theta x v). Where the height is
given (`Steps.level`), w_D and p_D are zero.

Derived from the psi-angle error equations (Benson 1975; Groves 2013, ch. 14) by w = dv - theta x v;
physics.md 6.2 and 6.5 are the parked and level-taxi cases. A heading error does not enter w: that
is the cancellation of 6.5, exact here by construction, and the measured velocity in body axes is
C_bn w.

Ground-vehicle nuisances ride along (the states from S on, CONVENTIONS.md). What a sensor
gets wrong drives w and theta (`Tape.drive`); how the others enter a measurement stands
with it (`ins.estimation.measurements`).

Decision: docs/decisions/0006-error-state-w.md.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ins.estimation.states import (
    ACCEL,
    ACCEL_Z,
    BASE,
    CENTRE_LINE,
    CORE,
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
    POS_DOWN,
    SCALE_Z,
    SLIP,
    THETA,
    THETA_CLONE,
    THETA_START,
    W_DOWN,
    WHEEL_Y,
    WIND,
    YAW,
    S,
    W,
)
from ins.estimation.tape import ACCELEROMETER, GYRO, INPUTS

__all__ = [
    "ACCEL",
    "ACCEL_Z",
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
    "POS_DOWN",
    "SCALE_Z",
    "SLIP",
    "THETA",
    "THETA_CLONE",
    "THETA_START",
    "WHEEL_Y",
    "WIND",
    "W_DOWN",
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
        """What drives the core, as the kernel takes it.

        Returns
        -------
        values : ndarray, shape (4,)
            arw, vrw, lateral_rms, lateral_time_s.
        """
        return np.array([self.arw, self.vrw, self.lateral_rms, self.lateral_time_s])

    def walks(self) -> dict[int, float]:
        """The base states that walk at random, and the variance that each gains in a second.

        Returns
        -------
        walks : dict of float
            By the numbers of the states.
        """
        level = range(ACCEL.start, ACCEL.stop)
        return {**dict.fromkeys(level, self.accel_rrw**2), YAW: self.yaw_creep**2}


def system_matrix(step: Step, lateral_time_s: float) -> tuple[NDArray, NDArray]:
    """Continuous system of the base states: x' = F x + B (wrong inputs).

    Parameters
    ----------
    step : Step
    lateral_time_s : float
        Correlation time of the lateral velocity.

    Returns
    -------
    F : ndarray, shape (42, 42)
    B : ndarray, shape (42, 9)
        From gyros and accelerometers in body axes, then accelerations north, east, down.
    """
    from ins.estimation import kernel

    A, B = np.zeros((CORE, CORE)), np.zeros((CORE, INPUTS))
    kernel.system_alone(_row(step), lateral_time_s, A, B)
    return _in_full(step, A, B, np.zeros((BASE, BASE)))


def discretize(
    step: Step,
    noise: ProcessNoise,
    *,
    rolling: bool,
    keep_displacement: bool = False,
    level: bool = True,
) -> tuple[NDArray, NDArray, NDArray]:
    """Transition, input and process noise of the base states over a step.

    Parameters
    ----------
    step : Step
    noise : ProcessNoise
    rolling : bool
        While not rolling the lateral velocity takes no part and is held at its stationary spread.
    keep_displacement : bool
        S goes on from the step before (a standing vehicle) instead of starting at zero.
    level : bool
        The height is given: what is down stands still and takes no part.

    Returns
    -------
    Phi : ndarray, shape (42, 42)
    Gamma : ndarray, shape (42, 9)
        From what the inputs are wrong by over the step, as of `system_matrix`.
    Q : ndarray, shape (42, 42)

    Notes
    -----
    Phi and Gamma are to third order in dt (largest remainder: theta into p, (omega_s dt)^2 / 12 =
    1.3e-5 of it at 10 s), Q is by Simpson's rule.
    """
    from ins.estimation import kernel

    Phi, Gamma = np.eye(CORE), np.zeros((CORE, INPUTS))
    Q = np.zeros((CORE, CORE))
    flags = np.array([0, rolling, keep_displacement, 0], dtype=np.int64)
    moves = moving(level)
    room = np.zeros((5, CORE, CORE))
    kernel.transition_alone(_row(step), flags, noise.values(), moves, room, Phi, Gamma, Q)
    Q = np.tril(Q) + np.tril(Q, -1).T
    Phi_full, Gamma_full = _in_full(step, Phi, Gamma, np.eye(BASE))
    Q_full = np.zeros((BASE, BASE))
    Q_full[:CORE, :CORE] = Q
    for state, density in noise.walks().items():
        added, column = density * step.dt_s, Phi_full[:CORE, state].copy()
        Q_full[:CORE, :CORE] += added / 3.0 * np.outer(column, column)
        Q_full[:CORE, state] += 0.5 * added * column
        Q_full[state, :CORE] += 0.5 * added * column
        Q_full[state, state] += added
    return Phi_full, Gamma_full, Q_full


def moving(level: bool, wheels: bool = True) -> NDArray:
    """Numbers of the core errors that take part.

    Parameters
    ----------
    level, wheels : bool
        As of `ins.estimation.tape.Steps`.

    Returns
    -------
    moves : ndarray of int64, shape (m,)
    """
    down = (W_DOWN, POS_DOWN) if level else ()
    on_wheels = () if wheels else (*range(S.start, S.stop), LATERAL)
    return np.setdiff1d(np.arange(CORE), [*down, *on_wheels])


def _in_full(step: Step, core: NDArray, inputs: NDArray, full: NDArray) -> tuple[NDArray, NDArray]:
    """The core's matrix (12, 12) placed in the base states' (42, 42), with what accelerometers and
    the vertical gyro's scale drive, and the inputs' part (42, 9).
    """
    full[:CORE, :CORE] = core
    for axis, state in enumerate((*range(ACCEL.start, ACCEL.stop), ACCEL_Z)):
        full[:CORE, state] = inputs[:, ACCELEROMETER + axis]
    full[:CORE, SCALE_Z] = inputs[:, GYRO + 2] * step.turn_rad / step.dt_s
    B = np.zeros((BASE, INPUTS))
    B[:CORE] = inputs
    return full, B


def _row(step: Step) -> NDArray:
    """The step as the kernel takes it. The transport rate is given, not worked out from v_n: east
    and north rates over v_E and v_N, where there is a velocity.
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
        [step.gravity, step.radius_m],
    )
    return np.concatenate([*parts, np.zeros(2)]).astype(float)
