"""Where the vehicle stands again after it first rolled, and how fast a free-inertial solution says it goes there."""

from dataclasses import dataclass

import numpy as np

from alignment import excursions, stillness
from infield.drift import REALIGN_M_S
from ins.records import NavHistory, Run

STOP_QUIET_M_S = 0.03  # spread of the velocity within a standing vehicle's eight seconds, above its own noise
STOP_BELOW_M_S = 2.0 * REALIGN_M_S  # a faster "stop" is a steady taxi, unless the log calls it parked

Where = tuple[float, float]  # start and end [s]


@dataclass(frozen=True, kw_only=True)
class StopSpeed:
    """Computed ground speed [m/s] while the vehicle stands: all of it is error."""

    start_s: float
    end_s: float
    median_m_s: float
    max_m_s: float

    @property
    def realign(self) -> bool:
        return self.median_m_s > REALIGN_M_S


def first_roll(motion: stillness.Motion) -> float:
    """End of the parked span: the last epoch before the vehicle rolls, or the end of the log [s]."""
    rolling = np.flatnonzero(motion.kind >= stillness.ROLLING)
    return float(motion.time_s[max(rolling[0] - 1, 0)] if rolling.size else motion.time_s[-1])


def find_stops(history: NavHistory, motion: stillness.Motion, run: Run) -> tuple[Where, ...]:
    """Where the vehicle stands again after it first rolled, for at least eight seconds.

    The velocity is steady to 3 cm/s (or eight sigmas of its noise), and either below 10 kt or the log says parked;
    an odometer, where there is one, must agree. The same rule on the ramp after a flight, where the solution's own
    speed may be several knots wrong.
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
    stands = steady & (said | (np.linalg.norm(v, axis=1) < STOP_BELOW_M_S)) & (t > first_roll(motion))
    if run.odometer is not None:
        stands &= np.abs(np.interp(t, run.odometer.time_s, run.odometer.speed_m_s, left=0.0, right=0.0)) < 0.5
    edges = np.flatnonzero(np.diff(np.concatenate(([0], stands.astype(int), [0]))))
    return tuple((float(t[a]), float(t[b - 1])) for a, b in zip(edges[::2], edges[1::2]) if b - a >= width)


def stop_speed(history: NavHistory, where: Where) -> StopSpeed:
    rows = (history.time_s >= where[0]) & (history.time_s <= where[1])
    speed = np.linalg.norm(history.v_n_m_s[rows, :2], axis=1)
    return StopSpeed(start_s=where[0], end_s=where[1], median_m_s=float(np.median(speed)), max_m_s=float(speed.max()))
