"""Where the gap lies: sums of squares in cells of channel, kind of motion and octave band, and what
is left at the end (effects.md, sections 3.3 and 3.6)::

    D = n/2 (rho - 1 - ln rho) - 1/2 nats

with rho the mean square over its expectation, of n degrees of freedom; two-sided: a twin that is
too noisy has a gap as well. Levels come from replicates of the twin's own noise.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ins.errors.telemetry import PARKED
from simreal.evidence.parked import PARKED_MEAN_S
from simreal.evidence.whitened import BAND_HZ, BANDS, CHANNELS, SENSORS, Evidence
from simreal.inference.noise_hypotheses import Squares
from simreal.inference.tails import tail_probability
from simreal.inference.verdict import Looks

# of the indices of the slow rows: each twice as quick as the one before, up to those of 4096
OCTAVES = (0, 1, 2, 4, 8, 16, 32, 64, 128, 256, 512, 1024, 2048, 4096)
BAND_WINDOW_S = 600.0


@dataclass(frozen=True)
class Cell:
    """Squares (indices into `Squares`) of one channel and band over all runs; moving: rows after
    the parked stretch.
    """

    channel: str
    frequency_hz: tuple[float, float]
    moving: bool
    index: NDArray
    octave: int


@dataclass(frozen=True)
class CellTable:
    """Cells with their mean square rho, degrees of freedom and D [nats]; threshold: family-wise at
    the level asked.
    """

    cells: tuple[Cell, ...]
    rho: NDArray
    dof: NDArray
    nats: NDArray
    threshold: float

    @property
    def located(self) -> NDArray:
        """Cells that stand out (boolean)."""
        return self.nats > self.threshold


@dataclass(frozen=True, kw_only=True)
class GapCell:
    """Squares of one channel and band; `_after` with what was found. frequency_hz: an upper end of
    None is open.
    """

    channel: str
    moving: bool
    frequency_hz: tuple[float, float | None]
    dof: float
    rho: float
    nats: float
    located: bool
    rho_after: float
    nats_after: float
    located_after: bool


def gap_cells(before: CellTable, after: CellTable) -> tuple[GapCell, ...]:
    """The cells of a diagnosis, before and with what was found."""
    located, located_after = before.located, after.located
    return tuple(
        GapCell(
            channel=cell.channel,
            moving=cell.moving,
            frequency_hz=_band(cell.frequency_hz),
            dof=float(before.dof[k]),
            rho=float(before.rho[k]),
            nats=float(before.nats[k]),
            located=bool(located[k]),
            rho_after=float(after.rho[k]),
            nats_after=float(after.nats[k]),
            located_after=bool(located_after[k]),
        )
        for k, cell in enumerate(before.cells)
    )


def _band(frequency_hz: tuple[float, float]) -> tuple[float, float | None]:
    low, high = frequency_hz
    return low, high if np.isfinite(high) else None


def cells_of(evidence: Evidence, squares: Squares) -> tuple[Cell, ...]:
    """All cells of an evidence, channels in their order, bands from slow to quick."""
    out: list[Cell] = []
    longest = max((run.parked.bins for run in evidence.runs), default=0) * PARKED_MEAN_S
    for c, channel in enumerate(CHANNELS[: SENSORS + 1]):
        for number, (low, high) in enumerate(pairwise(OCTAVES)):
            parts = [index[low:high] for (_, k), index in squares.slow.items() if k == c]
            index = np.concatenate(parts) if parts else np.zeros(0, int)
            if index.size:
                out.append(
                    Cell(
                        channel,
                        (low / (2 * longest), min(high / (2 * longest), 0.5 / PARKED_MEAN_S)),
                        False,
                        index,
                        number,
                    )
                )
        for b in range(len(BANDS) + 1):
            parts = [index for (_, k, band), index in squares.quick.items() if (k, band) == (c, b)]
            if parts:
                out.append(
                    Cell(channel, BAND_HZ[b], False, np.concatenate(parts), len(OCTAVES) + b)
                )
    for c in range(SENSORS + 1, len(CHANNELS)):
        parts = [index for (_, k), (index, _) in squares.single.items() if k == c]
        if parts:
            out.append(Cell(CHANNELS[c], (0.0, 0.5), True, np.concatenate(parts), len(OCTAVES)))
    return tuple(out)


def measure_cells(
    cells: Sequence[Cell], dof: NDArray, ratio: NDArray
) -> tuple[NDArray, NDArray, NDArray]:
    """rho (cells, reps), n (cells,), D (cells, reps) from squares (k, reps)."""
    n = np.array([dof[c.index].sum() for c in cells])
    rho = (
        np.array([(dof[c.index][:, None] * ratio[c.index]).sum(axis=0) for c in cells]) / n[:, None]
    )
    safe = np.maximum(rho, 1e-6)
    return rho, n, 0.5 * n[:, None] * (safe - 1.0 - np.log(safe)) - 0.5


def locate(cells: Sequence[Cell], squares: Squares, ratio: NDArray, threshold: float) -> CellTable:
    """The cell table of squares (k,)."""
    rho, n, nats = measure_cells(cells, squares.dof, ratio[:, None])
    return CellTable(tuple(cells), rho[:, 0], n, nats[:, 0], threshold)


class Leftover:
    """Tests whether anything is left in whitened rows, each calibrated on replicates, then
    together.

    Tests: cells (two-sided), means over temperature bands and over ten-minute windows of each
    channel, bursts, kurtosis, scatter against temperature rate, correlation between channels.
    """

    tests = tuple(look for look in Looks if look is not Looks.NOTHING)  # as in `statistics`

    def __init__(self, evidence: Evidence, cells: Sequence[Cell], squares: Squares) -> None:
        self.evidence, self.cells, self.squares = evidence, tuple(cells), squares
        rows = evidence.rows
        self._windows, self._bands = [], []
        for r in range(len(evidence.runs)):
            for c in range(len(CHANNELS)):
                at = np.flatnonzero((rows.run == r) & (rows.channel == c) & rows.steady)
                if at.size < 20:
                    continue
                window = (rows.time_s[at] // BAND_WINDOW_S).astype(int)
                self._windows += [
                    at[window == w] for w in np.unique(window) if np.sum(window == w) >= 10
                ]
        for c in range(SENSORS):
            at = np.flatnonzero(
                (rows.channel == c)
                & (rows.kind == PARKED)
                & rows.steady
                & np.isfinite(rows.temperature_degC)
            )
            if at.size:
                T = rows.temperature_degC[at]
                band = np.minimum(
                    (12 * (T - T.min()) / max(float(np.ptp(T)), 1e-9)).astype(int), 11
                )
                self._bands += [at[band == b] for b in range(12) if np.sum(band == b) >= 10]
        self._steady = [
            np.flatnonzero((rows.channel == c) & rows.steady) for c in range(len(CHANNELS))
        ]

    def statistics(self, z: NDArray, ratio: NDArray) -> NDArray:
        """The six statistics (6, reps) of rows (rows, reps) and squares (k, reps)."""
        _, _, nats = measure_cells(self.cells, self.squares.dof, ratio)
        zero = np.zeros(z.shape[1])
        mean = [self._largest_sum(z, groups) for groups in (self._bands, self._windows)]
        used = [at for at in self._steady[:SENSORS] if at.size >= 50]
        burst = (
            np.max(
                [np.abs(z[at]).max(axis=0) - np.sqrt(2 * np.log(at.size)) for at in used], axis=0
            )
            if used
            else zero
        )
        tails = [
            ((z[at] ** 4).mean(axis=0) - 3.0 * (z[at] ** 2).mean(axis=0) ** 2)
            * np.sqrt(at.size / 24.0)
            for at in used
        ]
        kurtosis = np.max(np.abs(tails), axis=0) if tails else zero
        return np.stack([nats.max(axis=0), *mean, burst, kurtosis, self._correlation(z)])

    @staticmethod
    def _largest_sum(z: NDArray, groups: Sequence[NDArray]) -> NDArray:
        if not groups:
            return np.zeros(z.shape[1])
        return np.max([np.abs(z[at].sum(axis=0)) / np.sqrt(at.size) for at in groups], axis=0)

    def _correlation(self, z: NDArray) -> NDArray:
        """Largest correlation of two parked sensors, in sigmas."""
        best = np.zeros(z.shape[1])
        pairs = [(a, b) for a in range(SENSORS) for b in range(a)]
        total, count = np.zeros((len(pairs), z.shape[1])), 0
        for r, run in enumerate(self.evidence.runs):
            if not run.parked.steady.any():
                continue
            first, bins = int(self.evidence.offsets[r]), run.parked.bins
            block = z[first : first + SENSORS * bins].reshape(SENSORS, bins, -1)
            total += np.array([np.einsum("br,br->r", block[a], block[b]) for a, b in pairs])
            count += bins
        return np.maximum(best, np.abs(total).max(axis=0) / np.sqrt(max(count, 1)))

    def judge(self, z: NDArray, ratio: NDArray, replicates: NDArray) -> tuple[float, Looks]:
        """p-value that nothing is left (all tests together), and what the strongest test is about.

        replicates (6, reps): the statistics of the twin's own noise.
        """
        seen = self.statistics(z[:, None], ratio[:, None])[:, 0]
        p = np.array([tail_probability(replicates[k], seen[k]) for k in range(len(seen))])
        ranks = np.array(
            [[tail_probability(replicates[k], v) for v in replicates[k]] for k in range(len(seen))]
        )
        smallest = ranks.min(axis=0)
        together = float((1 + np.sum(smallest <= p.min())) / (1 + smallest.size))
        if together <= 2.0 / (1 + smallest.size):  # beyond what the replicates resolve
            together = min(together, len(seen) * float(p.min()))
        return together, self.tests[int(np.argmin(p))]
