"""Satellite fixes over a whole flown session: one position and one velocity a step, level.

The antenna's arm and the delays are taken as found so far (`Antenna`), their states are about the
declared ones: what was found goes back into z, as in `infield.session.navigated.taxi_heading`.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import CubicSpline

from alignment.navigation_filter import StepViews
from infield.session.flown.priors import Further, Layout
from infield.session.navigated.receiver import sigma_of_fixes
from infield.session.navigated.taxi_heading import velocity_rows
from ins.earth import EARTH_RATE_RAD_S, displacement_ned
from ins.filters import error_model as em
from ins.filters.error_filter import GATE_SIGMA, ErrorFilter
from ins.filters.program import FilterProgram
from ins.records import GnssLog, NavHistory

OF_POSITION, OF_VELOCITY = "flight position", "flight velocity"
# faster than that no two good fixes are the same to their last bit, 1e-9 deg; as
# infield.aided.checks
REPEATS_ABOVE_M_S = 0.5
# of what the turning arm adds to the velocity of the antenna: the rate within a second is not
# its mean
SWING_SHARE = 0.1
# without a fix the height is a straight line; a climb of 10 m/s turns with the Earth into 0.04 m/s
# in 30 s, a fix's own sigma
UNHELD_S = 30.0
CLIMB_M_S = 10.0  # of an airliner, 2000 ft/min; its climb rate is unknown by as much


@dataclass(frozen=True)
class Antenna:
    """Lever arm from the IMU (3,) [m] and delays of positions and velocities [s], as found beside
    the declared arm.
    """

    arm_m: NDArray
    delay_s: float = 0.0
    velocity_delay_s: float = 0.0

    def found(self, flt: ErrorFilter, layout: Layout) -> "Antenna":
        """The same about what a filter found."""
        delays = flt.x[list(layout.indices(Further.DELAY))]
        if not delays.size:
            return self
        return replace(self, delay_s=float(delays[0]), velocity_delay_s=float(delays[1]))


@dataclass(frozen=True)
class Sigmas:
    """Declared noise of a receiver, one component [m], [m/s]."""

    horizontal_m: float
    velocity_m_s: float


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
class FixAid:
    """The fixes of a log against a solution."""

    log: GnssLog
    sigmas: Sigmas
    antenna: Antenna
    layout: Layout
    history: NavHistory

    def measure(self, program: FilterProgram, views: StepViews) -> None:
        """Lay down the last fix of each step."""
        self._outages(program, views)
        self._positions(program, views)
        self._velocities(program, views)

    def _outages(self, program: FilterProgram, views: StepViews) -> None:
        """What an unseen height may do to level velocity and position while no fix holds it.

        The height is a straight line between the fixes; a climb rate wrong by CLIMB_M_S turns with
        the Earth into a level acceleration (Coriolis), and that is the size taken for possible.
        """
        gap_s = np.diff(self.log.time_s)
        for k in np.flatnonzero(gap_s > UNHELD_S):
            lost_m_s = 2.0 * EARTH_RATE_RAD_S * CLIMB_M_S * gap_s[k]
            step = np.searchsorted(views.end_s, self.log.time_s[k + 1] - 1e-6)
            at = np.array([min(int(step), views.end_s.size - 1)])
            for i in range(2):
                program.widen(at, em.W.start + i, lost_m_s**2)
                program.widen(at, em.POS.start + i, (lost_m_s * gap_s[k]) ** 2)

    def _fixes(self, views: StepViews, delay_s: float) -> tuple[NDArray, NDArray, NDArray]:
        """Steps with a fix (m,), the fix, and when it was measured [s]."""
        measured_s = self.log.time_s - delay_s
        fix = np.searchsorted(measured_s, views.end_s + 1e-6) - 1
        at = np.flatnonzero((fix >= 0) & (measured_s[fix] > views.start_s + 1e-6))
        return at, fix[at], measured_s[fix[at]]

    def _solution(self, time_s: NDArray) -> tuple[NDArray, NDArray, NDArray]:
        """Latitude, longitude and height (m, 3), velocity and acceleration (m, 3) at some times."""
        h = self.history
        place = np.column_stack([h.lat_rad, np.unwrap(h.lon_rad), h.height_m])
        velocity = CubicSpline(h.time_s, h.v_n_m_s)
        return CubicSpline(h.time_s, place)(time_s), velocity(time_s), velocity(time_s, 1)

    def _arm(self, views: StepViews, at: NDArray, time_s: NDArray) -> tuple[NDArray, NDArray]:
        """Arm of the antenna and its velocity by the turning of the body, level NED (m, 2)."""
        C = views.C_nb[at]
        swing = np.cross(self._turning(time_s), self.antenna.arm_m)
        return (C @ self.antenna.arm_m)[:, :2], np.einsum("kij,kj->ki", C, swing)[:, :2]

    def _turning(self, time_s: NDArray) -> NDArray:
        """Angular rate of the body (m, 3) [rad/s] at some times, between the means of epochs."""
        h = self.history
        dt = np.diff(h.time_s)
        middle, rate = h.time_s[1:] - 0.5 * dt, h.dtheta_b_rad[1:] / dt[:, None]
        return np.column_stack([np.interp(time_s, middle, r) for r in rate.T])

    def _positions(self, program: FilterProgram, views: StepViews) -> None:
        at, k, time_s = self._fixes(views, self.antenna.delay_s)
        place, v_n, _ = self._solution(time_s)
        way = displacement_ned(
            self.log.lat_rad[k],
            self.log.lon_rad[k],
            lat0_rad=place[:, 0],
            lon0_rad=place[:, 1],
            height0_m=place[:, 2],
        )
        arm_n, swing = self._arm(views, at, time_s)
        of_antenna = v_n[:, :2] + swing
        z = arm_n - way + of_antenna * self.antenna.delay_s
        sigma = sigma_of_fixes(self.log.sigma_horizontal_m, k, self.sigmas.horizontal_m)
        rows: list[dict[int, ArrayLike]] = [{em.POS.start + i: 1.0} for i in range(2)]
        self._with_receiver(rows, Further.SLOW_POSITION)
        self._with_antenna(rows, -views.C_nb[at, :2, :], of_antenna, 0)
        program.measure(OF_POSITION, at, z.T, rows, [sigma**2, sigma**2], gate=GATE_SIGMA)

    def _velocities(self, program: FilterProgram, views: StepViews) -> None:
        at, k, time_s = self._fixes(views, self.antenna.velocity_delay_s)
        _, v_n, acceleration = self._solution(time_s)
        _, swing = self._arm(views, at, time_s)
        z = v_n[:, :2] + swing - self.log.v_n_m_s[k, :2]
        z = z + acceleration[:, :2] * self.antenna.velocity_delay_s
        sigma = sigma_of_fixes(self.log.sigma_velocity_m_s, k, self.sigmas.velocity_m_s)
        variance = sigma**2 + (SWING_SHARE * np.linalg.norm(swing, axis=1)) ** 2
        rows = velocity_rows(views, at, v_n)
        rate = self._turning(time_s)
        zero = np.zeros(len(at))
        spin = np.stack(
            [
                np.column_stack([zero, -rate[:, 2], rate[:, 1]]),
                np.column_stack([rate[:, 2], zero, -rate[:, 0]]),
                np.column_stack([-rate[:, 1], rate[:, 0], zero]),
            ],
            axis=1,
        )
        of_arm = -np.einsum("kij,kjl->kil", views.C_nb[at], spin)[:, :2]
        self._with_receiver(rows, Further.SLOW_VELOCITY)
        self._with_antenna(rows, of_arm, acceleration[:, :2], 1)
        program.measure(OF_VELOCITY, at, z.T, rows, [variance, variance], gate=GATE_SIGMA)

    def _with_receiver(self, rows: list[dict[int, ArrayLike]], state: Further) -> None:
        """The receiver's slow error in north and east rows, in place."""
        for row, k in zip(rows, self.layout.indices(state)):
            row[k] = -1.0

    def _with_antenna(
        self, rows: list[dict[int, ArrayLike]], of_arm: NDArray, of_delay: NDArray, delay: int
    ) -> None:
        """Errors of arm (m, 2, 3) and delay (m, 2) in north and east rows, in place."""
        delays = self.layout.indices(Further.DELAY)
        for i, row in enumerate(rows):
            for axis, k in enumerate(self.layout.indices(Further.ANTENNA)):
                row[k] = of_arm[:, i, axis]
            if delays:
                row[delays[delay]] = of_delay[:, i]
