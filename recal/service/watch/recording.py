"""The rows of a source in run directories: one a stretch of time without a gap that no run may
hold.
"""

import json
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from datetime import timedelta
from pathlib import Path

import numpy as np

from infield.session.disagreement import utc
from ins.records import InputError, RunHeader
from trajectories.readers.live.rows import Dropped, Order, Rows, Source
from trajectories.runs.checks import MAX_GAP_S
from trajectories.runs.recorder import Recorder, run_text

# of the first rows, for the median of their intervals; chosen: 0.1 s of 200 Hz
FIRST_ROWS = 20


class Recording:
    """Rows that come, put in order and kept: in `output`, after a gap in `output-2`, and so on.

    Parameters
    ----------
    source : Source
        Where the rows come from.
    output : Path
        The run directory; of one that was begun before, the last part goes on.
    """

    def __init__(self, source: Source, output: Path) -> None:
        self._source, self._output = source, output
        self.parts: list[Path] = []
        self._recorder: Recorder | None = None
        self._header: RunHeader | None = None
        self._orders: dict[str, Order] = {}
        self._first: list[Rows] = []

    @property
    def dropped(self) -> Counter[str]:
        """Rows that were not recorded, by reason."""
        found = Counter(self._source.dropped)
        for order in self._orders.values():
            found += order.dropped
        return found

    def take(self, batch: Sequence[Rows]) -> list[Rows]:
        """Record rows; what is recorded of them, in run time."""
        found: list[Rows] = []
        for rows in sorted(batch, key=lambda rows: rows.stream != "imu"):
            if self._recorder is None:
                self._first.append(rows)
                found += self._begun()
            else:
                found += self._taken(rows)
        return found

    def close(self) -> None:
        """Put all on the disk."""
        if self._recorder is not None:
            self._recorder.close()

    def sync(self) -> None:
        """Put on the disk what came."""
        if self._recorder is not None:
            self._recorder.sync()

    def _begun(self) -> list[Rows]:
        """What is recorded of the first rows, once they say when the run begins, and the source
        where.
        """
        header = self._source.header()
        imu = [rows for rows in self._first if rows.stream == "imu"]
        if header is None or sum(len(rows) for rows in imu) < FIRST_ROWS:
            return []
        self._header = header
        text = self._source.run_json()
        if text is None:
            text = self._text(np.concatenate([rows.time_s for rows in imu]), 1)
        number = 1
        while self._folder(number + 1).exists():
            number += 1
        self.parts = [self._folder(k) for k in range(1, number)]
        self._open(text, number)
        first, self._first = self._first, []
        return [part for rows in first for part in self._taken(rows)]

    def _text(self, time_s: np.ndarray, number: int) -> str:
        """run.json of a part whose first rows have these times by the source."""
        assert self._header is not None
        steps = np.diff(time_s)
        fits = (steps > 0) & (steps <= MAX_GAP_S)
        if not fits.any():
            raise InputError(f"rows {np.median(steps):.3g} s apart, needed at most {MAX_GAP_S:g} s")
        # a first stamp may be garbled
        first_s = float(time_s[int(np.argmax(fits))])
        shift_s = first_s - float(np.median(steps[fits]))
        header = self._header
        if number > 1:
            begun = json.loads((self.parts[0] / "run.json").read_text("utf-8"))
            later_s = shift_s - float((begun.get("conversion") or {}).get("time_shift_s", 0.0))
            start = utc(begun["start_utc"]) + timedelta(seconds=max(later_s, 0.0))
            run_id = f"{begun['run_id']}-{number}"
            header = replace(header, run_id=run_id, start_utc=f"{start:%Y-%m-%dT%H:%M:%SZ}")
        return run_text(header, str(self._output), shift_s)

    def _folder(self, number: int) -> Path:
        if number == 1:
            return self._output
        return self._output.with_name(f"{self._output.name}-{number}")

    def _open(self, text: str, number: int) -> None:
        folder = self._folder(number)
        self._recorder = Recorder(folder, text)
        self.parts.append(folder)
        for stream, last_s in self._recorder.last_s.items():
            until_s = last_s + self._recorder.shift_s if self._source.rereads else -np.inf
            self._orders[stream] = self._order(stream, until_s)
            self._orders[stream].last_s = last_s + self._recorder.shift_s

    def _order(self, stream: str, recorded_s: float = -np.inf) -> Order:
        return Order(MAX_GAP_S if stream == "imu" else np.inf, recorded_s)

    def _taken(self, rows: Rows) -> list[Rows]:
        order = self._orders.setdefault(rows.stream, self._order(rows.stream))
        found = []
        for part, is_new in order.take(rows):
            if is_new:
                self._next(part)
            assert self._recorder is not None
            part = part.shifted(self._recorder.shift_s)
            early = part.time_s < 0
            if self._recorder.shift_s and early.any():
                order.dropped[Dropped.STAMP] += int(np.count_nonzero(early))
                part = part.where(~early)
            self._recorder.append(part.stream, part.lines(), part.columns)
            found.append(part)
        return found

    def _next(self, first: Rows) -> None:
        """Begin the next part; the other streams may have begun again, too."""
        assert self._recorder is not None
        self._recorder.close()
        for stream, order in self._orders.items():
            if stream != "imu":
                order.begin_again()
        number = len(self.parts) + 1
        if self._folder(number).exists():
            raise InputError(f"{self._folder(number)}: exists, not written to")
        self._open(self._text(first.time_s, number), number)
