"""An antenna on its lever arm when each of its fixes was measured, from a solution and its rows."""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from ins.attitude import dcm_from_rotation_vector
from ins.earth import omega_ie_n, radii_of_curvature
from ins.records import ImuSource, NavHistory
from ins.strapdown.increments import rotation_vectors, velocity_increments

# over which rows are summed for the rate at a fix; chosen: it leaves 99.8 % of turbulence at
# 0.35 Hz and averages what shakes the unit
RATE_OVER_S = 0.1
# columns of the sums of rows: angles; velocity, its integral and attitude in the axes that the body
# had at the start of the log
ANGLE, VELOCITY, WAY, ATTITUDE, SUMS = slice(3), slice(3, 6), slice(6, 9), slice(9, 18), 18
STRETCH_ROWS = 128  # whose attitudes are multiplied side by side with those of other stretches


@dataclass(frozen=True)
class Antenna:
    """An antenna as it is taken to be, which its rows are linearised about.

    Parameters
    ----------
    arm_m : ndarray, shape (3,)
        Lever arm from the IMU, body axes.
    delay_s, velocity_delay_s : float
        How much older than their stamps positions and velocities are.
    found_m : ndarray, shape (3,)
        Of the arm, what is beyond the declared one, which the states are about.
    """

    arm_m: NDArray
    delay_s: float = 0.0
    velocity_delay_s: float = 0.0
    found_m: NDArray = field(default_factory=lambda: np.zeros(3))


@dataclass(frozen=True)
class AntennaMotion:
    """Unit and antenna at m times.

    Parameters
    ----------
    place : ndarray, shape (m, 3)
        Of the unit: latitude, longitude [rad], height [m].
    v_n : ndarray, shape (m, 3)
        Velocity of the unit [m/s].
    C_nb : ndarray, shape (m, 3, 3)
    rate_b : ndarray, shape (m, 3)
        Turn rate of the body against Earth [rad/s].
    acceleration_n : ndarray, shape (m, 3)
        Of the antenna against Earth [m/s^2].
    """

    place: NDArray
    v_n: NDArray
    C_nb: NDArray
    rate_b: NDArray
    acceleration_n: NDArray

    def at(self, times: NDArray | slice) -> "AntennaMotion":
        """The motion at some of the times.

        Parameters
        ----------
        times : ndarray of int or slice

        Returns
        -------
        motion : AntennaMotion
        """
        return AntennaMotion(*(column[times] for column in vars(self).values()))

    def swing_n(self, arm_m: NDArray) -> NDArray:
        """What turning adds to the velocity of a point of the body.

        Parameters
        ----------
        arm_m : ndarray, shape (3,)
            From the unit to the point, body axes.

        Returns
        -------
        swing_n : ndarray, shape (m, 3) [m/s]
        """
        return np.einsum("kij,kj->ki", self.C_nb, np.cross(self.rate_b, arm_m))


@dataclass(frozen=True)
class Epoch:
    """The unit at m times.

    Parameters
    ----------
    time_s : ndarray, shape (m,)
    place : ndarray, shape (m, 3)
        Latitude, longitude [rad], height [m].
    v_n : ndarray, shape (m, 3)
        In m/s.
    C_nb : ndarray, shape (m, 3, 3)
    """

    time_s: NDArray
    place: NDArray
    v_n: NDArray
    C_nb: NDArray


class RowSums:
    """What the rows of a log add up to. The log is read where other times are asked for than last.

    Parameters
    ----------
    imu : ImuSource
    """

    def __init__(self, imu: ImuSource) -> None:
        self._imu = imu
        self._newest = (np.zeros(0), np.zeros((0, SUMS)))  # ten hours of 10 Hz: 0.4 GB

    def at(self, time_s: NDArray) -> NDArray:
        """Sums from the start of the log, each row's rates even.

        Parameters
        ----------
        time_s : ndarray, shape (m,)

        Returns
        -------
        sums : ndarray, shape (m, 18)
            Angles [rad], body axes; velocity by the specific force [m/s], its integral [m] and
            C (3, 3) of the body, in the axes that it had at the start.
        """
        if not np.array_equal(time_s, self._newest[0]):
            self._newest = time_s.copy(), self._read(time_s)
        return self._newest[1]

    def _read(self, time_s: NDArray) -> NDArray:
        order = np.argsort(time_s)
        ordered_s, sums = time_s[order], np.zeros((time_s.size, SUMS))
        total, done = np.zeros(SUMS), 0
        total[ATTITUDE] = np.eye(3).ravel()
        for piece in self._imu.pieces():
            t = np.append(piece.time_s[0] - piece.dt_s[0], piece.time_s)
            until = int(np.searchsorted(ordered_s, t[-1], side="right"))
            here = order[done:until]  # with those that no row holds, since the piece before
            dt, turns, pushes = np.diff(t), rotation_vectors(piece), velocity_increments(piece)
            C = total[ATTITUDE].reshape(3, 3) @ _multiplied(dcm_from_rotation_vector(turns))
            gained = _summed(total[VELOCITY], np.einsum("kij,kj->ki", C[:-1], pushes))
            went = _summed(total[WAY], 0.5 * (gained[1:] + gained[:-1]) * dt[:, None])
            angles = _summed(total[ANGLE], piece.dtheta_rad)
            edges = np.hstack([angles, gained, went, C.reshape(-1, 9)])
            sums[here] = _within(edges, t, turns, time_s[here])
            total, done = edges[-1], until
        sums[order[done:]] = total
        return sums


