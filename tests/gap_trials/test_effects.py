"""Each planted effect has the sign and shape of its physics, on cases worked out by hand."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.gap_trials import runs
from benchmarks.gap_trials.effects import EFFECTS, FORMS, effect_named, possible
from benchmarks.gap_trials.seen import moved, streams_of, turned_back
from benchmarks.gap_trials.trial import draw_trial
from ins.earth import displacement_ned
from ins.errors.catalogue import catalogue
from ins.records import VehicleNoise
from ins.units import ARCSEC, DEG, DEG_PER_HOUR, MICRO_G
from tests.gap_trials.cases import SHORT_S, change, planted
from trajectories.simulator.thermal import STARTS
from trajectories.simulator.vehicle import disturb


def test_settling_turns_gyros_and_accelerometers_together(short):
    """1 arcsec is 4.848 micro-g: a roll q_x gives f_y = -g q_x, a pitch q_y gives f_x = g q_y."""
    p = {"run": 0, "tau_s": 60.0, "arcsec_xyz": [30.0, 50.0, 0.0]}
    gyro, accel, _ = change(short, 0, planted("platform_settling", "vehicle", **p))
    turned = np.cumsum(gyro, axis=0)[2900] * short.seen[0].dt_s * DEG_PER_HOUR / ARCSEC
    # Earth rate seen askew: 1 arcsec in 300 s
    assert turned[:2] == pytest.approx([30.0, 50.0], rel=0.03)
    assert accel[2900, 0] == pytest.approx(4.848 * turned[1], rel=0.03)
    assert accel[2900, 1] == pytest.approx(-4.848 * turned[0], rel=0.03)


def test_an_arm_swings_the_unit_and_its_fixes(short):
    """P at (1.5, 0.4, 0) from the IMU: v = -w x arm, in the fixes and as the integral of the
    specific force.
    """
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


def test_quanta_are_whole_and_lose_nothing(short):
    run = change(short, 0, planted("gyro_quantization", "gyro_y", arcsec=0.5))[2]
    pulses = run.imu.dtheta_rad[:, 1] / (0.5 * ARCSEC)
    np.testing.assert_allclose(pulses, np.round(pulses), atol=1e-6)
    lost = np.cumsum(short.runs_without[0].imu.dtheta_rad[:, 1] - run.imu.dtheta_rad[:, 1])
    assert 0 <= lost.min() + 1e-12 and lost.max() < 0.5 * ARCSEC * 1.001


def test_a_wrong_thermometer_leaves_the_sensors_alone(short):
    gyro, accel, run = change(
        short,
        0,
        planted(
            "temperature_sensor_error", "temperature", kind="late", tau_s=300.0, offset_degC=0.0
        ),
    )
    assert not gyro.any() and not accel.any()
    late = run.temperature.gyro_degC - short.runs_without[0].temperature.gyro_degC
    assert late[250:300].max() < 0  # a cold start: the reading stays behind


def test_a_wrong_site_is_in_the_header_only(short):
    gyro, accel, run = change(short, 0, planted("site_latitude_error", "site", arcmin=2.0))
    assert not gyro.any() and not accel.any()
    assert run.header.site.lat_rad - short.runs_without[0].header.site.lat_rad == pytest.approx(
        120.0 * ARCSEC
    )


def test_a_unit_set_askew_is_a_crab_of_the_vehicle():
    """Against trajectories.simulator.vehicle, which lays a crab over a run by its own formulas:
    0.02 of 700 micro-g.
    """
    ideal = runs.ideal_run(90.0, 1, SHORT_S, True)
    crab = VehicleNoise(
        crab_mrad=5.0, lateral_noise_m_s=0.0, yaw_creep_arcsec_sqrt_h=0.0, sway_m_s=0.0
    )
    theirs = disturb(ideal, crab, (), np.random.default_rng(0))
    trial = draw_trial(1, effects=0, parked_s=SHORT_S)
    seen = runs.seen_of(ideal, STARTS["cold"], number=0, of=1, twin=trial.twin, table=trial.table)
    bare = streams_of(trial.runs_without[0])
    bare = replace(bare, dtheta_rad=ideal.dtheta_rad, dv_m_s=ideal.dv_m_s, gnss=None)
    ours = EFFECTS["odometer_boresight"].lay(
        bare, seen, "vehicle", {"yaw_deg": -5e-3 / DEG, "pitch_deg": 0.0}, 1.0
    )
    assert np.abs(theirs.dv_m_s - ideal.dv_m_s).max() > 500 * MICRO_G * seen.dt_s
    assert np.abs(ours.dv_m_s - theirs.dv_m_s).max() < 0.02 * MICRO_G * seen.dt_s
    assert np.abs(ours.dtheta_rad - theirs.dtheta_rad).max() < 1e-4 * DEG_PER_HOUR * seen.dt_s


def way_of_fixes(run, plain):
    """North, east, down from the fixes of one run to those of another [m], (n, 3)."""
    now, log = run.gnss, plain.gnss
    level = displacement_ned(
        now.lat_rad, now.lon_rad, lat0_rad=log.lat_rad, lon0_rad=log.lon_rad, height0_m=log.height_m
    )
    return np.column_stack([level, log.height_m - now.height_m])


def test_fixes_go_the_way_of_a_vehicle_that_is_moved(short):
    seen, plain = short.seen[0], short.runs_without[0]
    v_n = np.array([1.0, 2.0, -0.5])
    dv_n = np.tile(v_n, (seen.rows, 1))
    run = replace(plain, gnss=moved(streams_of(plain), seen, dv_n).gnss)
    # the velocity begins in the middle of the first row
    way_n = np.outer(plain.gnss.time_s - 0.5 * seen.dt_s, v_n)
    np.testing.assert_allclose(way_of_fixes(run, plain), way_n, rtol=1e-3, atol=0.06)
    np.testing.assert_allclose(run.gnss.v_n_m_s - plain.gnss.v_n_m_s, dv_n[: len(way_n)])


def taxi_rows(seen, log):
    """Rows of a stream while the vehicle rolls, and those of the truth nearest to them."""
    rows = seen.nearest(log.time_s)
    rolling = np.abs(seen.speed_m_s[rows]) > 1.0
    return rolling, rows[rolling]


def test_an_antenna_elsewhere_shifts_and_swings_the_fixes(short):
    """At (1.5, 0.4, 0): C_nb arm, and its velocity w x arm."""
    seen, plain = short.seen[1], short.runs_without[1]
    arm = np.array([1.5, 0.4, 0.0])
    p = {"kind": "arm", "arm_m": arm.tolist()}
    *_, run = change(short, 1, planted("gnss_lever_arm_or_latency", "gnss", **p))
    rows = seen.nearest(plain.gnss.time_s)
    way_b = turned_back(seen.C_nb[rows], way_of_fixes(run, plain))
    np.testing.assert_allclose(way_b, np.tile(arm, (len(rows), 1)), atol=1e-3)
    swing_b = turned_back(seen.C_nb[rows], run.gnss.v_n_m_s - plain.gnss.v_n_m_s)
    np.testing.assert_allclose(swing_b, np.cross(seen.omega_nb_b[rows], arm), atol=0.01)
    assert np.abs(swing_b).max() > 0.1


def test_a_late_fix_is_where_and_as_fast_as_the_vehicle_was(short):
    seen, plain = short.seen[0], short.runs_without[0]
    late = {"kind": "latency", "late_s": 0.2}
    *_, run = change(short, 0, planted("gnss_lever_arm_or_latency", "gnss", **late))
    rolling, rows = taxi_rows(seen, plain.gnss)
    before = seen.v_n_m_s[rows - 2]  # of 0.1 s each
    change_n = (run.gnss.v_n_m_s - plain.gnss.v_n_m_s)[rolling]
    np.testing.assert_allclose(change_n, before - seen.v_n_m_s[rows], atol=1e-9)
    assert np.abs(change_n).max() > 0.1
    way_n = way_of_fixes(run, plain)[rolling]
    np.testing.assert_allclose(way_n, -0.1 * (before + seen.v_n_m_s[rows]), atol=2e-3)


def test_a_late_odometer_reads_the_speed_of_before(short):
    seen, plain = short.seen[0], short.runs_without[0].odometer
    run = change(short, 0, planted("odometer_time_offset", "odometer", late_s=0.1))[2]
    rows = np.maximum(seen.nearest(plain.time_s), 1)
    more = run.odometer.speed_m_s - plain.speed_m_s
    before = seen.speed_m_s[rows - 1] - seen.speed_m_s[rows]
    np.testing.assert_allclose(more[1:], before[1:], atol=1e-9)
    assert np.abs(more).max() > 0.05


def test_a_wheel_slips_with_thrust_and_brakes(short):
    """It turns faster under thrust, slower under braking: c a V, a fifth less under thrust."""
    seen, plain = short.seen[0], short.runs_without[0].odometer
    run = change(short, 0, planted("wheel_slip", "odometer", slip_s2_m=0.015))[2]
    rows = seen.nearest(plain.time_s)
    pull, more = seen.acceleration_m_s2[rows], run.odometer.speed_m_s - plain.speed_m_s
    slip = 0.015 * pull * seen.speed_m_s[rows]
    np.testing.assert_allclose(more[pull < 0], slip[pull < 0], atol=1e-9)
    np.testing.assert_allclose(more[pull > 0], 0.8 * slip[pull > 0], atol=1e-9)
    assert more.min() < -0.02 and more.max() > 0.02


@pytest.mark.parametrize("name", ["side_slip", "tyre_cornering"])
def test_in_a_right_turn_tyres_let_the_vehicle_drift_left(short, name):
    """The lateral velocity is against the turn, V c a; tyres of finite grip slip more, up to 2.5
    times at 0.6 of it.
    """
    seen, plain = short.seen[1], short.runs_without[1]
    p = {"deg_s2_m": 0.4, "wind_rad": 0.0, "grip_m_s2": 4.0, "road_m": 1.0}
    *_, run = change(short, 1, planted(name, "vehicle", **p))
    rolling, rows = taxi_rows(seen, plain.gnss)
    drift_n = (run.gnss.v_n_m_s - plain.gnss.v_n_m_s)[rolling]
    lateral = turned_back(seen.C_nb[rows], drift_n)[:, 1]
    expected = -(seen.speed_m_s[rows] ** 2) * seen.omega_at_ends[rows, 2]
    turning = np.abs(seen.omega_at_ends[rows, 2]) > 0.05
    assert np.corrcoef(lateral[turning], expected[turning])[0, 1] > 0.9
    times = np.abs(lateral[turning]).max() / (0.4 * DEG * np.abs(expected[turning]).max())
    assert 0.8 < times < 2.5


def test_a_unit_pitched_askew_rolls_off_its_axis_downward(short):
    """Pitch of 0.5 deg: at V the unit moves along its own z by V times that."""
    seen, plain = short.seen[0], short.runs_without[0]
    p = {"yaw_deg": 0.0, "pitch_deg": 0.5}
    *_, run = change(short, 0, planted("odometer_boresight", "vehicle", **p))
    rolling, rows = taxi_rows(seen, plain.gnss)
    off_n = (run.gnss.v_n_m_s - plain.gnss.v_n_m_s)[rolling]
    off_b = turned_back(seen.C_nb[rows], off_n)
    np.testing.assert_allclose(off_b[:, 2], 0.5 * DEG * seen.speed_m_s[rows], rtol=1e-6)


def test_stronger_gravity_is_felt_upward(short):
    """30 mGal more: an accelerometer at rest reads -g down, 30.6 micro-g more of it."""
    p = {"arcsec_north_east": [0.0, 0.0], "anomaly_mgal": 30.0}
    gyro, accel, _ = change(short, 0, planted("vertical_deflection", "site", **p))
    assert not gyro.any()
    np.testing.assert_allclose(accel[:, 2], -30e-5 / 9.80665 * 1e6, rtol=1e-3)


def test_the_field_points_east_of_north_and_down(short):
    """0.222 Gauss horizontally, 3 deg east of north, 0.42 down."""
    seen, field_b = short.seen[1], np.empty((short.seen[1].rows, 3))
    for k, row in enumerate(np.eye(3)):
        p = {"deg_h_gauss": 1.0, "direction": list(row)}
        field_b[:, k] = change(short, 1, planted("gyro_magnetic_sensitivity", "gyro_x", **p))[0][
            :, 0
        ]
    north, east, down = np.einsum("nij,nj->ni", seen.C_nb, field_b).T
    np.testing.assert_allclose(np.arctan2(east, north) / DEG, 3.0, atol=1e-3)
    np.testing.assert_allclose(np.hypot(east, north), 0.222, atol=1e-5)
    np.testing.assert_allclose(down, 0.42, atol=1e-5)


def test_an_engine_shifts_the_sensors_from_its_start_on(short):
    p = {
        "run": 0,
        "onset_s": 100.0,
        "gyro_deg_h": [0.002, 0.0, -0.004],
        "accel_ug": [15.0, -30.0, 0.0],
        "gyro_deg_sqrt_h": 0.0,
        "accel_ug_sqrt_hz": 0.0,
        "seed": 1,
    }
    gyro, accel, _ = change(short, 0, planted("engine_start", "vehicle", **p))
    assert np.abs(gyro[:500]).max() < 1e-5 and np.abs(accel[:500]).max() < 1e-2
    np.testing.assert_allclose(gyro[1500], p["gyro_deg_h"], atol=1e-5)
    np.testing.assert_allclose(accel[1500], p["accel_ug"], atol=1e-2)
    noise = {"gyro_deg_sqrt_h": 0.0015, "accel_ug_sqrt_hz": 60.0}
    still = {"gyro_deg_h": [0.0] * 3, "accel_ug": [0.0] * 3}
    gyro, accel, _ = change(short, 0, planted("engine_start", "vehicle", **{**p, **still, **noise}))
    # rows of 0.1 s; 1 deg/sqrt(h) is 60 deg/h/sqrt(Hz)
    assert np.std(gyro[1500:2900]) == pytest.approx(0.0015 * 60.0 * np.sqrt(10.0), rel=0.05)
    assert np.std(accel[1500:2900]) == pytest.approx(60.0 * np.sqrt(10.0), rel=0.05)


@pytest.mark.parametrize("kind, key", [("to and fro", "accel"), ("rocking", "gyro")])
def test_sway_has_its_size(short, kind, key):
    """To and fro: fixes move with that RMS. Rocking: gyros turn, and f is g times it."""
    rms = 0.01 if kind == "to and fro" else 50.0 * ARCSEC
    p = {"kind": kind, "rms": rms, "hz": 0.3, "damping": 0.2, "seed": 5}
    gyro, accel, run = change(short, 0, planted("platform_sway", "vehicle", **p))
    dt = short.seen[0].dt_s
    if key == "accel":
        assert np.std(
            run.gnss.v_n_m_s[:, 0] - short.runs_without[0].gnss.v_n_m_s[:, 0]
        ) == pytest.approx(rms, rel=0.15)
        assert np.abs(gyro).max() < 0.01
        return
    roll = np.cumsum(gyro[:2900, 0]) * dt * DEG_PER_HOUR
    assert np.std(roll) == pytest.approx(rms, rel=0.2)
    middle = roll - 0.5 * np.diff(roll, prepend=0.0)
    assert np.corrcoef(accel[:2900, 1], -middle)[0, 1] > 0.99


def test_other_forms_are_planted_by_name_only_and_answered_by_the_catalogue():
    assert not FORMS.keys() & EFFECTS.keys()
    everything = frozenset({"taxi", "gnss", "odometer", "runs"})
    assert not {e.name for e in possible(everything)} & FORMS.keys()
    names = {e.name for e in catalogue()} | {"unknown"}  # a cause without a name is an answer too
    for name in FORMS:
        effect = effect_named(name)
        assert {*effect.right_answers, *effect.confounded} <= names
