"""Levelling and analytic gyrocompass: closed form, disturbed beginnings, and where there is no
rest.
"""

from dataclasses import replace

import numpy as np
import pytest

from alignment import coarse
from alignment.motion.inertial import LONGEST_COARSE_S, first_rest
from alignment.motion.seconds import seconds_of
from ins.attitude import dcm_from_euler, rotation_vector_from_dcm
from ins.earth import EARTH_RATE_RAD_S, gravity_magnitude, omega_ie_n
from ins.records import ImuLog
from ins.units import DEG, DEG_PER_HOUR, MICRO_G
from tests.alignment.parked import ideal_of, simulate
from trajectories.simulator.segments import Park, Stop, Straight, Turn
from trajectories.simulator.vehicle import Boarding, Bump


def resting(
    lat_deg, *, roll=0.0, pitch=0.0, heading=0.0, gyro=(0, 0, 0), accel=(0, 0, 0), rows=(1200, 0.1)
):
    """True C_nb and the log of a resting unit with sensor errors; rows: their count and dt [s]."""
    n, dt = rows
    C_nb = dcm_from_euler(roll, pitch, heading)
    rate = C_nb.T @ omega_ie_n(lat_deg * DEG) + gyro
    force = C_nb.T @ [0.0, 0.0, -float(gravity_magnitude(lat_deg * DEG, 0.0))] + accel
    time_s = dt * np.arange(1, n + 1)
    log = ImuLog(
        time_s=time_s,
        dt_s=np.full(n, dt),
        dtheta_rad=np.tile(rate * dt, (n, 1)),
        dv_m_s=np.tile(force * dt, (n, 1)),
    )
    return C_nb, log


@pytest.mark.parametrize("lat_deg", [-45.0, 0.1, 45.0, 70.0])
@pytest.mark.parametrize("heading_deg", [0.0, 77.0, 200.0, 359.0])
def test_gyrocompass_is_exact_with_perfect_sensors(lat_deg, heading_deg):
    C_nb, log = resting(lat_deg, roll=0.03, pitch=-0.07, heading=heading_deg * DEG)
    found = coarse.gyrocompass_dcm(coarse.rest_means(log))
    assert rotation_vector_from_dcm(found @ C_nb.T) == pytest.approx(np.zeros(3), abs=1e-9)


@pytest.mark.parametrize("lat_deg", [-45.0, 0.1, 45.0, 70.0])
def test_gyrocompass_errors_are_those_of_the_closed_form(lat_deg):
    """phi_N = -del_E / g, phi_E = del_N / g, psi = -eps_E / (Omega cosL) + del_E / g tanL
    (physics.md 6.4).
    """
    gyro = 0.01 * DEG_PER_HOUR * np.array([0.5, 1.0, -0.3])
    accel = 50 * MICRO_G * np.array([1.0, -0.6, 0.2])
    C_nb, log = resting(lat_deg, gyro=gyro, accel=accel)  # heading 0: body axes are NED
    phi = rotation_vector_from_dcm(coarse.gyrocompass_dcm(coarse.rest_means(log)) @ C_nb.T)
    g, L = float(gravity_magnitude(lat_deg * DEG, 0.0)), lat_deg * DEG
    psi = -gyro[1] / (EARTH_RATE_RAD_S * np.cos(L)) + accel[1] / g * np.tan(L)
    assert phi == pytest.approx([-accel[1] / g, accel[0] / g, psi], abs=2e-3 * abs(psi))


@pytest.mark.parametrize("lat_deg", [-45.0, 0.1, 45.0, 70.0])
def test_latitude_from_the_rates(lat_deg):
    """North gyro error e turns the latitude by -e sinL / Omega, a down error by -e cosL / Omega."""
    _, log = resting(lat_deg, roll=0.02, heading=1.0)
    latitude, excess = coarse.latitude_from_rates(coarse.rest_means(log))
    assert latitude == pytest.approx(lat_deg * DEG, abs=1e-9)
    assert excess == pytest.approx(0.0, abs=1e-15)
    north, down = (0.01 * DEG_PER_HOUR * np.eye(3)[k] for k in (0, 2))
    for error, slope in ((north, -np.sin(lat_deg * DEG)), (down, -np.cos(lat_deg * DEG))):
        found, _ = coarse.latitude_from_rates(coarse.rest_means(resting(lat_deg, gyro=error)[1]))
        assert found - lat_deg * DEG == pytest.approx(
            slope * error.sum() / EARTH_RATE_RAD_S, abs=1e-6
        )


def test_nothing_to_align_on_is_an_error():
    with pytest.raises(ValueError, match="no gravity or no level rate"):
        coarse.gyrocompass_dcm(
            coarse.RestMeans(np.array([0.0, 0.0, -9.8]), np.array([0, 0, 1e-5]), np.zeros(3), 60.0)
        )


