"""What fleet.json (recal.fleet/1) holds, as records; `fleet.document` fills them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from ins.documents import OMIT_NONE
from recal.fleet.records import FleetOutcome, FleetVerdict
from recal.service.priors.records import ForecastReport
from recal.service.results.pages import BiasStep, MethodDocument


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
class UnitRow:
    """A unit of the fleet. runs: how many came to each outcome; ranked_nm_h: the larger of drift
    and step, -1 without either.
    """

    imu_serial: str
    gyro_technology: str
    gyro_mode: str
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
class StaleRow:
    """A table that needs somebody's attention."""

    imu_serial: str
    gyro_technology: str
    gyro_mode: str
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


@dataclass(frozen=True, kw_only=True)
class RunRow:
    """What became of a run; report: relative to the output folder."""

    path: str
    outcome: FleetOutcome
    reasons: Sequence[str]
    imu_serial: str
    gyro_technology: str
    gyro_mode: str
    run_id: str
    start_utc: str
    sha256: str
    revision: int | None
    proposal: int | None
    seconds: float
    cpu_s: float
    worker: str
    attempts: int
    notes: Sequence[str]
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
