"""Loosely coupled navigation: increments, satellite fixes and standstills to a solution with sigmas
(`ins.filters.aided_kernel`).

The filter steps at each fix and at least every STEP_S, so that attitude and specific force are the
step's own. It is causal: a row holds what was known at its time, and what its start was found with
(a gyrocompass uses all of its rest). Fed in parts, it gives the same bits however the log is cut.
"""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.stats import chi2

from ins.earth import ecef_from_geodetic
from ins.records import GnssLog, ImuLog, InputError, NavState, frozen_array
from ins.strapdown.start import check_initial, check_rows, earth_frame_state, interval_at

STEP_S = 0.2
KINDS = ("position", "velocity")
ROUNDING = 1e-9  # of the trace: how negative an eigenvalue of a covariance may be
REJECT_PROBABILITY = 1e-6  # of a good fix, by the gate on the NIS of its three components


@dataclass(frozen=True, kw_only=True)
class AidedNoise:
    """Densities, SI: arw [rad/sqrt(s)], vrw [m/s/sqrt(s)], walks of the biases [rad/s/sqrt(s)],
    [m/s^2/sqrt(s)].

    slow_level_m, slow_down_m, slow_velocity_m_s: sigmas of the receiver's slow errors, beside the
    fixes' own; slow_s, slow_velocity_s: their time constants.
    """

    arw: float
    vrw: float
    gyro_walk: float
    accel_walk: float
    slow_level_m: float = 0.0
    slow_down_m: float = 0.0
    slow_s: float = 200.0
    slow_velocity_m_s: float = 0.0
    slow_velocity_s: float = 3.0


@dataclass(frozen=True, kw_only=True)
class AidedStart:
    """Where the filter starts: state, biases still in the increments [rad/s], [m/s^2], covariance
    of its errors (15, 15) (order and signs: `ins.filters.aided_kernel`).
    """

    state: NavState
    gyro_bias_rad_s: NDArray
    accel_bias_m_s2: NDArray
    covariance: NDArray


@dataclass(frozen=True, kw_only=True)
class Antenna:
    """What the fixes are of: lever arm (3,) from the IMU [m], delays [s] by which positions and
    velocities are older than their time, and the covariance (5, 5) of these errors. estimated: by
    the filter; else considered: as they are, with what that costs.
    """

    lever_arm_m: NDArray
    delay_s: float = 0.0
    velocity_delay_s: float = 0.0
    covariance: NDArray = field(default_factory=lambda: np.zeros((5, 5)))
    estimated: bool = False

    def later(self, seconds: float) -> "Antenna":
        """Both delays longer by so much."""
        return replace(
            self, delay_s=self.delay_s + seconds, velocity_delay_s=self.velocity_delay_s + seconds
        )


@dataclass(frozen=True, kw_only=True)
class Fixes:
    """Satellite fixes as the filter takes them, ECEF position (n, 3) [m], v_n (n, 3) [m/s], sigmas
    (n, 3) of the NED components; NaN: not measured.
    """

    time_s: NDArray
    r_e_m: NDArray
    v_n_m_s: NDArray
    sigma_position_m: NDArray
    sigma_velocity_m_s: NDArray

    def earlier(self, latency_s: float) -> "Fixes":
        """The same fixes, each `latency_s` before its time."""
        return self if latency_s == 0.0 else replace(self, time_s=self.time_s - latency_s)

    def scaled(self, position: float, velocity: float) -> "Fixes":
        """The same fixes with sigmas this many times as large."""
        return replace(
            self,
            sigma_position_m=position * self.sigma_position_m,
            sigma_velocity_m_s=velocity * self.sigma_velocity_m_s,
        )


