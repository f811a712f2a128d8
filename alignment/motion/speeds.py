"""What a receiver and the wheels say of a stretch that looks like rest to the inertial sensors.

A steady roll, a slow circle and a smooth hover look like rest to inertial sensors, a slow push like
rest to a receiver, a dead wheel encoder like parking: a vehicle stands where none that sees it says
otherwise.

Decision: docs/decisions/0009-motion-two-ways.md.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from alignment.motion.inertial import Where, first_rest, steady_seconds
from alignment.motion.kinds import ROLLING, STILL, Says, Witness, WitnessEvidence
from alignment.motion.seconds import LogSeconds, seconds_of
from alignment.motion.stillness import Motion
from alignment.reasons import AlignmentReason
from ins.earth import displacement_ned
from ins.filters.aided_records import Fixes
from ins.records import GnssLog, OdometerLog, Run
from ins.robust import runs_of_true
from ins.verdicts import Reason, because

# of a receiver while the vehicle stands, or four of its sigmas
# (tests/alignment/test_motion_timeline.py has 0.4 m/s at rest)
SLOW_M_S = 0.5
LOOSE_M_S = 2.0  # a receiver that declares worse cannot say that the unit stands
CREEP_M_S = 0.05  # mean velocity of a stretch that stands, beyond its noise
MOST_CREEP_M_S = 0.2  # however noisy
CORRELATED_S = 5.0  # of a receiver's velocity errors
FEWEST_ROWS = 3  # of a receiver, for its word: of 3 one may be wrong
# speed by the positions of a receiver that gives no velocity, LASTING_S apart: 3 sigma of fixes
# of 5 m
POSITION_CREEP_M_S = 1.0
# a logged speed above this is movement: twice what a standing vehicle may read (0.5)
MOVING_M_S = 1.0
WHEELS_STAND_M_S = 0.5  # an odometer below this stands
# an odometer below this reads zero: 5 sigmas of the default one (formats.md section 3)
DEAD_M_S = 0.05
# a log of speeds is silent where its nearest row is farther than so many rows, and than this
GAP_ROWS, SHORTEST_GAP_S = 5.0, 2.0
NAMES = {Witness.GNSS: "GNSS", Witness.WHEELS: "the odometer"}  # as reasons name them
# for so long before two sensors are said to disagree: at half and at twice of it
# tests/alignment/test_motion_timeline.py fails
LASTING_S = 20.0

SHORTEST_S = 5.0  # of a stand in a flight: with EDGE_S off at either end 13 s of rest
EDGE_S = 4.0  # taken off either end: a receiver sees a slow start late


@dataclass(frozen=True)
class Testimony:
    """What a receiver says of a stretch, and why it says that the vehicle moves.

    fastest_m_s, moving_s: its largest speed and how long it is beyond what may be noise; mean_m_s,
    allowed_m_s: the speed of its mean velocity, and what that may be at rest.
    """

    said: Says
    fastest_m_s: float = 0.0
    moving_s: float = 0.0
    mean_m_s: float = 0.0
    allowed_m_s: float = 0.0


def watched_seconds(run: Run) -> LogSeconds:
    """The seconds of a run's log, with what its receiver and its wheels say of each."""
    log = seconds_of(run.imu)
    heard = (gnss_evidence(run.gnss, log.end_s), wheel_evidence(run.odometer, log.end_s))
    moves = np.any([seen.says == Says.MOVES for seen in heard], axis=0)
    return replace(log, moves=moves)


def steady_roll(run: Run) -> Reason | None:
    """Why what looks like rest to a log's inertial rows is none; None where they never rest, or
    where nobody contradicts them.
    """
    log = seconds_of(run.imu)
    rest = first_rest(log)
    if rest is None:
        return None
    log = log.between(*rest)
    for heard in (gnss_evidence(run.gnss, log.end_s), wheel_evidence(run.odometer, log.end_s)):
        moves = heard.says == Says.MOVES
        if moves.any():
            return because(
                AlignmentReason.SPEED_AT_REST,
                witness=NAMES[heard.witness],
                fastest_m_s=float(heard.seen[moves].max()),
                moving_s=float(log.dt_s[moves].sum()),
            )
    return None


