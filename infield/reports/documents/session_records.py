"""What `update.json` holds of one run, as records; `documents.session` fills them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from infield.reports.documents.alignment import FilterNis, LevelDocument, SessionAlignment
from infield.session.estimate import BegunInMotion, OwnError
from infield.session.flown.gates import InformationGain
from infield.session.navigated.claim_chain import ChainPoint
from infield.session.navigated.environment import StandingMotion
from infield.session.points import AxisObservability
from infield.session.reasons import HeadingSource
from ins.documents import OMIT_NONE
from ins.records import LatitudeSource, Phase, Span
from ins.verdicts import Outcome


@dataclass(frozen=True, kw_only=True)
class SiteDocument:
    """Where the run stood, how well its latitude is known, and who says it."""

    lat_deg: float
    lon_deg: float
    height_m: float
    sigma_lat_deg: float | None = None
    lat_source: LatitudeSource | str | None = None


@dataclass(frozen=True, kw_only=True)
class TemperatureDocument:
    """Gyro temperatures, thinned for the drawing, and what is wrong with the thermometers."""

    min_degC: Sequence[float]
    max_degC: Sequence[float]
    unusable: Sequence[str]
    faults: Sequence[str]
    time_s: Sequence[float]
    gyro_degC: Sequence[Sequence[float]]


@dataclass(frozen=True, kw_only=True)
class HeadingError:
    """Computed minus true at the end of the alignment; None where not observable."""

    value_mrad: float | None
    sigma_mrad: float | None
    source: HeadingSource | str | None


@dataclass(frozen=True, kw_only=True)
class CoverageDocument:
    """Seconds in a band of temperature."""

    axis: str
    low_degC: float
    high_degC: float
    seconds: float


@dataclass(frozen=True, kw_only=True)
class ResidualDocument:
    """A point less the table before and after the merge."""

    axis: str
    time_s: float
    temperature_degC: float
    before_deg_h: float
    after_deg_h: float
    sigma_deg_h: float


@dataclass(frozen=True, kw_only=True)
class HeatingCooling:
    """Mean residual over rising less that over falling temperature; None where one is missing."""

    axis: str
    heating_points: int
    cooling_points: int
    difference_deg_h: float | None
    sigma_deg_h: float | None


@dataclass(frozen=True, kw_only=True)
class CarriedNuisance:
    """What a filter carried beside the gyros' biases, in `unit`; prior_sigma: taken for possible
    before. value, sigma: None of what comes and goes (slow errors, the vertical along the track)
    and where nothing was estimated; sigma alone, and the value an RMS, of a crab that changes on
    its own.
    """

    nuisance: str
    text: str
    value: Sequence[float] | None
    sigma: Sequence[float] | None
    prior_sigma: Sequence[float]
    unit: str


@dataclass(frozen=True, kw_only=True)
class TaxiNuisance(CarriedNuisance):
    """What a taxi showed of wind, tyres or installation; gain_nats: by how much the log likelihood
    grew as it was taken, None of what every taxi has.
    """

    value: Sequence[float]
    gain_nats: float | None


@dataclass(frozen=True, kw_only=True)
class TaxiDocument:
    """What the taxi needed beyond what is declared, and what every taxi estimates.

    is_test: False where the noise of the lateral way was fitted, so that its NIS tests nothing.
    nis_mean_as_declared, dof_as_declared: of all measurements with nothing but the declared.
    """

    needed: Sequence[TaxiNuisance]
    always: Sequence[TaxiNuisance]
    is_test: bool
    nis_mean_as_declared: float
    dof_as_declared: int


@dataclass(frozen=True, kw_only=True)
class FlightAgainstRest:
    """What a gyro read in flight beyond what it read at rest, by itself; None: not shown."""

    axis: str
    size_deg_h: float | None
    sigma_deg_h: float | None


@dataclass(frozen=True, kw_only=True)
class FlightDocument:
    """A session's flight: joined to it, or left out for these reasons.

    rests_after_s: rests after landing, from and to; covered_percent: of its seconds, by fixes;
    repeated_fixes: left out as repetitions of the one before.
    """

    joined: bool
    reasons: Sequence[str]
    reason_codes: Sequence[str | None]
    start_s: float
    end_s: float
    rests_after_s: Sequence[Sequence[float]]
    covered_percent: float
    repeated_fixes: int
    sigma_heading_ground_mrad: float | None
    sigma_heading_mrad: float | None
    against_rest: Sequence[FlightAgainstRest]
    notes: Sequence[str] = ()
    note_codes: Sequence[str | None] = ()
    nuisances: Sequence[CarriedNuisance]
    worth: Sequence[InformationGain] | None = field(default=None, metadata=OMIT_NONE)


@dataclass(frozen=True, kw_only=True)
class SmoothingDocument:
    """RMS sigma of a gyro over the bins, by the filter alone and given the whole run."""

    filtered_sigma_deg_h: float
    smoothed_sigma_deg_h: float


@dataclass(frozen=True, kw_only=True)
class VelocityDocument:
    """Computed velocity, thinned for the drawing."""

    time_s: Sequence[float]
    north_m_s: Sequence[float]
    east_m_s: Sequence[float]
    heading_deg: Sequence[float]


@dataclass(frozen=True)
class ChainRow(ChainPoint):
    """A window of the claim chain beside what the filter says of it."""

    filter_north_deg_h: float
    filter_east_deg_h: float


@dataclass(frozen=True, kw_only=True)
class ChainDocument:
    """The patent's own path beside the filter."""

    points: Sequence[ChainRow]
    heading_error_mrad: float | None
    sigma_heading_error_mrad: float | None
    note: str
    sigma_deg_h: float | None
    sigma_filtered_deg_h: float | None
    bracket_sigma_deg_h: float | None
    difference_rms_deg_h: float | None
    difference_rms_east_deg_h: float | None


