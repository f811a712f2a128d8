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
    from ins import strapdown_kernel

    vertical = vertical or VerticalChannel()
    first = int(np.searchsorted(imu.time_s, initial.time_s, side="right"))
    _check(imu, initial, first, vertical)
    ends = _epoch_ends(imu.time_s[first:], initial.time_s, epoch_s)
    n, site, C_en = ends.size, initial.site, dcm_en(initial.site.lat_rad, initial.site.lon_rad)
    geodetic, v_n, C_nb = np.empty((n, 3)), np.empty((n, 3)), np.empty((n, 3, 3))
    geodetic[0] = site.lat_rad, wrap_pi(site.lon_rad), site.height_m
    v_n[0], C_nb[0] = initial.v_n_m_s, initial.C_nb
    C_nb_dt, sums = np.zeros((n, 3, 3)), np.zeros((n, 12))
    dt = imu.dt_s[first:]
    strapdown_kernel.integrate(
        dt, imu.dtheta_rad[first:], imu.dv_m_s[first:], _interval_before(imu, first),
        vertical.reference_height(imu.time_s[first:] - 0.5 * dt, site.height_m), vertical.gains(), ends,
        _floats(quaternion_from_dcm(C_en @ initial.C_nb)), _floats(C_en @ initial.v_n_m_s),
        _floats(ecef_from_geodetic(site.lat_rad, site.lon_rad, site.height_m)),
        geodetic, v_n, C_nb, C_nb_dt, sums,
    )  # fmt: skip
    return NavHistory(
        time_s=np.concatenate([[initial.time_s], imu.time_s[first:][ends[1:] - 1]]),
        lat_rad=geodetic[:, 0], lon_rad=geodetic[:, 1], height_m=geodetic[:, 2], v_n_m_s=v_n, C_nb=C_nb,
        C_nb_dt=C_nb_dt, displacement_n_m=sums[:, :3], displacement_b_m=sums[:, 3:6], dv_f_n_m_s=sums[:, 6:9],
        dtheta_b_rad=sums[:, 9:],
    )  # fmt: skip


def _floats(values: NDArray) -> tuple[float, ...]:
    return tuple(float(x) for x in values)


def _interval_before(imu: ImuLog, first: int) -> NDArray:
    """dtheta, dv, dt of the interval before row `first`; where there is none, that row itself: no slope."""
    k = max(first - 1, 0)
    return np.concatenate([imu.dtheta_rad[k], imu.dv_m_s[k], imu.dt_s[k : k + 1]])


def _epoch_ends(time_s: NDArray, start_s: float, epoch_s: float | None) -> NDArray:
    """How many rows are used up at each epoch end; starts with 0."""
    if epoch_s is None:
        return np.arange(time_s.size + 1)
    if not 0 < epoch_s < np.inf:
        raise InputError(f"epoch_s {epoch_s}, needed above 0")
    edges = np.concatenate([[start_s], time_s])
    half_step = 0.5 * (edges[-1] - edges[-2])
    count = int(np.floor((edges[-1] + half_step - start_s) / epoch_s + 1e-9))
    targets = start_s + epoch_s * np.arange(1, count + 1)
    after = np.clip(np.searchsorted(edges, targets), 1, edges.size - 1)
    nearest = after - (targets - edges[after - 1] < edges[after] - targets)
    return np.unique(np.concatenate([[0], nearest]))


def _check(imu: ImuLog, initial: NavState, first: int, vertical: VerticalChannel) -> None:
    """Raise InputError unless the rows from `first` on can be navigated from `initial`."""
    if first == imu.time_s.size:
        raise InputError(f"imu: ends at {imu.time_s[-1]:.6g} s, needed rows after the initial {initial.time_s:.6g} s")
    dt = imu.dt_s[first:]
    finite = np.isfinite(imu.dtheta_rad).all(axis=1) & np.isfinite(imu.dv_m_s).all(axis=1) & (imu.dt_s > 0)
    if not finite[first:].all():
        k = first + int(np.argmin(finite[first:]))
        raise InputError(f"imu: row {k} at {imu.time_s[k]:.6g} s, needed finite increments and dt_s above 0")
    late = imu.time_s[first] - dt[0] - initial.time_s
    if late > dt[0]:
        raise InputError(
            f"imu: first row starts {late:.6g} s after the initial state at {initial.time_s:.6g} s, needed at it"
        )
    C = initial.C_nb
    if not (np.abs(C.T @ C - np.eye(3)).max() < ORTHONORMAL_TOLERANCE and np.linalg.det(C) > 0):
        raise InputError("initial C_nb is not a rotation matrix")
    if not np.isfinite(initial.v_n_m_s).all():
        raise InputError(f"initial v_n_m_s {initial.v_n_m_s}, needed finite")
    if vertical.mode != "free" and vertical.time_constant_s < MIN_STEPS_PER_TIME_CONSTANT * np.median(dt):
        raise InputError(
            f"VerticalChannel.time_constant_s {vertical.time_constant_s:.6g} s, needed at least "
            f"{MIN_STEPS_PER_TIME_CONSTANT} intervals of {np.median(dt):.6g} s"
        )
