"""Satellite fixes over a whole flown session: one position and one velocity a step, level."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from alignment.navigation_filter import StepViews
from infield.session.flown.priors import Further, Layout
from infield.session.navigated.receiver import FixAid
from ins.earth import EARTH_RATE_RAD_S
from ins.estimation import error_model as em
from ins.estimation.error_filter import ErrorFilter
from ins.estimation.measurements.antenna import Antenna
from ins.estimation.measurements.fix import ReceiverStates
from ins.estimation.tape import Tape
from ins.records import GnssLog

OF_POSITION, OF_VELOCITY = "flight position", "flight velocity"
# faster than that no two good fixes are the same to their last bit, 1e-9 deg; as
# infield.aided.checks
REPEATS_ABOVE_M_S = 0.5
# without a fix the height is a straight line; a climb of 10 m/s turns with the Earth into 0.04 m/s
# in 30 s, a fix's own sigma
UNHELD_S = 30.0
CLIMB_M_S = 10.0  # of an airliner, 2000 ft/min; its climb rate is unknown by as much


def receiver_states(layout: Layout) -> ReceiverStates:
    """Where a flight holds what its receiver may have wrong."""
    delays = layout.indices(Further.DELAY)
    return ReceiverStates(
        arm=layout.indices(Further.ANTENNA),
        delay=delays[:1],
        velocity_delay=delays[1:],
        slow_position=layout.indices(Further.SLOW_POSITION),
        slow_velocity=layout.indices(Further.SLOW_VELOCITY),
    )


def with_delays(antenna: Antenna, flt: ErrorFilter, layout: Layout) -> Antenna:
    """An antenna with the delays that a filter found."""
    delays = flt.x[list(layout.indices(Further.DELAY))]
    if not delays.size:
        return antenna
    return replace(antenna, delay_s=float(delays[0]), velocity_delay_s=float(delays[1]))


def usable(log: GnssLog) -> tuple[GnssLog, int]:
    """The fixes that are whole and are no repetition of the one before; how many were repeated."""
    whole = np.isfinite(log.lat_rad) & np.isfinite(log.lon_rad)
    whole &= np.isfinite(log.v_n_m_s[:, :2]).all(axis=1)
    speed = np.linalg.norm(log.v_n_m_s, axis=1)
    same = np.zeros(log.time_s.size, dtype=bool)
    same[1:] = (np.diff(log.lat_rad) == 0.0) & (np.diff(log.lon_rad) == 0.0)
    same &= speed > REPEATS_ABOVE_M_S
    kept = whole & ~same
    return only(log, kept), int(same.sum())


def only(log: GnssLog, kept: NDArray) -> GnssLog:
    """Some fixes of a log (n,) bool."""

    def of(column: NDArray | None) -> NDArray | None:
        return None if column is None else column[kept]

    return GnssLog(
        time_s=log.time_s[kept],
        lat_rad=log.lat_rad[kept],
        lon_rad=log.lon_rad[kept],
        height_m=log.height_m[kept],
        v_n_m_s=log.v_n_m_s[kept],
        sigma_horizontal_m=of(log.sigma_horizontal_m),
        sigma_vertical_m=of(log.sigma_vertical_m),
        sigma_velocity_m_s=of(log.sigma_velocity_m_s),
        fix_type=of(log.fix_type),
    )


@dataclass(frozen=True)
class FlightFixes:
    """The fixes of a flight, and what an unseen height may do while there are none."""

    fixes: FixAid

    def measure(self, tape: Tape, views: StepViews) -> None:
        """Lay down outages, then the last fix of each step.

        The height is a straight line between the fixes; a climb rate wrong by CLIMB_M_S turns with
        the Earth into a level acceleration (Coriolis), and that is the size taken for possible.
        """
        time_s = self.fixes.log.time_s
        gap_s = np.diff(time_s)
        for k in np.flatnonzero(gap_s > UNHELD_S):
            lost_m_s = 2.0 * EARTH_RATE_RAD_S * CLIMB_M_S * gap_s[k]
            step = np.searchsorted(views.end_s, time_s[k + 1] - 1e-6)
            at = np.array([min(int(step), views.end_s.size - 1)])
            for i in range(2):
                tape.widen(at, em.W.start + i, lost_m_s**2)
                tape.widen(at, em.POS.start + i, (lost_m_s * gap_s[k]) ** 2)
        self.fixes.measure(tape, views)
