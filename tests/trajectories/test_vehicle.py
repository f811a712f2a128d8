"""Disturbances: their statistics, their signs, and that sensors and truth move together (through
the mechanization).
"""

from itertools import accumulate

import numpy as np
import pytest
from scipy import stats

from ins.attitude import dcm_from_euler, euler_from_dcm, rotation_vector_from_dcm, wrap_pi
from ins.earth import radii_of_curvature
from ins.records import ImuLog, InputError, NavState, Site, VehicleNoise
from ins.strapdown.mechanization import navigate
from ins.units import ARCSEC, DEG, MILLIRADIAN
from trajectories.simulator.motions import lay
from trajectories.simulator.segments import Park, Stop, Straight, Turn
from trajectories.simulator.sensors import ideal_sensors
from trajectories.simulator.truth import build_truth
from trajectories.simulator.vehicle import (
    Boarding,
    Bump,
    Gust,
    Push,
    disturb,
    gauss_markov,
    recursion,
    sway_velocity,
)

QUIET = {
    "crab_mrad": 0.0,
    "lateral_noise_m_s": 0.0,
    "yaw_creep_arcsec_sqrt_h": 0.0,
    "sway_m_s": 0.0,
}
SITE = Site(lat_rad=45 * DEG, lon_rad=7 * DEG, height_m=250.0)
TAXI = [
    Park(duration_s=60.0),
    Turn(angle_deg=90.0),
    Straight(duration_s=120.0),
    Stop(duration_s=20.0),
    Turn(angle_deg=-90.0),
    Straight(duration_s=60.0),
    Stop(duration_s=10.0),
]


@pytest.fixture(scope="module")
def taxi():
    return ideal_sensors(
        build_truth(lay(TAXI), SITE, heading_rad=0.4, wheel_reference_m=(4.0, 0.5, 1.0)), 100.0
    )


@pytest.fixture(scope="module")
def parked():
    return ideal_sensors(build_truth(lay([Park(duration_s=4000.0)]), SITE), 10.0)


def chi_square_band(n, false_alarm=1e-4):
    """Two-sided bounds on a sample variance over the true one."""
    return stats.chi2.ppf([false_alarm / 2, 1 - false_alarm / 2], n) / n


@pytest.mark.parametrize(
    ("noise", "events", "far_m"),
    [
        ({"crab_mrad": 8.7}, (), 0.05),
        ({"lateral_noise_m_s": 0.3}, (), 0.02),
        ({"yaw_creep_arcsec_sqrt_h": 300.0}, (), 0.002),
        ({"sway_m_s": 0.02}, (), 0.001),
        (
            {},
            (Boarding(time_s=20.0, roll_arcsec=300.0, pitch_arcsec=-200.0, heading_arcsec=250.0),),
            0.02,
        ),
        (
            {},
            (Boarding(time_s=20.0, roll_arcsec=300.0), Boarding(time_s=30.0, pitch_arcsec=300.0)),
            0.02,
        ),
        (
            {},
            (Gust(time_s=10.0, duration_s=30.0, sway_m_s=0.1), Bump(time_s=50.0, velocity_m_s=0.2)),
            0.001,
        ),
        ({}, (Push(time_s=10.0, distance_m=-4.0, turn_deg=0.2),), 0.03),
        (
            {},
            (
                Bump(time_s=50.0, velocity_m_s=0.2, direction_deg=70.0),
                Boarding(time_s=20.0, sink_mm=30.0),
            ),
            0.002,
        ),
    ],
    ids=[
        "crab",
        "side noise",
        "creep",
        "sway",
        "boarding",
        "roll then pitch",
        "gust and bump",
        "push",
        "side bump and sinking",
    ],
)
def test_sensors_and_truth_move_together(taxi, noise, events, far_m):
    """The disturbed increments navigate to the disturbed truth; bounds: what is left out."""
    moved = disturb(taxi, VehicleNoise(**{**QUIET, **noise}), events, np.random.default_rng(5))
    imu = ImuLog(
        time_s=taxi.time_s,
        dt_s=np.full(taxi.time_s.size, taxi.dt_s),
        dtheta_rad=moved.dtheta_rad,
        dv_m_s=moved.dv_m_s,
    )
    start = NavState(time_s=0.0, site=SITE, v_n_m_s=np.zeros(3), C_nb=dcm_from_euler(0.0, 0.0, 0.4))
    history = navigate(imu, start, epoch_s=None)
    meridian, transverse = radii_of_curvature(taxi.lat_rad)
    assert np.max(np.abs(history.lat_rad[1:] - moved.lat_rad) * meridian) < far_m
    assert np.max(np.abs(history.lon_rad[1:] - moved.lon_rad) * transverse) < far_m
    assert np.max(np.abs(history.v_n_m_s[1:] - moved.v_n_m_s)) < 2e-4
    phi = rotation_vector_from_dcm(history.C_nb[1:] @ np.swapaxes(moved.C_nb, 1, 2))
    assert np.max(np.abs(phi)) < 0.002 * ARCSEC
    shifted = (
        np.max(np.abs(moved.v_n_m_s - taxi.v_n_m_s)) + np.max(np.abs(moved.C_nb - taxi.C_nb)) * 10
    )
    assert shifted > 0.005  # the disturbance was there


