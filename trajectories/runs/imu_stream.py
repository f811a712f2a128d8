"""The imu stream: rows to increments, with all that can be wrong in its values and times.

A long stream stays in its file and is read again, a piece at a time, by whoever uses it; a short
one becomes an `ImuLog`. Both hold the same bits.

Decision: docs/decisions/0005-imu-source.md.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ins.records import ImuLog, ImuSource, Span
from trajectories.runs.checks import MAX_GAP_S, Findings
from trajectories.runs.imu_scan import (
    Dropouts,
    DropoutScan,
    FiniteScan,
    Intervals,
    RateScan,
    TimeScan,
)
from trajectories.runs.schema import imu_columns
from trajectories.runs.stream_files import HELD_ROWS, PIECE_ROWS, StreamFile

Columns = tuple[NDArray, NDArray, NDArray, NDArray]  # time_s, dt_s, dtheta_rad, dv_m_s


class ImuParts:
    """What an `ins.records.ImuSource` gives of its rows, by its parts.

    Attributes
    ----------
    source : str
        "increments" or "rates": what the rows were read from.
    """

    source: str

    def parts(self, start_s: float, end_s: float) -> Iterator[Columns]:
        """The rows whose interval ends in (start_s, end_s], as they come.

        Parameters
        ----------
        start_s, end_s : float

        Returns
        -------
        parts : iterator of (time_s, dt_s, dtheta_rad, dv_m_s)
            Shapes (n,), (n,), (n, 3), (n, 3), each of one row or more.
        """
        raise NotImplementedError

    def between(self, start_s: float, end_s: float) -> ImuLog:
        """The rows whose interval ends in (start_s, end_s], in memory."""
        return _joined(list(self.parts(start_s, end_s)), self.source)

    def whole(self) -> ImuLog:
        """All rows, in memory."""
        return self.between(-np.inf, np.inf)

    def pieces(self, start_s: float = -np.inf, end_s: float = np.inf) -> Iterator[ImuLog]:
        """The rows of `between` a piece at a time, each of two rows or more."""
        held: list[Columns] = []
        for part in self.parts(start_s, end_s):
            if len(part[0]) > 1 and sum(len(p[0]) for p in held) > 1:
                yield _joined(held, self.source)
                held = []
            held.append(part)
        if held:
            yield _joined(held, self.source)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class ImuFile(ImuParts):
    """Increments that stay in their file (an `ins.records.ImuSource`); each use reads what it
    needs.

    names: of the columns; intervals: of all rows; scaled_rows: rows after a dropout whose
    increments are made to cover it; index_row, index_time_s, index_before_s: first row of each
    piece, its time and that of the row before it.
    """

    stream: StreamFile
    names: tuple[str, ...]
    source: str
    rows: int
    start_s: float
    end_s: float
    intervals: Intervals
    scaled_rows: NDArray
    index_row: NDArray
    index_time_s: NDArray
    index_before_s: NDArray
    piece_rows: int = PIECE_ROWS

    def __repr__(self) -> str:
        span = f"{self.start_s:.6g} to {self.end_s:.6g} s"
        return f"ImuFile({self.stream.label}: {self.rows} rows, {span}, {self.rate_hz:.4g} Hz)"

    @property
    def rate_hz(self) -> float:
        """Nominal sample rate: one over the median interval."""
        return float(1.0 / self.intervals.nominal_s)

    def parts(self, start_s: float, end_s: float) -> Iterator[Columns]:
        """As the file's pieces come."""
        first = max(int(np.searchsorted(self.index_time_s, start_s, side="right")) - 1, 0)
        before_s, nominal_s = self.index_before_s[first], self.intervals.nominal_s
        for row, columns in self.stream.pieces(
            self.names, from_row=int(self.index_row[first]), rows=self.piece_rows
        ):
            time_s = columns["time_s"]
            dt_s = np.diff(time_s, prepend=nominal_s if row == 0 else before_s)
            if row == 0:
                dt_s[0] = nominal_s
            before_s = time_s[-1]
            a, b = np.searchsorted(time_s, [start_s, end_s], side="right")
            if a < b:
                dtheta, dv = _vectors(columns, self.names[1:4]), _vectors(columns, self.names[4:])
                self._to_increments(row, dt_s, dtheta, dv)
                yield time_s[a:b], dt_s[a:b], dtheta[a:b], dv[a:b]
            if b < time_s.size:
                return

    def _to_increments(self, row: int, dt_s: NDArray, dtheta: NDArray, dv: NDArray) -> None:
        if self.source == "rates":
            _to_increments(slice(None), dt_s, dtheta, dv, 1.0)
        elif self.scaled_rows.size:
            a, b = np.searchsorted(self.scaled_rows, [row, row + dt_s.size])
            _to_increments(self.scaled_rows[a:b] - row, dt_s, dtheta, dv, self.intervals.nominal_s)


