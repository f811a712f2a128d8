"""Where a vehicle stands: satellite velocity and inertial sensors must both say so.

A steady roll looks like rest to inertial sensors alone, and a slow push like rest to a receiver:
only seconds in which both are quiet count, in stretches whose mean velocity is none.
"""

import numpy as np
from numpy.typing import NDArray

from alignment.motion.imu_seconds import whole_seconds
from ins.filters.aided_records import Fixes
from ins.records import ImuSource
from ins.robust import runs_of_true

SHORTEST_S = 5.0
EDGE_S = 4.0  # taken off either end: a receiver sees a slow start late
SLOW_M_S = 0.5
CREEP_M_S = 0.05  # mean velocity of a stretch that stands, beyond its noise
MOST_CREEP_M_S = 0.2  # however noisy
CORRELATED_S = 5.0  # of a receiver's velocity errors
# of the mean force from second to second, and of the mean rate; wind on a parked aircraft passes
FORCE_STEP_M_S2 = 0.15
RATE_STEP_RAD_S = 0.01
TURN_RAD_S = 0.02  # above any bias; a vehicle that turns on the spot does not stand still

Where = tuple[float, float]


def find_stands(imu: ImuSource, fixes: Fixes) -> tuple[Where, ...]:
    """Stretches (start, end) [s] in which the vehicle stands, from the log's pieces and its
    fixes.
    """
    seen = np.isfinite(fixes.v_n_m_s[:, 0])
    time_s, v_n = fixes.time_s[seen], fixes.v_n_m_s[seen]
    if time_s.size < 2:
        return ()
    sigma = float(np.median(fixes.sigma_velocity_m_s[seen, 0]))
    slow = np.linalg.norm(v_n[:, :2], axis=1) < max(SLOW_M_S, 4.0 * sigma)
    gap_s = max(5.0 * float(np.median(np.diff(time_s))), 2.0)
    ends, quiet = _quiet_seconds(imu)
    moving = time_s[~slow]
    near = np.searchsorted(moving, ends - 2.0) != np.searchsorted(moving, ends + 1.0, side="right")
    after = np.clip(np.searchsorted(time_s, ends), 1, time_s.size - 1)
    watched = (
        (time_s[after] - time_s[after - 1] <= gap_s)
        & (ends <= time_s[-1] + gap_s)
        & (ends >= time_s[0])
    )
    found = []
    for a, b in runs_of_true(quiet & watched & ~near):
        start, end = float(ends[a]) + EDGE_S, float(ends[b - 1]) - EDGE_S
        if end - start >= SHORTEST_S and goes_nowhere(fixes.time_s, fixes.v_n_m_s, start, end):
            found.append((start, end))
    return tuple(found)


def _quiet_seconds(imu: ImuSource) -> tuple[NDArray, NDArray]:
    """End of each second, and whether force and rate are steady there."""
    ends, means = [], []
    for time_s, dt_s, rows in whole_seconds(imu, imu.start_s, imu.end_s):
        first = np.flatnonzero(np.diff(np.ceil(time_s - imu.start_s - 1e-9), prepend=-1.0))
        last = np.append(first[1:], time_s.size) - 1
        ends.append(time_s[last])
        means.append(np.add.reduceat(rows, first) / np.add.reduceat(dt_s, first)[:, None])
    mean = np.concatenate(means)
    step = np.abs(np.diff(mean, axis=0, prepend=mean[:1]))
    quiet = (step[:, :3] < FORCE_STEP_M_S2).all(axis=1) & (step[:, 3:] < RATE_STEP_RAD_S).all(
        axis=1
    )
    return np.concatenate(ends), np.asarray(
        quiet & (np.linalg.norm(mean[:, 3:], axis=1) < TURN_RAD_S)
    )


def goes_nowhere(time_s: NDArray, v_n_m_s: NDArray, start_s: float, end_s: float) -> bool:
    """Whether the mean of a receiver's velocities (n, 3) stays within its noise over a stretch, as
    it is seen.
    """
    v = v_n_m_s[(time_s >= start_s) & (time_s <= end_s)]
    v = v[np.isfinite(v[:, 0])]
    if len(v) < 2:
        return False
    mean, allowed = mean_speed(v, end_s - start_s)
    return mean <= allowed


def mean_speed(v_n_m_s: NDArray, seconds: float) -> tuple[float, float]:
    """Level speed of the mean of a receiver's velocities (n, 3) over so many seconds, and what it
    may be where it stands.
    """
    sigma = float(np.hypot(*v_n_m_s[:, :2].std(axis=0)))
    allowed = CREEP_M_S + 3.0 * sigma / np.sqrt(min(max(seconds / CORRELATED_S, 1.0), len(v_n_m_s)))
    return float(np.linalg.norm(v_n_m_s[:, :2].mean(axis=0))), float(min(allowed, MOST_CREEP_M_S))


def joined(*spans: Where, gap_s: float = 0.0) -> tuple[Where, ...]:
    """Spans in order, those that meet, or lie no more than a gap apart, made one."""
    found: list[Where] = []
    for start, end in sorted(spans):
        if found and start <= found[-1][1] + gap_s:
            found[-1] = (found[-1][0], max(found[-1][1], end))
        else:
            found.append((start, end))
    return tuple(found)
