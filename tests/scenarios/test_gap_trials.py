"""The blind trials: same seed same trial, noise as declared, each effect with the sign and shape of its physics."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

from benchmarks.gap_trials import outside, runs
from benchmarks.gap_trials.__main__ import write_trial
from benchmarks.gap_trials.effects import EFFECTS
from benchmarks.gap_trials.seen import turned_back
from benchmarks.gap_trials.trial import Base, Planted, draw_noise_trial, draw_trial, lay_over
from infield.table_file import table_from_dict
from ins.earth import gravity_magnitude, omega_ie_n
from ins.records import InputError
from ins.twin_file import read_twin
from ins.units import ARCSEC, DEG_PER_HOUR, MICRO_G
from trajectories.run import read_run

SHORT_S = 300.0
SOURCES = ("trajectories", "pyins")


@pytest.fixture(scope="module", params=SOURCES)
def short(request):
    """Four short runs with a taxi and no effect."""
    return draw_trial(7, effects=0, source=request.param, parked_s=SHORT_S)


@pytest.fixture(scope="module", params=SOURCES)
def parked(request):
    return draw_trial(11, plan="four_parked", effects=0, source=request.param)


def planted(name, target, size=1.0, **parameters):
    return Planted(effect=name, target=target, parameters=parameters, size=size, answers=(name,), targets=(target,))


def change(trial, number, *effects):
    """Run `number` with effects minus without: gyro [deg/h], accel [micro-g] (n, 3), and the run."""
    seen, plain = trial.seen[number], trial.runs_without[number]
    run = lay_over(Base(plain, seen), effects)
    gyro = (run.imu.dtheta_rad - plain.imu.dtheta_rad) / seen.dt_s / DEG_PER_HOUR
    accel = (run.imu.dv_m_s - plain.imu.dv_m_s) / seen.dt_s / MICRO_G
    return gyro, accel, run


def residuals(trial, number):
    """Parked rows less Earth rate, gravity and the table: gyro [deg/h], accel [micro-g], (n, 3)."""
    seen, run = trial.seen[number], trial.runs_without[number]
    parked = seen.time_s <= seen.taxi_s - 1.0
    earth_b = turned_back(seen.C_nb, omega_ie_n(seen.lat_rad))
    table = np.stack([
        np.interp(seen.gyro_degC[:, k], trial.table["axes"][a]["temperature_degC"], trial.table["axes"][a]["bias_deg_h"])
        for k, a in enumerate("xyz")
    ], axis=-1)  # fmt: skip
    gyro = (run.imu.dtheta_rad / seen.dt_s - earth_b) / DEG_PER_HOUR - table
    down = np.array([0.0, 0.0, -1.0]) * gravity_magnitude(seen.lat_rad, seen.height_m)[:, None]
    accel = (run.imu.dv_m_s / seen.dt_s - turned_back(seen.C_nb, down)) / MICRO_G
    return gyro[parked], accel[parked]


def allan_variance(rows, count):
    """Of means over `count` rows, not overlapping; (axes,), and how many differences went in."""
    means = rows[: len(rows) // count * count].reshape(-1, count, rows.shape[1]).mean(axis=1)
    return 0.5 * np.mean(np.diff(means, axis=0) ** 2, axis=0), len(means) - 1


def test_the_same_seed_makes_the_same_trial():
    first, again, other = (draw_trial(seed, parked_s=SHORT_S) for seed in (3, 3, 4))
    assert [r.sha256 for r in first.runs] == [r.sha256 for r in again.runs]
    assert first.truth == again.truth
    assert {r.sha256 for r in first.runs_without}.isdisjoint(r.sha256 for r in other.runs_without)


def test_noise_does_not_depend_on_the_effect():
    """Runs without are the same whatever is planted."""
    a, b = (draw_trial(5, names=[name], parked_s=SHORT_S) for name in ("gyro_rate_ramp", "platform_sway"))
    assert [r.sha256 for r in a.runs_without] == [r.sha256 for r in b.runs_without]
    assert a.truth[0].effect == "gyro_rate_ramp" and b.truth[0].effect == "platform_sway"


@pytest.mark.parametrize("name", [name for name, effect in EFFECTS.items() if effect.linear])
def test_effects_are_linear_in_their_size(short, name):
    effect = EFFECTS[name]
    parameters = effect.draw(np.random.default_rng(2), short.seen)
    number = parameters.get("run", 0)
    one, three = (
        change(short, number, planted(name, effect.targets[0], size, **parameters)) for size in (1.0, 3.0)
    )  # fmt: skip
    touched = False
    for a, b in zip(one[:2], three[:2]):
        np.testing.assert_allclose(b, 3 * a, rtol=1e-6, atol=1e-4)  # atol: the rounding of 9.8 m/s^2 in rows, in micro-g
        touched |= bool(np.abs(a).max() > 0)
    plain = short.runs_without[number]
    speeds = [run.odometer.speed_m_s - plain.odometer.speed_m_s for run in (one[2], three[2])]
    latitudes = [run.header.site.lat_rad - plain.header.site.lat_rad for run in (one[2], three[2])]
    np.testing.assert_allclose(speeds[1], 3 * speeds[0], atol=1e-12)
    assert latitudes[1] == pytest.approx(3 * latitudes[0], abs=1e-12)
    assert touched or np.any(speeds[0]) or latitudes[0]


@pytest.mark.parametrize("name", list(EFFECTS))
def test_size_zero_is_the_run_without(short, name):
    effect = EFFECTS[name]
    parameters = effect.draw(np.random.default_rng(2), short.seen)
    number = parameters.get("run", 0)
    _, _, run = change(short, number, planted(name, effect.targets[0], 0.0, **parameters))
    plain = short.runs_without[number]
    assert np.array_equal(run.imu.dtheta_rad, plain.imu.dtheta_rad)
    np.testing.assert_allclose(run.imu.dv_m_s, plain.imu.dv_m_s, atol=1e-15)
    assert np.array_equal(run.odometer.speed_m_s, plain.odometer.speed_m_s)
    np.testing.assert_allclose(run.gnss.v_n_m_s, plain.gnss.v_n_m_s, atol=1e-12)
    assert np.array_equal(run.temperature.gyro_degC, plain.temperature.gyro_degC)


def test_with_sizes_keeps_noise_and_draws():
    trial = draw_trial(21, names=["gyro_thermal_linear"], parked_s=SHORT_S)
    double = trial.with_sizes([2.0])
    axis = "xyz".index(trial.truth[0].target[-1])
    once, twice = (t.runs[0].imu.dtheta_rad - t.runs_without[0].imu.dtheta_rad for t in (trial, double))
    np.testing.assert_allclose(twice, 2 * once, atol=1e-16)
    assert np.abs(once[:, axis]).max() > 0
    assert double.truth[0].parameters == trial.truth[0].parameters
    with pytest.raises(InputError, match="2 sizes, needed 1"):
        trial.with_sizes([1.0, 2.0])


def test_parked_gyros_have_the_declared_noise(parked):
    """Allan variance N^2 / tau at 1 and 10 s (flicker adds 0.1 %), slope -1/2 of the deviation, on x and y.

    On z the creep of the heading adds its own walk of angle: 0.00083 to 0.002 deg/sqrt(h).
    """
    gyro = [residuals(parked, k)[0] for k in range(4)]
    angle_walks = np.array([parked.twin.gyro.arw_deg_sqrt_h, parked.twin.vehicle.yaw_creep_arcsec_sqrt_h / 3600.0])
    per_hour = np.sqrt(angle_walks[0] ** 2 + np.array([0, 0, 1]) * angle_walks[1] ** 2) * 60.0
    found = {}
    for count, tau_s in ((10, 1.0), (100, 10.0)):
        values, numbers = zip(*(allan_variance(rows, count) for rows in gyro))
        found[count] = np.mean(values, axis=0)
        expected = per_hour**2 / tau_s + 2 * np.log(2) / np.pi * parked.twin.gyro.bias_instability_deg_h**2
        spread = np.sqrt(3.0 / sum(numbers))  # relative, non-overlapping Allan variance of white noise
        assert found[count] == pytest.approx(expected, rel=4 * spread)
    assert np.log10(found[100] / found[10]) / 2 == pytest.approx([-0.5] * 3, abs=0.04)
    means = np.array([rows.mean(axis=0) for rows in gyro])
    assert np.abs(means).max() < 5 * 0.006  # turn-on 0.003, flicker and walk: no table error left


def test_parked_accelerometers_have_the_declared_noise(parked):
    """z: white; x and y: sway of an oscillator, increments of variance 2 rms^2 (1 - rho(dt)), and white."""
    accel = [residuals(parked, k)[1] for k in range(4)]
    seen, twin = parked.seen[0], parked.twin
    white = twin.accel.vrw_ug_sqrt_hz**2 / seen.dt_s
    w, z = 2 * np.pi * twin.vehicle.sway_hz, twin.vehicle.sway_damping
    wd = w * np.sqrt(1 - z**2)
    rho = np.exp(-z * w * seen.dt_s) * (np.cos(wd * seen.dt_s) - z * w / wd * np.sin(wd * seen.dt_s))
    sway = 2 * twin.vehicle.sway_m_s**2 * (1 - rho) / (seen.dt_s * MICRO_G) ** 2
    variance = np.mean([rows[1:].var(axis=0) for rows in accel], axis=0)
    assert variance[2] == pytest.approx(white, rel=0.03)
    assert variance[:2] == pytest.approx(white + sway, rel=0.05)
    slow = np.mean([allan_variance(rows, 100)[0] for rows in accel], axis=0)
    assert slow[2] == pytest.approx(twin.accel.vrw_ug_sqrt_hz**2 / 10.0, rel=0.2)


def test_pyins_and_trajectories_agree_on_a_parked_unit():
    """Two authors' increments of one attitude: 1e-6 deg/h, 0.3 micro-g (pyins has gravity to first order in height)."""
    path = outside.ideal_path(90.0, 1, SHORT_S, False)
    earth_b = turned_back(path.C_nb, omega_ie_n(path.lat_rad)) * outside.DT_S
    down_b = turned_back(path.C_nb, np.array([0.0, 0.0, 1.0]) * gravity_magnitude(path.lat_rad, path.height_m)[:, None])
    assert np.mean(path.dtheta_rad - earth_b, axis=0) / outside.DT_S / DEG_PER_HOUR == pytest.approx(np.zeros(3), abs=1e-6)
    assert np.mean(path.dv_m_s + down_b * outside.DT_S, axis=0) / outside.DT_S / MICRO_G == pytest.approx(np.zeros(3), abs=0.3)


