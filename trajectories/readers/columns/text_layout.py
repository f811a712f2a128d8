"""How the rows of an unknown text lie: separator, decimal sign, comments, the line of names."""

import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from ins.records import InputError
from trajectories.readers.rows.column_map import LayoutKeys
from trajectories.runs.text_rows import text_parts

SIGHTED_BYTES = 1 << 16  # of the text's beginning
SIGHTED_ROWS = 20  # that have to agree
FEWEST_NUMBERS = 6  # of a row: 3 rates and 3 forces
SIGNS = (
    (";", ","),
    ("\t", ","),
    (" ", ","),
    (",", "."),
    (";", "."),
    ("\t", "."),
    ("|", "."),
    (" ", "."),
)
NUMBER = {
    ".": re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?|[nN]a[nN]|"),
    ",": re.compile(r"[-+]?(\d+,?\d*|,\d+)([eE][-+]?\d+)?|[nN]a[nN]|"),
}
COMMENT = re.compile(r"\s*(#|%|//)")
UNIT_LINE = re.compile(r"[\[(]?[a-zA-Z\u00b0\u00b5/^0-9\u00b2*._ -]{0,12}[\])]?")


@dataclass(frozen=True)
class TextLayout:
    """The layout as a map says it, the names of the columns in turn, the unit of each where a line
    below the names gives them, and which columns hold numbers.
    """

    layout: LayoutKeys
    names: tuple[str, ...]
    units: tuple[str, ...]
    numbers: tuple[str, ...]


def text_layout(path: Path) -> TextLayout | None:
    """How the rows of a text lie; None where it holds no rows of six numbers or more."""
    try:
        head = next(iter(text_parts(path, [], block_bytes=SIGHTED_BYTES)), b"")[:SIGHTED_BYTES]
    except InputError:
        return None
    if b"\x00" in head:
        return None
    text = head.decode("utf-8-sig", errors="replace").replace("\r\n", "\n").replace("\r", "\n")
    lines = text.split("\n")
    lines = lines[:-1] if len(lines) > 1 else lines  # the last may be cut
    best: tuple[int, int, str, str] | None = None
    for sign, decimal in SIGNS:
        found = _first_row(lines, sign, decimal)
        if found and (best is None or found[1] > best[1]):
            best = *found, sign, decimal
    return None if best is None else _layout(lines, *best)


def _first_row(lines: Sequence[str], sign: str, decimal: str) -> tuple[int, int] | None:
    """The first line of rows that agree in size, and how many numbers each has; None without."""
    run, size, numbers = 0, 0, 0
    for k, line in enumerate(lines):
        row = _fields(line, sign)
        count = sum(bool(NUMBER[decimal].fullmatch(field)) and field != "" for field in row)
        is_row = count >= FEWEST_NUMBERS and count >= len(row) / 2
        if is_row and run and len(row) == size:
            run, numbers = run + 1, min(numbers, count)
        else:
            run, size, numbers = int(is_row), len(row), count
        if run == min(SIGHTED_ROWS, max(len(lines) - k, 2)):
            return k - run + 1, numbers
    return None


def _fields(line: str, sign: str) -> list[str]:
    if sign == " ":
        return line.split()
    return [field.strip() for field in next(csv.reader([line], delimiter=sign), [])]


def _layout(lines: Sequence[str], first: int, numbers: int, sign: str, decimal: str) -> TextLayout:
    row = _fields(lines[first], sign)
    above = [k for k in range(first) if lines[k].strip()]
    heads = [(k, _fields(re.sub(COMMENT, "", lines[k], count=1), sign)) for k in above[-2:]]
    heads = [(k, fields) for k, fields in heads if len(fields) == len(row)]
    units = ("",) * len(row)
    if len(heads) == 2 and all(UNIT_LINE.fullmatch(unit) for unit in heads[1][1]):
        units = tuple(heads.pop()[1])
    keys: dict[str, str | int | list[str]] = (
        {"format": "csv", "delimiter": sign} if sign != " " else {"format": "text"}
    )
    if decimal != ".":
        keys["decimal"] = decimal
    comment = COMMENT.match(lines[heads[-1][0]]) if heads else None
    if heads and comment is None and len(set(heads[-1][1])) == len(row):
        names = heads[-1][1]
        keys |= {"header_lines": first, "names_line": heads[-1][0] + 1}
    else:
        named = heads[-1][1] if heads and len(set(heads[-1][1])) == len(row) else []
        names = named or [f"column_{k + 1}" for k in range(len(row))]
        keys |= {"header_lines": first, "columns": names}
    held = [n for n, field in zip(names, row) if NUMBER[decimal].fullmatch(field)]
    return TextLayout(LayoutKeys.model_validate(keys), tuple(names), units, tuple(held))
