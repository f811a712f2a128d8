"""Simulated runs for the tests of the twin: small, made once."""

from dataclasses import replace
from functools import lru_cache

import numpy as np

from infield.table.file import table_from_dict
from ins.records import Site
from ins.twin_file import default_twin
from ins.units import DEG
from trajectories.simulator.motions import lay
from trajectories.simulator.segments import (
    Climb,
    Cruise,
    Descend,
    Landing,
    Park,
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

PARKED_S = 1200.0
TAXI = (
    Park(duration_s=PARKED_S),
    Turn(angle_deg=90.0),
    Straight(duration_s=60.0),
    Stop(duration_s=60.0),
    Turn(angle_deg=-60.0),
    Straight(duration_s=40.0),
    Stop(duration_s=60.0),
)
PARKED = TAXI[:1]
FLIGHT = (
    Park(duration_s=600.0),
    Turn(angle_deg=90.0),
    Stop(duration_s=20.0),
    TakeOff(),
    Climb(height_m=900.0, speed_m_s=90.0),
    TurnFlight(angle_deg=180.0),
    Cruise(duration_s=200.0),
    Descend(height_m=500.0),
    Landing(),
    Stop(duration_s=5.0),
    Park(duration_s=120.0),
)
SITE = Site(lat_rad=45 * DEG, lon_rad=7 * DEG, height_m=250.0)
WHEELS, ANTENNA = (-6.0, 0.3, 2.0), (1.5, -0.4, -1.8)


def twin_of(technology="rlg", **changes):
    return replace(default_twin(technology), **changes)


@lru_cache(maxsize=8)
def _ideal(segments, heading_deg):
    truth = build_truth(
        lay(segments),
        SITE,
        heading_rad=heading_deg * DEG,
        roll_rad=0.01,
        pitch_rad=-0.02,
        wheel_reference_m=WHEELS,
    )
    return ideal_sensors(truth, 10.0)


@lru_cache(maxsize=4)
def unit(technology="rlg"):
    return aged_unit(
        np.random.default_rng(7),
        gyro_technology=technology,
        ageing_offset_deg_h=0.0,
        ageing_shape_deg_h=0.0,
    )


def table(technology="rlg"):
    """The unit's own curve: what the twin believes is true."""
    return table_from_dict(
        unit(technology).factory_table(np.arange(-20.0, 61.0, 2.0)), name="table"
    )


@lru_cache(maxsize=32)
def simulated(
    seed=1,
    segments=TAXI,
    heading_deg=37.0,
    technology="rlg",
    aids=False,
    events=(),
    antenna_m=ANTENNA,
):
    return simulate_run(
        _ideal(segments, heading_deg),
        thermal_history("ambient"),
        unit(technology),
        twin_of(technology),
        rng=np.random.default_rng([seed, 31]),
        plan=SessionPlan(
            with_gnss=aids, with_odometer=aids, events=events, gnss_lever_arm_m=antenna_m
        ),
    )
