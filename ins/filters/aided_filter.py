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

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ins.attitude import dcm_from_rotation_vector, skew
from ins.earth import SEMI_MAJOR_AXIS_M, dcm_en, ecef_from_geodetic, geodetic_from_ecef
from ins.estimation.error_filter import ErrorFilter, Response, Tally
from ins.estimation.measurements.antenna import RowSums
from ins.estimation.states import BASE, POS, THETA, W
from ins.estimation.tape import LEAPT, MEASURE, REFUSED, RENEW, RENEWED, USED
from ins.filters import aided_records as records
from ins.filters.aided_records import AidedHistory, AidedNoise
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
)
from ins.filters.reference import SHAKEN_S, About, Rows, less, reference
from ins.filters.states import AIDED_GYRO, AIDED_MOTION, AIDED_POS, AIDED_THETA, AIDED_VEL
from ins.records import ImuSource, InputError, NavState, Site
from ins.strapdown.mechanization import navigate
from ins.strapdown.start import check_rows

# of a window's measurements that are rejected, chosen: wild ones are up to 1 in 3 of a log; P is
# then widened by
LOST_SHARE, LOST_M, LOST_M_S = 0.5, 100.0, 10.0
POSITION_STATES, VELOCITY_STATES = range(POS.start, POS.start + 3), range(W.start, W.start + 3)
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
# of a window: at first, and at most, chosen: rows are 1 s apart, and 16 s of a MEMS gyro of
# 1,000 deg/h turn by 4 deg; one whose correction shows that it is not linear is flown in halves
FIRST_WINDOW_S, WINDOW_S = 1.0, 16.0
NONLINEAR = 0.2  # of a tilt's sigma: its square over two adds 2 % to it (sqrt(1 + 0.2^2))
# of an antenna that is free: flights, each linearised about what the last one found; what it may
# still be off, m and s: 0.01 s at a change of 3 m/s^2 is a velocity's sigma
ANTENNA_PASSES, SETTLED = 3, np.array([0.3, 0.3, 0.3, 0.01, 0.01])
MARGIN_S = 2.0  # of log before and after a window: a fix may be older than its time
# of a reference: nothing of it counts, so it follows the fixes whatever the sensors do
LOUDER, WIDEST_WALK = (8.0, 64.0, 512.0, 4096.0), 32.0
# of fixes, a log with 28 of 679 (0.04) wild ones needed no more noise; and of those that were
# rejected before, chosen
MOST_REJECTED, LESS_REJECTED = 0.05, 0.7
LEAST_STEP_S = 0.5  # chosen: rows are 1 s apart
LOWEST_M, HIGHEST_M = -900.0, 29_000.0  # within `Site`'s -1,000 to 30,000: it has run away
POLE_TAN = 1e6  # of the latitude


def solved(
    about: About, task: Task, *, smooth: bool = False, rows: bool = True
) -> AidedHistory:
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
    whole = _with_start(about, task, smooth=smooth, rows=rows)
    free = task.antenna.estimated and task.antenna.covariance.any()
    for _ in range(ANTENNA_PASSES if free else 0):
        if (np.abs(whole.antenna.values - task.linearised.values) < SETTLED).all():
            break
        task = replace(task, near=whole.antenna)
        whole = _with_start(about, task, smooth=smooth, rows=rows)
    columns = {k: v[1:] for k, v in vars(whole).items() if k in ROW_FIELDS}
    return replace(whole, **columns)


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
    # adjoints ask for gains that are best: an antenna that is considered has others
    free = replace(task, antenna=replace(task.antenna, estimated=True))
    given, rows, taken_off = _steadiest(imu, free, min(end_s, imu.end_s))
    for _ in range(2):
        about = About.of(imu, rows, taken_off, task.fixes.time_s, given.noise.vrw)
        best = _with_start(about, given, smooth=True)
        rows, taken_off = Rows.of(best), _mean_biases(best)
    return About.of(imu, rows, taken_off, task.fixes.time_s, task.noise.vrw)


def begun_again(about: About, imu: ImuSource, task: Task) -> About:
    """A reference for a start shortly before or after that of another one.

    Parameters
    ----------
    about : About
    imu : ImuSource
        The log with all its biases.
    task : Task

    Returns
    -------
    about : About
    """
    state, rows = task.start.state, about.rows
    later = rows.time_s > state.time_s + LEAST_STEP_S
    kept = Rows(*(column[later] for column in vars(rows).values()))
    first = kept.after(state, np.diag(task.start.covariance)[AIDED_VEL])
    return About.of(imu, first, about.taken_off, task.fixes.time_s, task.noise.vrw)


