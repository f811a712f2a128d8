"""The runs whose answers about rest and movement are frozen (`motion`).

Forty-six simulated runs at 10 Hz, each with its own seed, and the recorded logs of ../shared/data.
The simulated ones use the vehicle events, faults and thermal histories that the scenario studies
use.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from infield.table.thermal_table import ThermalTable, default_table
from ins.json_file import read_toml
from ins.records import OdometerLog, Phase, Run, Site, TwinModel
from ins.twin_file import default_twin
from ins.units import DEG
from recal.service.inputs.unit_inputs import table_of_unknown_unit
from tests.cut import cut_run
from tests.faults import clipped_accelerometer, shock, stuck_at_full_scale
from tests.infield import aided_cases, azimuth_cases, mems_flights, mems_sessions
from tests.scenarios.study import DEFAULT_TWIN, table_to_zero
from trajectories.readers.conversion import convert_log
from trajectories.runs.imu_stream import imu_log
from trajectories.simulator.chamber import ChamberProfile
from trajectories.simulator.motions import lay
from trajectories.simulator.segments import (
    Climb,
    Cruise,
    Descend,
    Landing,
    Park,
    Pivot,
    Segment,
    Stop,
    Straight,
    TakeOff,
    Turn,
    TurnFlight,
)
from trajectories.simulator.sensors import ideal_sensors
from trajectories.simulator.session import SessionPlan, simulate_run
from trajectories.simulator.thermal import thermal_history
from trajectories.simulator.truth import build_truth
from trajectories.simulator.unit_truth import aged_unit
from trajectories.simulator.vehicle import Boarding, Bump, Gust, Push

ROOT = Path(__file__).parents[2]
DATA = ROOT.parent / "shared" / "data"
RATE_HZ = 10.0
KNOWN_SIGMA_DEG_H = 0.01  # of a ring-laser or fibre unit that has a table: it finds north
TEN_MINUTES = (Park(duration_s=600.0),)
PARKED = (Park(duration_s=800.0),)  # events after 600 s fall into what is replayed free-inertially
FOG = default_twin("fog")


@dataclass(frozen=True)
class Case:
    """A run with the table and the twin that its callers believe in."""

    run: Run
    table: ThermalTable
    twin: TwinModel


@dataclass(frozen=True)
class Named:
    """A case by name. quick: in the normal suite; needs: its file in DATA, empty if simulated."""

    name: str
    make: Callable[[], Case]
    quick: bool = False
    needs: str = ""


def simulated(
    seed: int,
    segments: tuple[Segment, ...] = PARKED,
    *,
    twin: TwinModel = DEFAULT_TWIN,
    lat_deg: float = 45.0,
    heading_deg: float = 17.0,
    thermal: Any = "ambient",
    phases: bool = False,
    **options: Any,
) -> Case:
    """One seeded run of a unit with a table; `options` go to `simulate_run`."""
    rng = np.random.default_rng([seed, 20261122])
    site = Site(lat_rad=lat_deg * DEG, lon_rad=7 * DEG, height_m=250.0)
    truth = build_truth(lay(segments), site, heading_rad=heading_deg * DEG)
    unit = aged_unit(
        rng,
        ageing_offset_deg_h=0.008,
        ageing_shape_deg_h=0.005,
        table=table_to_zero(),
        gyro_technology=twin.gyro_technology,
    )
    history = thermal_history(thermal) if isinstance(thermal, str) else thermal
    made = simulate_run(
        ideal_sensors(truth, RATE_HZ),
        history,
        unit,
        twin,
        rng=rng,
        plan=SessionPlan(with_phases=phases, run_id=f"motion-{seed}", **options),
    )
    return known(made.run, twin)


def known(run: Run, twin: TwinModel) -> Case:
    """The case of a unit with a table that is good to KNOWN_SIGMA_DEG_H."""
    table = default_table(
        imu_serial=run.header.imu_serial,
        gyro_technology=run.header.gyro_technology,
        created_utc="2026-01-01T00:00:00Z",
        sigma_deg_h=KNOWN_SIGMA_DEG_H,
    )
    return Case(run, table, twin)


def changed(case: Case, change: Callable[[Run], Run]) -> Case:
    """The case with its run changed."""
    return replace(case, run=change(case.run))


def swaying(sway_m_s: float) -> TwinModel:
    """A ring-laser unit in a vehicle that sways by so much (RMS of its velocity)."""
    return replace(DEFAULT_TWIN, vehicle=replace(DEFAULT_TWIN.vehicle, sway_m_s=sway_m_s))


def without_rows(run: Run, start_s: float, end_s: float) -> Run:
    """The run as its reader gives it after the rows of (start_s, end_s] were lost."""
    imu = run.imu.whole()
    keep = (imu.time_s <= start_s) | (imu.time_s > end_s)
    dtheta, dv = imu.dtheta_rad[keep].copy(), imu.dv_m_s[keep].copy()
    held, spans = imu_log(imu.time_s[keep], dtheta, dv, source=imu.source)
    return replace(run, imu=held, faults=tuple(spans))


# Ways to go ---------------------------------------------------------------------------------------

LEG = (Straight(duration_s=60.0), Stop(duration_s=60.0))
TAXI = (*TEN_MINUTES, Turn(angle_deg=90.0), *LEG, Turn(angle_deg=90.0), *LEG)
STRAIGHT = (*TEN_MINUTES, Straight(duration_s=150.0), Stop(duration_s=90.0))
STEADY = (*TEN_MINUTES, Straight(duration_s=400.0, speed_m_s=8.0))
FIVE_STANDS = (
    Park(duration_s=400.0),
    *(Turn(angle_deg=70.0), *LEG),
    *(Turn(angle_deg=-120.0), Straight(duration_s=40.0), Stop(duration_s=120.0)),
    *(Straight(duration_s=30.0, speed_m_s=4.0), Stop(duration_s=15.0)),
    *(Turn(angle_deg=180.0), Straight(duration_s=50.0), Stop(duration_s=200.0)),
)
TWO_HEADINGS = (*TEN_MINUTES, Pivot(angle_deg=90.0), *TEN_MINUTES)
SLOW_TOW = (
    *TEN_MINUTES,
    Straight(duration_s=90.0, speed_m_s=0.5, acceleration_m_s2=0.1),
    Stop(duration_s=120.0),
)
PIVOTS = (
    *TEN_MINUTES,
    *(Pivot(angle_deg=30.0), Park(duration_s=120.0)),
    *(Pivot(angle_deg=-2.0, duration_s=20.0), Park(duration_s=120.0)),
    *(Pivot(angle_deg=10.0, duration_s=300.0), Park(duration_s=120.0)),
)
FLIGHT = (
    *TEN_MINUTES,
    *(Turn(angle_deg=90.0), Stop(duration_s=20.0), TakeOff()),
    *(Climb(height_m=600.0, speed_m_s=90.0), TurnFlight(angle_deg=180.0)),
    *(Cruise(duration_s=100.0), Descend(height_m=300.0), Landing(), Stop(duration_s=5.0)),
    Park(duration_s=120.0),
)
NEVER_AT_REST = (
    Park(duration_s=30.0),
    *(Turn(angle_deg=90.0), Straight(duration_s=60.0), Turn(angle_deg=-60.0)),
    *(Straight(duration_s=80.0, speed_m_s=6.0), Turn(angle_deg=150.0), Straight(duration_s=60.0)),
)
HOUR_AND_TAXI = (
    Park(duration_s=4200.0),
    *(Turn(angle_deg=90.0), Straight(duration_s=120.0), Stop(duration_s=60.0)),
    *(Turn(angle_deg=90.0), Straight(duration_s=120.0), Stop(duration_s=120.0)),
)
FAST_RAMPS = ChamberProfile(start_degC=-10.0, end_degC=30.0, rate_degC_min=2.5, soak_s=600.0)
SLOW_RAMPS = ChamberProfile(start_degC=0.0, end_degC=15.0, rate_degC_min=0.25, soak_s=600.0)
ON_TURNTABLE = (
    *(Park(duration_s=1500.0), Pivot(angle_deg=20.0, duration_s=30.0)),
    Park(duration_s=2190.0),
)


# Simulated cases ----------------------------------------------------------------------------------


def ramps(
    seed: int, chamber: ChamberProfile, segments: tuple[Segment, ...] = (), **options: Any
) -> Case:
    """A fibre unit in a chamber, on the bench all the time unless segments say otherwise."""
    stays = (Park(duration_s=chamber.duration_s),)
    return simulated(seed, segments or stays, twin=FOG, thermal=chamber, **options)


def azimuths(stop_s: float, turn_s: float, events: tuple = ()) -> Case:
    """A fibre unit on four azimuths within one power-on."""
    segments = azimuth_cases.four_stops(turn_s, stop_s=stop_s)
    made = azimuth_cases.simulated(segments, 45.0, events=events)
    return Case(made.run, azimuth_cases.table(), azimuth_cases.TWIN)


def mems(run: Run) -> Case:
    """A MEMS unit on a blank table."""
    return Case(run, mems_sessions.blank(), mems_sessions.TWIN)


def warm_up(seed: int, duration_s: float, **options: Any) -> Case:
    """A MEMS unit that warms up where it stands."""
    rng = np.random.default_rng([seed, 20261123])
    made = simulate_run(
        mems_sessions.ideal(60.0, duration_s),
        mems_sessions.WARM_UP,
        mems_sessions.unit(seed),
        mems_sessions.TWIN,
        rng=rng,
        plan=SessionPlan(run_id=f"warm-{seed}", **options),
    )
    return mems(made.run)


def mems_away(seed: int, away_s: float, *, named: bool = False, **options: Any) -> Case:
    """A MEMS unit that stands, is away and stands again; named: its phases are logged."""
    run = mems_flights.flight(seed, turn_deg=90.0, away_s=away_s, **options).run
    return mems(mems_flights.landed(run) if named else run)


def mems_vehicle(seed: int, segments: tuple[Segment, ...], *, cut_s: float = 0.0) -> Case:
    """A MEMS unit in a taxiing vehicle with a receiver; cut_s: the log begins so late."""
    twin = mems_sessions.TWIN
    made = simulated(seed, segments, twin=twin, with_gnss=True)
    run = cut_run(made.run, cut_s, made.run.imu.end_s) if cut_s else made.run
    table = default_table(
        imu_serial=run.header.imu_serial,
        gyro_technology="mems",
        created_utc="2026-01-01T00:00:00Z",
        sigma_deg_h=mems_sessions.SIGMA_DEG_H,
    )
    return Case(run, table, twin)


def mems_in_the_air(seed: int) -> Case:
    """A MEMS unit with a receiver that stands for a minute, taxies, takes off and cruises."""
    twin = aided_cases.twin_of("mems")
    run = aided_cases.flown(aided_cases.ideal(60.0), twin, seed).run
    run = replace(run, header=replace(run.header, gyro_technology="mems"))
    return Case(run, table_of_unknown_unit(run, twin), twin)


def from_the_first_row(seed: int, segments: tuple[Segment, ...], start_s: float) -> Case:
    """A log that begins while the vehicle rolls."""
    made = simulated(seed, segments, with_gnss=True, with_odometer=True)
    return changed(made, lambda run: cut_run(run, start_s, run.imu.end_s))


def bumped() -> Case:
    events = [
        Bump(time_s=200.2, velocity_m_s=0.1, duration_s=0.5, direction_deg=60.0),
        Bump(time_s=330.0, velocity_m_s=0.5, duration_s=2.0),
        Bump(time_s=470.7, velocity_m_s=0.07, duration_s=0.3, direction_deg=200.0),
        Bump(time_s=680.0, velocity_m_s=0.8, duration_s=2.5),
    ]
    return simulated(5, events=events)


def loaded() -> Case:
    """Fuel and cargo: steps of roll and pitch that stay."""
    events = [
        Boarding(time_s=150.0, roll_arcsec=8.0),
        Boarding(time_s=260.0, roll_arcsec=60.0, pitch_arcsec=-40.0, settle_s=3.0),
        Boarding(time_s=400.0, pitch_arcsec=150.0, heading_arcsec=10.0, sink_mm=15.0),
        Boarding(time_s=520.0, roll_arcsec=1.0),
        Boarding(time_s=680.0, roll_arcsec=-200.0, heading_arcsec=40.0),
    ]
    return simulated(6, events=events)


def gusty() -> Case:
    events = [
        Gust(time_s=180.0, duration_s=60.0, sway_m_s=0.03),
        Gust(time_s=380.0, duration_s=40.0, sway_m_s=0.1),
        Gust(time_s=650.0, duration_s=50.0, sway_m_s=0.2),
    ]
    return simulated(7, events=events)


def stormy() -> Case:
    """Sway all the time, and gusts three times as strong."""
    return simulated(
        8, twin=swaying(0.03), events=[Gust(time_s=300.0, duration_s=90.0, sway_m_s=0.1)]
    )


def boarding(first_s: float, every_s: float, seed: int) -> Case:
    """Doors and people: a small step every so often, and a large one where somebody sits down."""
    rng = np.random.default_rng([seed, 3])
    times = np.arange(first_s, 720.0, every_s)
    events = []
    for time_s in times:
        roll, pitch, heading = rng.normal(0.0, 12.0, 3)
        step = Boarding(
            time_s=float(time_s),
            roll_arcsec=float(roll),
            pitch_arcsec=float(pitch),
            heading_arcsec=0.3 * float(heading),
            sink_mm=float(rng.uniform(0.0, 3.0)),
        )
        events.append(step)
    return simulated(seed, events=events)


def pushed(seed: int, turn_deg: float) -> Case:
    """A tug moves the parked vehicle twice, and turns it."""
    events = [
        Push(time_s=200.0, distance_m=-3.0, speed_m_s=0.1),
        Push(time_s=400.0, distance_m=8.0, speed_m_s=0.4, turn_deg=turn_deg),
        Push(time_s=660.0, distance_m=0.5, speed_m_s=0.2, turn_deg=0.3 * turn_deg),
    ]
    return simulated(seed, events=events)


def dropped() -> Case:
    """Rows lost at rest, in the middle of a gust, and on the way."""
    gust = Gust(time_s=400.0, duration_s=40.0, sway_m_s=0.06)
    case = simulated(13, TAXI, events=[gust])
    for start_s, end_s in ((150.25, 150.95), (420.15, 420.85), (660.05, 660.65)):
        case = changed(case, lambda run, a=start_s, b=end_s: without_rows(run, a, b))
    return case


def clipped() -> Case:
    """A bump beyond the range of an accelerometer, and gyros stuck at full scale for some rows."""
    case = simulated(14, events=[Bump(time_s=450.0, velocity_m_s=2.0, duration_s=0.9)])
    case = changed(case, lambda run: clipped_accelerometer(run, axis="x", limit_m_s2=5.0))
    stuck = {"sensor": "gyro", "axis": "x", "at_s": 200.3, "rows": 5, "total": 0.05}
    return changed(case, lambda run: stuck_at_full_scale(run, **stuck))


def shocked() -> Case:
    """Single rows that no vehicle can have made."""
    case = simulated(15)
    case = changed(case, lambda run: shock(run, axis="y", at_s=180.3, dv_m_s=-0.1))
    case = changed(case, lambda run: shock(run, axis="z", at_s=300.3, dv_m_s=1.5))
    turn = {"sensor": "gyro", "axis": "z", "at_s": 420.3, "rows": 1, "total": 0.002}
    return changed(case, lambda run: stuck_at_full_scale(run, **turn))


def dead_wheels() -> Case:
    """A taxi whose wheel encoder reads nothing."""
    case = simulated(20, TAXI, with_odometer=True)
    assert case.run.odometer is not None
    time_s = case.run.odometer.time_s
    nothing = OdometerLog(time_s=time_s, speed_m_s=np.zeros(time_s.size))
    return changed(case, lambda run: replace(run, odometer=nothing))


def wrongly_named() -> Case:
    """Phases that call the taxi parked and its second half a flight."""
    said = (
        Phase(phase="parked", start_s=0.0, end_s=700.0),
        Phase(phase="flight", start_s=800.0, end_s=900.0),
    )
    return changed(simulated(21, TAXI), lambda run: replace(run, phases=said))


def ramps_with_events() -> Case:
    """Chamber ramps in which the bench is bumped and tilted."""
    events = [
        Bump(time_s=1200.0, velocity_m_s=0.5, duration_s=2.0),
        Boarding(time_s=2000.0, roll_arcsec=900.0, pitch_arcsec=400.0),
        Boarding(time_s=2800.0, roll_arcsec=30.0),
    ]
    return ramps(31, FAST_RAMPS, events=events)


def warm_up_with_people() -> Case:
    """A MEMS warm-up with a shock, a small step and a tilt after which it stands elsewhere."""
    events = [
        Bump(time_s=200.0, velocity_m_s=1.0, duration_s=1.0),
        Boarding(time_s=400.0, roll_arcsec=600.0),
        Boarding(time_s=650.0, roll_arcsec=6000.0, pitch_arcsec=3000.0, settle_s=2.0),
    ]
    return warm_up(34, 900.0, events=events)


def all_aids() -> Case:
    return simulated(4, TAXI, phases=True, with_gnss=True, with_odometer=True)


def steady_with_wheels() -> Case:
    """A taxi at a constant speed to the end of the log: quiet to everything but the wheels."""
    return simulated(18, STEADY, with_odometer=True)


def bumped_azimuths() -> Case:
    """Stops that are hardly long enough, one of them bumped and one loaded."""
    events = (Bump(time_s=150.0, velocity_m_s=0.3), Boarding(time_s=500.0, roll_arcsec=80.0))
    return azimuths(350.0, 25.0, events)


def mems_steady_roll() -> Case:
    """A log that begins and ends at one speed, straight ahead."""
    return mems_vehicle(38, STEADY, cut_s=640.0)


SIMULATED = (
    Named("quiet park", lambda: simulated(1, phases=True)),
    Named("quiet park, half an hour", lambda: simulated(2, (Park(duration_s=1800.0),))),
    Named("taxi with two stops", lambda: simulated(3, TAXI)),
    Named("taxi, all aids", all_aids),
    Named("bumps", bumped, quick=True),
    Named("loading", loaded, quick=True),
    Named("gusts", gusty),
    Named("sway and gusts", stormy),
    Named("sway of 20 mm/s", lambda: simulated(9, twin=swaying(0.02))),
    Named("doors and people", lambda: boarding(60.0, 45.0, 10)),
    Named("boarding in the first 30 s", lambda: boarding(8.0, 130.0, 11)),
    Named("tug push", lambda: pushed(12, 0.0)),
    Named("tug push with a turn", lambda: pushed(16, 1.0), quick=True),
    Named("dropouts", dropped),
    Named("clipping", clipped, quick=True),
    Named("shocks", shocked),
    Named("straight taxi", lambda: simulated(17, STRAIGHT)),
    Named("constant speed with odometer", steady_with_wheels),
    Named("constant speed, inertial alone", lambda: simulated(19, STEADY)),
    Named("dead wheel encoder", dead_wheels),
    Named("phases that are wrong", wrongly_named, quick=True),
    Named("five stands", lambda: simulated(22, FIVE_STANDS, with_gnss=True)),
    Named("two headings", lambda: simulated(23, TWO_HEADINGS)),
    Named("slow tow", lambda: simulated(24, SLOW_TOW), quick=True),
    Named("turning on the spot", lambda: simulated(25, PIVOTS)),
    Named("rolling from the first row", lambda: from_the_first_row(26, TAXI, 640.0)),
    Named("never at rest", lambda: from_the_first_row(27, NEVER_AT_REST, 38.0), quick=True),
    Named("four azimuths", lambda: azimuths(400.0, 60.0)),
    Named("four azimuths, short and bumped", bumped_azimuths),
    Named("chamber ramps", lambda: ramps(30, SLOW_RAMPS)),
    Named("chamber ramps, bumped and tilted", ramps_with_events, quick=True),
    Named("chamber ramps on a turntable", lambda: ramps(32, FAST_RAMPS, ON_TURNTABLE)),
    Named("MEMS warm-up", lambda: warm_up(33, 2400.0)),
    Named("MEMS warm-up with people", warm_up_with_people, quick=True),
    Named("MEMS, two stands", lambda: mems_away(35, 500.0)),
    Named("MEMS, two stands with phases", lambda: mems_away(36, 500.0, named=True), quick=True),
    Named("MEMS, smooth taxi with GNSS", lambda: mems_vehicle(37, FIVE_STANDS)),
    Named("MEMS, steady roll from the first row", mems_steady_roll, quick=True),
    Named("MEMS flight with GNSS", lambda: mems_in_the_air(39)),
    Named("flight", lambda: simulated(40, FLIGHT, phases=True, with_gnss=True)),
    Named("flight without phases or aids", lambda: simulated(41, FLIGHT)),
    Named("cooling unit", lambda: simulated(42, TAXI, thermal="cooling", lat_deg=20.0)),
    Named("fibre unit, high latitude", lambda: simulated(43, TAXI, twin=FOG, lat_deg=72.0)),
    Named("beyond the last latitude", lambda: simulated(44, lat_deg=80.0)),
    Named("south", lambda: simulated(45, TAXI, lat_deg=-35.0, heading_deg=250.0)),
    Named("an hour and a taxi", lambda: simulated(46, HOUR_AND_TAXI, with_gnss=True)),
)


# Recorded logs ------------------------------------------------------------------------------------

MAPS = ROOT / "examples" / "maps"
PLANE, COPTER = "apm_fixedwing_TestLog2.mat", "ardupilot_log171.bin"
LEFT_OUT = {
    "groves_Profile_0.csv": "a true path, no inertial rows",
    "groves_Profile_1.csv": "a true path, no inertial rows",
    "groves_Profile_2.csv": "a true path, no inertial rows",
}


def recorded(log: str, options: dict[str, Any]) -> Case:
    """A recorded log as `recal convert` makes it a run; nobody has a table of its unit."""
    run = convert_log(DATA / log, options, {}).run
    twin = default_twin(run.header.gyro_technology)
    return Case(run, table_of_unknown_unit(run, twin), twin)


def mapped(log: str) -> Case:
    """A recorded log with its map in examples/maps."""
    name = log.rsplit(".", 1)[0]
    return recorded(log, read_toml(MAPS / f"{name}.toml"))


def copter(number: int, part: dict[str, float]) -> Case:
    """One IMU of the copter, before or behind the gap in its log."""
    return recorded(COPTER, {"imu": number, **part})


BEFORE_GAP, AFTER_GAP = {"to_s": 72.6}, {"from_s": 74.628}
RECORDED = (
    Named("LN-100", lambda: mapped("x_LN100_up.ins"), needs="x_LN100_up.ins"),
    Named("ADI", lambda: mapped("x_adi_up.txt"), needs="x_adi_up.txt"),
    Named("Calgary", lambda: mapped("calgary_project_data.BIN"), needs="calgary_project_data.BIN"),
    Named("plane", lambda: recorded(PLANE, {}), needs=PLANE),
    Named("copter IMU 1", lambda: copter(1, BEFORE_GAP), quick=True, needs=COPTER),
    Named("copter IMU 2", lambda: copter(2, BEFORE_GAP), needs=COPTER),
    Named("copter IMU 3", lambda: copter(3, BEFORE_GAP), needs=COPTER),
    Named("copter IMU 1, later", lambda: copter(1, AFTER_GAP), needs=COPTER),
    Named("copter IMU 3, later", lambda: copter(3, AFTER_GAP), needs=COPTER),
)
