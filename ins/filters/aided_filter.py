"""Loosely coupled navigation: increments, satellite fixes and standstills to a solution with sigmas
(`ins.filters.aided_kernel`).

The filter steps at each fix and at least every STEP_S, so that attitude and specific force are the
step's own. It is causal: a row holds what was known at its time, and what its start was found with
(a gyrocompass uses all of its rest). Fed in parts, it gives the same bits however the log is cut.

Decision: docs/decisions/0076-mean-specific-force.md.
Decision: docs/decisions/0063-leaps.md.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ins.filters.aided_records import (
    REJECTED,
    UNSEEN,
    USED,
    AidedHistory,
    AidedNoise,
    AidedOptions,
    AidedStart,
    Antenna,
    Fixes,
)
from ins.filters.aided_tape import TAPED_PHI, AidedTape, TapedPiece
from ins.filters.states import (
    AIDED_ACCEL_SCALE,
    AIDED_DEFLECTION,
    AIDED_GYRO_SCALE,
    AIDED_LEVER,
    AIDED_MISALIGNED,
    AIDED_MOTION,
    AIDED_SLOW_OTHER,
    AIDED_SLOW_POS,
    AIDED_SLOW_VEL,
    AIDED_STATES,
)
from ins.records import ImuLog, InputError, frozen_array
from ins.robust import chi2
from ins.strapdown.start import check_initial, check_rows, earth_frame_state, interval_at

STEP_S = 0.2
KINDS = ("position", "velocity")
# of the trace: how negative an eigenvalue of a covariance may be; a file of ten digits has 1e-10
ROUNDING = 1e-9
REJECT_PROBABILITY = 1e-6  # of a good fix, by the gate on the NIS of its three components
ANTENNA = slice(AIDED_LEVER.start, AIDED_STATES)  # states of lever arm and delays
OF_SCALES = slice(AIDED_MOTION, AIDED_DEFLECTION.start)  # of scales and misalignments
ON_UNIT = Antenna(lever_arm_m=np.zeros(3))
DEFAULTS = AidedOptions()


class AidedNavigator:
    """Aided navigation of a log that comes in parts: `feed` each in turn, then `finish`.

    Parameters
    ----------
    start : AidedStart
    noise : AidedNoise
    fixes : Fixes
    antenna : Antenna
        Where and when the fixes are measured.
    options : AidedOptions

    Raises
    ------
    InputError
        Where the start is no state, or a covariance not positive semidefinite.
    """

    def __init__(
        self,
        start: AidedStart,
        noise: AidedNoise,
        fixes: Fixes,
        *,
        antenna: Antenna = ON_UNIT,
        options: AidedOptions = DEFAULTS,
    ) -> None:
        from ins.filters import aided_kernel as kernel
        from ins.strapdown.kernel import BEFORE, CORRECTION, HISTORY_COLUMNS, STATE_SIZE, U

        check_initial(start.state)
        self._kernel, self._start, self._before = kernel, start.state, slice(BEFORE, U)
        self._state, self._opened = np.zeros(STATE_SIZE), np.zeros(HISTORY_COLUMNS)
        self._state[:CORRECTION] = earth_frame_state(start.state)
        self._bias = _taken_off(start, antenna)
        self._trail = np.zeros((kernel.TRAIL_ROWS, kernel.TRAIL))
        self._x, self._P = np.zeros(kernel.N), _prior(start, noise, antenna)
        self._carry = np.zeros(kernel.CARRY)
        self._carry[kernel.V_BEFORE : kernel.V_BEFORE + 3] = start.state.v_n_m_s
        self._carry[kernel.STEPS] = 1.0  # the first row of the trail is the start
        self._noise = _noise_values(noise)
        self._settings = _settings(
            options, antenna, scaled=bool(self._P[OF_SCALES, OF_SCALES].any())
        )
        self._antenna, self._fixes = antenna, fixes
        self._fix_rows = np.column_stack(
            [
                fixes.r_e_m,
                fixes.v_n_m_s,
                fixes.sigma_position_m**2,
                fixes.sigma_velocity_m_s**2,
                fixes.other_type,
            ]
        )
        self._fix_out = np.full((fixes.time_s.size, kernel.FIX), np.nan)
        self._fix_out[:, kernel.F_USED : kernel.F_LOGLIK] = UNSEEN
        self._wheels = options.wheels
        self._rolled, self._mount = options.wheels.rows, options.wheels.mount
        self._roll_out = np.zeros(options.wheels.time_s.size, dtype=np.int64)
        self._stands = np.asarray(options.stands, dtype=float).reshape(-1, 2)
        self._output_s, self._keep = options.output_s, options.keep_covariance
        self._last_s, self._started = start.state.time_s, False
        self._step_from_s = start.state.time_s
        self._rows: list[NDArray] = []
        self._times_s: list[NDArray] = []
        self._P_rows: list[NDArray] = []
        self._tape: list[TapedPiece] = []
        self._P_start, self._taping = self._P.copy(), options.keep_tape

    def feed(self, imu: ImuLog) -> None:
        """Use the rows of a part of the log after those used before (at first: after the start).

        Parameters
        ----------
        imu : ImuLog
            The next part.

        Raises
        ------
        InputError
            Where a row is not finite.
        """
        first = int(np.searchsorted(imu.time_s, self._last_s, side="right"))
        if first == imu.time_s.size:
            return
        check_rows(imu, first, 0)
        time_s, dt = imu.time_s[first:], imu.dt_s[first:]
        dtheta, dv = imu.dtheta_rad[first:], imu.dv_m_s[first:]
        if not self._started:
            before = interval_at(imu, max(first - 1, 0))
            self._state[self._before] = interval_at(imu, first) if before is None else before
            self._started = True
        ends, fix_of, late_s, stands, emits, roll_of = self._steps(time_s)
        rows = np.zeros((int(emits.sum()), self._kernel.OUT))
        kept = AIDED_STATES if self._taping else AIDED_MOTION
        P_rows = np.zeros((len(rows) if self._keep or self._taping else 0, kept, kept))
        used = 6 * int(stands.sum()) + 7 * int((fix_of >= 0).sum()) + 3 * int((roll_of >= 0).sum())
        taped = TapedPiece(
            step_s=np.diff(np.concatenate([[self._step_from_s], time_s[ends - 1]])),
            phis=np.zeros((ends.size if self._taping else 0, *TAPED_PHI)),
            measurements=np.zeros((used if self._taping else 0, self._kernel.TAPE)),
            ends=np.zeros(ends.size if self._taping else 0, dtype=np.int64),
            emits=emits,
            P_rows=P_rows,
        )
        turned, pushed = np.empty(dtheta.shape), np.empty(dv.shape)
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
            taped.phis,
            taped.measurements,
            taped.ends,
            turned,
            pushed,
            _read_only(turned),
            _read_only(pushed),
            roll_of,
            self._rolled,
            self._mount,
            self._roll_out,
        )
        self._rows.append(rows)
        self._P_rows.append(P_rows[:, :AIDED_MOTION, :AIDED_MOTION] if self._keep else P_rows[:0])
        if self._taping:
            self._tape.append(taped.shortened())
        self._step_from_s = float(time_s[ends[-1] - 1]) if ends.size else self._step_from_s
        self._times_s.append(time_s[ends - 1][emits])
        self._last_s = float(time_s[-1])

    def _steps(self, time_s: NDArray) -> tuple[NDArray, ...]:
        """Where steps end in this piece, the fix at each end, how late it is, whether it stands,
        whether it is put out.
        """
        since = np.append(self._last_s, time_s) - self._start.time_s
        ticks, second = _passes(since, STEP_S), _passes(since, 1.0)
        put_out = second if self._output_s == 1.0 else _passes(since, self._output_s)
        # the first row not before the fix
        fix_row = np.searchsorted(time_s, self._fixes.time_s - 1e-6)
        here = np.flatnonzero((self._fixes.time_s > self._last_s + 1e-6) & (fix_row < time_s.size))
        fix_at = np.full(time_s.size, -1, dtype=np.int64)
        fix_at[fix_row[here]] = here  # of several between two rows, the last
        roll_row = np.searchsorted(time_s, self._wheels.time_s - 1e-6)
        there = np.flatnonzero(
            (self._wheels.time_s > self._last_s + 1e-6) & (roll_row < time_s.size)
        )
        roll_at = np.full(time_s.size, -1, dtype=np.int64)
        roll_at[roll_row[there]] = there
        rows = np.flatnonzero(ticks | (fix_at >= 0) | (roll_at >= 0) | put_out)
        ends_s, fix = time_s[rows], fix_at[rows]
        late = np.zeros(rows.size)
        if here.size:
            late = np.where(fix >= 0, np.minimum(self._fixes.time_s[fix] - ends_s, 0.0), 0.0)
        stands = np.zeros(rows.size, dtype=bool)
        if self._stands.size:
            number = np.searchsorted(self._stands[:, 0], ends_s, side="left") - 1
            stands = (number >= 0) & (ends_s <= self._stands[number, 1]) & second[rows]
        return rows + 1, fix, late, stands, put_out[rows], roll_at[rows]

    @property
    def tape(self) -> AidedTape:
        """What `ins.filters.aided_smoother` needs, up to here.

        Raises
        ------
        InputError
            Where none was kept (`AidedOptions.keep_tape`).
        """
        if not self._taping:
            raise InputError("AidedOptions.keep_tape: needed for a smoother")
        return AidedTape(pieces=tuple(self._tape), P_start=self._P_start, noise=self._noise)

    def finish(self) -> AidedHistory:
        """The solution up to here.

        Returns
        -------
        history : AidedHistory

        Raises
        ------
        InputError
            Where the log ends within a second of the start.
        """
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
            covariance=np.concatenate([p[:, :AIDED_MOTION, :AIDED_MOTION] for p in self._P_rows]),
            fix_time_s=self._fixes.time_s,
            residual=fix[:, : k.F_SIGMA],
            sigma=fix[:, k.F_SIGMA : k.F_NIS],
            nis=fix[:, k.F_NIS : k.F_USED],
            used=fix[:, k.F_USED : k.F_LOGLIK].astype(int),
            loglik=fix[:, k.F_LOGLIK :],
            stand_nis=float(self._carry[k.STAND_NIS]),
            stand_dof=int(self._carry[k.STOOD]),
            rolled=(int((self._roll_out == USED).sum()), int((self._roll_out == REJECTED).sum())),
            antenna=replace(
                self._antenna,
                lever_arm_m=self._bias[k.B_LEVER : k.B_DELAY].copy(),
                delay_s=float(self._bias[k.B_DELAY]),
                velocity_delay_s=float(self._bias[k.B_VELOCITY_DELAY]),
                covariance=self._P[k.L_ :, k.L_ :].copy(),
            ),
            scales=self._bias[k.B_SCALE : k.B_SLOW].copy(),
            scales_covariance=self._P[OF_SCALES, OF_SCALES].copy(),
            shaking=(float(self._carry[k.SHAKEN_LEAST]), float(self._carry[k.SHAKEN_MOST])),
        )


def _passes(since_s: NDArray, step_s: float) -> NDArray:
    """Which rows (n,) are the first at or after a multiple of a step; since_s (n + 1,): their
    times, the last one before them first.
    """
    step = np.floor(since_s / step_s + 1e-6)
    return np.asarray(step[1:] > step[:-1])


def _prior(start: AidedStart, noise: AidedNoise, antenna: Antenna) -> NDArray:
    """Covariance (43, 43) of all errors at the start."""
    P = np.zeros((AIDED_STATES, AIDED_STATES))
    motion = slice(0, AIDED_MOTION)
    P[motion, motion] = _covariance(start.covariance, AIDED_MOTION, "AidedStart.covariance")
    for part, sigma in (
        (AIDED_GYRO_SCALE, noise.gyro_scale),
        (AIDED_MISALIGNED, noise.misalignment_rad),
        (AIDED_ACCEL_SCALE, noise.accel_scale),
        (AIDED_DEFLECTION, noise.deflection_rad),
    ):
        P[part, part] = sigma**2 * np.eye(part.stop - part.start)
    slow_m = np.array([noise.slow_level_m, noise.slow_level_m, noise.slow_down_m])
    P[AIDED_SLOW_POS, AIDED_SLOW_POS] = np.diag(slow_m**2)
    other_m = np.array(
        [noise.slow_other_level_m, noise.slow_other_level_m, noise.slow_other_down_m]
    )
    P[AIDED_SLOW_OTHER, AIDED_SLOW_OTHER] = np.diag(other_m**2)
    P[AIDED_SLOW_VEL, AIDED_SLOW_VEL] = noise.slow_velocity_m_s**2 * np.eye(3)
    P[ANTENNA, ANTENNA] = _covariance(antenna.covariance, 5, "Antenna.covariance")
    return P


def _taken_off(start: AidedStart, antenna: Antenna) -> NDArray:
    """What the kernel takes off: biases, scales and slow errors (none yet), lever arm,
    delays, deflection (none yet) (34,).
    """
    biases = start.gyro_bias_rad_s, start.accel_bias_m_s2
    delays = antenna.delay_s, antenna.velocity_delay_s
    return np.concatenate([*biases, np.zeros(21), antenna.lever_arm_m, delays, np.zeros(2)]).astype(
        float
    )


def _noise_values(noise: AidedNoise) -> NDArray:
    """The noise in the order of the kernel."""
    densities = noise.arw, noise.vrw, noise.gyro_walk, noise.accel_walk
    slow_positions = noise.slow_level_m, noise.slow_down_m, noise.slow_s
    slow_velocities = noise.slow_velocity_m_s, noise.slow_velocity_s
    vertical = noise.deflection_rad, noise.deflection_m
    others = vertical + (noise.slow_other_level_m, noise.slow_other_down_m)
    return np.array(
        [*densities, *slow_positions, *slow_velocities, noise.stirred, *others, noise.shaken]
    )


def _settings(options: AidedOptions, antenna: Antenna, *, scaled: bool) -> NDArray:
    """The settings in the order of the kernel."""
    gate = chi2.isf(REJECT_PROBABILITY, 3)
    consider = float(not antenna.estimated)
    stand = options.stand_sigma_m_s
    rate = options.stand_rate_rad_s
    return np.array([gate, stand, options.reset_s, rate, consider, float(scaled)])


def _covariance(P: NDArray, size: int, name: str) -> NDArray:
    P = frozen_array(P, (size, size), name)
    if not (np.isfinite(P).all() and np.linalg.eigvalsh(P).min() >= -ROUNDING * np.trace(P)):
        raise InputError(f"{name}: needed finite and positive semidefinite")
    return P


def level_sigmas(phi_covariance: NDArray, C_nb: NDArray) -> NDArray:
    """Sigmas of roll, pitch and heading from the covariance of the NED attitude error.

    Parameters
    ----------
    phi_covariance : ndarray, shape (k, 3, 3)
        In rad^2.
    C_nb : ndarray, shape (k, 3, 3)

    Returns
    -------
    sigma_rad : ndarray, shape (k, 3)

    Notes
    -----
    Roll and pitch errors are those about the level body axes. At a pitch near 90 deg roll and
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


def _read_only(rows: NDArray) -> NDArray:
    """The same memory, not to be written through."""
    seen = rows.view()
    seen.flags.writeable = False
    return seen
