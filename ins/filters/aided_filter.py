"""Satellite-aided navigation: increments, fixes and standstills to a solution with sigmas.

The errors of a reference are estimated by one sweep of the estimator (`ins.filters.aided_tape`).
The reference is a solution of the same log, set anew each second: nothing that it was found with
counts. The first one (`first_about`) is fed back, a window of some seconds after the other, each
begun where the last one ended; the next is what all fixes make of it. A solution (`solved`) is
causal: a row holds what was known at its time, and what its start and its reference were found
with; or, smoothed, what the whole log tells.

Decision: docs/decisions/0076-mean-specific-force.md.
Decision: docs/decisions/0063-leaps.md.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ins.attitude import dcm_from_rotation_vector, skew
from ins.earth import SEMI_MAJOR_AXIS_M, dcm_en, ecef_from_geodetic, geodetic_from_ecef
from ins.estimation.error_filter import ErrorFilter, FedBack, Response
from ins.estimation.states import BASE
from ins.estimation.tape import LEAPT, RENEW, RENEWED, USED
from ins.filters import aided_records as records
from ins.filters.aided_records import NO_WHEELS, AidedHistory, AidedNoise, AidedStart
from ins.filters.aided_tape import (
    ANTENNA,
    GATE_NIS,
    MOTION,
    ROLL,
    SCALES,
    STAND,
    Laid,
    Task,
    aided_filter,
    aided_tape,
    fed_back,
)
from ins.filters.reference import SHAKEN_S, About, Rows
from ins.filters.states import AIDED_GYRO, AIDED_MOTION, AIDED_POS, AIDED_THETA, AIDED_VEL
from ins.records import ImuSource
from ins.strapdown.start import check_rows

KINDS = ("position", "velocity")
ROW_FIELDS = (
    "time_s",
    "lat_rad",
    "lon_rad",
    "height_m",
    "v_n_m_s",
    "C_nb",
    "gyro_bias_rad_s",
    "accel_bias_m_s2",
    "variance",
    "phi_covariance",
    "covariance",
)
# of an antenna that is free: flights, each linearised about what the last one found; what it may
# still be off, m and s: 0.01 s at a change of 3 m/s^2 is a velocity's sigma
ANTENNA_PASSES, SETTLED = 3, np.array([0.3, 0.3, 0.3, 0.01, 0.01])
SEARCHED = 5.0  # times that in a search of noise: 0.05 s are off by 0.013 m/s at 10 m/s^3
# of a reference: nothing of it counts, so it follows the fixes whatever the sensors do
LOUDER, WIDEST_WALK = (8.0, 64.0, 512.0, 4096.0), 32.0
# of fixes, a log with 28 of 679 (0.04) wild ones needed no more noise; and of those that were
# rejected before, chosen
MOST_REJECTED, LESS_REJECTED = 0.05, 0.7
POLE_TAN = 1e6  # of the latitude


def solved(about: About, task: Task, *, smooth: bool = False, rows: bool = True) -> AidedHistory:
    """The solution of a log under a task.

    Parameters
    ----------
    about : About
        What its errors are linearised about.
    task : Task
    smooth : bool
        Given all fixes; the antenna is then estimated, else as the task says.
    rows : bool
        Else what the fixes say alone, which a search of noise asks for.

    Returns
    -------
    history : AidedHistory

    Raises
    ------
    InputError
        Where the start is no state, or a covariance not positive semidefinite.
    """
    if smooth:
        task = replace(task, antenna=replace(task.antenna, estimated=True))
    free = task.antenna.estimated and task.antenna.covariance.any()
    prior = np.append(task.antenna.values, task.antenna.covariance).tobytes()
    if free:
        task = replace(task, near=about.near.get(prior))
    whole = _with_start(about, task, smooth=smooth, rows=rows)
    settled = SETTLED if rows else SEARCHED * SETTLED
    for _ in range(ANTENNA_PASSES if free else 0):
        if (np.abs(whole.antenna.values - task.linearised.values) < settled).all():
            break
        task = replace(task, near=whole.antenna)
        about.near[prior] = whole.antenna
        whole = _with_start(about, task, smooth=smooth, rows=rows)
    return without_start(whole)


def without_start(history: AidedHistory) -> AidedHistory:
    """A solution without where it starts.

    Parameters
    ----------
    history : AidedHistory

    Returns
    -------
    history : AidedHistory
    """
    columns = {k: v[1:] for k, v in vars(history).items() if k in ROW_FIELDS}
    return replace(history, **columns)


def first_about(imu: ImuSource, task: Task, end_s: float = np.inf) -> About:
    """A reference for a log: fed back, then smoothed.

    Parameters
    ----------
    imu : ImuSource
    task : Task
    end_s : float
        Of the log that is asked for.

    Returns
    -------
    about : About

    Raises
    ------
    InputError
        Where the log ends within a second of the start, or a row is not finite.
    """
    before = 0
    for piece in imu.pieces():
        check_rows(piece, 0, before)
        before += piece.rows
    known = replace(task.antenna, covariance=np.zeros((5, 5)), estimated=True)
    plain = replace(task, antenna=known, options=replace(task.options, wheels=NO_WHEELS))
    until_s, start, vrw = min(end_s, imu.end_s), task.start, task.noise.vrw
    crude = About.by_fixes(imu, start, task.fixes, until_s, vrw)
    given, first = _steadiest(crude, plain)
    rows, taken_off = Rows.of(first), _mean_biases(first)
    for _ in range(2):
        about = About.of(imu, rows, taken_off, task.fixes.time_s, given.noise.vrw)
        best = _with_start(about, given, smooth=True)
        rows, taken_off = Rows.of(best), _mean_biases(best)
    return About.of(imu, rows, taken_off, task.fixes.time_s, task.noise.vrw)


def _steadiest(crude: About, task: Task) -> tuple[Task, AidedHistory]:
    """The task with noise of the accelerometers that explains the fixes, and its solution with
    attitudes fed back.
    """
    given, least = task, np.inf
    found: AidedHistory | None = None
    for louder in LOUDER:
        tried = replace(task, noise=_louder(task, louder))
        history = FromHeadings(crude, tried, record=True).flown(task.start)
        seen = history.used != records.UNSEEN
        rejected = float((history.used == records.REJECTED).sum() / max(seen.sum(), 1))
        if found is not None and rejected > LESS_REJECTED * least:
            break  # what is rejected is wild, whatever the sensors do
        given, found, least = tried, history, rejected
        if least <= MOST_REJECTED:
            break
    assert found is not None  # of the first one
    return given, found


def _mean_biases(history: AidedHistory) -> NDArray:
    return np.concatenate(
        [history.gyro_bias_rad_s.mean(axis=0), history.accel_bias_m_s2.mean(axis=0)]
    )


def _louder(task: Task, times: float) -> AidedNoise:
    """The noise of a task with that of the accelerometers so many times as large: what shakes them
    turns the gyros little, and they keep the attitude.
    """
    noise, walk = task.noise, min(times, WIDEST_WALK)
    return replace(
        noise,
        arw=LOUDER[0] * noise.arw,
        vrw=times * noise.vrw,
        gyro_walk=LOUDER[0] * noise.gyro_walk,
        accel_walk=walk * noise.accel_walk,
    )


def without_errors(about: About, x: NDArray, P: NDArray) -> Rows:
    """The rows of a reference after its first less their errors.

    Parameters
    ----------
    about : About
    x : ndarray, shape (k, 15)
        Errors, computed - true, in the order of `MOTION`.
    P : ndarray, shape (k, 15, 15)

    Returns
    -------
    rows : Rows
    """
    ref, rows = about.reference, about.rows
    last = slice(rows.time_s.size - len(x), None)
    travels = ref.travels_n[ref.closes][last]
    place, v_n, C_nb = (a[last] for a in (rows.place, rows.v_n_m_s, rows.C_nb))
    theta = x[:, AIDED_THETA]
    C_en = dcm_en(place[:, 0], place[:, 1])
    r_e = ecef_from_geodetic(*place.T) - np.einsum("kij,kj->ki", C_en, x[:, AIDED_POS])
    off = x[:, AIDED_VEL] + np.cross(theta, travels)
    v_e = np.einsum("kij,kj->ki", C_en, v_n - off)
    C_eb = C_en @ dcm_from_rotation_vector(-theta) @ C_nb
    lat, lon, height = geodetic_from_ecef(r_e)
    now = dcm_en(lat, lon)
    return Rows(
        rows.time_s[last],
        np.column_stack([lat, lon, height]),
        np.einsum("kji,kj->ki", now, v_e),
        np.swapaxes(now, 1, 2) @ C_eb,
        np.diagonal(P, axis1=1, axis2=2)[:, AIDED_VEL],
    )


@dataclass
class FromHeadings:
    """Flights of a log that differ in where they start, and how wide, about one solution of it.

    Their attitudes are fed back at each step, so that a heading may be wrong by any angle.

    Parameters
    ----------
    about : About
    task : Task
        Of any of the starts: what is measured, under which noise.
    record : bool
        At each row.
    """

    about: About
    task: Task
    record: bool = False

    @cached_property
    def _laid(self) -> tuple[Laid, FedBack]:
        flt = aided_filter(self.task, self.about)
        gyro_sigma = np.sqrt(np.diag(flt.P)[BASE : BASE + 3])
        laid = aided_tape(self.task, self.about, gyro_sigma, record=self.record)
        return laid, fed_back(self.about, laid)

    def flown(self, start: AidedStart) -> AidedHistory:
        """The flight from a start.

        Parameters
        ----------
        start : AidedStart

        Returns
        -------
        history : AidedHistory
        """
        laid, back = self._laid
        task = replace(self.task, start=start)
        flt = aided_filter(task, self.about)
        found, x, P = flt.run_for_records(laid.tape, MOTION, fed_back=back)
        about = self.about
        if self.record:
            turned = replace(about.rows, C_nb=found.turns @ about.rows.C_nb)
            about = replace(about, rows=turned)
        return _history(about, task, laid, flt, (found, x, P))


def _with_start(about: About, task: Task, *, smooth: bool, rows: bool = True) -> AidedHistory:
    """The solution with where it starts as its first row."""
    if not smooth:
        return FromHeadings(about, task, record=rows).flown(task.start)
    flt = aided_filter(task, about)
    gyro_sigma = np.sqrt(np.diag(flt.P)[BASE : BASE + 3])
    laid = aided_tape(task, about, gyro_sigma, record=rows)
    return _history(about, task, laid, flt, flt.run_for_records(laid.tape, MOTION, smooth=True))


def _history(
    about: About, task: Task, laid: Laid, flt: ErrorFilter, swept: tuple[Response, NDArray, NDArray]
) -> AidedHistory:
    """What a sweep found."""
    found, x, P = swept
    tally, antenna = flt.tally, task.linearised.values + flt.x[np.array(ANTENNA)]
    rolled = found.counted(ROLL)
    since_s = about.reference.end_s[0] + 2.0 * SHAKEN_S
    shaking = about.shaking[about.reference.end_s > since_s]
    return AidedHistory(
        **_of_rows(about, x, P),
        fix_time_s=task.fixes.time_s,
        **_of_fixes(found, laid, task.fixes.time_s.size),
        stand_nis=tally.nis.get(STAND, 0.0),
        stand_dof=tally.dof.get(STAND, 0),
        rolled=rolled,
        antenna=replace(
            task.antenna,
            lever_arm_m=antenna[:3],
            delay_s=float(antenna[3]),
            velocity_delay_s=float(antenna[4]),
            covariance=flt.P[np.ix_(ANTENNA, ANTENNA)],
        ),
        scales=flt.x[SCALES],
        scales_covariance=flt.P[np.ix_(SCALES, SCALES)],
        shaking=(float(shaking.min(initial=np.inf)), float(shaking.max(initial=0.0))),
    )


def _of_rows(about: About, x: NDArray, P: NDArray) -> dict[str, NDArray]:
    """Rows of a solution, from what was recorded: fields of `AidedHistory`."""
    travels = about.reference.travels_n[about.reference.closes][: len(x)]
    to_dv = np.tile(np.eye(AIDED_MOTION), (len(x), 1, 1))
    to_dv[:, AIDED_VEL, AIDED_THETA] = -skew(travels)
    rows, P = without_errors(about, x, P), to_dv @ P @ np.swapaxes(to_dv, 1, 2)
    biases = about.taken_off + x[:, AIDED_GYRO.start :]
    lat, lon, height = rows.place.T
    return {
        "time_s": rows.time_s,
        "lat_rad": lat,
        "lon_rad": lon,
        "height_m": height,
        "v_n_m_s": rows.v_n_m_s,
        "C_nb": rows.C_nb,
        "gyro_bias_rad_s": biases[:, :3],
        "accel_bias_m_s2": biases[:, 3:],
        "variance": np.diagonal(P, axis1=1, axis2=2).copy(),
        "phi_covariance": _phi_covariance(lat, height, P),
        "covariance": P,
    }


def _of_fixes(found: Response, laid: Laid, count: int) -> dict[str, NDArray]:
    """What became of each fix: fields of `AidedHistory`."""
    ops, of_row = found.tape.ops, found.tape.operation_of_row
    residual, sigma = np.full((count, 6), np.nan), np.full((count, 6), np.nan)
    nis, loglik = np.full((count, 2), np.nan), np.full((count, 2), np.nan)
    used = np.full((count, 2), records.UNSEEN)
    renewed = ops[:, 0] == RENEW
    # what was begun anew at the fix of an operation, by its first row
    anew = np.zeros(len(found.normalised), dtype=np.int64)
    at = np.flatnonzero(renewed & (found.outcome > USED))
    anew[ops[at - ops[at, 1], 2]] = found.outcome[at]
    for kind, (fix, first) in enumerate(zip(laid.fixes, laid.rows)):
        rows = first[:, None] + np.arange(3)
        alone, variance = found.alone[rows, 0], found.alone[rows, 1]
        took = found.outcome[of_row[first]] == USED
        took |= anew[first] > 0
        own = slice(3 * kind, 3 * kind + 3)
        residual[fix, own], sigma[fix, own] = alone, np.sqrt(variance)
        normalised, spread = found.normalised[rows], found.spread[rows]
        nis[fix, kind] = np.where(
            took, np.sum(normalised**2, axis=1), np.sum(alone**2 / variance, axis=1)
        )
        loglik[fix, kind] = -0.5 * np.where(
            took,
            np.sum(normalised**2 + np.log(spread), axis=1),
            GATE_NIS + np.sum(np.log(variance), axis=1),
        )
        became = np.where(took, records.USED, records.REJECTED)
        became[anew[first] == RENEWED], became[anew[first] == LEAPT] = records.RESET, records.JUMPED
        used[fix, kind] = became
    return {"residual": residual, "sigma": sigma, "nis": nis, "used": used, "loglik": loglik}


def _phi_covariance(lat_rad: NDArray, height_m: NDArray, P: NDArray) -> NDArray:
    """Covariance (k, 3, 3) of the NED attitude error: phi_N = theta_N - p_E / R, phi_E = theta_E +
    p_N / R, phi_D = theta_D + p_E tan(lat) / R.
    """
    radius = SEMI_MAJOR_AXIS_M + height_m
    rows = np.zeros((lat_rad.size, 3, AIDED_MOTION))
    rows[:, :, AIDED_THETA] = np.eye(3)
    rows[:, 0, 1] = -1.0 / radius
    rows[:, 1, 0] = 1.0 / radius
    rows[:, 2, 1] = np.clip(np.tan(lat_rad), -POLE_TAN, POLE_TAN) / radius
    return np.asarray(rows @ P @ np.swapaxes(rows, 1, 2))


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
