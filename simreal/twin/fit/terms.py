"""The noise terms of a parked channel, each of unit variance: its spectrum as sampled means, and
its covariance over any bins.

A channel is a mean rate or a mean specific force over the sampling interval. Frequencies above half
the sampling rate are folded in exactly, or as far as they matter. formats.md, section 3.
"""

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from ins.noise import flicker_covariance, markov_covariance, random_walk_covariance
from simreal.evidence.noise_model import oscillator

FOLDS = 4  # images of the spectrum on either side; the next one holds 1e-3 of white flicker power


class NoiseTerm(StrEnum):
    """What a channel's noise may be made of."""

    WHITE = "white"
    QUANTIZATION = "quantization"
    FLICKER = "flicker"
    WALK = "walk"
    MARKOV = "markov"
    SWAY = "sway"
    CREEP = "creep"


@dataclass(frozen=True, kw_only=True)
class Shape:
    """What the terms do not enter with linearly: the Markov time [s], circular frequency [rad/s]
    and damping of the sway.
    """

    tau_s: float = 100.0
    sway_w: float = 2.0 * np.pi * 0.28
    sway_zeta: float = 0.2


def sampled_psd(term: NoiseTerm, f_hz: NDArray, dt_s: float, shape: Shape) -> NDArray:
    """Two-sided spectrum (k,) of means over dt_s taken every dt_s, for a term of unit variance."""
    half = np.sin(np.pi * f_hz * dt_s)
    if term in (NoiseTerm.WHITE, NoiseTerm.CREEP):
        return np.ones_like(f_hz)
    if term is NoiseTerm.QUANTIZATION:
        return np.asarray(4.0 * half**2 / dt_s)
    if term is NoiseTerm.WALK:
        w = 2.0 * np.pi * f_hz * dt_s
        return np.asarray(dt_s**2 * (2.0 + np.cos(w)) / (12.0 * half**2))
    if term is NoiseTerm.SWAY:
        return np.asarray(4.0 * half**2 / dt_s * _sampled_oscillator(f_hz, dt_s, shape))
    images = f_hz[:, None] + np.arange(-FOLDS, FOLDS + 1) / dt_s
    if term is NoiseTerm.FLICKER:
        density = 1.0 / (2.0 * np.pi * np.abs(images))
    else:
        density = 2.0 * shape.tau_s / (1.0 + (2.0 * np.pi * images * shape.tau_s) ** 2)
    return np.asarray((density * np.sinc(images * dt_s) ** 2).sum(axis=1))


def _sampled_oscillator(f_hz: NDArray, dt_s: float, shape: Shape) -> NDArray:
    """Sum over all lags of the velocity's autocorrelation: r(k) = Re(c p^k), a geometric series."""
    zeta = min(shape.sway_zeta, 0.999)
    damped = np.sqrt(1.0 - zeta**2)
    c = 1.0 + 1j * zeta / damped
    p = np.exp((-zeta + 1j * damped) * shape.sway_w * dt_s)
    cosine = np.cos(2.0 * np.pi * f_hz * dt_s)
    return np.asarray(np.real(c * (1.0 - p**2) / (1.0 - 2.0 * p * cosine + p**2)))


def sway_folded(f_hz: NDArray, dt_s: float, shape: Shape) -> NDArray:
    """Share (k,) of the sway's spectrum at f_hz, of means over dt_s, that folds there from above
    half the sampling rate.
    """
    w, at = 2.0 * np.pi * f_hz, shape.sway_w
    resonance = (at**2 - w**2) ** 2 + (2.0 * shape.sway_zeta * at * w) ** 2
    velocity = 4.0 * shape.sway_zeta * at * w**2 / resonance
    own = 4.0 * np.sin(np.pi * f_hz * dt_s) ** 2 / dt_s**2 * velocity
    return np.asarray(np.clip(1.0 - own / sampled_psd(NoiseTerm.SWAY, f_hz, dt_s, shape), 0.0, 1.0))


def bin_covariance(
    term: NoiseTerm, start_s: NDArray, end_s: NDArray, shape: Shape, *, run_s: float
) -> NDArray:
    """Covariance (n, n) of means over bins, up to a constant that the fit takes out; run_s: length
    of the run, whose quarter of a cycle is the lowest frequency of flicker.
    """
    if term in (NoiseTerm.WHITE, NoiseTerm.CREEP):
        return np.diag(1.0 / (end_s - start_s))
    if term is NoiseTerm.FLICKER:
        return flicker_covariance(start_s, end_s, lowest_hz=0.25 / run_s)
    if term is NoiseTerm.WALK:
        return random_walk_covariance(start_s, end_s)
    if term is NoiseTerm.MARKOV:
        return markov_covariance(start_s, end_s, tau_s=shape.tau_s)

    def bounded(a: NDArray, b: NDArray) -> NDArray:
        lag = np.abs(a[:, None] - b[None, :])
        if term is NoiseTerm.QUANTIZATION:
            return np.asarray(lag < 1e-6, dtype=float)
        return oscillator(lag, shape.sway_w, shape.sway_zeta)

    total = bounded(end_s, end_s) + bounded(start_s, start_s)
    total -= bounded(start_s, end_s) + bounded(end_s, start_s)
    seconds = end_s - start_s
    return np.asarray(total / np.outer(seconds, seconds))