@dataclass(frozen=True, kw_only=True)
class AidedHistory:
    """The solution at about 1 Hz, its sigmas, and what became of each fix.

    gyro_bias_rad_s, accel_bias_m_s2 (k, 3): the biases taken off beyond what the log was
    compensated with; variance (k, 15): of the errors; phi_covariance (k, 3, 3): of the NED attitude
    error; covariance (k, 15, 15): where asked. residual, sigma (n, 6): of the fixes, position then
    velocity, NED, NaN where unseen; nis, used, loglik (n, 2). antenna: as it is known at the end.
    """

    time_s: NDArray
    lat_rad: NDArray
    lon_rad: NDArray
    height_m: NDArray
    v_n_m_s: NDArray
    C_nb: NDArray
    gyro_bias_rad_s: NDArray
    accel_bias_m_s2: NDArray
    variance: NDArray
    phi_covariance: NDArray
    covariance: NDArray
    fix_time_s: NDArray
    residual: NDArray
    sigma: NDArray
    nis: NDArray
    used: NDArray
    loglik: NDArray
    stand_nis: float
    stand_dof: int
    antenna: Antenna


def fixes_of(log: GnssLog, *, horizontal_m: float, vertical_m: float, velocity_m_s: float) -> Fixes:
    """A GNSS log with a sigma for each component: as logged, else as declared (these arguments)."""

    def sigma(logged: NDArray | None, declared: float) -> NDArray:
        if logged is None:
            return np.full(log.time_s.size, declared)
        return np.where(np.isfinite(logged) & (logged > 0), logged, declared)

    level, down = (
        sigma(log.sigma_horizontal_m, horizontal_m),
        sigma(log.sigma_vertical_m, vertical_m),
    )
    speed = sigma(log.sigma_velocity_m_s, velocity_m_s)
    seen = np.isfinite(log.lat_rad) & np.isfinite(log.lon_rad) & np.isfinite(log.height_m)
    r_e = np.full((log.time_s.size, 3), np.nan)
    r_e[seen] = ecef_from_geodetic(log.lat_rad[seen], log.lon_rad[seen], log.height_m[seen])
    v_n = np.where(np.isfinite(log.v_n_m_s).all(axis=1)[:, None], log.v_n_m_s, np.nan)
    return Fixes(
        time_s=log.time_s,
        r_e_m=r_e,
        v_n_m_s=v_n,
        sigma_position_m=np.column_stack([level, level, down]),
        sigma_velocity_m_s=np.column_stack([speed, speed, speed]),
    )


ON_UNIT = Antenna(lever_arm_m=np.zeros(3))


