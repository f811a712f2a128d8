"""ArduPilot logs as text (.log, as Mission Planner and dronekit print them): a message a line,
`NAME, value, value ...`.

FMT lines name the fields of a message. Values are in plain units already.
"""

from collections.abc import Collection
from pathlib import Path

import numpy as np

from ins.records import InputError
from trajectories.readers.containers.dataflash import TEXT_FIELDS, Tables
from trajectories.readers.rows.increment_rows import is_file_of
from trajectories.runs.notes import About, Note, joined, labelled
from trajectories.runs.text_rows import LISTED_ROWS, is_number, read_text

Formats = dict[str, tuple[str, list[str]]]  # name -> letters, columns


def is_dataflash_text(path: Path) -> bool:
    """Whether the first line is the FMT line that describes FMT."""
    return is_file_of(path, rb"\A\s*FMT *, *128 *,[^\r\n]*\bFMT\b")


def read_tables(path: Path, wanted: Collection[str]) -> tuple[Tables, list[str]]:
    """The wanted messages of a log, and notes on what was skipped. InputError where none of them
    can be read.
    """
    data, note = read_text(path)
    lines = data.decode("utf-8", errors="replace").splitlines()
    if lines and not data.endswith((b"\n", b"\r")):
        lines.pop()
        cut = Note("last line has no line end (file cut off?), dropped", About.DAMAGE)
        note = joined((note, cut))
    formats: Formats = {}
    rows: dict[str, list[list[str]]] = {}
    bad: list[int] = []
    for number, line in enumerate(lines, start=1):
        name, *values = (word.strip() for word in line.split(","))
        if name == "FMT":
            _learn(formats, values)
        elif name in wanted:
            if values := _row(formats, name, values):
                rows.setdefault(name, []).append(values)
            else:
                bad.append(number)
    tables = {name: _columns(formats[name], found) for name, found in rows.items()}
    if not tables:
        raise InputError(f"{path.name}: holds none of the messages {' '.join(sorted(wanted))}")
    if bad:
        more = f" and {len(bad) - LISTED_ROWS} more" if len(bad) > LISTED_ROWS else ""
        listed = ", ".join(map(str, bad[:LISTED_ROWS]))
        note = joined((note, Note(f"damaged, skipped: lines {listed}{more}", About.DAMAGE)))
    return tables, [labelled(path.name, note)] if note else []


def _learn(formats: Formats, values: list[str]) -> None:
    """Type, length, name, letters, then the columns; the first format of a name is kept, a garbled
    one not taken.
    """
    name, letters, columns = (
        values[2] if len(values) > 2 else "",
        values[3] if len(values) > 3 else "",
        values[4:],
    )
    if name and len(letters) == len(columns) == len(set(columns)):
        formats.setdefault(name, (letters, columns))


def _row(formats: Formats, name: str, values: list[str]) -> list[str]:
    """The values of a message, one a column; empty where the line is damaged. The last text may
    hold commas.
    """
    letters, columns = formats.get(name, ("", []))
    if columns and letters[-1] in TEXT_FIELDS and len(values) > len(columns):
        values = [*values[: len(columns) - 1], ",".join(values[len(columns) - 1 :])]
    numbers = (v for v, letter in zip(values, letters) if letter not in TEXT_FIELDS)
    return (
        values
        if columns and len(values) == len(columns) and all(is_number(v) for v in numbers)
        else []
    )


def _columns(form: tuple[str, list[str]], rows: list[list[str]]) -> dict[str, np.ndarray]:
    letters, columns = form
    return {
        name: np.array(found) if letter in TEXT_FIELDS else np.array(found, dtype=np.float64)
        for name, letter, found in zip(columns, letters, zip(*rows))
    }
