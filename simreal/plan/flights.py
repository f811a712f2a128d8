"""Which flight would bring which gyro, and which temperatures of the table, to which sigma.

Each flight of a short list is simulated with the twin's noise, with a receiver, between a taxi out
and a rest after landing, and goes through the update itself: what its filter states of its own
errors depends on the motion, the temperatures and the twin, hardly on the noise drawn. So what a
flight promises here is what an update of such a flight then states (`tests/simreal/test_flights`).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from infield.session.one_run import take_run
from infield.session.points import observability
from infield.session.results import SessionResult
from infield.session.settings import FlightPriors, SessionSettings
from infield.table.file import table_from_dict
from infield.table.thermal_table import ThermalTable
from ins.records import AXES, InputError, Site, TwinModel
from ins.verdicts import Observability
from trajectories.simulator.motions import lay
from trajectories.simulator.segments import (
    Climb,
    Cruise,
    Descend,
    Landing,
    Park,
    Segment,
    Stop,
    Straight,
    TakeOff,
    Turn,
    TurnFlight,
)
from trajectories.simulator.sensors import ideal_sensors
from trajectories.simulator.session import SessionPlan, simulate_run
from trajectories.simulator.thermal import ThermalHistory
from trajectories.simulator.truth import build_truth
from trajectories.simulator.unit_truth import aged_unit

FLOWN_RATE_HZ = 10.0
BEFORE_TAXI_S, AFTER_LANDING_S = 1800.0, 600.0
FLOWN_NODES_DEGC = np.arange(-30.0, 51.0, 10.0)  # of a table where the twin has none
# gyros of a unit that starts at 8 degC and flies where it is -58 degC; a low flight stays warm
AT_START_DEGC, AT_REST_DEGC, ALOFT_DEGC, COOLS_S = 8.0, 30.0, -58.0, 2400.0
LONG_CRUISE_S, SHORT_CRUISE_S = 3600.0, 600.0
# chosen: an airliner cruises above 9 km; up to 1500 m the gyros stay as warm as on the ground
HIGH_M, LOW_M = 9000.0, 1500.0
WHEELS_AT_M, ANTENNA_ARM_M = (-6.0, 0.3, 2.0), (1.5, -0.4, -1.8)
# nothing is below a simulated flight: it must not find so small a deflection of the vertical
OVER_USUAL_LAND = SessionSettings(flight=FlightPriors().assumed)
FEWER_TURNS = 1.02  # chosen: a flight with turns is named where its sigma is 2 % better

_TAXI_OUT: tuple[Segment, ...] = (
    Park(duration_s=BEFORE_TAXI_S),
    Turn(angle_deg=90.0),
    Straight(duration_s=120.0),
    Stop(duration_s=45.0),
    Turn(angle_deg=90.0),
    Straight(duration_s=60.0),
)
_HOME: tuple[Segment, ...] = (
    Cruise(duration_s=30.0),
    Landing(),
    Straight(duration_s=60.0),
    Stop(duration_s=10.0),
    Park(duration_s=AFTER_LANDING_S),
)


@dataclass(frozen=True, kw_only=True)
class FlightPlan:
    """A flight between two rests: how high, and what turns before and after how long a cruise
    [deg].
    """

    name: str
    words: str
    height_m: float = HIGH_M
    cruise_s: float = LONG_CRUISE_S
    turns_deg: tuple[float, ...] = ()

    @property
    def cold(self) -> bool:
        """The gyros cool to the temperatures of a cruise."""
        return self.height_m > LOW_M

    @property
    def segments(self) -> tuple[Segment, ...]:
        """The way from rest to rest."""
        speed = 210.0 if self.cold else 90.0
        before: list[Segment] = []
        after: list[Segment] = []
        for number, angle in enumerate(self.turns_deg):
            turn = (TurnFlight(angle_deg=angle), Cruise(duration_s=60.0))
            (after if number else before).extend(turn)
        up = Climb(height_m=self.height_m, rate_m_s=10.0, speed_m_s=0.85 * speed)
        down = Descend(height_m=500.0, rate_m_s=8.0, speed_m_s=90.0)
        along = Cruise(duration_s=self.cruise_s, speed_m_s=speed)
        return (*_TAXI_OUT, TakeOff(), up, *before, along, *after, down, *_HOME)


FLIGHTS = (
    FlightPlan(name="straight", words="an hour of straight cruise, high and cold"),
    FlightPlan(
        name="two turns of 90 deg",
        words="an hour of cruise, high and cold, between two turns of 90 deg",
        turns_deg=(90.0, -90.0),
    ),
    FlightPlan(
        name="two turns of 180 deg",
        words="an hour of cruise, high and cold, between two turns of 180 deg",
        turns_deg=(180.0, 180.0),
    ),
    FlightPlan(
        name="short",
        words="ten minutes of cruise, high, between two turns of 180 deg",
        cruise_s=SHORT_CRUISE_S,
        turns_deg=(180.0, 180.0),
    ),
    FlightPlan(
        name="low",
        words="an hour low and warm between two turns of 180 deg",
        height_m=LOW_M,
        turns_deg=(180.0, 180.0),
    ),
)


@dataclass(frozen=True)
class NodeSigma:
    """Sigma of the table at a node [deg/h], before and after the session."""

    axis: str
    temperature_degC: float
    before_deg_h: float
    after_deg_h: float


@dataclass(frozen=True)
class GyroSigma:
    """What a flight would show of a gyro: sigma of its mean over the session before and after."""

    axis: str
    verdict: Observability | str
    sigma_before_deg_h: float
    sigma_after_deg_h: float


@dataclass(frozen=True, kw_only=True)
class PromisedFlight:
    """A flight, and what an update of it would show; hours: from rest to rest; best_for: the gyros
    that no other flight of the list shows better.
    """

    flight: str
    words: str
    hours: float
    from_degC: float
    to_degC: float
    best_for: tuple[str, ...] = ()
    gyros: tuple[GyroSigma, ...]
    nodes: tuple[NodeSigma, ...]

    def sigma_deg_h(self, axis: str) -> float:
        """Of a gyro's mean over the session."""
        return next(g.sigma_after_deg_h for g in self.gyros if g.axis == axis)