def test_a_bump_goes_clockwise_of_the_nose_and_who_boards_sinks_the_vehicle(parked):
    """A bump 45 deg to the right; people sink the vehicle by 30 mm, down in its velocity."""
    events = (
        Bump(time_s=50.0, velocity_m_s=0.2, duration_s=2.0, direction_deg=45.0),
        Boarding(time_s=100.0, sink_mm=30.0),
    )
    moved = disturb(parked, VehicleNoise(**QUIET), events, np.random.default_rng(1))
    largest = moved.v_n_m_s[np.argmax(moved.v_n_m_s[:, 0])]  # heading 0: north and east
    expected = [0.2 * np.cos(np.pi / 4), 0.2 * np.sin(np.pi / 4), 0.0]
    np.testing.assert_allclose(largest, expected, atol=0.005)
    assert np.sum(moved.v_n_m_s[:, 2]) * parked.dt_s == pytest.approx(0.03, rel=1e-3)


@pytest.mark.parametrize(
    ("crab_mrad", "events"),
    [(5.0, ()), (0.0, (Boarding(time_s=20.0, heading_arcsec=500.0),))],
    ids=["crab", "a heading that people changed"],
)
def test_a_vehicle_rolls_along_its_own_axis_but_for_its_crab(taxi, crab_mrad, events):
    """formats.md: lateral velocity in body axes is -V crab, whichever way the body was turned."""
    noise = VehicleNoise(**{**QUIET, "crab_mrad": crab_mrad})
    moved = disturb(taxi, noise, events, np.random.default_rng(1))
    leg = (taxi.time_s > 120) & (taxi.time_s < 160)
    v_n, heading = moved.v_n_m_s[leg], euler_from_dcm(moved.C_nb[leg])[2]
    v_b = np.einsum("nji,nj->ni", moved.C_nb[leg], v_n)
    crab = crab_mrad * MILLIRADIAN
    second_order = 4e-6 * taxi.speed_m_s.max()  # (500 arcsec)^2 / 2 and the cube of the crab
    np.testing.assert_allclose(v_b[:, 1], -taxi.speed_m_s[leg] * crab, atol=second_order)
    course = np.arctan2(v_n[:, 1], v_n[:, 0])
    np.testing.assert_allclose(wrap_pi(heading - course), crab, atol=4e-6)


def test_a_push_moves_the_vehicle_its_distance_and_turn(parked):
    push = Push(time_s=20.0, distance_m=-3.0, speed_m_s=0.25, ramp_s=2.0, turn_deg=0.8)
    moved = disturb(parked, VehicleNoise(**QUIET), (push,), np.random.default_rng(1))
    north_m = radii_of_curvature(SITE.lat_rad)[0] * (moved.lat_rad - parked.lat_rad)
    before, after = parked.time_s < 20.0, parked.time_s > 20.0 + push.duration_s
    assert push.duration_s == 14.0
    assert np.max(np.abs(north_m[before])) == 0.0
    np.testing.assert_allclose(north_m[after], -3.0, atol=1e-3)
    assert -0.251 < moved.v_n_m_s[:, 0].min() < -0.249
    np.testing.assert_allclose(euler_from_dcm(moved.C_nb[after])[2], 0.8 * DEG, atol=1e-9)
    with pytest.raises(InputError, match="turn_deg"):
        Push(time_s=0.0, distance_m=1.0, turn_deg=5.0)


def test_yaw_creep_walks_only_while_parked(parked, taxi):
    creep = VehicleNoise(**{**QUIET, "yaw_creep_arcsec_sqrt_h": 5.0})
    moved = disturb(parked, creep, (), np.random.default_rng(2))
    heading = wrap_pi(euler_from_dcm(moved.C_nb)[2])
    steps = np.diff(heading[::10]) / (5.0 * ARCSEC * np.sqrt(1 / 3600))
    low, high = chi_square_band(steps.size)
    assert low < np.mean(steps**2) < high
    rolling = disturb(taxi, creep, (), np.random.default_rng(3))
    drift = wrap_pi(euler_from_dcm(rolling.C_nb)[2] - taxi.euler_rad[:, 2])[taxi.speed_m_s > 0.1]
    legs = np.unique(np.round(drift, 12))
    assert legs.size == 2  # one heading shift on each of the two legs between rests


