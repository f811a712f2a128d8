"""Counts: the grid that readings lie on, and the spectrum of what rounding to it adds.

A unit that counts whole quanta q of its accumulated angle (or velocity) rounds that sum. The error
is uniform, q^2 / 12, and white where a row's noise spreads over several quanta. Where it does not,
neighbouring errors are alike, and the mean rate draws its comb. For Gaussian changes of the true
sum with structure function D(t) and mean rate u, and any phase::

    r(t) = q^2 / (2 pi^2) sum over m of m^-2 exp(-2 pi^2 m^2 D(t) / q^2) cos(2 pi m u t / q),

times J0 for each line that swings the sum, and averaged over what u is in the parts of a log (a
MEMS gyro that warms drifts through many phases). Source: the Fourier series of a sawtooth; Widrow
and Kollar (2008), Quantization Noise, ch. 20, for its correlation. Pinned by:
tests/simreal/test_twin_rounding.py
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import j0

from alignment.motion.seconds import seconds_of as log_seconds
from simreal.evidence.seconds import seconds_of
from simreal.twin.fit.streams import DitherLine, ParkedStream

GRID_ROWS = 4096  # that a grid is looked for in
# of a step: readings that lie this much off a grid do not lie on it; any would lie 0.29 off
OFF_GRID = 0.02
FINEST = 1e-9  # of the largest reading: 64-bit numbers differ by 1e-16 of it, sums of them by 1e-12
COUNTS = 3e5  # steps in the largest reading: beyond, the rounding of a 32-bit number hides the grid
MEAN_OVER_S = 300.0  # of the channel: its phase over LAGS rows is known to a hundredth
DRIFT_PARTS = 24  # of a log: of an hour, as long as a warm-up takes for a tenth of its way
HARMONICS = 6  # of the sawtooth: the rest holds 9 % of the error and is white
# of the step: rows of normal noise that scatter by less after rounding scatter by 0.4 steps before;
# the variance of their rounding is then no longer that of a uniform error (Widrow, ch. 5: 4 % off)
HIDDEN = 0.5
LAGS = 512  # rows over which errors may be alike
COLOUR_POINTS = 8 * LAGS  # of the transform of that, so that straight lines between will do
DIED = 1e-4  # of the error's variance: 512 lags of it are 5 % of a band where all add up
SIGMA_OF_GRID = 1e-6  # of a log variance: the step is known as well as the numbers are


@dataclass(frozen=True)
class Rounding:
    """How one channel of one run counts.

    quantum: step of the sum [rad or m/s]; mean: of the channel at rest [unit/s]; row_sigma: scatter
    of the rows' increments; lines: circular frequency [rad/s] and amplitude of the sum [unit] of
    each line; drift: of the mean, in parts of the log [unit/s].
    """

    quantum: float
    mean: float
    row_sigma: float = 0.0
    lines: tuple[tuple[float, float], ...] = ()
    drift: tuple[float, ...] = (0.0,)

    @property
    def hides_rows(self) -> bool:
        """Whether rows, were they rounded one by one, would hide their noise."""
        return self.row_sigma < HIDDEN * self.quantum

    @property
    def variance(self) -> float:
        """Of the error."""
        return self.quantum**2 / 12.0

    def correlation(self, structure: NDArray, dt_s: float) -> NDArray:
        """Correlation (k,) of errors at lags 0, dt_s, ... whose sums differ by the variance
        `structure` (k,).
        """
        lag = dt_s * np.arange(structure.size)
        m = np.arange(1, HARMONICS + 1)[:, None]
        alike = np.exp(-2.0 * (np.pi * m / self.quantum) ** 2 * structure)
        means = self.mean + np.array(self.drift)
        turns = np.multiply.outer(2.0 * np.pi * means / self.quantum, m * lag)
        alike = alike * np.cos(turns).mean(axis=0)
        for w, amplitude in self.lines:
            swing = 4.0 * np.pi * m * amplitude / self.quantum
            alike = alike * j0(swing * np.abs(np.sin(0.5 * w * lag)))
        found = (6.0 / (np.pi * m) ** 2 * alike).sum(axis=0)
        found[0] = 1.0  # the harmonics left out
        return np.asarray(found)

    def alike(self, change: float) -> float:
        """Correlation of errors, at most, whose sums differ by a variance."""
        return float(np.exp(-2.0 * (np.pi / self.quantum) ** 2 * change))

    def colour(self, f_hz: NDArray, dt_s: float, structure: NDArray) -> NDArray:
        """Spectrum (k,) of the errors over that of white ones; structure (LAGS + 1,)."""
        if self.alike(float(structure[1])) < DIED:
            return np.ones_like(f_hz)
        found = self.correlation(structure, dt_s)
        if abs(found[-1]) > DIED:  # alike to the end: its comb is drawn as wide as the window
            found = found * (0.5 + 0.5 * np.cos(np.pi * np.arange(LAGS + 1) / LAGS))
        even = np.zeros(COLOUR_POINTS)
        even[: LAGS + 1] = found
        even[-LAGS:] = found[:0:-1]
        drawn = np.fft.rfft(even).real
        at_hz = np.arange(drawn.size) / (COLOUR_POINTS * dt_s)
        return np.asarray(np.interp(f_hz, at_hz, np.maximum(drawn, DIED)))


def roundings(stream: ParkedStream, lines: Sequence[DitherLine]) -> dict[int, Rounding]:
    """How the channels of a run count, those that lie on a grid; from the rows as they were
    logged, before any table is taken out.
    """
    a, b = max(stream.spans, key=lambda ab: ab[1] - ab[0])
    end = stream.seconds.end_s
    log = stream.run.imu.between(end[a] - 1.0, min(end[b - 1], end[a] + MEAN_OVER_S))
    sums = np.concatenate([log.dtheta_rad, log.dv_m_s], axis=1)
    dt_s = float(np.median(log.dt_s))
    found: dict[int, Rounding] = {}
    raw = seconds_of(log_seconds(stream.run.imu)).mean[stream.still]
    parts = np.array([part.mean(axis=0) for part in np.array_split(raw, DRIFT_PARTS)])
    for c in range(6):
        if stream.seconds.dead[c]:
            continue
        quantum = grid_of(sums[:, c]) or dt_s * grid_of(sums[:, c] / log.dt_s)
        if quantum:
            mean = float(sums[:, c].sum() / log.dt_s.sum())
            own = [line for line in lines if line.channel == c]
            turns = [2.0 * np.pi * line.frequency_hz for line in own]
            swings = [line.swing for line in own]
            sigma = float(sums[:, c].std())
            drift = tuple((parts[:, c] - mean).tolist())
            found[c] = Rounding(quantum, mean, sigma, tuple(zip(turns, swings)), drift)
    return found


def grid_of(readings: NDArray) -> float:
    """The step of the grid on which readings (n,) lie; 0 where they lie on none."""
    values = np.unique(readings[:GRID_ROWS])
    largest = float(np.max(np.abs(values), initial=0.0))
    gaps = np.diff(values)
    gaps = gaps[gaps > FINEST * largest]
    if not gaps.size:
        return 0.0
    # rows that hold one number and its neighbours tell the step by their gaps alone
    step = float(gaps.min())
    if largest / step > COUNTS:
        return 0.0
    for reach in (8.0, 64.0, 512.0, 4096.0, COUNTS):
        near = values[np.abs(values) <= reach * step]
        count = np.rint(near / step)
        if not np.any(count):
            continue
        step = float(near @ count / (count @ count))
        if np.max(np.abs(near / step - np.rint(near / step))) > OFF_GRID:
            return 0.0
    return step
