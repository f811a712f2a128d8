"""What can be wrong with the rows of a stream: values, times, gaps, rate. Lines that name file, row
and column.

Levels: an "error" makes the run unusable (`read_run` raises it); a "suspect" fails `recal check`
only; a "warning" does neither.

Decision: docs/decisions/0005-imu-source.md.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

# between two imu rows: what moved meanwhile cannot be made good, 3 deg in a turn of standard
# rate; docs/decisions/0005-imu-source.md
MAX_GAP_S = 1.0
# of any number in a stream: squares of it still add up; 1e24, beside the 1.8e308 of a double
MAX_VALUE = 1e12
MIN_RATE_HZ = 10.0  # of an imu stream: formats.md section 1
MAX_RATE_HZ = 2000.0  # formats.md section 1, as above
RATE_TOLERANCE = 0.02  # of a rate, chosen: a logger's clock; 9.8 Hz are still taken for 10
# of the interval, lasting longer than RATE_CHANGE_S: above the jitter worth a warning (0.1),
# below the 0.5 and 1 of a rate doubled and halved
RATE_CHANGE = 0.2
RATE_CHANGE_S = 3.0
# intervals, halfway from 1 to 2: a longer one that its neighbour does not make up for has lost
# rows
DROPOUT = 1.5
JITTER_WARNING = 0.1  # of the interval, 99th percentile
LISTED = 5  # rows named of one kind of fault: a line of about 80 characters each, 5 lines


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


def first_beyond(values: NDArray) -> int | None:
    """Index of the first finite number beyond MAX_VALUE; None where there is none."""
    wild = np.abs(values, where=np.isfinite(values), out=np.zeros(values.shape)) > MAX_VALUE
    return int(np.argmax(wild)) if wild.any() else None


Row = Callable[[int], str]  # index of a row -> "imu.csv: row 12 (line 13)"


class BadRows:
    """The first few bad rows of one kind as lines, and how many more there are."""

    def __init__(self) -> None:
        self._lines: list[str] = []
        self._count = 0

    def add(self, rows: NDArray, text: Callable[[int], str]) -> None:
        """Rows by a number that `text` makes a line of."""
        self._lines += [text(int(k)) for k in rows[: LISTED - len(self._lines)]]
        self._count += len(rows)

    @property
    def lines(self) -> list[str]:
        more = self._count - len(self._lines)
        return (
            [*self._lines[:-1], f"{self._lines[-1]} (and {more} more such rows)"]
            if more
            else self._lines
        )


def check_increasing(time_s: NDArray, row: Row) -> list[str]:
    """Times that go back or repeat, shape (n,)."""
    found = BadRows()
    found.add(
        np.flatnonzero(np.diff(time_s) <= 0) + 1,
        lambda k: not_increasing(row(k), time_s[k], time_s[k - 1]),
    )
    return found.lines


def not_increasing(where: str, time_s: float, before_s: float) -> str:
    verb = "repeats" if time_s == before_s else "goes back from"
    return (
        f"{where}: column time_s: {time_s:.9g} s {verb} {before_s:.9g} s, needed strictly"
        " increasing"
    )
