"""Stream files as columns of float64: Parquet, CSV and CSV in gzip, read strictly and written
without loss.

Rows are counted from 1, the header not counted; messages on CSV give the line as well. A stream is
read whole, column by column, or in pieces of some ten thousand rows, as often as needed; a short
one is kept after its first reading.
"""

import csv
import gzip
import io
import re
from collections.abc import Iterator, Mapping, Sequence
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ins.records import PIECE_ROWS, InputError
from ins.user_input import open_regular
from trajectories.runs.limits import refuse_held
from trajectories.runs.notes import labelled
from trajectories.runs.text_rows import (
    BLOCK_BYTES,
    MAX_LINE_BYTES,
    MAX_ROWS,
    RowLayout,
    joined_columns,
    line_blocks,
    parse_block,
    refuse_rows,
    text_parts,
    text_size,
)

STREAM_ENDINGS = (".parquet", ".csv", ".csv.gz")
# what pandas adds to a filtered frame, no data of the run
PANDAS_INDEX = re.compile(r"__index_level_\d+__")

GROUP_ROWS = 1 << 20  # of a Parquet file that is written: what pyarrow takes by itself
HELD_ROWS = 1_000_000  # 83 min at 200 Hz: 64 MB of increments
READ_AHEAD_BYTES = 1 << 20
MAX_STREAM_COLUMNS = 100  # the widest stream that a run may have, temperature, has 13
WORD_BYTES = 1000  # of a row with words, on average: a phase and two times have 60

Piece = tuple[int, dict[str, NDArray]]  # index of its first row, columns


