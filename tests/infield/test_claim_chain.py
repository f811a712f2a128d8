"""Claim 1 step by step against the truth and against the filter."""

from functools import lru_cache

import numpy as np
import pytest

from infield.session.log import compensated_imu, session_end
from infield.session.navigated.claim_chain import ChainSpan, run_claim_chain
from infield.session.reasons import ChainNote
from infield.thermometer.gyro_temperature import gyro_temperature
from ins.earth import EARTH_RATE_RAD_S
from ins.units import DEG, DEG_PER_HOUR, MILLIRADIAN
from tests.infield.sessions import PARKED, TAXI, TWIN, estimate, factory, simulated

COUPLING = EARTH_RATE_RAD_S * np.cos(45 * DEG)


@lru_cache(maxsize=8)
def chain_of(seed=1, segments=TAXI):
    run, table = simulated(seed, segments).run, factory()
    temperature = gyro_temperature(run.temperature)
    imu = compensated_imu(run, table, temperature, TWIN)
    session = estimate(seed, segments)
    return run_claim_chain(
        imu,
        ChainSpan(run.header.site, session.alignment, session_end(run)),
        TWIN,
        temperature,
        motion=session.navigated.motion,
        prior_sigma_deg_h=0.012,
    )


def true_residual(seed, segments, point):
    """Bias less table (x, y, z) [deg/h] over a point's window; heading 0: x is north, y is east."""
    s, table = simulated(seed, segments), factory()
    rows = np.abs(s.bias_time_s - point.time_s) <= 150.0
    T = s.temperature_true_degC[rows]
    return np.array(
        [np.mean(s.gyro_bias_true_deg_h[rows, k] - table.bias_deg_h(k, T[:, k])) for k in range(3)]
    )


def heading_error(seed, segments):
    aligned, truth = estimate(seed, segments).alignment, simulated(seed, segments).reference
    k = int(np.argmin(np.abs(truth.time_s - aligned.time_s)))
    return float(np.angle(np.exp(1j * (aligned.heading_rad - truth.heading_rad[k]))))


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_north_points_are_absolute(seed):
    """Set 2, north: the true bias left by the table, to its sigma and 50 micro-g of tilt (6.4)."""
    chain = chain_of(seed)
    assert len(chain.points) == 4  # of 20 minutes after the alignment
    z = []
    for p in chain.points:
        z.append(
            (p.north_deg_h - true_residual(seed, TAXI, p)[0]) / np.hypot(p.sigma_deg_h, 0.0006)
        )
    assert np.abs(z).max() < 4.0


def test_north_points_have_an_honest_sigma():
    z = [
        (p.north_deg_h - true_residual(seed, TAXI, p)[0]) / np.hypot(p.sigma_deg_h, 0.0006)
        for seed in (1, 2, 3)
        for p in chain_of(seed).points
    ]
    assert 0.2 < np.mean(np.square(z)) < 2.7  # 99.9 % of chi-square, 12 degrees of freedom


def test_east_points_are_relative_before_the_taxi_and_absolute_after():
    """Before eps_E + Omega cosL psi. After (m): less Omega cosL psi, within the heading's sigma."""
    for seed in (1, 2, 3):
        chain, psi = chain_of(seed), heading_error(seed, TAXI)
        for p in chain.points:
            east = true_residual(seed, TAXI, p)[1]
            relative = east + COUPLING * psi / DEG_PER_HOUR
            assert p.east_relative_deg_h == pytest.approx(relative, abs=4 * p.sigma_deg_h)
            sigma = np.hypot(p.sigma_deg_h, COUPLING * chain.sigma_psi_rad / DEG_PER_HOUR)
            assert p.east_deg_h == pytest.approx(east, abs=4 * sigma)
            assert p.east_relative_deg_h - p.east_deg_h == pytest.approx(
                COUPLING * chain.psi_rad / DEG_PER_HOUR
            )


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_heading_error_of_the_taxi_agrees_with_truth_and_filter(seed):
    chain, filtered = chain_of(seed), estimate(seed)
    assert abs(chain.psi_rad - heading_error(seed, TAXI)) < 4 * chain.sigma_psi_rad
    # less than all data cannot know more
    assert chain.sigma_psi_rad > 0.8 * filtered.sigma_heading_rad
    assert chain.sigma_psi_rad < 0.9 * MILLIRADIAN
    assert abs(chain.psi_rad - filtered.heading_error_rad) < 4 * chain.sigma_psi_rad


def test_without_a_taxi_the_east_axis_stays_relative():
    chain = chain_of(1, PARKED)
    assert np.isnan(chain.psi_rad)
    assert chain.note is ChainNote.NO_TAXI
    assert all(np.isnan(p.east_deg_h) and np.isfinite(p.east_relative_deg_h) for p in chain.points)


def test_a_straight_taxi_is_blind():
    """physics.md 6.5: the chain says so instead of giving a number."""
    from trajectories.simulator.segments import Park, Straight

    chain = chain_of(1, (Park(duration_s=1800.0), Straight(duration_s=200.0)))
    assert np.isnan(chain.psi_rad)
    assert chain.note is ChainNote.BLIND
