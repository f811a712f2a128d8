"""Logs as raw binary rows: the same fixed numbers again and again, after an optional header."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ins.records import InputError
from trajectories.readers.column_map import binary_type, column_map
from trajectories.readers.columns import converted
from trajectories.readers.registry import ConvertedLog, Reader
from trajectories.text_rows import MAX_ROWS


def read(path: Path, options: Mapping[str, Any]) -> ConvertedLog:
    """A binary log by its map: `columns`, `dtype` (one for all or one each), `header_bytes`.

    A row cut off at the end of the file is dropped and noted.
    """
    keys = column_map(options)
    if keys.columns is None:
        raise InputError("map: key columns is missing: a binary log has no names of its own")
    if len(set(keys.columns)) != len(keys.columns):
        raise InputError("map: columns: a name appears twice")
    types = [keys.dtype] * len(keys.columns) if isinstance(keys.dtype, str) else keys.dtype
    if len(types) != len(keys.columns):
        raise InputError(f"map: dtype: got {len(types)} types, needed one or {len(keys.columns)}")
    row = np.dtype([(name, binary_type(text)) for name, text in zip(keys.columns, types)])
    size = path.stat().st_size - keys.header_bytes
    count, rest = divmod(max(size, 0), row.itemsize)
    if not 2 <= count <= MAX_ROWS:
        raise InputError(f"{path.name}: {count} rows of {row.itemsize} bytes, needed 2 to {MAX_ROWS}")
    data = np.fromfile(path, dtype=row, count=count, offset=keys.header_bytes)
    columns = {name: data[name].astype(np.float64) for name in keys.columns}
    notes = [f"{path.name}: last row cut off after {rest} of {row.itemsize} bytes, dropped"] if rest else []
    return converted(columns, keys, label=path.name, notes=notes)


def _never(path: Path) -> bool:
    return False


READERS = (Reader(name="binary", about="rows of raw numbers, needs a map", detect=_never, read=read),)
