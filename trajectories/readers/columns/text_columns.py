"""Columns of text: rows of numbers between commas (or another separator) or white space, plain or
in gzip.
"""

import csv
import re
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path

from numpy.typing import NDArray

from ins.records import InputError
from trajectories.readers.rows.column_map import LayoutKeys, MapError
from trajectories.runs.text_rows import (
    MAX_COLUMNS,
    BadRowError,
    Block,
    RowLayout,
    TextSize,
    column_rows,
    line_blocks,
    text_parts,
    text_size,
)

# looked at for text and a header; chosen: about 1,000 rows of 100 characters
HEADER_BYTES = 100_000
NO_TEXT = bytes([*range(9), *range(14, 32), *range(127, 256)])
# of the bytes of a text, names in any script and damage allowed for; raw numbers have 0.4
MIN_TEXT = 0.8
SEPARATORS = {",": '","', ";": '";"', "\t": '"\\t"', "|": '"|"'}  # as a map writes them
SIGHTED_TEXT = 1 << 16  # bytes; as many as a log without a head is looked at
LINES_BEFORE = 100  # at most, before the names; chosen: MT Manager writes some 15
SEPARATED_BY = "\t,;"


def text_columns(
    path: Path,
    layout: LayoutKeys,
    used: Sequence[str],
    *,
    rewrite: Callable[[bytes], bytes] | None = None,
) -> tuple[dict[str, NDArray], list[str]]:
    """The used columns by name, and what was dropped. Columns that are not used may hold
    anything. rewrite: makes of each block of lines one of as many rows of numbers.
    """
    packed: list[str] = []
    size = text_size(path, len(used))
    delimiter = " " if layout.format == "text" else layout.delimiter
    blocks = _blocks(path, layout, size, packed)
    if rewrite is not None:
        blocks = ((rewrite(part), is_last) for part, is_last in blocks)
    text, last = _head_block(blocks, layout)
    names, rows, first_line = _split_header(text, layout, delimiter, path.name)
    _refuse_one_column(
        rows if layout.columns else text[: len(text) - len(rows)], layout, delimiter, path.name
    )
    refuse_missing(used, names, path.name)
    if layout.decimal == "," and delimiter == ",":
        raise MapError('map: decimal = "," needs another delimiter')
    standing = RowLayout(
        names=names, label=path.name, delimiter=delimiter, first_line=first_line, used=used
    )
    found: Iterator[Block] = chain([(rows, last)], blocks)
    if layout.decimal == ",":
        found = ((part.replace(b",", b"."), is_last) for part, is_last in found)
    try:
        columns, notes = column_rows(found, standing, size.lines - first_line + 1)
    except BadRowError as error:
        raise InputError(f"{error}{_number_hint(error.field or '')}") from None
    return columns, [f"{path.name}: {note}" for note in packed] + notes


def _blocks(path: Path, layout: LayoutKeys, size: TextSize, notes: list[str]) -> Iterator[Block]:
    """The text by blocks of whole lines, those that begin with the comment sign made blank; line
    ends of old Macs become ours.
    """
    parts = text_parts(path, notes)
    if not size.feeds:
        parts = (part.replace(b"\r", b"\n") for part in parts)
    comment = None
    if layout.comment is not None:
        comment = re.compile(rb"(?m)^[ \t]*" + re.escape(layout.comment.encode()) + rb".*$")
    is_head = True
    for text, last in line_blocks(parts, label=path.name):
        if is_head:
            _refuse_no_text(text[:HEADER_BYTES], path.name)
        is_head = False
        yield text if comment is None else comment.sub(b"", text), last


def _refuse_no_text(head: bytes, label: str) -> None:
    if len(head.translate(None, NO_TEXT)) < MIN_TEXT * len(head):
        raise InputError(
            f"{label}: no text: needed format in the map (binary, with columns and dtype?)"
        )


def _head_block(blocks: Iterator[Block], layout: LayoutKeys) -> Block:
    """As many blocks as hold the header lines, as one."""
    text, last = next(blocks)
    counted = _countable(text, layout)
    while counted <= _header_count(layout) and not last:
        more, last = next(blocks)
        text, counted = text + more, counted + _countable(more, layout)
    return text, last


def _countable(text: bytes, layout: LayoutKeys) -> int:
    """The lines that count as lines of a header."""
    if layout.comment is None:
        return text.count(b"\n")
    return sum(1 for line in text.split(b"\n") if line.strip())


def _header_count(layout: LayoutKeys) -> int:
    if layout.header_lines is not None:
        return layout.header_lines
    return layout.names_line or int(layout.columns is None)


def _number_hint(got: str) -> str:
    """What a number that is none may be: decimal commas, thousands separators."""
    if re.fullmatch(r"-?\d+,\d+", got):
        return ': decimal = "," in the map?'
    thousands = re.fullmatch(r"-?\d{1,3}([,' ]\d{3})+([.,]\d*)?", got)
    return ": thousands separators? needed numbers without" if thousands else ""