class StreamFile:
    """One open stream file: column names first, values on demand; `notes` lists what was dropped.

    Text is parsed a block of `block_bytes` at a time; a stream of at most `held_rows` rows is kept
    once all was read.
    """

    def __init__(
        self, path: Path, *, block_bytes: int = BLOCK_BYTES, held_rows: int = HELD_ROWS
    ) -> None:
        self.path, self.label = path, path.name
        self.notes: list[str] = []
        self.is_text = not path.name.endswith(".parquet")
        self._block_bytes, self._held_rows = block_bytes, held_rows
        self._held: list[Any] | None = None  # pyarrow tables of all columns, in order
        self._rows_of: list[int] = []  # rows of each block of text, once read
        self._file: Any = None
        try:
            self.names = self._open_text() if self.is_text else self._open_parquet()
            if len(self.names) > MAX_STREAM_COLUMNS:
                told = f"{len(self.names)} columns, needed at most {MAX_STREAM_COLUMNS}"
                raise InputError(f"{self.label}: {told}")
            if path.name.endswith(".gz"):
                text_size(path, len(self.names))
        except OSError as error:
            raise InputError(
                f"{path}: cannot be read ({' '.join(str(error).split())[:200]})"
            ) from None

    def _open_text(self) -> tuple[str, ...]:
        head = b""
        for part in text_parts(self.path, [], block_bytes=1 << 16):
            head += part
            if b"\n" in part or len(head) > MAX_LINE_BYTES:
                break
        head = head.partition(b"\n")[0]
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
            open_regular(self.path).close()  # by the library, a pipe would wait for ever
            self._file = pq.ParquetFile(self.path, buffer_size=READ_AHEAD_BYTES, pre_buffer=False)
            names = self._file.schema_arrow.names
        except (pa.ArrowException, UnicodeDecodeError) as error:
            raise InputError(
                f"{self.label}: not a Parquet file ({' '.join(str(error).split())[:200]})"
            ) from None
        refuse_rows(self._file.metadata.num_rows, len(names), self.path)
        return tuple(n for n in names if not PANDAS_INDEX.fullmatch(n))

    def column(self, name: str) -> NDArray:
        """One column as float64, missing values NaN; InputError names file, row and column of
        anything else.
        """
        if self.is_text:
            if self._held is None:
                self._held = [table for _, table in self._text_tables(0)]
            tables = self._held
        else:
            tables = [table for _, table in self._parquet_tables((name,), 0)]
        self._check_type(name, tables[0].schema.field(name).type if tables else None)
        return np.concatenate([_values(table, name) for table in tables] or [np.empty(0)])

    def columns(self) -> dict[str, NDArray]:
        """All columns as `column` gives them; InputError where they take more memory than one
        file may.
        """
        parts: dict[str, list[NDArray]] = {name: [] for name in self.names}
        for row, piece in self.pieces():
            refuse_held(row + len(piece[self.names[0]]), len(self.names), self.label)
            for name, values in piece.items():
                parts[name].append(values)
        self._held = None
        return joined_columns(parts)

    def pieces(
        self, names: Sequence[str] | None = None, *, from_row: int = 0, rows: int = PIECE_ROWS
    ) -> Iterator[Piece]:
        """The named columns (None: all) from a row on, at most `rows` rows at a time, as float64,
        missing values NaN.

        InputError as in `column`. What is kept of a long stream is one block of text or one batch
        of Parquet.
        """
        names = self.names if names is None else names
        for start, table in self._tables(names, from_row, rows):
            for name in names:
                self._check_type(name, table.schema.field(name).type)
            for a in range(max(0, from_row - start), table.num_rows, rows):
                part = table.slice(a, rows)
                yield start + a, {name: _values(part, name) for name in names}

    def _tables(self, names: Sequence[str], from_row: int, rows: int) -> Iterator[tuple[int, Any]]:
        """Index of the first row and table, the one with `from_row` first; all of it kept where
        that is little.
        """
        if self._held is not None:
            yield from _numbered(self._held)
            return
        read = (
            self._text_tables(from_row)
            if self.is_text
            else self._parquet_tables(names, from_row, rows)
        )
        kept: list[Any] | None = (
            [] if from_row == 0 and (self.is_text or set(names) == set(self.names)) else None
        )
        try:
            for start, table in read:
                if kept is not None:
                    kept = None if start + table.num_rows > self._held_rows else [*kept, table]
                yield start, table
        except OSError as error:
            raise InputError(
                f"{self.path}: cannot be read ({' '.join(str(error).split())[:200]})"
            ) from None
        self._held = kept

    def _text_tables(self, from_row: int) -> Iterator[tuple[int, Any]]:
        """Blocks of parsed rows; after the first reading, blocks before `from_row` are passed over
        unparsed.
        """
        notes: list[str] = []
        parts = _without_header(text_parts(self.path, notes, block_bytes=self._block_bytes))
        blocks = line_blocks(parts, label=self.label, block_bytes=self._block_bytes)
        layout = RowLayout(names=self.names, label=self.label)
        known, counted, start, lines = self._rows_of, [], 0, 0
        for k, (text, last) in enumerate(blocks):
            if k < len(known) and start + known[k] <= from_row:
                start, lines = start + known[k], lines + text.count(b"\n")
                continue
            table, more = parse_block(text, layout, lines_before=lines, last=last)
            self._note(*more)
            counted.append(table.num_rows if table is not None else 0)
            if table is not None:
                yield start, table
            start, lines = start + counted[-1], lines + text.count(b"\n")
            if start > MAX_ROWS:
                raise InputError(f"{self.label}: more than {MAX_ROWS} rows, needed at most that")
        if start == 0:
            raise InputError(f"{self.label}: no rows")
        self._note(*(labelled(self.label, note) for note in notes))
        self._rows_of = known or counted

    def _parquet_tables(
        self, names: Sequence[str], from_row: int, rows: int = PIECE_ROWS
    ) -> Iterator[tuple[int, Any]]:
        import pyarrow as pa

        groups, start = self._groups_from(from_row)
        try:
            for batch in self._file.iter_batches(
                rows, row_groups=groups, columns=list(names), use_threads=False
            ):
                if batch.num_rows:
                    yield start, pa.Table.from_batches([batch])
                start += batch.num_rows
        except (pa.ArrowException, OSError) as error:
            name, error = self._damaged(names, groups) or (" ".join(names), error)
            raise InputError(
                f"{self.label}: column {name}: damaged ({' '.join(str(error).split())[:200]})"
            ) from None

    def _groups_from(self, from_row: int) -> tuple[list[int], int]:
        """Row groups from the one with `from_row` on, and their first row."""
        meta = self._file.metadata
        ends = np.cumsum([meta.row_group(k).num_rows for k in range(meta.num_row_groups)])
        first = int(np.searchsorted(ends, from_row, side="right"))
        return list(range(first, meta.num_row_groups)), int(ends[first - 1]) if first else 0

    def _damaged(self, names: Sequence[str], groups: list[int]) -> tuple[str, Exception] | None:
        """The first column that cannot be read, and why."""
        import pyarrow as pa

        for name in names:
            try:
                for _ in self._file.iter_batches(
                    PIECE_ROWS, row_groups=groups, columns=[name], use_threads=False
                ):
                    pass
            except (pa.ArrowException, OSError) as error:
                return name, error
        return None

    def _check_type(self, name: str, held: Any) -> None:
        import pyarrow as pa

        if held is None:
            return
        if not (pa.types.is_floating(held) or pa.types.is_integer(held)):
            raise InputError(f"{self.label}: column {name} holds {held}, needed float64")
        if pa.types.is_floating(held) and held.bit_width < 64:
            self._note(f"{self.label}: column {name} holds {held}, fewer digits than float64")

    def _note(self, *notes: str) -> None:
        self.notes += [note for note in notes if note not in self.notes]

    def text_lines(self, most: int) -> list[str]:
        """The rows of a text file as they are (for the one stream that holds words); InputError
        where there are more than `most`, or more than WORD_BYTES in each of those.
        """
        notes: list[str] = []
        text = bytearray()
        for part in _without_header(text_parts(self.path, notes)):
            text += part
            if text.count(b"\n") > most or len(text) > most * WORD_BYTES:
                raise InputError(f"{self.label}: more than {most} rows, needed at most that")
        self._note(*(f"{self.label}: {note}" for note in notes))
        try:
            return text.decode("utf-8").splitlines()
        except UnicodeDecodeError:
            raise InputError(f"{self.label}: not UTF-8 text") from None

    def text_column(self, name: str, most: int) -> list[str]:
        """A Parquet column of words; InputError where there are more than `most`, or a word has
        more than WORD_BYTES.
        """
        import pyarrow as pa
        import pyarrow.parquet as pq

        if self._file.metadata.num_rows > most:
            raise InputError(
                f"{self.label}: {self._file.metadata.num_rows} rows, needed at most {most}"
            )
        words: list[str] = []
        try:
            # a word that is repeated stays one word: a few bytes may name a long one many times;
            # in this thread: a worker of Arrow that is alive at exit may abort the process
            file = pq.ParquetFile(self.path, read_dictionary=[name], pre_buffer=False)
            held = file.schema_arrow.field(name).type
            if not pa.types.is_dictionary(held):
                raise InputError(f"{self.label}: column {name} holds {held}, needed text")
            for batch in file.iter_batches(PIECE_ROWS, columns=[name], use_threads=False):
                words += self._words(batch.column(0), name)
        except (pa.ArrowException, OSError, UnicodeDecodeError) as error:
            raise InputError(
                f"{self.label}: column {name}: damaged ({' '.join(str(error).split())[:200]})"
            ) from None
        return words

    def _words(self, column: Any, name: str) -> list[str]:
        import pyarrow.compute as pc

        longest = pc.max(pc.binary_length(column.dictionary)).as_py() or 0
        if longest > WORD_BYTES:
            raise InputError(
                f"{self.label}: column {name} holds a text of {longest} bytes, needed at most"
                f" {WORD_BYTES}"
            )
        texts = [str(text) for text in column.dictionary.to_pylist()]
        return [str(k) if k is None else texts[k] for k in column.indices.to_pylist()]

    def row(self, index: int) -> str:
        """How a message names the row with this index."""
        return f"{self.label}: row {index + 1}" + (f" (line {index + 2})" if self.is_text else "")