def gnss_evidence(gnss: GnssLog | None, end_s: NDArray) -> WitnessEvidence:
    """What a receiver's velocities, else its positions, say of the epochs that end at these times
    (k,).
    """
    if gnss is None or gnss.time_s.size < FEWEST_ROWS:
        return _silent(Witness.GNSS, end_s)
    seen = np.isfinite(gnss.v_n_m_s).all(axis=1)
    if np.count_nonzero(seen) < FEWEST_ROWS:
        time_s, speed = _way_speed(gnss)
        return _by_speed(Witness.GNSS, (time_s, speed), POSITION_CREEP_M_S, end_s)
    speed = np.linalg.norm(gnss.v_n_m_s[seen, :2], axis=1)
    return _by_speed(Witness.GNSS, (gnss.time_s[seen], speed), slow_m_s(gnss, seen), end_s)


def wheel_evidence(odometer: OdometerLog | None, end_s: NDArray) -> WitnessEvidence:
    """What the wheels say of the epochs that end at these times (k,)."""
    if odometer is None or odometer.time_s.size < FEWEST_ROWS:
        return _silent(Witness.WHEELS, end_s)
    speed = np.abs(odometer.speed_m_s)
    return _by_speed(Witness.WHEELS, (odometer.time_s, speed), WHEELS_STAND_M_S, end_s)


def slow_m_s(gnss: GnssLog, seen: NDArray) -> float:
    """Speed that a receiver may give of a standing vehicle, by its fixes `seen`."""
    declared = gnss.sigma_velocity_m_s
    sigma = 0.0 if declared is None else float(np.nanmedian(declared[seen]))
    return max(SLOW_M_S, min(4.0 * sigma, LOOSE_M_S) if np.isfinite(sigma) else 0.0)


def _silent(witness: Witness, end_s: NDArray) -> WitnessEvidence:
    return WitnessEvidence(
        witness, np.full(end_s.size, Says.SILENT), np.full(end_s.size, np.nan), 1.0
    )


def _by_speed(
    witness: Witness, logged: tuple[NDArray, NDArray], allowed_m_s: float, end_s: NDArray
) -> WitnessEvidence:
    """Epochs by the speed (n,) logged nearest to each."""
    time_s, speed = logged
    gap_s = max(GAP_ROWS * float(np.median(np.diff(time_s))), SHORTEST_GAP_S)
    after = np.clip(np.searchsorted(time_s, end_s), 1, time_s.size - 1)
    nearest = after - (end_s - time_s[after - 1] < time_s[after] - end_s)
    seen = np.where(np.abs(time_s[nearest] - end_s) <= gap_s, speed[nearest], np.nan)
    says = np.where(seen <= allowed_m_s, Says.STANDS, Says.SILENT)
    for a, b in runs_of_true(seen > allowed_m_s):
        if end_s[b - 1] - end_s[a] >= LASTING_S - 1.0:
            says[a:b] = Says.MOVES
    return WitnessEvidence(witness, says, seen, allowed_m_s)


def _way_speed(gnss: GnssLog) -> tuple[NDArray, NDArray]:
    """Times and level speeds (n,) of a receiver without velocities, from its positions LASTING_S
    apart.
    """
    rows = np.flatnonzero(np.isfinite(gnss.lat_rad) & np.isfinite(gnss.lon_rad))
    if rows.size < FEWEST_ROWS:
        return gnss.time_s, np.full(gnss.time_s.size, np.nan)
    time_s, way = gnss.time_s[rows], _way_m(gnss, rows)
    ends = [np.clip(time_s + s, time_s[0], time_s[-1]) for s in (-LASTING_S / 2, LASTING_S / 2)]
    before, after = (np.stack([np.interp(t, time_s, w) for w in way.T], axis=1) for t in ends)
    return time_s, np.linalg.norm(after - before, axis=1) / np.maximum(ends[1] - ends[0], 1.0)


