"""Strapdown mechanization: inertial increments to position, velocity and attitude.

The loop (ins.strapdown_kernel) runs in the Earth frame with a quaternion, so poles and the date line are ordinary
places; latitude and height come from square roots (Bowring). Coning, sculling and scrolling are compensated from
consecutive increments (Savage, J. Guidance 21(1) and 21(2), 1998); gravity and Coriolis act at the step's middle.
Everything is second order in the interval or better: halving it divides the error by four or more.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ins.attitude import quaternion_from_dcm, wrap_pi
from ins.earth import GRAVITY_EQUATOR_M_S2, SEMI_MAJOR_AXIS_M, dcm_en, ecef_from_geodetic
from ins.records import ImuLog, InputError, NavHistory, NavState, frozen_array

VERTICAL_MODES = ("free", "hold", "aided")
ORTHONORMAL_TOLERANCE = 1e-6  # largest |C^T C - I| of an initial attitude
MIN_STEPS_PER_TIME_CONSTANT = 20  # fewer, and the discrete vertical loop is no longer the designed one


@dataclass(frozen=True, kw_only=True)
class VerticalChannel:
    """What keeps the height from diverging: third-order baro-inertial loop, its three poles at -1/time_constant_s.

    mode "free": nothing; an error in height grows e-fold in sqrt(R/2g) = 570 s.
    mode "hold": damped to the constant `height_m` (None: the initial height).
    mode "aided": damped to the series (`time_s`, `height_m`), shape (n,), linear in between, constant beyond its ends.
    Heights are above the ellipsoid. Only the down components of velocity and position are corrected.
    The integral path removes a constant accelerometer error, so at rest the height error goes to zero.

    A step B of vertical acceleration error gives B t^2/2 exp(-t/tau) of height error.

    Source: the third-order loop of Widnall and Sinha, J. Guidance 3(2), 1980, pp. 172-178, with
    s^3 + k1 s^2 + (k2 - 2g/R) s + k3 = (s + 1/tau)^3:  k1 = 3/tau, k2 = 3/tau^2 + 2g/R, k3 = 1/tau^3.
    """

    mode: str = "free"
    time_s: NDArray | None = None
    height_m: NDArray | float | None = None
    time_constant_s: float = 100.0

    def __post_init__(self) -> None:
        if self.mode not in VERTICAL_MODES:
            raise InputError(f"VerticalChannel.mode {self.mode!r}, needed one of {', '.join(VERTICAL_MODES)}")
        if not 0 < self.time_constant_s < np.inf:
            raise InputError(f"VerticalChannel.time_constant_s {self.time_constant_s} s, needed above 0")
        if self.mode == "aided":
            self._freeze_series()
        elif self.time_s is not None or np.ndim(self.height_m if self.height_m is not None else 0.0) != 0:
            raise InputError(f"VerticalChannel: a height series needs mode 'aided', got {self.mode!r}")
        elif self.height_m is not None and not np.isfinite(self.height_m):
            raise InputError(f"VerticalChannel.height_m {self.height_m}, needed a finite height")

    def _freeze_series(self) -> None:
        if self.time_s is None or self.height_m is None:
            raise InputError("VerticalChannel: mode 'aided' needs time_s and height_m")
        time_s = frozen_array(self.time_s, (None,), "VerticalChannel.time_s")
        height_m = frozen_array(self.height_m, time_s.shape, "VerticalChannel.height_m")
        if time_s.size == 0 or not np.all(np.diff(time_s) > 0) or not np.all(np.isfinite(height_m)):
            raise InputError("VerticalChannel: needs finite heights at strictly increasing times")
        object.__setattr__(self, "time_s", time_s)
        object.__setattr__(self, "height_m", height_m)

    def gains(self) -> tuple[float, float, float]:
        """k1 [1/s], k2 [1/s^2], k3 [1/s^3]; all zero when free."""
        if self.mode == "free":
            return 0.0, 0.0, 0.0
        rate = 1 / self.time_constant_s
        return 3 * rate, 3 * rate**2 + 2 * GRAVITY_EQUATOR_M_S2 / SEMI_MAJOR_AXIS_M, rate**3

    def reference_height(self, time_s: NDArray, initial_height_m: float) -> NDArray:
        """The height it is damped to at each time [m]."""
        if self.mode == "aided":
            return np.interp(time_s, np.asarray(self.time_s), np.asarray(self.height_m))
        held = initial_height_m if self.height_m is None else float(self.height_m)
        return np.full(time_s.size, held)


def navigate(
    imu: ImuLog, initial: NavState, *, epoch_s: float | None = 1.0, vertical: VerticalChannel | None = None
) -> NavHistory:
    """Integrate the increments of `imu` from `initial` on.

    Parameters
    ----------
    imu : ImuLog
        Rows with time_s > initial.time_s are used, each whole, and over its own dt_s. The row before them, where
        there is one, serves the coning compensation of the first.
    initial : NavState
        Its time should be that of an IMU row (or the start of the first).
    epoch_s : float or None
        Output interval: row k is at the IMU row nearest to initial.time_s + k epoch_s; what is left after the last
        epoch end is not used. None: a row at every IMU row.
    vertical : VerticalChannel or None
        None: free.

    Returns
    -------
    NavHistory
        Row 0 is the initial state. Longitude in [-pi, pi]. Closer than 1 mm to a pole, longitude is 0
        and NED is the frame that belongs to it.

    Raises
    ------
    InputError
        No row after initial.time_s, or the first starts later than it; a value that is not finite; an
        interval not above zero; an initial attitude that is not a rotation; a vertical loop faster than the data.

    Notes
    -----
    Left out: the northward component of normal gravity (0.8 micro-g per km of height at 45 deg), as in ins.earth.
    The accumulations take the trapezoid of C_nb and of C_bn v_n over each interval, and leave out the position
    correction of the vertical loop. About 0.15 microseconds a row; the first call ever compiles for 3 s.

    Pinned by: tests/ins/test_mechanization.py (closed forms), tests/ins/test_mechanization_oracle.py (flights of
    known truth, profiles of other authors, pyins)
    """
    navigator = Navigator(initial, epoch_s=epoch_s, vertical=vertical)
    navigator.feed(imu)
    return navigator.finish()


class Navigator:
    """Navigation of a log that comes in parts: `feed` each in turn, then `finish`.

    The parameters are those of `navigate`, which is one `feed` and `finish`; the solution is the same to the last bit
    however the log is cut. Of the log only the last row is kept, of the solution one row (288 bytes) an epoch.

    Each part must follow the one before it in time, and dt_s[0] of a part must be its true interval. Row numbers in
    error lines count from the first row fed. A vertical loop too fast for the data is judged on the first part used.

    Pinned by: tests/ins/test_navigator.py
    """

    def __init__(
        self, initial: NavState, *, epoch_s: float | None = 1.0, vertical: VerticalChannel | None = None
    ) -> None:
        from ins import strapdown_kernel as kernel

        _check_initial(initial, epoch_s)
        self._kernel, self._initial, self._epoch_s = kernel, initial, epoch_s
        self._vertical = vertical or VerticalChannel()
        self._state = np.zeros(kernel.STATE_SIZE)
        self._state[: kernel.CORRECTION] = _earth_frame_state(initial)
        self._open = np.zeros(kernel.COLUMNS)  # sums since the last epoch end
        self._rows, self._times_s = [_initial_row(initial)], [np.array([initial.time_s])]
        self._edges_s = (np.nan, initial.time_s)  # of the last interval used
        self._epochs_seen, self._at_end = 0, True  # multiples of epoch_s passed; whether a row was made at edges[1]
        self._fed_rows, self._fed_s = 0, -np.inf

    def feed(self, imu: ImuLog) -> None:
        """Use the rows of `imu` after the initial state; InputError as `navigate`, or where it does not follow on."""
        if imu.time_s[0] <= self._fed_s:
            raise InputError(f"imu: starts at {imu.time_s[0]:.6g} s, needed after {self._fed_s:.6g} s, fed before")
        first = int(np.searchsorted(imu.time_s, self._initial.time_s, side="right"))
        if first < imu.time_s.size:
            _check_rows(imu, first, self._fed_rows)
            if np.isnan(self._edges_s[0]):
                _check_start(imu, first, self._initial, self._vertical)
        if first > 0 or self._fed_rows == 0:
            self._state[self._kernel.BEFORE :] = _interval_before(imu, first)
        if first < imu.time_s.size:
            self._advance(imu, first)
        self._fed_rows, self._fed_s = self._fed_rows + imu.time_s.size, float(imu.time_s[-1])

    def finish(self) -> NavHistory:
        """The solution up to here, with the epoch that ends within half an interval after the last row."""
        before_s, last_s = self._edges_s
        if np.isnan(before_s):
            start_s = self._initial.time_s
            raise InputError(f"imu: ends at {self._fed_s:.6g} s, needed rows after the initial {start_s:.6g} s")
        rows, times_s = self._rows, self._times_s
        if not self._at_end and self._epoch_s is not None:
            passed = (last_s + 0.5 * (last_s - before_s) - self._initial.time_s) / self._epoch_s
            if int(np.floor(passed + 1e-9)) > self._epochs_seen:
                out, nothing = np.stack([self._open, self._open]), np.empty((0, 3))
                self._integrate(np.empty(0), nothing, nothing, np.empty(0), np.zeros(1, np.int64), out)
                rows, times_s = [*rows, out[:1]], [*times_s, np.array([last_s])]
        return _history(np.concatenate(times_s), np.concatenate(rows))

    def _advance(self, imu: ImuLog, first: int) -> None:
        time_s, dt = imu.time_s[first:], imu.dt_s[first:]
        edges = np.concatenate([[self._edges_s[1]], time_s])
        ends = self._epoch_ends(edges)
        out = np.zeros((ends.size + 1, self._kernel.COLUMNS))
        out[0] = self._open
        height_ref = self._vertical.reference_height(time_s - 0.5 * dt, self._initial.site.height_m)
        self._integrate(dt, imu.dtheta_rad[first:], imu.dv_m_s[first:], height_ref, ends, out)
        self._rows.append(out[:-1])
        self._times_s.append(edges[ends])
        self._open = out[-1].copy()
        self._at_end = bool(ends.size and ends[-1] == time_s.size)
        self._edges_s = (float(edges[-2]), float(edges[-1]))

    def _integrate(
        self, dt: NDArray, dtheta: NDArray, dv: NDArray, height_ref: NDArray, ends: NDArray, out: NDArray
    ) -> None:
        self._kernel.integrate(dt, dtheta, dv, height_ref, self._vertical.gains(), ends, self._state, out)

    def _epoch_ends(self, edges: NDArray) -> NDArray:
        """Rows of this part used up at each epoch end that it settles; 0 where its first row settles the last part's."""
        if self._epoch_s is None:
            return np.arange(1, edges.size)
        start_s, seen = self._initial.time_s, self._epochs_seen
        targets = start_s + self._epoch_s * np.arange(seen + 1, int((edges[-1] - start_s) / self._epoch_s) + 2)
        targets = targets[targets <= edges[-1]]
        self._epochs_seen += targets.size
        after = np.searchsorted(edges, targets)
        ends = np.unique(after - (targets - edges[after - 1] < edges[after] - targets))
        return ends[1:] if self._at_end and ends.size and ends[0] == 0 else ends


