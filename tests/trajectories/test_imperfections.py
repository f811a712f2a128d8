"""Noise terms as formats.md section 3 defines them: two-sided bounds, allantools and Welch as
outside judges.
"""

import numpy as np
import pytest
from scipy import signal, stats

from ins.records import (
    AccelNoise,
    GnssLog,
    GnssNoise,
    GyroNoise,
    OdometerLog,
    OdometerNoise,
    TemperatureNoise,
)
from ins.units import DEG, DEG_PER_HOUR, DEG_PER_SQRT_HOUR, MICRO_G
from trajectories.simulator.imperfections import (
    SLOW_RATE_HZ,
    accel_output,
    accel_session_bias,
    flicker,
    gnss_output,
    gyro_output,
    gyro_session_bias,
    is_quick,
    odometer_output,
    quick_flicker,
    random_walk,
    thermometer,
)

SILENT = dict.fromkeys(
    ("arw_deg_sqrt_h", "bias_instability_deg_h", "rate_random_walk_deg_h_sqrt_h", "turn_on_deg_h"),
    0.0,
)
FALSE_ALARM = 1e-4


def assert_variance(samples, sigma):
    """Chi-square, two-sided."""
    n = np.size(samples)
    low, high = stats.chi2.ppf([FALSE_ALARM / 2, 1 - FALSE_ALARM / 2], n) / n
    assert low < np.mean(np.square(samples)) / sigma**2 < high


@pytest.mark.parametrize("rate_hz", [10.0, 100.0])
def test_random_walk_of_angle_and_velocity(rate_hz):
    """An increment over dt has sigma N sqrt(dt)."""
    rng, zeros, dt = np.random.default_rng(1), np.zeros((30_000, 3)), 1 / rate_hz
    gyro = gyro_output(rng, zeros, zeros, GyroNoise(**{**SILENT, "arw_deg_sqrt_h": 0.002}), dt_s=dt)
    assert_variance(gyro, 0.002 * DEG_PER_SQRT_HOUR * np.sqrt(dt))
    accel = accel_output(rng, zeros, zeros, AccelNoise(vrw_ug_sqrt_hz=10.0), dt_s=dt)
    assert_variance(accel, 10.0 * MICRO_G * np.sqrt(dt))


def test_flicker_has_its_spectrum():
    """Two-sided PSD B^2 / (2 pi f): Welch twice that, within 4 % in every octave over 200 draws."""
    rate, n, B = 10.0, 8192, 0.002
    rng = np.random.default_rng(2)
    draws = np.stack([flicker(rng, n, instability=B, rate_hz=rate) for _ in range(200)])
    f, power = signal.welch(draws, fs=rate, nperseg=2048, detrend="linear")
    ratio = np.mean(power, axis=0)[1:] / (B**2 / (np.pi * f[1:]))
    octaves = [np.mean(ratio[(f[1:] >= a) & (f[1:] < 2 * a)]) for a in 0.04 * 2.0 ** np.arange(6)]
    np.testing.assert_allclose(octaves, 1.0, atol=0.04)


def test_flicker_reaches_down_to_a_quarter_of_the_run():
    """Variance of the mean over the run: all power between 1/(4T) and 1/T is in, none below (closed
    form by sum).
    """
    n, rate, B = 1000, 10.0, 1.0
    rng = np.random.default_rng(3)
    means = [np.mean(flicker(rng, n, instability=B, rate_hz=rate)) for _ in range(4000)]
    f = np.arange(1, 2 * n + 1) * rate / (4 * n)
    window = (np.sin(np.pi * f * n / rate) / (n * np.sin(np.pi * f / rate))) ** 2
    expected = np.sum(2 * B**2 / (2 * np.pi * f) * window) * rate / (4 * n)
    assert_variance(means, np.sqrt(expected))