def _within(edges: NDArray, t: NDArray, turns: NDArray, time_s: NDArray) -> NDArray:
    """Sums (m, 18) at times, from those (n + 1, 18) at the ends t of rows; turns (n, 3)."""
    k = np.clip(np.searchsorted(t, time_s, side="right") - 1, 0, t.size - 2)
    dt = np.diff(t)[k]
    share = np.clip((time_s - t[k]) / dt, 0.0, 1.0)[:, None]
    sums = (1.0 - share) * edges[k] + share * edges[k + 1]
    # of velocity even in a row, its integral is a parabola
    bent = 0.5 * share * (1.0 - share) * dt[:, None] * (edges[k + 1] - edges[k])[:, VELOCITY]
    sums[:, WAY] -= bent
    C = edges[k, ATTITUDE].reshape(-1, 3, 3) @ dcm_from_rotation_vector(share * turns[k])
    sums[:, ATTITUDE] = C.reshape(-1, 9)
    return sums


def _summed(first: NDArray, rows: NDArray) -> NDArray:
    """Sums (n + 1, 3) of rows (n, 3) and what was before."""
    return np.cumsum(np.vstack([first, rows]), axis=0)


def _multiplied(C: NDArray) -> NDArray:
    """Products (n + 1, 3, 3) of the first k matrices of C (n, 3, 3)."""
    stretches = -(-len(C) // STRETCH_ROWS)
    products = np.tile(np.eye(3), (stretches * STRETCH_ROWS, 1, 1))
    products[: len(C)] = C
    products = products.reshape(stretches, STRETCH_ROWS, 3, 3)
    for k in range(1, STRETCH_ROWS):
        products[:, k] = products[:, k - 1] @ products[:, k]
    for k in range(1, stretches):
        products[k] = products[k - 1, -1] @ products[k]
    return np.concatenate([np.eye(3)[None], products.reshape(-1, 3, 3)[: len(C)]])


def motion_at(history: NavHistory, rows: RowSums, arm_m: NDArray, time_s: NDArray) -> AntennaMotion:
    """The motion at given times: the solution at its epochs, the rows in between.

    The rate is that of the rows about each time. A mean over an epoch of a second is not: entering
    a turn within 2 s the rate changes by half of its size in a second, and an arm of 6 m in a turn
    of 10 deg/s is then off by 0.5 m/s.

    Parameters
    ----------
    history : NavHistory
    rows : RowSums
        Of the log that the solution is of.
    arm_m : ndarray, shape (3,)
        From the unit to the antenna, body axes.
    time_s : ndarray, shape (m,)

    Returns
    -------
    motion : AntennaMotion
    """
    h = history
    place = np.column_stack([h.lat_rad, np.unwrap(h.lon_rad), h.height_m])
    k = np.clip(np.searchsorted(h.time_s, time_s, side="right") - 1, 0, h.time_s.size - 2)
    begins, ends, *about = _sums(rows, [h.time_s[k], h.time_s[k + 1]], time_s)
    epoch = Epoch(h.time_s[k], place[k], h.v_n_m_s[k], h.C_nb[k])
    gained = h.v_n_m_s[k + 1] - h.v_n_m_s[k] - _pushed_n(epoch, begins, ends)
    left = gained / (h.time_s[k + 1] - h.time_s[k])[:, None]
    return replace(
        _moved(epoch, left, [begins, *about], arm_m, time_s),
        place=CubicSpline(h.time_s, place)(time_s),
    )


def motion_from(
    epoch: Epoch, pull_n: NDArray, rows: RowSums, arm_m: NDArray, time_s: NDArray
) -> AntennaMotion:
    """The motion at given times, each from a state of the unit shortly before or after it.

    Parameters
    ----------
    epoch : Epoch
        Of m states, within a second of the times.
    pull_n : ndarray, shape (m, 3)
        What accelerates the unit beside what its accelerometers read: gravity and Coriolis [m/s^2].
    rows : RowSums
        Of the log that the states are of.
    arm_m : ndarray, shape (3,)
        From the unit to the antenna, body axes.
    time_s : ndarray, shape (m,)

    Returns
    -------
    motion : AntennaMotion
    """
    begins, *about = _sums(rows, [epoch.time_s], time_s)
    motion, late_s = _moved(epoch, pull_n, [begins, *about], arm_m, time_s), time_s - epoch.time_s
    late, now = late_s[:, None], about[1]
    way_b = _since(begins, now[:, WAY] - begins[:, WAY] - late * begins[:, VELOCITY])
    way = (epoch.v_n + 0.5 * pull_n * late) * late + np.einsum("kij,kj->ki", epoch.C_nb, way_b)
    return replace(motion, place=moved_by(epoch.place, way))


def moved_by(place: NDArray, way_n: NDArray) -> NDArray:
    """Places a short way from others.

    Parameters
    ----------
    place : ndarray, shape (m, 3)
        Latitude, longitude [rad], height [m].
    way_n : ndarray, shape (m, 3)
        North, east, down [m]; as of `ins.earth.displacement_ned`.

    Returns
    -------
    place : ndarray, shape (m, 3)
    """
    lat, lon, height = place.T
    meridian, transverse = radii_of_curvature(lat)
    north, east, down = way_n.T
    east_rad = east / ((transverse + height) * np.cos(lat))
    return np.column_stack([lat + north / (meridian + height), lon + east_rad, height - down])


def _sums(rows: RowSums, epochs: list[NDArray], time_s: NDArray) -> list[NDArray]:
    """Sums (m, 6) at the epochs, then RATE_OVER_S / 2 before the times, at them and after them."""
    half = 0.5 * RATE_OVER_S
    asked = [*epochs, time_s - half, time_s, time_s + half]
    return np.split(rows.at(np.concatenate(asked)), len(asked))


def _since(begins: NDArray, vectors: NDArray) -> NDArray:
    """Vectors (m, 3) of the start of the log, in the axes of the body where sums are begins."""
    return np.einsum("kji,kj->ki", begins[:, ATTITUDE].reshape(-1, 3, 3), vectors)


def _pushed_n(epoch: Epoch, begins: NDArray, sums: NDArray) -> NDArray:
    """Velocity (m, 3) that rows add since an epoch. begins, sums (m, 18): there, and later."""
    pushed_b = _since(begins, sums[:, VELOCITY] - begins[:, VELOCITY])
    return np.einsum("kij,kj->ki", epoch.C_nb, pushed_b)


def _moved(
    epoch: Epoch, left_n: NDArray, sums: list[NDArray], arm_m: NDArray, time_s: NDArray
) -> AntennaMotion:
    """From the epoch's place. left_n (m, 3): acceleration beside what rows add; sums: of the rows
    at the epoch, RATE_OVER_S / 2 before the times, at them and after them.
    """
    begins, before, now, after = sums
    of_log = [rows[:, ATTITUDE].reshape(-1, 3, 3) for rows in (begins, now)]
    C_nb = epoch.C_nb @ np.swapaxes(of_log[0], 1, 2) @ of_log[1]
    earth_b = np.einsum("kji,kj->ki", C_nb, omega_ie_n(epoch.place[:, 0]))
    rate = (after - before)[:, ANGLE] / RATE_OVER_S - earth_b
    faster = (after - 2.0 * now + before)[:, ANGLE] / (0.5 * RATE_OVER_S) ** 2
    pull = np.cross(faster, arm_m) + np.cross(rate, np.cross(rate, arm_m))
    pushed = (_pushed_n(epoch, begins, after) - _pushed_n(epoch, begins, before)) / RATE_OVER_S
    pushed_n = _pushed_n(epoch, begins, now)
    return AntennaMotion(
        place=epoch.place,
        v_n=epoch.v_n + pushed_n + left_n * (time_s - epoch.time_s)[:, None],
        C_nb=C_nb,
        rate_b=rate,
        acceleration_n=pushed + left_n + np.einsum("kij,kj->ki", C_nb, pull),
    )
