"""What navigation needs before its loop: valid rows and a valid start, the kernel's state, and
where epochs end.
"""

import numpy as np
from numpy.typing import NDArray

from ins.attitude import quaternion_from_dcm, wrap_pi
from ins.earth import dcm_en, ecef_from_geodetic
from ins.records import ImuLog, InputError, NavState

ORTHONORMAL_TOLERANCE = 1e-6  # largest |C^T C - I| of an initial attitude; 1e-6 rad is 0.2 arcsec


class EpochEnds:
    """Which rows of a log, fed in parts, are nearest to start_s + k epoch_s.

    Parameters
    ----------
    start_s : float
    epoch_s : float or None
        None: every row.

    Raises
    ------
    InputError
        Where epoch_s is not above 0.
    """

    def __init__(self, start_s: float, epoch_s: float | None) -> None:
        if epoch_s is not None and not 0 < epoch_s < np.inf:
            raise InputError(f"epoch_s {epoch_s}, needed above 0")
        self._start_s, self._epoch_s = start_s, epoch_s
        self._before_last_s = self.last_s = start_s  # the last two times seen
        # multiples of epoch_s passed; whether an epoch ended at last_s
        self._passed, self._ended = 0, True

    def settle(self, time_s: NDArray) -> NDArray:
        """The epoch ends that a part settles.

        Parameters
        ----------
        time_s : ndarray, shape (n,)
            Times of the next part.

        Returns
        -------
        ends : ndarray of int
            Rows of this part used up at each epoch end; 0: one that ended with the last part.
        """
        if self._epoch_s is None:
            ends = np.arange(1, time_s.size + 1)
        else:
            ends = self._nearest(time_s, self._epoch_s)
        self._before_last_s = float(time_s[-2]) if time_s.size > 1 else self.last_s
        self.last_s = float(time_s[-1])
        self._ended = bool(ends.size and ends[-1] == time_s.size)
        return ends

    def _nearest(self, time_s: NDArray, epoch_s: float) -> NDArray:
        last = int((time_s[-1] - self._start_s) / epoch_s) + 1
        targets = self._start_s + epoch_s * np.arange(self._passed + 1, last + 1)
        targets = targets[targets <= time_s[-1]]
        self._passed += targets.size
        row = np.searchsorted(time_s, targets)  # the first not before the target
        before_s = np.where(row > 0, time_s[row - 1], self.last_s)
        ends = np.unique(row + 1 - (targets - before_s < time_s[row] - targets))
        return ends[1:] if self._ended and ends.size and ends[0] == 0 else ends

    def last_row_ends_one(self) -> bool:
        """Whether, if no part follows, one more epoch ends at the last row.

        It does within half an interval of grace.

        Returns
        -------
        ends : bool
        """
        if self._ended or self._epoch_s is None:
            return False
        reach_s = self.last_s + 0.5 * (self.last_s - self._before_last_s) - self._start_s
        return int(np.floor(reach_s / self._epoch_s + 1e-9)) > self._passed


def earth_frame_state(initial: NavState) -> NDArray:
    """A navigation state as the kernel carries it.

    Parameters
    ----------
    initial : NavState

    Returns
    -------
    state : ndarray, shape (10,)
        Quaternion from body to ECEF (scalar first), v_eb_e [m/s], r_eb_e [m].
    """
    site = initial.site
    C_en = dcm_en(site.lat_rad, site.lon_rad)
    r_e = ecef_from_geodetic(site.lat_rad, site.lon_rad, site.height_m)
    return np.concatenate([quaternion_from_dcm(C_en @ initial.C_nb), C_en @ initial.v_n_m_s, r_e])


def initial_row(initial: NavState) -> NDArray:
    """Row 0 of the kernel's output: the state as given, its sums zero.

    Parameters
    ----------
    initial : NavState

    Returns
    -------
    row : ndarray, shape (1, COLUMNS)
    """
    from ins.strapdown import kernel

    row, site = np.zeros((1, kernel.HISTORY_COLUMNS)), initial.site
    row[0, : kernel.C_NB_DT_AT] = np.concatenate(
        [
            [site.lat_rad, wrap_pi(site.lon_rad), site.height_m],
            initial.v_n_m_s,
            initial.C_nb.ravel(),
        ]
    )
    return row


def interval_at(imu: ImuLog, row: int) -> NDArray | None:
    """One row of a log as the interval before another.

    Parameters
    ----------
    imu : ImuLog
    row : int

    Returns
    -------
    interval : ndarray, shape (7,), or None
        dtheta, dv, dt; None where the row is not valid.
    """
    interval = np.concatenate([imu.dtheta_rad[row], imu.dv_m_s[row], imu.dt_s[row : row + 1]])
    return interval if np.isfinite(interval).all() and interval[-1] > 0 else None


def check_rows(imu: ImuLog, first: int, fed_rows: int) -> None:
    """Refuse rows that are not finite or whose interval is not above zero.

    Parameters
    ----------
    imu : ImuLog
    first : int
        The first row that is looked at.
    fed_rows : int
        Rows of the parts before, for the row's number in the error line.

    Raises
    ------
    InputError
        Names the first such row.
    """
    dtheta, dv, dt = imu.dtheta_rad[first:], imu.dv_m_s[first:], imu.dt_s[first:]
    if np.isfinite(dtheta).all() and np.isfinite(dv).all() and dt.min() > 0 and dt.max() < np.inf:
        return
    finite = (
        np.isfinite(dtheta).all(axis=1) & np.isfinite(dv).all(axis=1) & (dt > 0) & (dt < np.inf)
    )
    k = int(np.argmin(finite))
    raise InputError(
        f"imu: row {fed_rows + first + k} at {imu.time_s[first + k]:.6g} s, "
        "needed finite increments and a finite dt_s above 0"
    )


def check_start(imu: ImuLog, first: int, initial: NavState) -> None:
    """Refuse a log whose row `first` starts more than an interval after the initial state.

    Parameters
    ----------
    imu : ImuLog
    first : int
    initial : NavState

    Raises
    ------
    InputError
    """
    dt = imu.dt_s[first:]
    late = imu.time_s[first] - dt[0] - initial.time_s
    if late > dt[0]:
        raise InputError(
            f"imu: first row starts {late:.6g} s after the initial state at {initial.time_s:.6g} s,"
            " needed at it"
        )


def check_initial(initial: NavState) -> None:
    """Refuse an initial attitude that is no rotation, or a velocity that is not finite.

    Parameters
    ----------
    initial : NavState

    Raises
    ------
    InputError
    """
    C = initial.C_nb
    if not (np.abs(C.T @ C - np.eye(3)).max() < ORTHONORMAL_TOLERANCE and np.linalg.det(C) > 0):
        raise InputError("initial C_nb is not a rotation matrix")
    if not np.isfinite(initial.v_n_m_s).all():
        raise InputError(f"initial v_n_m_s {initial.v_n_m_s}, needed finite")
