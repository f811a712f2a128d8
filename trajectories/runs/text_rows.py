"""Rows of numbers in text, plain or in gzip: whole, or a block of lines at a time.

What is said of a row does not depend on how the text was cut into blocks.
"""

import codecs
import csv
import re
import zlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from ins.records import InputError

MAX_ROWS = 100_000_000  # 13.9 h at 2 kHz
SMALL_ROWS, MAX_ROWS_PER_BYTE = 5_000_000, 20  # of a Parquet file: constants take next to nothing
MAX_TEXT_BYTES = 8_000_000_000
MAX_LINE_BYTES = 1_000_000
BLOCK_BYTES = 1 << 22
# unpacked bytes of each packed one; what a log may unpack to in any case
MAX_GROWTH, SMALL_BYTES = 200, 1 << 28
UNPACK_BYTES = 1 << 12  # of a gzip file at a time: what damage costs of the text before it
MAX_BAD = 0.01  # of the lines of a log; beyond it the map is wrong, not the lines
LISTED = 10  # bad lines named
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
    return bytes(text), "; ".join(notes)


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
        notes.append(f"gzip data damaged after {size} bytes ({note}), the rest dropped")


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


def parse_rows(
    text: bytes,
    names: Sequence[str],
    *,
    label: str,
    delimiter: str = ",",
    first_line: int = 2,
    used: Sequence[str] | None = None,
) -> tuple[Any, list[str]]:
    """A pyarrow table of float64 columns (those of `used`; None: all) from rows of text, and what
    was dropped.

    A last row without a line end, or broken, is a cut-off file: dropped and noted. A few broken
    rows before it become rows of missing values, and are noted; with many, the first is an
    InputError with line and column. `delimiter` " " means any white space.
    """
    try:
        table, notes = parse_block(
            text, names, label=label, delimiter=delimiter, first_line=first_line, used=used
        )
    except InputError:
        text, bad, why = _mended(text, names, delimiter, names if used is None else used)
        if not bad:
            raise
        table, notes = parse_block(
            text, names, label=label, delimiter=delimiter, first_line=first_line, used=used
        )
        shown = ", ".join(str(first_line + k) for k in bad[:LISTED]) + (
            f" and {len(bad) - LISTED} more" * (len(bad) > LISTED)
        )
        notes = [
            f"{label}: no row of {len(names)} numbers in line {shown} ({why}): taken as missing",
            *notes,
        ]
    if table is None:
        raise InputError(f"{label}: no rows")
    if table.num_rows > MAX_ROWS:
        raise InputError(f"{label}: {table.num_rows} rows, needed at most {MAX_ROWS}")
    return table, notes


def parse_block(
    text: bytes,
    names: Sequence[str],
    *,
    label: str,
    delimiter: str = ",",
    first_line: int = 2,
    lines_before: int = 0,
    last: bool = True,
    used: Sequence[str] | None = None,
) -> tuple[Any, list[str]]:
    """`parse_rows` of a block that has `lines_before` lines of rows before it; no table where it
    holds no row.
    """
    notes: list[str] = []
    used = names if used is None else used
    if last and text and not text.endswith((b"\n", b"\r")):
        text = text[: max(text.rfind(b"\n"), text.rfind(b"\r")) + 1]
        notes.append(f"{label}: last row has no line end (file cut off?), dropped")
    table, problem = _arrow_table(text, names, delimiter, used)
    if problem and (bad := _first_bad_line(text, names, delimiter, used)):
        index, at_end, why = bad
        where = (
            f"{label}: row {lines_before + index + 1} (line {lines_before + index + first_line}):"
            f" {why}"
        )
        if not (last and at_end):
            raise InputError(where)
        notes.append(f"{where}: last row dropped")
        text = text.rstrip(b"\r\n")
        table, problem = _arrow_table(text[: text.rfind(b"\n") + 1], names, delimiter, used)
    if problem:
        raise InputError(f"{label}: {problem}")
    return table, notes


def _mended(
    text: bytes, names: Sequence[str], delimiter: str, used: Sequence[str]
) -> tuple[bytes, list[int], str]:
    """The text with missing values for lines that are no rows, the indices of those (none if many),
    the first's fault.
    """
    lines = text.split(b"\n")
    end = lines.pop()
    bad = {
        k: why
        for k, line in enumerate(lines)
        if line.strip() and (why := _wrong_line(line, names, delimiter, used))
    }
    if not bad or len(bad) > max(5, MAX_BAD * len(lines)):
        return text, [], ""
    missing = delimiter.join(["nan"] * len(names)).encode()
    for k in bad:
        lines[k] = missing
    return b"\n".join([*lines, end]), list(bad), next(iter(bad.values()))


def _arrow_table(
    text: bytes, names: Sequence[str], delimiter: str, used: Sequence[str]
) -> tuple[Any, str]:
    """The table, None where the text is blank, and what the parser complains of."""
    import pyarrow as pa
    from pyarrow import csv as arrow_csv

    if delimiter == " ":
        text = re.sub(rb"(?m)^[ \t]+|[ \t\r]+$", b"", text)
        text, delimiter = re.sub(rb"[ \t]+", b",", text), ","
    if not text.strip():
        return None, ""
    keys, wanted = (
        [str(i) for i in range(len(names))],
        [str(i) for i, name in enumerate(names) if name in used],
    )
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
        return None, " ".join(str(error).split())[:200]
    return table.rename_columns([names[int(k)] for k in wanted]), ""


def _first_bad_line(
    text: bytes, names: Sequence[str], delimiter: str, used: Sequence[str]
) -> tuple[int, bool, str] | None:
    """Index of the first line that is not one number a used column, whether it is the last, and
    what is wrong with it.
    """
    lines = text.decode("utf-8", errors="replace").splitlines()
    while lines and not lines[-1].strip():
        lines.pop()
    for i, line in enumerate(lines):
        if line.strip() and (why := _wrong_line(line.encode(), names, delimiter, used)):
            return i, i == len(lines) - 1, why
    return None


def _wrong_line(line: bytes, names: Sequence[str], delimiter: str, used: Sequence[str]) -> str:
    """What is wrong with a line of one number a used column; empty where nothing is."""
    text = line.decode("utf-8", errors="replace").rstrip("\r")
    if "\r" in text or "\0" in text:
        return "not a row of text"
    try:
        fields = (
            text.split()
            if delimiter == " "
            else next(csv.reader([text], delimiter=delimiter, strict=True), [])
        )
    except csv.Error:
        return "not a row of separated values"
    return _wrong_fields(fields, names, used) if fields else ""


def _wrong_fields(fields: Sequence[str], names: Sequence[str], used: Sequence[str]) -> str:
    if len(fields) != len(names):
        return f"{len(fields)} values, needed {len(names)}"
    for name, field in zip(names, fields):
        if name in used and field.strip() not in MISSING and not is_number(field):
            return f"column {name}: got {field[:40]!r}, needed a number"
    return ""


def is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return "_" not in text
