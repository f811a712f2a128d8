"""Logs as text: rows of numbers between commas (or another separator) or white space."""

import csv
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ins.records import InputError
from trajectories.readers.column_map import ColumnMap, column_map
from trajectories.readers.columns import converted
from trajectories.readers.registry import ConvertedLog, Reader
from trajectories.run_schema import GYRO_DEGC, INCREMENTS, RATES
from trajectories.text_rows import parse_rows, read_text

OWN_UNITS = (("rad/s", "m/s2", RATES), ("rad", "m/s", INCREMENTS))


def read(path: Path, options: Mapping[str, Any]) -> ConvertedLog:
    """A text log by its map; a CSV whose header already has the names of formats.md needs none."""
    text, note = read_text(path)
    keys = column_map(options if options.get("gyro") or options.get("accel") else _own_map(text, options, path.name))
    delimiter = " " if keys.format == "text" else keys.delimiter
    names, rows, first_line = _split_header(text, keys, delimiter, path.name)
    table, notes = parse_rows(rows, names, label=path.name, delimiter=delimiter, first_line=first_line)
    columns = {name: table.column(name).to_numpy() for name in names}
    return converted(columns, keys, label=path.name, notes=([note] if note else []) + notes)


def detect(path: Path) -> bool:
    """Whether the first line names the imu columns of formats.md."""
    with path.open("rb") as file:
        names = _names(file.readline(100_000), ",")
    return any(set(columns) <= set(names) and "time_s" in names for _, _, columns in OWN_UNITS)


def _own_map(text: bytes, options: Mapping[str, Any], label: str) -> dict[str, Any]:
    names = _names(text[:100_000].partition(b"\n")[0], ",")
    for gyro, accel, columns in OWN_UNITS:
        if set(columns) <= set(names):
            own: dict[str, Any] = {"gyro": {"columns": list(columns[:3]), "unit": gyro}, "time": {"column": "time_s"}}
            own["accel"] = {"columns": list(columns[3:]), "unit": accel}
            if set(GYRO_DEGC) <= set(names):
                own["temperature"] = {"columns": list(GYRO_DEGC)}
            return {**own, **options}
    raise InputError(f"{label}: line 1 does not name the imu columns, needed [gyro] and [accel] in the map")


def _split_header(text: bytes, keys: ColumnMap, delimiter: str, label: str) -> tuple[list[str], bytes, int]:
    """Column names, the rows, and the number of the first line of rows."""
    count = keys.header_lines if keys.header_lines is not None else int(keys.columns is None)
    line = b""
    for k in range(count):
        line, end, text = text.partition(b"\n")
        if not end:
            raise InputError(f"{label}: {k + 1} lines, needed {count} header lines and rows")
    names = keys.columns if keys.columns is not None else _names(line, delimiter)
    twice = [name for name in names if names.count(name) > 1]
    if not names or twice:
        raise InputError(f"{label}: column {twice[0]} appears twice" if twice else f"{label}: no column names")
    return names, text, count + 1


def _names(line: bytes, delimiter: str) -> list[str]:
    words = line.decode("utf-8-sig", errors="replace").strip()
    if delimiter == " ":
        return words.split()
    try:
        return [name.strip() for name in next(csv.reader([words], delimiter=delimiter), [])]
    except csv.Error:  # not a line of text
        return []


def _never(path: Path) -> bool:
    return False


READERS = (
    Reader(name="csv", about="separated values; without a map only under the names of a run's imu stream",
           detect=detect, read=read),
    Reader(name="text", about="columns between white space, needs a map", detect=_never, read=read),
)  # fmt: skip
