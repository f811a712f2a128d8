"""The kinds of files that a column map can read, and which one a file is."""

from collections.abc import Callable, Sequence
from pathlib import Path

from numpy.typing import NDArray

from ins.records import InputError
from ins.user_input import open_regular
from trajectories.readers.columns.binary_columns import binary_columns
from trajectories.readers.columns.mat_columns import mat_columns
from trajectories.readers.columns.parquet_columns import PARQUET_MAGIC, parquet_columns
from trajectories.readers.columns.text_columns import text_columns
from trajectories.readers.containers.mat_file import is_matlab
from trajectories.readers.rows.column_map import LayoutKeys

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
