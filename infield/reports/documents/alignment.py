"""`alignment.json` of formats.md, section 5."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from alignment.level_fit import LevelFound
from alignment.reasons import AlignmentVerdict
from alignment.result import Alignment
from infield.session.parked.zero_rate import ZeroRates
from ins.documents import OMIT_NONE, Null, written
from ins.records import Phase, Run, Span
from ins.units import ARCSEC, DEG
from ins.verdicts import Reason, codes, sentences


@dataclass(frozen=True, kw_only=True)
class NoiseFit:
    """p_value: of the worst band of any sensor, times their number; text: in one line, with the
    command that would measure a model that does not fit.
    """

    fits: bool
    p_value: float
    text: str


SCHEMA = "recal.alignment/1"


@dataclass(frozen=True, kw_only=True)
class FilterNis:
    """How well the residuals fit the noise model."""

    nis_mean: float
    dof: int


@dataclass(frozen=True, kw_only=True)
class LevelDocument:
    """How the parked vehicle moved (RMS in the middle and at its roughest, walk over ten seconds),
    and what that cost: heading sigma over that on a calm vehicle; RMS and period of a place that
    swings, null where it does not.
    """

    place_mm: float
    largest_place_mm: float
    place_walk_mm: float
    yaw_arcsec: float
    largest_yaw_arcsec: float
    yaw_walk_arcsec: float
    unit_noise_scale: float
    sigma_cost: float
    swing_mm: float | None
    swing_s: float | None


@dataclass(frozen=True, kw_only=True)
class AlignmentDocument:
    """The alignment as the file holds it; angles not found are NaN (null in the file). Within
    replay.json it has no schema, run and phases of its own; within update.json only the keys of
    `SessionAlignment`, so that the others have a default.
    """

    schema: str | None = field(default=SCHEMA, metadata=OMIT_NONE)
    verdict: AlignmentVerdict
    reasons: Sequence[str]
    run_id: str | None = field(default=None, metadata=OMIT_NONE)
    imu_serial: str | None = field(default=None, metadata=OMIT_NONE)
    time_s: float
    roll_deg: float
    pitch_deg: float
    heading_deg: float
    sigma_roll_deg: float
    sigma_pitch_deg: float = float("nan")
    sigma_heading_deg: float
    latitude_found_deg: float
    sigma_latitude_deg: float
    phases: Sequence[Phase] | None = field(default=None, metadata=OMIT_NONE)
    duration_s: float = float("nan")
    excluded: Sequence[Span] = ()
    consistency: FilterNis = FilterNis(nis_mean=float("nan"), dof=0)
    reason_codes: Sequence[str | None] = ()
    used_percent: float = float("nan")
    motion_level: LevelDocument | None = None
    zero_rate: ZeroRates | Null | None = field(default=None, metadata=OMIT_NONE)
    noise_source: str | None = field(default=None, metadata=OMIT_NONE)
    noise_note: str | None = field(default=None, metadata=OMIT_NONE)
    noise_fit: NoiseFit | None = field(default=None, metadata=OMIT_NONE)


@written(
    "verdict time_s roll_deg pitch_deg sigma_roll_deg heading_deg sigma_heading_deg"
    " latitude_found_deg sigma_latitude_deg reasons reason_codes"
)
class SessionAlignment(AlignmentDocument):
    """What update.json says of a session's alignment."""


def alignment_document(result: Alignment, run: Run) -> AlignmentDocument:
    """The alignment of a run."""
    return AlignmentDocument(
        verdict=result.verdict,
        reasons=sentences(result.reasons),
        run_id=run.header.run_id,
        imu_serial=run.header.imu_serial,
        time_s=result.time_s,
        roll_deg=result.roll_rad / DEG,
        pitch_deg=result.pitch_rad / DEG,
        heading_deg=result.heading_rad / DEG % 360.0,
        sigma_roll_deg=result.sigma_roll_rad / DEG,
        sigma_pitch_deg=result.sigma_pitch_rad / DEG,
        sigma_heading_deg=result.sigma_heading_rad / DEG,
        latitude_found_deg=result.latitude_rad / DEG,
        sigma_latitude_deg=result.sigma_latitude_rad / DEG,
        phases=result.phases or run.phases,
        duration_s=result.duration_s,
        excluded=result.excluded,
        consistency=FilterNis(nis_mean=result.nis_mean, dof=result.dof),
        reason_codes=codes(result.reasons),
        used_percent=100.0 * result.used_share,
        motion_level=None if result.level is None else level_document(result.level),
    )


def flown_alignment(result: Alignment, run: Run, reasons: tuple[Reason, ...]) -> AlignmentDocument:
    """The alignment that a flight of replay.json began with; reasons: also why it was not flown."""
    return replace(
        alignment_document(result, run),
        schema=None,
        reasons=sentences(reasons),
        run_id=None,
        imu_serial=None,
        phases=None,
    )


def level_document(level: LevelFound) -> LevelDocument:
    """The level in millimetres and seconds of arc."""
    return LevelDocument(
        place_mm=1e3 * level.place_m,
        largest_place_mm=1e3 * level.largest_place_m,
        place_walk_mm=1e3 * level.place_walk_m,
        yaw_arcsec=level.yaw_rad / ARCSEC,
        largest_yaw_arcsec=level.largest_yaw_rad / ARCSEC,
        yaw_walk_arcsec=level.yaw_walk_rad / ARCSEC,
        unit_noise_scale=level.unit_noise,
        sigma_cost=level.sigma_cost,
        swing_mm=None if level.swing_s is None else 1e3 * level.swing_m,
        swing_s=level.swing_s,
    )
