"""Smoothed tilt rates: closed form of sigma, scatter against truth, what smoothing gains, gaps,
quiet truth.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from alignment.tilt_rate import smoothed_tilt_rates, tilt_rates
from ins.units import DEG_PER_HOUR, DEG_PER_SQRT_HOUR
from tests.alignment.parked import ideal_of, parked_history, simulate
from tests.scenarios.study import REFERENCE_TWIN
from trajectories.simulator.segments import Park

HOUR_PARKED = (Park(duration_s=3600.0),)
ARW = 0.002 * DEG_PER_SQRT_HOUR


def rates(history, still=None, *, arw=ARW, velocity_sigma=1e-3, rate_sigma=0.01):
    still = np.ones(len(history.time_s), bool) if still is None else still
    return smoothed_tilt_rates(
        history,
        still,
        arw=arw,
        vrw=1e-4,
        velocity_sigma_m_s=velocity_sigma,
        rate_sigma_rad_s=rate_sigma * DEG_PER_HOUR,
    )


def simulated_history(seed=1, twin=REFERENCE_TWIN):
    return parked_history(simulate(ideal_of(HOUR_PARKED), seed, twin=twin).run)


def driven(history, u_north, u_east, rng=None, arw=0.0):
    """Velocity error of given tilt rates (k,), by stepping physics.md 6.2 with a half-second
    Euler-Cromer scheme.
    """
    from ins.earth import EARTH_RATE_RAD_S, gravity_magnitude, radii_of_curvature

    lat, height = history.lat_rad[0], history.height_m[0]
    g, (meridian, transverse) = float(gravity_magnitude(lat, height)), radii_of_curvature(lat)
    coriolis, parts = 2.0 * EARTH_RATE_RAD_S * np.sin(lat), 20
    v, p, theta, out = np.zeros(2), np.zeros(2), np.zeros(2), np.zeros((len(history.time_s), 3))
    for k in range(1, len(history.time_s)):
        dt = (history.time_s[k] - history.time_s[k - 1]) / parts
        kick = (
            arw * np.sqrt(dt * parts) * rng.standard_normal(2) / parts
            if rng is not None
            else np.zeros(2)
        )
        for _ in range(parts):
            theta = theta + np.array([u_north[k], u_east[k]]) * dt + kick
            a = np.array(
                [
                    -g * (theta[1] + p[0] / (meridian + height)) - coriolis * v[1],
                    g * (theta[0] - p[1] / (transverse + height)) + coriolis * v[0],
                ]
            )
            v = v + a * dt
            p = p + v * dt
        out[k, :2] = v
    return replace(history, v_n_m_s=out)


def test_a_constant_rate_is_found_over_an_hour():
    """0.01 deg/h north and -0.004 east: the Schuler and Coriolis terms are the model's own, to five
    digits. The bracket of physics.md 6.3 has them from each window alone, to 1 %.
    """
    history = simulated_history()
    ones = np.ones(len(history.time_s)) * DEG_PER_HOUR
    tilted = driven(history, 0.01 * ones, -0.004 * ones)
    found = rates(tilted, arw=1e-3 * ARW, velocity_sigma=1e-6)
    bracket = tilt_rates(tilted, ones > 0, arw=0.0, velocity_sigma_m_s=1e-6)
    assert len(found) == len(bracket) == 12
    for rate, window in zip(found, bracket):
        assert rate.u_north_rad_s / DEG_PER_HOUR == pytest.approx(0.01, abs=2e-6)
        assert rate.u_east_rad_s / DEG_PER_HOUR == pytest.approx(-0.004, abs=2e-6)
        assert window.u_north_rad_s / DEG_PER_HOUR == pytest.approx(0.01, abs=1e-4)
        assert window.u_east_rad_s / DEG_PER_HOUR == pytest.approx(-0.004, abs=1e-4)


def test_a_rate_that_changes_is_followed():
    history = simulated_history()
    ramp = 0.01 * DEG_PER_HOUR * history.time_s / 3600.0
    found = rates(driven(history, ramp, 0.0 * ramp), arw=1e-3 * ARW, velocity_sigma=1e-6)
    for rate in found:
        seen_from_one_side = rate in (found[0], found[-1])
        allowed = rate.sigma_rad_s / DEG_PER_HOUR if seen_from_one_side else 3e-5
        assert rate.u_north_rad_s / DEG_PER_HOUR == pytest.approx(
            0.01 * rate.time_s / 3600.0, abs=allowed
        )


def test_scatter_is_the_sigma():
    """Angle random walk alone, 6 runs x 12 windows x 2 axes: two-sided 99.9 %, widened for
    neighbours' correlation.
    """
    history, rng, z = simulated_history(), np.random.default_rng(8), []
    none = np.zeros(len(history.time_s))
    for _ in range(6):
        for rate in rates(driven(history, none, none, rng, ARW), velocity_sigma=1e-4):
            z += [rate.u_north_rad_s / rate.sigma_rad_s, rate.u_east_rad_s / rate.sigma_rad_s]
    low, high = chi2.ppf([5e-4, 1.0 - 5e-4], len(z)) / len(z)
    assert len(z) == 144
    assert low < np.mean(np.square(z)) < high


def test_what_smoothing_gains():
    """Windows of 300 s are limited by the angle random walk, 0.0069 deg/h: the parabola of the
    bracket is a tenth above it, the filter 3 %, the smoother at it; the first window, of which the
    filter sees one side, gains 14 %.
    """
    history = simulated_history()
    smoothed = rates(history)
    bracket = tilt_rates(
        history, np.ones(len(history.time_s), bool), arw=ARW, velocity_sigma_m_s=1e-3
    )
    floor = 0.002 / np.sqrt(300.0 / 3600.0)
    for rate, window in zip(smoothed, bracket):
        assert rate.time_s == window.time_s
        assert rate.sigma_rad_s < rate.sigma_filtered_rad_s + 1e-15
        assert rate.sigma_rad_s < 0.9 * window.sigma_rad_s
        assert rate.sigma_rad_s / DEG_PER_HOUR == pytest.approx(floor, rel=0.05)
    assert smoothed[0].sigma_rad_s < 0.87 * smoothed[0].sigma_filtered_rad_s
    # nothing comes after it
    assert smoothed[-1].sigma_rad_s == pytest.approx(smoothed[-1].sigma_filtered_rad_s)


def test_a_disturbed_stretch_is_not_measured():
    history = simulated_history()
    still = ~((history.time_s > 900.0) & (history.time_s <= 1300.0))
    shaken = history.v_n_m_s.copy()
    shaken[~still, :2] += 0.5
    quiet, found = rates(history), rates(replace(history, v_n_m_s=shaken), still)
    times = [rate.time_s for rate in found]
    assert 1050.0 not in times
    assert 750.0 in times
    for rate in found:
        same = next(q for q in quiet if q.time_s == rate.time_s)
        assert rate.u_north_rad_s == pytest.approx(same.u_north_rad_s, abs=0.004 * DEG_PER_HOUR)
