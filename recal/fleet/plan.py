"""From run directories to units with their runs in time order; what cannot be ordered is set aside
with its reason.
"""

import hashlib
import json
import os
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

from ins.records import InputError, RunHeader
from recal.fleet.records import FleetOutcome, PlannedRun, RunOutcome, outcome_of
from recal.service.inputs.listings import (
    JsonObject,
    StrictModel,
    parse,
    read_csv_rows,
    read_header,
    read_small_text,
    read_toml,
)
from recal.service.store import UnitKey, moment

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


CLOCK_FROM = datetime(1990, 1, 1, tzinfo=UTC)  # older than any log: the clock was never set
CLOCK_AHEAD = timedelta(days=1)


@dataclass(frozen=True, kw_only=True)
class FleetPlan:
    """Runs by unit, each unit's in the order of their start; set_aside: those that no update is
    tried with.
    """

    units: dict[UnitKey, tuple[PlannedRun, ...]]
    set_aside: tuple[RunOutcome, ...]


def plan_fleet(listed: Sequence[ListedRun], now: datetime) -> FleetPlan:
    """Read every run.json; group by unit, order by start_utc, then run_id and path."""
    units: dict[UnitKey, list[PlannedRun]] = defaultdict(list)
    set_aside: list[RunOutcome] = []
    for run in listed:
        try:
            header = _header(run)
        except InputError as error:
            set_aside.append(
                RunOutcome(
                    path=str(run.path), outcome=FleetOutcome.BAD_INPUT, reasons=(str(error),)
                )
            )
            continue
        key = UnitKey(
            imu_serial=header.imu_serial,
            gyro_technology=header.gyro_technology,
            gyro_mode=header.gyro_mode,
        )
        planned = PlannedRun(
            path=str(run.path),
            unit=key,
            run_id=header.run_id,
            start_utc=header.start_utc,
            signature=_signature(run.path),
            twin=None if run.twin is None else str(run.twin),
        )
        wrong = wrong_clock(header.start_utc, now)
        if wrong:
            set_aside.append(
                outcome_of(planned, FleetOutcome.BAD_INPUT, f"{run.path}/run.json: {wrong}")
            )
        else:
            units[key].append(planned)
    return FleetPlan(
        units={key: _ordered(units[key]) for key in sorted(units)}, set_aside=tuple(set_aside)
    )


def wrong_clock(start_utc: str, now: datetime) -> str:
    """Why a start cannot be right, empty where it may be: order and ageing rest on it."""
    start = moment(start_utc)
    if CLOCK_FROM <= start <= now + CLOCK_AHEAD:
        return ""
    why = "the clock was not set" if start < CLOCK_FROM else "in the future"
    return (
        f"start_utc = {start_utc} ({why}), needed {CLOCK_FROM:%Y-%m-%d} to"
        f" {now + CLOCK_AHEAD:%Y-%m-%d}"
    )


def _header(run: ListedRun) -> RunHeader:
    if run.wrong:
        raise InputError(run.wrong)
    if not run.path.is_dir():
        raise InputError(f"{run.path}: no such run directory")
    return read_header(run.path)


def _ordered(runs: Sequence[PlannedRun]) -> tuple[PlannedRun, ...]:
    """In time order; two power-ons of one unit cannot start together, so a tie is said."""
    ordered = sorted(runs, key=lambda run: (moment(run.start_utc), run.run_id, run.path))
    starts = Counter(moment(run.start_utc) for run in ordered)
    note = "starts at the same time as another run of this unit: taken in the order of run_id"
    return tuple(
        replace(run, notes=(*run.notes, note)) if starts[moment(run.start_utc)] > 1 else run
        for run in ordered
    )


def _signature(path: Path) -> str:
    """Names, sizes and times of a run's files: another one when a file was written anew."""
    digest = hashlib.sha256()
    for entry in sorted(os.scandir(path), key=lambda e: e.name):
        status = entry.stat(follow_symlinks=False)
        digest.update(f"{entry.name} {status.st_size} {status.st_mtime_ns}\n".encode())
    return digest.hexdigest()[:16]
