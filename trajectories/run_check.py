"""What can be wrong with the rows of a stream: values, times, gaps, rate. Lines that name file, row and column.

Levels: an "error" makes the run unusable (`read_run` raises it); a "suspect" fails `recal check` only; a "warning"
does neither.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ins.records import Span

MAX_GAP_S = 1.0
MIN_RATE_HZ, MAX_RATE_HZ = 10.0, 2000.0
RATE_TOLERANCE = 0.02
RATE_CHANGE = 0.2  # of the interval, lasting longer than RATE_CHANGE_S
RATE_CHANGE_S = 3.0
DROPOUT = 1.5  # intervals; a longer one that its neighbour does not make up for has lost rows
JITTER_WARNING = 0.1  # of the interval, 99th percentile
LISTED = 5  # rows named of one kind of fault


@dataclass(frozen=True, kw_only=True)
class Finding:
    """One line for people, and how bad it is: "error", "suspect" or "warning"."""

    level: str
    text: str


@dataclass
class Findings:
    """Collects what is wrong, so that all of it is listed and not only the first."""

    items: list[Finding] = field(default_factory=list)

    def add(self, level: str, *lines: str) -> None:
        self.items += [Finding(level=level, text=line) for line in lines]

    def error(self, *lines: str) -> None:
        self.add("error", *lines)

    def suspect(self, *lines: str) -> None:
        self.add("suspect", *lines)

    def warn(self, *lines: str) -> None:
        self.add("warning", *lines)

    @property
    def errors(self) -> list[str]:
        return [item.text for item in self.items if item.level == "error"]


Row = Callable[[int], str]  # index of a row -> "imu.csv: row 12 (line 13)"


def name_rows(rows: NDArray, row: Row, text: Callable[[int], str]) -> list[str]:
    """One line for each of the first few rows, and how many more there are."""
    lines = [f"{row(int(k))}: {text(int(k))}" for k in rows[:LISTED]]
    if len(rows) > LISTED:
        lines[-1] += f" (and {len(rows) - LISTED} more such rows)"
    return lines


def check_finite(values: NDArray, column: str, row: Row) -> list[str]:
    """NaN or infinity in a required column, shape (n,)."""
    bad = np.flatnonzero(~np.isfinite(values))
    lines = name_rows(bad[:1], row, lambda k: f"column {column}: got {values[k]}, needed a finite number")
    return [line + (f" ({bad.size} such rows)" if bad.size > 1 else "") for line in lines]


def check_increasing(time_s: NDArray, row: Row) -> list[str]:
    """Times that go back or repeat, shape (n,)."""
    step = np.diff(time_s)
    return name_rows(
        np.flatnonzero(step <= 0) + 1, row,
        lambda k: f"column time_s: {time_s[k]:.9g} s {'repeats' if step[k - 1] == 0 else 'goes back from'} "
        f"{time_s[k - 1]:.9g} s, needed strictly increasing",
    )  # fmt: skip


def check_gaps(time_s: NDArray, row: Row) -> list[str]:
    """Intervals longer than MAX_GAP_S before a row."""
    step = np.diff(time_s)
    return name_rows(
        np.flatnonzero(step > MAX_GAP_S) + 1, row,
        lambda k: f"gap of {step[k - 1]:.3f} s before it (from {time_s[k - 1]:.3f} s), needed at most {MAX_GAP_S:g} s",
    )  # fmt: skip


def check_rate(time_s: NDArray, row: Row, label: str) -> list[str]:
    """A rate outside 10 Hz to 2 kHz, or one that changes for longer than a few seconds."""
    step = np.diff(time_s)
    nominal = float(np.median(step))
    if not MIN_RATE_HZ * (1 - RATE_TOLERANCE) <= 1 / nominal <= MAX_RATE_HZ * (1 + RATE_TOLERANCE):
        return [f"{label}: rate {1 / nominal:.4g} Hz, needed {MIN_RATE_HZ:g} to {MAX_RATE_HZ:g} Hz"]
    block = max(5, round(RATE_CHANGE_S / nominal))
    blocks = step[: step.size // block * block].reshape(-1, block)
    if len(blocks) < 2:
        return []
    medians = np.median(blocks, axis=1)
    changed = np.flatnonzero(np.abs(medians / medians[0] - 1) > RATE_CHANGE)
    if not changed.size:
        return []
    first = max(0, (changed[0] - 1) * block)
    off = np.abs(step[first:] / medians[0] - 1) > RATE_CHANGE
    k = first + int(np.argmax(np.convolve(off, np.ones(5), "valid") >= 4)) + 1
    return [
        f"{row(k)}: rate changes from {1 / medians[0]:.4g} to {1 / medians[changed[0]]:.4g} Hz at {time_s[k]:.3f} s, "
        "needed one rate in a run"
    ]


def find_dropouts(time_s: NDArray) -> tuple[NDArray, NDArray]:
    """Rows before which samples are lost, and how many: long intervals that the next one does not make up for.

    A late time stamp followed by an early one is jitter, not a dropout.
    """
    step = np.diff(time_s)
    nominal = np.median(step)
    following = np.append(step[1:], nominal)
    rows = np.flatnonzero((step > DROPOUT * nominal) & (step + following > (1 + DROPOUT) * nominal))
    lost = np.maximum(1, np.round((step[rows] + following[rows]) / nominal).astype(int) - 2)
    return rows + 1, lost


def dropout_spans(time_s: NDArray, rows: NDArray, lost: NDArray) -> list[Span]:
    """The dropouts as spans of time, neighbours within a second merged."""
    spans: list[Span] = []
    count = 0
    for k, n in zip(rows, lost):
        start, end = float(time_s[k - 1]), float(time_s[k])
        if spans and start - spans[-1].end_s <= MAX_GAP_S:
            start, count = spans.pop().start_s, count + int(n)
        else:
            count = int(n)
        spans.append(Span(start_s=start, end_s=end, reason=f"dropout: {count} imu rows lost"))
    return spans


def hold_over_dropouts(
    dtheta_rad: NDArray, dv_m_s: NDArray, dt_s: NDArray, rows: NDArray, *, nominal_s: float
) -> NDArray:
    """Make increments cover a dropout, in place: scaled to the whole interval where they hold only the nominal one.

    Which of the two a row holds is seen in its length: |dv| is close to 9.8 m/s^2 times one interval or the other.
    Returns the rows that were scaled. The rate is taken as constant over the lost rows.
    """
    at_next = np.minimum(rows + 1, len(dt_s) - 1)
    f = np.linalg.norm(dv_m_s[at_next], axis=1) / dt_s[at_next]
    short = rows[np.linalg.norm(dv_m_s[rows], axis=1) < 0.5 * f * (dt_s[rows] + nominal_s)]
    scale = (dt_s[short] / nominal_s)[:, None]
    dtheta_rad[short] *= scale
    dv_m_s[short] *= scale
    return short


def jitter(time_s: NDArray) -> float:
    """99th percentile of |interval - nominal| over the nominal interval, dropouts left out."""
    step = np.diff(time_s)
    nominal = np.median(step)
    kept = step[step <= DROPOUT * nominal]
    return float(np.percentile(np.abs(kept / nominal - 1), 99)) if kept.size else 0.0
