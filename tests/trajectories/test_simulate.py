"""A whole simulated session: same seed, same run; streams, biases and truth fit together; faults
land where told.
"""

import numpy as np
import pytest

from ins.attitude import dcm_from_euler, wrap_pi
from ins.earth import ecef_from_geodetic, gravity_n, omega_ie_n
from ins.records import (
    AccelNoise,
    GnssNoise,
    GyroNoise,
    InputError,
    OdometerNoise,
    Site,
    TwinModel,
    VehicleNoise,
)
from ins.units import DEG, DEG_PER_HOUR, MICRO_G
from tests import faults
from trajectories.simulator.motions import lay
from trajectories.simulator.segments import Park, Pivot, Stop, Straight, Turn
from trajectories.simulator.sensors import ideal_sensors
from trajectories.simulator.session import SessionPlan, simulate_run
from trajectories.simulator.thermal import thermal_history
from trajectories.simulator.truth import build_truth
from trajectories.simulator.unit_truth import aged_unit

SITE = Site(lat_rad=45 * DEG, lon_rad=7 * DEG, height_m=250.0)
MOTION = [
    Park(duration_s=300.0),
    Turn(angle_deg=90.0),
    Straight(duration_s=60.0),
    Stop(duration_s=10.0),
    Pivot(angle_deg=45.0, duration_s=20.0),
    Park(duration_s=20.0),
]
NO_NOISE = TwinModel(
    gyro=GyroNoise(arw_deg_sqrt_h=0.0),
    accel=AccelNoise(vrw_ug_sqrt_hz=0.0),
    gnss=GnssNoise(sigma_horizontal_m=0.0, sigma_vertical_m=0.0, sigma_velocity_m_s=0.0),
    odometer=OdometerNoise(noise_m_s=0.0),
    vehicle=VehicleNoise(lateral_noise_m_s=0.0, yaw_creep_arcsec_sqrt_h=0.0, sway_m_s=0.0),
)


@pytest.fixture(scope="module")
def ideal():
    return ideal_sensors(build_truth(lay(MOTION, alignment_s=100.0), SITE, heading_rad=1.0), 10.0)


def session(ideal, seed=1, twin=None, **options):
    unit = aged_unit(np.random.default_rng(9))
    return simulate_run(
        ideal,
        thermal_history("cold"),
        unit,
        twin or TwinModel(),
        rng=np.random.default_rng(seed),
        plan=SessionPlan(**options),
    )


def test_same_seed_same_run_and_another_seed_another(ideal):
    a, b, c = (session(ideal, seed, with_gnss=True, with_odometer=True) for seed in (1, 1, 2))
    assert a.run.sha256 == b.run.sha256 != c.run.sha256
    np.testing.assert_array_equal(a.run.imu.dtheta_rad, b.run.imu.dtheta_rad)
    np.testing.assert_array_equal(a.gyro_bias_true_deg_h, b.gyro_bias_true_deg_h)
    assert not np.array_equal(a.reference.v_n_m_s, c.reference.v_n_m_s)


def test_parked_gyros_read_earth_rate_plus_the_true_bias(ideal):
    """No white noise: bias = measured - true, at each second."""
    made = session(ideal, twin=NO_NOISE)
    parked = 290
    measured = made.run.imu.dtheta_rad[: parked * 10].reshape(parked, 10, 3).sum(axis=1)
    C_bn = dcm_from_euler(0.0, 0.0, 1.0).T
    bias = (measured - C_bn @ omega_ie_n(SITE.lat_rad)) / DEG_PER_HOUR
    true = 0.5 * (made.gyro_bias_true_deg_h[:parked] + made.gyro_bias_true_deg_h[1 : parked + 1])
    np.testing.assert_allclose(bias, true, atol=4 * 0.002)  # flicker within the second
    np.testing.assert_allclose(bias.mean(axis=0), true.mean(axis=0), atol=3e-4)
    f = made.run.imu.dv_m_s[: parked * 10].reshape(parked, 10, 3).sum(axis=1)
    accel = (f + C_bn @ gravity_n(SITE.lat_rad, 250.0)).mean(axis=0) / MICRO_G
    np.testing.assert_allclose(accel, made.accel_bias_true_ug[:parked].mean(axis=0), atol=0.5)


def test_true_bias_is_the_units_curve_plus_one_constant_where_nothing_else_drifts(ideal):
    quiet = GyroNoise(bias_instability_deg_h=0.0, rate_random_walk_deg_h_sqrt_h=0.0)
    made = session(ideal, twin=TwinModel(gyro=quiet))
    unit = aged_unit(np.random.default_rng(9))
    for k, axis in enumerate("xyz"):
        rest = made.gyro_bias_true_deg_h[:, k] - unit.bias_deg_h(
            axis, made.temperature_true_degC[:, k]
        )
        assert np.ptp(rest) < 1e-12 and 0 < abs(rest[0]) < 5 * 0.003


