"""What the documents of all thermal models share."""

from collections.abc import Sequence
from dataclasses import dataclass

from infield.thermal.reasons import ThermalVerdict
from ins.records import TwinModel


@dataclass(frozen=True, kw_only=True)
class ThermalDocument:
    """What the document of each thermal model begins with."""

    schema: str
    verdict: ThermalVerdict
    reasons: Sequence[str]
    reason_codes: Sequence[str | None]
    notes: Sequence[str]
    note_codes: Sequence[str | None]
    version: str
    imu_serial: str
    gyro_technology: str


@dataclass(frozen=True, kw_only=True)
class NoiseModelDocument:
    """The noise that a thermal model was fitted against."""

    source: str
    white: str = "scatter of the runs' own ten-second sums"
    turn_on_deg_h: float
    bias_instability_deg_h: float
    rate_random_walk_deg_h_sqrt_h: float


def noise_model(twin: TwinModel) -> NoiseModelDocument:
    gyro = twin.gyro
    return NoiseModelDocument(
        source=twin.source,
        turn_on_deg_h=gyro.turn_on_deg_h,
        bias_instability_deg_h=gyro.bias_instability_deg_h,
        rate_random_walk_deg_h_sqrt_h=gyro.rate_random_walk_deg_h_sqrt_h,
    )
