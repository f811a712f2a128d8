"""Columns of a Parquet file: numbers as float64, time stamps as seconds since 1970, parts of a
record as `record.part`.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ins.records import InputError
from trajectories.readers.columns.text_columns import refuse_missing
from trajectories.readers.rows.column_map import LayoutKeys
from trajectories.runs.limits import refuse_held
from trajectories.runs.text_rows import refuse_rows

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
