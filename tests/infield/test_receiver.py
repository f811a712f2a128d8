"""A receiver's slow errors by what its fixes say while the vehicle stands: levels against those
that were drawn, white noise, fixes that are too few, that are frozen or broken.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from infield.session.navigated.receiver import receiver_errors
from infield.session.settings import FlightPriors
from ins.records import GnssLog

STOOD = (0.0, 1800.0)
NOISE = (0.5, 0.03)
PRIORS = FlightPriors()
EARTH_M = 6.37e6
LAT_RAD = 0.8


def strayed(rng, count, sigma, time_s):
    kept = np.exp(-1.0 / time_s)
    news = np.sqrt(1.0 - kept**2) * rng.standard_normal((count, 2))
    news[0] = rng.standard_normal(2)
    return sigma * lfilter([1.0], [1.0, -kept], news, axis=0)


def fixes(seed, *, slow_m=0.0, slow_m_s=0.0, duration_s=1800, declared=None):
    """A fix a second from a standing antenna 3 m off the site."""
    rng = np.random.default_rng([23, seed])
    place = 3.0 + strayed(rng, duration_s, slow_m, PRIORS.slow_position_s)
    place += NOISE[0] * rng.standard_normal((duration_s, 2))
    velocity = np.zeros((duration_s, 3))
    velocity[:, :2] = strayed(rng, duration_s, slow_m_s, PRIORS.slow_velocity_s)
    velocity += NOISE[1] * rng.standard_normal((duration_s, 3))
    told = None if declared is None else np.full(duration_s, declared)
    return GnssLog(
        time_s=np.arange(duration_s) + 1.0,
        lat_rad=LAT_RAD + place[:, 0] / EARTH_M,
        lon_rad=0.1 + place[:, 1] / (EARTH_M * np.cos(LAT_RAD)),
        height_m=np.full(duration_s, 200.0),
        v_n_m_s=velocity,
        sigma_horizontal_m=told,
    )


def test_white_receivers_have_no_slow_error():
    """Odds of 20 to 1 for what is not there have a chance below 1 in 20 (Markov), of two kinds 4 of
    40; beyond 9 by chance in one of a hundred.
    """
    found = [receiver_errors(fixes(seed), STOOD, NOISE, PRIORS).found for seed in range(40)]
    assert sum(bool(one) for one in found) <= 9


@pytest.mark.parametrize(("slow_m", "slow_m_s"), [(1.5, 0.01), (4.0, 0.03), (0.3, 0.02)])
def test_levels_are_those_drawn(slow_m, slow_m_s):
    """Half an hour holds 12 and 60 degrees of freedom: medians of 15 within a quarter, a tenth,
    beside the steps of the levels.
    """
    found = [
        receiver_errors(fixes(seed, slow_m=slow_m, slow_m_s=slow_m_s), STOOD, NOISE, PRIORS)
        for seed in range(15)
    ]
    positions = np.median([errors.position.sigma for errors in found])
    velocities = np.median([errors.velocity.sigma for errors in found])
    assert positions == pytest.approx(slow_m, rel=0.4)
    assert velocities == pytest.approx(slow_m_s, rel=0.3)
    assert all(errors.position.gain_nats > 10.0 for errors in found)


def test_a_receiver_that_declares_its_whole_error_is_found_out():
    log = fixes(0, slow_m=1.5, slow_m_s=0.01, declared=np.hypot(1.5, 0.5))
    assert receiver_errors(log, STOOD, NOISE, PRIORS).position.sigma >= 0.75


@pytest.mark.parametrize("duration_s", [2, 30])
def test_fixes_too_few_to_tell_leave_what_is_assumed(duration_s):
    errors = receiver_errors(fixes(1, duration_s=duration_s), STOOD, NOISE, PRIORS)
    assert errors.position.sigma == PRIORS.slow_position_m
    assert errors.velocity.sigma == PRIORS.slow_velocity_m_s


def test_frozen_fixes_tell_nothing():
    """Some receivers hold their place while the vehicle stands: that is no white receiver."""
    log = fixes(2)
    one = np.ones(log.time_s.size)
    log = replace(
        log, lat_rad=LAT_RAD * one, lon_rad=0.1 * one, v_n_m_s=np.zeros(log.v_n_m_s.shape)
    )
    errors = receiver_errors(log, STOOD, NOISE, PRIORS)
    assert errors.position.sigma == PRIORS.slow_position_m
    assert errors.velocity.sigma == PRIORS.slow_velocity_m_s


def test_fixes_that_are_not_whole_are_left_out():
    log = fixes(3, slow_m=1.5, slow_m_s=0.01)
    before = receiver_errors(log, STOOD, NOISE, PRIORS)
    lat_rad, v_n_m_s = log.lat_rad.copy(), log.v_n_m_s.copy()
    lat_rad[100], v_n_m_s[200, 0] = np.nan, np.nan
    broken = replace(log, lat_rad=lat_rad, v_n_m_s=v_n_m_s)
    after = receiver_errors(broken, STOOD, NOISE, PRIORS)
    assert after.position.sigma == pytest.approx(before.position.sigma, rel=0.5)
    assert np.isfinite([after.position.gain_nats, after.velocity.gain_nats]).all()
