"""Rows of numbers in text, plain or in gzip: whole, or a block of lines at a time.

What is said of a row does not depend on how the text was cut into blocks.
"""

import codecs
import csv
import re
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from ins.records import InputError
from trajectories.runs.notes import About, Note, joined

MAX_ROWS = 100_000_000  # 13.9 h at 2 kHz
SMALL_ROWS = 5_000_000  # of a Parquet file of any size: constants take next to nothing
MAX_ROWS_PER_BYTE = 20  # of a Parquet file beyond that
MAX_TEXT_BYTES = 8_000_000_000  # MAX_ROWS of 80 characters
# chosen: 40,000 numbers of 25 characters; longer is a file without line ends
MAX_LINE_BYTES = 1_000_000
BLOCK_BYTES = 1 << 22
# Unpacked bytes of each packed one: a log of constants grows a hundredfold.
MAX_GROWTH = 200
SMALL_BYTES = 1 << 28  # what a log may unpack to in any case: 268 MB
UNPACK_BYTES = 1 << 12  # of a gzip file at a time: what damage costs of the text before it
MAX_BAD = 0.01  # of the lines or rows of a log: damage costs a few, a wrong map all; chosen: 1 %
MENDED_LINES = 5  # of a log so short that MAX_BAD of it is less: below 500 lines
LISTED_ROWS = 10  # bad lines or stretches named of one kind: 10 numbers fit a line of a terminal
SHOWN_CHARACTERS = 40  # of a field that is no number
MISSING = ("", "nan", "NaN", "NAN", "NA", "null")


def refuse_rows(rows: int, path: Path) -> None:
    """InputError where a packed table says that it has more rows than a log has, or than so small a
    file can hold.
    """
    most = min(MAX_ROWS, SMALL_ROWS + MAX_ROWS_PER_BYTE * path.stat().st_size)
    if rows > most:
        raise InputError(
            f"{path.name}: {rows} rows in {path.stat().st_size} bytes, needed at most {most}"
        )


def read_text(path: Path) -> tuple[bytes, str]:
    """The bytes of a text file, gunzipped as far as it goes, and a note where a gzip file is cut
    off or damaged.
    """
    notes: list[str] = []
    text = bytearray()
    for part in text_parts(path, notes):
        text += part
    return bytes(text), joined(notes)


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
    with path.open("rb") as file:
        while part := file.read(block_bytes):
            yield part


def _gunzip(path: Path, notes: list[str]) -> Iterator[bytes]:
    """What can be unpacked of a gzip file of one or more members; a note where it ends too
    early.
    """
    most = min(MAX_TEXT_BYTES, SMALL_BYTES + MAX_GROWTH * path.stat().st_size)
    size, unpack, note = 0, zlib.decompressobj(wbits=31), ""
    with path.open("rb") as file:
        try:
            while chunk := unpack.unused_data or file.read(UNPACK_BYTES):
                if unpack.eof:
                    unpack = zlib.decompressobj(wbits=31)
                part = unpack.decompress(chunk)
                size += len(part)
                if size > most:
                    raise InputError(
                        f"{path}: more than {most} bytes unpacked, needed at most that"
                    )
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
    held = b""
    for part in parts:
        cut = held.rfind(b"\n") + 1
        rest = held[cut:] + part
        if cut >= block_bytes and rest[: rest.rfind(b"\n") + 1].strip():
            yield held[:cut], False
            held = rest
        else:
            held += part
        if len(held) > MAX_LINE_BYTES + 2 * block_bytes and b"\n" not in held:
            raise InputError(f"{label}: a line of more than {MAX_LINE_BYTES} bytes")
    yield held, True


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

    @property
    def wanted(self) -> Sequence[str]:
        return self.names if self.used is None else self.used


def parse_rows(text: bytes, layout: RowLayout) -> tuple[Any, list[str]]:
    """A pyarrow table of float64 columns from rows of text, and what was dropped.

    A last row without a line end, or broken, is a cut-off file: dropped and noted. A few broken
    rows before it become rows of missing values, and are noted; with many, the first is an
    InputError with line and column.
    """
    label = layout.label
    try:
        table, notes = parse_block(text, layout)
    except InputError:
        text, bad, why = _mended(text, layout)
        if not bad:
            raise
        table, notes = parse_block(text, layout)
        shown = ", ".join(str(layout.first_line + k) for k in bad[:LISTED_ROWS])
        if len(bad) > LISTED_ROWS:
            shown += f" and {len(bad) - LISTED_ROWS} more"
        mended = (
            f"{label}: no row of {len(layout.names)} numbers in line {shown} ({why}): taken as"
            " missing"
        )
        notes = [mended, *notes]
    if table is None:
        raise InputError(f"{label}: no rows")
    if table.num_rows > MAX_ROWS:
        raise InputError(f"{label}: {table.num_rows} rows, needed at most {MAX_ROWS}")
    return table, notes


def parse_block(
    text: bytes, layout: RowLayout, *, lines_before: int = 0, last: bool = True
) -> tuple[Any, list[str]]:
    """`parse_rows` of a block that has `lines_before` lines of rows before it; no table where it
    holds no row.
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


def _mended(text: bytes, layout: RowLayout) -> tuple[bytes, list[int], str]:
    """The text with missing values for lines that are no rows, the indices of those (none if many),
    the first's fault.
    """
    lines = text.split(b"\n")
    end = lines.pop()
    bad: dict[int, str] = {}
    for k, line in enumerate(lines):
        fault = _wrong_line(line, layout) if line.strip() else None
        if fault is not None:
            bad[k] = fault.why
    if not bad or len(bad) > max(MENDED_LINES, MAX_BAD * len(lines)):
        return text, [], ""
    missing = layout.delimiter.join(["nan"] * len(layout.names)).encode()
    for k in bad:
        lines[k] = missing
    return b"\n".join([*lines, end]), list(bad), next(iter(bad.values()))


def _arrow_table(text: bytes, layout: RowLayout) -> tuple[Any, str]:
    """The table, None where the text is blank, and what the parser complains of."""
    import pyarrow as pa
    from pyarrow import csv as arrow_csv

    delimiter = layout.delimiter
    if delimiter == " ":
        text = re.sub(rb"(?m)^[ \t]+|[ \t\r]+$", b"", text)
        text = re.sub(rb"[ \t]+", b",", text)
        delimiter = ","
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