def test_flicker_has_its_allan_floor():
    """sqrt(2 ln2 / pi) B = 0.664 B, flat over a decade; judged by allantools."""
    allantools = pytest.importorskip("allantools")
    rate, B = 1.0, 0.002
    rng = np.random.default_rng(4)
    floors = []
    for _ in range(30):
        noise = flicker(rng, 16_384, instability=B, rate_hz=rate)
        _, deviation, _, _ = allantools.oadev(
            noise, rate=rate, data_type="freq", taus=[32.0, 100.0, 320.0]
        )
        floors.append(deviation**2)
    np.testing.assert_allclose(np.sqrt(np.mean(floors, axis=0)) / B, 0.664, rtol=0.05)


def test_rate_random_walk_grows_by_k_squared_a_second():
    rng = np.random.default_rng(5)
    ends = np.array(
        [
            random_walk(rng, 3601, density=0.002 / 60, rate_hz=1.0)[[0, 900, 3600]]
            for _ in range(3000)
        ]
    )
    assert not ends[:, 0].any()
    assert_variance(ends[:, 1], 0.002 * np.sqrt(0.25))
    assert_variance(ends[:, 2], 0.002)


def test_session_biases_walk_by_their_coefficient_in_an_hour():
    rng = np.random.default_rng(15)
    gyro = GyroNoise(**{**SILENT, "rate_random_walk_deg_h_sqrt_h": 0.002})
    accel = AccelNoise(
        bias_ug=(0.0, 0.0, 0.0),
        turn_on_ug=0.0,
        bias_instability_ug=0.0,
        rate_random_walk_ug_sqrt_h=3.0,
    )
    draws = {
        0.002: [gyro_session_bias(rng, gyro, 361, rate_hz=0.1)[-1] for _ in range(300)],
        3.0: [accel_session_bias(rng, accel, 361, rate_hz=0.1)[-1] for _ in range(300)],
    }
    for sigma, ends in draws.items():
        assert_variance(ends, sigma)


def test_session_biases_take_turn_on_and_the_nominal_bias():
    rng = np.random.default_rng(6)
    turn_on = GyroNoise(**{**SILENT, "turn_on_deg_h": 0.003})
    gyro = [gyro_session_bias(rng, turn_on, 5, rate_hz=10.0) for _ in range(1000)]
    assert np.ptp(gyro, axis=1).max() == 0
    assert_variance(np.array(gyro)[:, 0], 0.003)
    noise = AccelNoise(
        bias_ug=(10.0, -20.0, 5.0), bias_instability_ug=0.0, rate_random_walk_ug_sqrt_h=0.0
    )
    accel = np.array([accel_session_bias(rng, noise, 5, rate_hz=10.0)[0] for _ in range(1000)])
    assert_variance(accel - [10.0, -20.0, 5.0], 30.0)
    assert np.abs(np.corrcoef(accel.T)[0, 1]) < 0.15  # one constant an axis


def test_bias_scale_and_misalignment_enter_with_their_signs():
    """Bias adds to the reading; misalignment xy is the sensitivity of gyro x to rate about y."""
    noise = GyroNoise(
        **SILENT,
        scale_factor_ppm=(100.0, 0.0, -50.0),
        misalignment_mrad=(1.0, 2.0, 3.0, 4.0, 5.0, 6.0),
    )
    true = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    bias = np.full((3, 3), 0.01)
    read = (
        gyro_output(np.random.default_rng(8), true, bias, noise, dt_s=0.1)
        - 0.01 * DEG_PER_HOUR * 0.1
    )
    expected = [[1.0001, 1e-3, 2e-3], [3e-3, 1.0, 4e-3], [5e-3, 6e-3, 0.99995]]
    np.testing.assert_allclose(read.T, expected, atol=1e-15)
    accel = accel_output(
        np.random.default_rng(8), 0 * true, 100 + 0 * true, AccelNoise(vrw_ug_sqrt_hz=0.0), dt_s=0.1
    )
    np.testing.assert_allclose(accel, 100e-6 * 9.80665 * 0.1)


