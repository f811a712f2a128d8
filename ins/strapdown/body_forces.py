"""Specific force added up in the body frame of a log's start: what velocity matching compares with
satellite velocities.
"""

import numpy as np

from ins.jit import jit
from ins.strapdown.kernel import cross, dcm, rotate, rotation_quaternion


@jit
def turned_forces(dtheta, dv):
    """Attitude from a log's start on, and specific force added up in its body frame of then.

    Parameters
    ----------
    dtheta, dv : ndarray, shape (n, 3)
        Increments [rad], [m/s].

    Returns
    -------
    C_b0b : ndarray, shape (n + 1, 3, 3)
        Attitude after each row; row 0 is the start.
    force : ndarray, shape (n + 1, 3)
        Sum of C_b0b f dt up to each row [m/s].

    Notes
    -----
    Inertial: the turn of Earth under it is left in (0.07 mrad/s). The force acts in the mean
    attitude of its row, to first order in the rotation.

    Source: Groves (2013), eq. (5.28).
    """
    n = len(dtheta)
    C_b0b, force = np.zeros((n + 1, 3, 3)), np.zeros((n + 1, 3))
    w, x, y, z = 1.0, 0.0, 0.0, 0.0
    for k in range(n + 1):
        C = dcm((w, x, y, z))
        for i in range(3):
            for j in range(3):
                C_b0b[k, i, j] = C[3 * i + j]
        if k == n:
            break
        theta = (dtheta[k, 0], dtheta[k, 1], dtheta[k, 2])
        dv_b = (dv[k, 0], dv[k, 1], dv[k, 2])
        turn = cross(theta, dv_b)
        pushed = rotate(
            C, (dv_b[0] + 0.5 * turn[0], dv_b[1] + 0.5 * turn[1], dv_b[2] + 0.5 * turn[2])
        )
        for i in range(3):
            force[k + 1, i] = force[k, i] + pushed[i]
        a, b, c, d = rotation_quaternion(theta, False)
        w, x, y, z = (
            w * a - x * b - y * c - z * d,
            w * b + x * a + y * d - z * c,
            w * c - x * d + y * a + z * b,
            w * d + x * c - y * b + z * a,
        )
    return C_b0b, force
