"""Rows of a stream as they come, and which of them are taken: finite, possible, in the order of
time, each once.
"""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ins.records import RunHeader
from trajectories.readers.rows.row_cleaning import MAX_LATE_S, PLAUSIBLE_M_S2, PLAUSIBLE_RAD_S
from trajectories.runs.checks import MAX_VALUE

# rows on end that agree on another time before it is believed: 2 garbled stamps may do so
AGREEING = 5
SHIFT_ROUNDING_S = 1e-6  # of a time shifted there and back: 2e-7 at 2e9 s (unix), 1/500 of 2 kHz


class Dropped(StrEnum):
    """Why a row is not recorded."""

    GARBAGE = "garbage"  # no row, or no message
    UNKNOWN = "unknown message"  # of another dialect
    VALUE = "value"  # not finite, or beyond any sensor
    DUPLICATE = "duplicate"
    LATE = "late"  # older than a row that was taken
    STAMP = "time stamp"  # of another time than the rows around it
    LOST = "lost"  # by the sequence numbers of the messages
    OTHER = "other unit"  # of another sender, or of another imu of it


@dataclass(frozen=True)
class Rows:
    """Some rows of a stream.

    columns: their names; values (n, k), time_s first; text: the rows as they came, None where
    nothing but their numbers is kept.
    """

    stream: str
    columns: Sequence[str]
    values: NDArray
    text: Sequence[str] | None = None

    def __len__(self) -> int:
        return len(self.values)

    @property
    def time_s(self) -> NDArray:
        """Times (n,) [s]."""
        return np.asarray(self.values[:, 0])

    def where(self, chosen: NDArray | slice) -> "Rows":
        """Some of the rows."""
        if self.text is None:
            return replace(self, values=self.values[chosen])
        index = np.arange(len(self))[chosen]
        return replace(self, values=self.values[index], text=[self.text[k] for k in index])

    def shifted(self, shift_s: float) -> "Rows":
        """The rows with so much taken off their times; as they are where that is nothing."""
        if not shift_s:
            return self
        values = self.values.copy()
        values[:, 0] -= shift_s
        return replace(self, values=values, text=None)

    def lines(self) -> Sequence[str]:
        """The rows as text; each float64 comes back bit by bit from it."""
        if self.text is not None:
            return self.text
        return [",".join(map(repr, row)) for row in self.values.tolist()]

    def behind(self, before: "Rows") -> "Rows":
        """Other rows of the stream, then these."""
        values = np.concatenate([before.values, self.values])
        text = None
        if self.text is not None and before.text is not None:
            text = [*before.text, *self.text]
        return replace(self, values=values, text=text)


class Source(Protocol):
    """What is watched. dropped: what never became a row, by reason; rereads: whether it gives its
    first rows again where it is opened again.
    """

    dropped: Counter[str]
    rereads: bool

    def header(self) -> RunHeader | None:
        """What run.json is to say; None while the source has not said it."""

    def run_json(self) -> str | None:
        """A run.json that is kept as it is, its times too; None where run time begins with the
        first row.
        """

    def read(self, wait_s: float) -> list[Rows] | None:
        """What has come, after at most so long; None where nothing more will."""

    def close(self) -> None:
        """Let go of file, socket or line."""


class Order:
    """The rows of one stream in the order of time, and how many were dropped why.

    Parameters
    ----------
    longest_s : float
        Of a gap; a longer one, and a clock that began again, begins another stretch of time.
    recorded_s : float
        Until when rows were recorded before: up to there, they are passed over.
    """

    def __init__(self, longest_s: float, recorded_s: float = -np.inf) -> None:
        self.last_s, self._recorded_s, self._longest_s = recorded_s, recorded_s, longest_s
        self.dropped: Counter[str] = Counter()
        self._held: Rows | None = None

    def begin_again(self) -> None:
        """Take whatever time comes next."""
        self.last_s = self._recorded_s = -np.inf

    def take(self, rows: Rows) -> Iterator[tuple[Rows, bool]]:
        """The rows to record, and whether another stretch of time begins with them."""
        good = _possible(rows)
        self.dropped[Dropped.VALUE] += int(np.count_nonzero(~good))
        rows = rows.where(good)
        rows = rows.where(~(rows.time_s <= self._recorded_s + SHIFT_ROUNDING_S))
        while len(rows):
            t = rows.time_s
            steps = np.diff(t, prepend=self.last_s if np.isfinite(self.last_s) else t[0] - 1e-3)
            wrong = np.flatnonzero((steps <= 0) | (steps > self._longest_s))
            until = int(wrong[0]) if wrong.size else t.size
            if until:
                self._forget()
                self.last_s = float(t[until - 1])
                yield rows.where(slice(0, until)), False
            if wrong.size:
                yield from self._odd(rows.where(slice(until, until + 1)))
            rows = rows.where(slice(until + 1, None))

    def _odd(self, row: Rows) -> Iterator[tuple[Rows, bool]]:
        """A row out of order: late, a repeat, or the first of another stretch of time."""
        late_s = self.last_s - float(row.time_s[0])
        if 0 <= late_s <= MAX_LATE_S:
            self.dropped[Dropped.LATE if late_s else Dropped.DUPLICATE] += 1
            return
        held = self._held
        if held is not None and 0 < float(row.time_s[0] - held.time_s[-1]) <= self._longest_s:
            held = row.behind(held)
        else:
            self._forget()
            held = row
        self._held = held
        if len(held) >= AGREEING:
            self._held = None
            self.last_s, self._recorded_s = float(held.time_s[-1]), -np.inf
            yield held, True

    def _forget(self) -> None:
        if self._held is not None:
            self.dropped[Dropped.STAMP] += len(self._held)
            self._held = None


def _possible(rows: Rows) -> NDArray:
    """Rows (n,) that a sensor may have given."""
    values = rows.values
    with np.errstate(invalid="ignore"):
        if rows.stream != "imu":
            return np.asarray(np.isfinite(values[:, 0]) & ~(np.abs(values) > MAX_VALUE).any(axis=1))
        good = np.isfinite(values).all(axis=1) & (np.abs(values) < MAX_VALUE).all(axis=1)
        good &= (np.abs(values[:, 1:4]) < PLAUSIBLE_RAD_S).all(axis=1)
        good &= (np.abs(values[:, 4:7]) < PLAUSIBLE_M_S2).all(axis=1)
        good &= values[:, 1:7].any(axis=1)
    return np.asarray(good)
