"""MEMS units that stand, taxi and fly with a receiver, with errors of their own that only motion
shows.
"""

from dataclasses import replace
from functools import lru_cache

import numpy as np

from infield.session.flown.flight import RunInputs
from infield.session.one_run import take_run
from infield.session.settings import SessionSettings
from infield.thermometer.gyro_temperature import gyro_temperature
from ins.records import Site
from ins.units import DEG
from tests.infield.flight_errors import FlightErrors, with_flight_errors
from tests.infield.mems_sessions import TWIN, WARM_UP, blank, unit
from trajectories.simulator.motions import lay
from trajectories.simulator.segments import Climb, Cruise, Park, Straight, TakeOff, Turn, TurnFlight
from trajectories.simulator.sensors import ideal_sensors
from trajectories.simulator.session import SessionPlan, simulate_run
from trajectories.simulator.truth import build_truth

SETTINGS = SessionSettings()
PARKED_S = 120.0
ARM_M = (1.0, -0.3, -0.8)
SCALE_PPM, MISALIGNMENT_MRAD = (4000.0, -6000.0, 5000.0), (3.0, -4.0, 2.0, 5.0, -3.0, 4.0)
SLOW = FlightErrors(slow_position_m=1.5, slow_velocity_m_s=0.01)
WAY = (
    Turn(angle_deg=90.0),
    Straight(duration_s=40.0),
    TakeOff(lift_off_speed_m_s=40.0),
    Climb(height_m=300.0, rate_m_s=5.0, speed_m_s=60.0),
    TurnFlight(angle_deg=120.0),
    Cruise(duration_s=60.0),
    TurnFlight(angle_deg=-200.0),
    Cruise(duration_s=90.0),
    TurnFlight(angle_deg=90.0),
    Cruise(duration_s=60.0),
)


STRAIGHT = (
    Turn(angle_deg=90.0),
    Straight(duration_s=40.0),
    TakeOff(),
    Climb(height_m=3000.0, rate_m_s=10.0, speed_m_s=180.0),
    Cruise(duration_s=2400.0),
)


@lru_cache(maxsize=2)
def ideal(way=WAY, rate_hz=20.0):
    site = Site(lat_rad=45.0 * DEG, lon_rad=7 * DEG, height_m=250.0)
    motion = lay((Park(duration_s=PARKED_S), *way), alignment_s=60.0)
    truth = build_truth(motion, site, heading_rad=70.0 * DEG, roll_rad=0.02, pitch_rad=-0.03)
    return ideal_sensors(truth, rate_hz)


@lru_cache(maxsize=8)
def simulated(seed, *, errors=SLOW, gnss=TWIN.gnss, way=WAY):
    """A unit of the blank table's prior, with scales and misalignments that nobody declares; gnss:
    white noise of its receiver.
    """
    gyro = replace(TWIN.gyro, scale_factor_ppm=SCALE_PPM, misalignment_mrad=MISALIGNMENT_MRAD)
    rng = np.random.default_rng([seed, 21])
    plan = SessionPlan(
        run_id=f"away-{seed}",
        start_utc="2026-03-01T05:00:00Z",
        with_gnss=True,
        with_phases=False,
        gnss_lever_arm_m=ARM_M,
    )
    made = simulate_run(
        ideal(way), WARM_UP, unit(seed), replace(TWIN, gyro=gyro, gnss=gnss), rng=rng, plan=plan
    )
    return with_flight_errors(made, ideal(way), errors, rng)


def known(run):
    """A run as its update knows it, against the blank table."""
    temperature = gyro_temperature(run.temperature)
    low, high = temperature.temperature_degC.min(), temperature.temperature_degC.max()
    table = blank().extended_to(float(low), float(high))
    return RunInputs(run, table, temperature, TWIN, SETTINGS)


def taken(run):
    return take_run(run, blank(), TWIN, SETTINGS, False)


def bin_errors(made, estimate):
    """Estimate less truth (N, 3) [deg/h] of the bins' mean biases; the blank table is zero."""
    t, bias, bins = made.bias_time_s, made.gyro_bias_true_deg_h, estimate.bins
    true = [bias[(t >= a) & (t < b)].mean(axis=0) for a, b in zip(bins.start_s, bins.end_s)]
    return estimate.mean_deg_h.reshape(-1, 3) + bins.table_deg_h.reshape(-1, 3) - np.array(true)