def _steadiest(imu: ImuSource, task: Task, end_s: float) -> tuple[Task, Rows, NDArray]:
    """The task with noise of the accelerometers that explains the fixes, and as of `_fed_back` the
    rows and biases of its solution.
    """
    given, least = task, np.inf
    found: tuple[Rows, NDArray] | None = None
    for louder in LOUDER:
        tried = replace(task, noise=_louder(task, louder))
        rows, taken_off, rejected = _fed_back(imu, tried, end_s)
        if found is not None and rejected > LESS_REJECTED * least:
            break  # what is rejected is wild, whatever the sensors do
        given, found, least = tried, (rows, taken_off), rejected
        if least <= MOST_REJECTED:
            break
    assert found is not None  # of the first one
    return given, *found


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


def _fed_back(imu: ImuSource, task: Task, end_s: float) -> tuple[Rows, NDArray, float]:
    """Rows of a solution that is corrected after each window, the biases at its end (6,), and the
    share of fixes that were rejected.
    """
    start = task.start
    least_s = window_s = FIRST_WINDOW_S
    state, biases = start.state, np.concatenate([start.gyro_bias_rad_s, start.accel_bias_m_s2])
    flt: ErrorFilter | None = None
    parts, rejected, measured = [], 0, 0
    while state.time_s + FIRST_WINDOW_S <= end_s + 1e-6:
        until_s = min(state.time_s + window_s, end_s)
        about = _window(imu, task, state, biases, until_s)
        if about is None:
            if until_s == end_s:
                break
            least_s = window_s = 2.0 * window_s  # a gap
            continue
        if flt is None:
            flt = aided_filter(task, about)
        flt.tally = Tally()
        before = flt.x.copy(), flt.P.copy()
        laid = aided_tape(task, about, np.sqrt(np.diag(flt.P)[BASE : BASE + 3]))
        found, x, P = flt.run_for_records(laid.tape, MOTION)
        turned = float(np.linalg.norm(flt.x[THETA]))
        sigma = float(np.sqrt(np.trace(flt.P[THETA, THETA])))
        linear = 0.5 * turned**2 <= NONLINEAR * sigma
        if not linear and window_s > least_s:
            (flt.x, flt.P), window_s = before, max(0.5 * window_s, least_s)
            continue
        if linear:
            window_s = min(2.0 * window_s, WINDOW_S)
        least_s = FIRST_WINDOW_S
        done = without_errors(about, x[1:], P[1:])
        if not LOWEST_M < done.place[-1, 2] < HIGHEST_M:
            rejected, measured = 1, 1
            break
        parts.append(done)
        state, biases = _last_state(done), biases + x[-1, 9:]
        flt.x[MOTION] = 0.0
        of_fixes = found.tape.ops[:, 0] == MEASURE
        refused = int((found.outcome[of_fixes] == REFUSED).sum())
        rejected, measured = rejected + refused, measured + int(of_fixes.sum())
        if refused > LOST_SHARE * of_fixes.sum():
            flt.P[POSITION_STATES, POSITION_STATES] += LOST_M**2
            flt.P[VELOCITY_STATES, VELOCITY_STATES] += LOST_M_S**2
    if not parts:
        raise InputError(
            f"imu: ends at {end_s:.6g} s, needed a second of rows after {start.state.time_s:.6g} s"
        )
    joined = Rows(*(np.concatenate(c) for c in zip(*(vars(p).values() for p in parts))))
    first = joined.after(start.state, np.diag(start.covariance)[AIDED_VEL])
    return first, biases, rejected / max(measured, 1)


def _window(
    imu: ImuSource, task: Task, state: NavState, biases: NDArray, until_s: float
) -> About | None:
    """From a state on, by the increments alone; None where there are none."""
    log = less(imu.between(state.time_s - MARGIN_S, until_s + MARGIN_S), biases)
    log_there = log.between(-np.inf, until_s + 1e-6)
    if log_there.end_s <= state.time_s + 1e-6:
        return None
    nav = navigate(log_there, state, epoch_s=1.0)
    if nav.time_s.size < 2:
        return None
    place = np.column_stack([nav.lat_rad, nav.lon_rad, nav.height_m])
    variance = np.full((nav.time_s.size, 3), task.noise.vrw**2)
    rows = Rows(nav.time_s, place, nav.v_n_m_s, nav.C_nb, variance)
    whole = [slice(0, rows.time_s.size)]
    along = reference(log, rows, task.fixes.time_s, whole, task.noise.vrw)
    return About(rows, along, RowSums(log), log, biases)


def _last_state(rows: Rows) -> NavState:
    lat, lon, height = (float(value) for value in rows.place[-1])
    site = Site(lat_rad=lat, lon_rad=lon, height_m=height)
    return NavState(
        time_s=float(rows.time_s[-1]), site=site, v_n_m_s=rows.v_n_m_s[-1], C_nb=rows.C_nb[-1]
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


def _with_start(about: About, task: Task, *, smooth: bool, rows: bool = True) -> AidedHistory:
    """The solution with where it starts as its first row."""
    flt = aided_filter(task, about)
    gyro_sigma = np.sqrt(np.diag(flt.P)[BASE : BASE + 3])
    laid = aided_tape(task, about, gyro_sigma, record=rows)
    found, x, P = flt.run_for_records(laid.tape, MOTION, smooth=smooth)
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
