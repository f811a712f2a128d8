"""Rows of numbers in text as columns: block after block, so that no more of the text is held than a
block, and of the rows only the columns that are wanted.
"""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from ins.records import InputError
from trajectories.runs.limits import refuse_held
from trajectories.runs.text_rows import (
    LISTED_ROWS,
    MAX_BAD,
    MENDED_LINES,
    RowLayout,
    mended,
    parse_block,
)

Block = tuple[bytes, bool]  # whole lines, and whether they are the last


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