class AidedNavigator:
    """Aided navigation of a log that comes in parts: `feed` each in turn, then `finish`.

    stands (k, 2): spans in which the vehicle stands [s], each a measurement a second of no
    velocity, sigma stand_sigma_m_s, and, where stand_rate_rad_s is above 0, of no turn but Earth's,
    to that and the gyros' noise. reset_s: a solution whose fixes were all rejected for so long is
    begun anew at the next. output_s: interval of the rows. keep_covariance: also all of P at each
    row.
    """

    def __init__(
        self,
        start: AidedStart,
        noise: AidedNoise,
        fixes: Fixes,
        *,
        antenna: Antenna = ON_UNIT,
        stands: ArrayLike = (),
        stand_sigma_m_s: float = 0.01,
        stand_rate_rad_s: float = 0.0,
        reset_s: float = 120.0,
        output_s: float = 1.0,
        keep_covariance: bool = False,
    ) -> None:
        from ins.filters import aided_kernel as kernel
        from ins.strapdown.kernel import BEFORE, COLUMNS, CORRECTION, STATE_SIZE, U

        check_initial(start.state)
        P = np.zeros((kernel.N, kernel.N))
        P[: kernel.MOTION, : kernel.MOTION] = _covariance(
            start.covariance, kernel.MOTION, "AidedStart.covariance"
        )
        slow_m = np.array([noise.slow_level_m, noise.slow_level_m, noise.slow_down_m])
        P[kernel.B_ : kernel.W_, kernel.B_ : kernel.W_] = np.diag(slow_m**2)
        P[kernel.W_ : kernel.L_, kernel.W_ : kernel.L_] = noise.slow_velocity_m_s**2 * np.eye(3)
        P[kernel.L_ :, kernel.L_ :] = _covariance(antenna.covariance, 5, "Antenna.covariance")
        self._kernel, self._start, self._before = kernel, start.state, slice(BEFORE, U)
        self._state, self._opened = np.zeros(STATE_SIZE), np.zeros(COLUMNS)
        self._state[:CORRECTION] = earth_frame_state(start.state)
        biases = start.gyro_bias_rad_s, start.accel_bias_m_s2
        delays = antenna.delay_s, antenna.velocity_delay_s
        self._bias = np.concatenate([*biases, np.zeros(6), antenna.lever_arm_m, delays]).astype(
            float
        )
        self._trail = np.zeros((kernel.TRAIL_ROWS, kernel.TRAIL))
        self._x, self._P, self._carry = np.zeros(kernel.N), P, np.zeros(kernel.CARRY)
        self._carry[kernel.V_BEFORE : kernel.V_BEFORE + 3] = start.state.v_n_m_s
        self._carry[kernel.STEPS] = 1.0  # the first row of the trail is the start
        slow = *slow_m[1:], noise.slow_s, noise.slow_velocity_m_s, noise.slow_velocity_s
        self._noise = np.array([noise.arw, noise.vrw, noise.gyro_walk, noise.accel_walk, *slow])
        self._settings = np.array(
            [
                chi2.isf(REJECT_PROBABILITY, 3),
                stand_sigma_m_s,
                reset_s,
                stand_rate_rad_s,
                float(not antenna.estimated),
            ]
        )
        self._antenna, self._fixes = antenna, fixes
        self._fix_rows = np.column_stack(
            [fixes.r_e_m, fixes.v_n_m_s, fixes.sigma_position_m**2, fixes.sigma_velocity_m_s**2]
        )
        self._fix_out = np.full((fixes.time_s.size, kernel.FIX), np.nan)
        self._fix_out[:, kernel.F_USED : kernel.F_LOGLIK] = kernel.UNSEEN
        self._stands = np.asarray(stands, dtype=float).reshape(-1, 2)
        self._output_s, self._keep = output_s, keep_covariance
        self._last_s, self._started = start.state.time_s, False
        self._rows: list[NDArray] = []
        self._times_s: list[NDArray] = []
        self._P_rows: list[NDArray] = []

    def feed(self, imu: ImuLog) -> None:
        """Use the rows of `imu` after those used before (at first: after the start); InputError
        where one is not finite.
        """
        first = int(np.searchsorted(imu.time_s, self._last_s, side="right"))
        if first == imu.time_s.size:
            return
        check_rows(imu, first, 0)
        time_s, dt = imu.time_s[first:], imu.dt_s[first:]
        dtheta, dv = imu.dtheta_rad[first:], imu.dv_m_s[first:]
        if not self._started:
            before = interval_at(imu, max(first - 1, 0))
            self._state[self._before], self._started = (
                interval_at(imu, first) if before is None else before,
                True,
            )
        ends, fix_of, late_s, stands, emits = self._steps(time_s)
        rows = np.zeros((int(emits.sum()), self._kernel.OUT))
        P_rows = np.zeros((len(rows) if self._keep else 0, 15, 15))
        self._kernel.run(
            dt,
            dtheta,
            dv,
            ends,
            fix_of,
            late_s,
            stands,
            emits,
            self._state,
            self._opened,
            self._carry,
            self._bias,
            self._x,
            self._P,
            self._noise,
            self._settings,
            self._trail,
            self._fix_rows,
            self._fix_out,
            rows,
            P_rows,
        )
        self._rows.append(rows)
        self._P_rows.append(P_rows)
        self._times_s.append(time_s[ends - 1][emits])
        self._last_s = float(time_s[-1])

    def _steps(self, time_s: NDArray) -> tuple[NDArray, ...]:
        """Where steps end in this piece, the fix at each end, how late it is, whether it stands,
        whether it is put out.
        """
        t0, before = self._start.time_s, np.append(self._last_s, time_s[:-1])
        tick, tick_before = (np.floor((t - t0) / STEP_S + 1e-6) for t in (time_s, before))
        second = np.floor((time_s - t0) + 1e-6) > np.floor((before - t0) + 1e-6)
        put_out = np.floor((time_s - t0) / self._output_s + 1e-6) > np.floor(
            (before - t0) / self._output_s + 1e-6
        )
        # the first row not before the fix
        fix_row = np.searchsorted(time_s, self._fixes.time_s - 1e-6)
        here = np.flatnonzero((self._fixes.time_s > self._last_s + 1e-6) & (fix_row < time_s.size))
        fix_at = np.full(time_s.size, -1, dtype=np.int64)
        fix_at[fix_row[here]] = here  # of several between two rows, the last
        rows = np.flatnonzero((tick > tick_before) | (fix_at >= 0) | put_out)
        late = np.where(fix_at >= 0, np.minimum(self._fixes.time_s[fix_at] - time_s, 0.0), 0.0)
        number = np.searchsorted(self._stands[:, 0], time_s, side="left") - 1
        stood = (
            (number >= 0) & (time_s <= self._stands[number, 1])
            if self._stands.size
            else np.zeros(time_s.size, bool)
        )
        return rows + 1, fix_at[rows], late[rows], (stood & second)[rows], put_out[rows]

    def finish(self) -> AidedHistory:
        """The solution up to here."""
        if not any(len(rows) for rows in self._rows):
            raise InputError(
                f"imu: ends at {self._last_s:.6g} s, needed a second of rows after"
                f" {self._start.time_s:.6g} s"
            )
        k, rows, fix = self._kernel, np.concatenate(self._rows), self._fix_out
        return AidedHistory(
            time_s=np.concatenate(self._times_s),
            lat_rad=rows[:, 0],
            lon_rad=rows[:, 1],
            height_m=rows[:, 2],
            v_n_m_s=rows[:, 3:6],
            C_nb=rows[:, 6:15].reshape(-1, 3, 3),
            gyro_bias_rad_s=rows[:, k.O_BIAS : k.O_BIAS + 3],
            accel_bias_m_s2=rows[:, k.O_BIAS + 3 : k.O_VAR],
            variance=rows[:, k.O_VAR : k.O_PHI],
            phi_covariance=rows[:, k.O_PHI :].reshape(-1, 3, 3),
            covariance=np.concatenate(self._P_rows),
            fix_time_s=self._fixes.time_s,
            residual=fix[:, : k.F_SIGMA],
            sigma=fix[:, k.F_SIGMA : k.F_NIS],
            nis=fix[:, k.F_NIS : k.F_USED],
            used=fix[:, k.F_USED : k.F_LOGLIK].astype(int),
            loglik=fix[:, k.F_LOGLIK :],
            stand_nis=float(self._carry[k.STAND_NIS]),
            stand_dof=int(self._carry[k.STOOD]),
            antenna=replace(
                self._antenna,
                lever_arm_m=self._bias[k.B_LEVER : k.B_DELAY].copy(),
                delay_s=float(self._bias[k.B_DELAY]),
                velocity_delay_s=float(self._bias[k.B_VELOCITY_DELAY]),
                covariance=self._P[k.L_ :, k.L_ :].copy(),
            ),
        )


