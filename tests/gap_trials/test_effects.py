"""Each planted effect has the sign and shape of its physics, on cases worked out by hand."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.gap_trials import runs
from benchmarks.gap_trials.effects import EFFECTS, FORMS, effect_named, possible
from benchmarks.gap_trials.seen import streams_of, turned_back
from benchmarks.gap_trials.trial import draw_trial
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