@dataclass(frozen=True, kw_only=True)
class StretchDocument:
    """A stretch of rest of a unit without a heading, and the turn since the one before."""

    start_s: float
    duration_s: float
    still_s: float
    bins: int
    temperature_degC: tuple[float, float]
    turned_deg: float | None
    sigma_turned_deg: float | None
    turn_told: bool | None


@dataclass(frozen=True, kw_only=True)
class ZeroRateDocument:
    """What the parked seconds of a unit without a heading gave."""

    seconds: float
    start_s: float
    end_s: float
    ended_because: str
    angle_random_walk_deg_sqrt_h: Sequence[float]
    noise_over_model: float
    earth_rate_sigma_deg_h: Sequence[float]
    roll_deg: float
    pitch_deg: float
    heading_known: bool
    bin_s: float
    bins: int
    stretches: Sequence[StretchDocument] | None = field(default=None, metadata=OMIT_NONE)
    left_out: Sequence[Span] | None = field(default=None, metadata=OMIT_NONE)


@dataclass(frozen=True, kw_only=True)
class UnitMarksDocument:
    """What identifies the unit of a session: names with their unit at the end, values, the
    covariance of what does not repeat, and the pattern that thermometers heat up by; against how
    many earlier sessions they were held, and the chi2 of that (None where the store has none).
    """

    names: Sequence[str]
    value: Sequence[float]
    covariance: Sequence[Sequence[float]]
    heat: Sequence[float]
    sessions: int = 0
    chi2: float | None = None
    dof: int | None = None
    limit: float | None = None


@dataclass(frozen=True, kw_only=True)
class SessionDocument:
    """Everything a report shows of one run that was refused before it was estimated."""

    run_id: str
    sha256: str
    tail: str
    start_utc: str
    site: SiteDocument
    outcome: Outcome | str
    reasons: Sequence[str]
    reason_codes: Sequence[str | None] = ()
    duration_s: float
    streams: Sequence[str]
    temperature: TemperatureDocument | None = field(default=None, metadata=OMIT_NONE)


@dataclass(frozen=True, kw_only=True)
class EstimatedDocument(SessionDocument):
    """The same of a run that was estimated; what only a navigated session has is None.

    doubted: wrong facts that the session resembles, so that its table was taught nothing along
    them; left out where there are none. taxi: left out where nothing rolled. own_errors: left out
    where no installed package declares one with a prior of a session. phases_used: those
    that made points. environment: of a navigated session, what its parked vehicle went through.
    flight: left out where the run does not fly with a receiver. begun_in_motion: of a session
    without a first rest; the heading error is that of its start then. unit_marks: left out where
    the session shows none.
    """

    alignment: SessionAlignment
    heading_error: HeadingError
    observability: Mapping[str, AxisObservability]
    phases: Sequence[Phase] = ()
    phases_used: Sequence[str] = ()
    points_covariance_deg_h2: Sequence[Sequence[float]] | None = None
    coverage: Sequence[CoverageDocument] = ()
    residuals: Sequence[ResidualDocument] = ()
    heating_cooling: Sequence[HeatingCooling] = ()
    measurements: Mapping[str, FilterNis] = field(default_factory=dict)
    parked_jitter_m: float | None = None
    smoothing: Mapping[str, SmoothingDocument] = field(default_factory=dict)
    velocity: VelocityDocument | None = None
    claim_chain: ChainDocument | None = None
    zero_rate: ZeroRateDocument | None = field(default=None, metadata=OMIT_NONE)
    doubted: Sequence[str] | None = field(default=None, metadata=OMIT_NONE)
    motion_level: LevelDocument | None = field(default=None, metadata=OMIT_NONE)
    environment: StandingMotion | None = field(default=None, metadata=OMIT_NONE)
    taxi: TaxiDocument | None = field(default=None, metadata=OMIT_NONE)
    own_errors: Sequence[OwnError] | None = field(default=None, metadata=OMIT_NONE)
    flight: FlightDocument | None = field(default=None, metadata=OMIT_NONE)
    begun_in_motion: BegunInMotion | None = field(default=None, metadata=OMIT_NONE)
    unit_marks: UnitMarksDocument | None = field(default=None, metadata=OMIT_NONE)
