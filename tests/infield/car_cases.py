"""Simulated drives of a car: streets, turns, stops, an odometer that reads high, a unit that is not
quite along the way it rolls.
"""

from dataclasses import replace

import numpy as np

from tests.infield.aided_cases import LEVER_M, ideal, twin_of
from tests.scenarios.study import table_to_zero
from trajectories.simulator.segments import Segment, Stop, Straight, Turn
from trajectories.simulator.session import SessionPlan, SimulatedRun, simulate_run
from trajectories.simulator.thermal import thermal_history
from trajectories.simulator.unit_truth import aged_unit

PARK_S = 60.0
CRAB_MRAD, SIDE_M_S, SCALE_PPM = 20.0, 0.05, 20_000.0


def street(speed_m_s: float, duration_s: float) -> Straight:
    return Straight(duration_s=duration_s, speed_m_s=speed_m_s, acceleration_m_s2=1.0)


DRIVE: tuple[Segment, ...] = (
    street(12.0, 40.0),
    Turn(angle_deg=90.0, speed_m_s=5.0),
    street(15.0, 60.0),
    Turn(angle_deg=-90.0, speed_m_s=5.0),
    street(10.0, 40.0),
    Stop(duration_s=15.0),
    street(14.0, 50.0),
    Turn(angle_deg=90.0, speed_m_s=6.0),
    street(12.0, 50.0),
    Turn(angle_deg=90.0, speed_m_s=6.0),
    street(15.0, 60.0),
    Turn(angle_deg=-90.0, speed_m_s=6.0),
    street(15.0, 60.0),
    Stop(duration_s=10.0),
)


def driven(seed: int, technology: str = "mems") -> SimulatedRun:
    """Twelve minutes at up to 15 m/s, GNSS at 1 Hz, odometer, no thermal bias."""
    twin = twin_of(technology)
    twin = replace(
        twin,
        vehicle=replace(twin.vehicle, crab_mrad=CRAB_MRAD, lateral_noise_m_s=SIDE_M_S),
        odometer=replace(twin.odometer, scale_ppm=SCALE_PPM, noise_m_s=0.02),
    )
    unit = aged_unit(
        np.random.default_rng(5),
        ageing_offset_deg_h=0.0,
        ageing_shape_deg_h=0.0,
        table=table_to_zero(),
    )
    plan = SessionPlan(
        with_gnss=True, gnss_lever_arm_m=LEVER_M, with_phases=False, with_odometer=True
    )
    made = simulate_run(
        ideal(PARK_S, DRIVE),
        thermal_history("ambient"),
        unit,
        twin,
        rng=np.random.default_rng([seed, 3]),
        plan=plan,
    )
    header = replace(made.run.header, gyro_technology=technology)
    return replace(made, run=replace(made.run, header=header))
