"""`alignment.json` of formats.md, section 5."""

from collections.abc import Sequence
from dataclasses import dataclass, field

from alignment.level_fit import LevelFound
from alignment.reasons import AlignmentVerdict
from alignment.result import Alignment
from infield.session.parked.zero_rate import ZeroRates
from ins.documents import OMIT_NONE, MadeOf, Null, made, written
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
NAN = float("nan")
of = MadeOf[Alignment]()
of_level = MadeOf[LevelFound]()


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

    place_mm: float = of_level(lambda level: 1e3 * level.place_m)
    largest_place_mm: float = of_level(lambda level: 1e3 * level.largest_place_m)
    place_walk_mm: float = of_level(lambda level: 1e3 * level.place_walk_m)
    yaw_arcsec: float = of_level(lambda level: level.yaw_rad / ARCSEC)
    largest_yaw_arcsec: float = of_level(lambda level: level.largest_yaw_rad / ARCSEC)
    yaw_walk_arcsec: float = of_level(lambda level: level.yaw_walk_rad / ARCSEC)
    unit_noise_scale: float = of_level(lambda level: level.unit_noise)
    sigma_cost: float = of_level(lambda level: level.sigma_cost)
    swing_mm: float | None = of_level(lambda lv: None if lv.swing_s is None else 1e3 * lv.swing_m)
    swing_s: float | None = of_level(lambda level: level.swing_s)


@dataclass(frozen=True, kw_only=True)
class AlignmentDocument:
    """The alignment as the file holds it; angles not found are NaN (null in the file). Within
    replay.json it has no schema, run and phases of its own; within update.json only the keys of
    `SessionAlignment`, so that the others have a default.
    """

    schema: str | None = field(default=SCHEMA, metadata=OMIT_NONE)
    verdict: AlignmentVerdict = of(lambda found: found.verdict)
    reasons: Sequence[str] = of(lambda found: sentences(found.reasons))
    run_id: str | None = field(default=None, metadata=OMIT_NONE)
    imu_serial: str | None = field(default=None, metadata=OMIT_NONE)
    time_s: float = of(lambda found: found.time_s)
    roll_deg: float = of(lambda found: found.roll_rad / DEG)
    pitch_deg: float = of(lambda found: found.pitch_rad / DEG)
    heading_deg: float = of(lambda found: found.heading_rad / DEG % 360.0)
    sigma_roll_deg: float = of(lambda found: found.sigma_roll_rad / DEG)
    sigma_pitch_deg: float = of(lambda found: found.sigma_pitch_rad / DEG, default=NAN)
    sigma_heading_deg: float = of(lambda found: found.sigma_heading_rad / DEG)
    latitude_found_deg: float = of(lambda found: found.latitude_rad / DEG)
    sigma_latitude_deg: float = of(lambda found: found.sigma_latitude_rad / DEG)
    phases: Sequence[Phase] | None = field(default=None, metadata=OMIT_NONE)
    duration_s: float = of(lambda found: found.duration_s, default=NAN)
    excluded: Sequence[Span] = of(lambda found: found.excluded, default=())
    consistency: FilterNis = of(
        lambda found: FilterNis(nis_mean=found.nis_mean, dof=found.dof),
        default=FilterNis(nis_mean=NAN, dof=0),
    )
    reason_codes: Sequence[str | None] = of(lambda found: codes(found.reasons), default=())
    used_percent: float = of(lambda found: 100.0 * found.used_share, default=NAN)
    motion_level: LevelDocument | None = of(lambda found: _level(found.level), default=None)
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
    header, phases = run.header, result.phases or run.phases
    ids = {"run_id": header.run_id, "imu_serial": header.imu_serial}
    return made(AlignmentDocument, result, phases=phases, **ids)


def flown_alignment(result: Alignment, reasons: tuple[Reason, ...]) -> AlignmentDocument:
    """The alignment that a flight of replay.json began with; reasons: also why it was not flown."""
    return made(AlignmentDocument, result, schema=None, reasons=sentences(reasons))


def _level(level: LevelFound | None) -> LevelDocument | None:
    return None if level is None else made(LevelDocument, level)
