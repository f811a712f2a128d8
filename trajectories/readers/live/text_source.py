"""Text that grows: the streams of a run directory, a table with its column map, standard input."""

import csv
import os
import select
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ins.columns import GYRO_DEGC, INCREMENT_COLUMNS, RATE_COLUMNS
from ins.json_file import read_json_object
from ins.records import InputError, RunHeader
from trajectories.readers.columns.imu_columns import body_temperatures, second_means, sensor_vectors
from trajectories.readers.formats.mapped import own_map
from trajectories.readers.live.rows import Dropped, Rows
from trajectories.readers.rows.column_map import (
    TIME_UNITS,
    ColumnMap,
    LogOptions,
    axis_matrix,
    column_map,
    used_columns,
)
from trajectories.runs.schema import check_columns, header_from_json
from trajectories.runs.text_rows import MAX_LINE_BYTES

READ_BYTES = 1 << 20  # of a file at a time: 2 min of 200 Hz
GROWING = ("imu", "temperature", "gnss", "odometer")


class Lines:
    """Whole lines of a file that grows, or of standard input, as they come."""

    def __init__(self, path: Path | None) -> None:
        try:
            self._file = 0 if path is None else os.open(path, os.O_RDONLY)
        except OSError as error:
            raise InputError(f"{path}: cannot be read ({error.strerror})") from None
        self._is_pipe = path is None
        self._rest = b""
        self.ended = False

    def read(self, wait_s: float = 0.0) -> list[bytes]:
        """The lines that have come; a last one without its end is kept until it has one."""
        if self._is_pipe and not select.select([self._file], [], [], wait_s)[0]:
            return []
        data = os.read(self._file, READ_BYTES)
        self.ended = self._is_pipe and not data
        if self.ended and self._rest:
            data = b"\n"
        *lines, self._rest = (self._rest + data).split(b"\n")
        if len(self._rest) > MAX_LINE_BYTES:
            raise InputError(f"a line of more than {MAX_LINE_BYTES} bytes: no table of text")
        return lines

    def close(self) -> None:
        """Let go of the file."""
        if not self._is_pipe:
            os.close(self._file)


def numbers(lines: list[bytes], columns: int, dropped: Counter[str], delimiter: str) -> NDArray:
    """Values (n, columns) of the lines that are rows of so many numbers, an empty field as NaN; the
    other lines are counted as garbage.
    """
    found = []
    for line in lines:
        fields = line.decode("utf-8", "replace").split(None if delimiter == " " else delimiter)
        try:
            row = [float(field) if field.strip() else np.nan for field in fields]
        except ValueError:
            row = []
        if len(row) == columns:
            found.append(row)
        elif line.strip():
            dropped[Dropped.GARBAGE] += 1
    return np.array(found).reshape(-1, columns)


class RunSource:
    """A run directory whose streams are CSV that grows; its rows are kept as they are."""

    rereads = True

    def __init__(self, path: Path) -> None:
        self.path, self.dropped = path, Counter[str]()
        self._open: dict[str, tuple[Lines, list[str]]] = {}
        if any(path.glob("imu.parquet")) or any(path.glob("imu.csv.gz")):
            raise InputError(f"{path}: imu.parquet does not grow: needed imu.csv (recal update)")

    def header(self) -> RunHeader | None:
        """What its run.json says; None while there is none."""
        if not (self.path / "run.json").exists():
            return None
        data = read_json_object(self.path / "run.json")
        header, errors, _ = header_from_json(data, name=str(self.path / "run.json"))
        if header is None:
            raise InputError(errors[0])
        return header

    def run_json(self) -> str | None:
        """Its own."""
        return (self.path / "run.json").read_text("utf-8")

    def read(self, wait_s: float) -> list[Rows]:
        """What was added to its streams since."""
        del wait_s  # a file is never waited for
        return [rows for stream in GROWING if (rows := self._rows(stream)) is not None]

    def _rows(self, stream: str) -> Rows | None:
        path = self.path / f"{stream}.csv"
        if stream not in self._open:
            if not path.exists():
                return None
            self._open[stream] = (Lines(path), [])
        lines, names = self._open[stream]
        found = lines.read()
        if not names and found:
            names += _names(found.pop(0))
            wrong = check_columns(stream, names, where=str(path))
            if wrong:
                raise InputError(wrong[0])
            if names[0] != "time_s":
                raise InputError(f"{path}: column time_s, needed as the first one")
        found = [line.rstrip(b"\r") for line in found]
        good = [line for line in found if line.count(b",") == len(names) - 1]
        values = numbers(found, len(names), self.dropped, ",")
        if not len(values):
            return None
        if len(good) != len(values):  # one of them is no row of numbers
            return Rows(stream, names, values)
        return Rows(stream, names, values, [line.decode() for line in good])

    def close(self) -> None:
        """Let go of the files."""
        for lines, _ in self._open.values():
            lines.close()


@dataclass(frozen=True)
class _Table:
    """A table's map, its columns, and those of the run."""

    keys: ColumnMap
    names: list[str]
    columns: tuple[str, ...]


