"""The kinds of files that a column map can read, and which one a file is; raw binary rows: the same
fixed numbers again and again, after an optional header; Parquet: numbers as float64, time stamps as
seconds since 1970, parts of a record as `record.part`.
"""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ins.records import InputError
from ins.user_input import open_regular
from trajectories.readers.columns.mat_columns import mat_columns
from trajectories.readers.columns.text_columns import refuse_missing, text_columns
from trajectories.readers.containers.mat_file import is_matlab
from trajectories.readers.rows.column_map import LayoutKeys, MapError, binary_type
from trajectories.runs.limits import refuse_held
from trajectories.runs.notes import About, Note
from trajectories.runs.text_rows import MAX_ROWS, refuse_rows

PARQUET_MAGIC = b"PAR1"


def parquet_columns(
    path: Path, layout: LayoutKeys, used: Sequence[str]
) -> tuple[dict[str, NDArray], list[str]]:
    """The used columns by name, missing values NaN; InputError names a column that holds no
    numbers.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        file = pq.ParquetFile(path, pre_buffer=False)
        rows = file.metadata.num_rows
        refuse_rows(rows, len(used), path)
        refuse_held(rows, len(used), path.name)
        if rows < 2:
            raise InputError(f"{path.name}: {rows} rows, needed at least 2")
        refuse_missing(used, flat_names(path), path.name)
        roots = list(
            dict.fromkeys(
                name if name in file.schema_arrow.names else name.split(".")[0] for name in used
            )
        )
        table = file.read(columns=roots, use_threads=False)
    except (pa.ArrowException, OSError, UnicodeDecodeError) as error:
        raise InputError(
            f"{path.name}: not a whole Parquet file ({' '.join(str(error).split())[:200]})"
        ) from None
    while any(pa.types.is_struct(field.type) for field in table.schema):
        table = table.flatten()
    return {name: _numbers(table.column(name), name, path.name) for name in used}, []


def flat_names(path: Path) -> list[str]:
    """The names of the columns; empty where the file is no Parquet."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        table = pq.read_schema(path).empty_table()
    except (pa.ArrowException, OSError, UnicodeDecodeError):
        return []
    while any(pa.types.is_struct(field.type) for field in table.schema):
        table = table.flatten()
    return list(table.column_names)


def _numbers(column: Any, name: str, label: str) -> NDArray:
    import pyarrow as pa

    kind = column.type
    if pa.types.is_timestamp(kind):
        per_second = {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9}[kind.unit]
        column, factor = column.cast(pa.int64()), 1.0 / per_second
    elif pa.types.is_floating(kind) or pa.types.is_integer(kind) or pa.types.is_decimal(kind):
        factor = 1.0
    else:
        raise InputError(f"{label}: column {name} holds {kind}, needed numbers")
    values = np.asarray(column.cast(pa.float64(), safe=False).to_numpy(), dtype=np.float64)
    return values if factor == 1.0 else values * factor


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
