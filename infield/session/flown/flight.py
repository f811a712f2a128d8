"""When a session flies, and what its vehicle does from the first take-off on."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from alignment.motion.inertial import Where
from alignment.motion.kinds import AIRBORNE, ROLLING, STILL
from alignment.motion.seconds import seconds_of
from alignment.motion.speeds import find_stands
from alignment.motion.stillness import TAKE_OFF_M_S, Motion
from alignment.navigation_filter import StepPlan, StepViews
from infield.session.bins import SessionBins
from infield.session.estimate import SessionEstimate
from infield.session.flown.priors import Further, Layout, laid_out
from infield.session.log import session_end
from infield.session.navigated.own_errors import LoggedRun, OwnErrors, own_errors
from infield.session.navigated.receiver import FixAid
from infield.session.settings import SessionSettings
from infield.table.thermal_table import ThermalTable
from infield.thermometer.gyro_temperature import GyroTemperature
from ins.earth import EARTH_RATE_RAD_S
from ins.estimation import error_model as em
from ins.estimation.error_filter import ErrorFilter
from ins.estimation.measurements.antenna import Antenna
from ins.estimation.measurements.fix import ReceiverStates
from ins.estimation.tape import Tape
from ins.filters.aided_records import Fixes, fixes_of
from ins.records import GnssLog, NavHistory, Run, TwinModel


@dataclass(frozen=True)
class RunInputs:
    """A run with its temperatures, table, twin and settings."""

    run: Run
    table: ThermalTable
    temperature: GyroTemperature
    twin: TwinModel
    settings: SessionSettings

    def with_shift(self, size_deg_h: float) -> "RunInputs":
        """The same with gyros that may read so much more in flight than at rest (1 sigma)."""
        return replace(
            self, settings=self.settings.with_shift(self.run.header.gyro_technology, size_deg_h)
        )

    @property
    def gyro_sigma_deg_h(self) -> NDArray:
        """What the table and a turn-on leave open of each gyro (3,), 1 sigma."""
        P = self.table.covariance
        nodes = [np.sqrt(np.diag(P)[self.table.values_of(k)].max()) for k in range(3)]
        return np.hypot(nodes, self.twin.gyro.turn_on_deg_h)

    def own_errors(self, layout: Layout, flight: Where, rest: Where, C_nb: NDArray) -> OwnErrors:
        """What users' errors add, their states after the further ones; rest: a first stretch of the
        session, at the attitude C_nb (3, 3).
        """
        errors = own_errors(
            LoggedRun(self.run, self.table, self.temperature),
            self.twin,
            rest=rest,
            attitude=lambda: C_nb,
            first=layout.first + layout.sigma.size,
        )
        return replace(errors, airborne=flight)

    def layout(self, bins: SessionBins) -> Layout:
        """Where the further states stand, after the bins."""
        technology = self.run.header.gyro_technology
        return laid_out(
            self.settings.flight,
            technology,
            first=em.BASE + bins.table_deg_h.size,
            scale_ppm=self.settings.sigma_scale_factor_ppm[technology],
            accel_z_ug=max(self.twin.accel.turn_on_ug, 1.0),
        )


# of a flight with fixes that is worth a pass: a parked rest needs 300 s too
# (`infield.session.acceptance`)
LEAST_FLOWN_S = 300.0
# of the seconds of a flight that have a fix; chosen, docs/flight_update.md
LEAST_WITH_FIXES = 0.5
# Steps of a straight flight may be joined: errors of a solution turn slowly, and fixes of 0.2 Hz
# see a gyro's white noise as well as fixes of 1 Hz do (it outgrows them within 100 s).
CRUISE_STEP_S = 5.0
STRAIGHT_RAD_S = 2e-3  # of turning about any axis: 0.6 deg in a joined step
STEADY_M_S2 = 0.05  # of acceleration: 0.25 m/s in a joined step


@dataclass(frozen=True)
class Flight:
    """start_s: first take-off; end_s: the last time the receiver is fast; stands: rests after it;
    covered: share of the seconds between that have a fix.
    """

    start_s: float
    end_s: float
    stands: tuple[Where, ...]
    covered: float

    @property
    def duration_s(self) -> float:
        return self.end_s - self.start_s


def find_flight(
    run: Run, fixes: GnssLog, twin: TwinModel, ground: SessionEstimate
) -> Flight | None:
    """The flight of a run whose ground session was estimated; None where it does not fly, or not
    with a receiver.
    """
    fast = np.linalg.norm(fixes.v_n_m_s[:, :2], axis=1) > TAKE_OFF_M_S
    if not fast.any():
        return None
    airborne = ground.motion.time_s[ground.motion.kind == AIRBORNE]
    start_s = min(float(airborne[0]) if airborne.size else np.inf, session_end(run))
    end_s = float(fixes.time_s[fast][-1])
    if end_s - start_s < LEAST_FLOWN_S:
        return None
    stands = find_stands(seconds_of(run.imu), declared_fixes(fixes, twin))
    return Flight(
        start_s=start_s,
        end_s=end_s,
        stands=tuple(stand for stand in stands if stand[0] > end_s),
        covered=covered_share(fixes, start_s, end_s),
    )


def declared_fixes(log: GnssLog, twin: TwinModel) -> Fixes:
    """The fixes of a log with the twin's sigmas where it has none."""
    return fixes_of(
        log,
        horizontal_m=twin.gnss.sigma_horizontal_m,
        vertical_m=twin.gnss.sigma_vertical_m,
        velocity_m_s=twin.gnss.sigma_velocity_m_s,
    )


