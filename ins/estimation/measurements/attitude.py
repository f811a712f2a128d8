"""The attitude error phi of a solution in the states of the filter.

phi is theta and the rotation that belongs to the position error p, on a sphere of radius R at
latitude L (physics.md 6.2)::

    phi_N = theta_N - p_E / R,   phi_E = theta_E + p_N / R,   phi_D = theta_D + p_E tanL / R
"""

import numpy as np
from numpy.typing import ArrayLike

from ins.estimation.states import POS, THETA


def error_rows(lat_rad: ArrayLike, radius_m: ArrayLike) -> list[dict[int, ArrayLike]]:
    """Rows of phi.

    Parameters
    ----------
    lat_rad, radius_m : array_like, () or (m,)
        Latitude; distance from the centre of the Earth's sphere.

    Returns
    -------
    rows : list of dict
        State: coefficient () or (m,), of phi north, east and down.
    """
    north, east, down = range(THETA.start, THETA.stop)
    p_north, p_east = range(POS.start, POS.stop)
    of_p = 1.0 / np.asarray(radius_m, dtype=float)
    return [
        {north: 1.0, p_east: -of_p},
        {east: 1.0, p_north: of_p},
        {down: 1.0, p_east: np.tan(lat_rad) * of_p},
    ]


def heading_error_row(
    lat_rad: ArrayLike, radius_m: ArrayLike, scale: ArrayLike = 1.0
) -> dict[int, ArrayLike]:
    """The heading error of a solution, times a number.

    Parameters
    ----------
    lat_rad, radius_m : array_like, () or (m,)
        As of `error_rows`.
    scale : array_like, () or (m,)

    Returns
    -------
    row : dict
        State: coefficient () or (m,).
    """
    return {
        state: np.multiply(scale, of_phi)
        for state, of_phi in error_rows(lat_rad, radius_m)[2].items()
    }