def _way_m(gnss: GnssLog, rows: NDArray) -> NDArray:
    """Level way (n, 2) from the first of some rows."""
    first = rows[0]
    way = displacement_ned(
        gnss.lat_rad[rows],
        gnss.lon_rad[rows],
        lat0_rad=float(gnss.lat_rad[first]),
        lon0_rad=float(gnss.lon_rad[first]),
        height0_m=float(gnss.height_m[first]),
    )
    return np.asarray(way)


def receiver_says(gnss: GnssLog | None, start_s: float, end_s: float) -> Testimony:
    """Whether a receiver's velocities, else its positions, say that the vehicle stands."""
    if gnss is None:
        return Testimony(Says.SILENT)
    inside = (gnss.time_s >= start_s) & (gnss.time_s <= end_s)
    seen = inside & np.isfinite(gnss.v_n_m_s).all(axis=1)
    if np.count_nonzero(seen) < FEWEST_ROWS:
        return _positions_say(gnss, inside)
    v, slow = gnss.v_n_m_s[seen], slow_m_s(gnss, seen)
    speed = np.linalg.norm(v[:, :2], axis=1)
    step_s = float(np.median(np.diff(gnss.time_s[seen])))
    moving_s = float(np.count_nonzero(speed > slow) * step_s)
    mean, allowed = mean_speed(v, end_s - start_s)
    moves = moving_s >= LASTING_S or mean > allowed
    return Testimony(
        Says.MOVES if moves else Says.STANDS, float(speed.max()), moving_s, mean, allowed
    )


def _positions_say(gnss: GnssLog, inside: NDArray) -> Testimony:
    rows = np.flatnonzero(inside & np.isfinite(gnss.lat_rad) & np.isfinite(gnss.lon_rad))
    if rows.size < FEWEST_ROWS:
        return Testimony(Says.SILENT)
    way = _way_m(gnss, rows)
    since_s = gnss.time_s[rows] - gnss.time_s[rows[0]]
    creep = float(np.linalg.norm(np.polynomial.polynomial.polyfit(since_s, way, 1)[1]))
    said = Says.STANDS if creep <= POSITION_CREEP_M_S else Says.MOVES
    return Testimony(said, mean_m_s=creep, allowed_m_s=POSITION_CREEP_M_S)


def mean_speed(v_n_m_s: NDArray, seconds: float) -> tuple[float, float]:
    """Level speed of the mean of a receiver's velocities (n, 3) over so many seconds, and what it
    may be where it stands.
    """
    sigma = float(np.hypot(*v_n_m_s[:, :2].std(axis=0)))
    independent = min(max(seconds / CORRELATED_S, 1.0), len(v_n_m_s))
    allowed = CREEP_M_S + 3.0 * sigma / np.sqrt(independent)
    mean = float(np.linalg.norm(v_n_m_s[:, :2].mean(axis=0)))
    return mean, float(min(allowed, MOST_CREEP_M_S))


