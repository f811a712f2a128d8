"""The motion estimated from a run's own sensors against the simulator's truth, which it never sees."""

from dataclasses import replace

import numpy as np
import pytest

from ins.attitude import wrap_pi
from ins.earth import dcm_en, displacement_ned, geodetic_from_ecef
from ins.records import ImuLog, InputError
from simreal.run_motion import estimate_motion
from tests.simreal.runs import PARKED, PARKED_S, TAXI, simulated, table, twin_of

HEADING_BOUND_RAD = 3e-3
TILT_BOUND_RAD = 2e-4  # 30 micro-g of turn-on is 3e-5 rad
SPEED_BOUND_M_S = 0.03
LATERAL_BOUND_M_S = 0.1  # 5 sigmas of the side noise, which is not part of the motion


def estimated(sim, run=None, technology="rlg"):
    return estimate_motion(run or sim.run, table(technology), twin_of(technology))


def errors(sim, motion, *, from_s=1.0):
    """Heading, tilt [rad], horizontal place [m], forward speed and velocity [m/s]: estimated less true."""
    ref = sim.reference
    point = motion.truth.kinematics(ref.time_s - motion.origin_s)
    lat, lon, _ = geodetic_from_ecef(point.r_e)
    place = displacement_ned(lat, lon, lat0_rad=ref.lat_rad, lon0_rad=ref.lon_rad, height0_m=ref.height_m)[:, :2]
    v_n = np.einsum("nji,nj->ni", dcm_en(lat, lon), point.v_e)[:, :2]
    tilt = point.euler_rad[:, :2] - np.column_stack([ref.roll_rad, ref.pitch_rad])
    true_speed = np.linalg.norm(ref.v_n_m_s[:, :2], axis=1)
    return {
        "heading": wrap_pi(point.euler_rad[:, 2] - ref.heading_rad), "tilt": tilt, "place": place,
        "speed": np.linalg.norm(v_n, axis=1) - true_speed, "velocity": v_n - ref.v_n_m_s[:, :2],
    }  # fmt: skip


@pytest.mark.parametrize(("heading_deg", "aids"), [(37.0, False), (200.0, True), (359.9, False)])
def test_taxi_against_truth(heading_deg, aids):
    sim = simulated(2, TAXI, heading_deg, aids=aids)
    motion = estimated(sim)
    found = errors(sim, motion)
    assert motion.heading_known and motion.heading_source == "gyrocompass"
    assert np.abs(found["heading"]).max() < HEADING_BOUND_RAD
    assert np.abs(found["tilt"]).max() < TILT_BOUND_RAD
    assert np.abs(found["place"]).max() < 4.0  # 1 mrad of heading over 800 m, and side noise
    assert np.abs(found["speed"]).max() < SPEED_BOUND_M_S
    assert np.abs(found["velocity"]).max() < LATERAL_BOUND_M_S


def test_stands_are_found_and_constant():
    motion = estimated(simulated())
    assert len(motion.stands) == 3
    assert motion.stands[0][1] == pytest.approx(PARKED_S, abs=12.0)
    for start_s, end_s in motion.stands:
        point = motion.truth.kinematics(np.linspace(start_s + 0.1, end_s - 0.1, 50) - motion.origin_s)
        assert np.ptp(point.r_e, axis=0).max() == 0.0 and np.ptp(point.euler_rad, axis=0).max() == 0.0
        assert not point.v_e.any()


def test_sigma_of_the_heading_is_honest():
    """Ten parked units: the errors are as large as their sigma says (chi-square, 10 dof, 0.1 % on either side)."""
    total = 0.0
    for seed in range(10):
        sim = simulated(seed, PARKED)
        motion = estimated(sim)
        total += (errors(sim, motion)["heading"][100] / motion.sigma_heading_rad) ** 2
    assert total < 29.6  # the prior leaves room for an effect still to be found, so the lower side is not tested


def test_noise_does_not_go_into_a_straight_leg():
    """Side noise and sway are the twin's: on a leg without turns the estimated way is straight."""
    sim = simulated()
    motion = estimated(sim)
    t = np.arange(motion.stands[0][1] + 60.0, motion.stands[1][0] - 30.0, 0.1)  # after the turn, before braking
    v_b = errors(sim, motion)["velocity"][np.searchsorted(sim.reference.time_s, t)]
    true_side = np.std(v_b @ np.array([-np.sin(np.radians(127)), np.cos(np.radians(127))]))
    assert 0.01 < true_side < 0.04  # all of the side noise of 0.02 m/s is in the difference, none in the motion


def test_gnss_gives_place_and_a_wrong_site_does_not():
    sim = simulated(3, TAXI, 200.0, aids=True)
    site = sim.run.header.site
    off = replace(sim.run, header=replace(sim.run.header, site=replace(site, lat_rad=site.lat_rad + 2e-5)))  # 127 m
    for run in (sim.run, off):
        motion = estimated(sim, run)
        start = geodetic_from_ecef(motion.truth.kinematics(np.array([1.0])).r_e)
        assert start[0][0] == pytest.approx(run.header.site.lat_rad, abs=1e-12)
        assert np.abs(errors(sim, motion)["heading"]).max() < HEADING_BOUND_RAD


def test_a_mems_unit_keeps_an_assumed_heading():
    sim = simulated(1, PARKED, 37.0, "mems")
    motion = estimated(sim, technology="mems")
    assert not motion.heading_known and motion.heading_source == "assumed" and np.isinf(motion.sigma_heading_rad)
    assert motion.truth.kinematics(np.array([10.0])).euler_rad[0, 2] == 0.0


def test_a_mems_unit_takes_the_course_of_gnss():
    sim = simulated(1, TAXI, 37.0, "mems", aids=True)
    motion = estimated(sim, technology="mems")
    found = errors(sim, motion)
    assert motion.heading_known and motion.heading_source == "gnss"
    assert np.abs(found["heading"][200]) < 0.05
    assert np.abs(found["speed"]).max() < 0.3 and np.abs(found["place"]).max() < 10.0


@pytest.mark.parametrize("technology", ["rlg", "mems"])
def test_without_temperature_table_phases_and_aids(technology):
    sim = simulated(1, TAXI, 37.0, technology)
    run = replace(sim.run, temperature=None, phases=())
    motion = estimate_motion(run, None, twin_of(technology))
    assert motion.temperature is None and len(motion.stands) == 3
    middles = [0.5 * (a + b) - motion.origin_s for a, b in motion.stands]
    turned = np.degrees(np.diff(motion.truth.kinematics(np.array(middles)).euler_rad[:, 2]))
    assert turned == pytest.approx([90.0, -60.0], abs=2.0 if technology == "mems" else 0.01)


def test_a_run_that_never_rests_is_refused():
    rng, n = np.random.default_rng(1), 3000
    shaken = ImuLog(
        time_s=np.arange(1, n + 1) / 10.0, dt_s=np.full(n, 0.1), dtheta_rad=0.05 * rng.standard_normal((n, 3)),
        dv_m_s=rng.standard_normal((n, 3)),
    )  # fmt: skip
    with pytest.raises(InputError, match="never rests"):
        estimate_motion(replace(simulated().run, imu=shaken, phases=()), None, twin_of())
