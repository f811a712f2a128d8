"""What is wrong with the rows of an imu stream that is read in pieces: values, times, gaps, rate,
dropouts.

Each scan is fed piece after piece and holds a few rows of the last one; what it finds does not
depend on the cutting.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ins.units import STANDARD_GRAVITY
from trajectories.runs.checks import (
    DROPOUT,
    MAX_GAP_S,
    MAX_RATE_HZ,
    MAX_VALUE,
    MIN_RATE_HZ,
    RATE_CHANGE,
    RATE_CHANGE_S,
    RATE_TOLERANCE,
    BadRows,
    Row,
    first_beyond,
    not_increasing,
)


@dataclass(frozen=True)
class Intervals:
    """The intervals of a log as their distinct values, ascending, and how often each occurs: exact
    order statistics.

    A logger's clock has few distinct intervals (some hundred), so that this is small beside the
    intervals themselves.
    """

    step_s: NDArray
    count: NDArray

    @classmethod
    def of(cls, step_s: NDArray) -> "Intervals":
        return cls(*np.unique(step_s, return_counts=True))

    def joined(self, other: "Intervals") -> "Intervals":
        step_s, where = np.unique(np.concatenate([self.step_s, other.step_s]), return_inverse=True)
        count = np.bincount(
            where, weights=np.concatenate([self.count, other.count]), minlength=step_s.size
        )
        return Intervals(step_s, count.astype(np.int64))

    @property
    def nominal_s(self) -> float:
        """The median."""
        total = int(self.count.sum())
        return float(
            np.mean(_ranked(self.step_s, self.count, np.array([(total - 1) // 2, total // 2])))
        )

    @property
    def jitter(self) -> float:
        """99th percentile of |interval - nominal| over the nominal interval, dropouts left out."""
        nominal = self.nominal_s
        kept = self.step_s <= DROPOUT * nominal
        if not kept.any():
            return 0.0
        off, count = np.abs(self.step_s[kept] / nominal - 1), self.count[kept]
        order = np.argsort(off, kind="stable")
        rank = 0.99 * (int(count.sum()) - 1)
        low, high = _ranked(
            off[order], count[order], np.array([np.floor(rank), np.ceil(rank)]).astype(int)
        )
        return float(low + (high - low) * (rank - np.floor(rank)))


def _ranked(values: NDArray, count: NDArray, rank: NDArray) -> NDArray:
    """Order statistics: values (ascending, each occurring `count` times) of the given ranks from
    0.
    """
    return values[np.searchsorted(np.cumsum(count), rank, side="right")]


class FiniteScan:
    """NaN, infinity, or a number that no sensor and no clock gives, in a required column."""

    def __init__(self, column: str, row: Row) -> None:
        self.column, self._row = column, row
        self._line, self.bad_rows = "", 0
        self._wild = ""

    def feed(self, start: int, values: NDArray) -> None:
        bad = np.flatnonzero(~np.isfinite(values))
        if bad.size and not self.bad_rows:
            k = int(bad[0])
            self._line = (
                f"{self._row(start + k)}: column {self.column}: got {values[k]}, needed a finite"
                " number"
            )
        self.bad_rows += bad.size
        wild = None if self._wild else first_beyond(values)
        if wild is not None:
            self._wild = (
                f"{self._row(start + wild)}: column {self.column}: got {values[wild]:g}, needed"
                f" within +-{MAX_VALUE:g}"
            )

    @property
    def lines(self) -> list[str]:
        more = f" ({self.bad_rows} such rows)" if self.bad_rows > 1 else ""
        return ([self._line + more] if self.bad_rows else []) + ([self._wild] if self._wild else [])


class TimeScan:
    """The times of a stream: finite, increasing, without gaps, and their intervals."""

    def __init__(self, row: Row) -> None:
        self._row = row
        self.rows, self.start_s, self.end_s = 0, np.nan, np.nan
        self.finite = FiniteScan("time_s", row)
        self.backward, self.gaps = BadRows(), BadRows()
        self.intervals = Intervals(np.empty(0), np.empty(0, dtype=np.int64))

    @property
    def clean(self) -> bool:
        return self.rows >= 2 and not (self.finite.lines or self.backward.lines)

    def feed(self, time_s: NDArray) -> None:
        self.finite.feed(self.rows, time_s)
        t = np.concatenate([[self.end_s], time_s]) if self.rows else time_s
        base = self.rows - (t.size - time_s.size)  # index of t[0]
        with np.errstate(invalid="ignore"):
            step = np.diff(t)
            back, gaps = np.flatnonzero(step <= 0) + 1, np.flatnonzero(step > MAX_GAP_S) + 1
        self.backward.add(back, lambda k: not_increasing(self._row(base + k), t[k], t[k - 1]))
        self.gaps.add(gaps, lambda k: self._gap(base + k, float(step[k - 1]), float(t[k - 1])))
        if not self.finite.lines:
            self.intervals = self.intervals.joined(Intervals.of(step))
        self.start_s = self.start_s if self.rows else float(time_s[0])
        self.rows, self.end_s = self.rows + time_s.size, float(time_s[-1])

    def _gap(self, row: int, step_s: float, from_s: float) -> str:
        return (
            f"{self._row(row)}: gap of {step_s:.3f} s before it (from {from_s:.3f} s), needed at"
            f" most {MAX_GAP_S:g} s"
        )


class RateScan:
    """A rate outside 10 Hz to 2 kHz, or one that changes for longer than a few seconds."""

    def __init__(self, nominal_s: float, row: Row, label: str) -> None:
        self._row = row
        self._block = max(5, round(RATE_CHANGE_S / nominal_s))
        # the last block and what is not yet one; index of its first row
        self._time_s, self._base = np.empty(0), 0
        self._ready = 0  # of these, rows before the block under way
        self._first = np.nan  # median interval of the first block
        self.lines: list[str] = []
        rate_hz = 1 / nominal_s
        if not MIN_RATE_HZ * (1 - RATE_TOLERANCE) <= rate_hz <= MAX_RATE_HZ * (1 + RATE_TOLERANCE):
            self.lines = [
                f"{label}: rate {rate_hz:.4g} Hz, needed {MIN_RATE_HZ:g} to {MAX_RATE_HZ:g} Hz"
            ]

    def feed(self, time_s: NDArray) -> None:
        if self.lines:
            return
        t = self._time_s = np.concatenate([self._time_s, time_s])
        ready, block = self._ready, self._block
        count = (t.size - ready - 1) // block
        if count < 1:
            return
        medians = np.median(
            np.diff(t[ready : ready + count * block + 1]).reshape(count, block), axis=1
        )
        self._first = float(medians[0]) if np.isnan(self._first) else self._first
        changed = np.flatnonzero(np.abs(medians / self._first - 1) > RATE_CHANGE)
        if changed.size:
            self.lines = [
                self._change(ready + (int(changed[0]) - 1) * block, float(medians[changed[0]]))
            ]
        done = ready + (count - 1) * block  # the last block stays
        self._time_s, self._base, self._ready = t[done:], self._base + done, block

    def _change(self, start: int, median_s: float) -> str:
        """Where, in the block that differs or the one before it (from row `start` held), four of
        five intervals are off.
        """
        t = self._time_s[start : start + 2 * self._block + 1]
        off = np.abs(np.diff(t) / self._first - 1) > RATE_CHANGE
        k = int(np.argmax(np.convolve(off, np.ones(5), "valid") >= 4)) + 1
        return (
            f"{self._row(self._base + start + k)}: rate changes from {1 / self._first:.4g} to"
            f" {1 / median_s:.4g} Hz at {t[k]:.3f} s, needed one rate in a run"
        )


@dataclass(frozen=True)
class Dropouts:
    """Rows before which samples are lost: a long interval that the next one does not make up for.

    row (m,) index; from_s, to_s: the interval; lost: rows; short: whether the row's increments hold
    one nominal interval only, which is seen in their length: |dv| is close to 9.8 m/s^2 times the
    one interval or the other.
    """

    row: NDArray
    from_s: NDArray
    to_s: NDArray
    lost: NDArray
    short: NDArray


class DropoutScan:
    """Finds `Dropouts`; a late time stamp followed by an early one is jitter, not a dropout."""

    def __init__(self, nominal_s: float) -> None:
        self._nominal_s = nominal_s
        self._time_s, self._dv, self._base = np.empty(0), np.empty((0, 3)), 0
        self._found: list[tuple[NDArray, ...]] = []

    def feed(self, time_s: NDArray, dv: NDArray) -> None:
        """The next rows; dv (k, 3): increments or rates, as in the file."""
        self._time_s, self._dv = (
            np.concatenate([self._time_s, time_s]),
            np.concatenate([self._dv, dv]),
        )
        self._search(np.diff(self._time_s), self._dv)
        done = max(self._time_s.size - 2, 0)  # the last row is judged by what follows it
        self._time_s, self._dv, self._base = self._time_s[done:], self._dv[done:], self._base + done

    def finish(self) -> Dropouts:
        """All of them; the last row is taken to be followed by a nominal interval."""
        self._search(
            np.append(np.diff(self._time_s), self._nominal_s),
            np.concatenate([self._dv, self._dv[-1:]]),
            last=True,
        )
        parts = [np.concatenate(column) for column in zip(*self._found)]
        return Dropouts(*parts)

    def _search(self, step: NDArray, dv: NDArray, *, last: bool = False) -> None:
        """Look at rows 1 .. of the rows held whose following interval step[k] is known; dv of the
        row after each.
        """
        nominal, t = self._nominal_s, self._time_s
        before, after = step[:-1], step[1:]
        k = (
            np.flatnonzero(
                (before > DROPOUT * nominal) & (before + after > (1 + DROPOUT) * nominal)
            )
            + 1
        )
        # the next hole is counted by itself
        late_s = np.where(step[k] > DROPOUT * nominal, nominal, step[k])
        lost = np.maximum(1, np.round((step[k - 1] + late_s) / nominal).astype(int) - 2)
        f = np.linalg.norm(dv[k + 1], axis=1) / (step[k - 1] if last else step[k])
        # the row after it stands at a hole too
        f = np.where((not last) & (step[k] > DROPOUT * nominal), STANDARD_GRAVITY, f)
        short = np.linalg.norm(dv[k], axis=1) < 0.5 * f * (step[k - 1] + nominal)
        self._found.append((self._base + k, t[k - 1], t[k], lost, short))