def _earth_frame_state(initial: NavState) -> NDArray:
    """q, v, r of the kernel (10,)."""
    site = initial.site
    C_en = dcm_en(site.lat_rad, site.lon_rad)
    r_e = ecef_from_geodetic(site.lat_rad, site.lon_rad, site.height_m)
    return np.concatenate([quaternion_from_dcm(C_en @ initial.C_nb), C_en @ initial.v_n_m_s, r_e])


def _initial_row(initial: NavState) -> NDArray:
    """Row 0 of the output (1, COLUMNS): the state as given, sums zero."""
    from ins import strapdown_kernel as kernel

    row, site = np.zeros((1, kernel.COLUMNS)), initial.site
    row[0, : kernel.C_NB_DT] = np.concatenate(
        [[site.lat_rad, wrap_pi(site.lon_rad), site.height_m], initial.v_n_m_s, initial.C_nb.ravel()]
    )
    return row


def _history(time_s: NDArray, rows: NDArray) -> NavHistory:
    """The columns of the kernel's output rows by name."""
    from ins.strapdown_kernel import C_NB, C_NB_DT, SUMS, V_N

    square = (-1, 3, 3)
    return NavHistory(
        time_s=time_s, lat_rad=rows[:, 0], lon_rad=rows[:, 1], height_m=rows[:, 2], v_n_m_s=rows[:, V_N:C_NB],
        C_nb=rows[:, C_NB:C_NB_DT].reshape(square), C_nb_dt=rows[:, C_NB_DT:SUMS].reshape(square),
        displacement_n_m=rows[:, SUMS : SUMS + 3], displacement_b_m=rows[:, SUMS + 3 : SUMS + 6],
        dv_f_n_m_s=rows[:, SUMS + 6 : SUMS + 9], dtheta_b_rad=rows[:, SUMS + 9 :],
    )  # fmt: skip