def _covariance(P: NDArray, size: int, name: str) -> NDArray:
    P = frozen_array(P, (size, size), name)
    if not (np.isfinite(P).all() and np.linalg.eigvalsh(P).min() >= -ROUNDING * np.trace(P)):
        raise InputError(f"{name}: needed finite and positive semidefinite")
    return P


def level_sigmas(phi_covariance: NDArray, C_nb: NDArray) -> NDArray:
    """Sigmas (k, 3) of roll, pitch, heading [rad] from the covariance of the NED attitude error (k,
    3, 3).

    Roll and pitch errors are those about the level body axes; at a pitch near 90 deg roll and
    heading are not separate.
    """
    forward = C_nb[:, :2, 0] / np.maximum(np.linalg.norm(C_nb[:, :2, 0], axis=1), 1e-9)[:, None]
    cos_pitch = np.maximum(np.linalg.norm(C_nb[:, :2, 0], axis=1), 1e-9)
    tan_pitch = -C_nb[:, 2, 0] / cos_pitch
    zero, one = np.zeros(len(C_nb)), np.ones(len(C_nb))
    roll = np.column_stack([forward / cos_pitch[:, None], zero])
    pitch = np.column_stack([-forward[:, 1], forward[:, 0], zero])
    heading = np.column_stack([forward * tan_pitch[:, None], one])
    return np.stack(
        [np.sqrt(np.einsum("ki,kij,kj->k", r, phi_covariance, r)) for r in (roll, pitch, heading)],
        axis=1,
    )
