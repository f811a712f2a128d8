"""Covariances of the twin's noise: by hand, and against the simulator's own draws (another
implementation).
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.fft import dct
from scipy.linalg import toeplitz
from scipy.stats import chi2

from ins.records import GyroNoise, TwinModel, VehicleNoise
from ins.units import DEG_PER_HOUR, DEG_PER_SQRT_HOUR
from simreal.evidence.noise_model import ChannelNoise, channel_noises
from simreal.evidence.whitened import BANDS, block_freedom, block_spectrum
from trajectories.simulator import imperfections
from trajectories.simulator.vehicle import sway_velocity

LEVEL = np.eye(3)


def test_white_noise_of_a_mean():
    C = ChannelNoise(white=4.0).covariance(5, 10.0)
    np.testing.assert_allclose(C, 0.4 * np.eye(5))


def test_turn_on_is_common_to_all_bins():
    np.testing.assert_allclose(ChannelNoise(turn_on=9.0).covariance(3, 10.0), np.full((3, 3), 9.0))


def test_random_walk_means_by_hand():
    """Mean of a walk over [a, a + h]: variance K^2 (a + h/3), with a later one K^2 (a + h/2)."""
    C = ChannelNoise(walk=2.0).covariance(3, 6.0)
    assert C[0, 0] == pytest.approx(2.0 * 2.0)
    assert C[1, 1] == pytest.approx(2.0 * 8.0)
    assert C[0, 2] == pytest.approx(2.0 * 3.0)


def test_quantised_angle_has_anticorrelated_neighbours():
    C = ChannelNoise(bounded=1.0).covariance(3, 10.0)
    assert C[0, 0] == pytest.approx(0.02)
    assert C[0, 1] == pytest.approx(-0.01)
    assert C[0, 2] == pytest.approx(0.0)


def test_markov_means_tend_to_the_variance():
    C = ChannelNoise(markov=3.0, markov_tau_s=1e6).covariance(2, 10.0)
    np.testing.assert_allclose(C, 3.0, rtol=1e-4)
    quick = ChannelNoise(markov=3.0, markov_tau_s=0.01).covariance(2, 10.0)
    assert quick[0, 0] == pytest.approx(3.0 * 2 * 0.01 / 10.0, rel=2e-3)  # white of PSD 2 tau var


@pytest.mark.parametrize("kind", ["flicker", "walk", "sway"])
def test_agrees_with_the_simulators_draws(kind):
    """Variance of ten-second means and of their differences over 400 draws, within four sigmas."""
    rng, n, rate = np.random.default_rng(1), 6000, 10.0
    draws = {
        "flicker": lambda: imperfections.flicker(rng, n, instability=1.0, rate_hz=rate),
        "walk": lambda: imperfections.random_walk(rng, n, density=1.0, rate_hz=rate),
        "sway": lambda: (
            np.diff(
                sway_velocity(rng, n + 1, rms_m_s=1.0, frequency_hz=0.28, damping=0.2, rate_hz=rate)
            )
            * rate
        ),
    }[kind]
    noise = ChannelNoise(
        flicker=float(kind == "flicker"),
        walk=float(kind == "walk"),
        sway=float(kind == "sway"),
        sway_w=2 * np.pi * 0.28,
        sway_zeta=0.2,
        run_s=600.0,
    )
    means = np.array([draws().reshape(60, 100).mean(axis=1) for _ in range(400)])
    C = noise.covariance(60, 10.0)
    for W in (np.ones(60) / 60, np.eye(60)[30] - np.eye(60)[29], np.eye(60)[50] - np.eye(60)[5]):
        expected = W @ C @ W
        found = float(np.mean((means @ W) ** 2))
        assert found / expected == pytest.approx(1.0, abs=4.0 * np.sqrt(2.0 / 400) + 0.03)


def test_channels_of_a_twin():
    twin = TwinModel(
        gyro=GyroNoise(arw_deg_sqrt_h=0.01, turn_on_deg_h=0.02), vehicle=VehicleNoise(sway_m_s=0.01)
    )
    x, _, z, ax, _, az = channel_noises(twin, 3600.0, LEVEL)
    assert x.white == pytest.approx((0.01 * DEG_PER_SQRT_HOUR) ** 2)
    assert x.turn_on == pytest.approx((0.02 * DEG_PER_HOUR) ** 2)
    assert z.white > x.white  # the parked heading creeps
    assert (ax.sway, az.sway) == (pytest.approx(1e-4), 0.0)


def test_a_tilted_accelerometer_feels_its_share_of_the_sway():
    tilt = 0.02
    C_nb = np.array([[np.cos(tilt), 0, np.sin(tilt)], [0, 1, 0], [-np.sin(tilt), 0, np.cos(tilt)]])
    az = channel_noises(TwinModel(), 3600.0, C_nb)[5]
    assert az.sway == pytest.approx(np.sin(tilt) ** 2 * TwinModel().vehicle.sway_m_s ** 2)


def test_scatter_of_white_rows_is_chi_square():
    trace, dof = ChannelNoise(white=2.0).scatter(10, 0.1)
    assert trace == pytest.approx(9 * 20.0)
    assert dof == pytest.approx(9.0)


def test_a_line_of_a_fit_scatters_as_a_sine_of_its_amplitude():
    """Rows of a line of dither: half its squared amplitude each; over ten seconds nearly none."""
    hz, dt, swing = 23.0, 0.01, 1e-6
    amplitude = swing * 2.0 * np.sin(np.pi * hz * dt) / dt
    line = {"channel": "gyro_y", "frequency_hz": hz, "amplitude": amplitude, "swing": swing}
    silent = replace(TwinModel(), gyro=GyroNoise(arw_deg_sqrt_h=0.0, bias_instability_deg_h=0.0))
    x, y, *_ = channel_noises(replace(silent, fit={"lines": [line]}), 3600.0, LEVEL)
    assert x.scatter(100, dt)[0] == pytest.approx(0.0, abs=1e-30)
    assert y.scatter(100, dt)[0] == pytest.approx(100 * 0.5 * amplitude**2, rel=0.01)
    assert y.covariance(2, 10.0)[0, 0] < 1e-4 * 0.5 * amplitude**2 + y.turn_on + 1e-10 * y.walk


def test_an_axis_of_a_fit_has_its_own_white_noise_and_quantum():
    twin = replace(TwinModel(), gyro=GyroNoise(quantization_rad=1e-6))
    apart = {"channel": "gyro_z", "white": 4.0, "quantization": 0.25}
    x, _, z, *_ = channel_noises(replace(twin, fit={"axes": [apart]}), 3600.0, LEVEL)
    creep = channel_noises(twin, 3600.0, LEVEL)[2].white - x.white
    assert z.white == pytest.approx(4.0 * x.white + creep)
    assert z.bounded == pytest.approx(0.25 * x.bounded)


@pytest.mark.parametrize("sway", [0.0, 1.0])
def test_band_sums_scatter_as_their_freedom_says(sway):
    """Mean squares of 300 sums over 60 blocks, drawn by the simulator's own oscillator: variance
    2/dof, two-sided.
    """
    sums, blocks, rate = 300, 60, 10.0
    rng = np.random.default_rng(5)
    n = sums * blocks * 10
    v = sway_velocity(
        rng, round(n * rate) + 1, rms_m_s=1.0, frequency_hz=0.28, damping=0.2, rate_hz=rate
    )
    seconds = sway * np.diff(v[:: round(rate)]) + 0.01 * rng.standard_normal(n)
    noise = ChannelNoise(
        white=1e-4, sway=sway, sway_w=2 * np.pi * 0.28, sway_zeta=0.2, run_s=3600.0
    )
    spectrum = dct(seconds.reshape(sums, blocks, 10), axis=2, norm="ortho") ** 2 / block_spectrum(
        noise
    )
    for low, high in BANDS:
        freedom = blocks * block_freedom(noise, low, high)
        seen = spectrum[:, :, low:high].mean(axis=(1, 2))
        assert (
            chi2.ppf(1e-4, sums)
            < np.sum((seen - 1.0) ** 2) * freedom / 2.0
            < chi2.ppf(1 - 1e-4, sums)
        )
        wrong = blocks * (high - low)
        # counted as independent, the slow band would scatter 2.5 times as much as told
        if sway and low == 1:
            assert np.sum((seen - 1.0) ** 2) * wrong / 2.0 > chi2.ppf(1 - 1e-4, sums)


def test_added_noise_adds_variances():
    from ins.errors.base import AddedNoise

    base = ChannelNoise(white=1.0)
    more = base.with_added(AddedNoise("gyro_x", white=2.0), 3.0)
    assert more == replace(base, white=7.0)


def test_rows_of_flicker_scatter_as_its_spectrum_says():
    """Means over 0.1 s of 1 / (2 pi f), two-sided, summed over a fine grid of frequencies."""
    f = np.geomspace(1e-4, 3e3, 200_000)
    power = np.gradient(f) * np.sinc(0.1 * f) ** 2 / (2.0 * np.pi * f)
    r = [2.0 * np.sum(power * np.cos(0.2 * np.pi * f * k)) for k in range(10)]
    C = toeplitz(r)
    by_hand = np.trace(C) - C.mean() * 10
    assert ChannelNoise(flicker=1.0).scatter(10, 0.1)[0] == pytest.approx(by_hand, rel=1e-4)
