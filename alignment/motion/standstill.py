"""Does the speed that other sensors log agree with where the inertial solution rests and rolls?

A steady straight roll looks like rest to inertial sensors alone, and a dead wheel encoder looks
like parking.
"""

import numpy as np
from numpy.typing import NDArray

from alignment.motion.stillness import ROLLING, STILL, Motion
from ins.records import Run

MOVING_M_S = 1.0  # a logged speed above this is movement
DEAD_M_S = 0.05  # an odometer below this reads zero
MIN_S = 20.0  # for so long before the two are said to disagree


def speed_disagreement(run: Run, motion: Motion) -> tuple[str, ...]:
    """Reasons where GNSS or odometer contradict the motion found; empty where they agree or are not
    logged.
    """
    found = []
    if run.gnss is not None:
        speed = np.linalg.norm(run.gnss.v_n_m_s[:, :2], axis=1)
        found += _moving_at_rest("GNSS", run.gnss.time_s, speed, motion)
    if run.odometer is not None:
        found += _moving_at_rest(
            "the odometer", run.odometer.time_s, np.abs(run.odometer.speed_m_s), motion
        )
        found += _dead(run.odometer.time_s, np.abs(run.odometer.speed_m_s), motion)
    return tuple(found)


def _moving_at_rest(name: str, time_s: NDArray, speed: NDArray, motion: Motion) -> list[str]:
    still = _kind_at(time_s, motion) == STILL
    seconds = _seconds(time_s, still & (speed > MOVING_M_S))
    if seconds < MIN_S:
        return []
    fastest = float(speed[still].max())
    return [
        f"{name} says up to {fastest:.1f} m/s for {seconds:.0f} s while the inertial solution"
        " rests: a steady roll taken for rest, or a wrong stream"
    ]


def _dead(time_s: NDArray, speed: NDArray, motion: Motion) -> list[str]:
    rolling = _kind_at(time_s, motion) == ROLLING
    seconds = _seconds(time_s, rolling)
    if seconds < MIN_S or np.median(speed[rolling]) > DEAD_M_S:
        return []
    return [
        f"the odometer reads zero while the inertial solution rolls for {seconds:.0f} s: a dead"
        " encoder reads as parked"
    ]


def _kind_at(time_s: NDArray, motion: Motion) -> NDArray:
    index = np.clip(np.searchsorted(motion.time_s, time_s), 0, len(motion.kind) - 1)
    inside = (time_s >= motion.time_s[0]) & (time_s <= motion.time_s[-1])
    return np.where(inside, motion.kind[index], -1)


def _seconds(time_s: NDArray, mask: NDArray) -> float:
    return float(np.count_nonzero(mask) * np.median(np.diff(time_s))) if time_s.size > 1 else 0.0
