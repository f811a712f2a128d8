"""First attitude of a parked vehicle from gravity carried in the inertial frame: motion of the body
is signal there, not noise::

    C_nb(0) = C_ne C_ei(0) C_ib0, f_i = C_ib0 C_b0b(t) f_b, -g_i(t) = C_ie(t) C_en (0, 0, -g)

The gyros carry C_b0b(t), so that whatever tilts or turns the body drops out; Earth rate turns
gravity in the inertial frame by 15 deg/h, and that turn is the heading. Means of the specific force
over overlapping windows, in the frame of the body as it stood at the start, are matched with
gravity in the Earth-fixed inertial frame by Wahba's problem, solved by Davenport's q-method.

A raised cosine weighs each window: by parts, an acceleration of bounded position x enters as x w'',
so a sway of 1 cm at 0.3 Hz over 30 s tilts a mean by less than 1e-5 rad. Windows far from the
others' attitude (a push, a start-up) lose weight by Cauchy's function.

Sources: Wahba (1965); Davenport's q-method in Markley and Crassidis, "Fundamentals of Spacecraft
Attitude Determination and Control" (2014), section 5.3; vectors carried in the inertial frame: Gu,
El-Sheimy, Hassan, Syed, "Coarse alignment for marine SINS using gravity in the inertial frame as a
reference" (2008), and Wu, Pan, "Velocity/position integration formula" (IEEE T-AES 49, 2013).
Pinned by: tests/alignment/test_inertial_start.py
"""

import numpy as np
from numpy.typing import NDArray

from alignment import coarse
from ins.attitude import wrap_pi
from ins.earth import EARTH_RATE_RAD_S, dcm_en, gravity_magnitude
from ins.records import ImuSource, NavHistory, NavState, Site
from ins.strapdown.mechanization import VerticalChannel, navigate

# Windows are a quarter of the rest, within these: long against a sway of seconds, short against
# the rest, whose two ends the heading lives on.
SHORTEST_WINDOW_S, LONGEST_WINDOW_S = 20.0, 60.0
REWEIGHTINGS = 8  # the weights of a spoilt window settle in three or four
MEDIAN_TO_SIGMA = 1.2  # of the length of a two-component normal error: sqrt(2 ln 2)
CAUCHY = 2.385  # keeps 95 % of the efficiency on normal errors (Holland and Welsch 1977)
SMALLEST_ANGLE_RAD = 1e-7  # of a window's misfit: below, rounding decides


def start_attitude(imu: ImuSource, site: Site, rest: tuple[float, float]) -> NDArray:
    """C_nb (3, 3) at the start of a parked stretch, whatever moved the body in it.

    imu: compensated; rest: (start, end) [s], a minute or more. The coarse attitude, which motion
    may spoil, only lays the frame in which gyros and accelerometers are added up.
    Raises ValueError where there is no gravity, or no rate to begin from.
    """
    means = coarse.rest_means(imu.between(*rest))
    start = NavState(
        time_s=float(rest[0]), site=site, v_n_m_s=np.zeros(3), C_nb=coarse.gyrocompass_dcm(means)
    )
    history = navigate(imu.pieces(*rest), start, epoch_s=1.0, vertical=VerticalChannel(mode="hold"))
    return attitude_of(history, site)


def attitude_of(history: NavHistory, site: Site) -> NDArray:
    """C_nb (3, 3) at the first epoch of a free solution, from its gyros and specific forces alone:
    its own attitude at the start drops out.
    """
    C_en0 = dcm_en(site.lat_rad, site.lon_rad)
    seen, time_s = _windows(history)
    gravity_e = C_en0 @ [0.0, 0.0, -gravity_magnitude(site.lat_rad, site.height_m)]
    expected = np.einsum("kij,j->ki", _earth_turned(time_s), gravity_e)
    R = _robust_wahba(seen, expected)
    return np.asarray(C_en0.T @ R @ C_en0 @ history.C_nb[0])


def _windows(history: NavHistory) -> tuple[NDArray, NDArray]:
    """Means of the specific force (m, 3) over weighted windows, in the inertial frame that is the
    computed Earth frame at the first epoch, and the windows' centres [s] since then.
    """
    time_s = history.time_s - history.time_s[0]
    middle, dt = 0.5 * (time_s[1:] + time_s[:-1]), np.diff(time_s)
    C_en = _middle_C_en(history)
    f_i = np.einsum("kij,kjl,kl->ki", _earth_turned(middle), C_en, history.dv_f_n_m_s[1:])
    length = float(np.clip(0.25 * time_s[-1], SHORTEST_WINDOW_S, LONGEST_WINDOW_S))
    length = min(length, 0.5 * time_s[-1])
    count = int(2.0 * time_s[-1] / length) - 1
    centre = np.linspace(0.5 * length, time_s[-1] - 0.5 * length, max(count, 2))
    off = (middle - centre[:, None]) / length
    weight = np.where(np.abs(off) < 0.5, 1.0 + np.cos(2.0 * np.pi * off), 0.0)
    over = weight @ dt
    return weight @ f_i / over[:, None], weight * dt @ middle / over


def _middle_C_en(history: NavHistory) -> NDArray:
    """C_en (k - 1, 3, 3) in the middle of each epoch."""
    east = wrap_pi(np.diff(history.lon_rad))
    lat = 0.5 * (history.lat_rad[1:] + history.lat_rad[:-1])
    return dcm_en(lat, history.lon_rad[:-1] + 0.5 * east)


def _earth_turned(time_s: NDArray) -> NDArray:
    """C_ie (k, 3, 3) of the Earth frame that was the inertial frame at 0 s."""
    angle = EARTH_RATE_RAD_S * time_s
    C = np.zeros((len(time_s), 3, 3))
    C[:, 0, 0] = C[:, 1, 1] = np.cos(angle)
    C[:, 1, 0] = np.sin(angle)
    C[:, 0, 1] = -C[:, 1, 0]
    C[:, 2, 2] = 1.0
    return C


def _robust_wahba(seen: NDArray, expected: NDArray) -> NDArray:
    """R (3, 3) with expected = R seen, windows that fit badly weighing little."""
    b = seen / np.linalg.norm(seen, axis=1, keepdims=True)
    r = expected / np.linalg.norm(expected, axis=1, keepdims=True)
    weight = np.ones(len(b))
    for _ in range(REWEIGHTINGS):
        R = _wahba(b, r, weight)
        angle = np.linalg.norm(np.cross(r, b @ R.T), axis=1)
        sigma = max(float(np.median(angle)) / MEDIAN_TO_SIGMA, SMALLEST_ANGLE_RAD)
        weight = 1.0 / (1.0 + (angle / (CAUCHY * sigma)) ** 2)
    return R


def _wahba(b: NDArray, r: NDArray, weight: NDArray) -> NDArray:
    """R (3, 3) that minimises the sum of weight |r - R b|^2 over unit vectors (m, 3)."""
    B = np.einsum("k,ki,kj->ij", weight, r, b)
    z = np.einsum("k,ki->i", weight, np.cross(b, r))
    K = np.zeros((4, 4))
    K[0, 0] = np.trace(B)
    K[0, 1:] = K[1:, 0] = z
    K[1:, 1:] = B + B.T - np.trace(B) * np.eye(3)
    q0, *q = np.linalg.eigh(K)[1][:, -1]
    v = np.asarray(q)
    cross = np.cross(np.eye(3), v)  # the matrix [v x]: its rows are e_k x v
    R = (q0**2 - v @ v) * np.eye(3) + 2.0 * np.outer(v, v) + 2.0 * q0 * cross
    return np.asarray(R)