def test_taxis_turn_both_ways_stop_and_brake(short):
    for seen in short.seen:
        rolling = seen.time_s > seen.taxi_s
        turn = seen.omega_nb_b[rolling, 2]
        assert turn.max() > 0.08 and turn.min() < -0.08
        assert 7.0 <= seen.speed_m_s.max() <= 12.5
        assert seen.acceleration_m_s2[rolling].min() < -0.4
        stopped = np.abs(seen.speed_m_s[rolling]) < 1e-6
        spans = np.diff(np.flatnonzero(np.diff(np.concatenate([[0], stopped.astype(int), [0]]))))[::2]
        assert np.sum(spans * seen.dt_s >= 59.5) >= 3
        assert 7.0 <= (seen.time_s[-1] - seen.taxi_s) / 60.0 <= 12.0


def test_a_temperature_slope_follows_the_true_temperature(short):
    gyro, _, _ = change(short, 0, planted("gyro_thermal_linear", "gyro_y", coefficient_deg_h_degC=0.002))
    off = short.seen[0].gyro_degC[:, 1] - 20.0
    np.testing.assert_allclose(gyro[:, 1], 0.002 * off, rtol=0.04, atol=1e-9)
    assert not gyro[:, [0, 2]].any()


def test_a_rate_term_changes_sign_with_cooling(short):
    p = {"coefficient_deg_h_min_degC": 0.03, "shell_s": 30.0}
    warm, cool = (change(short, k, planted("gyro_thermal_rate", "gyro_x", **p))[0][2000:2900, 0] for k in (0, 3))
    assert warm.min() > 0 > cool.max()


