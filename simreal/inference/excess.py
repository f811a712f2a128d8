"""How large the gap is, in one measure: the excess of squared whitened rows over their floor
(effects.md, section 3.2)::

    score = sum w z^2 / sum w,   E = sum w (z^2 - 1),   excess in sigmas = E / sqrt(2 sum w^2)
    w = 1 / (1 + k / 8),   k: index of the cosine transform over a run's rows of one channel

z: whitened rows, unit noise where the twin is right, so that the floor is 1; the transform is
orthonormal and keeps that. What tells effects apart is slow, so that slow indices count most: with
equal weights an effect of 14 sigma was 0.6 sigma of the sum of 16,000 squares. What is quicker than
a row has its own cells (`inference.locate`). With what was found E becomes E'; the shrink is
1 - E' / E, with Fieller's interval (`inference.addback`).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.fft import dct

from simreal.evidence.whitened import CHANNELS, Evidence
from simreal.inference.addback import Gone, fieller

FLOOR = 1.0  # of the mean square of whitened rows
# a quarter of what `inference.addback` keeps of a channel; a warm-up of an hour lies below 8
HALF_INDEX = 8.0


@dataclass(frozen=True)
class Excess:
    """Weighted mean square before and after, the distance of both from the floor in sigmas of the
    null, and the share of it that is gone.

    channel: "" for all rows together; rows: their number.
    """

    channel: str
    rows: int
    score: float
    score_after: float
    excess_sigma: float
    excess_sigma_after: float
    shrink: Gone


@dataclass(frozen=True)
class _Spectrum:
    """Squares of transformed rows before and after (m,), their weights and their channels."""

    before: NDArray
    after: NDArray
    weight: NDArray
    channel: NDArray


def excesses(evidence: Evidence, after: NDArray, fitted: int) -> tuple[Excess, ...]:
    """Of all rows, then of each channel that has some.

    evidence : the runs' whitened rows (m,) under the twin; after : (m,), with what was found.
    fitted : coefficients that were fitted to these rows; what they owe to the rows' own noise, a
        square each, is no shrink.
    """
    spectrum = _spectrum(evidence, after)
    found = [_excess("", spectrum, np.ones(spectrum.weight.size, bool), fitted)]
    for number, name in enumerate(CHANNELS):
        mine = spectrum.channel == number
        if spectrum.weight[mine].any():
            found.append(_excess(name, spectrum, mine, fitted * float(mine.mean())))
    return tuple(found)


def _spectrum(evidence: Evidence, after: NDArray) -> _Spectrum:
    """The transform of each channel's rows, run by run, in order of time."""
    rows, z = evidence.rows, evidence.z
    made = _Spectrum(np.empty(z.size), np.empty(z.size), np.empty(z.size), rows.channel)
    for run in np.unique(rows.run):
        for channel in np.unique(rows.channel[rows.run == run]):
            at = np.flatnonzero((rows.run == run) & (rows.channel == channel))
            at = at[np.argsort(rows.time_s[at], kind="stable")]
            made.before[at] = dct(z[at], norm="ortho") ** 2
            made.after[at] = dct(after[at], norm="ortho") ** 2
            shown = float(np.any(z[at]))  # not of a sensor that says nothing
            made.weight[at] = shown / (1.0 + np.arange(at.size) / HALF_INDEX)
    return made


def _excess(channel: str, spectrum: _Spectrum, mine: NDArray, fitted: float) -> Excess:
    w = spectrum.weight[mine]
    squares, left = (float(w @ s[mine]) for s in (spectrum.before, spectrum.after))
    total, spread = float(w.sum()), float(w @ w)
    gap, gone = squares - total, squares - left - fitted
    explained = max(gone, 0.0)
    shrink = fieller(gone, gap, dd=explained, dz=explained, m=spread)
    sigma = float(np.sqrt(2.0 * spread))
    return Excess(
        channel=channel,
        rows=int(mine.sum()),
        score=squares / total,
        score_after=left / total,
        excess_sigma=gap / sigma,
        excess_sigma_after=(left - total) / sigma,
        shrink=Gone(shrink.fraction, shrink.interval_95),
    )
