"""Where the vehicle stands again after it first rolled, and how fast a free-inertial solution says
it goes there.

A stop is one of the run's motion (`alignment.motion.timeline`); one that neither a receiver nor an
odometer covers is named as found by the IMU alone.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from alignment.motion.excursions import STOP_WINDOW_S
from alignment.motion.kinds import Says, Witness
from alignment.motion.stillness import Motion
from alignment.motion.timeline import BRAKING_S
from infield.replay.drift import REALIGN_M_S
from ins.records import NavHistory
from ins.units import KNOT


@dataclass(frozen=True)
class StopInterval:
    """Start and end [s] of a stop, and by whose word; ROWS: no receiver and no odometer covers
    it.
    """

    start_s: float
    end_s: float
    seen_by: Witness


@dataclass(frozen=True, kw_only=True)
class StopSpeed:
    """Computed ground speed while the vehicle stands, all of it error: median and largest. realign:
    it is above REALIGN_M_S; seen_by: as of a StopInterval.
    """

    start_s: float
    end_s: float
    ground_speed_m_s: float
    ground_speed_kt: float
    max_m_s: float
    realign: bool
    seen_by: Witness


def find_stops(motion: Motion, steady: NDArray) -> tuple[StopInterval, ...]:
    """Where the vehicle stands again after it first rolled, for at least eight seconds.

    motion: of the run, joined from all witnesses; steady (k,): epochs in which the computed
    velocity stays where it is, so that all of it is error.
    """
    found = motion.stands(STOP_WINDOW_S, after_s=motion.parked_until_s, where=steady)
    return tuple(
        StopInterval(s.start_s, s.end_s, _seen_by(motion, s.start_s, s.end_s)) for s in found
    )


def _seen_by(motion: Motion, start_s: float, end_s: float) -> Witness:
    """By whose word a stop is one: the receiver's before the wheels', and else the rows' alone."""
    inside = (motion.time_s >= start_s + BRAKING_S) & (motion.time_s <= end_s)
    for witness in (Witness.GNSS, Witness.WHEELS):
        if (motion.of(witness).says[inside] == Says.STANDS).any():
            return witness
    return Witness.ROWS


def stop_speed(history: NavHistory, stop: StopInterval) -> StopSpeed:
    rows = (history.time_s >= stop.start_s) & (history.time_s <= stop.end_s)
    speed = np.linalg.norm(history.v_n_m_s[rows, :2], axis=1)
    median_m_s = float(np.median(speed))
    return StopSpeed(
        start_s=stop.start_s,
        end_s=stop.end_s,
        ground_speed_m_s=median_m_s,
        ground_speed_kt=median_m_s / KNOT,
        max_m_s=float(speed.max()),
        realign=median_m_s > REALIGN_M_S,
        seen_by=stop.seen_by,
    )