def test_hysteresis_splits_heating_from_cooling(parked):
    p = {"half_split_deg_h": 0.005, "width_degC": 2.0}
    warm, cool = (change(parked, k, planted("gyro_thermal_hysteresis", "gyro_x", **p))[0][:, 0] for k in (0, 3))
    assert warm[-1] == pytest.approx(-0.005, rel=1e-3) and cool[-1] == pytest.approx(0.005, rel=1e-3)
    assert abs(warm[0]) < 1e-3


def test_a_step_comes_once_and_stays(short):
    p = {"step_deg_h": 0.02, "run": 2, "onset_s": 150.0}
    assert not change(short, 1, planted("gyro_bias_step", "gyro_z", **p))[0].any()
    gyro, _, _ = change(short, 2, planted("gyro_bias_step", "gyro_z", **p))
    assert np.abs(gyro[:1300, 2]).max() < 1e-9 and np.abs(gyro[1700:, 2] - 0.02).max() < 1e-9


def test_settling_turns_gyros_and_accelerometers_together(short):
    """1 arcsec is 4.848 micro-g: a roll q_x gives f_y = -g q_x, a pitch q_y gives f_x = g q_y."""
    p = {"run": 0, "tau_s": 60.0, "arcsec_xyz": [30.0, 50.0, 0.0]}
    gyro, accel, _ = change(short, 0, planted("platform_settling", "vehicle", **p))
    turned = np.cumsum(gyro, axis=0)[2900] * short.seen[0].dt_s * DEG_PER_HOUR / ARCSEC
    assert turned[:2] == pytest.approx([30.0, 50.0], rel=0.03)  # Earth rate seen askew: 1 arcsec in 300 s
    assert accel[2900, 0] == pytest.approx(4.848 * turned[1], rel=0.03)
    assert accel[2900, 1] == pytest.approx(-4.848 * turned[0], rel=0.03)


