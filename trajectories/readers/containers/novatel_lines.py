"""Lines of a NovAtel ASCII log: `#NAMEA,header;fields*crc` and, with a short header,
`%NAMEA,week,seconds;fields*crc`.

The check is a CRC32 over all between the first sign and the star, begun with 0 and not inverted
(OEM7, "32-Bit CRC"). A log caught from a port may begin within a line, and hold other things
between the lines: only what has the sign of a wanted log and fails is told.
"""

import re
import zlib
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ins.records import InputError
from trajectories.readers.rows.row_cleaning import row_ranges
from trajectories.runs.notes import About, Note
from trajectories.runs.text_rows import arrow_words, line_blocks, text_parts

LINE = re.compile(rb"[#%]([A-Z0-9_]+)A,([^;*#%]*);([^*#%]*)\*([0-9a-fA-F]{8})")
FRAME_SIGNS = (b"\xaa\x44\x12", b"\xaa\x44\x13")  # of binary logs: long and short head


# by name: header and fields of each line, both between commas
Logs = dict[str, list[tuple[bytes, bytes]]]


@dataclass
class Lines:
    """The good lines of a file, notes on the rest, and whether signs of binary logs are among
    them.
    """

    logs: Logs = field(default_factory=dict)
    has_frames: bool = False
    notes: list[str] = field(default_factory=list)


def crc32(text: bytes) -> int:
    """The check of a line: polynomial 0xEDB88320, begun with 0, not inverted."""
    return zlib.crc32(text, 0xFFFFFFFF) ^ 0xFFFFFFFF


def read_lines(path: Path, wanted: Collection[str]) -> Lines:
    """The good lines of the wanted logs of a text."""
    notes: list[str] = []
    out = lines_of(_lines(path, notes), wanted, path.name)
    out.notes = notes + out.notes
    return out


def lines_of(lines: Iterable[bytes], wanted: Collection[str], label: str) -> Lines:
    """The good lines of the wanted logs among others, or among bytes that are no text."""
    out, bad, cut = Lines(), list[int](), list[int]()
    looked_for = re.compile(rb"[#%](" + "|".join(wanted).encode() + rb")A,")
    for k, line in enumerate(lines):
        out.has_frames = out.has_frames or any(sign in line for sign in FRAME_SIGNS)
        begins = looked_for.search(line)
        if begins is None:
            continue
        found = LINE.match(line, begins.start())
        if found is None:
            cut.append(k)
        elif crc32(line[begins.start() + 1 : found.start(4) - 1]) != int(found[4], 16):
            bad.append(k)
        else:
            out.logs.setdefault(found[1].decode(), []).append((found[2], found[3]))
    for rows, why in ((cut, "cut off or garbled"), (bad, "wrong CRC")):
        if rows:
            told = row_ranges(np.array(rows)).replace("row", "line")
            out.notes.append(Note(f"{label}: {told} dropped: {why}", About.DAMAGE))
    return out


def columns(
    rows: Sequence[bytes], names: Sequence[str], *, text: Collection[str] = (), label: str
) -> dict[str, NDArray]:
    """The fields of lines by name (an empty name: not wanted), numbers as float64, those of `text`
    as words.

    Lines of another number of fields are left out by the caller (`of_width`).
    """
    import pyarrow as pa
    from pyarrow import csv as arrow_csv

    keys = [f"{k} {name}" for k, name in enumerate(names)]
    wanted = {
        key: pa.string() if name in text else pa.float64() for key, name in zip(keys, names) if name
    }
    try:
        table = arrow_csv.read_csv(
            pa.BufferReader(b"\n".join(rows) + b"\n"),
            read_options=arrow_csv.ReadOptions(column_names=keys, use_threads=False),
            convert_options=arrow_csv.ConvertOptions(
                column_types=wanted, include_columns=list(wanted)
            ),
        )
    except pa.ArrowException as error:
        raise InputError(f"{label}: {arrow_words(error)}") from None
    return {key.partition(" ")[2]: table.column(key).to_numpy() for key in wanted}


def of_width(rows: Sequence[bytes], fields: int) -> list[int]:
    """Which lines have so many fields."""
    return [k for k, row in enumerate(rows) if row.count(b",") == fields - 1]


def _lines(path: Path, notes: list[str]) -> Iterator[bytes]:
    packed: list[str] = []
    for block, _ in line_blocks(text_parts(path, packed), label=path.name):
        yield from block.split(b"\n")[: None if not block.endswith(b"\n") else -1]
    notes += [f"{path.name}: {note}" for note in packed]
