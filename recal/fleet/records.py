"""What a fleet update plans, hands to its workers and gets back, and what fleet.json
(recal.fleet/1) holds of it.
"""

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import Any

from ins.documents import OMIT_NONE, written
from recal.service.priors.records import ForecastReport
from recal.service.results.pages import BiasStep, MethodDocument
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
    """What became of a run, as workers and the journal have it; unit fields are empty where
    run.json could not be read. seconds, cpu_s: wall and CPU time.
    """

    path: str
    outcome: FleetOutcome
    reasons: tuple[str, ...] = ()
    imu_serial: str = ""
    gyro_technology: str = ""
    gyro_mode: str = ""
    run_id: str = ""
    start_utc: str = ""
    sha256: str = ""
    revision: int | None = None
    proposal: int | None = None
    seconds: float = 0.0
    cpu_s: float = 0.0
    worker: str = ""
    attempts: int = 1
    notes: tuple[str, ...] = ()
    signature: str = ""
    folder: str = ""

    @property
    def unit(self) -> UnitKey | None:
        """None where it is not known."""
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
class TemperatureBand:
    """Seconds of a unit's merged runs in 5 degC of gyro temperature."""

    low_degC: float
    high_degC: float
    seconds: float


@dataclass(frozen=True, kw_only=True)
class FleetBand:
    """How many units were seen in 5 degC of gyro temperature, and for how long."""

    low_degC: float
    high_degC: float
    units: int
    seconds: float


@dataclass(frozen=True, kw_only=True)
class TableDrift:
    """The level gyros' change from the first merge's old table to the last one's new, at the
    temperatures of the points.

    surprise_sigmas: RMS of the change over what the old table's sigma led to expect of it.
    """

    level_change_deg_h: float
    nm_h: float
    sigma_nm_h: float
    surprise_sigmas: float
    sigma_before_deg_h: float
    sigma_after_deg_h: float
    largest_deg_h: float
    temperature_degC: tuple[float, float]
    table_before_sha256: str | None
    table_after_sha256: str | None
    since_utc: str
    until_utc: str


@dataclass(frozen=True, kw_only=True)
class StepDrift:
    """What a step that the table does not follow makes of a solution."""

    nm_h: float
    sigma_nm_h: float


@dataclass(frozen=True, kw_only=True)
class UnitReport:
    """What the reports of a unit's runs say of it; of: the outcomes and pages that it sums up."""

    of: str = ""
    drift: TableDrift | None = None
    coverage: Sequence[TemperatureBand] = ()
    steps: Sequence[BiasStep] = ()
    step_words: Sequence[str] = ()
    pages: Sequence[str] = ()


@dataclass(frozen=True, kw_only=True)
class TableFacts:
    """A stored table today. age_days: of its newest data; sigma_deg_h: RMS over the nodes of the
    level gyros; stale: why it needs attention.
    """

    revision: int
    kind: str
    sha256: str
    created_utc: str
    stored_utc: str
    age_days: float
    sigma_deg_h: float
    contradictions: int
    contradicted_by: Sequence[str]
    stale: Sequence[str]


@dataclass(frozen=True, kw_only=True)
class UnitRow(UnitKey):
    """A unit of the fleet. runs: how many came to each outcome; ranked_nm_h: the larger of drift
    and step, -1 without either.
    """

    runs: Mapping[str, int]
    drift: TableDrift | None
    step_drift: StepDrift | None
    ranked_nm_h: float
    coverage: Sequence[TemperatureBand]
    steps: Sequence[BiasStep]
    step_words: Sequence[str]
    table: TableFacts | None
    page: str | None
    pages: Sequence[str]
    proposal: int | None
    rank: int | None = None


@dataclass(frozen=True, kw_only=True)
class StaleRow(UnitKey):
    """A table that needs somebody's attention."""

    reasons: Sequence[str]
    contradictions: int
    age_days: float
    in_this_update: bool


@dataclass(frozen=True)
class Example:
    """One run of a group, with its own reason."""

    path: str
    reason: str


@dataclass(frozen=True, kw_only=True)
class LeftOutGroup:
    """Runs left out for one reason, numbers and names taken out of it."""

    outcome: FleetOutcome
    reason: str
    count: int
    units: int
    example: Example


@dataclass(frozen=True)
class NoteGroup:
    """A note and how many runs have it."""

    note: str
    count: int
    example: str


@dataclass(frozen=True, kw_only=True)
class Criteria:
    """What makes a table stale, and a change surprising."""

    stale_after_days: float
    stale_sigma_deg_h: Mapping[str, float]
    stale_contradictions: int
    surprise_sigmas: float


@dataclass(frozen=True, kw_only=True)
class Spread:
    """Of the runs of a call [s]."""

    median: float
    p95: float
    max: float


@dataclass(frozen=True, kw_only=True)
class CallTiming:
    """What a call cost; curve: seconds since it began, runs through by then."""

    began_utc: str
    seconds: float
    runs: int
    workers: int
    where: str
    runs_per_hour: float | None
    run_s: Spread | None
    run_cpu_s: Spread | None
    cpu_s: float
    curve: Sequence[tuple[float, int]]


@dataclass(frozen=True, kw_only=True)
class EarlierCall:
    """A call that this one goes on from, with the revisions that it found; timing: None where it
    was killed.
    """

    utc: str
    heads: Mapping[str, int]
    timing: CallTiming | None = field(default=None, metadata=OMIT_NONE)


@dataclass(frozen=True, kw_only=True)
class FleetTiming(CallTiming):
    """The same with the calls that this one goes on from."""

    earlier_calls: Sequence[EarlierCall]


@written(
    "path outcome reasons imu_serial gyro_technology gyro_mode run_id start_utc sha256 revision"
    " proposal seconds cpu_s worker attempts notes report"
)
@dataclass(frozen=True, kw_only=True)
class RunRow(RunOutcome):
    """What became of a run; report: relative to the output folder."""

    report: str | None


@dataclass(frozen=True, kw_only=True)
class FleetReport:
    """The whole file."""

    schema: str = "recal.fleet/1"
    verdict: FleetVerdict
    reasons: Sequence[str]
    store: str
    mode: str
    issued_utc: str
    method: MethodDocument
    counts: Mapping[str, int]
    units: Sequence[UnitRow]
    stale: Sequence[StaleRow]
    left_out: Sequence[LeftOutGroup]
    noted: Sequence[NoteGroup]
    coverage: Sequence[FleetBand]
    criteria: Criteria
    timing: FleetTiming
    runs: Sequence[RunRow]
    forecast: ForecastReport | None = field(default=None, metadata=OMIT_NONE)


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