def _interval_before(imu: ImuLog, first: int) -> NDArray:
    """dtheta, dv, dt of the interval before row `first`; where there is none to use, that row itself: no slope."""
    for k in (max(first - 1, 0), min(first, imu.time_s.size - 1)):
        before = np.concatenate([imu.dtheta_rad[k], imu.dv_m_s[k], imu.dt_s[k : k + 1]])
        if np.isfinite(before).all() and before[-1] > 0:
            break
    return before


def _check_rows(imu: ImuLog, first: int, fed_rows: int) -> None:
    """Raise InputError unless the rows from `first` on are finite, with intervals above zero."""
    dtheta, dv, dt = imu.dtheta_rad[first:], imu.dv_m_s[first:], imu.dt_s[first:]
    if np.isfinite(dtheta).all() and np.isfinite(dv).all() and dt.min() > 0 and dt.max() < np.inf:
        return
    finite = np.isfinite(dtheta).all(axis=1) & np.isfinite(dv).all(axis=1) & (dt > 0) & (dt < np.inf)
    k = int(np.argmin(finite))
    raise InputError(
        f"imu: row {fed_rows + first + k} at {imu.time_s[first + k]:.6g} s, "
        "needed finite increments and a finite dt_s above 0"
    )


def _check_start(imu: ImuLog, first: int, initial: NavState, vertical: VerticalChannel) -> None:
    """Raise InputError unless row `first` starts at the initial state and the vertical loop is slow enough for it."""
    dt = imu.dt_s[first:]
    late = imu.time_s[first] - dt[0] - initial.time_s
    if late > dt[0]:
        raise InputError(
            f"imu: first row starts {late:.6g} s after the initial state at {initial.time_s:.6g} s, needed at it"
        )
    if vertical.mode != "free" and vertical.time_constant_s < MIN_STEPS_PER_TIME_CONSTANT * np.median(dt):
        raise InputError(
            f"VerticalChannel.time_constant_s {vertical.time_constant_s:.6g} s, needed at least "
            f"{MIN_STEPS_PER_TIME_CONSTANT} intervals of {np.median(dt):.6g} s"
        )


def _check_initial(initial: NavState, epoch_s: float | None) -> None:
    """Raise InputError unless the attitude is a rotation, the velocity finite and the epoch above zero."""
    C = initial.C_nb
    if not (np.abs(C.T @ C - np.eye(3)).max() < ORTHONORMAL_TOLERANCE and np.linalg.det(C) > 0):
        raise InputError("initial C_nb is not a rotation matrix")
    if not np.isfinite(initial.v_n_m_s).all():
        raise InputError(f"initial v_n_m_s {initial.v_n_m_s}, needed finite")
    if epoch_s is not None and not 0 < epoch_s < np.inf:
        raise InputError(f"epoch_s {epoch_s}, needed above 0")
