"""Columns of raw binary rows: the same fixed numbers again and again, after an optional header."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ins.records import InputError
from trajectories.readers.rows.column_map import LayoutKeys, MapError, binary_type
from trajectories.runs.limits import refuse_held
from trajectories.runs.notes import About, Note
from trajectories.runs.text_rows import MAX_ROWS

# of sizes of the numbers of a log, 0 aside: increments of a quiet gyro, nanoseconds since 1970
SOUND_SIZES = (1e-18, 1e19)
SIGHTED_ROWS = 1000  # looked at for it; chosen: 5 s at 200 Hz
SOUND_SHARE = 0.9  # of the numbers; chosen: of doubles read the wrong way round 4 % look sound


def _refuse_byte_order(rows: NDArray, first: str, path: Path) -> None:
    """InputError where the numbers look sound the other way round only."""
    if _sound(rows) < SOUND_SHARE < _sound(rows.view(rows.dtype.newbyteorder("S"))):
        other = ("<" if first.startswith(">") else ">") + first[-2:]
        raise InputError(
            f"{path.name}: numbers beyond any log: of the other byte order? dtype = {other!r} in"
            " the map"
        )


def _sound(rows: NDArray) -> float:
    """The share of numbers that a log may hold."""
    with np.errstate(invalid="ignore", over="ignore"):
        sizes = np.abs(np.stack([rows[k].astype(float) for k in rows.dtype.names or ()]))
        sound = (sizes == 0) | ((sizes > SOUND_SIZES[0]) & (sizes < SOUND_SIZES[1]))
    return float(np.mean(sound))


def binary_columns(
    path: Path, layout: LayoutKeys, used: Sequence[str]
) -> tuple[dict[str, NDArray], list[str]]:
    """The used columns by `columns`, `dtype` (one for all or one each), `header_bytes`; a row cut
    off at the end is dropped.
    """
    if layout.columns is None:
        raise MapError("map: key columns is missing: a binary log has no names of its own")
    if len(set(layout.columns)) != len(layout.columns):
        raise MapError("map: columns: a name appears twice")
    types = [layout.dtype] * len(layout.columns) if isinstance(layout.dtype, str) else layout.dtype
    if len(types) != len(layout.columns):
        raise MapError(f"map: dtype: got {len(types)} types, needed one or {len(layout.columns)}")
    row = np.dtype([(name, binary_type(text)) for name, text in zip(layout.columns, types)])
    size = path.stat().st_size - layout.header_bytes
    count, rest = divmod(max(size, 0), row.itemsize)
    if not 2 <= count <= MAX_ROWS:
        raise InputError(
            f"{path.name}: {count} rows of {row.itemsize} bytes, needed 2 to {MAX_ROWS}"
        )
    refuse_held(count, len(set(used)), path.name)
    data = np.fromfile(path, dtype=row, count=count, offset=layout.header_bytes)
    _refuse_byte_order(data[:SIGHTED_ROWS], types[0], path)
    columns = {k: data[k].astype(np.float64) for k in layout.columns if k in set(used)}
    cut = f"{path.name}: last row cut off after {rest} of {row.itemsize} bytes, dropped"
    return columns, [Note(cut, About.DAMAGE)] if rest else []
