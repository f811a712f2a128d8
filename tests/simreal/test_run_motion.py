"""The motion estimated from a run's own sensors against the simulator's truth, which it never
sees.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ins.attitude import wrap_pi
from ins.earth import dcm_en, displacement_ned, geodetic_from_ecef
from ins.records import ImuLog, InputError
from simreal.twin.run_motion import estimate_motion
from tests.simreal.runs import FLIGHT, PARKED, PARKED_S, TAXI, simulated, table, twin_of
from trajectories.readers.conversion import convert_log
from trajectories.simulator.vehicle import Boarding, Bump, Gust, Push

DATA, PLANE = Path(__file__).parents[3] / "shared" / "data", "apm_fixedwing_TestLog2.mat"

HEADING_BOUND_RAD = 3e-3
TILT_BOUND_RAD = 2e-4  # 30 micro-g of turn-on is 3e-5 rad
SPEED_BOUND_M_S = 0.03
LATERAL_BOUND_M_S = 0.1  # 5 sigmas of the side noise, which is not part of the motion


def estimated(sim, run=None, technology="rlg"):
    return estimate_motion(run or sim.run, table(technology), twin_of(technology))


def errors(sim, motion, *, from_s=1.0):
    """Heading, tilt [rad], horizontal place [m], forward speed and velocity [m/s]: estimated less
    true.
    """
    ref = sim.reference
    point = motion.truth.kinematics(ref.time_s - motion.origin_s)
    lat, lon, _ = geodetic_from_ecef(point.r_e)
    place = displacement_ned(
        lat, lon, lat0_rad=ref.lat_rad, lon0_rad=ref.lon_rad, height0_m=ref.height_m
    )[:, :2]
    v_n = np.einsum("nji,nj->ni", dcm_en(lat, lon), point.v_e)[:, :2]
    tilt = point.euler_rad[:, :2] - np.column_stack([ref.roll_rad, ref.pitch_rad])
    true_speed = np.linalg.norm(ref.v_n_m_s[:, :2], axis=1)
    return {
        "heading": wrap_pi(point.euler_rad[:, 2] - ref.heading_rad),
        "tilt": tilt,
        "place": place,
        "speed": np.linalg.norm(v_n, axis=1) - true_speed,
        "velocity": v_n - ref.v_n_m_s[:, :2],
    }


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
        point = motion.truth.kinematics(
            np.linspace(start_s + 0.1, end_s - 0.1, 50) - motion.origin_s
        )
        assert (
            np.ptp(point.r_e, axis=0).max() == 0.0 and np.ptp(point.euler_rad, axis=0).max() == 0.0
        )
        assert not point.v_e.any()


def test_sigma_of_the_heading_is_honest():
    """Ten parked units: the errors are as large as their sigma says (chi-square, 10 dof, 0.1 % on
    either side).
    """
    total = 0.0
    for seed in range(10):
        sim = simulated(seed, PARKED)
        motion = estimated(sim)
        total += (errors(sim, motion)["heading"][100] / motion.sigma_heading_rad) ** 2
    # the prior leaves room for an effect still to be found, so the lower side is not tested
    assert total < 29.6


def test_noise_does_not_go_into_a_straight_leg():
    """Side noise and sway are the twin's: on a leg without turns the estimated way is straight."""
    sim = simulated()
    motion = estimated(sim)
    # after the turn, before braking
    t = np.arange(motion.stands[0][1] + 60.0, motion.stands[1][0] - 30.0, 0.1)
    v_b = errors(sim, motion)["velocity"][np.searchsorted(sim.reference.time_s, t)]
    true_side = np.std(v_b @ np.array([-np.sin(np.radians(127)), np.cos(np.radians(127))]))
    # all of the side noise of 0.02 m/s is in the difference, none in the motion
    assert 0.01 < true_side < 0.04


def test_gnss_gives_place_and_a_wrong_site_does_not():
    sim = simulated(3, TAXI, 200.0, aids=True)
    site = sim.run.header.site
    # 127 m
    off = replace(
        sim.run, header=replace(sim.run.header, site=replace(site, lat_rad=site.lat_rad + 2e-5))
    )
    for run in (sim.run, off):
        motion = estimated(sim, run)
        start = geodetic_from_ecef(motion.truth.kinematics(np.array([1.0])).r_e)
        assert start[0][0] == pytest.approx(run.header.site.lat_rad, abs=1e-12)
        assert np.abs(errors(sim, motion)["heading"]).max() < HEADING_BOUND_RAD


