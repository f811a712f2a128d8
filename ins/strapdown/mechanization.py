"""Strapdown mechanization: inertial increments to position, velocity and attitude.

The loop (ins.strapdown.loop) runs in the Earth frame with a quaternion, so poles and the date line
are ordinary places; latitude and height come from square roots (Bowring). Coning, sculling and
scrolling are compensated from consecutive increments (Savage, J. Guidance 21(1) and 21(2), 1998);
gravity and Coriolis act at the step's middle. Everything is second order in the interval or better:
halving it divides the error by four or more.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ins.earth import GRAVITY_EQUATOR_M_S2, SEMI_MAJOR_AXIS_M
from ins.records import ImuLog, InputError, NavHistory, NavState, frozen_array
from ins.strapdown.start import (
    EpochEnds,
    check_initial,
    check_rows,
    check_start,
    earth_frame_state,
    initial_row,
    interval_at,
)

VERTICAL_MODES = ("free", "hold", "aided")
# fewer, and the discrete vertical loop is no longer the designed one; a step is 5 % of it
MIN_STEPS_PER_TIME_CONSTANT = 20


@dataclass(frozen=True, kw_only=True)
class VerticalChannel:
    """What keeps the height from diverging: a third-order baro-inertial loop.

    Parameters
    ----------
    mode : str
        "free": nothing; an error in height grows e-fold in sqrt(R/2g) = 570 s.
        "hold": damped to the constant `height_m` (None: the initial height).
        "aided": damped to the series (`time_s`, `height_m`), linear in between, constant beyond its
        ends.
    time_s : ndarray, shape (n,), optional
    height_m : ndarray, shape (n,), or float, optional
        Above the ellipsoid.
    time_constant_s : float
        The loop's three poles lie at -1/time_constant_s.

    Raises
    ------
    InputError
        Another mode; a time constant that is not above 0; a series that is missing, not finite or
        in no order.

    Notes
    -----
    Only the down components of velocity and position are corrected. The integral path removes a
    constant accelerometer error, so at rest the height error goes to zero: a step B of vertical
    acceleration error gives B t^2/2 exp(-t/tau) of height error.

    Source: the third-order loop of Widnall and Sinha, J. Guidance 3(2), 1980, pp. 172-178, with
    s^3 + k1 s^2 + (k2 - 2g/R) s + k3 = (s + 1/tau)^3:  k1 = 3/tau, k2 = 3/tau^2 + 2g/R,
    k3 = 1/tau^3.
    """

    mode: str = "free"
    time_s: NDArray | None = None
    height_m: NDArray | float | None = None
    time_constant_s: float = 100.0

    def __post_init__(self) -> None:
        if self.mode not in VERTICAL_MODES:
            raise InputError(
                f"VerticalChannel.mode {self.mode!r}, needed one of {', '.join(VERTICAL_MODES)}"
            )
        if not 0 < self.time_constant_s < np.inf:
            raise InputError(
                f"VerticalChannel.time_constant_s {self.time_constant_s} s, needed above 0"
            )
        if self.mode == "aided":
            self._freeze_series()
        elif self.time_s is not None or (self.height_m is not None and np.ndim(self.height_m)):
            raise InputError(
                f"VerticalChannel: a height series needs mode 'aided', got {self.mode!r}"
            )
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
        """Gains of the loop.

        Returns
        -------
        k1, k2, k3 : float
            In 1/s, 1/s^2 and 1/s^3; all zero when free.
        """
        if self.mode == "free":
            return 0.0, 0.0, 0.0
        rate = 1 / self.time_constant_s
        return 3 * rate, 3 * rate**2 + 2 * GRAVITY_EQUATOR_M_S2 / SEMI_MAJOR_AXIS_M, rate**3

    @property
    def look_s(self) -> float:
        """Longest time [s] over which the look-up of gravity takes the loop as constant."""
        from ins.strapdown.kernel import LOOK_AHEAD_S

        return (
            LOOK_AHEAD_S if self.mode == "free" else min(LOOK_AHEAD_S, self.time_constant_s / 100.0)
        )

    def check_interval(self, dt_s: NDArray) -> None:
        """Refuse intervals that are too long for the loop.

        Parameters
        ----------
        dt_s : ndarray, shape (n,)
            Of the log.

        Raises
        ------
        InputError
            Where the time constant is below MIN_STEPS_PER_TIME_CONSTANT median intervals.
        """
        if self.mode == "free" or self.time_constant_s >= MIN_STEPS_PER_TIME_CONSTANT * dt_s.max():
            return
        if self.time_constant_s < MIN_STEPS_PER_TIME_CONSTANT * np.median(dt_s):
            raise InputError(
                f"VerticalChannel.time_constant_s {self.time_constant_s:.6g} s, needed at least "
                f"{MIN_STEPS_PER_TIME_CONSTANT} intervals of {np.median(dt_s):.6g} s"
            )

    def reference_height(self, time_s: NDArray, dt_s: NDArray, initial_height_m: float) -> NDArray:
        """The height that the loop is damped to, in the middle of intervals.

        Parameters
        ----------
        time_s, dt_s : ndarray, shape (n,)
            Ends and lengths of the intervals.
        initial_height_m : float
            Held where the loop has no height of its own.

        Returns
        -------
        height_m : ndarray, shape (n,)
        """
        if self.mode == "aided":
            return np.interp(
                time_s - 0.5 * dt_s, np.asarray(self.time_s), np.asarray(self.height_m)
            )
        held = initial_height_m if self.height_m is None else float(self.height_m)
        return np.full(time_s.size, held)


def navigate(
    imu: ImuLog | Iterable[ImuLog],
    initial: NavState,
    *,
    epoch_s: float | None = 1.0,
    vertical: VerticalChannel | None = None,
) -> NavHistory:
    """Integrate the increments of `imu` from `initial` on.

    Parameters
    ----------
    imu : ImuLog, or its pieces in order (`ins.records.ImuSource.pieces`)
        Rows with time_s > initial.time_s are used, each whole, and over its own dt_s. The row
        before them, where there is one, serves the coning compensation of the first.
    initial : NavState
        Its time should be that of an IMU row (or the start of the first).
    epoch_s : float or None
        Output interval: row k is at the IMU row nearest to initial.time_s + k epoch_s; what is left
        after the last epoch end is not used. None: a row at every IMU row.
    vertical : VerticalChannel or None
        None: free.

    Returns
    -------
    NavHistory
        Row 0 is the initial state. Longitude in [-pi, pi]. Closer than 1 mm to a pole, longitude is
        0 and NED is the frame that belongs to it.

    Raises
    ------
    InputError
        No row after initial.time_s, or the first starts later than it; a value that is not finite;
        an interval not above zero; an initial attitude that is not a rotation; a vertical loop
        faster than the data.

    Notes
    -----
    Left out: the northward component of normal gravity (0.8 micro-g per km of height at 45 deg), as
    in ins.earth. The accumulations take the trapezoid of C_nb and of C_bn v_n over each interval,
    and leave out the position correction of the vertical loop. About 0.045 microseconds a row; the
    first call ever compiles for 6 s of CPU.

    Pinned by: tests/ins/test_mechanization.py (closed forms),
    tests/ins/test_mechanization_oracle.py (flights of known truth, profiles of other authors,
    pyins)
    """
    navigator = Navigator(initial, epoch_s=epoch_s, vertical=vertical)
    for piece in (imu,) if isinstance(imu, ImuLog) else imu:
        navigator.feed(piece)
    return navigator.finish()


class Navigator:
    """Navigation of a log that comes in parts: `feed` each in turn, then `finish`.

    Parameters
    ----------
    initial : NavState
    epoch_s : float or None
    vertical : VerticalChannel or None
        All three as in `navigate`, which is one `feed` and `finish`.

    Notes
    -----
    The solution is the same to the last bit however the log is cut. Of the log only the last row is
    kept, of the solution one row (288 bytes) an epoch.

    Each part must follow the one before it in time, and dt_s[0] of a part must be its true
    interval. Row numbers in error lines count from the first row fed. A vertical loop too fast for
    the data is judged on the first part used.

    Pinned by: tests/ins/test_navigator.py
    """

    def __init__(
        self,
        initial: NavState,
        *,
        epoch_s: float | None = 1.0,
        vertical: VerticalChannel | None = None,
    ) -> None:
        from ins.strapdown import kernel
        from ins.strapdown import loop as strapdown_loop

        check_initial(initial)
        self._kernel, self._loop, self._initial = kernel, strapdown_loop.integrate, initial
        self._vertical = vertical or VerticalChannel()
        self._state = np.zeros(kernel.STATE_SIZE)
        self._state[: kernel.CORRECTION] = earth_frame_state(initial)
        self._open = np.zeros(kernel.HISTORY_COLUMNS)  # sums since the last epoch end
        self._rows, self._times_s = [initial_row(initial)], [np.array([initial.time_s])]
        self._epochs, self._rows_used = EpochEnds(initial.time_s, epoch_s), False
        self._before: NDArray | None = None  # the interval before the first used
        self._fed_rows, self._fed_s = 0, -np.inf

    def feed(self, imu: ImuLog) -> None:
        """Use the rows of a part of the log after the initial state.

        Parameters
        ----------
        imu : ImuLog
            The next part.

        Raises
        ------
        InputError
            As `navigate`, or where the part does not follow on.
        """
        if imu.time_s[0] <= self._fed_s:
            raise InputError(
                f"imu: starts at {imu.time_s[0]:.6g} s, needed after {self._fed_s:.6g} s, fed"
                " before"
            )
        first = int(np.searchsorted(imu.time_s, self._initial.time_s, side="right"))
        if first > 0:
            self._before = interval_at(imu, first - 1)
        if first < imu.time_s.size:
            check_rows(imu, first, self._fed_rows)
            if not self._rows_used:
                check_start(imu, first, self._initial)
                self._vertical.check_interval(imu.dt_s[first:])
                before = interval_at(imu, first) if self._before is None else self._before
                self._state[self._kernel.BEFORE : self._kernel.U] = before
            self._advance(imu, first)
        self._fed_rows, self._fed_s = self._fed_rows + imu.time_s.size, float(imu.time_s[-1])

    def finish(self) -> NavHistory:
        """The solution up to here.

        Returns
        -------
        history : NavHistory
            With the epoch that ends within half an interval after the last row.

        Raises
        ------
        InputError
            Where no row after the initial state was fed.
        """
        if not self._rows_used:
            start_s = self._initial.time_s
            raise InputError(
                f"imu: ends at {self._fed_s:.6g} s, needed rows after the initial {start_s:.6g} s"
            )
        rows, times_s = self._rows, self._times_s
        if self._epochs.last_row_ends_one():
            out, nothing = np.stack([self._open, self._open]), np.empty((0, 3))
            self._integrate(np.empty(0), nothing, nothing, np.empty(0), np.zeros(1, np.int64), out)
            rows, times_s = [*rows, out[:1]], [*times_s, np.array([self._epochs.last_s])]
        return _history(np.concatenate(times_s), np.concatenate(rows))

    def _advance(self, imu: ImuLog, first: int) -> None:
        time_s, dt = imu.time_s[first:], imu.dt_s[first:]
        before_s = self._epochs.last_s
        ends = self._epochs.settle(time_s)
        out = np.zeros((ends.size + 1, self._kernel.HISTORY_COLUMNS))
        out[0] = self._open
        height_ref = self._vertical.reference_height(time_s, dt, self._initial.site.height_m)
        self._integrate(dt, imu.dtheta_rad[first:], imu.dv_m_s[first:], height_ref, ends, out)
        self._rows.append(out[:-1])
        self._times_s.append(np.where(ends == 0, before_s, time_s[ends - 1]))
        self._open, self._rows_used = out[-1].copy(), True

    def _integrate(
        self,
        dt: NDArray,
        dtheta: NDArray,
        dv: NDArray,
        height_ref: NDArray,
        ends: NDArray,
        out: NDArray,
    ) -> None:
        gains, look_s = self._vertical.gains(), self._vertical.look_s
        self._loop(
            dt,
            dtheta,
            dv,
            height_ref,
            gains,
            look_s,
            self._kernel.LOOK_ROWS,
            ends,
            self._state,
            out,
        )


def _history(time_s: NDArray, rows: NDArray) -> NavHistory:
    """The columns of the kernel's output rows by name."""
    from ins.strapdown.kernel import C_NB_AT, C_NB_DT_AT, SUMS, V_N_AT

    square = (-1, 3, 3)
    return NavHistory(
        time_s=time_s,
        lat_rad=rows[:, 0],
        lon_rad=rows[:, 1],
        height_m=rows[:, 2],
        v_n_m_s=rows[:, V_N_AT:C_NB_AT],
        C_nb=rows[:, C_NB_AT:C_NB_DT_AT].reshape(square),
        C_nb_dt=rows[:, C_NB_DT_AT:SUMS].reshape(square),
        displacement_n_m=rows[:, SUMS : SUMS + 3],
        displacement_b_m=rows[:, SUMS + 3 : SUMS + 6],
        dv_f_n_m_s=rows[:, SUMS + 6 : SUMS + 9],
        dtheta_b_rad=rows[:, SUMS + 9 :],
    )
