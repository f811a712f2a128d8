"""What plan.json (`recal.plan/1`) holds: a field is a key. `ins.verdicts.plain` makes the JSON."""

from dataclasses import dataclass, field

from ins.documents import OMIT_NONE
from ins.verdicts import Observability
from simreal.plan.pairs import PairVerdict

SCHEMA = "recal.plan/1"


@dataclass(frozen=True, kw_only=True)
class CriteriaRecord:
    """When two effects are told apart (odds), and when one is seen (alpha)."""

    odds: float
    odds_nats: float
    alpha: float
    null_nats: float


@dataclass(frozen=True, kw_only=True)
class MemberRecord:
    """One effect of a pair."""

    effect: str
    target: str


@dataclass(frozen=True, kw_only=True)
class PairRecord:
    """Two rivals."""

    label: str
    a: MemberRecord
    b: MemberRecord


@dataclass(frozen=True, kw_only=True)
class CoefficientRecord:
    """The sizes of a coefficient: usual, and those from which it is seen and told from its rival
    (inf: never).
    """

    name: str
    unit: str
    usual: tuple[float, ...]
    seen_from: float
    told_from: float


@dataclass(frozen=True, kw_only=True)
class SizesRecord(MemberRecord):
    """An effect in the runs; `delta_*`: norms of the whitened effect."""

    delta_usual: tuple[float, ...]
    delta_seen: float
    delta_needed: float
    coefficients: tuple[CoefficientRecord, ...]


@dataclass(frozen=True, kw_only=True)
class JudgedRecord:
    """A pair in a plan; what follows `lacks` only where the runs can show both.

    special_case : "a" or "b" where that one is a special case of the other, else empty.
    """

    label: str
    verdict: PairVerdict
    lacks: str
    cos: float | None = field(default=None, metadata=OMIT_NONE)
    delta_needed: float | None = field(default=None, metadata=OMIT_NONE)
    cos_typical: float | None = field(default=None, metadata=OMIT_NONE)
    delta_needed_typical: float | None = field(default=None, metadata=OMIT_NONE)
    special_case: str | None = field(default=None, metadata=OMIT_NONE)
    a: SizesRecord | None = field(default=None, metadata=OMIT_NONE)
    b: SizesRecord | None = field(default=None, metadata=OMIT_NONE)

    @property
    def members(self) -> tuple[SizesRecord, ...]:
        """Both effects where the runs can show them, else none."""
        return tuple(m for m in (self.a, self.b) if m is not None)

    @property
    def special(self) -> SizesRecord | None:
        """The one that is a special case of the other."""
        return {"a": self.a, "b": self.b}.get(self.special_case or "")


@dataclass(frozen=True, kw_only=True)
class RecordingRecord:
    """A recording, in words and in numbers."""

    recording: str
    words: str
    start: str
    heading_deg: float
    hours: float
    taxi: bool
    gnss: bool
    odometer: bool


@dataclass(frozen=True, kw_only=True)
class StepRecord(RecordingRecord):
    """A recording added to a plan, and the pairs that it separates."""

    score: float
    separates: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class PlanOfRecordings:
    """A set of recordings, and every pair in it. run_ids: of the runs at hand."""

    name: str
    score: float
    hours: float
    recordings: tuple[RecordingRecord, ...]
    pairs: tuple[JudgedRecord, ...]
    run_ids: tuple[str, ...] | None = field(default=None, metadata=OMIT_NONE)

    @property
    def separated(self) -> int:
        """Pairs that are told apart, at least where the effect is large."""
        return sum(p.verdict.separates for p in self.pairs)


@dataclass(frozen=True, kw_only=True)
class FlightGyroRecord:
    """What a flight would show of a gyro: sigma of its mean over the session before and after."""

    axis: str
    verdict: Observability
    sigma_before_deg_h: float
    sigma_after_deg_h: float


@dataclass(frozen=True, kw_only=True)
class FlightNodeRecord:
    """Sigma of the table at a node before and after a flight."""

    axis: str
    temperature_degC: float
    before_deg_h: float
    after_deg_h: float


@dataclass(frozen=True, kw_only=True)
class FlightRecord:
    """A flight, and what an update of it would show; best_for: the gyros that no other flight of
    the list shows better.
    """

    flight: str
    words: str
    hours: float
    from_degC: float
    to_degC: float
    best_for: tuple[str, ...]
    gyros: tuple[FlightGyroRecord, ...]
    nodes: tuple[FlightNodeRecord, ...]


@dataclass(frozen=True, kw_only=True)
class NeverRecord:
    """A pair that no recording separates."""

    label: str
    why: str


@dataclass(frozen=True, kw_only=True)
class InseparableRecord:
    """What no parked recording separates, in words."""

    a: str
    b: str
    why: str


@dataclass(frozen=True, kw_only=True)
class PlanRecord:
    """The document of a study."""

    schema: str = SCHEMA
    verdict: str = "planned"
    version: str
    noise_model: str
    imu_serial: str
    gyro_technology: str
    lat_deg: float
    without: tuple[str, ...]
    criteria: CriteriaRecord
    pairs: tuple[PairRecord, ...]
    given: PlanOfRecordings | None
    compared: tuple[PlanOfRecordings, ...]
    steps: tuple[StepRecord, ...]
    recommended: PlanOfRecordings
    next: tuple[StepRecord, ...]
    never: tuple[NeverRecord, ...]
    inseparable: tuple[InseparableRecord, ...]
    flights: tuple[FlightRecord, ...] | None = field(default=None, metadata=OMIT_NONE)
