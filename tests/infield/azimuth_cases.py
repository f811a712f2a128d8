"""A quiet unit with a misalignment that no table knows, and its runs on four azimuths, each made
once.
"""

from dataclasses import replace
from functools import lru_cache

import numpy as np

from infield.table.file import table_from_dict
from ins.records import Site
from ins.twin_file import default_twin
from ins.units import DEG
from trajectories.simulator.motions import lay
from trajectories.simulator.segments import Park, Pivot
from trajectories.simulator.sensors import ideal_sensors
from trajectories.simulator.session import SessionPlan, simulate_run
from trajectories.simulator.thermal import thermal_history
from trajectories.simulator.truth import build_truth
from trajectories.simulator.unit_truth import aged_unit

TRUE_MRAD = (0.3, 0.2, 0.3, 0.1, 0.3, -0.3)  # xy, xz, yx, yz, zx, zy
_FOG = default_twin("fog")
TWIN = replace(
    _FOG,
    gyro=replace(
        _FOG.gyro,
        arw_deg_sqrt_h=3e-4,
        bias_instability_deg_h=2e-4,
        rate_random_walk_deg_h_sqrt_h=2e-4,
        turn_on_deg_h=2e-4,
    ),
    accel=replace(_FOG.accel, turn_on_ug=10.0),
    vehicle=replace(_FOG.vehicle, yaw_creep_arcsec_sqrt_h=0.3, sway_m_s=2e-4),
)
TRUTH = replace(TWIN, gyro=replace(TWIN.gyro, misalignment_mrad=TRUE_MRAD))
SITE = Site(lat_rad=45 * DEG, lon_rad=7 * DEG, height_m=250.0)
STOP_S = 900.0


@lru_cache(maxsize=1)
def unit():
    return aged_unit(
        np.random.default_rng(5),
        gyro_technology="fog",
        ageing_offset_deg_h=0.001,
        ageing_shape_deg_h=0.0005,
    )


@lru_cache(maxsize=1)
def table():
    return table_from_dict(unit().factory_table(np.arange(-20.0, 61.0, 10.0)), name="factory")


@lru_cache(maxsize=16)
def ideal_of(segments, heading_deg):
    truth = build_truth(
        lay(segments), SITE, heading_rad=heading_deg * DEG, roll_rad=2e-3, pitch_rad=-1e-3
    )
    return ideal_sensors(truth, 10.0)


def four_stops(turn_s=60.0, angles_deg=(90.0, 90.0, 90.0), stop_s=STOP_S):
    segments = [Park(duration_s=stop_s)]
    for angle in angles_deg:
        segments += [Pivot(angle_deg=angle, duration_s=turn_s), Park(duration_s=stop_s)]
    return tuple(segments)


def simulated(segments, heading_deg, seed=1, twin=TRUTH, **options):
    return simulate_run(
        ideal_of(segments, heading_deg),
        thermal_history("ambient"),
        unit(),
        twin,
        rng=np.random.default_rng([seed, round(heading_deg)]),
        plan=SessionPlan(run_id=f"run-{heading_deg:.0f}-{seed}", with_phases=False, **options),
    )


@lru_cache(maxsize=4)
def one_power_on(heading_deg=45.0, turn_s=60.0):
    return simulated(four_stops(turn_s), heading_deg)


@lru_cache(maxsize=8)
def parked_run(heading_deg):
    return simulated((Park(duration_s=STOP_S),), heading_deg)
