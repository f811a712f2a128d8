"""A twin's noise in SI, against unit factors by hand; rules for flicker against its spectrum."""

import numpy as np
import pytest

from ins.noise import (
    FLICKER_FLOOR,
    SHORTEST_FLICKER_S,
    accel_densities,
    flicker_covariance,
    flicker_walk,
    gyro_densities,
    random_walk_covariance,
    walk_with_flicker,
)
from ins.records import AccelNoise, GyroNoise
from ins.units import HOUR

DEG_H = np.pi / 180.0 / 3600.0


def test_the_units_of_data_sheets_become_si():
    gyro = gyro_densities(
        GyroNoise(
            arw_deg_sqrt_h=2.0,
            bias_instability_deg_h=3.0,
            rate_random_walk_deg_h_sqrt_h=5.0,
            turn_on_deg_h=7.0,
        )
    )
    # 1 deg/sqrt(h) = (pi / 180) / sqrt(3600) rad/sqrt(s); 1 deg/h/sqrt(h): its rate over sqrt(3600)
    assert gyro.white == pytest.approx(2.0 * np.pi / 180.0 / 60.0)
    assert gyro.instability == pytest.approx(3.0 * DEG_H)
    assert gyro.walk == pytest.approx(5.0 * DEG_H / 60.0)
    assert gyro.turn_on == pytest.approx(7.0 * DEG_H)
    accel = accel_densities(
        AccelNoise(
            vrw_ug_sqrt_hz=2.0,
            bias_instability_ug=3.0,
            rate_random_walk_ug_sqrt_h=5.0,
            turn_on_ug=7.0,
        )
    )
    ug = 9.80665e-6
    assert accel.white == pytest.approx(2.0 * ug)
    assert accel.instability == pytest.approx(3.0 * ug)
    assert accel.walk == pytest.approx(5.0 * ug / 60.0)
    assert accel.turn_on == pytest.approx(7.0 * ug)


def test_an_angle_random_walk_is_what_an_hour_of_it_gives():
    """0.6 deg/sqrt(h) is 0.6 deg after an hour: white sqrt(t) in radians."""
    gyro = gyro_densities(GyroNoise(arw_deg_sqrt_h=0.6))
    assert np.degrees(gyro.white * np.sqrt(HOUR)) == pytest.approx(0.6)


def test_the_floor_of_flicker():
    assert pytest.approx(np.sqrt(2.0 * np.log(2.0) / np.pi), abs=5e-4) == FLICKER_FLOOR


def test_allan_variance_of_exact_bin_means_is_the_floor():
    """Half the variance of the difference of two neighbouring means, at any bin of a long run."""
    for bin_s in (10.0, 100.0, 1000.0):
        start = np.array([0.0, bin_s])
        P = flicker_covariance(start, start + bin_s, lowest_hz=1e-6)
        allan = 0.5 * (P[0, 0] - 2.0 * P[0, 1] + P[1, 1])
        assert np.sqrt(allan) == pytest.approx(FLICKER_FLOOR, rel=2e-3)


def test_the_walk_of_an_hour_says_less_in_minutes_and_more_beyond():
    """K^2 t/3 is the Allan variance of a walk: figures of the docstring."""
    K = walk_with_flicker(0.0, 1.0)

    def allan(t):
        return np.sqrt(K**2 / HOUR * t / 3.0)

    assert allan(300.0) == pytest.approx(0.17, abs=5e-3)
    assert allan(4.0 / 3.0 * HOUR) == pytest.approx(FLICKER_FLOOR, abs=5e-3)
    assert walk_with_flicker(3.0, 4.0) == 5.0


def test_the_walk_that_meets_flicker_is_never_below_its_floor_later_on():
    B = 2.0
    for white in (0.0, 1.0, 20.0, 1e6):
        K = flicker_walk(B, white)
        meets_s = np.clip((white / (FLICKER_FLOOR * B)) ** 2, SHORTEST_FLICKER_S, HOUR)
        for t in (meets_s, 2.0 * meets_s, 10.0 * meets_s):
            assert K * np.sqrt(t / HOUR / 3.0) >= FLICKER_FLOOR * B * (1.0 - 1e-12)


def test_bin_means_of_a_walk_against_a_simulated_one():
    rng = np.random.default_rng(7)
    steps = rng.standard_normal((20_000, 60))
    walk = np.cumsum(steps, axis=1)
    means = walk.reshape(-1, 3, 20).mean(axis=2)
    start = np.array([0.0, 20.0, 40.0])
    P = random_walk_covariance(start, start + 20.0)
    assert np.cov(means.T) == pytest.approx(P, rel=0.12)
