"""The fixes of a receiver against a solution, as `ins.estimation.measurements.fix` compares them:
which of them each step takes, and with what noise.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from alignment.motion.kinds import ROLLING
from alignment.navigation_filter import StepViews
from infield.session.navigated.receiver import sigma_of_fixes
from ins.estimation.error_filter import GATE_SIGMA
from ins.estimation.measurements import fix
from ins.estimation.measurements.antenna import Antenna, AntennaMotion, RowSums, motion_at
from ins.estimation.tape import Tape
from ins.records import GnssLog, NavHistory


@dataclass(frozen=True)
class Sigmas:
    """Declared noise of a receiver, one component [m], [m/s]."""

    horizontal_m: float
    velocity_m_s: float


@dataclass(frozen=True, kw_only=True)
class FixAid:
    """The fixes of a log against a solution.

    rows: of the solution's log; names: of the kinds of measurement, positions and velocities;
    of_each_step: how many fixes at most a rolling step takes, its last ones; any other takes one.
    """

    log: GnssLog
    sigmas: Sigmas
    antenna: Antenna
    states: fix.ReceiverStates
    history: NavHistory
    rows: RowSums
    names: tuple[str, str]
    of_each_step: int = 1

    def measure(self, tape: Tape, views: StepViews) -> None:
        """Lay down the fixes of each step."""
        for back in range(self.of_each_step, 0, -1):
            self._positions(tape, views, *self._fixes(views, back, self.antenna.delay_s))
            delay_s = self.antenna.velocity_delay_s
            self._velocities(tape, views, *self._fixes(views, back, delay_s))

    def _fixes(self, views: StepViews, back: int, delay_s: float) -> tuple[NDArray, NDArray]:
        """Steps (m,), and their fix that is the last but `back` - 1."""
        measured_s = self.log.time_s - delay_s
        before = np.searchsorted(measured_s, views.start_s + 1e-6, side="right")
        fixes = np.searchsorted(measured_s, views.end_s + 1e-6) - back
        takes = (views.kind == ROLLING) | (back == 1)
        at = np.flatnonzero((fixes >= before) & takes)
        return at, fixes[at]

    @cached_property
    def _motions(self) -> tuple[AntennaMotion, AntennaMotion]:
        """When each position and each velocity of the log was measured."""
        delays = self.antenna.delay_s, self.antenna.velocity_delay_s
        time_s = np.concatenate([self.log.time_s - delay for delay in delays])
        every = motion_at(self.history, self.rows, self.antenna.arm_m, time_s)
        count = self.log.time_s.size
        return every.at(slice(count)), every.at(slice(count, None))

    def _positions(self, tape: Tape, views: StepViews, at: NDArray, k: NDArray) -> None:
        log, motion = self.log, self._motions[0].at(k)
        places = log.lat_rad[k], log.lon_rad[k], log.height_m[k]
        z, rows = fix.position(motion, self.antenna, places, self.states)
        variance = sigma_of_fixes(log.sigma_horizontal_m, k, self.sigmas.horizontal_m) ** 2
        tape.measure(self.names[0], at, z, rows, [variance, variance], gate=GATE_SIGMA)

    def _velocities(self, tape: Tape, views: StepViews, at: NDArray, k: NDArray) -> None:
        log, motion = self.log, self._motions[1].at(k)
        rolls = (views.kind[at] == ROLLING)[:, None]
        about = np.where(rolls, motion.v_n + motion.swing_n(self.antenna.arm_m), 0.0)
        z, rows = fix.velocity(motion, self.antenna, log.v_n_m_s[k], self.states, about_n=about)
        variance = sigma_of_fixes(log.sigma_velocity_m_s, k, self.sigmas.velocity_m_s) ** 2
        tape.measure(self.names[1], at, z, rows, [variance, variance], gate=GATE_SIGMA)