def plan_flights(
    twin: TwinModel,
    table: ThermalTable | None,
    site: Site,
    seed: int,
    progress: Callable[[str], None] = lambda words: None,
) -> tuple[PromisedFlight, ...]:
    """What each flight of the list would bring to a table. InputError for gyros that find no north:
    their flights are joined, but not through this filter.
    """
    check_technology(twin)
    promised = []
    for flight in FLIGHTS:
        progress(f"flying: {flight.words}")
        promised.append(promise(flight, twin, table, site, seed))
    best = {axis: best_flight(promised, axis) for axis in AXES}
    return tuple(
        replace(p, best_for=tuple(axis for axis in AXES if best[axis] is p)) for p in promised
    )


def best_flight(promised: Sequence[PromisedFlight], axis: str) -> PromisedFlight:
    """The first flight whose sigma of a gyro is the smallest but for FEWER_TURNS."""
    least = min(p.sigma_deg_h(axis) for p in promised)
    return next(p for p in promised if p.sigma_deg_h(axis) <= FEWER_TURNS * least)


def check_technology(twin: TwinModel) -> None:
    """InputError for gyros that find no north."""
    if twin.gyro_technology == "mems":
        raise InputError(
            "flights are planned for gyros that find north (rlg, fog), got gyro_technology mems"
        )


def promise(
    flight: FlightPlan, twin: TwinModel, table: ThermalTable | None, site: Site, seed: int
) -> PromisedFlight:
    """One flight, simulated and updated. InputError where the update would not join it."""
    result, table, hours = flown(flight, twin, table, site, seed)
    evidence = result.flight
    if evidence is None or evidence.joined is None:
        raise InputError(f"flight {flight.name!r}: an update would not join it to the table")
    estimate = evidence.as_usual or evidence.joined
    seen = observability(estimate, hold_heading=True, flown=True)
    T = estimate.bins.temperature_degC
    wide = table.extended_to(float(T.min()), float(T.max()))
    after = estimate.merged_into(wide).candidate
    nodes = [
        NodeSigma(axis, float(t), float(before), float(then))
        for k, axis in enumerate(AXES)
        for t, before, then in zip(
            wide.temperature_degC[k],
            wide.sigma_deg_h(k, wide.temperature_degC[k]),
            after.sigma_deg_h(k, wide.temperature_degC[k]),
        )
    ]
    gyros = [
        GyroSigma(axis, m.verdict, m.sigma_before_deg_h, m.sigma_after_deg_h)
        for axis, m in zip(AXES, seen)
    ]
    return PromisedFlight(
        flight=flight.name,
        words=flight.words,
        hours=hours,
        from_degC=float(T.min()),
        to_degC=float(T.max()),
        gyros=tuple(gyros),
        nodes=tuple(nodes),
    )


def flown(
    flight: FlightPlan, twin: TwinModel, table: ThermalTable | None, site: Site, seed: int
) -> tuple[SessionResult, ThermalTable, float]:
    """The update's result of a simulated flight, its table, and hours from rest to rest.

    table: None: that of a unit as the factory made it.
    """
    rng = np.random.default_rng([23, seed])
    unit = aged_unit(rng, gyro_technology=twin.gyro_technology)
    if table is None:
        table = table_from_dict(unit.factory_table(FLOWN_NODES_DEGC), name="factory table")
    truth = build_truth(
        lay(flight.segments),
        site,
        heading_rad=0.4,
        roll_rad=0.0,
        pitch_rad=0.0,
        wheel_reference_m=WHEELS_AT_M,
    )
    ideal = ideal_sensors(truth, FLOWN_RATE_HZ)
    end_s = float(ideal.time_s[-1])
    thermal = ThermalHistory(
        ambient_degC=AT_START_DEGC, start_degC=AT_START_DEGC, settled_degC=AT_REST_DEGC
    )
    if flight.cold:
        thermal = replace(
            thermal,
            flight_degC=ALOFT_DEGC,
            flight_start_s=BEFORE_TAXI_S + 600.0,
            flight_end_s=end_s - AFTER_LANDING_S - 600.0,
            flight_tau_s=COOLS_S,
        )
    plan = SessionPlan(with_gnss=True, gnss_lever_arm_m=ANTENNA_ARM_M, run_id=flight.name)
    run = simulate_run(ideal, thermal, unit, twin, rng=rng, plan=plan).run
    return take_run(run, table, twin, OVER_USUAL_LAND, False), table, end_s / 3600.0
