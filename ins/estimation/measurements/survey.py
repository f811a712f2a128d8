"""What was surveyed: the heading of a parked vehicle, the azimuth of a line that it rolls along.

With D the way along the line and A its azimuth, reading high by dA, what is computed is::

    heading      phi_D                                          for a level unit
    cross track  D phi_D + S across the line - D dA
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ins.attitude import wrap_pi
from ins.estimation.measurements.attitude import heading_error_row
from ins.estimation.states import CENTRE_LINE, S
from ins.estimation.tape import Measured, Row


def heading(
    heading_rad: NDArray,
    surveyed_rad: float,
    variance: ArrayLike,
    *,
    lat_rad: NDArray,
    radius_m: NDArray,
) -> Measured:
    """Computed less surveyed heading.

    Parameters
    ----------
    heading_rad : ndarray, shape (m,)
        Of the solution.
    surveyed_rad : float
    variance : array_like, () or (m,)
        Of the survey [rad^2].
    lat_rad, radius_m : ndarray, shape (m,)
        As of `attitude.error_rows`.

    Returns
    -------
    measured : Measured
        One row [rad] at m steps.

    Notes
    -----
    Left out: the tangent of the pitch times the level errors, 0.02 of them on a slope of 1 deg.
    """
    z = wrap_pi(heading_rad - surveyed_rad)
    return Measured([z], [heading_error_row(lat_rad, radius_m)], [variance])


def cross_track(
    way_n_m: NDArray,
    C_nb: NDArray,
    azimuth_rad: NDArray,
    variance: ArrayLike,
    *,
    lat_rad: NDArray,
    radius_m: NDArray,
) -> Measured:
    """Way of the solution across a surveyed line, over each step along it.

    Parameters
    ----------
    way_n_m : ndarray, shape (m, 3)
        NED.
    C_nb : ndarray, shape (m, 3, 3)
        Mean over each step.
    azimuth_rad : ndarray, shape (m,)
        Of the line, in the sense in which the vehicle rolls.
    variance : array_like, () or (m,)
        Of the vehicle's way across the line [m^2].
    lat_rad, radius_m : ndarray, shape (m,)
        As of `attitude.error_rows`.

    Returns
    -------
    measured : Measured
        One row [m] at m steps.
    """
    along = np.column_stack([np.cos(azimuth_rad), np.sin(azimuth_rad)])
    across = np.column_stack([-along[:, 1], along[:, 0]])
    D = np.einsum("ki,ki->k", along, way_n_m[:, :2])
    # the step's displacement error is in body axes
    across_b = np.einsum("ki,kij->kj", across, C_nb[:, :2, :2])
    row: Row = {
        **heading_error_row(lat_rad, radius_m, D),
        S.start: across_b[:, 0],
        S.start + 1: across_b[:, 1],
        CENTRE_LINE: -D,
    }
    return Measured([np.einsum("ki,ki->k", across, way_n_m[:, :2])], [row], [variance])
