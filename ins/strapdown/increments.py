"""What integrating within one interval owes to the motion: coning and sculling.

Rows of a rate log are taken as the mean over the interval that ends at `time_s`. A log of
instantaneous samples is thereby tagged half an interval too early (what is computed for time_s
belongs to time_s + dt/2), gyros and accelerometers alike: attitude and velocity stay consistent
with each other, only their common time tag is off.

Rate and specific force are modelled as linear in time over the previous and the current interval,
of lengths Tp, T: with d = 2 (x/T - xp/Tp) / (T + Tp) the slope of either. An interval longer than
MAX_INTERVAL_RATIO times the one before it (a gap) and the first row are taken as constant: no
slope, no coning, no sculling. Units are SI and radians. ins.strapdown.kernel holds the same
formulas for the loop; a test pins one to the other. Source: Savage, J. Guidance 21(1), 1998, pp.
19-28 and 21(2), 1998, pp. 208-221 (previous and current increment), derived here for unequal
intervals.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ins.attitude import dcm_from_rotation_vector
from ins.records import ImuLog

# of an interval to the one before: above it a gap; one lost row makes 2, jitter 2.5
# (tests/ins/test_strapdown_kernel.py holds it to that of the loop)
MAX_INTERVAL_RATIO = 2.5
SERIES_ANGLE_RAD = 1e-3  # below, (a - sin a)/a^3 is 1/6 to 5e-8


def coning(imu: ImuLog) -> NDArray:
    """Rotation vector of each interval less the sum of its angle increments.

    Parameters
    ----------
    imu : ImuLog
        n rows.

    Returns
    -------
    beta_rad : ndarray, shape (n, 3)
        (1/2) integral of alpha x omega, body axes.

    Notes
    -----
    T^2 / (6 Tp (T + Tp)) dtheta_p x dtheta: a twelfth of the cross product at equal intervals.
    Neglected: what a rate that is not linear in time over two intervals adds.
    """
    return _slope_weight(imu.dt_s)[:, None] * np.cross(rows_before(imu.dtheta_rad), imu.dtheta_rad)


def sculling(imu: ImuLog) -> NDArray:
    """Velocity from alternating rotation and acceleration within each interval.

    Parameters
    ----------
    imu : ImuLog
        n rows.

    Returns
    -------
    dv_m_s : ndarray, shape (n, 3)
        (1/2) integral of alpha x f + u x omega, body axes, without its rotation part
        (1/2) dtheta x dv.

    Notes
    -----
    T^2 / (6 Tp (T + Tp)) (dtheta_p x dv + dv_p x dtheta).
    """
    cross = np.cross(rows_before(imu.dtheta_rad), imu.dv_m_s) + np.cross(
        rows_before(imu.dv_m_s), imu.dtheta_rad
    )
    return _slope_weight(imu.dt_s)[:, None] * cross


def rotation_vectors(imu: ImuLog) -> NDArray:
    """Rotation of the body over each interval.

    Parameters
    ----------
    imu : ImuLog
        n rows.

    Returns
    -------
    rotation_rad : ndarray, shape (n, 3)
        C_b(k-1)b(k) = exp(skew(row k)): increments with their coning.
    """
    return imu.dtheta_rad + coning(imu)


def velocity_increments(imu: ImuLog) -> NDArray:
    """Integral of specific force over each interval, in the body frame of its start.

    Parameters
    ----------
    imu : ImuLog
        n rows.

    Returns
    -------
    dv_m_s : ndarray, shape (n, 3)
        With rotation and sculling.

    Notes
    -----
    The rotation part is exact for constant rate and force:
    dv + (1 - cos a)/a^2 t x dv + (a - sin a)/a^3 t x (t x dv).
    """
    turn = np.cross(imu.dtheta_rad, imu.dv_m_s)
    angle = np.linalg.norm(imu.dtheta_rad, axis=1)[:, None]
    k1 = 0.5 * np.sinc(angle / (2 * np.pi)) ** 2
    a = np.maximum(angle, SERIES_ANGLE_RAD)
    k2 = np.where(angle < SERIES_ANGLE_RAD, 1 / 6, (a - np.sin(a)) / a**3)
    return imu.dv_m_s + k1 * turn + k2 * np.cross(imu.dtheta_rad, turn) + sculling(imu)


def rows_before(rows: NDArray) -> NDArray:
    """Each row's predecessor; the first is its own.

    Parameters
    ----------
    rows : (n, ...) array

    Returns
    -------
    before : (n, ...) array
    """
    return np.concatenate([rows[:1], rows[:-1]])


def _interval_ratio(dt_s: NDArray) -> NDArray:
    """T / Tp."""
    return dt_s / np.concatenate([dt_s[:1], dt_s[:-1]])


def _slope_weight(dt_s: NDArray) -> NDArray:
    """T^2 / (6 Tp (T + Tp)), zero after a gap."""
    ratio = _interval_ratio(dt_s)
    return np.where(ratio <= MAX_INTERVAL_RATIO, ratio**2 / (6 * (1 + ratio)), 0.0)


def joined(imu: ImuLog, ends: ArrayLike) -> tuple[NDArray, NDArray, NDArray]:
    """Rotation, velocity and way over longer intervals, each of one or more rows.

    Parameters
    ----------
    imu : ImuLog
        n rows.
    ends : array_like of int, shape (k,)
        Where the intervals end, strictly increasing: interval j holds rows ends[j - 1] to
        ends[j] - 1, the first from row 0.

    Returns
    -------
    C : ndarray, shape (k, 3, 3)
        Rotation over each interval, C_b(j-1)b(j).
    dv_m_s : ndarray, shape (k, 3)
        Integral of specific force, in the body frame of the interval's start.
    way_m : ndarray, shape (k, 3)
        Integral of that velocity, likewise; the force is even within a row.

    Notes
    -----
    Products of the rows' own rotations (`rotation_vectors`), one row of every interval at a time.
    """
    ends = np.asarray(ends, dtype=np.int64)
    starts = np.concatenate([[0], ends[:-1]])
    angles, pushes = rotation_vectors(imu), velocity_increments(imu)
    C = np.tile(np.eye(3), (ends.size, 1, 1))
    dv, way = np.zeros((ends.size, 3)), np.zeros((ends.size, 3))
    for k in range(int((ends - starts).max(initial=0))):
        of = np.flatnonzero(starts + k < ends)
        row = starts[of] + k
        pushed = np.einsum("kij,kj->ki", C[of], pushes[row])
        way[of] += (dv[of] + 0.5 * pushed) * imu.dt_s[row, None]
        dv[of] += pushed
        C[of] = C[of] @ dcm_from_rotation_vector(angles[row])
    return C, dv, way
