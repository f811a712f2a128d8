"""Satellite fixes: position and velocity of an antenna on its arm, against a solution.

With phi = theta + the rotation that belongs to p, l the arm and omega the turn rate, what is
computed less what is measured is::

    position   p + phi x C l - C dl + (v + C (omega x l)) dt - slow error
    velocity   w + phi x (v + C (omega x l)) - C (omega x dl) + a dt - slow error

dl and dt: how much more than declared arm and delay are; a: acceleration of the antenna. What was
found of them before stands in the antenna that a fix is compared with, and goes back into z, so
that their states stay about the declared ones. Source: Groves (2013), eqs. (14.102) to (14.111), in
the errors of `ins.estimation.error_model`.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ins.attitude import skew
from ins.earth import SEMI_MAJOR_AXIS_M, displacement_ned
from ins.estimation import states
from ins.estimation.measurements.antenna import Antenna, AntennaMotion
from ins.estimation.measurements.attitude import error_rows

Rows = list[dict[int, ArrayLike]]  # of each component: state, coefficient


@dataclass(frozen=True)
class ReceiverStates:
    """Where in the filter stands what a receiver may have wrong; empty where it is not estimated.

    Parameters
    ----------
    arm : sequence of int
        Lever arm, body x, y, z or x, y [m].
    delay, velocity_delay : sequence of int
        One each [s].
    slow_position, slow_velocity : sequence of int
        Slow errors north, east, down or level [m], [m/s].
    """

    arm: Sequence[int] = ()
    delay: Sequence[int] = ()
    velocity_delay: Sequence[int] = ()
    slow_position: Sequence[int] = ()
    slow_velocity: Sequence[int] = ()


def position(
    motion: AntennaMotion,
    antenna: Antenna,
    fixes: tuple[NDArray, NDArray, NDArray],
    of: ReceiverStates,
    *,
    level: bool = True,
) -> tuple[NDArray, Rows]:
    """Computed less measured position of the antenna.

    Parameters
    ----------
    motion : AntennaMotion
        When the fixes were measured, the antenna's delay taken off their stamps.
    antenna : Antenna
    fixes : tuple of ndarray, shape (m,)
        Latitude, longitude [rad] and height [m].
    of : ReceiverStates
    level : bool
        North and east alone.

    Returns
    -------
    z : ndarray, shape (2, m) or (3, m) [m]
    rows : list of dict
        State: coefficient (m,), of each component.
    """
    lat, lon, height = motion.place.T
    way = displacement_ned(fixes[0], fixes[1], lat0_rad=lat, lon0_rad=lon, height0_m=height)
    way_n = np.column_stack([way, height - fixes[2]])
    arm_n = motion.C_nb @ antenna.arm_m
    of_arm, of_delay = -motion.C_nb, motion.v_n + motion.swing_n(antenna.arm_m)
    z = arm_n - way_n + of_arm @ antenna.found_m + of_delay * antenna.delay_s
    rows: Rows = [{state: 1.0} for state in (*_range(states.POS), states.POS_DOWN)]
    _add_attitude(rows, -skew(arm_n), motion.place)
    _add(rows, of.arm, of_arm)
    _add(rows, of.delay, of_delay[:, :, None])
    _add_own(rows, of.slow_position)
    return _components(z, rows, level)


def velocity(
    motion: AntennaMotion,
    antenna: Antenna,
    v_n_m_s: NDArray,
    of: ReceiverStates,
    *,
    about_n: NDArray,
    level: bool = True,
) -> tuple[NDArray, Rows]:
    """Computed less measured velocity of the antenna.

    Parameters
    ----------
    motion : AntennaMotion
        When the velocities were measured.
    antenna : Antenna
    v_n_m_s : ndarray, shape (m, 3)
        As measured.
    of : ReceiverStates
    about_n : ndarray, shape (m, 3)
        Velocity of the antenna that the rows are linearised about; zero of a vehicle that is known
        to stand. With the computed velocity, drifted by 0.1 m/s, a parked unit would claim to see
        its heading (at 75 deg the east gyro's sigma came out 10 % below the Cramer-Rao bound).
    level : bool
        North and east alone.

    Returns
    -------
    z : ndarray, shape (2, m) or (3, m) [m/s]
    rows : list of dict
        State: coefficient (m,), of each component.
    """
    swing_n = motion.swing_n(antenna.arm_m)
    of_arm, of_delay = -(motion.C_nb @ skew(motion.rate_b)), motion.acceleration_n
    z = motion.v_n + swing_n - v_n_m_s
    z = z + np.einsum("kij,j->ki", of_arm, antenna.found_m) + of_delay * antenna.velocity_delay_s
    rows: Rows = [{state: 1.0} for state in (*_range(states.W), states.W_DOWN)]
    _add_attitude(rows, -skew(about_n), motion.place)
    _add(rows, of.arm, of_arm)
    _add(rows, of.velocity_delay, of_delay[:, :, None])
    _add_own(rows, of.slow_velocity)
    return _components(z, rows, level)


def _components(z: NDArray, rows: Rows, level: bool) -> tuple[NDArray, Rows]:
    """The level components, or all; what is down has no error where the height is given."""
    if not level:
        return z.T, rows
    return z[:, :2].T, rows[:2]


def _add_attitude(rows: Rows, of_phi: NDArray, place: NDArray) -> None:
    """Add what attitude errors phi do to the rows, in place; of_phi (m, rows, 3)."""
    phi = error_rows(place[:, 0], SEMI_MAJOR_AXIS_M + place[:, 2])
    for i, row in enumerate(rows):
        for component, of_phi_i in zip(phi, of_phi[:, i].T):
            for state, coefficient in component.items():
                row[state] = row.get(state, 0.0) + of_phi_i * coefficient


def _add(rows: Rows, places: Sequence[int], of: NDArray) -> None:
    """Add states to rows in place; of (m, rows, states): their coefficients."""
    for i, row in enumerate(rows):
        for k, state in enumerate(places):
            row[state] = of[:, i, k]


def _add_own(rows: Rows, places: Sequence[int]) -> None:
    """Add to each row in place the state of its own component: what a fix reads too much."""
    for row, state in zip(rows, places):
        row[state] = -1.0


def _range(where: slice) -> range:
    return range(where.start, where.stop)
