"""When a session flies, and what its vehicle does from the first take-off on."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from alignment.motion.inertial import Where
from alignment.motion.kinds import AIRBORNE, ROLLING, STILL
from alignment.motion.seconds import seconds_of
from alignment.motion.speeds import find_stands
from alignment.motion.stillness import TAKE_OFF_M_S, Motion
from alignment.navigation_filter import StepPlan
from infield.session.bins import SessionBins
from infield.session.estimate import SessionEstimate
from infield.session.flown.priors import Layout, laid_out
from infield.session.log import session_end
from infield.session.navigated.own_errors import LoggedRun, OwnErrors, own_errors
from infield.session.settings import SessionSettings
from infield.table.thermal_table import ThermalTable
from infield.thermometer.gyro_temperature import GyroTemperature
from ins.estimation import error_model as em
from ins.filters.aided_records import fixes_of
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
    stands = find_stands(
        seconds_of(run.imu),
        fixes_of(
            fixes,
            horizontal_m=twin.gnss.sigma_horizontal_m,
            vertical_m=twin.gnss.sigma_vertical_m,
            velocity_m_s=twin.gnss.sigma_velocity_m_s,
        ),
    )
    return Flight(
        start_s=start_s,
        end_s=end_s,
        stands=tuple(stand for stand in stands if stand[0] > end_s),
        covered=covered_share(fixes, start_s, end_s),
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
