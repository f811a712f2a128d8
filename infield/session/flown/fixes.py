"""Satellite fixes over a whole flown session: one position and one velocity a step, level.

The antenna's arm and the delays are taken as found so far (`Antenna`), their states are about the
declared ones: what was found goes back into z, as in `infield.session.navigated.taxi_heading`.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import CubicSpline

from alignment.navigation_filter import StepViews
from infield.session.flown.priors import Further, Layout
from infield.session.navigated.receiver import sigma_of_fixes
from infield.session.navigated.taxi_heading import velocity_rows
from ins.attitude import dcm_from_rotation_vector, skew
from ins.earth import EARTH_RATE_RAD_S, displacement_ned
from ins.filters import error_model as em
from ins.filters.error_filter import GATE_SIGMA, ErrorFilter
from ins.filters.program import FilterProgram
from ins.records import GnssLog, ImuSource, NavHistory

OF_POSITION, OF_VELOCITY = "flight position", "flight velocity"
# faster than that no two good fixes are the same to their last bit, 1e-9 deg; as
# infield.aided.checks
REPEATS_ABOVE_M_S = 0.5
# over which rows are summed for the rate at a fix; chosen: it leaves 99.8 % of turbulence at
# 0.35 Hz and averages what shakes the unit
RATE_OVER_S = 0.1
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


class _Motion(NamedTuple):
    """The vehicle at some times (m): place (m, 3) as latitude, longitude and height; velocity,
    attitude, rate of the body (m, 3) [rad/s]; what turning adds to the antenna's velocity (m, 3),
    and the antenna's acceleration (m, 3), NED.
    """

    place: NDArray
    v_n: NDArray
    C_nb: NDArray
    rate_rad_s: NDArray
    swing_n: NDArray
    acceleration_n: NDArray

    def at(self, rows: NDArray | slice) -> "_Motion":
        return _Motion(*(column[rows] for column in self))


def sums_up_to(imu: ImuSource, time_s: NDArray) -> NDArray:
    """Turn [rad] and velocity [m/s] that the rows of a log add up to at given times (m, 6), body
    axes, straight within a row.
    """
    order = np.argsort(time_s)
    ordered_s, sums, total = time_s[order], np.zeros((time_s.size, 6)), np.zeros(6)
    for piece in imu.pieces():
        t = np.append(piece.time_s[0] - piece.dt_s[0], piece.time_s)
        grown = np.cumsum(np.vstack([total, np.hstack([piece.dtheta_rad, piece.dv_m_s])]), axis=0)
        here = order[slice(*np.searchsorted(ordered_s, t[[0, -1]], side="right"))]
        sums[here] = np.column_stack([np.interp(time_s[here], t, column) for column in grown.T])
        total = grown[-1]
    sums[time_s > imu.end_s] = total
    return sums


@dataclass(frozen=True)
class FixAid:
    """The fixes of a log against a solution."""

    log: GnssLog
    sigmas: Sigmas
    antenna: Antenna
    layout: Layout
    history: NavHistory
    imu: ImuSource

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

    def _fixes(self, views: StepViews, delay_s: float) -> tuple[NDArray, NDArray]:
        """Steps with a fix (m,), and the fix."""
        measured_s = self.log.time_s - delay_s
        fix = np.searchsorted(measured_s, views.end_s + 1e-6) - 1
        at = np.flatnonzero((fix >= 0) & (measured_s[fix] > views.start_s + 1e-6))
        return at, fix[at]

    @cached_property
    def _motions(self) -> tuple[_Motion, _Motion]:
        """The vehicle when each position and each velocity of the log was measured: one reading of
        the rows for all sweeps.
        """
        delays = self.antenna.delay_s, self.antenna.velocity_delay_s
        every = self._motion(np.concatenate([self.log.time_s - delay for delay in delays]))
        count = self.log.time_s.size
        return every.at(slice(count)), every.at(slice(count, None))

    def _motion(self, time_s: NDArray) -> _Motion:
        """The solution at its epochs, the rows in between."""
        h, arm, half = self.history, self.antenna.arm_m, 0.5 * RATE_OVER_S
        place = np.column_stack([h.lat_rad, np.unwrap(h.lon_rad), h.height_m])
        k = np.clip(np.searchsorted(h.time_s, time_s, side="right") - 1, 0, h.time_s.size - 2)
        asked = [h.time_s[k], h.time_s[k + 1], time_s - half, time_s, time_s + half]
        sums = np.split(sums_up_to(self.imu, np.concatenate(asked)), len(asked))
        C_start = h.C_nb[k]

        def since_epoch(rows: NDArray) -> NDArray:
            turned, pushed = np.split(rows - sums[0], 2, axis=1)
            return np.einsum("kij,kj->ki", C_start, pushed + 0.5 * np.cross(turned, pushed))

        whole = h.time_s[k + 1] - h.time_s[k]
        left = (h.v_n_m_s[k + 1] - h.v_n_m_s[k] - since_epoch(sums[1])) / whole[:, None]
        turned = sums[3][:, :3] - sums[0][:, :3]
        C_nb = C_start @ dcm_from_rotation_vector(turned)
        rate = (sums[4] - sums[2])[:, :3] / RATE_OVER_S
        faster = (sums[4] - 2.0 * sums[3] + sums[2])[:, :3] / half**2
        pull = np.cross(faster, arm) + np.cross(rate, np.cross(rate, arm))
        return _Motion(
            place=CubicSpline(h.time_s, place)(time_s),
            v_n=h.v_n_m_s[k] + since_epoch(sums[3]) + left * (time_s - h.time_s[k])[:, None],
            C_nb=C_nb,
            rate_rad_s=rate,
            swing_n=np.einsum("kij,kj->ki", C_nb, np.cross(rate, arm)),
            acceleration_n=(since_epoch(sums[4]) - since_epoch(sums[2])) / RATE_OVER_S
            + left
            + np.einsum("kij,kj->ki", C_nb, pull),
        )

    def _positions(self, program: FilterProgram, views: StepViews) -> None:
        at, k = self._fixes(views, self.antenna.delay_s)
        motion = self._motions[0].at(k)
        way = displacement_ned(
            self.log.lat_rad[k],
            self.log.lon_rad[k],
            lat0_rad=motion.place[:, 0],
            lon0_rad=motion.place[:, 1],
            height0_m=motion.place[:, 2],
        )
        of_antenna = (motion.v_n + motion.swing_n)[:, :2]
        arm_n = (motion.C_nb @ self.antenna.arm_m)[:, :2]
        z = arm_n - way + of_antenna * self.antenna.delay_s
        sigma = sigma_of_fixes(self.log.sigma_horizontal_m, k, self.sigmas.horizontal_m)
        rows: list[dict[int, ArrayLike]] = [{em.POS.start + i: 1.0} for i in range(2)]
        self._with_receiver(rows, Further.SLOW_POSITION)
        self._with_antenna(rows, -motion.C_nb[:, :2, :], of_antenna, 0)
        program.measure(OF_POSITION, at, z.T, rows, [sigma**2, sigma**2], gate=GATE_SIGMA)

    def _velocities(self, program: FilterProgram, views: StepViews) -> None:
        at, k = self._fixes(views, self.antenna.velocity_delay_s)
        motion = self._motions[1].at(k)
        acceleration = motion.acceleration_n[:, :2]
        z = (motion.v_n + motion.swing_n)[:, :2] - self.log.v_n_m_s[k, :2]
        z = z + acceleration * self.antenna.velocity_delay_s
        sigma = sigma_of_fixes(self.log.sigma_velocity_m_s, k, self.sigmas.velocity_m_s)
        rows = velocity_rows(views, at, motion.v_n)
        of_arm = -(motion.C_nb @ skew(motion.rate_rad_s))[:, :2]
        self._with_receiver(rows, Further.SLOW_VELOCITY)
        self._with_antenna(rows, of_arm, acceleration, 1)
        program.measure(OF_VELOCITY, at, z.T, rows, [sigma**2, sigma**2], gate=GATE_SIGMA)

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
