"""What `look.json` (`recal.look/1`) holds: a field is a key."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum

from infield.reports.drawing import Panel
from ins.documents import UNWRITTEN, written
from ins.records import Phase, Span
from recal.service.check import RunHolds
from simreal.twin.fit.result import Parameter, TwinFit
from trajectories.runs.checks import Finding

SCHEMA = "recal.look/1"


class LookVerdict(StrEnum):
    """Whether the log can be used for anything."""

    USABLE = "usable"
    REFUSED = "refused"
    BAD_INPUT = "bad_input"


class Use(StrEnum):
    """What a log may be used for."""

    ALIGNMENT = "alignment"
    NOISE = "noise"
    TABLE = "table"
    REPLAY = "replay"
    DIAGNOSIS = "diagnosis"


class Fit(StrEnum):
    """How far a log can be used for something."""

    YES = "yes"
    PARTLY = "partly"
    NO = "no"


@dataclass(frozen=True, kw_only=True)
class LogUse:
    """One use: whether the log is fit for it, why, and the command that does it (empty where it is
    not).
    """

    use: Use
    fit: Fit
    why: str
    reason_code: str
    command: str


@dataclass(frozen=True, kw_only=True)
class Assumption:
    """What the log does not say: the key of run.json, what was taken for it, and the option that
    says it. sigma: of a guess from the data, None of what any value would do for.
    """

    key: str
    value: str | float
    option: str
    text: str
    sigma: float | None = None


@written("name value sigma unit")
class NoiseNumber(Parameter):
    """A number of the noise model that the log tells, with one sigma."""


@dataclass(frozen=True, kw_only=True)
class LookReport:
    """What `recal look --json` prints; noise: only what the log itself tells; start_utc: None where
    nobody knows it.
    """

    schema: str = SCHEMA
    verdict: LookVerdict
    reasons: Sequence[str]
    version: str
    log: str
    format: str
    run_id: str
    imu_serial: str
    gyro_technology: str
    start_utc: str | None
    assumed: Sequence[Assumption]
    holds: RunHolds
    problems: Sequence[Finding]
    notes: Sequence[str]
    repaired: Sequence[Span]
    phases: Sequence[Phase]
    rest_s: float
    uses: Sequence[LogUse]
    noise: Sequence[NoiseNumber]
    convert: str
    series: Mapping[str, Panel] = field(metadata=UNWRITTEN)
    fitted: TwinFit | None = field(metadata=UNWRITTEN)
