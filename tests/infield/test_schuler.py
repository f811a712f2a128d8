"""The Schuler period: a closed form with noise, honest sigma over seeds, a simulated unit,
refusals.
"""

import numpy as np
import pytest

from infield.replay.drift import Drift, drift_of
from infield.replay.free_inertial import replay
from infield.replay.schuler import expected_period_s, fit_schuler
from ins.records import TwinModel
from ins.units import MINUTE
from tests.infield.test_replay import SITE, choices, flat, parked


def swing(
    seconds: float,
    *,
    period_s: float = 5064.0,
    noise: float = 0.0,
    walk: float = 0.0,
    seed: int = 0,
) -> Drift:
    """0.3 m/s of swing about a line, white noise and a random walk [m/s per sqrt(s)]."""
    t, rng = np.arange(1.0, seconds), np.random.default_rng(seed)
    w = 2 * np.pi / period_s
    v = np.column_stack([0.3 * np.sin(w * t) + 0.1, 0.2 * (1 - np.cos(w * t)) + 1e-5 * t])
    v += noise * rng.standard_normal(v.shape) + walk * np.cumsum(
        rng.standard_normal(v.shape), axis=0
    )
    return drift_of(time_s=t, position_m=np.zeros_like(v), velocity_m_s=v)


def test_expected_period_is_84_4_minutes():
    assert expected_period_s(SITE) / 60 == pytest.approx(84.4, abs=0.1)


@pytest.mark.parametrize("minutes", [70, 90, 240])
def test_closed_form_is_found(minutes):
    fit = fit_schuler(swing(60.0 * minutes, noise=1e-3), SITE)
    assert not fit.reason
    assert MINUTE * fit.period_min == pytest.approx(
        5064.0, abs=max(4 * MINUTE * fit.sigma_period_min, 1.0)
    )
    assert fit.amplitude_m_s == pytest.approx(np.hypot(0.3, 0.2), rel=0.02)


def test_sigma_holds_over_seeds():
    """White noise, then a slow wander: squared error over variance 0.25 to 2.5 over 20 seeds
    (chi-square, 99.9 %: 0.27 to 2.4)."""
    for noise, walk in ((0.02, 0.0), (1e-3, 1e-4)):
        fits = [fit_schuler(swing(7200.0, noise=noise, walk=walk, seed=s), SITE) for s in range(20)]
        ratio = np.mean(
            [((f.period_min - 5064.0 / MINUTE) / f.sigma_period_min) ** 2 for f in fits]
        )
        assert 0.25 < ratio < 2.5


def test_simulated_unit_swings_at_the_schuler_period():
    """0.01 deg/h of the north gyro, a perfect unit, 90 min."""
    run = parked(600.0 + 5400.0).run
    flown = replay(run, choices(flat(x=0.01)), TwinModel()).tables[0]
    fit = fit_schuler(flown.parked, SITE)
    assert fit.period_min == pytest.approx(fit.expected_period_min, rel=0.02)


def test_short_records_and_no_swing_are_refused():
    assert "needed 63 min" in fit_schuler(swing(3000.0), SITE).reason
    assert "needed 63 min" in fit_schuler(None, SITE).reason
    still = swing(7200.0, noise=0.05)
    rng = np.random.default_rng(1)
    quiet = drift_of(
        time_s=still.time_s,
        position_m=still.position_m,
        velocity_m_s=0.05 * rng.standard_normal((7199, 2)),
    )
    refused = fit_schuler(quiet, SITE)
    assert refused.reason and np.isnan(refused.period_min)
