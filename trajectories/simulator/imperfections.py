"""Sensor imperfections as formats.md section 3 defines them, written apart from the estimator; rng
passed in.

Slow errors (flicker, rate random walk, turn-on) are made at SLOW_RATE_HZ and interpolated between;
what a large flicker has beyond that (`quick_flicker`) is added at the rows. formats.md, section 3.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ins.earth import radii_of_curvature
from ins.records import (
    AccelNoise,
    GnssLog,
    GnssNoise,
    GyroNoise,
    OdometerLog,
    OdometerNoise,
    TemperatureNoise,
)
from ins.units import DEG_PER_HOUR, DEG_PER_SQRT_HOUR, MICRO_G, MILLIRADIAN, PPM

SLOW_RATE_HZ = 10.0  # of slow errors; what a flicker has above 5 Hz is made apart
# of the white noise in power, at half of SLOW_RATE_HZ: a smaller flicker is not made above that. In
# an hour of three axes 1e-3 of 2 to 10 Hz is 0.3 sigmas.
QUICK_SHARE = 1e-3


def flicker(rng: np.random.Generator, n: int, *, instability: float, rate_hz: float) -> NDArray:
    """Bias instability B, shape (n,): two-sided PSD B^2 / (2 pi f) from 1/(4 x run length) to half
    the rate.

    Drawn in the frequency domain over four run lengths, of which the first is kept. Allan floor
    sqrt(2 ln2 / pi) B. Source: IEEE Std 952-1997, annex C (eq. C.14).
    """
    if instability == 0:
        return np.zeros(n)
    m = 4 * n
    f = np.fft.rfftfreq(m, 1 / rate_hz)[1:]
    sigma = np.sqrt(instability**2 / (2 * np.pi * f) * m * rate_hz / 2)
    spectrum = np.zeros(m // 2 + 1, dtype=complex)
    spectrum[1:] = sigma * (rng.standard_normal(f.size) + 1j * rng.standard_normal(f.size))
    return np.fft.irfft(spectrum, m)[:n]


def quick_flicker(
    rng: np.random.Generator, n: int, *, instability: float, rate_hz: float
) -> NDArray:
    """What the means of flicker over rows have and a flicker drawn at SLOW_RATE_HZ with straight
    lines between has not, shape (n,).

    The spectrum of such lines is that of their nodes, repeated every SLOW_RATE_HZ, times sinc^4;
    that of the means has its images folded in.
    """
    f = np.fft.rfftfreq(n, 1 / rate_hz)[1:]
    images = np.abs(f[:, None] + rate_hz * np.arange(-2, 3))
    means = np.sum(np.sinc(images / rate_hz) ** 2 / images, axis=1)
    of_nodes = np.abs((f + 0.5 * SLOW_RATE_HZ) % SLOW_RATE_HZ - 0.5 * SLOW_RATE_HZ)
    held = np.sinc(f / SLOW_RATE_HZ) ** 4 / np.maximum(of_nodes, f[0])
    psd = instability**2 / (2 * np.pi) * np.maximum(means - held, 0.0)
    sigma = np.sqrt(psd * n * rate_hz / 2)
    spectrum = np.zeros(n // 2 + 1, dtype=complex)
    spectrum[1:] = sigma * (rng.standard_normal(f.size) + 1j * rng.standard_normal(f.size))
    return np.fft.irfft(spectrum, n)


def is_quick(instability: float, white: float) -> bool:
    """Whether flicker B [unit] shows beyond the slow rate beside white noise N [unit sqrt(s)]."""
    return instability**2 / (np.pi * SLOW_RATE_HZ) > QUICK_SHARE * white**2


def random_walk(rng: np.random.Generator, n: int, *, density: float, rate_hz: float) -> NDArray:
    """A walk from 0 whose variance grows by density^2 a second, shape (n,)."""
    steps = density / np.sqrt(rate_hz) * rng.standard_normal(n)
    steps[0] = 0.0
    return np.cumsum(steps)


def gyro_session_bias(
    rng: np.random.Generator, noise: GyroNoise, n: int, *, rate_hz: float
) -> NDArray:
    """Turn-on, flicker and rate random walk of three gyros at k / rate_hz, (n, 3) [deg/h]; without
    the thermal bias.
    """
    return _session_bias(
        rng,
        n,
        rate_hz=rate_hz,
        turn_on=noise.turn_on_deg_h,
        instability=noise.bias_instability_deg_h,
        walk=noise.rate_random_walk_deg_h_sqrt_h / 60.0,
    )


def accel_session_bias(
    rng: np.random.Generator, noise: AccelNoise, n: int, *, rate_hz: float
) -> NDArray:
    """Nominal bias, turn-on, flicker and rate random walk of three accelerometers at k / rate_hz,
    (n, 3) [micro-g].
    """
    return np.asarray(noise.bias_ug) + _session_bias(
        rng,
        n,
        rate_hz=rate_hz,
        turn_on=noise.turn_on_ug,
        instability=noise.bias_instability_ug,
        walk=noise.rate_random_walk_ug_sqrt_h / 60.0,
    )


def _session_bias(
    rng: np.random.Generator,
    n: int,
    *,
    rate_hz: float,
    turn_on: float,
    instability: float,
    walk: float,
) -> NDArray:
    axes = [
        turn_on * rng.standard_normal()
        + flicker(rng, n, instability=instability, rate_hz=rate_hz)
        + random_walk(rng, n, density=walk, rate_hz=rate_hz)
        for _ in range(3)
    ]
    return np.stack(axes, axis=-1)


def gyro_output(
    rng: np.random.Generator,
    dtheta_rad: NDArray,
    bias_deg_h: NDArray,
    noise: GyroNoise,
    *,
    dt_s: float | NDArray,
) -> NDArray:
    """Measured increments (n, 3): scale factor and misalignment, bias, angle random walk, then
    quantised angle.

    dt_s: of all rows, or of each (n, 1).
    """
    white = (
        noise.arw_deg_sqrt_h
        * DEG_PER_SQRT_HOUR
        * np.sqrt(dt_s)
        * rng.standard_normal(dtheta_rad.shape)
    )
    measured = dtheta_rad @ sensitivity(noise.scale_factor_ppm, noise.misalignment_mrad).T
    measured += bias_deg_h * (DEG_PER_HOUR * dt_s) + white
    return _quantised(measured, noise.quantization_rad)


def accel_output(
    rng: np.random.Generator,
    dv_m_s: NDArray,
    bias_ug: NDArray,
    noise: AccelNoise,
    *,
    dt_s: float | NDArray,
) -> NDArray:
    """Measured velocity increments (n, 3): bias and velocity random walk, then quantised velocity.
    dt_s: of all rows, or of each (n, 1).
    """
    white = noise.vrw_ug_sqrt_hz * MICRO_G * np.sqrt(dt_s) * rng.standard_normal(dv_m_s.shape)
    return _quantised(dv_m_s + bias_ug * (MICRO_G * dt_s) + white, noise.quantization_m_s)


def sensitivity(scale_factor_ppm: Sequence[float], misalignment_mrad: Sequence[float]) -> NDArray:
    """Matrix from true to measured rate; misalignment [xy, xz, yx, yz, zx, zy]: of gyro i to rate
    about j.
    """
    M = np.diag(1.0 + np.asarray(scale_factor_ppm) * PPM)
    M[[0, 0, 1, 1, 2, 2], [1, 2, 0, 2, 0, 1]] = np.asarray(misalignment_mrad) * MILLIRADIAN
    return M


def _quantised(increments: NDArray, quantum: float) -> NDArray:
    """Increments of the accumulated angle or velocity rounded to whole quanta."""
    if not quantum:
        return increments
    total = quantum * np.round(np.cumsum(increments, axis=0) / quantum)
    return np.diff(total, axis=0, prepend=np.zeros((1, 3)))


def thermometer(rng: np.random.Generator, true_degC: NDArray, noise: TemperatureNoise) -> NDArray:
    """Readings of any shape: white noise, then rounding to the resolution."""
    read = true_degC + noise.noise_degC * rng.standard_normal(true_degC.shape)
    return (
        noise.resolution_degC * np.round(read / noise.resolution_degC)
        if noise.resolution_degC
        else read
    )


def gnss_output(rng: np.random.Generator, true: GnssLog, noise: GnssNoise) -> GnssLog:
    """Fixes with white errors; horizontal sigma for each of north and east, velocity sigma for all
    three axes.
    """
    n = true.time_s.size
    north, east = noise.sigma_horizontal_m * rng.standard_normal((2, n))
    meridian, transverse = radii_of_curvature(true.lat_rad)
    return GnssLog(
        time_s=true.time_s,
        lat_rad=true.lat_rad + north / (meridian + true.height_m),
        lon_rad=true.lon_rad + east / ((transverse + true.height_m) * np.cos(true.lat_rad)),
        height_m=true.height_m + noise.sigma_vertical_m * rng.standard_normal(n),
        v_n_m_s=true.v_n_m_s + noise.sigma_velocity_m_s * rng.standard_normal((n, 3)),
        sigma_horizontal_m=np.full(n, noise.sigma_horizontal_m),
        sigma_vertical_m=np.full(n, noise.sigma_vertical_m),
        sigma_velocity_m_s=np.full(n, noise.sigma_velocity_m_s),
    )


def odometer_output(
    rng: np.random.Generator, true: OdometerLog, noise: OdometerNoise
) -> OdometerLog:
    """Speeds with scale error and white noise."""
    white = noise.noise_m_s * rng.standard_normal(true.time_s.size)
    return OdometerLog(
        time_s=true.time_s, speed_m_s=true.speed_m_s * (1 + noise.scale_ppm * PPM) + white
    )
