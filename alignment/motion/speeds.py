"""What a receiver and the wheels say of a stretch that looks like rest to the inertial sensors.

A steady roll, a slow circle and a smooth hover look like rest to inertial sensors, a slow push like
rest to a receiver, a dead wheel encoder like parking: a vehicle stands where none that sees it says
otherwise.
"""

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from alignment.motion.inertial import Where, steady_seconds
from alignment.motion.kinds import ROLLING, STILL
from alignment.motion.seconds import LogSeconds
from alignment.motion.stillness import Motion
from alignment.reasons import AlignmentReason
from ins.earth import displacement_ned
from ins.filters.aided_records import Fixes
from ins.records import GnssLog, Run
from ins.robust import runs_of_true
from ins.verdicts import Reason, because

SLOW_M_S = 0.5  # of a receiver while the vehicle stands, or four of its sigmas
LOOSE_M_S = 2.0  # a receiver that declares worse cannot say that the unit stands
CREEP_M_S = 0.05  # mean velocity of a stretch that stands, beyond its noise
MOST_CREEP_M_S = 0.2  # however noisy
CORRELATED_S = 5.0  # of a receiver's velocity errors
FEWEST_ROWS = 3  # of a receiver, for its word
# slope of the positions of a receiver that gives no velocity; over eight seconds it is noisy
POSITION_CREEP_M_S = 1.0
MOVING_M_S = 1.0  # a logged speed above this is movement
WHEELS_STAND_M_S = 0.5  # an odometer below this stands
DEAD_M_S = 0.05  # an odometer below this reads zero
LASTING_S = 20.0  # for so long before two sensors are said to disagree

SHORTEST_S = 5.0  # of a stand in a flight
EDGE_S = 4.0  # taken off either end: a receiver sees a slow start late


class Said(StrEnum):
    """What a witness says of a stretch."""

    STANDS = "stands"
    MOVES = "moves"
    NOTHING = "nothing"


@dataclass(frozen=True)
class Testimony:
    """What a receiver says of a stretch, and why it says that the vehicle moves.

    fastest_m_s, moving_s: its largest speed and how long it is beyond what may be noise; mean_m_s,
    allowed_m_s: the speed of its mean velocity, and what that may be at rest.
    """

    said: Said
    fastest_m_s: float = 0.0
    moving_s: float = 0.0
    mean_m_s: float = 0.0
    allowed_m_s: float = 0.0


def receiver_says(gnss: GnssLog | None, start_s: float, end_s: float) -> Testimony:
    """Whether a receiver's velocities, else its positions, say that the vehicle stands."""
    if gnss is None:
        return Testimony(Said.NOTHING)
    inside = (gnss.time_s >= start_s) & (gnss.time_s <= end_s)
    seen = inside & np.isfinite(gnss.v_n_m_s).all(axis=1)
    if np.count_nonzero(seen) < FEWEST_ROWS:
        return _positions_say(gnss, inside)
    v, declared = gnss.v_n_m_s[seen], gnss.sigma_velocity_m_s
    sigma = 0.0 if declared is None else float(np.nanmedian(declared[seen]))
    slow = max(SLOW_M_S, min(4.0 * sigma, LOOSE_M_S) if np.isfinite(sigma) else 0.0)
    speed = np.linalg.norm(v[:, :2], axis=1)
    step_s = float(np.median(np.diff(gnss.time_s[seen])))
    moving_s = float(np.count_nonzero(speed > slow) * step_s)
    mean, allowed = mean_speed(v, end_s - start_s)
    moves = moving_s >= LASTING_S or mean > allowed
    return Testimony(
        Said.MOVES if moves else Said.STANDS, float(speed.max()), moving_s, mean, allowed
    )


def _positions_say(gnss: GnssLog, inside: NDArray) -> Testimony:
    rows = np.flatnonzero(inside & np.isfinite(gnss.lat_rad) & np.isfinite(gnss.lon_rad))
    if rows.size < FEWEST_ROWS:
        return Testimony(Said.NOTHING)
    lat, lon = gnss.lat_rad[rows], gnss.lon_rad[rows]
    way = displacement_ned(
        lat,
        lon,
        lat0_rad=float(lat[0]),
        lon0_rad=float(lon[0]),
        height0_m=float(gnss.height_m[rows[0]]),
    )
    since_s = gnss.time_s[rows] - gnss.time_s[rows[0]]
    creep = float(np.linalg.norm(np.polynomial.polynomial.polyfit(since_s, way, 1)[1]))
    said = Said.STANDS if creep <= POSITION_CREEP_M_S else Said.MOVES
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
        found += _moving_at_rest("GNSS", run.gnss.time_s, speed, motion)
    if run.odometer is not None:
        speed = np.abs(run.odometer.speed_m_s)
        found += _moving_at_rest("the odometer", run.odometer.time_s, speed, motion)
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
