"""Rotations: direction cosine matrices, Euler angles, rotation vectors.

`C_nb` takes body components into navigation components: v_n = C_nb @ v_b.
Euler angles are the aerospace sequence heading (about down), pitch (about right), roll (about
forward). All functions broadcast over leading dimensions. Pinned by tests/ins/test_attitude.py
against scipy Rotation.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray


def skew(vector: ArrayLike) -> NDArray:
    """Cross-product matrix: skew(a) @ b = a x b. Shape (..., 3) -> (..., 3, 3)."""
    v = np.asarray(vector, dtype=float)
    S = np.zeros(v.shape[:-1] + (3, 3))
    S[..., 0, 1], S[..., 0, 2] = -v[..., 2], v[..., 1]
    S[..., 1, 0], S[..., 1, 2] = v[..., 2], -v[..., 0]
    S[..., 2, 0], S[..., 2, 1] = -v[..., 1], v[..., 0]
    return S


def dcm_from_euler(roll_rad: ArrayLike, pitch_rad: ArrayLike, heading_rad: ArrayLike) -> NDArray:
    """C_nb from roll, pitch, heading [rad]. Shapes (...) -> (..., 3, 3).

    Source: Groves (2013), eq. (2.24).
    """
    r, p, h = np.broadcast_arrays(
        *(np.asarray(a, dtype=float) for a in (roll_rad, pitch_rad, heading_rad))
    )
    sr, cr, sp, cp, sh, ch = np.sin(r), np.cos(r), np.sin(p), np.cos(p), np.sin(h), np.cos(h)
    C_nb = np.empty(r.shape + (3, 3))
    C_nb[..., 0, 0], C_nb[..., 0, 1], C_nb[..., 0, 2] = (
        cp * ch,
        -cr * sh + sr * sp * ch,
        sr * sh + cr * sp * ch,
    )
    C_nb[..., 1, 0], C_nb[..., 1, 1], C_nb[..., 1, 2] = (
        cp * sh,
        cr * ch + sr * sp * sh,
        -sr * ch + cr * sp * sh,
    )
    C_nb[..., 2, 0], C_nb[..., 2, 1], C_nb[..., 2, 2] = -sp, sr * cp, cr * cp
    return C_nb


def euler_from_dcm(C_nb: ArrayLike) -> tuple[NDArray, NDArray, NDArray]:
    """Roll, pitch, heading [rad] from C_nb, shape (..., 3, 3); heading in [0, 2 pi).

    At pitch +-90 deg roll and heading are not separate; what comes back there still rebuilds C_nb
    to the matrix's own rounding.  Source: Groves (2013), eq. (2.25).
    """
    C = np.asarray(C_nb, dtype=float)
    roll = np.arctan2(C[..., 2, 1], C[..., 2, 2])
    pitch = np.arctan2(-C[..., 2, 0], np.hypot(C[..., 0, 0], C[..., 1, 0]))
    heading = np.mod(np.arctan2(C[..., 1, 0], C[..., 0, 0]), 2 * np.pi)
    return roll, pitch, heading


def dcm_from_rotation_vector(rotation_rad: ArrayLike) -> NDArray:
    """Rotation matrix exp(skew(rotation)), shape (..., 3) -> (..., 3, 3). Exact to rounding at any
    size.

    C = I + sin(a)/a S + (1 - cos a)/a^2 S^2, both factors as sinc.  Source: Rodrigues (1840).
    """
    v = np.asarray(rotation_rad, dtype=float)
    angle = np.linalg.norm(v, axis=-1)[..., None, None]
    S = skew(v)
    return (
        np.eye(3) + np.sinc(angle / np.pi) * S + 0.5 * np.sinc(angle / (2 * np.pi)) ** 2 * (S @ S)
    )


def rotation_vector_from_dcm(C: ArrayLike) -> NDArray:
    """Rotation vector [rad] of a rotation matrix, shape (..., 3, 3) -> (..., 3); angles below
    pi.
    """
    C = np.asarray(C, dtype=float)
    axial = 0.5 * np.stack(
        [C[..., 2, 1] - C[..., 1, 2], C[..., 0, 2] - C[..., 2, 0], C[..., 1, 0] - C[..., 0, 1]],
        axis=-1,
    )
    s = np.linalg.norm(axial, axis=-1)
    angle = np.arctan2(s, 0.5 * (np.trace(C, axis1=-2, axis2=-1) - 1.0))
    return axial / np.sinc(angle / np.pi)[..., None]


def level_angles(f_b: ArrayLike) -> tuple[float, float]:
    """Roll and pitch of a unit at rest, from its specific force.

    Parameters
    ----------
    f_b : array_like, shape (3,)
        Mean specific force in body axes [m/s^2]; its length does not count.

    Returns
    -------
    roll_rad, pitch_rad : float
        Roll in [-pi, pi], pitch in [-pi/2, pi/2].

    Notes
    -----
    Accelerometer biases are left in: 1 mg tilts the result by 1 mrad. Roll is undefined where the
    x axis is vertical.

    Source: Groves (2013), eq. (5.101).

    Examples
    --------
    >>> level_angles([0.0, 0.0, -9.8])
    (-0.0, 0.0)
    """
    x, y, z = np.asarray(f_b, dtype=float)
    return float(np.arctan2(-y, -z)), float(np.arctan2(x, np.hypot(y, z)))


def wrap_pi(angle_rad: ArrayLike) -> NDArray:
    """Angle brought into [-pi, pi)."""
    return np.mod(np.asarray(angle_rad, dtype=float) + np.pi, 2 * np.pi) - np.pi


def quaternion_from_dcm(C: ArrayLike) -> NDArray:
    """Unit quaternion, scalar first and not negative, of one rotation matrix (3, 3) -> (4,); any
    angle.

    The eigenvector of the largest eigenvalue, so a matrix that is slightly off gives the nearest
    rotation. Source: Bar-Itzhack, J. Guidance 23(6), 2000, pp. 1085-1087.
    """
    (a, b, c), (d, e, f), (g, h, i) = np.asarray(C, dtype=float)
    K = np.array(
        [[a + e + i, h - f, c - g, d - b],
         [h - f, a - e - i, b + d, c + g],
         [c - g, b + d, e - a - i, f + h],
         [d - b, c + g, f + h, i - a - e]]
    )  # fmt: skip
    q = np.linalg.eigh(K)[1][:, -1]
    return q if q[0] >= 0 else -q
