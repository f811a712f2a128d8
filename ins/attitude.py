"""Rotations: direction cosine matrices, Euler angles, rotation vectors.

`C_nb` takes body components into navigation components: v_n = C_nb @ v_b.
Euler angles are the aerospace sequence heading (about down), pitch (about right), roll (about
forward). All functions broadcast over leading dimensions. Pinned by tests/ins/test_attitude.py
against scipy Rotation.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray


def skew(vector: ArrayLike) -> NDArray:
    """Cross-product matrix of a vector: skew(a) @ b = a x b.

    Parameters
    ----------
    vector : array_like, shape (..., 3)
        In any unit.

    Returns
    -------
    matrix : ndarray, shape (..., 3, 3)
        Antisymmetric, in the unit of the vector.

    Examples
    --------
    >>> skew([1.0, 0.0, 0.0]) @ [0.0, 1.0, 0.0]
    array([0., 0., 1.])
    """
    v = np.asarray(vector, dtype=float)
    if v.ndim == 1:  # a third of the time; filters ask for it at each step
        x, y, z = v.tolist()
        return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    S = np.zeros(v.shape[:-1] + (3, 3))
    S[..., 0, 1], S[..., 0, 2] = -v[..., 2], v[..., 1]
    S[..., 1, 0], S[..., 1, 2] = v[..., 2], -v[..., 0]
    S[..., 2, 0], S[..., 2, 1] = -v[..., 1], v[..., 0]
    return S


def cross(a: NDArray, b: NDArray) -> NDArray:
    """Cross product of two vectors, of one pair: numpy's own takes 20 times as long.

    Parameters
    ----------
    a, b : ndarray, shape (3,)
        In any unit.

    Returns
    -------
    product : ndarray, shape (3,)
        a x b.

    Examples
    --------
    >>> cross(np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0]))
    array([0., 0., 1.])
    """
    (a0, a1, a2), (b0, b1, b2) = a.tolist(), b.tolist()
    return np.array([a1 * b2 - a2 * b1, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0])


def dcm_from_euler(roll_rad: ArrayLike, pitch_rad: ArrayLike, heading_rad: ArrayLike) -> NDArray:
    """Attitude matrix from roll, pitch and heading.

    Parameters
    ----------
    roll_rad, pitch_rad, heading_rad : array_like, shape (...)
        Turns about forward, right and down, made in the order heading, pitch, roll.

    Returns
    -------
    C_nb : ndarray, shape (..., 3, 3)
        Takes body components into navigation components.

    Notes
    -----
    Source: Groves (2013), eq. (2.24).

    Examples
    --------
    >>> dcm_from_euler(0.0, 0.0, np.pi / 2).round(12) @ [1.0, 0.0, 0.0]  # forward is east
    array([0., 1., 0.])
    """
    r, p, h = np.broadcast_arrays(
        *(np.asarray(a, dtype=float) for a in (roll_rad, pitch_rad, heading_rad))
    )
    sr, cr = np.sin(r), np.cos(r)
    sp, cp = np.sin(p), np.cos(p)
    sh, ch = np.sin(h), np.cos(h)
    C_nb = np.empty(r.shape + (3, 3))
    C_nb[..., 0, 0] = cp * ch
    C_nb[..., 0, 1] = -cr * sh + sr * sp * ch
    C_nb[..., 0, 2] = sr * sh + cr * sp * ch
    C_nb[..., 1, 0] = cp * sh
    C_nb[..., 1, 1] = cr * ch + sr * sp * sh
    C_nb[..., 1, 2] = -sr * ch + cr * sp * sh
    C_nb[..., 2, 0] = -sp
    C_nb[..., 2, 1] = sr * cp
    C_nb[..., 2, 2] = cr * cp
    return C_nb


def euler_from_dcm(C_nb: ArrayLike) -> tuple[NDArray, NDArray, NDArray]:
    """Roll, pitch and heading of an attitude matrix.

    Parameters
    ----------
    C_nb : array_like, shape (..., 3, 3)
        Takes body components into navigation components.

    Returns
    -------
    roll_rad, pitch_rad, heading_rad : ndarray, shape (...)
        Roll in [-pi, pi], pitch in [-pi/2, pi/2], heading in [0, 2 pi].

    Notes
    -----
    At a pitch of +-90 deg roll and heading are not separate. What comes back there still rebuilds
    C_nb to the rounding of the matrix.

    Source: Groves (2013), eq. (2.25).
    """
    C = np.asarray(C_nb, dtype=float)
    roll = np.arctan2(C[..., 2, 1], C[..., 2, 2])
    pitch = np.arctan2(-C[..., 2, 0], np.hypot(C[..., 0, 0], C[..., 1, 0]))
    heading = np.mod(np.arctan2(C[..., 1, 0], C[..., 0, 0]), 2 * np.pi)
    return roll, pitch, heading


def dcm_from_rotation_vector(rotation_rad: ArrayLike) -> NDArray:
    """Rotation matrix exp(skew(rotation)) of a rotation vector.

    Parameters
    ----------
    rotation_rad : array_like, shape (..., 3)
        Axis times angle, of any size.

    Returns
    -------
    C : ndarray, shape (..., 3, 3)
        Exact to rounding at any angle.

    Notes
    -----
    C = I + sin(a)/a S + (1 - cos a)/a^2 S^2. Both factors are written with sinc, so that neither
    loses digits near a = 0.

    Source: Rodrigues (1840).
    """
    v = np.asarray(rotation_rad, dtype=float)
    angle = np.linalg.norm(v, axis=-1)[..., None, None]
    S = skew(v)
    return (
        np.eye(3) + np.sinc(angle / np.pi) * S + 0.5 * np.sinc(angle / (2 * np.pi)) ** 2 * (S @ S)
    )


def rotation_vector_from_dcm(C: ArrayLike) -> NDArray:
    """Rotation vector of a rotation matrix.

    Parameters
    ----------
    C : array_like, shape (..., 3, 3)
        A rotation by less than pi.

    Returns
    -------
    rotation_rad : ndarray, shape (..., 3)
        Axis times angle.

    Notes
    -----
    At an angle of pi the axis is not determined by the part that is used; the vector then is lost.
    Below 3.1 rad the way there and back is exact to 1e-12.
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
    """The same angle, brought into [-pi, pi).

    Parameters
    ----------
    angle_rad : array_like, shape (...)
        Any angle.

    Returns
    -------
    angle_rad : ndarray, shape (...)

    Examples
    --------
    >>> float(wrap_pi(3 * np.pi))
    -3.141592653589793
    """
    return np.mod(np.asarray(angle_rad, dtype=float) + np.pi, 2 * np.pi) - np.pi


def quaternion_from_dcm(C: ArrayLike) -> NDArray:
    """Unit quaternion of one rotation matrix, for any angle.

    Parameters
    ----------
    C : array_like, shape (3, 3)
        A rotation. A matrix that is slightly off gives the quaternion of the nearest rotation.

    Returns
    -------
    q : ndarray, shape (4,)
        Scalar first and not negative.

    Notes
    -----
    The eigenvector of the largest eigenvalue of a symmetric (4, 4) matrix.

    Source: Bar-Itzhack, J. Guidance 23(6), 2000, pp. 1085-1087.

    Examples
    --------
    >>> quaternion_from_dcm(np.eye(3))
    array([1., 0., 0., 0.])
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
