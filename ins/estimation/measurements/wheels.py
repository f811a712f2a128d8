"""Wheels that do not slip sideways: the way of their no-slip point over a step.

With d the computed way of that point (body axes), omega the turn rate about down, dt the step, l_x
and l_y how much longer than declared the arm from the point to the unit is, what is computed less
what the wheels say is::

    lateral   d_y = S_y + l_x omega dt + d_x (kappa + wind across the body + kappa_t + kappa_g
              + c omega d_x / dt)
    forward   d_x - way = S_x - l_y omega dt - s way + tau_w (change of speed)

The side slip c is by the lateral acceleration omega d_x / dt. A state that a caller leaves at zero
takes no part. Source: Groves (2013), section 15.4, in the errors of `ins.estimation.error_model`
(physics.md 6.5).
"""

from dataclasses import dataclass

from numpy.typing import ArrayLike, NDArray

from ins.estimation import states
from ins.estimation.tape import Measured, Row


@dataclass(frozen=True)
class PointWay:
    """Way of a point of the body over m steps, as a solution has it.

    Parameters
    ----------
    way_b_m : ndarray, shape (m, 3)
    turn_rad : ndarray, shape (m,)
        Change of heading.
    dt_s : ndarray, shape (m,)
    C_nb : ndarray, shape (m, 3, 3)
        Mean over each step.
    """

    way_b_m: NDArray
    turn_rad: NDArray
    dt_s: NDArray
    C_nb: NDArray


def lateral(way: PointWay, variance: ArrayLike) -> Measured:
    """Way of the no-slip point to the side.

    Parameters
    ----------
    way : PointWay
        Of the no-slip point, as declared.
    variance : array_like, () or (m,)
        Of the way that sway makes [m^2].

    Returns
    -------
    measured : Measured
        One row [m] at m steps.
    """
    forward = way.way_b_m[:, 0]
    row: Row = {
        states.S.start + 1: 1.0,
        states.KAPPA: forward,
        states.LEVER_X: way.turn_rad,
        states.WIND.start: forward * way.C_nb[:, 0, 1],
        states.WIND.start + 1: forward * way.C_nb[:, 1, 1],
        states.CRAB_TURN: forward,
        states.CRAB_GUST: forward,
        states.SLIP: forward * (forward / way.dt_s) * (way.turn_rad / way.dt_s),
    }
    return Measured([way.way_b_m[:, 1]], [row], [variance])


def forward(way: PointWay, rolled_m: NDArray, faster_m_s: NDArray, variance: ArrayLike) -> Measured:
    """Way of the no-slip point forward less the way by the odometer.

    Parameters
    ----------
    way : PointWay
        Of the no-slip point, as declared.
    rolled_m, faster_m_s : ndarray, shape (m,)
        Way by the odometer over each step, and by how much it is faster at the end of the step.
    variance : array_like, () or (m,)
        Of the odometer's way and of the way that sway makes [m^2].

    Returns
    -------
    measured : Measured
        One row [m] at m steps.
    """
    row: Row = {
        states.S.start: 1.0,
        states.ODOMETER: -rolled_m,
        states.WHEEL_Y: -way.turn_rad,
        states.ODOMETER_DELAY: faster_m_s,
    }
    return Measured([way.way_b_m[:, 0] - rolled_m], [row], [variance])