def test_streams_have_their_rates_and_headers(ideal):
    made = session(
        ideal, with_gnss=True, with_odometer=True, gnss_lever_arm_m=(1.0, 2.0, -3.0), run_id="R7"
    )
    run = made.run
    assert run.header.run_id == "R7" and run.header.gnss_lever_arm_m == (1.0, 2.0, -3.0)
    assert run.imu.time_s[0] == 0.1 and run.imu.rate_hz == pytest.approx(10.0)
    for stream, rate in (
        (run.temperature, 1.0),
        (run.gnss, 1.0),
        (run.odometer, 10.0),
        (made.reference, 10.0),
    ):
        np.testing.assert_allclose(np.diff(stream.time_s), 1 / rate, atol=1e-9)
    np.testing.assert_array_equal(run.temperature.time_s, made.bias_time_s)
    assert run.phases[0].phase == "alignment" and run.phases[0].end_s == 100.0
    bare = session(ideal, with_phases=False)
    assert bare.run.gnss is None and bare.run.odometer is None and bare.run.phases == ()


def test_gnss_antenna_swings_with_the_vehicle(ideal):
    """Position is r_imu + C_eb lever; velocity is the derivative of that position, also while the
    vehicle pivots.
    """
    lever = (3.0, 0.0, -2.0)
    made = session(ideal, twin=NO_NOISE, with_gnss=True, gnss_lever_arm_m=lever)
    fix, reference = made.run.gnss, made.reference
    rows = np.searchsorted(reference.time_s, fix.time_s - 1e-9)
    imu_e = ecef_from_geodetic(
        reference.lat_rad[rows], reference.lon_rad[rows], reference.height_m[rows]
    )
    antenna_e = ecef_from_geodetic(fix.lat_rad, fix.lon_rad, fix.height_m)
    arm = np.linalg.norm(antenna_e - imu_e, axis=1)
    np.testing.assert_allclose(arm, np.hypot(3.0, 2.0), atol=1e-6)
    np.testing.assert_allclose(fix.height_m - reference.height_m[rows], 2.0, atol=1e-5)
    pivot = int(np.searchsorted(fix.time_s, ideal.truth.motion.end_s - 30.0))
    angle, rate = reference.heading_rad[rows[pivot]], ideal.dtheta_rad[rows[pivot], 2] * 10.0
    expected = 3.0 * rate * np.array([-np.sin(angle), np.cos(angle), 0.0])
    np.testing.assert_allclose(fix.v_n_m_s[pivot], expected, atol=0.005)
    assert abs(rate) > 0.05


def test_odometer_reads_p_along_body_x_and_no_sway(ideal):
    sway = TwinModel(
        odometer=OdometerNoise(noise_m_s=0.0), vehicle=VehicleNoise(sway_m_s=0.5, crab_mrad=5.0)
    )
    made = session(ideal, twin=sway, with_odometer=True)
    speed = np.interp(made.run.odometer.time_s, ideal.time_s, ideal.speed_m_s)
    np.testing.assert_allclose(made.run.odometer.speed_m_s, speed, atol=1e-12)


def test_reference_is_the_disturbed_truth(ideal):
    creep = TwinModel(
        vehicle=VehicleNoise(yaw_creep_arcsec_sqrt_h=500.0, sway_m_s=0.0, lateral_noise_m_s=0.0)
    )
    made = session(ideal, twin=creep)
    moved = wrap_pi(made.reference.heading_rad - ideal.euler_rad[:, 2])
    assert 1e-5 < np.max(np.abs(moved)) < 5e-3
    turned = np.cumsum(made.run.imu.dtheta_rad[:3000, 2] - ideal.dtheta_rad[:3000, 2])
    assert np.corrcoef(turned, moved[:3000])[0, 1] > 0.9


def test_twin_effects_are_not_passed_over_in_silence(ideal):
    twin = TwinModel(
        effects=({"effect": "gyro_thermal_rate", "target": "gyro_y", "parameters": {}},)
    )
    with pytest.raises(InputError, match="gyro_thermal_rate"):
        session(ideal, twin=twin)


def test_faults_touch_what_they_say_and_nothing_else(ideal):
    run = session(ideal).run
    stuck = faults.stuck_thermometer(run, axis="y", start_s=100.0)
    assert np.ptp(stuck.temperature.gyro_degC[100:, 1]) == 0
    assert np.ptp(run.temperature.gyro_degC[100:, 1]) > 1
    np.testing.assert_array_equal(
        stuck.temperature.gyro_degC[:, 0], run.temperature.gyro_degC[:, 0]
    )
    clipped = faults.clipped_gyro(run, axis="z", limit_rad_s=0.05)
    assert np.max(np.abs(clipped.imu.dtheta_rad[:, 2])) == pytest.approx(0.005)
    assert np.max(np.abs(run.imu.dtheta_rad[:, 2])) > 0.006
    gap = faults.dropout(run, start_s=50.0, end_s=60.0)
    assert run.imu.time_s.size - gap.imu.time_s.size == 100
    assert np.max(np.diff(gap.imu.time_s)) == pytest.approx(10.1)
    assert np.max(gap.imu.dt_s) == pytest.approx(0.1)
    hit = faults.shock(run, axis="x", at_s=70.0, dv_m_s=2.0)
    np.testing.assert_allclose(np.abs(hit.imu.dv_m_s - run.imu.dv_m_s).sum(), 2.0)
    late = faults.time_jump(run, at_s=80.0, by_s=3.0)
    assert np.max(np.diff(late.imu.time_s)) == pytest.approx(3.1)
    with pytest.raises(InputError, match="no rows"):
        faults.dropout(run, start_s=1e6, end_s=2e6)
