"""A latitude that was typed, guessed or measured: what the gyros' sigmas make of it.

The recordings are written here from the equations of a unit at rest on the turning Earth, in numpy,
without the simulator.
"""

import json

import numpy as np

EARTH_DEG_H, GRAVITY = 15.041067, 9.80825  # at 48 deg and 200 m
TRUE_LAT_DEG = 48.0
BIAS_DEG_H = np.array([-0.0120, 0.0180, 0.0065])  # at 20 degC
SLOPE_DEG_H_DEGC = np.array([4e-4, -3e-4, 5e-4])
RATE_HZ, MINUTES = 10, 40
WARMED_DEGC = 8.0
SIGMAS = 3.0


def parked_rows(rng, *, heading_deg=40.0, lat_deg=TRUE_LAT_DEG, lean_deg=(0.4, -0.7)):
    """Time (n,), rates [rad/s], specific force (n, 3) and temperature (n,) of a ring-laser unit
    that stands for 40 min while it warms up.
    """
    n = RATE_HZ * 60 * MINUTES
    time_s = np.arange(1, n + 1) / RATE_HZ
    T = 20.0 + WARMED_DEGC * (1.0 - np.exp(-time_s / 1200.0))
    heading, lat = np.radians(heading_deg), np.radians(lat_deg)
    roll, pitch = np.radians(lean_deg)
    about_z = np.array(
        [
            [np.cos(heading), np.sin(heading), 0.0],
            [-np.sin(heading), np.cos(heading), 0.0],
            [0.0, 0.0, 1.0],
        ]
    )
    about_y = np.array(
        [[np.cos(pitch), 0.0, -np.sin(pitch)], [0.0, 1.0, 0.0], [np.sin(pitch), 0.0, np.cos(pitch)]]
    )
    about_x = np.array(
        [[1.0, 0.0, 0.0], [0.0, np.cos(roll), np.sin(roll)], [0.0, -np.sin(roll), np.cos(roll)]]
    )
    body_of_ned = about_x @ about_y @ about_z
    earth = body_of_ned @ (EARTH_DEG_H * np.array([np.cos(lat), 0.0, -np.sin(lat)]))
    bias = BIAS_DEG_H + SLOPE_DEG_H_DEGC * (T - 20.0)[:, None]
    white = 0.002 * np.sqrt(3600.0 * RATE_HZ) * rng.standard_normal((n, 3))  # 0.002 deg/sqrt(h)
    rates = np.radians(earth + bias + white) / 3600.0
    force = body_of_ned @ [0.0, 0.0, -GRAVITY] + 2e-4 * rng.standard_normal((n, 3))
    return time_s, rates, force, T


def write_csv(path, columns):
    names, values = list(columns), np.column_stack(list(columns.values()))
    np.savetxt(path, values, "%.12g", ",", header=",".join(names), comments="")


def write_run(folder, site, rng, **how):
    """A run directory whose run.json has this site, as text."""
    folder.mkdir(parents=True)
    time_s, rates, force, T = parked_rows(rng, **how)
    of_axes = {f"gyro_{a}_rad_s": rates[:, k] for k, a in enumerate("xyz")}
    of_axes |= {f"accel_{a}_m_s2": force[:, k] for k, a in enumerate("xyz")}
    write_csv(folder / "imu.csv", {"time_s": time_s, **of_axes})
    every = slice(None, None, RATE_HZ)
    of_gyros = {f"gyro_{a}_degC": T[every] for a in "xyz"}
    write_csv(folder / "temperature.csv", {"time_s": time_s[every], **of_gyros})
    keys = {
        "schema": "recal.run/1",
        "run_id": folder.name,
        "tail": "",
        "imu_serial": "SN-48",
        "gyro_technology": "rlg",
        "start_utc": "2026-05-01T08:00:00Z",
        "lever_arms_m": {},
        "applied_table_sha256": None,
    }
    text = json.dumps(keys)[:-1] + f', "site": {{{site}, "lon_deg": 11.5, "height_m": 200.0}}}}'
    (folder / "run.json").write_text(text)
    return folder
