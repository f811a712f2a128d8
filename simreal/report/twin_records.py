"""What twin_fit.json (`recal.twin_fit/1`) and twin_check.json (`recal.twin_check/1`) hold: a field
is a key.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from ins.documents import OMIT_NONE, UNWRITTEN
from simreal.twin.fit.agreement import Of
from simreal.twin.fit.result import Needs, TwinFit, Why

FIT_SCHEMA, CHECK_SCHEMA = "recal.twin_fit/1", "recal.twin_check/1"
FIT_METHOD = (
    "restricted maximum likelihood of slow means with Whittle's of half-overlapping Hann spectra"
)


@dataclass(frozen=True, kw_only=True)
class ParameterRecord:
    """One number of the twin; interval_95: the upper end is a one-sided limit where not identified;
    nats: log likelihood against none of it; needed_s, needed_runs: what would identify it.
    """

    name: str
    words: str
    unit: str
    value: float
    sigma: float
    interval_95: Sequence[float]
    identified: bool
    believed: float
    seconds: float
    nats: float | None
    why: Why | None
    text: str
    needs: Needs
    needed_s: float | None
    needed_runs: float | None


@dataclass(frozen=True, kw_only=True)
class ChannelRecord:
    """A channel's spectrum and Allan deviation beside those of the model (SI units)."""

    channel: str
    p_value: float
    white: float | None
    frequency_hz: Sequence[float]
    power: Sequence[float]
    power_model: Sequence[float]
    dof: Sequence[float]
    tau_s: Sequence[float]
    allan: Sequence[float]
    allan_model: Sequence[float]
    allan_low: Sequence[float]
    allan_high: Sequence[float]


@dataclass(frozen=True, kw_only=True)
class LineRecord:
    """A line of dither or of an engine; amplitude in rad/s or m/s^2."""

    channel: str
    frequency_hz: float
    amplitude: float
    sigma: float


@dataclass(frozen=True, kw_only=True)
class RunRecord:
    """A run of the fit."""

    run_id: str
    sha256: str
    parked_s: float


@dataclass(frozen=True, kw_only=True)
class TwinFitRecord:
    """The document of a fit."""

    schema: str = FIT_SCHEMA
    verdict: str
    reasons: Sequence[str]
    version: str
    method: str = FIT_METHOD
    imu_serial: str
    gyro_technology: str
    start: str
    runs: Sequence[RunRecord]
    parked_s: float
    parameters: Sequence[ParameterRecord]
    channels: Sequence[ChannelRecord]
    lines: Sequence[LineRecord]
    axes_alike_p: Mapping[str, float]
    vehicle_share: Mapping[str, float]
    windows_left_out: Mapping[str, float]
    read_below_hz: Mapping[str, float] = field(default_factory=dict)
    read_above_hz: Mapping[str, float] = field(default_factory=dict)
    notes: Sequence[str]
    found: TwinFit | None = field(default=None, metadata=UNWRITTEN)
    twin: str | None = field(default=None, metadata=OMIT_NONE)


@dataclass(frozen=True, kw_only=True)
class CellRecord:
    """A band of a channel: power over what the twin declares, and how improbable that is."""

    channel: str
    frequency_hz: tuple[float, float]
    ratio: float
    dof: float
    p_value: float
    of: Of
    fits: bool


@dataclass(frozen=True, kw_only=True)
class TwinCheckRecord:
    """The document of a check; text: in one line."""

    schema: str = CHECK_SCHEMA
    verdict: str
    reasons: Sequence[str]
    version: str
    imu_serial: str
    noise_model: str
    runs: Sequence[str]
    parked_s: float
    p_value: float | None
    tolerated: float
    cells: Sequence[CellRecord]
    text: str
