"""A vehicle that stands: it stays at its place, and keeps its heading.

Zero velocity is measured as a way, what the solution moved since the stop::

    way      S + place of the vehicle beside the one at the stop
    turn     phi_D - phi_D at the stop + turn of the vehicle

(A zero mean velocity over each step says the same but counts the vehicle's jitter twice.) The
second and third term of the turn are one state, YAW. Source: Groves (2013), section 15.3, in the
errors of `ins.estimation.error_model`.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ins.attitude import rotation_vector_from_dcm
from ins.estimation.measurements.attitude import heading_error_row
from ins.estimation.states import YAW, S
from ins.estimation.tape import Measured, Row


def way_since_stop(displacement_b_m: NDArray, still: NDArray) -> NDArray:
    """What a solution moved since the last stop.

    Parameters
    ----------
    displacement_b_m : ndarray, shape (K, 3)
        Over each step.
    still : ndarray of bool, shape (K,)
        Of m steps the vehicle stands in.

    Returns
    -------
    way_b_m : ndarray, shape (m, 2)
        Body x and y, after each step at rest.
    """
    way = np.cumsum(np.where(still[:, None], displacement_b_m[:, :2], 0.0), axis=0)
    begins = still & ~np.append(False, still[:-1])
    before = np.vstack([np.zeros((1, 2)), way[:-1]])[begins]
    return np.asarray(way[still] - before[np.cumsum(begins)[still] - 1])


def place(way_b_m: NDArray, variance: NDArray, swing: Sequence[Row] = ({}, {})) -> Measured:
    """Way since the last stop, which is the solution's error.

    Parameters
    ----------
    way_b_m : ndarray, shape (m, 2)
        As of `way_since_stop`.
    variance : ndarray, shape (m,)
        Of the vehicle's jitter about its place [m^2].
    swing : sequence of dict
        Place of a vehicle that swings, body x and y: state, coefficient (m,).

    Returns
    -------
    measured : Measured
        Two rows [m] at m steps.
    """
    rows = [{S.start + axis: 1.0, **swing[axis]} for axis in range(2)]
    return Measured(way_b_m.T, rows, [variance, variance])


def heading(
    C_nb: NDArray, C_nb_stop: NDArray, variance: ArrayLike, *, lat_rad: NDArray, radius_m: NDArray
) -> Measured:
    """Computed turn about down since the stop.

    Parameters
    ----------
    C_nb, C_nb_stop : ndarray, shape (m, 3, 3)
        Of the solution, and as it was at the stop.
    variance : array_like, () or (m,)
        Of the vehicle's jitter in heading [rad^2].
    lat_rad, radius_m : ndarray, shape (m,)
        As of `attitude.error_rows`.

    Returns
    -------
    measured : Measured
        One row [rad] at m steps.
    """
    turn = rotation_vector_from_dcm(C_nb @ np.swapaxes(C_nb_stop, 1, 2))[:, 2]
    return Measured([turn], [{**heading_error_row(lat_rad, radius_m), YAW: 1.0}], [variance])
