"""Rates of a unit that sways: its spectrum gives the covariance of their means."""

import numpy as np

from alignment.motion.parked_seconds import ParkedSeconds, averages, sway_of
from ins.units import DEG_PER_HOUR

SECONDS, BIN_S = 3600, 120.0


def rocked(rng, rms_deg, period_s, damping, white_deg_h=9.0):
    """Seconds of a unit that rolls as a damped oscillator driven by noise, simulated at 10 Hz."""
    w, dt, count = 2 * np.pi / period_s, 0.1, SECONDS * 10
    push = rng.standard_normal(count + 5000) * rms_deg * np.sqrt(4 * damping * w**3 / dt)
    angle, speed, angles = 0.0, 0.0, []
    for force in push:
        speed += dt * (force - 2 * damping * w * speed - w**2 * angle)
        angle += dt * speed
        angles.append(angle)
    turned = np.diff(np.array(angles)[4999::10][: SECONDS + 1]) * 3600.0
    rate = np.zeros((SECONDS, 3))
    rate[:, 0] = turned
    rate += white_deg_h * rng.standard_normal(rate.shape)
    sums = np.concatenate([np.zeros((SECONDS, 3)), rate * DEG_PER_HOUR], axis=1)
    start = np.arange(SECONDS, dtype=float)
    return ParkedSeconds(start, start + 1.0, sums, np.ones(SECONDS, bool)), rate


def bins():
    edges = np.arange(0.0, SECONDS + 1.0, BIN_S)
    return edges[:-1], edges[1:]


def test_a_quiet_unit_does_not_sway():
    for seed in range(5):
        seconds, _ = rocked(np.random.default_rng(seed), 0.0, 12.0, 0.1)
        assert sway_of(seconds) is None


def test_means_of_a_rolling_unit_scatter_as_the_spectrum_says():
    """Six logs, 30 means each: squared mean over variance 0.6 to 1.5; as white noise of the same
    seconds it would be below a fifth.
    """
    squares, as_white = [], []
    for seed in range(6):
        seconds, rate = rocked(np.random.default_rng(seed), 0.4, 12.0, 0.08)
        sway = sway_of(seconds)
        A = averages(seconds, *bins())
        R = sway.covariance(A, 0)
        means = A @ rate[:, 0]
        squares += list(means**2 / np.diag(R))
        as_white += list(means**2 / (np.var(rate[:, 0]) / BIN_S))
    assert 0.6 < np.mean(squares) < 1.5
    assert np.mean(as_white) < 0.2


def test_an_axis_that_does_not_roll_keeps_its_noise():
    seconds, _ = rocked(np.random.default_rng(3), 0.4, 12.0, 0.08)
    R = sway_of(seconds).covariance(averages(seconds, *bins()), 1)
    assert 0.5 * 81.0 < np.mean(np.diag(R)) * BIN_S < 2.0 * 81.0
