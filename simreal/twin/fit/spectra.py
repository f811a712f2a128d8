"""Spectra of the six channels at rest, in bands of frequency: from the rows above HIGH_HZ, from the
seconds below it, and from ever longer means as the recording allows.

Windows overlap by half under a Hann taper, so that neither a random walk nor a dither line leaks
over the bands. A window in which a person or a gust adds power is left out. Lines are found and
left out. What the gyros share with the accelerometers is the vehicle's, and is left out too
(`shared_motion`).
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain, pairwise

import numpy as np
from numpy.typing import NDArray

from ins.robust import gamma as gamma_law
from simreal.twin.fit.rounding import Rounding
from simreal.twin.fit.shared_motion import MOSTLY_SHARED, MOSTLY_SWAY, own_power
from simreal.twin.fit.streams import DitherLine, ParkedStream
from simreal.twin.fit.terms import NoiseTerm, Shape, sampled_psd

HIGH_HZ = 0.4  # the rows' spectra begin here, those of the seconds end here
WINDOW_S = 20.0  # of rows
# stretches of rows, and their length [s], that a check reads: 8 minutes know the size of a noise
# above 16 Hz to 0.6 %, a tenth of what is tolerated
FEW, FEW_S = 8, 60
POINTS = 320  # of a window of means
FIRST_BIN = 8  # below, a 1/f^2 spectrum leaks by more than 1.6 % under a Hann taper (1 / k^2)
DECIMATION = 8  # each layer of means is so much slower than the one before
PER_DECADE = 25  # bands
# Independent complex values that half-overlapping Hann windows give a bin: 1 / (1 + var(w^2) / mean
# (w^2)^2 / 2) of a half, w^2 summed over windows is 0.75 + 0.25 cos.
SHARE = 0.5 / (1.0 + (0.25 / 0.75) ** 2 / 2.0)
# of the expected power of a bin under a Hann taper, its own and that of either neighbour: squares
# of the taper's lines 1/2 and 1/4, by their sum
HANN_BIN, HANN_BESIDE = 2.0 / 3.0, 1.0 / 6.0
# of one bin between its neighbours under the taper: white noise shows in 1.5 of them
BINS_ALIKE = 1.5
# of the vertical along a gyro: beyond 0.5, 30 deg off level, its turns are mostly yaw, which the
# accelerometers do not see
UPRIGHT = 0.5
WILD_P = 1e-5  # a window with more power than this probability is somebody's step or a gust
LINE_P = 1e-6  # of a bin that stands out; a log of an hour has 2e4 of them
LINE_BINS = 2  # on either side of a line: a Hann window is 4 bins wide between its zeros
# of the floor that may be left beside a line; the side lobes fall as 1 / (pi k^3)^2
LINE_LEFT = 0.01
ROUGH_BANDS = 4  # in which a window is judged


@dataclass(frozen=True)
class Bands:
    """One channel in one layer: dt_s: of the samples; bin_hz: from bin to bin; bins hz (m,) and
    band (m,) of each; power (b,) [unit^2/Hz, two-sided], dof (b,): complex values behind it; own
    (b,): where what the other accelerometers tell is taken out; rounding: where it counts.
    """

    channel: int
    dt_s: float
    bin_hz: float
    hz: NDArray
    band: NDArray
    power: NDArray
    dof: NDArray
    own: NDArray
    rounding: Rounding | None = None
    known: dict[NoiseTerm, NDArray] = field(default_factory=dict, repr=False, compare=False)

    @property
    def centre_hz(self) -> NDArray:
        """Mean frequency of each band."""
        return self.mean(self.hz)

    def mean(self, of_bins: NDArray) -> NDArray:
        """Mean over the bins of each band."""
        count = np.bincount(self.band, minlength=self.power.size)
        return np.bincount(self.band, of_bins, self.power.size) / count

    def expected(self, term: NoiseTerm, shape: Shape) -> NDArray:
        """Power (b,) that a term of unit variance is expected to show under the taper."""
        if term in (NoiseTerm.WHITE, NoiseTerm.CREEP):
            return np.ones(self.power.size)
        shaped = term in (NoiseTerm.SWAY, NoiseTerm.MARKOV)
        if not shaped and term in self.known:
            return self.known[term]
        around = (self.hz - self.bin_hz, self.hz, self.hz + self.bin_hz)
        below, at, above = sampled_psd(term, np.concatenate(around), self.dt_s, shape).reshape(
            3, -1
        )
        found = self.mean(HANN_BIN * at + HANN_BESIDE * (below + above))
        if not shaped:
            self.known[term] = found
        return found


def below_hz(bands: Bands, hz: float) -> Bands:
    """The bands with those above a frequency counting for nothing."""
    return replace(bands, dof=np.where(bands.centre_hz > hz, 0.0, bands.dof))


@dataclass(frozen=True)
class Spectra:
    """All bands of a stream; left_out: share of the windows that were wild, by layer name; shared
    (3,): share of each gyro's power that the accelerometers tell.
    """

    bands: tuple[Bands, ...]
    lines: tuple[DitherLine, ...]
    left_out: dict[str, float]
    shared: NDArray
    slow_s: float


def spectra_of(stream: ParkedStream) -> Spectra:
    """The layers of a stream."""
    layers = [(_row_windows(stream, stream.spans), 1.0 / stream.run.imu.rate_hz, HIGH_HZ, np.inf)]
    steps = decimations(stream)
    layers += [_mean_layer(stream, step) for step in steps]
    found = _joined(layers, _level_gyros(stream) | _vertical_accelerometer(stream))
    return replace(found, slow_s=slow_block_s(steps))


def few_spectra(stream: ParkedStream) -> tuple[Spectra, Spectra]:
    """Spectra of a few minutes of rows, spread over the rest, and of all seconds."""
    dt_s = 1.0 / stream.run.imu.rate_hz
    rows = (_row_windows(stream, _few_spans(stream)), dt_s, HIGH_HZ, np.inf)
    return _joined([rows], {}), _joined([_mean_layer(stream, 1)], _level_gyros(stream))


def _few_spans(stream: ParkedStream) -> list[tuple[int, int]]:
    """FEW stretches of FEW_S seconds at rest, at even places."""
    starts = [first for a, b in stream.spans for first in range(a, b - FEW_S + 1, FEW_S)]
    at = np.unique(np.linspace(0, len(starts) - 1, min(FEW, len(starts))).round().astype(int))
    return [(starts[k], starts[k] + FEW_S) for k in at]


Layer = tuple[Iterator[NDArray], float, float, float]


def _mean_layer(stream: ParkedStream, step: int) -> Layer:
    return _mean_windows(stream, step), float(step), FIRST_BIN / (POINTS * step), HIGH_HZ / step


Witnesses = Mapping[int, tuple[int, ...]]  # of a channel: those that tell what the vehicle does


def _level_gyros(stream: ParkedStream) -> dict[int, tuple[int, ...]]:
    return {int(c): (3, 4, 5) for c in np.flatnonzero(np.abs(stream.up_b) < UPRIGHT)}


def _vertical_accelerometer(stream: ParkedStream) -> dict[int, tuple[int, ...]]:
    """Told by the two others, where they are level."""
    level = np.abs(stream.up_b) < UPRIGHT
    if level.sum() != 2:
        return {}
    others = tuple((3 + np.flatnonzero(level)).tolist())
    return {3 + int(np.flatnonzero(~level)[0]): others}


def _joined(layers: Sequence[Layer], witnesses: Witnesses) -> Spectra:
    bands: list[Bands] = []
    lines: list[DitherLine] = []
    left_out: dict[str, float] = {}
    shared = np.zeros(3)
    for windows, dt_s, low_hz, high_hz in layers:
        found = _layer(windows, dt_s, (low_hz, high_hz), witnesses)
        if found is None:
            continue
        bands += found.bands
        lines += found.lines
        left_out |= found.left_out
        shared = np.maximum(shared, found.shared)
    return Spectra(tuple(bands), tuple(lines), left_out, shared, 0.0)


def decimations(stream: ParkedStream) -> list[int]:
    """Seconds a mean, layer by layer: on until a span holds at most SLOW_BINS of the slow means."""
    steps = [1]
    while _slow_bins(stream, slow_block_s(steps)) > SLOW_BINS:
        steps.append(steps[-1] * DECIMATION)
    return steps


SLOW_BINS = 540  # of the means that are taken with their whole covariance: 50 ms an inversion


def slow_block_s(steps: list[int]) -> float:
    """Length of the slow means: they end where the last layer begins."""
    return POINTS * steps[-1] / (2.0 * FIRST_BIN)


def _slow_bins(stream: ParkedStream, block_s: float) -> float:
    return sum((b - a) // block_s for a, b in stream.spans)


def _row_windows(stream: ParkedStream, spans: Sequence[tuple[int, int]]) -> Iterator[NDArray]:
    """Rates and forces (n, 6) of half-overlapping windows of rows."""
    rate = stream.run.imu.rate_hz
    n = 2 * round(0.5 * WINDOW_S * rate)
    for a, b in spans:
        start_s, end_s = stream.seconds.end_s[a] - 1.0, stream.seconds.end_s[b - 1]
        kept = np.zeros((0, 6))
        for piece in stream.imu.pieces(start_s, end_s + 1e-6):
            rows = np.concatenate([piece.dtheta_rad, piece.dv_m_s], axis=1) / piece.dt_s[:, None]
            kept = np.concatenate([kept, rows])
            while len(kept) >= n:
                yield kept[:n]
                kept = kept[n // 2 :]


def _mean_windows(stream: ParkedStream, step: int) -> Iterator[NDArray]:
    """The same of means over `step` seconds."""
    for a, b in stream.spans:
        count = (b - a) // step
        mean = stream.seconds.mean[a : a + count * step].reshape(count, step, 6).mean(axis=1)
        for first in range(0, count - POINTS + 1, POINTS // 2):
            yield mean[first : first + POINTS]


def _layer(
    windows: Iterator[NDArray], dt_s: float, where_hz: tuple[float, float], witnesses: Witnesses
) -> Spectra | None:
    first = next(windows, None)
    if first is None:
        return None
    n = len(first)
    f = np.fft.rfftfreq(n, dt_s)
    low_hz = max(where_hz[0], FIRST_BIN / (n * dt_s))
    use = np.flatnonzero((f >= low_hz - 1e-9) & (f < where_hz[1] - 1e-9))
    use = use[use < n // 2]  # the last bin of an even window is real
    if use.size < FIRST_BIN:
        return None
    Z = _transforms(chain([first], windows), dt_s, use)  # windows, bins, channels
    f = f[use]
    wild = _wild(Z)
    left = float(wild.mean())
    if wild.all():
        return None
    if wild.any():
        Z = Z[~wild]
    mean = (np.abs(Z) ** 2).mean(axis=0)
    dof = SHARE * len(Z) if wild.size > 1 else 1.0 / BINS_ALIKE
    line, lines = _lines(mean, f, len(Z), (dt_s * n, dt_s))
    band = _bands_of(f)
    bands: list[Bands] = []
    shared = np.zeros(3)
    for c in range(6):
        good = ~line[:, c] & np.isfinite(mean[:, c]) & (mean[:, c] > 0)
        if good.sum() < FIRST_BIN:
            continue
        _, own = np.unique(band[good], return_inverse=True)
        count = np.bincount(own).astype(float)
        power_of = np.bincount(own, mean[good, c]) / count
        nothing = np.zeros(count.size, bool)
        bin_hz = 1.0 / (n * dt_s)
        found = Bands(c, dt_s, bin_hz, f[good], own, power_of, dof * count, nothing)
        if c in witnesses:
            band_of = np.full(good.size, -1)
            band_of[good] = own
            found, told = _less_told(found, Z, band_of, witnesses[c])
            if c < 3:
                shared[c] = told
        bands.append(found)
    name = "rows" if dt_s < 1.0 else f"{dt_s:.0f} s"
    return Spectra(tuple(bands), lines, {name: left}, shared, 0.0)


def _less_told(
    bands: Bands, Z: NDArray, band_of: NDArray, witnesses: tuple[int, ...]
) -> tuple[Bands, float]:
    """A channel's bands less what its witnesses tell, and the largest share of that.

    Z: transforms (w, m, 6); band_of (m,): the band of each bin, -1 of those in none.
    """
    mostly = MOSTLY_SHARED if bands.channel < 3 else MOSTLY_SWAY
    power, dof, shared = own_power(
        Z[:, :, bands.channel], Z[:, :, list(witnesses)], band_of, bands.dof, mostly
    )
    found = replace(bands, power=power, dof=dof, own=dof != bands.dof)
    return found, float(np.max(shared))


def _transforms(windows: Iterator[NDArray], dt_s: float, use: NDArray) -> NDArray:
    """Scaled transforms (w, m, 6) at the bins `use` (m,): their mean square is the two-sided
    spectrum. Of the windows, which overlap, one is held at a time.
    """
    found = [_transform(rows, dt_s)[use] for rows in windows]
    out = np.empty((len(found), use.size, 6), dtype=complex)
    for k in range(len(out)):
        out[-1 - k] = found.pop()
    return out


def _transform(rows: NDArray, dt_s: float) -> NDArray:
    """The transform (n // 2 + 1, 6) of a window (n, 6), tapered, its mean and trend taken out."""
    n = len(rows)
    taper = np.hanning(n + 1)[:n]
    scale = np.sqrt(dt_s / np.sum(taper**2))
    ramp = np.arange(n) - 0.5 * (n - 1)
    off = rows - rows.mean(axis=0)
    off = off - np.outer(ramp, ramp @ off / (ramp @ ramp))
    return np.fft.rfft(off * taper[:, None], axis=0) * scale


def _wild(Z: NDArray) -> NDArray:
    """Windows (w,) of transforms (w, m, 6) whose power in any rough band of any channel noise does
    not explain.
    """
    count = Z.shape[0]
    wild = np.zeros(count, bool)
    if count < 5:
        return wild
    edges = np.unique(np.geomspace(1, Z.shape[1] + 1, ROUGH_BANDS + 1).astype(int)) - 1
    for a, b in pairwise(edges):
        power = np.abs(Z[:, a:b]) ** 2
        flat = power / np.maximum(np.median(power, axis=0), 1e-300)
        total = flat.mean(axis=1)
        nu = (b - a) / BINS_ALIKE
        centre = np.median(total, axis=0) / (gamma_law.ppf(0.5, nu) / nu)
        limit = gamma_law.isf(WILD_P, nu) / nu
        wild |= (total > limit * centre).any(axis=1)
    return wild if wild.sum() <= count // 2 else np.zeros(count, bool)


def _lines(
    mean: NDArray, f: NDArray, windows: int, length: tuple[float, float]
) -> tuple[NDArray, tuple[DitherLine, ...]]:
    """Bins (m, 6) that belong to lines, and the lines; length: of a window and of a sample [s]."""
    window_s, dt_s = length
    line = np.zeros(mean.shape, bool)
    found: list[DitherLine] = []
    nu = max(SHARE * windows, 0.5)
    limit = gamma_law.isf(LINE_P, nu) / nu
    half = 12  # bins on either side that say what the floor is
    for c in range(6):
        if not (mean[:, c] > 0).all():
            continue
        padded = np.pad(np.log(mean[:, c]), half, mode="reflect")
        around = np.lib.stride_tricks.sliding_window_view(padded, 2 * half + 1)
        floor = np.exp(np.median(around, axis=1)) / (gamma_law.ppf(0.5, nu) / nu)
        out = mean[:, c] > limit * floor
        for k in np.flatnonzero(out):
            beside = slice(max(k - LINE_BINS, 0), k + LINE_BINS + 1)
            edge = k < half or k >= len(f) - half  # the floor is known on one side only
            if edge or mean[k, c] < mean[beside, c].max() or _broad(out, int(k)):
                continue
            line[_hidden_by(int(k), float(mean[k, c] / floor[k])), c] = True
            excess = float(np.sum(mean[beside, c] - floor[beside])) / window_s
            sigma = float(floor[k]) / window_s / np.sqrt(max(windows, 1))
            if excess <= 0.0:
                continue  # a peak beside a hollow: of a filter, no line
            amplitude = np.sqrt(4.0 * excess)
            swing = amplitude * dt_s / (2.0 * np.sin(np.pi * f[k] * dt_s))
            known = float(2.0 * sigma / amplitude)
            found.append(DitherLine(c, float(f[k]), float(amplitude), known, float(swing)))
    return line, tuple(found)


def _hidden_by(k: int, over_floor: float) -> slice:
    """Bins about a line's bin k that its side lobes reach."""
    reach = max(LINE_BINS, int(np.ceil((over_floor / LINE_LEFT / np.pi**2) ** (1.0 / 6.0))))
    return slice(max(k - reach, 0), k + reach + 1)


def _broad(out: NDArray, k: int) -> bool:
    """Whether more than a line's own bins stand out about bin k: a resonance, not a line."""
    beside = out[max(k - 12, 0) : k + 13]
    return bool(beside.sum() > 0.5 * beside.size)


def _bands_of(f: NDArray) -> NDArray:
    """Number of the band of each bin."""
    return np.floor(PER_DECADE * np.log10(f)).astype(int)