def _values(table: Any, name: str) -> NDArray:
    """A column as float64, missing values NaN; `to_numpy` of Arrow would load pandas for it."""
    import pyarrow as pa
    import pyarrow.compute as pc

    column = table.column(name).cast(pa.float64(), safe=False)
    if column.null_count:
        column = pc.fill_null(column, pa.scalar(float("nan"), pa.float64()))
    parts = [np.from_dlpack(chunk) for chunk in column.chunks if len(chunk)]
    return parts[0] if len(parts) == 1 else np.concatenate([np.empty(0), *parts])


def _numbered(tables: Sequence[Any]) -> Iterator[tuple[int, Any]]:
    start = 0
    for table in tables:
        yield start, table
        start += table.num_rows


def _without_header(parts: Iterator[bytes]) -> Iterator[bytes]:
    head = True
    for part in parts:
        if head:
            _, end, part = part.partition(b"\n")
            head = not end
        if part:
            yield part


def write_columns(path: Path, columns: Mapping[str, ArrayLike]) -> None:
    """Columns to a new Parquet or CSV file by its ending; every float64 comes back bit-identical,
    NaN as missing.
    """
    if path.name.endswith(".parquet"):
        _write_parquet(path, {name: np.asarray(values) for name, values in columns.items()})
        return
    table = _table(columns)
    from pyarrow import csv as arrow_csv

    out = io.BytesIO((",".join(table.column_names) + "\n").encode())
    out.seek(0, io.SEEK_END)
    arrow_csv.write_csv(
        table, out, arrow_csv.WriteOptions(include_header=False, quoting_style="none")
    )
    data = out.getvalue()
    path.write_bytes(
        gzip.compress(data, compresslevel=6, mtime=0) if path.name.endswith(".gz") else data
    )


