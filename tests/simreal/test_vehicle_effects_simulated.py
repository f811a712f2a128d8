"""Effects against the simulator's own truth, which shares no formula with them: signs of rotations,
levers and places.
"""

from dataclasses import replace

import numpy as np
import pytest

from ins.attitude import dcm_from_euler
from ins.errors.accelerometer import ACCELEROMETER
from ins.errors.navigation import NAVIGATION_EFFECTS
from ins.errors.platform import PLATFORM
from ins.errors.telemetry import PARKED, ROLLING, Telemetry, Trace, total
from ins.errors.wheels import WHEELS
from ins.records import Site, VehicleNoise
from ins.units import ARCSEC, DEG
from trajectories.simulator.motions import lay
from trajectories.simulator.segments import Park, Stop, Straight, Turn
from trajectories.simulator.sensors import IdealSensors, ideal_sensors
from trajectories.simulator.truth import build_truth
from trajectories.simulator.vehicle import Boarding, disturb

SITE = Site(lat_rad=45 * DEG, lon_rad=7 * DEG, height_m=250.0)
TAXI = [
    Park(duration_s=40.0),
    Turn(angle_deg=90.0),
    Straight(duration_s=60.0),
    Stop(duration_s=10.0),
    Turn(angle_deg=-120.0),
    Straight(duration_s=30.0),
    Stop(duration_s=10.0),
]
QUIET = VehicleNoise(
    crab_mrad=0.0, lateral_noise_m_s=0.0, yaw_creep_arcsec_sqrt_h=0.0, sway_m_s=0.0
)
WHEEL = (4.0, 0.5, 1.0)
ARCMIN = 60.0 * ARCSEC
BY_ID = {effect.id: effect for effect in (*ACCELEROMETER, *NAVIGATION_EFFECTS, *PLATFORM, *WHEELS)}


def simulated(wheel=WHEEL, site=SITE, plan=TAXI, rate_hz=20.0) -> IdealSensors:
    return ideal_sensors(
        build_truth(lay(plan), site, heading_rad=0.4, wheel_reference_m=wheel), rate_hz
    )


@pytest.fixture(scope="module")
def taxi():
    return simulated()


def telemetry(ideal: IdealSensors) -> Telemetry:
    """Of the IMU, at its rows (attitude and velocity in the middle of each)."""
    dt = ideal.dt_s
    roll, pitch, heading = (
        ideal.euler_rad - 0.5 * np.diff(ideal.euler_rad, axis=0, prepend=ideal.euler_rad[:1])
    ).T
    v_n = ideal.v_n_m_s - 0.5 * np.diff(ideal.v_n_m_s, axis=0, prepend=ideal.v_n_m_s[:1])
    C_nb = dcm_from_euler(roll, pitch, heading)
    return Telemetry(
        run_index=0,
        time_s=ideal.time_s - 0.5 * dt,
        dt_s=dt,
        rate_rad_s=ideal.dtheta_rad / dt,
        force_m_s2=ideal.dv_m_s / dt,
        C_nb=C_nb,
        v_n_m_s=v_n,
        speed_m_s=np.einsum("ni,ni->n", C_nb[:, :, 0], v_n),
        turn_rad_s=np.diff(ideal.euler_rad[:, 2], prepend=ideal.euler_rad[0, 2]) / dt,
        kind=np.where(ideal.at_rest, PARKED, ROLLING),
        lat_rad=SITE.lat_rad,
        height_m=SITE.height_m,
    )


def combined(
    key: str, run: Telemetry, sizes: list[float], target: str = "", **shape: float
) -> Trace:
    effect = BY_ID[key]
    return total(
        t.scaled(s)
        for t, s in zip(effect.traces(run, target or effect.targets[0], shape), sizes, strict=True)
    )