@pytest.mark.parametrize(
    ("event", "stands"),
    [
        (Gust(time_s=300.0, duration_s=300.0, sway_m_s=0.02), 3),
        (Bump(time_s=700.0, velocity_m_s=0.1), 3),
        (Boarding(time_s=500.0, roll_arcsec=80.0), 3),
        (Push(time_s=600.0, distance_m=5.0, turn_deg=0.5), 4),
    ],
)
def test_only_a_push_is_a_move(event, stands):
    """What shakes the parked vehicle stays for the diagnosis to see; a tug that pushes it takes it
    elsewhere.
    """
    sim = simulated(2, events=(event,))
    motion = estimated(sim)
    found = errors(sim, motion)
    assert len(motion.stands) == stands
    assert np.abs(found["heading"]).max() < HEADING_BOUND_RAD and np.abs(found["place"]).max() < 4.0


@pytest.mark.parametrize("technology", ["rlg", "mems"])
def test_flight_with_gnss(technology):
    sim = simulated(1, FLIGHT, 37.0, technology, aids=True)
    motion = estimated(sim, technology=technology)
    found = errors(sim, motion)
    mems = technology == "mems"
    assert len(motion.stands) == 3
    assert np.abs(found["place"]).max() < (15.0 if mems else 3.0)
    assert np.abs(found["velocity"]).max() < (0.3 if mems else LATERAL_BOUND_M_S)
    assert np.abs(found["heading"]).max() < (0.05 if mems else HEADING_BOUND_RAD)
    height = geodetic_from_ecef(motion.truth.kinematics(sim.reference.time_s).r_e)[2]
    assert np.abs(height - sim.reference.height_m).max() < (30.0 if mems else 5.0)
    assert motion.truth.motion.airborne(
        np.array([300.0, motion.truth.motion.end_s - 60.0])
    ) == pytest.approx(0.0, abs=1e-9)
    assert motion.truth.motion.airborne(1000.0) == pytest.approx(1.0)


@pytest.mark.skipif(not (DATA / PLANE).exists(), reason=f"no {PLANE} in {DATA}")
def test_a_real_flight_of_a_mems_unit():
    """The ArduPilot plane, hands and catapult included: its twin's GNSS is where the log's is."""
    run = convert_log(DATA / PLANE, {}, {}).run
    motion = estimate_motion(run, None, twin_of("mems"))
    fixes = run.gnss.time_s < run.imu.end_s
    point = motion.truth.kinematics(run.gnss.time_s[fixes] - motion.origin_s)
    lat, lon, _ = geodetic_from_ecef(point.r_e)
    v_n = np.einsum("nji,nj->ni", dcm_en(lat, lon), point.v_e)[:, :2]
    off = displacement_ned(
        lat, lon, lat0_rad=run.gnss.lat_rad[fixes], lon0_rad=run.gnss.lon_rad[fixes], height0_m=15.0
    )[:, :2]
    assert motion.heading_source == "gnss"
    assert np.sqrt(np.mean((off - np.median(off, axis=0)) ** 2)) < 10.0
    assert np.sqrt(np.mean((v_n - run.gnss.v_n_m_s[fixes, :2]) ** 2)) < 2.5  # m/s, of 10 to 30


def test_a_mems_unit_keeps_an_assumed_heading():
    sim = simulated(1, PARKED, 37.0, "mems")
    motion = estimated(sim, technology="mems")
    assert (
        not motion.heading_known
        and motion.heading_source == "assumed"
        and np.isinf(motion.sigma_heading_rad)
    )
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
        time_s=np.arange(1, n + 1) / 10.0,
        dt_s=np.full(n, 0.1),
        dtheta_rad=0.05 * rng.standard_normal((n, 3)),
        dv_m_s=rng.standard_normal((n, 3)),
    )
    with pytest.raises(InputError, match="never rests"):
        estimate_motion(replace(simulated().run, imu=shaken, phases=()), None, twin_of())
