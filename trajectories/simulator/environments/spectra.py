"""Published one-sided power spectra [unit^2/Hz], and random series that have them.

A series is a Fourier sum with Gaussian coefficients over the whole grid: a function of time with
all derivatives, stationary, and as long in memory as its spectrum says. Shinozuka & Deodatis
(1991), "Simulation of stochastic processes by spectral representation".
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from trajectories.simulator.environments.scene import Scene

Spectrum = Callable[[NDArray], NDArray]
FOOT_M = 0.3048


def gaussian(scene: Scene, spectrum: Spectrum, rng: np.random.Generator) -> NDArray:
    """A stationary series (J,) of this spectrum, of mean zero."""
    f = scene.frequency_hz
    count = scene.time_s.size
    power = np.zeros(f.size)
    power[1:] = spectrum(f[1:])
    # variance power * df falls in equal shares on a cosine and a sine
    size = 0.5 * count * np.sqrt(power / (count * scene.dt_s))
    draws = rng.standard_normal((2, f.size))
    return np.fft.irfft(size * (draws[0] + 1j * draws[1]), count)


def gust_scales(wind_20ft_m_s: float, height_m: float) -> tuple[float, float, float, float]:
    """Sigma and length along and across the wind [m/s, m], then upward, near the ground.

    Source: MIL-F-8785C (1980), 3.7.3.4 (low-altitude model).
    """
    height_ft = height_m / FOOT_M
    slope = 0.177 + 0.000823 * height_ft
    sigma_w = 0.1 * wind_20ft_m_s
    return sigma_w / slope**0.4, FOOT_M * height_ft / slope**1.2, sigma_w, height_m


def von_karman_along(f: NDArray, *, sigma: float, length_m: float, speed_m_s: float) -> NDArray:
    """Gusts along the wind at a fixed point.  Source: ESDU 85020 (1985); MIL-HDBK-1797 (1997)."""
    n = f * length_m / speed_m_s
    return 4 * sigma**2 * length_m / speed_m_s / (1 + 70.8 * n**2) ** (5 / 6)


def von_karman_across(f: NDArray, *, sigma: float, length_m: float, speed_m_s: float) -> NDArray:
    """Gusts across the wind and upward; `length_m` is half of that along.  Source: the same."""
    n = f * length_m / speed_m_s
    shape = (1 + 755.2 * n**2) / (1 + 283.2 * n**2) ** (11 / 6)
    return 4 * sigma**2 * length_m / speed_m_s * shape


def gust_share(f: NDArray, *, area_m2: float, speed_m_s: float) -> NDArray:
    """Share of the gusts' power that a surface feels at once.  Source: Vickery (1966)."""
    return 1 / (1 + (2 * f * np.sqrt(area_m2) / speed_m_s) ** (4 / 3)) ** 2


def jonswap(f: NDArray, *, height_m: float, peak_s: float, gamma: float = 3.3) -> NDArray:
    """Wave elevation [m^2/Hz] of a significant height; scaled on the grid given to that height.

    Source: Hasselmann et al. (1973).
    """
    peak_hz = 1 / peak_s
    width = np.where(f <= peak_hz, 0.07, 0.09)
    bump = gamma ** np.exp(-((f - peak_hz) ** 2) / (2 * (width * peak_hz) ** 2))
    shape = f**-5.0 * np.exp(-1.25 * (peak_hz / f) ** 4) * bump
    return shape * (height_m / 4) ** 2 / (shape.sum() * (f[1] - f[0]))


def resonance(f: NDArray, *, rms: float, peak_hz: float, damping: float) -> NDArray:
    """A motion of this RMS under a force that is white about its own frequency.

    Source: Crandall & Mark (1963), chapter 2 (white force: rms^2 = pi f S / (4 damping)).
    """
    ratio = f / peak_hz
    shape = 1 / ((1 - ratio**2) ** 2 + (2 * damping * ratio) ** 2)
    return rms**2 * 4 * damping / (np.pi * peak_hz) * shape


def band(f: NDArray, *, rms: float, low_hz: float, high_hz: float) -> NDArray:
    """Even between two frequencies, falling by the fourth power outside."""
    shape = 1 / (1 + (low_hz / f) ** 4) / (1 + (f / high_hz) ** 4)
    return rms**2 * shape / (shape.sum() * (f[1] - f[0]))