def test_one_spoilt_block_does_not_move_the_means():
    """Somebody steps in for 8 s of a minute: the plain mean is off by 2 mrad, the block median by
    nothing.
    """
    _, log = resting(45.0)
    dv = log.dv_m_s.copy()
    dv[615:695] += [0.03, 0.0, 0.0]
    spoilt = ImuLog(time_s=log.time_s, dt_s=log.dt_s, dtheta_rad=log.dtheta_rad, dv_m_s=dv)
    assert coarse.rest_means(spoilt).f_ib_b == pytest.approx(log.dv_m_s[0] / 0.1, abs=1e-9)
    assert np.abs(spoilt.dv_m_s.mean(axis=0) / 0.1 - log.dv_m_s[0] / 0.1).max() > 0.3e-3


def test_sigma_of_the_mean_rate_is_honest():
    """ARW alone over ten minutes, 20 runs: error over sigma in its 99.9 % chi-square band (60
    degrees of freedom).
    """
    _, log = resting(45.0, rows=(6000, 0.1))
    arw, normalised = 0.002 / 60 * DEG, []
    for seed in range(20):
        noise = (
            arw * np.sqrt(0.1) * np.random.default_rng(seed).standard_normal(log.dtheta_rad.shape)
        )
        noisy = ImuLog(
            time_s=log.time_s, dt_s=log.dt_s, dtheta_rad=log.dtheta_rad + noise, dv_m_s=log.dv_m_s
        )
        means = coarse.rest_means(noisy)
        normalised.append((means.omega_ib_b - log.dtheta_rad[0] / 0.1) / means.sigma_omega_rad_s)
    # the median's own 1.25, and a scatter from 60 blocks
    assert 0.51 < np.mean(np.square(normalised)) < 1.72


PARK = (Park(duration_s=900.0),)


def test_first_rest_of_a_parked_log_is_its_first_ten_minutes():
    start_s, end_s = first_rest(seconds_of(simulate(ideal_of(PARK), 1).run.imu))
    assert start_s < 1.0
    assert end_s == pytest.approx(LONGEST_COARSE_S, abs=2 * coarse.COARSE_BLOCK_S)


def test_first_rest_survives_people_and_a_bump():
    events = [
        Boarding(time_s=95.0, heading_arcsec=8.0),
        Bump(time_s=203.0, velocity_m_s=0.3),
        Boarding(time_s=301.0),
    ]
    start_s, end_s = first_rest(seconds_of(simulate(ideal_of(PARK), 2, events=events).run.imu))
    assert end_s - start_s > 500.0


def test_first_rest_after_a_disturbed_beginning():
    """Rolling and turning for 100 s, then rest: the rest is found behind it."""
    segments = (
        Straight(duration_s=20.0),
        Turn(angle_deg=90.0),
        Turn(angle_deg=-90.0),
        Straight(duration_s=10.0),
    )
    ideal = ideal_of((*segments, Stop(duration_s=10.0), Park(duration_s=600.0)))
    rest = ideal.truth.motion.rest[0]
    start_s, end_s = first_rest(seconds_of(simulate(ideal, 3).run.imu))
    assert rest[0] - 1.0 < start_s < rest[0] + 30.0
    assert end_s > rest[0] + 300.0


def test_turning_all_the_way_is_no_rest():
    turns = tuple(Turn(angle_deg=a) for a in (170.0, -170.0) * 4)
    for seed in range(3):
        assert first_rest(seconds_of(simulate(ideal_of(turns), seed).run.imu)) is None


def tilting(tilt_rad):
    """Ten minutes at rest at 45 deg while the base rolls by tilt(t), without any noise."""
    log = resting(45.0, rows=(6000, 0.1))[1]
    rate = np.gradient(tilt_rad, log.time_s)
    C = np.zeros((log.time_s.size, 3, 3))
    C[:, 0, 0] = 1.0
    C[:, 1, 1] = C[:, 2, 2] = np.cos(tilt_rad)
    C[:, 1, 2] = np.sin(tilt_rad)
    C[:, 2, 1] = -C[:, 1, 2]
    dtheta = np.einsum("kij,kj->ki", C, log.dtheta_rad)
    dtheta[:, 0] += rate * log.dt_s
    return replace(log, dtheta_rad=dtheta, dv_m_s=np.einsum("kij,kj->ki", C, log.dv_m_s))


@pytest.mark.parametrize("shape", ["ramp", "step"])
def test_the_turn_of_the_base_is_no_wrong_latitude(shape):
    """0.1 deg of roll in ten minutes is 0.6 deg/h: 2 deg of latitude, and of bias, if not known."""
    time_s = resting(45.0, rows=(6000, 0.1))[1].time_s
    ramp = time_s / time_s[-1]
    along = ramp if shape == "ramp" else np.clip((time_s - 290.0) / 20.0, 0.0, 1.0)
    log = tilting(np.radians(0.1) * along)
    plain, _ = coarse.latitude_from_rates(coarse.rest_means(log))
    found, excess = coarse.latitude_from_rates(coarse.earth_rate_means(log))
    assert np.degrees(found) == pytest.approx(45.0, abs=0.02)
    assert abs(excess) < 0.002 * EARTH_RATE_RAD_S
    assert shape == "step" or abs(np.degrees(plain) - 45.0) > 0.3
