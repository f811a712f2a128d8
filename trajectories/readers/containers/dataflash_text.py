"""ArduPilot logs as text (.log, as Mission Planner and dronekit print them): a message a line,
`NAME, value, value ...`.

FMT lines name the fields of a message. Values are in plain units already.
"""

from array import array
from collections.abc import Collection
from pathlib import Path

import numpy as np

from ins.records import InputError
from trajectories.readers.containers.dataflash import TEXT_FIELDS, Tables
from trajectories.readers.rows.increment_rows import is_file_of
from trajectories.runs.limits import NUMBER_BYTES, Room
from trajectories.runs.notes import About, Note, joined, labelled
from trajectories.runs.text_rows import LISTED_ROWS, is_number, line_blocks, text_parts

Formats = dict[str, tuple[str, list[str]]]  # name -> letters, columns
# of a text in a message: what a field of 64 bytes holds (dataflash.FIELDS, Z)
MAX_TEXT = 64
MAX_TEXTS = 1_000_000  # messages with a text; parameters and remarks are some 2,000 in a log


def is_dataflash_text(path: Path) -> bool:
    """Whether the first line is the FMT line that describes FMT."""
    return is_file_of(path, rb"\A\s*FMT *, *128 *,[^\r\n]*\bFMT\b")


def read_tables(path: Path, wanted: Collection[str]) -> tuple[Tables, list[str]]:
    """The wanted messages of a log, and notes on what was skipped. InputError where none of them
    can be read.
    """
    packed: list[str] = []
    messages = _Messages(Room(path.stat().st_size, path.name) if path.suffix == ".gz" else None)
    cut = False
    for block, last in line_blocks(text_parts(path, packed), label=path.name):
        lines = block.decode("utf-8", errors="replace").splitlines()
        if last and lines and not block.endswith((b"\n", b"\r")):
            lines.pop()
            cut = True
        for line in lines:
            messages.take(line, wanted)
    tables = {name: table.columns() for name, table in messages.tables.items()}
    if not tables:
        raise InputError(f"{path.name}: holds none of the messages {' '.join(sorted(wanted))}")
    note = joined(packed)
    if cut:
        told = Note("last line has no line end (file cut off?), dropped", About.DAMAGE)
        note = joined((note, told))
    if bad := messages.bad:
        more = f" and {len(bad) - LISTED_ROWS} more" if len(bad) > LISTED_ROWS else ""
        listed = ", ".join(map(str, bad[:LISTED_ROWS]))
        note = joined((note, Note(f"damaged, skipped: lines {listed}{more}", About.DAMAGE)))
    return tables, [labelled(path.name, note)] if note else []


class _Messages:
    """The messages so far, by name, and the lines that are damaged; `room`: of a packed log."""

    def __init__(self, room: Room | None) -> None:
        self.tables: dict[str, _Table] = {}
        self.bad: list[int] = []
        self._formats: Formats = {}
        self._lines = 0
        self._room = room

    def take(self, line: str, wanted: Collection[str]) -> None:
        """Take up a line."""
        self._lines += 1
        name, *values = (word.strip() for word in line.split(","))
        if name == "FMT":
            _learn(self._formats, values)
        elif name in wanted:
            if values := _row(self._formats, name, values):
                table = self.tables.setdefault(name, _Table(name, self._formats[name]))
                table.take(values)
                if self._room is not None:
                    self._room.take(NUMBER_BYTES * len(values))
            else:
                self.bad.append(self._lines)


class _Table:
    """The messages of a name: numbers as they come in, texts cut to what a field holds."""

    def __init__(self, name: str, form: tuple[str, list[str]]) -> None:
        letters, self._columns = form
        self._name, self._rows = name, 0
        self._texts: list[list[str] | None] = [[] if k in TEXT_FIELDS else None for k in letters]
        self._numbers = [array("d") for _ in letters]

    def take(self, values: list[str]) -> None:
        """Take up a message."""
        self._rows += 1
        if self._rows > MAX_TEXTS and any(texts is not None for texts in self._texts):
            raise InputError(f"more than {MAX_TEXTS} messages {self._name}, needed at most that")
        for value, texts, numbers in zip(values, self._texts, self._numbers):
            if texts is None:
                numbers.append(float(value))
            else:
                texts.append(value[:MAX_TEXT])

    def columns(self) -> dict[str, np.ndarray]:
        """The fields by name."""
        held = zip(self._columns, self._texts, self._numbers)
        return {
            name: np.frombuffer(numbers, dtype=np.float64) if texts is None else np.array(texts)
            for name, texts, numbers in held
        }


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
