"""What gyros and accelerometers share at rest is the vehicle's motion, not the gyros' noise.

A vehicle that tilts turns gravity in the body: d(up)/dt = -omega x up. So the part of a level gyro
that the accelerometers tell, at whatever ratio of turning to swinging the vehicle's gear has, is
the vehicle's; what they do not tell is the gyro's. Nothing beside the gyro itself witnesses a turn
about the vertical.

A unit that is not quite level has a part of a sway in its vertical accelerometer too: 5e-4 of the
power at 1.3 degrees, which may hide its noise. The level accelerometers tell that part.

Decision: docs/decisions/0034-flicker-walk.md.
"""

import numpy as np
from numpy.typing import NDArray

# complex values of a band: of 12 the three accelerometers cost a quarter
FEWEST_DOF = 12.0
# of a band: where the vehicle makes more than 0.5, a tenth of it left in is 10 % of the gyro
MOSTLY_SHARED = 0.5
# the same of the vertical accelerometer, of which a tilt alone makes the part, alike at all
# frequencies: of 0.9 a hundredth left in is 9 %
MOSTLY_SWAY = 0.9


def own_power(
    channel: NDArray, witnesses: NDArray, band: NDArray, dof: NDArray, mostly: float = MOSTLY_SHARED
) -> tuple[NDArray, NDArray, NDArray]:
    """Power of a channel that the accelerometers do not tell.

    Parameters
    ----------
    channel : ndarray, shape (w, m)
        Transforms of windows and bins.
    witnesses : ndarray, shape (w, m, k)
        The same of the accelerometers.
    band : ndarray, shape (m,)
        Number of each bin's band.
    dof : ndarray, shape (b,)
        Independent complex values in each band.
    mostly : float
        Share of a band's power beyond which it says nothing of the channel.

    Returns
    -------
    power, dof, shared : ndarray, shape (b,)
        Conditional power and its degrees of freedom (dof - k; 0 where the vehicle makes most of the
        band), share of the power that is the vehicle's.

    Notes
    -----
    The residual of a regression of one complex Gaussian on k others is gamma with dof - k,
    whether or not they share anything (complex Wishart).
    """
    count = witnesses.shape[2]
    power, shared = np.zeros(dof.size), np.zeros(dof.size)
    left = dof.copy()
    for b in range(dof.size):
        inside = band == b
        g = channel[:, inside].ravel()
        total = float(np.mean(np.abs(g) ** 2))
        power[b] = total
        if dof[b] < FEWEST_DOF:
            continue
        a = witnesses[:, inside].reshape(g.size, count)
        size = np.sqrt(np.mean(np.abs(a) ** 2, axis=0))
        if not (size > 0).all():
            continue
        told = a / size
        gram = told.conj().T @ told
        cross = told.conj().T @ g
        explained = float(np.real(cross.conj() @ np.linalg.lstsq(gram, cross, rcond=1e-9)[0]))
        left[b] = dof[b] - count
        power[b] = max(total - explained / g.size, 1e-9 * total) * dof[b] / left[b]
        shared[b] = max(1.0 - power[b] / total, 0.0)
        if shared[b] > mostly:
            left[b] = 0.0
    return power, left, shared
