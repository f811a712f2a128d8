"""Where the vehicle stands again after it first rolled, and how fast a free-inertial solution says
it goes there.

A steady roll looks like rest to inertial sensors alone: a stop that a receiver or an odometer
covers needs their word, one that neither covers is named as found by the IMU alone.
"""

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from alignment.motion import excursions, kinds, stillness
from alignment.motion.kinds import Says
from alignment.motion.speeds import WHEELS_STAND_M_S, receiver_says
from infield.replay.drift import REALIGN_M_S
from ins.records import NavHistory, Run
from ins.robust import runs_of_true

# spread of the velocity within a standing vehicle's eight seconds, above its own noise
STOP_QUIET_M_S = 0.03
# a faster "stop" is a steady taxi, unless the log calls it parked
STOP_BELOW_M_S = 2.0 * REALIGN_M_S

BRAKING_S = 2.0  # at the start of a stop: the last of the braking, and a receiver that is late


class Witness(StrEnum):
    """Whose word there is for a stop; IMU: no receiver and no odometer covers it."""

    GNSS = "gnss"
    ODOMETER = "odometer"
    IMU = "imu"


@dataclass(frozen=True)
class Stop:
    """Start and end [s] of a stop, and by whose word."""

    start_s: float
    end_s: float
    seen_by: Witness


@dataclass(frozen=True, kw_only=True)
class StopSpeed:
    """Computed ground speed [m/s] while the vehicle stands: all of it is error. seen_by: as of a
    Stop.
    """

    start_s: float
    end_s: float
    median_m_s: float
    max_m_s: float
    seen_by: Witness = Witness.IMU

    @property
    def realign(self) -> bool:
        return self.median_m_s > REALIGN_M_S


def first_roll(motion: stillness.Motion) -> float:
    """End of the parked span: the last epoch before the vehicle rolls, or the end of the log
    [s].
    """
    rolling = np.flatnonzero(motion.kind >= kinds.ROLLING)
    return float(motion.time_s[max(rolling[0] - 1, 0)] if rolling.size else motion.time_s[-1])


def find_stops(history: NavHistory, motion: stillness.Motion, run: Run) -> tuple[Stop, ...]:
    """Where the vehicle stands again after it first rolled, for at least eight seconds.

    The velocity is steady to 3 cm/s (or eight sigmas of its noise), and either below 10 kt or the
    log says parked; GNSS and odometer, where there are any, must agree. The same rule on the ramp
    after a flight, where the solution's own speed may be several knots wrong.
    """
    t, v = history.time_s, history.v_n_m_s[:, :2]
    width = excursions.STOP_WINDOW_S
    steady = np.zeros(t.size, bool)
    quiet = max(8.0 * motion.sigma_v_m_s, STOP_QUIET_M_S)
    for k in np.flatnonzero(t[: t.size - width + 1] >= first_roll(motion)):
        if np.ptp(v[k : k + width], axis=0).max() <= quiet:
            steady[k : k + width] = True
    said = np.zeros(t.size, bool)
    for p in run.phases:
        said |= (p.phase == "parked") & (t > p.start_s) & (t <= p.end_s)
    stands = (
        steady & (said | (np.linalg.norm(v, axis=1) < STOP_BELOW_M_S)) & (t > first_roll(motion))
    )
    if run.odometer is not None:
        stands &= (
            np.abs(np.interp(t, run.odometer.time_s, run.odometer.speed_m_s, left=0.0, right=0.0))
            < WHEELS_STAND_M_S
        )
    found = []
    for a, b in runs_of_true(stands):
        start_s, end_s = float(t[a]), float(t[b - 1])
        received = receiver_says(run.gnss, start_s + BRAKING_S, end_s).said
        if b - a < width or received is Says.MOVES:
            continue
        rolled = run.odometer is not None and bool(
            ((run.odometer.time_s >= start_s) & (run.odometer.time_s <= end_s)).any()
        )
        without_receiver = Witness.ODOMETER if rolled else Witness.IMU
        seen_by = Witness.GNSS if received is Says.STANDS else without_receiver
        found.append(Stop(start_s, end_s, seen_by))
    return tuple(found)


def stop_speed(history: NavHistory, stop: Stop) -> StopSpeed:
    rows = (history.time_s >= stop.start_s) & (history.time_s <= stop.end_s)
    speed = np.linalg.norm(history.v_n_m_s[rows, :2], axis=1)
    return StopSpeed(
        start_s=stop.start_s,
        end_s=stop.end_s,
        median_m_s=float(np.median(speed)),
        max_m_s=float(speed.max()),
        seen_by=stop.seen_by,
    )
