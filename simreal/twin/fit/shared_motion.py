"""What gyros and accelerometers share at rest is the vehicle's motion, not the gyros' noise.

A vehicle that tilts turns gravity in the body: d(up)/dt = -omega x up. So the part of a level gyro
that the accelerometers tell, at whatever ratio of turning to swinging the vehicle's gear has, is
the vehicle's; what they do not tell is the gyro's. Nothing beside the gyro itself witnesses a turn
about the vertical.
"""

import numpy as np
from numpy.typing import NDArray

# complex values of a band: of 12 the three accelerometers cost a quarter
FEWEST_DOF = 12.0
# of a band: where the vehicle makes more than 0.5, a tenth of it left in is 10 % of the gyro
MOSTLY_SHARED = 0.5


def own_power(
    gyro: NDArray, accel: NDArray, band: NDArray, dof: NDArray
) -> tuple[NDArray, NDArray, NDArray]:
    """Power of a level gyro that the accelerometers do not tell.

    Parameters
    ----------
    gyro : ndarray, shape (w, m)
        Transforms of windows and bins.
    accel : ndarray, shape (w, m, 3)
    band : ndarray, shape (m,)
        Number of each bin's band.
    dof : ndarray, shape (b,)
        Independent complex values in each band.

    Returns
    -------
    power, dof, shared : ndarray, shape (b,)
        Conditional power and its degrees of freedom (dof - 3; 0 where the vehicle makes most of the
        band), share of the power that is the vehicle's.

    Notes
    -----
    The residual of a regression of one complex Gaussian on three others is gamma with dof - 3,
    whether or not they share anything (complex Wishart).
    """
    power, shared = np.zeros(dof.size), np.zeros(dof.size)
    left = dof.copy()
    for b in range(dof.size):
        inside = band == b
        g = gyro[:, inside].ravel()
        total = float(np.mean(np.abs(g) ** 2))
        power[b] = total
        if dof[b] < FEWEST_DOF:
            continue
        a = accel[:, inside].reshape(g.size, 3)
        size = np.sqrt(np.mean(np.abs(a) ** 2, axis=0))
        if not (size > 0).all():
            continue
        told = a / size
        gram = told.conj().T @ told
        cross = told.conj().T @ g
        explained = float(np.real(cross.conj() @ np.linalg.lstsq(gram, cross, rcond=1e-9)[0]))
        left[b] = dof[b] - 3.0
        power[b] = max(total - explained / g.size, 1e-9 * total) * dof[b] / left[b]
        shared[b] = max(1.0 - power[b] / total, 0.0)
        if shared[b] > MOSTLY_SHARED:
            left[b] = 0.0
    return power, left, shared