def find_stands(seconds: LogSeconds, fixes: Fixes) -> tuple[Where, ...]:
    """Stretches (start, end) [s] in which both the inertial rows and the fixes of a flight are at
    rest.
    """
    seen = np.isfinite(fixes.v_n_m_s[:, 0])
    time_s, v_n = fixes.time_s[seen], fixes.v_n_m_s[seen]
    if time_s.size < 2:
        return ()
    sigma = float(np.median(fixes.sigma_velocity_m_s[seen, 0]))
    slow = np.linalg.norm(v_n[:, :2], axis=1) < max(SLOW_M_S, 4.0 * sigma)
    gap_s = max(5.0 * float(np.median(np.diff(time_s))), 2.0)
    ends, moving = seconds.end_s, time_s[~slow]
    near = np.searchsorted(moving, ends - 2.0) != np.searchsorted(moving, ends + 1.0, side="right")
    after = np.clip(np.searchsorted(time_s, ends), 1, time_s.size - 1)
    watched = time_s[after] - time_s[after - 1] <= gap_s
    watched &= (ends <= time_s[-1] + gap_s) & (ends >= time_s[0])
    stands = steady_seconds(seconds) & watched & ~near
    found = []
    for a, b in runs_of_true(stands):
        start, end = float(ends[a]) + EDGE_S, float(ends[b - 1]) - EDGE_S
        if end - start >= SHORTEST_S and _goes_nowhere(time_s, v_n, start, end):
            found.append((start, end))
    return tuple(found)


def _goes_nowhere(time_s: NDArray, v_n_m_s: NDArray, start_s: float, end_s: float) -> bool:
    """Whether the mean of a receiver's velocities (n, 3) stays within its noise over a stretch."""
    v = v_n_m_s[(time_s >= start_s) & (time_s <= end_s)]
    if len(v) < 2:
        return False
    mean, allowed = mean_speed(v, end_s - start_s)
    return mean <= allowed


def speed_disagreement(run: Run, motion: Motion) -> tuple[Reason, ...]:
    """Reasons where GNSS or odometer contradict the motion found; empty where they agree or are not
    logged.
    """
    found: list[Reason] = []
    if run.gnss is not None:
        speed = np.linalg.norm(run.gnss.v_n_m_s[:, :2], axis=1)
        found += _moving_at_rest(NAMES[Witness.GNSS], run.gnss.time_s, speed, motion)
    if run.odometer is not None:
        speed = np.abs(run.odometer.speed_m_s)
        found += _moving_at_rest(NAMES[Witness.WHEELS], run.odometer.time_s, speed, motion)
        found += _dead(run.odometer.time_s, speed, motion)
    return tuple(found)


def _moving_at_rest(witness: str, time_s: NDArray, speed: NDArray, motion: Motion) -> list[Reason]:
    still = _kind_at(time_s, motion) == STILL
    seconds = _seconds(time_s, still & (speed > MOVING_M_S))
    if seconds < LASTING_S:
        return []
    moves = because(
        AlignmentReason.SPEED_AT_REST,
        witness=witness,
        fastest_m_s=float(speed[still].max()),
        moving_s=seconds,
    )
    return [moves]


def _dead(time_s: NDArray, speed: NDArray, motion: Motion) -> list[Reason]:
    rolling = _kind_at(time_s, motion) == ROLLING
    seconds = _seconds(time_s, rolling)
    if seconds < LASTING_S or np.median(speed[rolling]) > DEAD_M_S:
        return []
    return [because(AlignmentReason.DEAD_ODOMETER, rolling_s=seconds)]


def _kind_at(time_s: NDArray, motion: Motion) -> NDArray:
    index = np.clip(np.searchsorted(motion.time_s, time_s), 0, len(motion.kind) - 1)
    inside = (time_s >= motion.time_s[0]) & (time_s <= motion.time_s[-1])
    return np.where(inside, motion.kind[index], -1)


def _seconds(time_s: NDArray, mask: NDArray) -> float:
    return float(np.count_nonzero(mask) * np.median(np.diff(time_s))) if time_s.size > 1 else 0.0


def joined(*spans: Where, gap_s: float = 0.0) -> tuple[Where, ...]:
    """Spans in order, those that meet, or lie no more than a gap apart, made one."""
    found: list[Where] = []
    for start, end in sorted(spans):
        if found and start <= found[-1][1] + gap_s:
            found[-1] = (found[-1][0], max(found[-1][1], end))
        else:
            found.append((start, end))
    return tuple(found)
