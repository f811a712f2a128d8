"""MEMS units that stand cold, fly and stand warm: two stretches of rest of one power-on, on
headings that nobody knows.
"""

from dataclasses import replace
from functools import lru_cache

import numpy as np

from ins.records import Phase, Site
from ins.units import DEG
from tests.infield.mems_sessions import LAT_RAD, TWIN, WARM_UP, unit
from trajectories.simulator.motions import lay
from trajectories.simulator.segments import Park, Stop, Straight, Turn
from trajectories.simulator.sensors import ideal_sensors
from trajectories.simulator.session import SessionPlan, simulate_run
from trajectories.simulator.truth import build_truth

COLD_S, WARM_S = 180.0, 120.0
# of the angle and velocity from row to row while it does not stand
VIBRATION_RAD, VIBRATION_M_S = 1e-3, 0.1
SCALE_PPM = 5000.0  # 1 sigma, as `SessionSettings` says of MEMS


@lru_cache(maxsize=64)
def ideal(heading_deg, turn_deg, away_s=1200.0):
    """Stand, a turn, a way, stand again; and from when to when it does not stand [s]."""
    leg = 0.5 * away_s - 60.0
    motion = lay(
        (
            Park(duration_s=COLD_S),
            Turn(angle_deg=turn_deg - 120.0),
            Straight(duration_s=leg),
            Turn(angle_deg=120.0),
            Straight(duration_s=leg),
            Stop(duration_s=5.0),
            Park(duration_s=WARM_S),
        ),
        alignment_s=60.0,
    )
    site = Site(lat_rad=LAT_RAD, lon_rad=7 * DEG, height_m=250.0)
    truth = build_truth(motion, site, heading_rad=heading_deg * DEG, roll_rad=0.02, pitch_rad=-0.03)
    return ideal_sensors(truth, 10.0), (COLD_S, motion.end_s - WARM_S)


def flight(
    seed,
    number=0,
    *,
    heading_deg=None,
    turn_deg=None,
    twin=TWIN,
    away_s=1200.0,
    shaken=True,
    **options,
):
    """One of six headings and four turns by the seed, where none is given; no phases."""
    rng = np.random.default_rng([seed, number, 11])
    heading_deg = 60.0 * rng.integers(6) if heading_deg is None else heading_deg
    turn_deg = 90.0 * rng.integers(4) - 60.0 if turn_deg is None else turn_deg
    sensors, (away, back) = ideal(heading_deg, turn_deg, away_s)
    simulated = simulate_run(
        sensors,
        WARM_UP,
        unit(seed),
        twin,
        rng=rng,
        plan=SessionPlan(
            run_id=f"flight-{seed}-{number}",
            start_utc=f"2026-03-{number + 1:02d}T05:00:00Z",
            **options,
        ),
    )
    run = replace(simulated.run, phases=())
    imu = run.imu
    off = ((imu.time_s > away) & (imu.time_s <= back))[:, None]
    angle = rng.normal(0.0, VIBRATION_RAD, imu.dtheta_rad.shape)
    way = rng.normal(0.0, VIBRATION_M_S, imu.dv_m_s.shape)
    of_scale = 1e-6 * SCALE_PPM * rng.standard_normal(3) * sensors.dtheta_rad
    turned = (
        imu.dtheta_rad
        + of_scale
        + shaken * off * np.diff(angle * off, axis=0, prepend=np.zeros((1, 3)))
    )
    pushed = imu.dv_m_s + shaken * off * np.diff(way * off, axis=0, prepend=np.zeros((1, 3)))
    return replace(simulated, run=replace(run, imu=replace(imu, dtheta_rad=turned, dv_m_s=pushed)))


def landed(run, duration_s=WARM_S):
    """The last stretch named as a phase, and the flight."""
    end = run.imu.end_s
    named = (
        ("parked", 0.0, COLD_S),
        ("flight", COLD_S, end - duration_s),
        ("parked", end - duration_s, end),
    )
    return replace(run, phases=tuple(Phase(phase=n, start_s=a, end_s=b) for n, a, b in named))
