"""From runs to parked stops: azimuth, gyro and accelerometer means, and the joint covariance of
what they show.

A stop is a stretch at rest between turns; a run is one power-on with one stop or several. Stops of
one run share its turn-on bias, which the fit cannot tell from k' and does not need to; stops of
separate runs each have their own, and that is noise on the couplings. Levels come from the
accelerometers, azimuths from the person at the table (with sigma) or from the gyros themselves:
then the azimuth of each run is unknown, and the turns within one are followed by the vertical gyro.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from alignment import coarse
from alignment.motion.imu_faults import repair
from alignment.motion.inertial import between_turns, first_rest
from alignment.motion.kinds import DISTURBED, STILL
from alignment.motion.seconds import seconds_of
from alignment.motion.speeds import speed_disagreement
from alignment.motion.stillness import PIVOT_RAD_S, classify
from infield.misalignment.geometry import SHORTEST_STOP_S
from infield.misalignment.reasons import StopReason
from infield.session.log import compensated_imu, compensated_seconds, session_end
from ins.attitude import dcm_from_euler, euler_from_dcm, level_angles, wrap_pi
from ins.earth import gravity_magnitude, omega_ie_n
from ins.noise import gyro_densities
from ins.records import ImuLog, NavHistory, NavState, Run, TwinModel
from ins.robust import robust_sigmas, runs_of_true
from ins.strapdown.compensation import compensate
from ins.strapdown.mechanization import VerticalChannel, navigate
from ins.units import DEG
from ins.verdicts import Reason, because

TURN_GUARD_S = 30.0  # left out before and after a turn: a slow start of it is below every gate
EDGE_SIGMAS = 6.0  # a 10 s block this far from the others at the edge of a stop belongs to the turn
STOP_BLOCK_S = 10.0
# a turn beyond this ends a stop; 15 deg/h x sin(5 deg) is 1.3 deg/h of Earth rate
STOP_TURN_RAD = 5.0 * DEG
# a stop that turns by more, slowly, is none; 15 deg/h x 0.0017 is 0.026 deg/h of Earth rate
MAX_CREEP_RAD = 0.1 * DEG


@dataclass(frozen=True, kw_only=True)
class AzimuthStop:
    """One stretch at rest.

    run: index of the run in the list; used_s: seconds that the means are over (disturbed ones are
    left out); gyro_rad_s, f_m_s2 (3,): means of the log less the twin's nominal errors; turn_rad:
    heading change since the run's first stop by the gyros, and its variance but for the scale
    factor's error.
    """

    run: int
    start_s: float
    end_s: float
    used_s: float
    gyro_rad_s: NDArray
    f_m_s2: NDArray
    turn_rad: float = 0.0
    turn_variance_rad2: float = 0.0


def find_stops(
    run: Run, twin: TwinModel, *, index: int = 0, shortest_s: float = SHORTEST_STOP_S
) -> tuple[list[AzimuthStop], list[Reason]]:
    """Stops of at least `shortest_s` in a run, in order, and what was left out and why."""
    imu = compensated_imu(run, None, None, twin).between(-np.inf, session_end(run))
    rests: list[_Rest] = []
    left_out: list[Reason] = []
    log = compensated_seconds(run, None, None, twin).between(-np.inf, session_end(run))
    for start_s, end_s in between_turns(log, turn_rad=STOP_TURN_RAD, rate_rad_s=PIVOT_RAD_S):
        found = _rest_of(imu.between(start_s, end_s), run)
        if isinstance(found, _Rest) and found.used_s >= shortest_s:
            rests.append(found)
        elif end_s - start_s >= 0.5 * shortest_s:
            why = found
            if isinstance(found, _Rest):
                why = because(StopReason.TOO_SHORT, used_s=found.used_s, needed_s=shortest_s)
            left_out.append(
                because(
                    StopReason.LEFT_OUT,
                    run_id=run.header.run_id,
                    start_s=start_s,
                    end_s=end_s,
                    why=why,
                )
            )
    if not rests and not left_out:
        left_out.append(
            because(StopReason.NO_STRETCH, run_id=run.header.run_id, needed_s=shortest_s)
        )
    stops: list[AzimuthStop] = []
    for k, rest in enumerate(rests):
        turn, variance = (stops[-1].turn_rad, stops[-1].turn_variance_rad2) if k else (0.0, 0.0)
        if k:
            step, spread = _turned(imu, rests[k - 1], rest, run, twin)
            turn, variance = turn + step, variance + spread
        stops.append(
            AzimuthStop(
                run=index,
                start_s=rest.start_s,
                end_s=rest.end_s,
                used_s=rest.used_s,
                gyro_rad_s=rest.gyro_rad_s,
                f_m_s2=rest.f_m_s2,
                turn_rad=turn,
                turn_variance_rad2=variance,
            )
        )
    return stops, left_out


@dataclass(frozen=True, kw_only=True)
class _Rest:
    """A stop before its turns are known; excess_rad_s: of its gyros over Earth rate, C_nb: at its
    end.
    """

    start_s: float
    end_s: float
    used_s: float
    gyro_rad_s: NDArray
    f_m_s2: NDArray
    excess_rad_s: NDArray
    C_nb: NDArray


def _rest_of(imu: ImuLog, run: Run) -> _Rest | Reason:
    """The longest rest of a stretch between turns, or why there is none."""
    log = seconds_of(imu)
    found = first_rest(log)
    if found is None:
        return because(StopReason.NEVER_RESTS)
    mended, faults = repair(imu, log, found[0], imu.end_s)
    imu = mended.whole()
    history = _followed(imu, run, found)
    motion = classify(history, run.phases, imu, faults)
    moving = speed_disagreement(run, motion)
    if moving:
        return because(StopReason.MOVES, witness=moving[0])
    longest = max(stretches(motion.kind <= DISTURBED), key=lambda ab: ab[1] - ab[0], default=(0, 0))
    a, b = _without_edges(history, *longest, (run.imu.start_s, run.imu.end_s))
    epoch = np.clip(
        np.searchsorted(history.time_s, imu.time_s - 0.5 * imu.dt_s), 1, history.time_s.size - 1
    )
    rows = (epoch > a) & (epoch <= b) & (motion.kind[epoch] == STILL)
    used_s = float(imu.dt_s[rows].sum())
    heading = euler_from_dcm(history.C_nb[[a, b]])[2]
    turned_rad = float(abs(wrap_pi(heading[1] - heading[0])))
    if turned_rad > MAX_CREEP_RAD:
        return because(StopReason.CREEPS, turned_rad=turned_rad)
    gyro, f = (
        column[rows].sum(axis=0) / max(used_s, 1.0) for column in (imu.dtheta_rad, imu.dv_m_s)
    )
    return _Rest(
        start_s=float(history.time_s[a]),
        end_s=float(history.time_s[b]),
        used_s=used_s,
        gyro_rad_s=gyro,
        f_m_s2=f,
        excess_rad_s=gyro - history.C_nb[a].T @ omega_ie_n(run.header.site.lat_rad),
        C_nb=history.C_nb[b],
    )


def _turned(
    imu: ImuLog, before: _Rest, after: _Rest, run: Run, twin: TwinModel
) -> tuple[float, float]:
    """Heading change [rad] from the end of a rest to the start of the next, by the gyros less their
    excess, and its variance.

    The excess is the mean of the two rests; that it may be anywhere between them, and its flicker,
    is the variance beside the random walk.
    """
    bias = 0.5 * (before.excess_rad_s + after.excess_rad_s)
    apart = after.excess_rad_s[2] - before.excess_rad_s[2]
    log = compensate(imu.between(before.end_s, after.start_s), gyro_bias_rad_s=bias)
    start = NavState(
        time_s=float(before.end_s), site=run.header.site, v_n_m_s=np.zeros(3), C_nb=before.C_nb
    )
    history = navigate(log, start, epoch_s=None, vertical=VerticalChannel(mode="hold"))
    heading = np.unwrap(euler_from_dcm(history.C_nb)[2])
    seconds, gyro = after.start_s - before.end_s, twin.gyro
    drift = seconds**2 * (apart**2 / 12.0 + gyro_densities(gyro).instability ** 2)
    return float(heading[-1] - heading[0]), float(drift + gyro_densities(gyro).white ** 2 * seconds)


def _followed(imu: ImuLog, run: Run, rest: tuple[float, float]) -> NavHistory:
    """A solution of the stretch from its rest on, one epoch a second."""
    site = run.header.site
    means = coarse.rest_means(imu.between(*rest))
    C_nb = coarse.gyrocompass_dcm(means)
    excess = means.omega_ib_b - C_nb.T @ omega_ie_n(site.lat_rad)
    start = NavState(time_s=float(rest[0]), site=site, v_n_m_s=np.zeros(3), C_nb=C_nb)
    return navigate(
        compensate(imu, gyro_bias_rad_s=excess),
        start,
        epoch_s=1.0,
        vertical=VerticalChannel(mode="hold"),
    )


def stretches(mask: NDArray) -> list[tuple[int, int]]:
    """First and last row of the runs of True."""
    return [(first, end - 1) for first, end in runs_of_true(mask)]


def _without_edges(
    history: NavHistory, a: int, b: int, log_s: tuple[float, float]
) -> tuple[int, int]:
    """The stretch of epochs without the slow start and end of a turn and a guard."""
    block = int(STOP_BLOCK_S)
    count = (b - a) // block
    if count < 6:
        return a, a
    rate = history.dtheta_b_rad[a + 1 : a + 1 + count * block].reshape(count, block, 3).sum(axis=1)
    off = np.abs(rate - np.median(rate, axis=0))
    good = np.flatnonzero((off <= EDGE_SIGMAS * robust_sigmas(off)).all(axis=1))
    if not good.size:
        return a, a
    first, last = (
        a + good[0] * block,
        min(a + (good[-1] + 1) * block, b) if good[-1] < count - 1 else b,
    )
    first = first if history.time_s[a] <= log_s[0] + 1.0 else first + int(TURN_GUARD_S)
    last = last if history.time_s[b] >= log_s[1] - 1.0 else last - int(TURN_GUARD_S)
    return (first, last) if last > first else (a, a)


def earth_rate_b(f_m_s2: NDArray, heading_rad: float, lat_rad: float) -> NDArray:
    """Earth rate [rad/s] in body axes of a unit levelled by its accelerometers, on a heading."""
    roll, pitch = level_angles(f_m_s2)
    return dcm_from_euler(roll, pitch, heading_rad).T @ omega_ie_n(lat_rad)


def level_columns(
    stop: AzimuthStop, heading_rad: float, lat_rad: float, height_m: float
) -> NDArray:
    """What an x and a y accelerometer bias do to the excess rates of a stop, (3, 2) [rad/s per
    m/s^2].
    """
    step = 1e-3 * float(gravity_magnitude(lat_rad, height_m))
    columns = []
    for axis in range(2):
        change = step * np.eye(3)[axis]
        ahead = earth_rate_b(stop.f_m_s2 + change, heading_rad, lat_rad)
        columns.append(
            -(ahead - earth_rate_b(stop.f_m_s2 - change, heading_rad, lat_rad)) / (2 * step)
        )
    return np.stack(columns, axis=1)


def coarse_headings(stops: Sequence[AzimuthStop], bias_rad_s: NDArray) -> NDArray:
    """Heading (m,) of each stop where gyros less the bias (3,) see north [rad]."""
    out = []
    for stop in stops:
        means = coarse.RestMeans(
            stop.f_m_s2, stop.gyro_rad_s - bias_rad_s, np.zeros(3), stop.used_s
        )
        out.append(euler_from_dcm(coarse.gyrocompass_dcm(means))[2])
    return np.array(out)


def excess_rad_s(stops: Sequence[AzimuthStop], heading_rad: NDArray, lat_rad: float) -> NDArray:
    """What the gyros read beyond Earth rate, (m, 3) [rad/s]."""
    return np.stack(
        [s.gyro_rad_s - earth_rate_b(s.f_m_s2, H, lat_rad) for s, H in zip(stops, heading_rad)]
    )


def heading_disagreement(
    stops: Sequence[AzimuthStop], heading_rad: NDArray, lat_rad: float
) -> tuple[int, float]:
    """The stop whose given heading is farthest from what its gyros say, and by how much [rad].

    The gyros' own bias is the mean of the excess, which turns with the stops where it is none.
    """
    bias = excess_rad_s(stops, heading_rad, lat_rad).mean(axis=0)
    off = wrap_pi(np.asarray(heading_rad) - coarse_headings(stops, bias))
    j = int(np.argmax(np.abs(off)))
    return j, float(off[j])