def header_names(path: Path) -> list[str]:
    """The names in the first line of a CSV, plain or in gzip; empty where it is not a line of
    text.
    """
    return _names(_head(path).partition(b"\n")[0], ",")


def refuse_missing(used: Sequence[str], names: Sequence[str], label: str) -> None:
    """InputError for the first column that the file does not have."""
    missing = [name for name in used if name not in names]
    if missing:
        raise InputError(f"{label}: no column {missing[0]}, has {' '.join(names)}"[:300])


def _head(path: Path) -> bytes:
    """The beginning of a text, gunzipped as far as it goes; empty where it is no gzip file."""
    head = b""
    try:
        for part in text_parts(path, [], block_bytes=HEADER_BYTES):
            head += part
            if len(head) >= HEADER_BYTES or b"\n" in part:
                break
    except InputError:
        return b""
    return head


def _split_header(
    text: bytes, layout: LayoutKeys, delimiter: str, label: str
) -> tuple[list[str], bytes, int]:
    """Column names, the rows, and the number of the first line of rows; with a comment sign, empty
    lines do not count.
    """
    count = _header_count(layout)
    lines: list[bytes] = []
    first_line, at = 1, 0
    while len(lines) < count:
        end = text.find(b"\n", at)
        if end < 0:
            raise InputError(
                f"{label}: {len(lines) + 1} lines, needed {count} header lines and rows"
            )
        line, at = text[at:end], end + 1
        lines += [line] if line.strip() or layout.comment is None else []
        first_line += 1
    text = text[at:]
    place = (layout.names_line or count) - 1
    if layout.columns is None and not 0 <= place < count:
        raise MapError(f"map: names_line {place + 1}, needed at most header_lines ({count})")
    names = layout.columns if layout.columns is not None else _names(lines[place], delimiter)
    if len(names) > MAX_COLUMNS:
        raise InputError(f"{label}: {len(names)} columns, needed at most {MAX_COLUMNS}")
    twice = [name for name, count in Counter(names).items() if count > 1]
    if not names or twice:
        raise InputError(
            f"{label}: column {twice[0]} appears twice" if twice else f"{label}: no column names"
        )
    return names, text, first_line


def _refuse_one_column(lines: bytes, layout: LayoutKeys, delimiter: str, label: str) -> None:
    """InputError where a line, the last before the rows or the first of them, has one field only,
    and what would part it.
    """
    empty_count = layout.columns is None and layout.comment is None  # as in _split_header
    whole = [line for line in lines.split(b"\n", 50)[:50] if line.strip() or empty_count]
    place = 0 if layout.columns else (layout.names_line or _header_count(layout)) - 1
    line = whole[place] if place < len(whole) else b""
    if len(_names(line, delimiter)) != 1:
        return
    best = max(SEPARATORS, key=lambda sign: len(_names(line, sign)))
    best = best if len(_names(line, best)) > 1 else " "
    if len(_names(line, best)) > 1:
        needed = 'format = "text"' if best == " " else f"delimiter = {SEPARATORS[best]}"
        raise InputError(
            f"{label}: one column {line.decode(errors='replace').strip()[:40]!r}, needed {needed}"
            " in the map"
        )


def _names(line: bytes, delimiter: str) -> list[str]:
    words = line.decode("utf-8-sig", errors="replace").strip()
    if delimiter == " ":
        return words.split()
    try:
        return [name.strip() for name in next(csv.reader([words], delimiter=delimiter), [])]
    except csv.Error:  # not a line of text
        return []


@dataclass(frozen=True)
class Heading:
    """names: of the columns, each once; layout: how the rows below them lie; before: the lines
    above.
    """

    names: tuple[str, ...]
    layout: LayoutKeys
    before: tuple[str, ...]


def heading(path: Path, are_names: Callable[[Sequence[str]], bool]) -> Heading | None:
    """The first line whose fields are such names; None where there is none near the start."""
    try:
        head = next(iter(text_parts(path, [], block_bytes=SIGHTED_TEXT)), b"")[:SIGHTED_TEXT]
    except InputError:
        return None
    lines = head.decode("utf-8-sig", errors="replace").splitlines()[: LINES_BEFORE + 1]
    for k, line in enumerate(lines):
        for sign in SEPARATED_BY:
            names = [name.strip().strip('"') for name in line.split(sign)]
            if are_names(names):
                return _found(names, lines[:k], sign)
    return None


def _found(names: Sequence[str], before: Sequence[str], sign: str) -> Heading:
    """A name that stands there twice counts the first time."""
    seen: Counter[str] = Counter()
    once = []
    for name in names:
        seen[name] += 1
        once.append(name if seen[name] == 1 else f"{name} ({seen[name]})")
    layout = LayoutKeys(
        format="csv", delimiter=sign, columns=once, header_lines=len(before) + 1, names_line=None
    )
    return Heading(tuple(once), layout, tuple(before))
