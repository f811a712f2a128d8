"""Logs of seven numbers a row, increments and a time, without a word about it: known by gravity in
the numbers.

An increment of velocity over its interval is gravity's size at rest and near it in any vehicle; a
rate, a count or another order of columns is not.

Decision: docs/decisions/0040-known-by-gravity.md.
"""

import re
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ins.records import InputError
from trajectories.readers.rows.column_map import LayoutKeys
from trajectories.runs.checks import MAX_VALUE
from trajectories.runs.text_rows import is_number, text_parts

SNIFFED_BYTES = 1 << 16
MIN_ROWS = 20  # 2 s at the slowest rate of a run, 10 Hz
MIN_WHOLE = 0.9  # of the first rows, some 500 in 64 kB: the others are damaged; chosen
INTERVAL_S = (4e-4, 0.11)  # 10 Hz to 2 kHz with room
PLAUSIBLE_G_M_S2 = (7.0, 13.0)  # of the median: 0.7 to 1.3 g, what a vehicle feels most of the time
COMMENTS = ("%", "#", "//")


def head_rows(path: Path) -> tuple[NDArray, LayoutKeys] | None:
    """The first rows of a text of numbers, shape (n, columns), and how it lies; None where it is no
    such text.

    A few lines may be damaged: they are left out here, and named where the log is read.
    """
    try:
        head = next(iter(text_parts(path, [], block_bytes=SNIFFED_BYTES)), b"")[:SNIFFED_BYTES]
    except InputError:
        return None
    if head.count(b"\x00") > 0.1 * len(head):
        return None
    lines = [line.strip() for line in head.decode("utf-8-sig", errors="replace").splitlines()[:-1]]
    sign = next((c for c in COMMENTS if any(line.startswith(c) for line in lines)), None)
    lines = [line for line in lines if line and not (sign and line.startswith(sign))]
    comma = bool(lines) and "," in lines[-1]
    rows = [line.split(",") if comma else line.split() for line in lines]
    named = int(bool(rows) and not any(map(is_number, rows[0])))
    if named and "time_s" in map(str.strip, rows[0]):
        return None  # a run's own imu stream, which says itself what its columns are
    rows = rows[named:]
    width = Counter(map(len, rows)).most_common(1)[0][0] if rows else 0
    whole = [row for row in rows if len(row) == width and all(map(is_number, row))]
    if len(whole) < max(2, MIN_WHOLE * len(rows)):
        return None
    layout = LayoutKeys(format="csv" if comma else "text", comment=sign, header_lines=named)
    return np.array(whole, dtype=float), layout


def head_doubles(path: Path, columns: int) -> NDArray | None:
    """The first rows of a file of little-endian doubles, whose last may be cut off; None where its
    numbers are others.
    """
    numbers = np.fromfile(path, dtype="<f8", count=1000 * columns)
    if numbers.size < columns:
        return None
    rows = numbers[: numbers.size // columns * columns].reshape(-1, columns)
    with np.errstate(invalid="ignore"):
        sane = np.isfinite(rows).all() and np.abs(rows).max() < MAX_VALUE
    return rows if sane else None


def are_increments(rows: NDArray | None, *, time: int, accel: int) -> bool:
    """Whether rows (n, 7) hold rising times in a column and velocity increments in the three from
    another on.
    """
    if rows is None or rows.shape[1] != 7 or len(rows) < MIN_ROWS:
        return False
    rows = rows[np.abs(rows).max(axis=1) < MAX_VALUE]  # NaN falls out too
    steps = np.diff(rows[:, time])
    steps = steps[steps != 0]  # rows written twice
    if not steps.size or len(rows) < MIN_ROWS or np.mean(steps > 0) < 0.95:
        return False
    interval = float(np.median(steps))
    force = float(np.median(np.linalg.norm(rows[:, accel : accel + 3], axis=1))) / interval
    return (
        INTERVAL_S[0] < interval < INTERVAL_S[1]
        and PLAUSIBLE_G_M_S2[0] < force < PLAUSIBLE_G_M_S2[1]
    )


def refuse_other_width(rows: NDArray, widths: Sequence[int], label: str, what: str) -> None:
    """InputError where a table has another number of columns than its format."""
    if rows.shape[1] not in widths:
        raise InputError(
            f"{label}: {rows.shape[1]} columns, needed {' or '.join(map(str, widths))} ({what})"
        )


def is_file_of(path: Path, pattern: bytes) -> bool:
    """Whether the beginning of a text, plain or in gzip, has a line that matches."""
    try:
        head = next(iter(text_parts(path, [], block_bytes=SNIFFED_BYTES)), b"")[:SNIFFED_BYTES]
    except InputError:
        return False
    return re.search(pattern, head) is not None
