"""MEMS units drawn from the prior of a blank table, and warm-ups of them on headings that nobody
knows.
"""

from dataclasses import replace
from functools import lru_cache

import numpy as np

from infield.session.pipeline import update_calibration
from infield.table.file import table_to_dict
from infield.table.thermal_table import default_table
from ins.records import AccelNoise, GyroNoise, Site
from ins.twin_file import default_twin
from ins.units import DEG
from trajectories.simulator.motions import lay
from trajectories.simulator.segments import Park
from trajectories.simulator.sensors import ideal_sensors
from trajectories.simulator.session import SessionPlan, simulate_run
from trajectories.simulator.thermal import thermal_history
from trajectories.simulator.truth import build_truth
from trajectories.simulator.unit_truth import aged_unit

# of the blank table: 70 % of the variance common, 30 % smooth (formats.md, section 2)
SIGMA_DEG_H = 30.0
GYRO = GyroNoise(
    arw_deg_sqrt_h=0.2,
    bias_instability_deg_h=5.0,
    rate_random_walk_deg_h_sqrt_h=5.0,
    turn_on_deg_h=100.0,
)
TWIN = replace(
    default_twin("mems"), gyro=GYRO, accel=AccelNoise(vrw_ug_sqrt_hz=100.0, turn_on_ug=3000.0)
)
WARM_UP = replace(
    thermal_history("ambient"),
    start_degC=20.0,
    settled_degC=43.5,
    block_tau_s=600.0,
    gyro_tau_s=(60.0, 70.0, 50.0),
)
LAT_RAD = 45.0 * DEG


def blank():
    return default_table(
        imu_serial="SN-1",
        gyro_technology="mems",
        created_utc="2026-01-01T00:00:00Z",
        sigma_deg_h=SIGMA_DEG_H,
    )


def unit(seed):
    """A unit whose curve is a draw from the blank table's own prior."""
    return aged_unit(
        np.random.default_rng([seed, 3]),
        imu_serial="SN-1",
        gyro_technology="mems",
        table=table_to_dict(blank()),
        ageing_offset_deg_h=SIGMA_DEG_H * np.sqrt(0.7),
        ageing_shape_deg_h=SIGMA_DEG_H * np.sqrt(0.3),
    )


@lru_cache(maxsize=32)
def ideal(heading_deg, duration_s=2400.0, lat_rad=LAT_RAD):
    site = Site(lat_rad=lat_rad, lon_rad=7 * DEG, height_m=250.0)
    truth = build_truth(
        lay((Park(duration_s=duration_s),), alignment_s=60.0),
        site,
        heading_rad=heading_deg * DEG,
        roll_rad=0.02,
        pitch_rad=-0.03,
    )
    return ideal_sensors(truth, 10.0)


def session(seed, number=0, *, heading_deg=None, thermal=WARM_UP, twin=TWIN, **options):
    """One of 24 headings by the seed, where none is given."""
    rng = np.random.default_rng([seed, number, 5])
    heading_deg = 15.0 * rng.integers(24) if heading_deg is None else heading_deg
    return simulate_run(
        ideal(heading_deg),
        thermal,
        unit(seed),
        twin,
        rng=rng,
        plan=SessionPlan(
            run_id=f"run-{seed}-{number}",
            start_utc=f"2026-03-{number + 1:02d}T05:00:00Z",
            **options,
        ),
    )


def updated(runs, table=None, twin=TWIN, **options):
    return update_calibration(runs, table or blank(), twin, **options)


def squared_error(table, truth, temperature_degC=(22.0, 32.0, 43.0)):
    """Squared normalised error of a table against the true unit and its degrees of freedom."""
    T = np.array(temperature_degC)
    rows = np.vstack([table.basis(axis, T) for axis in range(3)])
    error = rows @ table.parameters - np.concatenate([truth.bias_deg_h(axis, T) for axis in "xyz"])
    return float(error @ np.linalg.solve(rows @ table.covariance @ rows.T, error)), error.size
