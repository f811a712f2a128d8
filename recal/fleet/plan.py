"""From run directories to units with their runs in time order; what cannot be ordered is set aside
with its reason.
"""

import hashlib
import os
from collections import Counter, defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

from ins.records import InputError, RunHeader
from recal.fleet.manifest import ListedRun
from recal.fleet.records import FleetOutcome, PlannedRun, RunOutcome, outcome_of
from recal.service.inputs.listings import read_header
from recal.service.store import UnitKey, moment

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