def covered_share(fixes: GnssLog, start_s: float, end_s: float) -> float:
    """Share of the seconds of a flight that have a fix."""
    inside = fixes.time_s[(fixes.time_s > start_s) & (fixes.time_s <= end_s)]
    return min(np.unique(np.floor(inside)).size / (end_s - start_s), 1.0)


def flown_motion(history: NavHistory, ground: Motion, flight: Flight) -> Motion:
    """The motion of a whole session: as the ground session found it up to take-off, then moving but
    for the rests.

    What moves after take-off counts as rolling: the filter asks no wheels of it.
    """
    t = history.time_s
    kind = np.full(t.size, int(ROLLING))
    before = int(np.searchsorted(t, flight.start_s))
    before = min(before, ground.time_s.size)
    kind[:before] = ground.kind[:before]
    for start, end in flight.stands:
        kind[(t > start) & (t <= end)] = STILL
    cause = np.full(t.size, "", dtype=object)
    if ground.cause.size:
        cause[:before] = ground.cause[:before]

    def continued(values: NDArray) -> NDArray:
        whole = np.zeros(t.size)
        whole[:before] = values[:before]
        return whole

    jumps, turns = ground.velocity_jump_m_s, ground.turn_jump_rad

    return replace(
        ground,
        time_s=t,
        kind=kind,
        jolt_rad=continued(ground.jolt_rad),
        cause=cause,
        velocity_jump_m_s=None if jumps is None else continued(jumps),
        turn_jump_rad=None if turns is None else continued(turns),
        disturbed=None,
        turn_rad=None,
        evidence=(),
    )


def joined_cruise(plan: StepPlan, history: NavHistory, flight: Flight) -> StepPlan:
    """The plan with steps of straight, steady flight joined to CRUISE_STEP_S, within a bin."""
    t, first, last = history.time_s, plan.first, plan.last
    dt = t[last] - t[first]
    turning = np.abs(history.dtheta_b_rad[last]).max(axis=1) / dt > STRAIGHT_RAD_S
    change = np.linalg.norm(history.v_n_m_s[last] - history.v_n_m_s[first], axis=1)
    calm = ~turning & (change / dt < STEADY_M_S2)
    calm &= (t[first] >= flight.start_s) & (t[last] <= flight.end_s)
    calm &= last - first == 1
    heads = [0]
    for k in range(1, first.size):
        joins = calm[k] and calm[k - 1] and plan.bin_index[k] == plan.bin_index[k - 1]
        if not joins or t[last[k]] - t[first[heads[-1]]] > CRUISE_STEP_S + 1e-6:
            heads.append(k)
    head = np.array(heads)
    tail = np.append(head[1:], first.size) - 1

    def root_sum(values: NDArray | None) -> NDArray | None:
        return None if values is None else np.sqrt(np.add.reduceat(values**2, head))

    return StepPlan(
        first[head],
        last[tail],
        plan.kind[head],
        plan.bin_index[head],
        np.sqrt(np.add.reduceat(plan.jolt_rad**2, head)),
        root_sum(plan.velocity_jump_m_s),
        root_sum(plan.turn_jump_rad),
    )


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