@pytest.mark.parametrize(
    "sizes",
    [[200.0, 0.0, 0.0], [0.0, -150.0, 0.0], [0.0, 0.0, 250.0]],
    ids=["roll", "pitch", "heading"],
)
def test_a_step_is_a_boarding(taxi, sizes):
    """The same rotation before the taxi: angles once it has settled, and what all later turns and
    forces make of it.
    """
    names = ("roll_arcsec", "pitch_arcsec", "heading_arcsec")
    event = Boarding(time_s=20.0, settle_s=1.0, **dict(zip(names, sizes)))
    moved = disturb(taxi, QUIET, (event,), np.random.default_rng(1))
    trace = combined("platform_step", telemetry(taxi), sizes, onset_s=20.5)
    gyro = (moved.dtheta_rad - taxi.dtheta_rad) / taxi.dt_s
    accel = (moved.dv_m_s - taxi.dv_m_s) / taxi.dt_s
    early = taxi.time_s < 30.0
    np.testing.assert_allclose(
        trace.gyro_rad_s[early].sum(axis=0) * taxi.dt_s,
        gyro[early].sum(axis=0) * taxi.dt_s,
        atol=2e-3 * 250 * ARCSEC,
    )
    later = taxi.time_s > 30.0
    # of the way that turns with the heading: 12 m/s x 1.2 mrad, over R or times 2 Omega
    transport, coriolis = 3e-9, 2.5e-6
    np.testing.assert_allclose(
        trace.gyro_rad_s[later], gyro[later], atol=2e-3 * np.abs(gyro[later]).max() + transport
    )
    np.testing.assert_allclose(
        trace.accel_m_s2[later], accel[later], atol=5e-3 * np.abs(accel[later]).max() + coriolis
    )
    if sizes[2] != 0.0:
        turned = moved.v_n_m_s - taxi.v_n_m_s
        assert np.abs(turned).max() > 0.01
        np.testing.assert_allclose(trace.gnss_velocity_m_s[later], turned[later], atol=1e-3)
        np.testing.assert_allclose(
            trace.gnss_position_m[-1], turned.sum(axis=0) * taxi.dt_s, atol=0.01
        )


def test_lever_arm_is_what_a_vehicle_on_other_wheels_shows(taxi):
    d = np.array([-1.5, 0.8, 0.0])  # true place of the wheels less the logged one
    run, logged = telemetry(taxi), np.array(WHEEL) - d
    v_b = np.einsum("nji,nj->ni", run.C_nb, run.v_n_m_s)
    at_logged = v_b + np.cross(run.rate_rad_s, logged)
    at_true = v_b + np.cross(run.rate_rad_s, WHEEL)
    trace = combined("lever_arm", run, [-1.5, 0.8])
    assert np.abs(at_logged[:, 1]).max() > 0.1
    rolls = run.rolling
    np.testing.assert_allclose(trace.lateral_m_s[rolls], at_logged[rolls, 1], atol=2e-3)
    np.testing.assert_allclose(
        trace.odometer_m_s[rolls], (at_true - at_logged)[rolls, 0], atol=2e-3
    )


@pytest.mark.parametrize("axis", range(3))
def test_size_effect_is_what_a_unit_beside_it_feels(taxi, axis):
    r_m = np.array([0.3, -0.2, 0.1])
    beside = simulated(tuple(np.array(WHEEL) - r_m))
    felt = (beside.dv_m_s - taxi.dv_m_s)[:, axis] / taxi.dt_s
    trace = combined(
        "imu_size_effect", telemetry(taxi), list(100 * r_m), target=f"accel_{'xyz'[axis]}"
    )
    error = trace.accel_m_s2[:, axis] - felt
    smooth = np.convolve(error, np.full(20, 0.05), mode="same")  # means over a second
    assert np.abs(smooth).max() < 0.05 * np.abs(felt).max() + 2e-6


def test_latitude_error_is_the_difference_of_two_places():
    plan = [Park(duration_s=20.0)]
    entered, true = (
        simulated(plan=plan, site=replace(SITE, lat_rad=SITE.lat_rad - x))
        for x in (0.0, 3 * ARCMIN)
    )
    trace = combined("site_latitude_error", telemetry(entered), [3.0])
    np.testing.assert_allclose(
        trace.gyro_rad_s, (true.dtheta_rad - entered.dtheta_rad) / true.dt_s, rtol=2e-3, atol=1e-12
    )
    np.testing.assert_allclose(
        trace.accel_m_s2, (true.dv_m_s - entered.dv_m_s) / true.dt_s, rtol=2e-3, atol=1e-9
    )


def test_antenna_and_latency_are_where_the_simulated_vehicle_was(taxi):
    run, arm, late_s = telemetry(taxi), np.array([2.0, -1.0, 0.0]), 0.1
    trace = combined("gnss_lever_arm_or_latency", run, [*arm[:2], 1e3 * late_s])
    rows = round(late_s * taxi.rate_hz)
    at = np.einsum("nij,j->ni", run.C_nb, arm) + np.cumsum(run.v_n_m_s, axis=0) * run.dt_s
    way = np.roll(at, rows, axis=0) - np.cumsum(run.v_n_m_s, axis=0) * run.dt_s
    np.testing.assert_allclose(trace.gnss_position_m[rows:], way[rows:], atol=0.05)
    assert np.abs(way[rows:, :2]).max() > 2.0
    swing = np.gradient(np.einsum("nij,j->ni", run.C_nb, arm), run.time_s, axis=0)
    expected = swing - late_s * np.gradient(run.v_n_m_s, run.time_s, axis=0)
    np.testing.assert_allclose(trace.gnss_velocity_m_s, expected, atol=5e-3)
