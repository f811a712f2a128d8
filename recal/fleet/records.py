"""What a fleet update plans, hands to its workers and gets back."""

import hashlib
import json
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Any

from recal.service.store import UnitKey


class FleetOutcome(StrEnum):
    """What became of a run of a fleet."""

    COMMITTED = "committed"
    PROPOSED = "proposed"
    ALREADY = "already"
    INCONSISTENT = "inconsistent"
    REFUSED = "refused"
    BAD_INPUT = "bad_input"
    TAKEN_OUT = "taken_out"
    CRASHED = "crashed"
    AGAIN = "again"  # not told yet: to be taken again without the runs that are


class FleetVerdict(StrEnum):
    """What became of a fleet (docs, results)."""

    COMMITTED = "committed"
    PROPOSED = "proposed"
    UP_TO_DATE = "up_to_date"
    INCONSISTENT = "inconsistent"
    REFUSED = "refused"
    BAD_INPUT = "bad_input"
    FAILED = "failed"


MERGED = (FleetOutcome.COMMITTED, FleetOutcome.PROPOSED)
OUTCOMES = {  # outcome of a run: what it means, in the order of the report
    FleetOutcome.COMMITTED: "merged into the stored table",
    FleetOutcome.PROPOSED: "would be merged; nothing was stored in the table",
    FleetOutcome.ALREADY: "the table held this run before",
    FleetOutcome.INCONSISTENT: "contradicts the model or the stored table; left out",
    FleetOutcome.REFUSED: "not usable, nothing to gain from it, or no table of its unit; left out",
    FleetOutcome.BAD_INPUT: "cannot be read as a run; left out",
    FleetOutcome.TAKEN_OUT: "merged by an earlier call, but the store does not hold it now",
    FleetOutcome.CRASHED: (
        "the program, its worker or the store broke down on it; the same command tries again"
    ),
}


@dataclass(frozen=True, kw_only=True)
class FleetRequest:
    """What was asked for.

    Parameters
    ----------
    source : path
        A folder, searched for runs, or a manifest (.csv, .jsonl, .toml).
    store_url : str
        The store of tables.
    output : path
        The folder to write to.
    mode : str
        One of MODES.
    by : str
        Who proposes.
    note : str
        A note kept with the proposals.
    joint : bool
        With --commit: take all runs of a unit as one update.
    known_only : bool
        Refuse runs of units without a stored table; with --dry-run too.
    new_unit, new_store : bool
        Make them where they are not there.
    workers : int
        Processes on this machine.
    cluster : str
        Work on the cluster of this Dask scheduler, such as tcp://host:8786.
    config : path, optional
        Settings (TOML) of the session.
    pages : {'last', 'all', 'none'}
        Which runs get a page: a unit's last of each outcome, all, or none.
    """

    source: Path
    store_url: str
    output: Path
    mode: str = "propose"
    by: str = ""
    note: str = ""
    joint: bool = False
    known_only: bool = False
    new_unit: bool = False
    new_store: bool = False
    workers: int = 1
    cluster: str = ""
    config: Path | None = None
    pages: str = "last"

    @property
    def jointly(self) -> bool:
        """All runs of a unit as one update; a proposal must stand on the active table."""
        return self.joint or self.mode != "commit"

    @property
    def refuses_new_units(self) -> bool:
        """What is stored is stored for units that the store knows, unless asked for otherwise."""
        return self.known_only or (self.mode != "dry" and not self.new_unit)


@dataclass(frozen=True, kw_only=True)
class CallSettings:
    """What makes two calls the same piece of work; config: its hash."""

    store: str
    mode: str
    joint: bool
    config: str | None
    version: str


@dataclass(frozen=True, kw_only=True)
class PlannedRun:
    """A run whose run.json could be read; `signature` changes when a file of the run does. Times as
    text of run.json.
    """

    path: str
    unit: UnitKey
    run_id: str
    start_utc: str
    signature: str
    twin: str | None = None
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class RunOutcome:
    """What became of a run; unit fields are empty where run.json could not be read. seconds, cpu_s:
    wall and CPU time.
    """

    path: str
    outcome: FleetOutcome
    reasons: tuple[str, ...] = ()
    signature: str = ""
    imu_serial: str = ""
    gyro_technology: str = ""
    gyro_mode: str = ""
    run_id: str = ""
    start_utc: str = ""
    sha256: str = ""
    folder: str = ""
    revision: int | None = None
    proposal: int | None = None
    seconds: float = 0.0
    cpu_s: float = 0.0
    worker: str = ""
    attempts: int = 1
    notes: tuple[str, ...] = ()

    @property
    def unit(self) -> UnitKey | None:
        if not self.imu_serial:
            return None
        return UnitKey(
            imu_serial=self.imu_serial,
            gyro_technology=self.gyro_technology,
            gyro_mode=self.gyro_mode,
        )


def outcome_of(run: PlannedRun, outcome: FleetOutcome, *reasons: str, **more: Any) -> RunOutcome:
    """An outcome with what is known of the run."""
    return RunOutcome(
        path=run.path,
        outcome=outcome,
        reasons=reasons,
        signature=run.signature,
        run_id=run.run_id,
        start_utc=run.start_utc,
        **{"notes": run.notes, **vars(run.unit), **more},
    )


@dataclass(frozen=True, kw_only=True)
class RunTask:
    """Runs of one unit to be updated with in one go, in time order: one, or all of them jointly.

    folders: where the report of each run goes; a joint update writes to the first. head: number of
    the unit's active revision before the fleet update first began: what is in it was not merged by
    it. merged: hash and path of the unit's runs that were.
    """

    runs: tuple[PlannedRun, ...]
    folders: tuple[str, ...]
    store_url: str
    commit: bool
    propose: tuple[str, str] | None
    config: str | None
    head: int
    merged: tuple[tuple[str, str], ...] = ()
    attempt: int = 1

    @property
    def unit(self) -> UnitKey:
        return self.runs[0].unit


@dataclass(frozen=True, kw_only=True)
class UnitTask:
    """To sum up a unit once its runs are through, and to draw the pages of its reports."""

    unit: UnitKey
    outcomes: tuple[RunOutcome, ...]
    pages: str
    attempt: int = 1

    @property
    def identity(self) -> str:
        """The same for the same outcomes and pages."""
        text = json.dumps([self.pages, [(o.path, o.outcome, o.sha256) for o in self.outcomes]])
        return hashlib.sha256(text.encode()).hexdigest()[:16]


Task = RunTask | UnitTask
