"""Effects against the plain formula of effects.md: what is richer in them stays within the
tolerance written beside it.

Each case: target, parameters, the plain formula over a `Seen` (gyro [deg/h] or accelerometer
[micro-g] of the target's axis), and the part of the largest value by which the shape may depart
from it.
"""

import numpy as np
import pytest

from ins.units import ARCSEC, DEG_PER_HOUR, MICRO_G
from tests.gap_trials.cases import change, planted


def rate_degC_min(seen, axis=0):
    return np.gradient(seen.gyro_degC[:, axis], seen.dt_s) * 60.0


def body_rate_deg_h(seen, axis):
    return seen.dtheta_rad[:, axis] / seen.dt_s / DEG_PER_HOUR


def force_ug(seen, axis):
    return seen.dv_m_s[:, axis] / seen.dt_s / MICRO_G


def lagging(seen, tau_s):
    """T_coil - T by Euler steps."""
    T, late = seen.gyro_degC[:, 1], np.empty(seen.rows)
    now = T[0]
    for k, value in enumerate(T):
        now += (value - now) * seen.dt_s / tau_s
        late[k] = now - value
    return late


def centripetal_ug(seen, arm_m):
    w = seen.omega_nb_b[:, 2]
    turning = np.gradient(w, seen.dt_s)
    return (-(w**2) * arm_m[0] - turning * arm_m[1]) / MICRO_G


def decay(seen, tau_s):
    return np.exp(-seen.time_s / tau_s)


def case(target, formula, apart, **parameters):
    return target, parameters, formula, apart


CASES = {
    "gyro_thermal_rate": case(
        "gyro_x",
        lambda s: 0.03 * rate_degC_min(s),
        0.01,
        coefficient_deg_h_min_degC=0.03,
        shell_s=0.2,
    ),
    "gyro_thermal_quadratic": case(
        "gyro_z", lambda s: 1e-4 * (s.gyro_degC[:, 2] - 20) ** 2, 0.1, coefficient_deg_h_degC2=1e-4
    ),
    "gyro_thermal_gradient": case(
        "gyro_y", lambda s: 0.01 * s.gradient_degC[:, 1], 1e-6, coefficient_deg_h_degC=0.01
    ),
    "gyro_thermal_lag": case(
        "gyro_y", lambda s: 0.01 * lagging(s, 200.0), 0.12, coefficient_deg_h_degC=0.01, tau_s=200.0
    ),
    "gyro_warmup_transient": case(
        "gyro_x", lambda s: 0.02 * decay(s, 400.0), 0.08, amplitude_deg_h=0.02, tau_s=400.0
    ),
    "gyro_rate_ramp": case(
        "gyro_x", lambda s: 0.003 * s.time_s / 3600.0, 1e-6, slope_deg_h_h=0.003
    ),
    "gyro_mode_hop": case(
        "gyro_x",
        lambda s: 0.005 * np.sin(2 * np.pi * s.gyro_degC[:, 0] / 6.0 + 1.0),
        0.5,
        amplitude_deg_h=0.005,
        period_degC=6.0,
        phase_rad=1.0,
    ),
    "gyro_scale_factor": case(
        "gyro_z", lambda s: 20e-6 * body_rate_deg_h(s, 2), 1e-6, scale_ppm=20.0
    ),
    "gyro_scale_asymmetry": case(
        "gyro_z", lambda s: 20e-6 * np.abs(body_rate_deg_h(s, 2)), 0.05, asymmetry_ppm=20.0
    ),
    "gyro_misalignment": case(
        "gyro_x", lambda s: 10 * ARCSEC * body_rate_deg_h(s, 2), 1e-6, arcsec_xyz=[500.0, 0.0, 10.0]
    ),
    "gyro_g_sensitivity": case(
        "gyro_y",
        lambda s: 0.002e-6 * force_ug(s, 2),
        1e-6,
        deg_h_g=0.002,
        direction=[0.0, 0.0, 1.0],
    ),
    "clock_rate": case("gyro_z", lambda s: 30e-6 * body_rate_deg_h(s, 2), 1e-6, ppm=30.0),
    "accel_thermal": case("accel_x", lambda s: 2.0 * (s.accel_degC[:, 0] - 20), 0.12, ug_degC=2.0),
    "accel_warmup_transient": case(
        "accel_y", lambda s: 40.0 * decay(s, 400.0), 0.08, amplitude_ug=40.0, tau_s=400.0
    ),
    "accel_scale_factor": case(
        "accel_z", lambda s: 100e-6 * force_ug(s, 2), 0.025, scale_ppm=100.0
    ),
    "imu_size_effect": case(
        "accel_x", lambda s: centripetal_ug(s, [0.05, 0.03]), 0.1, arm_m=[0.05, 0.03, 0.0]
    ),
    "vertical_deflection": case(
        "accel_x",
        lambda s: 4.848 * (10 * np.cos(s.heading_rad) - 5 * np.sin(s.heading_rad)),
        0.01,
        arcsec_north_east=[10.0, -5.0],
        anomaly_mgal=0.0,
    ),
    "platform_mount_sag": case(
        "accel_y",
        lambda s: -4.848 * 20 * (s.block_degC - s.block_degC[0]) / 30,
        0.15,
        arcsec_xyz=[20.0, 0.0, 0.0],
    ),
}


