"""Rows of numbers in text, plain or in gzip: whole, or a block of lines at a time.

What is said of a row does not depend on how the text was cut into blocks.
"""

import codecs
import csv
import re
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ins.records import InputError
from ins.user_input import open_regular
from trajectories.runs.limits import NUMBER_BYTES, refuse_held, refuse_unpacked
from trajectories.runs.notes import About, Note

MAX_ROWS = 100_000_000  # 13.9 h at 2 kHz
MAX_COLUMNS = 10_000  # of a row: the widest logs known here, of autopilots, have some 300
MAX_TEXT_BYTES = 8_000_000_000  # MAX_ROWS of 80 characters
# chosen: 40,000 numbers of 25 characters; longer is a file without line ends
MAX_LINE_BYTES = 1_000_000
BLOCK_BYTES = 1 << 22
UNPACK_BYTES = 1 << 12  # of a gzip file at a time: what damage costs of the text before it
MAX_BAD = 0.01  # of the lines or rows of a log: damage costs a few, a wrong map all; chosen: 1 %
MENDED_LINES = 5  # of a log so short that MAX_BAD of it is less: below 500 lines
LISTED_ROWS = 10  # bad lines or stretches named of one kind: 10 numbers fit a line of a terminal
SHOWN_CHARACTERS = 40  # of a field that is no number
MISSING = ("", "nan", "NaN", "NAN", "NA", "null")
Block = tuple[bytes, bool]  # whole lines, and whether they are the last


def refuse_rows(rows: int, columns: int, path: Path) -> None:
    """InputError where a packed table says that it has more rows than a log has, or more numbers
    than so small a file may unpack to.
    """
    if rows > MAX_ROWS:
        raise InputError(f"{path.name}: {rows} rows, needed at most {MAX_ROWS}")
    size = path.stat().st_size
    refuse_unpacked(rows * columns * NUMBER_BYTES, size, path.name, f"bytes in {rows} rows")


@dataclass(frozen=True)
class TextSize:
    """How long a text is, as far as it can be unpacked: bytes, line feeds, carriage returns."""

    size: int
    feeds: int
    returns: int

    @property
    def lines(self) -> int:
        """How many lines have an end."""
        return self.feeds or self.returns


def text_size(path: Path, columns: int) -> TextSize:
    """The length of a text, counted without keeping any of it. InputError where a gzip file
    unpacks to more than it may, as text or as rows of so many numbers.
    """
    packed = path.stat().st_size
    size = feeds = returns = 0
    for part in text_parts(path, []):
        size += len(part)
        feeds += part.count(b"\n")
        returns += part.count(b"\r")
        if path.name.endswith(".gz"):
            rows = max(feeds, returns)
            numbers = rows * columns * NUMBER_BYTES
            refuse_unpacked(numbers, packed, path.name, f"bytes in {rows} rows")
    return TextSize(size, feeds, returns)


def text_parts(path: Path, notes: list[str], *, block_bytes: int = BLOCK_BYTES) -> Iterator[bytes]:
    """The text in parts of about `block_bytes`, gunzipped as far as it goes; what is wrong with the
    gzip goes to `notes`.

    A byte order mark in front is no text.
    """
    parts = _parts(path, notes, block_bytes)
    first = next(parts, b"").removeprefix(codecs.BOM_UTF8)
    if first:
        yield first
    yield from parts


def _parts(path: Path, notes: list[str], block_bytes: int) -> Iterator[bytes]:
    if path.stat().st_size > MAX_TEXT_BYTES:
        raise InputError(f"{path}: {path.stat().st_size} bytes, needed at most {MAX_TEXT_BYTES}")
    if path.name.endswith(".gz"):
        yield from _gunzip(path, notes)
        return
    with open_regular(path) as file:
        while part := file.read(block_bytes):
            yield part


def _gunzip(path: Path, notes: list[str]) -> Iterator[bytes]:
    """What can be unpacked of a gzip file of one or more members; a note where it ends too
    early.
    """
    packed = path.stat().st_size
    size, unpack, note = 0, zlib.decompressobj(wbits=31), ""
    with open_regular(path) as file:
        try:
            while chunk := unpack.unused_data or file.read(UNPACK_BYTES):
                if unpack.eof:
                    unpack = zlib.decompressobj(wbits=31)
                part = unpack.decompress(chunk)
                size += len(part)
                refuse_unpacked(size, packed, path.name)
                if part:
                    yield part
        except zlib.error as error:
            note = str(error)
    if not unpack.eof:
        note = note or "the file ends too early"
        if not size:
            raise InputError(f"{path}: not a gzip file ({note})")
        told = f"gzip data damaged after {size} bytes ({note}), the rest dropped"
        notes.append(Note(told, About.DAMAGE))