def test_sway_has_its_rms_and_the_correlation_of_the_oscillator():
    """R(tau) = rms^2 e^{-zw tau}(cos wd tau - z w/wd sin wd tau): velocity of a damped oscillator
    under white force.
    """
    rate, f, z, rms = 10.0, 0.28, 0.2, 0.001
    v = sway_velocity(
        np.random.default_rng(4), 400_000, rms_m_s=rms, frequency_hz=f, damping=z, rate_hz=rate
    )
    w = 2 * np.pi * f
    wd = w * np.sqrt(1 - z**2)
    independent = v.size / rate * z * w  # samples worth: correlation time 1/(2 z w) of the square
    assert np.mean(v**2) / rms**2 == pytest.approx(1.0, abs=4 * np.sqrt(2 / independent))
    for lag in (3, 10, 18, 36):
        tau = lag / rate
        expected = np.exp(-z * w * tau) * (np.cos(wd * tau) - z * w / wd * np.sin(wd * tau))
        assert np.mean(v[lag:] * v[:-lag]) / rms**2 == pytest.approx(
            expected, abs=4 / np.sqrt(independent)
        )


def test_side_noise_is_gauss_markov_of_two_seconds():
    v = gauss_markov(np.random.default_rng(6), 400_000, rms=0.02, tau_s=2.0, rate_hz=10.0)
    independent = v.size / 20.0
    assert np.mean(v**2) / 0.02**2 == pytest.approx(1.0, abs=4 * np.sqrt(2 / independent))
    assert np.mean(v[20:] * v[:-20]) / 0.02**2 == pytest.approx(
        np.exp(-1), abs=4 / np.sqrt(independent)
    )


def test_side_noise_acts_along_body_y_and_only_while_rolling(taxi):
    moved = disturb(
        taxi, VehicleNoise(**{**QUIET, "lateral_noise_m_s": 0.05}), (), np.random.default_rng(7)
    )
    extra_b = np.einsum("nji,nj->ni", taxi.C_nb, moved.v_n_m_s - taxi.v_n_m_s)
    np.testing.assert_allclose(extra_b[:, [0, 2]], 0.0, atol=1e-15)
    assert not extra_b[taxi.speed_m_s < 0.5, 1].any()
    assert 0.02 < np.std(extra_b[taxi.speed_m_s > 1.5, 1]) < 0.08


def test_boarding_settles_at_its_step_within_seconds(parked):
    event = Boarding(time_s=100.0, roll_arcsec=100.0, pitch_arcsec=-50.0, heading_arcsec=20.0)
    moved = disturb(parked, VehicleNoise(**QUIET), (event,), np.random.default_rng(8))
    angles = np.stack(euler_from_dcm(moved.C_nb), axis=-1)
    angles[:, 2] = wrap_pi(angles[:, 2])
    assert np.max(np.abs(angles[parked.time_s <= 100.0])) < 1e-12
    # from rest: no faster than under the full force of a spring of 7.5 rad/s
    first = np.flatnonzero(parked.time_s > 100.0)[0]
    assert 0.0 < angles[first, 0] < 100.0 * ARCSEC * 0.5 * (7.5 * 0.1) ** 2
    settled = angles[parked.time_s > 105.0] / ARCSEC
    np.testing.assert_allclose(
        settled, np.tile([100.0, -50.0, 20.0], (settled.shape[0], 1)), atol=0.1
    )


def test_level_turns_with_the_displacement_as_the_frames_say():
    """rho = (cosL dlon, -dlat, -sinL dlon) is the rotation between the frames at the two places."""
    from ins.earth import dcm_en

    lat, dlat, dlon = 0.8, 3e-6, -5e-6
    between = rotation_vector_from_dcm(dcm_en(lat, 0.1).T @ dcm_en(lat + dlat, 0.1 + dlon))
    np.testing.assert_allclose(
        between, [np.cos(lat) * dlon, -dlat, -np.sin(lat) * dlon], atol=1e-10
    )


@pytest.mark.parametrize("keep", [0.99 * np.exp(0.03j), 0.5])
@pytest.mark.parametrize("n", [1, 2, 500])
def test_a_recursion_is_pythons_to_the_last_bit(keep, n):
    """y[k] = keep y[k - 1] + x[k], added up with Python's own numbers."""
    rng = np.random.default_rng(n)
    real = rng.standard_normal(n)
    for drive in (real, real + 1j * rng.standard_normal(n)):
        factor = keep if np.iscomplexobj(drive) else np.real(keep)
        want = np.array(list(accumulate(drive.tolist(), lambda y, x, f=factor: x + f * y)))
        np.testing.assert_array_equal(recursion(keep, drive), want)