def test_an_arm_swings_the_unit_and_its_fixes(short):
    """P at (1.5, 0.4, 0) from the IMU: v = -w x arm, in the fixes and as the integral of the specific force."""
    seen = short.seen[1]
    arm = np.array([1.5, 0.4, 0.0])
    _, accel, run = change(short, 1, planted("lever_arm", "vehicle", arm_m=arm.tolist()))
    swing_b = -np.cross(seen.omega_nb_b, arm)
    rows = seen.nearest(run.gnss.time_s)
    fixes_b = turned_back(seen.C_nb[rows], run.gnss.v_n_m_s - short.runs_without[1].gnss.v_n_m_s)
    assert np.abs(fixes_b).max() > 0.1
    np.testing.assert_allclose(fixes_b, swing_b[rows], atol=0.01)
    felt_n = np.cumsum(np.einsum("nij,nj->ni", seen.C_nb, accel * MICRO_G * seen.dt_s), axis=0)
    np.testing.assert_allclose(turned_back(seen.C_nb, felt_n), swing_b, atol=0.02)


def test_tyres_drift_out_of_a_turn(short):
    seen = short.seen[0]
    _, _, run = change(short, 0, planted("side_slip", "vehicle", deg_s2_m=0.4, wind_rad=0.0))
    rows = seen.nearest(run.gnss.time_s)
    slip_b = turned_back(seen.C_nb[rows], run.gnss.v_n_m_s - short.runs_without[0].gnss.v_n_m_s)[:, 1]
    right = seen.omega_nb_b[rows, 2] > 0.08
    left = seen.omega_nb_b[rows, 2] < -0.08
    assert slip_b[right].mean() < -0.005 and slip_b[left].mean() > 0.005


def test_a_late_odometer_reads_low_in_acceleration(short):
    seen = short.seen[0]
    run = change(short, 0, planted("odometer_time_offset", "odometer", late_s=0.1))[2]
    more = run.odometer.speed_m_s - short.runs_without[0].odometer.speed_m_s
    np.testing.assert_allclose(more, -0.1 * seen.acceleration_m_s2[seen.nearest(run.odometer.time_s)], atol=0.01)
    assert more.min() < -0.03


def test_the_field_of_the_earth_turns_with_the_heading(parked):
    p = {"deg_h_gauss": 0.01, "direction": [1.0, 0.0, 0.0]}
    north, south = (change(parked, k, planted("gyro_magnetic_sensitivity", "gyro_z", **p))[0][0, 2] for k in (0, 2))
    assert north > 0.001 and south < -0.001