class TableSource:
    """A table of text with a row an imu sample, by its map or by the names of a run's columns.

    Parameters
    ----------
    path : Path or None
        None: standard input.
    options : LogOptions
        The column map.
    header : callable
        Makes the run's header of what the map's [run] says.
    """

    rereads = True

    def __init__(
        self, path: Path | None, options: LogOptions, header: Callable[[LogOptions], RunHeader]
    ) -> None:
        self.dropped = Counter[str]()
        self._label = "standard input" if path is None else path.name
        self._lines, self._options, self._made = Lines(path), options.keys, header
        self._table: _Table | None = None
        self._head: list[bytes] = []
        self._rows, self._warm = 0, np.zeros((0, 4))

    def header(self) -> RunHeader | None:
        """Of the options and the map's [run]."""
        return self._made(LogOptions(self._options.get("run", {})))

    def run_json(self) -> str | None:
        """None."""
        return None

    def read(self, wait_s: float) -> list[Rows] | None:
        """What was added to the table since."""
        if self._lines.ended:
            return None
        lines = [line.rstrip(b"\r") for line in self._lines.read(wait_s)]
        comment = str(self._options.get("comment") or "").encode()
        if comment:
            lines = [line for line in lines if not line.startswith(comment)]
        if self._table is None:
            self._head += lines
            needed = int(self._options.get("header_lines") or not self._options.get("columns"))
            if len(self._head) <= needed:
                return []
            lines = self._begun(self._head, needed)
        if self._table is None or not lines:
            return []
        table = self._table
        if table.keys.decimal == ",":
            lines = [line.replace(b",", b".") for line in lines]
        delimiter = " " if table.keys.format == "text" else table.keys.delimiter
        values = numbers(lines, len(table.names), self.dropped, delimiter)
        return self._split(table, values) if len(values) else []

    def _begun(self, lines: list[bytes], header_lines: int) -> list[bytes]:
        """The lines behind those of the header, which is understood."""
        options = LogOptions(self._options)
        names = list(self._options.get("columns") or ())
        if not names:
            as_words = self._options.get("format") == "text"
            delimiter = " " if as_words else str(self._options.get("delimiter", ","))
            at = int(self._options.get("names_line") or header_lines)
            names = _names(lines[at - 1], delimiter)
        if not {"gyro", "accel"} & set(self._options):
            options = options.over(own_map(names, self._label))
        keys = column_map(options)
        for key in ("gnss", "odometer"):
            if getattr(keys, key) is not None:
                raise InputError(f"map: {key}: a table that grows brings no {key}; convert does")
        if keys.temperature is not None and keys.temperature.file is not None:
            raise InputError("map: temperature.file: needed columns of the table that grows")
        missing = [name for name in used_columns(keys) if name not in names]
        if missing:
            raise InputError(f"{self._label}: column {missing[0]} is missing")
        _, kind = sensor_vectors({n: np.zeros(1) for n in names}, keys.gyro, axis_matrix(keys.axes))
        columns = RATE_COLUMNS if kind == "rates" else INCREMENT_COLUMNS
        self._table = _Table(keys, names, ("time_s", *columns))
        return lines[header_lines:]

    def _split(self, table: _Table, values: NDArray) -> list[Rows]:
        """Rows of the imu, and of the temperatures the means of the seconds that are over."""
        keys = table.keys
        columns = {name: values[:, k] for k, name in enumerate(table.names)}
        M = axis_matrix(keys.axes)
        w, kind = sensor_vectors(columns, keys.gyro, M)
        f, other = sensor_vectors(columns, keys.accel, M)
        if kind != other:
            raise InputError("map: gyro and accel, needed both as rates or both as increments")
        time_s = self._times(keys, columns, len(values))
        imu = Rows("imu", table.columns, np.column_stack([time_s, w, f]))
        if keys.temperature is None:
            return [imu]
        degC = body_temperatures(columns, keys.temperature, keys.axes)
        self._warm = np.concatenate([self._warm, np.column_stack([time_s, degC])])
        over = self._warm[:, 0] < np.floor(self._warm[-1, 0])
        means = second_means(self._warm[over, 0], self._warm[over, 1:])
        self._warm = self._warm[~over]
        if means is None:
            return [imu]
        warm = np.column_stack([means.time_s, means.gyro_degC])
        return [imu, Rows("temperature", ("time_s", *GYRO_DEGC), warm)]

    def _times(self, keys: ColumnMap, columns: Mapping[str, NDArray], n: int) -> NDArray:
        if keys.time is not None:
            return np.asarray(columns[keys.time.column] * TIME_UNITS[keys.time.unit])
        assert keys.rate_hz is not None  # column_map has refused a map with neither
        first, self._rows = self._rows, self._rows + n
        return np.arange(first + 1, first + n + 1) / keys.rate_hz

    def close(self) -> None:
        """Let go of the file."""
        self._lines.close()


def _names(line: bytes, delimiter: str = ",") -> list[str]:
    text = line.decode("utf-8-sig", "replace").strip()
    if delimiter == " ":
        return text.split()
    return [name.strip() for name in next(csv.reader([text], delimiter=delimiter), [])]