def line_blocks(
    parts: Iterator[bytes], *, label: str, block_bytes: int = BLOCK_BYTES
) -> Iterator[tuple[bytes, bool]]:
    """Whole lines, at least `block_bytes` of them, and whether they are the last: the last block
    alone may end without a line end, and no block but the last ends in what may be the last line of
    the text.
    """
    held = bytearray()
    for part in parts:
        if len(held) < block_bytes:
            held += part
            continue
        cut = held.rfind(b"\n") + 1
        rest = held[cut:] + part
        if cut >= block_bytes and rest[: rest.rfind(b"\n") + 1].strip():
            yield bytes(held[:cut]), False
            held = rest
        else:
            held += part
        if len(held) > MAX_LINE_BYTES + 2 * block_bytes and b"\n" not in held:
            raise InputError(f"{label}: a line of more than {MAX_LINE_BYTES} bytes")
    yield bytes(held), True


@dataclass(frozen=True, kw_only=True)
class RowLayout:
    """How rows of numbers stand in a text.

    names: of the columns; label: of the file, for messages; delimiter: " " means any white space;
    first_line: of the file, the one that holds the first row; used: columns that are wanted (None:
    all).
    """

    names: Sequence[str]
    label: str
    delimiter: str = ","
    first_line: int = 2
    used: Sequence[str] | None = None

    @cached_property
    def wanted(self) -> set[str]:
        """The names of the columns that are wanted."""
        return set(self.names if self.used is None else self.used)


def parse_block(
    text: bytes, layout: RowLayout, *, lines_before: int = 0, last: bool = True
) -> tuple[Any, list[str]]:
    """A pyarrow table of float64 columns from a block of rows that has `lines_before` lines of rows
    before it, and what was dropped; no table where it holds no row.

    A last row without a line end, or broken, is a cut-off file: dropped and noted. InputError for
    any other line that is no row, with its number and column.
    """
    label = layout.label
    notes: list[str] = []
    if last and text and not text.endswith((b"\n", b"\r")):
        text = text[: max(text.rfind(b"\n"), text.rfind(b"\r")) + 1]
        told = f"{label}: last row has no line end (file cut off?), dropped"
        notes.append(Note(told, About.DAMAGE))
    table, problem = _arrow_table(text, layout)
    bad = _first_bad_line(text, layout) if problem else None
    if bad is not None:
        row = lines_before + bad.line
        where = f"{label}: row {row + 1} (line {row + layout.first_line}): {bad.fault.why}"
        if not (last and bad.at_end):
            raise BadRowError(where, field=bad.fault.field)
        notes.append(f"{where}: last row dropped")
        text = text.rstrip(b"\r\n")
        table, problem = _arrow_table(text[: text.rfind(b"\n") + 1], layout)
    if problem:
        raise InputError(f"{label}: {problem}")
    return table, notes


class BadRowError(InputError):
    """A line that is no row of numbers; `field`: the text that was to be a number, where that is
    the fault.
    """

    def __init__(self, text: str, *, field: str | None) -> None:
        super().__init__(text)
        self.field = field


class _Fault(NamedTuple):
    """What is wrong with a line, and the text that was to be a number, where that is the fault."""

    why: str
    field: str | None = None


class _BadLine(NamedTuple):
    """The first line that is no row: its number from 0, whether it is the last, what is wrong."""

    line: int
    at_end: bool
    fault: _Fault


def mended(text: bytes, layout: RowLayout) -> tuple[bytes, dict[int, str]]:
    """The text with missing values for lines that are no rows; of those the index and the fault."""
    lines = text.split(b"\n")
    end = lines.pop()
    bad: dict[int, str] = {}
    for k, line in enumerate(lines):
        fault = _wrong_line(line, layout) if line.strip() else None
        if fault is not None:
            bad[k] = fault.why
    missing = layout.delimiter.join(["nan"] * len(layout.names)).encode()
    for k in bad:
        lines[k] = missing
    return b"\n".join([*lines, end]), bad


def _arrow_table(text: bytes, layout: RowLayout) -> tuple[Any, str]:
    """The table, None where the text is blank, and what the parser complains of."""
    import pyarrow as pa
    from pyarrow import csv as arrow_csv

    delimiter = layout.delimiter
    if delimiter == " ":
        text, delimiter = _separated(text), ","
    if not text.strip():
        return None, ""
    keys = [str(i) for i in range(len(layout.names))]
    wanted = [key for key, name in zip(keys, layout.names) if name in layout.wanted]
    try:
        table = arrow_csv.read_csv(
            pa.BufferReader(text),
            read_options=arrow_csv.ReadOptions(column_names=keys, use_threads=False),
            parse_options=arrow_csv.ParseOptions(delimiter=delimiter),
            convert_options=arrow_csv.ConvertOptions(
                column_types=dict.fromkeys(wanted, pa.float64()),
                null_values=list(MISSING),
                include_columns=wanted,
            ),
        )
    except pa.ArrowException as error:
        return None, arrow_words(error)
    return table.rename_columns([layout.names[int(k)] for k in wanted]), ""


def _separated(text: bytes) -> bytes:
    """Columns between white space as columns between commas.

    Each step goes over the text once: a pattern such as [ ]+$ begins anew at every blank of a run,
    which takes the square of its length.
    """
    text = re.sub(rb"[ \t]+", b" ", text).replace(b" \r", b"\r")
    text = re.sub(rb"\r+", b"\r", text).replace(b"\r\n", b"\n")
    text = text.replace(b" \n", b"\n").replace(b"\n ", b"\n")
    return text.strip(b" ").replace(b" ", b",")