def _table(columns: Mapping[str, ArrayLike]) -> Any:
    import pyarrow as pa

    arrays = [_arrow(np.asarray(part)) for part in columns.values()]
    return pa.Table.from_arrays(arrays, names=list(columns))


def _arrow(values: NDArray) -> Any:
    """A column as an array of Arrow, NaN as missing. By its buffers: `pa.array` and `pa.table` load
    pandas, a quarter of a second of CPU.
    """
    import pyarrow as pa

    if values.dtype == np.float64:
        there = ~np.isnan(values)
        bits = None if there.all() else pa.py_buffer(np.packbits(there, bitorder="little"))
        data = pa.py_buffer(np.ascontiguousarray(values))
        return pa.Array.from_buffers(pa.float64(), len(values), [bits, data])
    if values.dtype.kind == "U":
        words = [str(word).encode() for word in values]
        ends = np.cumsum([0, *map(len, words)], dtype=np.int32)
        buffers = [None, pa.py_buffer(ends), pa.py_buffer(b"".join(words))]
        return pa.Array.from_buffers(pa.string(), len(words), buffers)
    return pa.array(values, from_pandas=True)


def _write_parquet(path: Path, columns: Mapping[str, NDArray]) -> None:
    """A row group at a time: of a long log, no more than that is held a second time."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    rows = max((len(values) for values in columns.values()), default=0)
    groups = (
        _table({name: v[first : first + GROUP_ROWS] for name, v in columns.items()})
        for first in range(0, max(rows, 1), GROUP_ROWS)
    )
    group = next(groups)
    floats = [f.name for f in group.schema if pa.types.is_floating(f.type)]
    with pq.ParquetWriter(
        path, group.schema, compression="zstd", use_dictionary=False, use_byte_stream_split=floats
    ) as writer:
        for part in chain([group], groups):
            writer.write_table(part, row_group_size=GROUP_ROWS)