def test_quantization_is_of_the_accumulated_angle():
    quantum = 1e-6
    true = np.abs(np.random.default_rng(9).normal(3e-7, 1e-7, (20_000, 3)))
    read = gyro_output(
        np.random.default_rng(9),
        true,
        0 * true,
        GyroNoise(**SILENT, quantization_rad=quantum),
        dt_s=0.01,
    )
    np.testing.assert_allclose(read / quantum, np.round(read / quantum), atol=1e-6)
    error = np.cumsum(read, axis=0) - np.cumsum(true, axis=0)
    assert np.max(np.abs(error)) <= quantum / 2 * (1 + 1e-6)
    assert np.std(error) == pytest.approx(quantum / np.sqrt(12), rel=0.03)


def test_flicker_has_its_spectrum_beyond_the_slow_rate():
    """Nodes at 10 Hz with lines between, and what they lack: from 0.5 to 40 Hz within 5 % of the
    means of B^2 / (2 pi f) over rows, where lines alone have 1e-2 of it (300 degrees of freedom).
    """
    n, rate, slow = 20_000, 100.0, SLOW_RATE_HZ
    power = 0.0
    rng = np.random.default_rng(12)
    for _ in range(8):
        nodes = flicker(rng, int(n / rate * slow) + 1, instability=1.0, rate_hz=slow)
        lines = np.interp((np.arange(n) + 0.5) / rate, np.arange(nodes.size) / slow, nodes)
        made = lines + quick_flicker(rng, n, instability=1.0, rate_hz=rate)
        taper = np.hanning(n)
        spectrum = np.abs(np.fft.rfft((made - made.mean()) * taper)) ** 2
        power = power + spectrum / rate / np.sum(taper**2) / 8
    f = np.fft.rfftfreq(n, 1 / rate)
    for low, high in ((0.5, 2), (2, 4), (4, 7), (7, 12), (12, 20), (20, 40)):
        inside = (f >= low) & (f < high)
        images = np.abs(f[inside][:, None] + rate * np.arange(-1, 2))
        means = np.sum(np.sinc(images / rate) ** 2 / images, axis=1) / (2 * np.pi)
        assert np.mean(power[inside] / means) == pytest.approx(1.0, abs=0.07)
    assert is_quick(10.0, 18.0) and not is_quick(0.002, 0.12)


def test_thermometer_is_noise_then_rounding():
    true = np.full(20_000, 20.0)
    fine = thermometer(
        np.random.default_rng(10), true, TemperatureNoise(noise_degC=0.05, resolution_degC=0.0)
    )
    assert_variance(fine - 20.0, 0.05)
    coarse = thermometer(
        np.random.default_rng(10), true + 0.3, TemperatureNoise(noise_degC=0.0, resolution_degC=1.0)
    )
    assert set(coarse) == {20.0}
    both = thermometer(
        np.random.default_rng(10), true, TemperatureNoise(noise_degC=0.05, resolution_degC=0.01)
    )
    np.testing.assert_allclose(both, np.round(both, 2), atol=1e-12)
    assert_variance(both - 20.0, np.sqrt(0.05**2 + 0.01**2 / 12))


def test_gnss_and_odometer_sigmas():
    n, rng = 6000, np.random.default_rng(11)
    lat, height = np.full(n, 45 * DEG), np.full(n, 250.0)
    true = GnssLog(
        time_s=np.arange(n), lat_rad=lat, lon_rad=0 * lat, height_m=height, v_n_m_s=np.zeros((n, 3))
    )
    fix = gnss_output(rng, true, GnssNoise())
    assert_variance((fix.lat_rad - lat) * (6_367_382 + 250), 0.5)  # meridian radius at 45 deg
    assert_variance(fix.lon_rad * (6_388_838 + 250) * np.cos(45 * DEG), 0.5)
    assert_variance(fix.height_m - 250.0, 0.75)
    assert_variance(fix.v_n_m_s, 0.03)
    assert set(fix.sigma_velocity_m_s) == {0.03} and set(fix.sigma_horizontal_m) == {0.5}
    rolled = OdometerLog(time_s=np.arange(n), speed_m_s=np.full(n, 10.0))
    read = odometer_output(rng, rolled, OdometerNoise(scale_ppm=500.0, noise_m_s=0.01))
    assert_variance(read.speed_m_s - 10.005, 0.01)
