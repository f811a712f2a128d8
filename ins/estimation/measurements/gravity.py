"""What gravity and the Earth's rotation make a unit read that stands."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ins.attitude import skew
from ins.earth import gravity_magnitude, omega_ie_n


@dataclass(frozen=True)
class RestReadings:
    """Expected readings at rest, body axes, and how they grow with what they are computed from.

    Parameters
    ----------
    rate, force : ndarray, shape (3,)
        Of gyros [rad/s] and accelerometers [m/s^2].
    rate_of_phi, force_of_phi : ndarray, shape (3, 3)
        With the error phi of the attitude, computed - true, NED.
    rate_of_latitude : ndarray, shape (3,)
        With the latitude.
    """

    rate: NDArray
    force: NDArray
    rate_of_phi: NDArray
    force_of_phi: NDArray
    rate_of_latitude: NDArray


def rest_readings(C_nb: NDArray, *, lat_rad: float, height_m: float) -> RestReadings:
    """The readings of perfect sensors at rest.

    Parameters
    ----------
    C_nb : ndarray, shape (3, 3)
    lat_rad, height_m : float

    Returns
    -------
    readings : RestReadings

    Notes
    -----
    With C_computed = (I + [phi x]) C_true, a vector u is computed as C_bn (u + u x phi). Source:
    Groves (2013), section 5.6.
    """
    omega_n = omega_ie_n(lat_rad)
    force_n = np.array([0.0, 0.0, -float(gravity_magnitude(lat_rad, height_m))])
    with_latitude_n = np.array([omega_n[2], 0.0, -omega_n[0]])
    return RestReadings(
        rate=C_nb.T @ omega_n,
        force=C_nb.T @ force_n,
        rate_of_phi=C_nb.T @ skew(omega_n),
        force_of_phi=C_nb.T @ skew(force_n),
        rate_of_latitude=C_nb.T @ with_latitude_n,
    )
