"""The forms that no catalogue shares, and noises: sign, size and spectrum, by hand."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.gap_trials import outside
from benchmarks.gap_trials.effects import FORMS
from benchmarks.gap_trials.runs import Plan
from benchmarks.gap_trials.seen import streams_of, turned_back
from ins.records import GyroNoise, VehicleNoise
from ins.units import ARCSEC, DEG_PER_HOUR, MICRO_G, MILLIRADIAN
from tests.gap_trials.cases import change, planted
from tests.gap_trials.test_effects import way_of_fixes

PER_ROW = np.sqrt(10.0)  # a density is spread over rows of 0.1 s


def of_temperature(short, degC):
    """The truth of the first run with all gyros at these temperatures (n,)."""
    return replace(short.seen[0], gyro_degC=np.repeat(degC[:, None], 3, axis=1))


def laid(short, name, seen, target="gyro_x", **parameters):
    """What a gyro reads more by a form [deg/h], (n,)."""
    plain = streams_of(short.runs_without[0])
    found = FORMS[name].lay(plain, seen, target, parameters, 1.0)
    return (found.dtheta_rad - plain.dtheta_rad)[:, 0] / seen.dt_s / DEG_PER_HOUR


def test_a_coil_behind_three_nodes_lags_a_ramp(short):
    """Housing - block x, housing - coil y in the steady state of a ramp R, by hand:
    x/h + (x - y)/c = R and (y - x)/c + y/l = R.
    """
    h, c, leak, ramp = 60.0, 30.0, 120.0, 0.01
    p = {"housing_s": h, "coil_s": c, "leak_s": leak, "coefficient_deg_h_degC": 0.02}
    found = laid(
        short, "three_node_network", of_temperature(short, 5.0 + ramp * short.seen[0].time_s), **p
    )
    A = [[1.0 / h + 1.0 / c, -1.0 / c], [-1.0 / c, 1.0 / c + 1.0 / leak]]
    _, behind = np.linalg.solve(A, [ramp, ramp])
    assert found[-20] == pytest.approx(-0.02 * behind, rel=0.03)  # steps of a second


def test_relays_split_heating_from_cooling(short):
    """Above the mean of both branches while it warms, below it while it cools."""
    time_s = short.seen[0].time_s
    degC = np.interp(time_s, [0.0, 0.5 * time_s[-1], time_s[-1]], [-10.0, 50.0, -10.0])
    p = {"width_degC": 4.0, "centre_degC": 20.0, "spread_degC": 20.0, "half_split_deg_h": 0.01}
    found = laid(short, "preisach_hysteresis", of_temperature(short, degC), **p)
    quarter = len(found) // 4
    heating, cooling = found[quarter], found[-quarter]
    assert heating > 0.005 and cooling == pytest.approx(-heating, rel=0.1)


def test_a_bead_in_grease_reads_a_ramp_late_by_its_time(short):
    plain = streams_of(short.runs_without[0])
    time_s, ramp = short.seen[0].time_s, 0.01
    seen = of_temperature(short, 5.0 + ramp * time_s)
    found = FORMS["slow_thermometer"].lay(plain, seen, "temperature", {"tau_s": 40.0}, 1.0)
    late = found.temperature.gyro_degC - plain.temperature.gyro_degC
    np.testing.assert_allclose(late[-50:-5], -ramp * 40.0, rtol=0.05)


def test_a_dead_zone_takes_from_a_slow_rate(short):
    """The mean over a Gaussian dither of w sqrt(1 - (lock / w)^2) - w, by a sum of its own."""
    lock, dither, rate = 4.0, 60.0, 30.0
    rates = np.full((short.seen[0].rows, 3), rate * DEG_PER_HOUR * short.seen[0].dt_s)
    seen = replace(short.seen[0], dtheta_rad=rates)
    found = laid(short, "dead_zone", seen, lock_deg_h=lock, dither_deg_h=dither)
    w = np.linspace(rate - 8 * dither, rate + 8 * dither, 400_001)
    output = np.sign(w) * np.sqrt(np.maximum(w**2 - lock**2, 0.0))
    weight = np.exp(-0.5 * ((w - rate) / dither) ** 2)
    expected = np.sum(weight * (output - w)) / np.sum(weight)
    assert expected < 0.0
    np.testing.assert_allclose(found, expected, rtol=0.03)


def test_fixes_that_a_wing_reflects_are_off_by_their_distance(short):
    plain = short.runs_without[0]
    p = {"metres": 3.0, "bearing_rad": 0.7}
    *_, run = change(short, 0, planted("fixes_by_heading", "gnss", **p))
    off = way_of_fixes(run, plain)
    bearing = short.seen[0].heading_rad[short.seen[0].nearest(plain.gnss.time_s)] + 0.7
    expected = 3.0 * np.column_stack([np.cos(bearing), np.sin(bearing), 0.0 * bearing])
    np.testing.assert_allclose(off, expected, atol=0.02)  # a sphere for the ellipsoid: 0.5 %


def test_a_machine_shakes_with_its_density(short):
    p = {"run": 0, "shares": [0.3, 0.5, 1.0], "ug_sqrt_hz": 20.0, "seed": 4}
    _, accel, _ = change(short, 0, planted("white_vibration", "vehicle", **p))
    np.testing.assert_allclose(
        np.std(accel, axis=0), 20.0 * PER_ROW * np.array(p["shares"]), rtol=0.05
    )


def test_a_slow_clock_makes_forces_larger_too(short):
    _, accel, _ = change(short, 0, planted("clock_rate", "gyro_z", ppm=30.0))
    force = short.seen[0].dv_m_s / short.seen[0].dt_s / MICRO_G
    np.testing.assert_allclose(accel, 30e-6 * force, atol=1e-3)


def test_a_walk_of_the_rate_grows_by_its_density(short):
    """1 deg/h/sqrt(h) is 1/60 deg/h/sqrt(s)."""
    p = {"deg_h_sqrt_h": 0.6, "seed": 5}
    gyro, *_ = change(short, 0, planted("gyro_rate_random_walk", "gyro_y", **p))
    assert np.std(np.diff(gyro[:, 1])) == pytest.approx(0.01 * np.sqrt(0.1), rel=0.05)


def test_a_markov_process_has_its_size_and_time(short):
    p = {"deg_h": 0.5, "tau_s": 1.0, "seed": 6}
    gyro, *_ = change(short, 0, planted("gyro_gauss_markov", "gyro_y", **p))
    rows = gyro[:, 1]
    assert np.std(rows) == pytest.approx(0.5, rel=0.15)
    assert np.corrcoef(rows[1:], rows[:-1])[0, 1] == pytest.approx(np.exp(-0.1), abs=0.03)


def test_a_table_subtracted_twice_takes_its_bias_off(short):
    gyro, *_ = change(short, 0, planted("compensation_misapplied", "gyro_z", coefficient=-1.0))
    seen = short.seen[0]
    curve = seen.table["axes"]["z"]
    bias = np.interp(seen.gyro_degC[:, 2], curve["temperature_degC"], curve["bias_deg_h"])
    np.testing.assert_allclose(gyro[:, 2], -bias, atol=1e-6)


def test_a_vehicle_of_the_second_source_crabs_and_turns_as_it_says(short):
    """Crab and parked yaw creep of a quiet unit: sideways -V tan(crab), and along the course that
    the creep has turned; wheels that read high, and fixes of a parked vehicle east and west.
    """
    vehicle = VehicleNoise(
        crab_mrad=20.0, lateral_noise_m_s=0.0, yaw_creep_arcsec_sqrt_h=20_000.0, sway_m_s=1e-9
    )
    gyro = GyroNoise(
        arw_deg_sqrt_h=0.0,
        bias_instability_deg_h=0.0,
        rate_random_walk_deg_h_sqrt_h=0.0,
        turn_on_deg_h=0.0,
    )
    gnss = replace(short.twin.gnss, sigma_velocity_m_s=0.0, sigma_horizontal_m=2.0)
    odometer = replace(short.twin.odometer, scale_ppm=5000.0, noise_m_s=0.0)
    twin = replace(short.twin, vehicle=vehicle, gyro=gyro, gnss=gnss, odometer=odometer)
    flat = {a: {"temperature_degC": [0.0, 40.0], "bias_deg_h": [0.0, 0.0]} for a in "xyz"}
    plan = Plan(starts=("cold",), headings_deg=(90.0,), taxi=True, parked_s=300.0)
    (base,) = outside.base_runs(3, plan, table={"axes": flat}, twin=twin)
    seen, run = base.seen, base.run
    yaw = np.sum((run.imu.dtheta_rad - seen.dtheta_rad)[: int(10 * seen.taxi_s), 2])
    assert abs(yaw) > 1000.0 * ARCSEC
    rows = seen.nearest(run.gnss.time_s)
    side = turned_back(seen.C_nb[rows], run.gnss.v_n_m_s - seen.v_n_m_s[rows])[:, 1]
    fast = seen.speed_m_s[rows] > 3.0
    angle = side[fast] / seen.speed_m_s[rows][fast]
    # stops turn it further: the first leg
    assert angle[0] == pytest.approx(yaw - np.tan(20.0 * MILLIRADIAN), abs=0.1 * abs(yaw))
    np.testing.assert_allclose(run.odometer.speed_m_s, 1.005 * seen.speed_m_s)
    parked = run.gnss.time_s < seen.taxi_s - 1.0
    east_m = run.gnss.lon_rad[parked] * np.cos(seen.lat_rad[0]) * 6.378e6
    assert np.std(east_m) == pytest.approx(2.0, rel=0.15)  # of 300: 4 %