@pytest.mark.parametrize("name", list(CASES))
def test_plain_formula(short, name):
    target, parameters, formula, apart = CASES[name]
    gyro, accel, _ = change(short, 0, planted(name, target, **parameters))
    found = (gyro if target.startswith("gyro") else accel)[:, "xyz".index(target[-1])]
    expected = formula(short.seen[0])
    parked = slice(20, 2900) if name == "platform_mount_sag" else slice(20, -20)
    largest = np.abs(expected[parked]).max()
    assert largest > 0
    np.testing.assert_allclose(found[parked], expected[parked], atol=(apart + 1e-5) * largest)


def test_yaw_creep_is_felt_by_the_vertical_gyro_alone(short):
    p = {"run": 0, "tau_s": 60.0, "arcsec_xyz": [0.0, 0.0, 30.0]}
    gyro, accel, _ = change(short, 0, planted("platform_yaw_creep", "vehicle", **p))
    crept = np.cumsum(gyro[:2900], axis=0)[-1] * short.seen[0].dt_s * DEG_PER_HOUR / ARCSEC
    assert crept[2] == pytest.approx(30.0, rel=0.01) and np.abs(crept[:2]).max() < 1.0
    # 30 arcsec about a vertical that is up to 1 deg askew: 2.5 micro-g
    assert np.abs(accel[:2900]).max() < 10.0


def test_a_larger_wheel_reads_in_proportion(short):
    run = change(short, 0, planted("odometer_scale", "odometer", scale=0.01))[2]
    speed = short.seen[0].speed_m_s[short.seen[0].nearest(run.odometer.time_s)]
    more = run.odometer.speed_m_s - short.runs_without[0].odometer.speed_m_s
    np.testing.assert_allclose(more, 0.01 * speed, atol=0.13 * 0.01 * speed.max())
    assert not more[speed == 0].any()


def test_pulses_of_the_wheel_lose_no_way(short):
    run = change(short, 0, planted("odometer_quantization", "odometer", pulse_m=0.03))[2]
    pulses = run.odometer.speed_m_s * 0.1 / 0.03
    np.testing.assert_allclose(pulses, np.round(pulses), atol=1e-6)
    lost_m = np.cumsum(short.runs_without[0].odometer.speed_m_s - run.odometer.speed_m_s) * 0.1
    assert lost_m.min() > -1e-9 and lost_m.max() < 0.0301


@pytest.mark.parametrize(
    "name, key, per_row",
    [
        ("gyro_angle_random_walk", "deg_sqrt_h", 60.0 * np.sqrt(10.0)),
        ("accel_noise", "ug_sqrt_hz", np.sqrt(10.0)),
    ],
)
def test_more_white_noise_has_its_density(short, name, key, per_row):
    """A density N gives rows over 0.1 s a sigma of N sqrt(10); 1 deg/sqrt(h) is 60
    deg/h/sqrt(Hz).
    """
    gyro, accel, _ = change(
        short, 0, planted(name, "gyro_x" if "gyro" in name else "accel_x", seed=1, **{key: 2.0})
    )
    rows = (gyro if "gyro" in name else accel)[:, 0]
    assert np.std(rows) == pytest.approx(2.0 * per_row, rel=0.04)


def test_noise_that_grows_with_the_rate_of_temperature(short):
    p = {"growth": 0.5, "with": "rate", "seed": 3}
    gyro, _, _ = change(short, 0, planted("gyro_noise_thermal", "gyro_x", **p))
    seen = short.seen[0]
    declared = seen.twin.gyro.arw_deg_sqrt_h * 60.0 * np.sqrt(10.0)
    rows = slice(1000, 3000)
    more = np.sqrt((1 + 0.5 * np.abs(rate_degC_min(seen)[rows])) ** 2 - 1)
    assert np.std(gyro[rows, 0] / (declared * more)) == pytest.approx(1.0, rel=0.07)