def arrow_words(error: Exception) -> str:
    """What Arrow complains of, without its row, which counts from the block's first."""
    return re.sub(r"Row #\d+: ", "", " ".join(str(error).split()))[:200]


def _first_bad_line(text: bytes, layout: RowLayout) -> _BadLine | None:
    """The first line that is not one number a used column; None where there is none."""
    lines = text.decode("utf-8", errors="replace").splitlines()
    while lines and not lines[-1].strip():
        lines.pop()
    for i, line in enumerate(lines):
        fault = _wrong_line(line.encode(), layout) if line.strip() else None
        if fault is not None:
            return _BadLine(i, i == len(lines) - 1, fault)
    return None


def _wrong_line(line: bytes, layout: RowLayout) -> _Fault | None:
    """What is wrong with a line of one number a used column; None where nothing is."""
    text = line.decode("utf-8", errors="replace").rstrip("\r")
    if "\r" in text or "\0" in text:
        return _Fault("not a row of text")
    try:
        fields = _fields(text, layout.delimiter)
    except csv.Error:
        return _Fault("not a row of separated values")
    return _wrong_fields(fields, layout) if fields else None


def _fields(text: str, delimiter: str) -> list[str]:
    if delimiter == " ":
        return text.split()
    return next(csv.reader([text], delimiter=delimiter, strict=True), [])


def _wrong_fields(fields: Sequence[str], layout: RowLayout) -> _Fault | None:
    if len(fields) != len(layout.names):
        return _Fault(f"{len(fields)} values, needed {len(layout.names)}")
    for name, field in zip(layout.names, fields):
        given = name in layout.wanted and field.strip() not in MISSING
        if given and not is_number(field):
            got = field[:SHOWN_CHARACTERS]
            return _Fault(f"column {name}: got {got!r}, needed a number", got)
    return None


def is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return "_" not in text


def column_rows(
    blocks: Iterator[Block], layout: RowLayout, lines: int
) -> tuple[dict[str, NDArray], list[str]]:
    """The wanted columns as float64, missing values NaN, and what was dropped; `lines`: of the
    whole text.

    A last row without a line end, or broken, is a cut-off file: dropped and noted. A few broken
    rows before it become rows of missing values, and are noted; with many, the first is an
    InputError with line and column.
    """
    found = _Columns(layout, lines)
    for text, last in blocks:
        found.take(text, last=last)
    return found.joined()


class _Columns:
    """The columns of the blocks so far."""

    def __init__(self, layout: RowLayout, lines: int) -> None:
        self._layout = layout
        self._parts: dict[str, list[NDArray]] = {}
        self._rows = self._lines = 0
        self._notes: list[str] = []
        self._bad: list[int] = []  # lines that are no rows, counted from 0
        self._most_bad = max(MENDED_LINES, MAX_BAD * lines)
        self._why = ""
        self._first: InputError | None = None  # what the first of them is, as an error

    def take(self, text: bytes, *, last: bool) -> None:
        """Take up the rows of a block."""
        layout, before = self._layout, self._lines
        try:
            table, notes = parse_block(text, layout, lines_before=before, last=last)
        except InputError as error:
            self._first = self._first or error
            text, bad = mended(text, layout)
            self._bad += [before + k for k in bad]
            if not bad or len(self._bad) > self._most_bad:
                raise self._first from None
            self._why = self._why or next(iter(bad.values()))
            table, notes = parse_block(text, layout, lines_before=before, last=last)
        self._notes += notes
        self._lines += text.count(b"\n")
        if table is None:
            return
        self._rows += table.num_rows
        refuse_held(self._rows, table.num_columns, layout.label)
        for name in table.column_names:
            self._parts.setdefault(name, []).append(table.column(name).to_numpy())

    def joined(self) -> tuple[dict[str, NDArray], list[str]]:
        """The columns whole, and the notes; the parts of a column go when it is joined."""
        label, bad = self._layout.label, self._bad
        if not self._rows:
            raise InputError(f"{label}: no rows")
        if bad:
            shown = ", ".join(str(self._layout.first_line + k) for k in bad[:LISTED_ROWS])
            if len(bad) > LISTED_ROWS:
                shown += f" and {len(bad) - LISTED_ROWS} more"
            told = (
                f"{label}: no row of {len(self._layout.names)} numbers in line {shown}"
                f" ({self._why}): taken as missing"
            )
            self._notes.insert(0, told)
        return joined_columns(self._parts), self._notes


def joined_columns(parts: dict[str, list[NDArray]]) -> dict[str, NDArray]:
    """The columns whole; the parts of each, which Arrow holds, go when it is joined."""
    import pyarrow as pa

    names = list(parts)
    columns = {name: np.concatenate(parts.pop(name)) for name in names}
    pa.default_memory_pool().release_unused()
    return columns
