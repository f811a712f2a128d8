"""Stream files as columns of float64: Parquet, CSV and CSV in gzip, read strictly and written without loss.

Rows are counted from 1, the header not counted; messages on CSV give the line as well.
"""

import csv
import gzip
import io
import re
import zlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ins.records import InputError

ENDINGS = (".parquet", ".csv", ".csv.gz")
PANDAS_INDEX = re.compile(r"__index_level_\d+__")  # what pandas adds to a filtered frame, no data of the run
MAX_ROWS = 100_000_000  # 13.9 h at 2 kHz
MAX_TEXT_BYTES = 8_000_000_000
MISSING = ("", "nan", "NaN", "NAN", "NA", "null")


class StreamFile:
    """One open stream file: column names first, values on demand; `notes` lists what was dropped."""

    def __init__(self, path: Path) -> None:
        self.path, self.label = path, path.name
        self.notes: list[str] = []
        self.is_text = not path.name.endswith(".parquet")
        self._table: Any = None
        self._text = b""
        try:
            self.names = self._open_text() if self.is_text else self._open_parquet()
        except OSError as error:
            raise InputError(f"{path}: cannot be read ({' '.join(str(error).split())[:200]})") from None

    def _open_text(self) -> tuple[str, ...]:
        self._text, note = read_text(self.path)
        self.notes += [f"{self.label}: {note}"] if note else []
        head, _, self._text = self._text.partition(b"\n")
        try:
            names = next(csv.reader([head.decode("utf-8-sig").strip()]), [])
        except (UnicodeDecodeError, csv.Error):
            raise InputError(f"{self.label}: line 1 is not a CSV header") from None
        if len(names) == 1 and re.search(r"[;\t]", names[0]):
            raise InputError(f"{self.label}: columns must be separated by commas")
        return tuple(name.strip() for name in names)

    def _open_parquet(self) -> tuple[str, ...]:
        import pyarrow as pa
        import pyarrow.parquet as pq

        try:
            self._table = pq.ParquetFile(self.path)
        except pa.ArrowException as error:
            raise InputError(f"{self.label}: not a Parquet file ({' '.join(str(error).split())[:200]})") from None
        if self._table.metadata.num_rows > MAX_ROWS:
            raise InputError(f"{self.label}: {self._table.metadata.num_rows} rows, needed at most {MAX_ROWS}")
        return tuple(n for n in self._table.schema_arrow.names if not PANDAS_INDEX.fullmatch(n))

    def column(self, name: str) -> NDArray:
        """One column as float64, missing values NaN; InputError names file, row and column of anything else."""
        import pyarrow as pa

        if self._table is None:
            self._table, notes = parse_rows(self._text, self.names, label=self.label)
            self.notes, self._text = self.notes + notes, b""
        try:
            values = self._table.column(name) if self.is_text else self._table.read(columns=[name]).column(0)
        except (pa.ArrowException, OSError) as error:
            raise InputError(f"{self.label}: column {name}: damaged ({' '.join(str(error).split())[:200]})") from None
        if not (pa.types.is_floating(values.type) or pa.types.is_integer(values.type)):
            raise InputError(f"{self.label}: column {name} holds {values.type}, needed float64")
        if pa.types.is_floating(values.type) and values.type.bit_width < 64:
            self.notes.append(f"{self.label}: column {name} holds {values.type}, fewer digits than float64")
        return np.asarray(values.cast(pa.float64(), safe=False).to_numpy(), dtype=np.float64)

    @property
    def text(self) -> str:
        """The rows of a text file as they are (for the one stream that holds words)."""
        try:
            return self._text.decode("utf-8")
        except UnicodeDecodeError:
            raise InputError(f"{self.label}: not UTF-8 text") from None

    def text_column(self, name: str) -> list[str]:
        """A Parquet column of words."""
        import pyarrow as pa

        values = self._table.read(columns=[name]).column(0)
        if not (pa.types.is_string(values.type) or pa.types.is_large_string(values.type)):
            raise InputError(f"{self.label}: column {name} holds {values.type}, needed text")
        return [str(v) for v in values.to_pylist()]

    def row(self, index: int) -> str:
        """How a message names the row with this index."""
        return f"{self.label}: row {index + 1}" + (f" (line {index + 2})" if self.is_text else "")


def read_text(path: Path) -> tuple[bytes, str]:
    """The bytes of a text file, gunzipped as far as it goes, and a note where a gzip file is cut off or damaged."""
    if path.stat().st_size > MAX_TEXT_BYTES:
        raise InputError(f"{path}: {path.stat().st_size} bytes, needed at most {MAX_TEXT_BYTES}")
    if not path.name.endswith(".gz"):
        return path.read_bytes(), ""
    return _gunzip(path)


