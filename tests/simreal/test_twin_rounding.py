"""Counts: the grid is found, the spectrum of rounding is that of rounded sums, and the noise
beneath is told, or said to be hidden.
"""

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

import recal
from ins.twin_file import default_twin
from simreal.twin.fit.rounding import LAGS, Rounding, grid_of
from simreal.twin.reasons import Why

QUANTUM = 1.234567e-7


@lru_cache
def parked():
    """Twenty minutes at rest."""
    run = recal.simulate("parked_only", seed=6, rate_hz=20).run
    return replace(run, imu=run.imu.between(run.imu.start_s, run.imu.start_s + 1200.0), phases=())


def counted(run, quantum, *, sums):
    """A run whose gyros count in steps: of their sums, or of each row."""
    imu = run.imu.whole()
    if sums:
        total = quantum * np.round(np.cumsum(imu.dtheta_rad, axis=0) / quantum)
        rows = np.diff(total, axis=0, prepend=np.zeros((1, 3)))
    else:
        rows = quantum * np.round(imu.dtheta_rad / quantum)
    return replace(run, imu=replace(imu, dtheta_rad=rows))


@pytest.mark.parametrize("scale", [0.2, 1.0, 100.0])
def test_counts_lie_on_a_grid_and_noise_on_none(scale):
    rng = np.random.default_rng(1)
    rows = QUANTUM * (scale * rng.standard_normal(5000) + 0.13)
    counts = np.diff(QUANTUM * np.round(np.cumsum(rows) / QUANTUM), prepend=0.0)
    assert grid_of(counts) == pytest.approx(QUANTUM, rel=1e-9)
    assert grid_of(counts.astype(np.float32).astype(float)) == pytest.approx(QUANTUM, rel=1e-6)
    assert grid_of(rows) == 0.0


@pytest.mark.parametrize(("sigma", "mean"), [(1 / 3, 0.13), (1 / 5, 0.3), (1 / 10, 0.07)])
def test_the_spectrum_of_rounding_is_that_of_rounded_sums(sigma, mean):
    """300 windows of a sum in steps of 1: power in five bands within 3 % (4 sigma of the least)."""
    rng, n, dt = np.random.default_rng(2), 1000, 0.01
    steps = sigma * rng.standard_normal((300, n + 1)) + mean
    sums = np.round(np.cumsum(steps, axis=1) + rng.uniform(size=(300, 1)))
    rates = np.diff(sums, axis=1) / dt
    taper = np.hanning(n + 1)[:n]
    rates -= rates.mean(axis=1)[:, None]
    power = np.mean(np.abs(np.fft.rfft(rates * taper, axis=1)) ** 2, axis=0) * dt / np.sum(taper**2)
    f = np.fft.rfftfreq(n, dt)
    white = sigma**2 / dt
    colour = Rounding(1.0, mean / dt).colour(f, dt, white * dt * np.arange(LAGS + 1))
    expected = white + 4.0 * np.sin(np.pi * f * dt) ** 2 / dt / 12.0 * colour
    for low, high in ((2, 8), (8, 16), (16, 28), (28, 40), (40, 50)):
        inside = (f >= low) & (f < high)
        assert power[inside].mean() == pytest.approx(expected[inside].mean(), rel=0.03)


def test_a_quantum_far_above_the_noise_is_exact_and_the_noise_beneath_is_told():
    true = default_twin("rlg").gyro.arw_deg_sqrt_h
    row_rad = np.deg2rad(true) / 60.0 / np.sqrt(20.0)
    found = recal.fit_twin(counted(parked(), 20.0 * row_rad, sums=True))
    told = {p.name: p for p in found.parameters}
    quantum, white = told["gyro.quantization_rad"], told["gyro.arw_deg_sqrt_h"]
    assert quantum.identified and quantum.value == pytest.approx(20.0 * row_rad, rel=1e-6)
    assert white.identified and abs(white.value - true) < 4.0 * white.sigma
    assert white.sigma < 0.1 * true


def test_noise_that_rounded_rows_hide_is_not_told():
    row_rad = np.deg2rad(default_twin("rlg").gyro.arw_deg_sqrt_h) / 60.0 / np.sqrt(20.0)
    found = recal.fit_twin(counted(parked(), 6.0 * row_rad, sums=False))
    told = {p.name: p for p in found.parameters}
    for name in ("gyro.arw_deg_sqrt_h", "gyro.quantization_rad"):
        assert not told[name].identified and told[name].why is Why.ROUNDED
    assert told["accel.vrw_ug_sqrt_hz"].identified
    assert found.twin.gyro.arw_deg_sqrt_h == 0.002