def load_imu(
    stream: StreamFile,
    findings: Findings,
    *,
    held_rows: int = HELD_ROWS,
    piece_rows: int = PIECE_ROWS,
    dead_columns: bool = False,
) -> tuple[ImuSource | None, list[Span]]:
    """The imu stream as increments, with its faults; None once an error was found.

    dead_columns: a sensor without a finite value in any row is told of, its NaN stay in the log.
    In memory up to `held_rows` rows. A row of rates is the mean over the interval that ends at its
    time, so increment = rate x interval.
    """
    errors, names = len(findings.errors), imu_columns(stream.names)
    times = TimeScan(stream.row)
    for _, columns in stream.pieces(("time_s",), rows=piece_rows):
        times.feed(columns["time_s"])
    values = _ValueScan(stream, names, times)
    for row, columns in stream.pieces(names, rows=piece_rows):
        with np.errstate(over="ignore", invalid="ignore"):  # numbers that are refused below
            values.feed(row, columns)
    silent = [scan for scan in values.finite if dead_columns and scan.bad_rows == times.rows]
    findings.warn(
        *(
            f"{stream.label}: column {scan.column} has no finite value in any row: left out"
            for scan in silent
        )
    )
    findings.error(
        *(line for scan in values.finite if scan not in silent for line in scan.lines),
        *times.finite.lines,
    )
    if times.rows < 2:
        findings.error(f"{stream.label}: {times.rows} rows, needed at least 2")
    elif len(findings.errors) == errors:
        findings.error(*times.backward.lines)
    if len(findings.errors) == errors:
        findings.error(*times.gaps.lines, *values.rate.lines)
    if len(findings.errors) > errors:
        return None, []
    source, dropouts = (
        "rates" if "gyro_x_rad_s" in names else "increments",
        values.dropouts.finish(),
    )
    file = ImuFile(
        stream=stream,
        names=names,
        source=source,
        rows=times.rows,
        start_s=times.start_s,
        end_s=times.end_s,
        intervals=times.intervals,
        scaled_rows=dropouts.row[dropouts.short] if source == "increments" else _NO_ROWS,
        index_row=np.array(values.index_row),
        index_time_s=np.array(values.index_time_s),
        index_before_s=np.array(values.index_before_s),
        piece_rows=piece_rows,
    )
    return file.whole() if file.rows <= held_rows else file, dropout_spans(dropouts)


_NO_ROWS = np.empty(0, dtype=np.int64)


class _ValueScan:
    """All that the second reading finds: values, rate, dropouts, and where each piece begins."""

    def __init__(self, stream: StreamFile, names: tuple[str, ...], times: TimeScan) -> None:
        self._names, self._clean = names, times.clean
        self.finite = [FiniteScan(name, stream.row) for name in names[1:]]
        nominal_s = times.intervals.nominal_s if times.clean else 1.0
        self.rate, self.dropouts = (
            RateScan(nominal_s, stream.row, stream.label),
            DropoutScan(nominal_s),
        )
        self.index_row: list[int] = []
        self.index_time_s: list[float] = []
        self.index_before_s = [np.nan]

    def feed(self, row: int, columns: dict[str, NDArray]) -> None:
        for scan, name in zip(self.finite, self._names[1:]):
            scan.feed(row, columns[name])
        time_s = columns["time_s"]
        self.index_row.append(row)
        self.index_time_s.append(float(time_s[0]))
        self.index_before_s.append(float(time_s[-1]))
        if self._clean:
            self.rate.feed(time_s)
            self.dropouts.feed(time_s, np.nan_to_num(_vectors(columns, self._names[4:])))


def imu_log(
    time_s: NDArray, dtheta: NDArray, dv: NDArray, *, source: str
) -> tuple[ImuLog, list[Span]]:
    """Rates (per second) or increments, (n, 3) each and changed in place, as a log with its
    dropouts held over.
    """
    nominal = Intervals.of(np.diff(time_s)).nominal_s
    dt_s = np.concatenate([[nominal], np.diff(time_s)])
    scan = DropoutScan(nominal)
    for first in range(0, time_s.size, PIECE_ROWS):  # it holds what it is fed
        scan.feed(time_s[first : first + PIECE_ROWS], dv[first : first + PIECE_ROWS])
    dropouts = scan.finish()
    rows = slice(None) if source == "rates" else dropouts.row[dropouts.short]
    _to_increments(rows, dt_s, dtheta, dv, 1.0 if source == "rates" else nominal)
    for values in (time_s, dt_s, dtheta, dv):
        values.flags.writeable = False  # so that the log takes them as they are
    log = ImuLog(time_s=time_s, dt_s=dt_s, dtheta_rad=dtheta, dv_m_s=dv, source=source)
    return log, dropout_spans(dropouts)


def jitter(imu: ImuSource) -> float:
    """99th percentile of |interval - nominal| over the nominal interval, dropouts left out."""
    intervals = (
        imu.intervals if isinstance(imu, ImuFile) else Intervals.of(np.diff(imu.whole().time_s))
    )
    return intervals.jitter


def dropout_spans(found: Dropouts) -> list[Span]:
    """The dropouts as spans of time, neighbours within a second merged."""
    spans: list[Span] = []
    count = 0
    for start, end, lost in zip(found.from_s.tolist(), found.to_s.tolist(), found.lost.tolist()):
        if spans and start - spans[-1].end_s <= MAX_GAP_S:
            start, count = spans.pop().start_s, count + lost
        else:
            count = lost
        spans.append(Span(start_s=start, end_s=end, reason=f"dropout: {count} imu rows lost"))
    return spans


def _to_increments(
    rows: slice | NDArray, dt_s: NDArray, dtheta: NDArray, dv: NDArray, held_s: float
) -> None:
    """Make rows that hold `held_s` of motion cover their interval, in place: 1 s, rates; a nominal
    one, after a dropout.

    The rate is taken as constant over lost rows.
    """
    scale = (dt_s[rows] / held_s)[:, None]
    dtheta[rows] *= scale
    dv[rows] *= scale


def _vectors(columns: dict[str, NDArray], names: tuple[str, ...]) -> NDArray:
    return np.stack([columns[name] for name in names], axis=1)


def _joined(parts: list[Columns], source: str) -> ImuLog:
    if not parts:
        parts = [(np.empty(0), np.empty(0), np.empty((0, 3)), np.empty((0, 3)))]
    time_s, dt_s, dtheta, dv = (
        parts[0] if len(parts) == 1 else (np.concatenate(column) for column in zip(*parts))
    )
    return ImuLog(time_s=time_s, dt_s=dt_s, dtheta_rad=dtheta, dv_m_s=dv, source=source)
