"""Which runs a fleet update takes: all below a folder, or those that a manifest names (CSV, JSON
lines or TOML).
"""

import json
import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from ins.records import InputError
from recal.service.inputs.listings import (
    JsonObject,
    StrictModel,
    parse,
    read_csv_rows,
    read_small_text,
    read_toml,
)

ENDINGS = ("imu.parquet", "imu.csv", "imu.csv.gz")


@dataclass(frozen=True, kw_only=True)
class ListedRun:
    """A run directory, absolute; `wrong`: why it cannot be taken, where that is known already."""

    path: Path
    twin: Path | None = None
    wrong: str = ""


class _Entry(StrictModel):
    path: str
    twin: str | None = None


def listed_runs(source: Path) -> list[ListedRun]:
    """The runs of a folder (any depth) or of a manifest, each once. InputError where there is
    none.
    """
    if source.is_dir():
        found = sorted(_below(source.absolute()), key=lambda run: run.path)
        if not found:
            raise InputError(f"{source}: no run below it (a folder with run.json)")
        return found
    if not source.exists():
        raise InputError(f"{source}: no such folder or manifest")
    entries = list(_entries(source))
    if not entries:
        raise InputError(f"{source}: names no run")
    folder, seen, runs = source.absolute().parent, set(), []
    for entry in entries:
        path = Path(os.path.normpath(folder / entry.path))
        twin = None if not entry.twin else Path(os.path.normpath(folder / entry.twin))
        if path not in seen:
            runs.append(ListedRun(path=path, twin=twin))
        seen.add(path)
    return runs


def _below(folder: Path) -> Iterator[ListedRun]:
    """Run directories at any depth, links followed once; names that begin with a dot are
    half-written runs.
    """
    seen: set[tuple[int, int]] = set()
    for name, folders, files in os.walk(folder, followlinks=True):
        status = os.stat(name)
        here = (status.st_dev, status.st_ino)
        known = here in seen
        seen.add(here)
        folders[:] = [] if known else sorted(f for f in folders if not f.startswith("."))
        if known:
            continue
        if "run.json" in files:
            folders[:] = []
            yield ListedRun(path=Path(name))
        elif any(end in files for end in ENDINGS):
            folders[:] = []
            yield ListedRun(
                path=Path(name), wrong=f"{name}: run.json is missing beside the imu stream"
            )


def _entries(source: Path) -> Iterator[_Entry]:
    readers = {
        ".csv": _csv_rows,
        ".jsonl": _json_lines,
        ".ndjson": _json_lines,
        ".toml": _toml_runs,
    }
    reader = readers.get(source.suffix)
    if reader is None:
        raise InputError(
            f"{source}: needed a folder, or a manifest that ends in {', '.join(readers)}"
        )
    for where, row in reader(source):
        yield parse(_Entry, row, name=where)


def _csv_rows(source: Path) -> Iterator[tuple[str, JsonObject]]:
    rows = read_csv_rows(source)
    names = [name.strip() for name in rows[0][1]] if rows else []
    for number, row in rows[1:]:
        where = f"{source}: line {number}"
        if len(row) != len(names):
            raise InputError(f"{where}: needed as many fields as the header has ({len(names)})")
        yield where, {k: v.strip() for k, v in zip(names, row) if v.strip() or k == "path"}


def _json_lines(source: Path) -> Iterator[tuple[str, JsonObject]]:
    for number, line in enumerate(read_small_text(source).splitlines(), 1):
        if not line.strip():
            continue
        try:
            row = json.loads(line)
        except ValueError as error:
            raise InputError(f"{source}: line {number}: not valid JSON ({error})") from None
        if not isinstance(row, dict):
            raise InputError(f'{source}: line {number}: needed an object like {{"path": "run-1"}}')
        yield f"{source}: line {number}", row


def _toml_runs(source: Path) -> Iterator[tuple[str, JsonObject]]:
    data = read_toml(source)
    rows = data.get("run")
    wrong = f"{source}: needed [[run]] sections with path, and nothing else"
    if set(data) != {"run"} or not isinstance(rows, list):
        raise InputError(wrong)
    sections = [row for row in rows if isinstance(row, dict)]
    if len(sections) < len(rows):
        raise InputError(wrong)
    for number, row in enumerate(sections, 1):
        yield f"{source}: [[run]] {number}", row