def _gunzip(path: Path) -> tuple[bytes, str]:
    """What can be unpacked of a gzip file of one or more members, and a note where it ends too early."""
    out, unpack, note = bytearray(), zlib.decompressobj(wbits=31), ""
    with path.open("rb") as file:
        try:
            while chunk := unpack.unused_data or file.read(1 << 16):
                if unpack.eof:
                    unpack = zlib.decompressobj(wbits=31)
                out += unpack.decompress(chunk)
                if len(out) > MAX_TEXT_BYTES:
                    raise InputError(f"{path}: more than {MAX_TEXT_BYTES} bytes unpacked")
        except zlib.error as error:
            note = str(error)
    if not unpack.eof:
        note = note or "the file ends too early"
        if not out:
            raise InputError(f"{path}: not a gzip file ({note})")
        return bytes(out), f"gzip data damaged after {len(out)} bytes ({note}), the rest dropped"
    return bytes(out), ""


def parse_rows(
    text: bytes, names: Sequence[str], *, label: str, delimiter: str = ",", first_line: int = 2
) -> tuple[Any, list[str]]:
    """A pyarrow table of float64 columns from rows of text, and what was dropped.

    A last row without a line end, or broken, is a cut-off file: dropped and noted. A broken row before it is an
    InputError with line and column. `delimiter` " " means any white space.
    """
    notes: list[str] = []
    if text and not text.endswith((b"\n", b"\r")):
        text = text[: max(text.rfind(b"\n"), text.rfind(b"\r")) + 1]
        notes.append(f"{label}: last row has no line end (file cut off?), dropped")
    table, problem = _arrow_table(text, names, delimiter)
    if table is None and (bad := _first_bad_line(text, names, delimiter)):
        index, last, why = bad
        where = f"{label}: row {index + 1} (line {index + first_line}): {why}"
        if not last:
            raise InputError(where)
        notes.append(f"{where}: last row dropped")
        text = text.rstrip(b"\r\n")
        table, problem = _arrow_table(text[: text.rfind(b"\n") + 1], names, delimiter)
    if table is None:
        raise InputError(f"{label}: {problem}")
    if table.num_rows > MAX_ROWS:
        raise InputError(f"{label}: {table.num_rows} rows, needed at most {MAX_ROWS}")
    return table, notes


def _arrow_table(text: bytes, names: Sequence[str], delimiter: str) -> tuple[Any, str]:
    import pyarrow as pa
    from pyarrow import csv as arrow_csv

    if delimiter == " ":
        text = re.sub(rb"(?m)^[ \t]+|[ \t\r]+$", b"", text)
        text, delimiter = re.sub(rb"[ \t]+", b",", text), ","
    if not text.strip():
        return None, "no rows"
    keys = [str(i) for i in range(len(names))]
    try:
        table = arrow_csv.read_csv(
            pa.BufferReader(text),
            read_options=arrow_csv.ReadOptions(column_names=keys),
            parse_options=arrow_csv.ParseOptions(delimiter=delimiter),
            convert_options=arrow_csv.ConvertOptions(
                column_types=dict.fromkeys(keys, pa.float64()), null_values=list(MISSING)
            ),
        )
    except pa.ArrowException as error:
        return None, " ".join(str(error).split())[:200]
    return table.rename_columns(list(names)), ""


def _first_bad_line(text: bytes, names: Sequence[str], delimiter: str) -> tuple[int, bool, str] | None:
    """Index of the first line that is not one number a column, whether it is the last, and what is wrong with it."""
    lines = text.decode("utf-8", errors="replace").splitlines()
    while lines and not lines[-1].strip():
        lines.pop()
    for i, line in enumerate(lines):
        fields = line.split() if delimiter == " " else next(csv.reader([line], delimiter=delimiter), [])
        if fields and (why := _wrong_fields(fields, names)):
            return i, i == len(lines) - 1, why
    return None


def _wrong_fields(fields: Sequence[str], names: Sequence[str]) -> str:
    if len(fields) != len(names):
        return f"{len(fields)} values, needed {len(names)}"
    for name, field in zip(names, fields):
        if field.strip() not in MISSING and not _is_number(field):
            return f"column {name}: got {field[:40]!r}, needed a number"
    return ""


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return "_" not in text


def write_columns(path: Path, columns: Mapping[str, ArrayLike]) -> None:
    """Columns to a new Parquet or CSV file by its ending; every float64 comes back bit-identical, NaN as missing."""
    import pyarrow as pa

    table = pa.table({name: pa.array(values, from_pandas=True) for name, values in columns.items()})
    if path.name.endswith(".parquet"):
        import pyarrow.parquet as pq

        floats = [f.name for f in table.schema if pa.types.is_floating(f.type)]
        pq.write_table(table, path, compression="zstd", use_dictionary=False, use_byte_stream_split=floats)
        return
    from pyarrow import csv as arrow_csv

    out = io.BytesIO((",".join(table.column_names) + "\n").encode())
    out.seek(0, io.SEEK_END)
    arrow_csv.write_csv(table, out, arrow_csv.WriteOptions(include_header=False, quoting_style="none"))
    data = out.getvalue()
    path.write_bytes(gzip.compress(data, compresslevel=6, mtime=0) if path.name.endswith(".gz") else data)
