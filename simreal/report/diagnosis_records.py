"""What diagnosis.json (`recal.diagnosis/1`, formats.md section 5) holds: a field is a key."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated

from infield.reports.documents.noise_fit import NoiseFit
from ins.documents import OMIT_NONE, AsRead, written_as
from ins.records import EffectDocument
from simreal.inference.verdict import GapVerdict, Judging, KeptOut, Looks
from simreal.predict.records import SimulatorRecord

SCHEMA = "recal.diagnosis/1"


@dataclass(frozen=True, kw_only=True)
class GapRecord:
    """Mean squared whitened residual over all rows, the twin's own, its distance from that in
    sigmas of the null, and the p-value that there is no gap.
    """

    score: float | None
    floor: float | None
    p_value: float | None
    excess_sigma: float | None = None


@dataclass(frozen=True, kw_only=True)
class GapAfterRecord:
    """The same with what was found."""

    score: float | None
    p_value: float | None
    excess_sigma: float | None = None


@dataclass(frozen=True, kw_only=True)
class GoneRecord:
    """Share of the excess over the floor that what was found takes away."""

    fraction: float
    interval_95: tuple[float, ...]


@dataclass(frozen=True, kw_only=True)
class ChannelRecord:
    """The gap over all rows of one channel, as `gap` and `gap_after` have it over all."""

    channel: str
    rows: int
    score: float
    score_after: float
    excess_sigma: float
    excess_sigma_after: float
    shrink: GoneRecord


@dataclass(frozen=True, kw_only=True)
class PlaceRecord:
    """Where a part of the gap lies; share of the total excess."""

    channel: str
    phase: str
    temperature_degC: tuple[float, ...] | None
    frequency_hz: tuple[float, ...]
    time_s: tuple[float, ...]
    share: float


@dataclass(frozen=True, kw_only=True)
class ParameterRecord:
    """A parameter of a cause.

    usual: its usual size. sigma_from: "fit", "bounds" (of a shape that the data do not narrow) or
    None. below_declared: of a noise, that much less than the twin declares.
    """

    value: float
    sigma: float | None
    unit: str
    usual: tuple[float, ...] | None
    unusual: bool
    sigma_from: str | None
    below_declared: bool


@dataclass(frozen=True, kw_only=True)
class ShrinkRecord:
    """Share of the excess that is gone on held-out data; size of the held-out gap in sigmas."""

    fraction: float
    interval_95: tuple[float, ...]
    held_out: bool
    how: Judging
    size: float
    too_small: bool


@dataclass(frozen=True, kw_only=True)
class RivalRecord:
    """Another answer; cosine of the two signatures, None for noise."""

    effect: str
    target: str
    probability: float
    cosine: float | None


@dataclass(frozen=True, kw_only=True)
class AnswerRecord:
    """A probable answer of a cause."""

    effect: str
    target: str
    probability: float


@dataclass(frozen=True, kw_only=True)
class RmsRecord:
    """RMS of an effect on a channel while parked."""

    value: float
    unit: str


@dataclass(frozen=True, kw_only=True)
class CauseRecord:
    """A found effect. twin_effects: its items in the twin that the diagnosis writes; kept_out: why
    there are none. advice: the command that mends it.
    """

    effect: str
    target: str
    probability: float
    confounded_with: tuple[str, ...]
    parameters: Mapping[str, ParameterRecord]
    shrink: ShrinkRecord | None
    id: str
    named: bool
    resolved: bool
    repeats: str
    run_id: str | None
    size: float
    rivals: tuple[RivalRecord, ...]
    posterior: tuple[AnswerRecord, ...]
    rms: Mapping[str, RmsRecord]
    nodes: tuple[float, ...]
    values: tuple[float, ...]
    twin_effects: tuple[Annotated[EffectDocument, AsRead()], ...]
    kept_out: KeptOut | None = field(default=None, metadata=OMIT_NONE)
    advice: str | None = field(default=None, metadata=OMIT_NONE)


@dataclass(frozen=True, kw_only=True)
class OpenRecord:
    """A cause that the twin leaves out: why, what would settle it, and the items of the twin for
    who takes it out all the same.
    """

    effect: str
    target: str
    why: KeptOut
    settled_by: tuple[str, ...]
    twin_effects: tuple[Annotated[EffectDocument, AsRead()], ...]


@dataclass(frozen=True, kw_only=True)
class UnexplainedRecord:
    """What is left; share of the excess, and the test that sees it."""

    present: bool | None
    p_value: float | None
    share: float | None
    looks_like: Looks = Looks.NOTHING


@dataclass(frozen=True, kw_only=True)
class NotTestableRecord:
    """An effect that these runs cannot show; target where only that one lacks something."""

    effect: str
    needs: str
    target: str | None = field(default=None, metadata=OMIT_NONE)


@dataclass(frozen=True, kw_only=True)
class DriftRecord:
    """At the end of unaided navigation."""

    rate_nm_h: float
    speed_m_s: float


@dataclass(frozen=True, kw_only=True)
class UserRecord:
    """A parked run aligned and navigated: as it is, and without the found effects."""

    run_id: str
    align_s: float
    navigated_s: float
    heading_change_arcmin: float
    as_it_is: DriftRecord = field(metadata=written_as("with"))
    without: DriftRecord


@dataclass(frozen=True, kw_only=True)
class CellRecord:
    """Squares of one channel and band; `_after` with what was found. frequency_hz: an upper end of
    None is open.
    """

    channel: str
    moving: bool
    frequency_hz: tuple[float | None, ...]
    dof: float
    rho: float
    nats: float
    located: bool
    rho_after: float
    nats_after: float
    located_after: bool


@dataclass(frozen=True, kw_only=True)
class RunRecord:
    """A run that was given; what follows `used` only of one that could be looked at."""

    run_id: str
    sha256: str
    start_utc: str | None = field(default=None, metadata=OMIT_NONE)
    used: bool
    parked_s: tuple[float, ...] | None = field(default=None, metadata=OMIT_NONE)
    moves: bool | None = field(default=None, metadata=OMIT_NONE)
    held_out: bool | None = field(default=None, metadata=OMIT_NONE)


@dataclass(frozen=True, kw_only=True)
class NotLookedAtRecord:
    """A run that could not be looked at."""

    run_id: str
    why: str


@dataclass(frozen=True, kw_only=True)
class DiagnosisRecord:
    """The document of a diagnosis."""

    schema: str = SCHEMA
    verdict: GapVerdict
    sentence: str
    reasons: tuple[str, ...] = ()
    imu_serial: str
    gyro_technology: str
    twin: str
    version: str
    gap: GapRecord
    where: tuple[PlaceRecord, ...] = ()
    causes: tuple[CauseRecord, ...] = ()
    open: tuple[OpenRecord, ...] = ()
    unexplained: UnexplainedRecord
    not_testable: tuple[NotTestableRecord, ...]
    gap_after: GapAfterRecord
    shrink: GoneRecord | None = field(default=None, metadata=OMIT_NONE)
    channels: tuple[ChannelRecord, ...] = ()
    user_level: tuple[UserRecord, ...] = ()
    record_next: tuple[str, ...] = ()
    cells: tuple[CellRecord, ...] = ()
    runs: tuple[RunRecord, ...]
    not_looked_at: tuple[NotLookedAtRecord, ...]
    notes: tuple[str, ...] = ()
    noise_fit: NoiseFit | None = field(default=None, metadata=OMIT_NONE)
    simulator: SimulatorRecord | None = field(default=None, metadata=OMIT_NONE)
    alpha: float
    threshold_nats: float | None
    replicates: int
    seed: int
    table_sha256: str | None
