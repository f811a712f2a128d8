"""The kinds of files that a column map can read, and which one a file is."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ins.records import InputError
from ins.user_input import open_regular
from trajectories.readers.columns.mat_columns import mat_columns
from trajectories.readers.columns.parquet_columns import PARQUET_MAGIC, parquet_columns
from trajectories.readers.columns.text_columns import text_columns
from trajectories.readers.containers.mat_file import is_matlab
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


ColumnsOf = Callable[[Path, LayoutKeys, Sequence[str]], tuple[dict[str, NDArray], list[str]]]
READ: dict[str, ColumnsOf] = {
    "csv": text_columns,
    "text": text_columns,
    "binary": binary_columns,
    "parquet": parquet_columns,
    "mat": mat_columns,
}


def content_format(path: Path) -> str:
    """Parquet and MATLAB by their first bytes, else "csv"; rows of raw numbers have no mark and
    need `format`.
    """
    with open_regular(path) as file:
        if file.read(4) == PARQUET_MAGIC:
            return "parquet"
    return "mat" if is_matlab(path) else "csv"


def read_columns(
    path: Path, layout: LayoutKeys, used: Sequence[str]
) -> tuple[dict[str, NDArray], list[str]]:
    """The used columns of a file by name, shape (n,) each and of one length, and notes on what was
    dropped.
    """
    name = layout.format or content_format(path)
    columns, notes = READ[name](path, layout, used)
    lengths = {len(values): key for key, values in columns.items()}
    if len(lengths) > 1:
        (a, first), (b, second) = list(lengths.items())[:2]
        raise InputError(f"{path.name}: {first} has {a} values, {second} has {b}, needed as many")
    return columns, notes


def side_file(log: Path, name: str, key: str) -> Path:
    """Another file named by a map, relative to the log's folder. InputError where there is none."""
    path = log.parent / name
    if not path.is_file():
        raise InputError(f"{key}: {path}: {'not a file' if path.exists() else 'no such file'}")
    return path