def test_a_table_subtracted_twice(short):
    gyro, _, _ = change(short, 0, planted("compensation_misapplied", "gyro_x", coefficient=-1.0))
    curve = short.table["axes"]["x"]
    expected = -np.interp(short.seen[0].gyro_degC[:, 0], curve["temperature_degC"], curve["bias_deg_h"])
    np.testing.assert_allclose(gyro[:, 0], expected, atol=1e-9)


def test_quanta_are_whole_and_lose_nothing(short):
    run = change(short, 0, planted("gyro_quantization", "gyro_y", arcsec=0.5))[2]
    pulses = run.imu.dtheta_rad[:, 1] / (0.5 * ARCSEC)
    np.testing.assert_allclose(pulses, np.round(pulses), atol=1e-6)
    lost = np.cumsum(short.runs_without[0].imu.dtheta_rad[:, 1] - run.imu.dtheta_rad[:, 1])
    assert 0 <= lost.min() + 1e-12 and lost.max() < 0.5 * ARCSEC * 1.001


def test_a_wrong_thermometer_leaves_the_sensors_alone(short):
    gyro, accel, run = change(
        short, 0, planted("temperature_sensor_error", "temperature", kind="late", tau_s=300.0, offset_degC=0.0)
    )
    assert not gyro.any() and not accel.any()
    late = run.temperature.gyro_degC - short.runs_without[0].temperature.gyro_degC
    assert late[250:300].max() < 0  # a cold start: the reading stays behind


def test_a_wrong_site_is_in_the_header_only(short):
    gyro, accel, run = change(short, 0, planted("site_latitude_error", "site", arcmin=2.0))
    assert not gyro.any() and not accel.any()
    assert run.header.site.lat_rad - short.runs_without[0].header.site.lat_rad == pytest.approx(120.0 * ARCSEC)


@pytest.mark.parametrize("which_seed", range(3))
def test_noise_that_is_five_percent_off(which_seed):
    trial = draw_noise_trial(which_seed, plan="one_cold", parked_s=SHORT_S)
    truth = trial.truth[0].parameters
    key, axis = ("dv_m_s", 2) if truth["which"] == "accel" else ("dtheta_rad", 0)  # no sway, no yaw creep there
    spread = [np.std(np.diff(getattr(r[0].imu, key)[:2900, axis])) for r in (trial.runs, trial.runs_without)]
    assert spread[0] / spread[1] == pytest.approx(truth["factor"], rel=2e-3)
    with pytest.raises(InputError, match="no size"):
        trial.with_sizes([2.0])


def test_two_effects_hit_different_targets():
    for seed in range(4):
        a, b = draw_trial(seed, effects=2, parked_s=SHORT_S).truth
        assert a.target != b.target


def test_plans_plant_only_what_they_can_show():
    rng_names = {draw_trial(seed, plan="one_cold", parked_s=60.0).truth[0].effect for seed in range(25)}
    assert len(rng_names) > 8
    assert all(not EFFECTS[name].needs & {"taxi", "runs"} for name in rng_names)
    with pytest.raises(InputError, match="no effect left"):
        draw_trial(0, plan="one_cold", names=["lever_arm"], parked_s=60.0)


def test_files_of_a_trial_read_back(tmp_path):
    trial = draw_trial(2, plan="one_cold", names=["gyro_warmup_transient"], parked_s=60.0)
    write_trial(trial, tmp_path / "t")
    run = read_run(tmp_path / "t/blind/run-1")
    assert np.array_equal(run.imu.dtheta_rad, trial.runs[0].imu.dtheta_rad)
    assert np.array_equal(run.temperature.gyro_degC, trial.runs[0].temperature.gyro_degC)
    assert read_twin(tmp_path / "t/blind/twin.json").gyro == trial.twin.gyro
    table_from_dict(json.loads((tmp_path / "t/blind/table.json").read_text()), name="table.json")
    truth = json.loads((tmp_path / "t/truth.json").read_text())
    assert truth["planted"][0]["effect"] == "gyro_warmup_transient"
    blind = "".join(p.read_text() for p in (tmp_path / "t/blind").rglob("*.json"))
    assert "warmup" not in blind


def test_trials_never_import_the_diagnosis():
    for path in Path(runs.__file__).parent.glob("*.py"):
        assert not re.search(r"^\s*(from|import)\s+simreal", path.read_text(), re.MULTILINE), path.name
