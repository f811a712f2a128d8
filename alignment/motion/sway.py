"""Rates of a parked unit that sways slowly (a moored ship): noise with a spectrum, not white noise.

A roll of half a degree in twelve seconds turns a unit by 0.2 deg/s, a hundred times the noise of a
MEMS gyro over a second, and by next to nothing in ten minutes: an angle that comes back adds up to
no rate. As white noise it would hide the bias; as what it is it costs the mean over an hour a
degree an hour at most. The spectrum of the rates' seconds tells the two apart: what it says of the
means over bins is::

    cov(i, j) = sum over f of S(f) Re(a_i(f) conj(a_j(f))) df

with a_i the Fourier transform of what bin i averages, S two-sided. Below the lowest frequency that
the log resolves S goes on flat, where the wander of a bias, which the prior of the bins has, is
counted once more: on the safe side.

Source: Welch (1967); Percival and Walden, "Spectral Analysis for Physical Applications" (1993),
section 6.17. Pinned by: tests/alignment/test_sway.py
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from alignment.motion.parked_seconds import ParkedSeconds
from ins.units import DEG_PER_HOUR, HOUR

SEGMENT_S = 600  # of the spectrum: swings of a minute and a half stand apart from the bias's wander
PIECES = 4  # a stretch of less than so many segments is cut into so many
SHORTEST_SEGMENT_S = 30  # of two or three swells
FROM_TREND = 2  # lowest frequencies that a segment's own trend reaches
SMOOTH = 3  # neighbouring frequencies that are averaged
# of the median power: white noise does not reach it (chi-square of 12 degrees of freedom beyond
# eight medians: 3e-14)
STANDS_OUT = 8.0


@dataclass(frozen=True)
class Sway:
    """Two-sided spectrum (m, 3) of the rates about body axes [(deg/h)^2/Hz] at frequencies (m,)
    [Hz] from zero on, by the seconds of a stretch.
    """

    frequency_hz: NDArray
    power: NDArray

    @property
    def walk_deg_sqrt_h(self) -> NDArray:
        """Angle random walk (3,) of the same power at the lowest frequency."""
        return np.asarray(np.sqrt(self.power[0] / HOUR))

    def covariance(self, averages: NDArray, axis: int) -> NDArray:
        """Of the means (n, n) [(deg/h)^2] that `averages` (n, seconds) takes of one axis' rates."""
        size = 2 * averages.shape[1]
        transform = np.fft.rfft(averages, n=size, axis=1)
        power = np.interp(np.fft.rfftfreq(size), self.frequency_hz, self.power[:, axis])
        twice = np.full(power.size, 2.0)
        twice[0] = twice[-1] = 1.0
        weighted = transform * (power * twice / size)
        return np.asarray((weighted @ transform.conj().T).real)


def sway_of(seconds: ParkedSeconds) -> Sway | None:
    """The spectrum of a stretch that sways; None where nothing stands out of its noise."""
    from scipy.signal import welch  # half a second of CPU, which units that find north never need

    rate = seconds.sums[:, 3:] / seconds.dt_s[:, None] / DEG_PER_HOUR
    segment = int(np.clip(len(rate) // PIECES, SHORTEST_SEGMENT_S, SEGMENT_S))
    if len(rate) < 2 * segment:
        return None
    frequency, power = welch(rate, fs=1.0, nperseg=segment, detrend="linear", axis=0)
    power = 0.5 * power  # of one side
    kernel = np.ones(SMOOTH) / SMOOTH
    power = np.stack([np.convolve(p, kernel, "same") for p in power.T], axis=1)
    inner = power[FROM_TREND:-1]
    if not (inner.max(axis=0) > STANDS_OUT * np.median(inner, axis=0)).any():
        return None
    power[:FROM_TREND] = power[FROM_TREND]
    power[-1] = power[-2]
    return Sway(frequency, power)


def averages(seconds: ParkedSeconds, start_s: NDArray, end_s: NDArray) -> NDArray:
    """What each bin takes of the seconds of a stretch: weights (bins, seconds) that add up to one,
    of its still seconds as `ParkedSeconds.means` takes them.
    """
    inside = seconds.still & (seconds.start_s >= start_s[:, None] - 0.5)
    inside &= seconds.end_s <= end_s[:, None] + 0.5
    weight = inside * seconds.dt_s
    return np.asarray(weight / np.maximum(weight.sum(axis=1, keepdims=True), 1e-9))
