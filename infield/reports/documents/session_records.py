"""What `update.json` holds of one run, as records; `documents.session` fills them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from infield.reports.documents.alignment import FilterNis, LevelDocument, SessionAlignment
from infield.session.estimate import BegunInMotion, OwnError, ParkedEvidence, RollingEvidence
from infield.session.flown.gates import FlightEvidence, InformationGain
from infield.session.identity.marks import UnitMarks
from infield.session.navigated.claim_chain import ChainPoint
from infield.session.navigated.environment import StandingMotion
from infield.session.points import AxisObservability
from infield.session.reasons import HeadingSource
from infield.thermometer.gyro_temperature import GyroTemperature, fault_reason
from ins.documents import OMIT_NONE, MadeOf, made
from ins.records import LatitudeSource, Phase, Run, Site, Span
from ins.units import DEG
from ins.verdicts import Outcome, codes, sentence, sentences

of_flight = MadeOf[FlightEvidence]()
of_marks = MadeOf[UnitMarks]()
of_rest = MadeOf[ParkedEvidence]()
of_rolling = MadeOf[RollingEvidence]()
of_site = MadeOf[Site]()
of_T = MadeOf[GyroTemperature]()
of_run = MadeOf[Run]()
MOST_TEMPERATURES = 400  # points of a drawing


@dataclass(frozen=True, kw_only=True)
class SiteDocument:
    """Where the run stood, how well its latitude is known, and who says it."""

    lat_deg: float = of_site(lambda site: site.lat_rad / DEG)
    lon_deg: float = of_site(lambda site: site.lon_rad / DEG)
    height_m: float = of_site(lambda site: site.height_m)
    sigma_lat_deg: float | None = of_site(lambda site: site.sigma_lat_rad / DEG, default=None)
    lat_source: LatitudeSource | str | None = of_site(lambda site: site.lat_source, default=None)


@dataclass(frozen=True, kw_only=True)
class TemperatureDocument:
    """Gyro temperatures, thinned for the drawing, and what is wrong with the thermometers."""

    min_degC: Sequence[float] = of_T(lambda T: T.temperature_degC.min(axis=0).tolist())
    max_degC: Sequence[float] = of_T(lambda T: T.temperature_degC.max(axis=0).tolist())
    unusable: Sequence[str] = of_T(lambda T: T.unusable)
    faults: Sequence[str] = of_T(lambda T: [sentence(fault_reason(fault)) for fault in T.faults])
    time_s: Sequence[float] = of_T(lambda T: T.time_s[:: _every(T)].tolist())
    gyro_degC: Sequence[Sequence[float]] = of_T(lambda T: T.temperature_degC[:: _every(T)].tolist())


def _every(T: GyroTemperature) -> int:
    """One row in so many is drawn."""
    return max(len(T.time_s) // MOST_TEMPERATURES, 1)


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
    is_test: bool = of_rolling(lambda rolling: rolling.is_test)
    nis_mean_as_declared: float = of_rolling(lambda rolling: rolling.declared_nis)
    dof_as_declared: int = of_rolling(lambda rolling: rolling.declared_dof)


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

    joined: bool = of_flight(lambda e: e.joined is not None)
    reasons: Sequence[str] = of_flight(lambda e: sentences(e.reasons))
    reason_codes: Sequence[str | None] = of_flight(lambda e: codes(e.reasons))
    start_s: float = of_flight(lambda e: e.flight.start_s)
    end_s: float = of_flight(lambda e: e.flight.end_s)
    rests_after_s: Sequence[Sequence[float]] = of_flight(lambda e: e.flight.stands)
    covered_percent: float = of_flight(lambda e: 100.0 * e.flight.covered)
    repeated_fixes: int = of_flight(lambda e: e.repeated)
    sigma_heading_ground_mrad: float | None
    sigma_heading_mrad: float | None
    against_rest: Sequence[FlightAgainstRest]
    notes: Sequence[str] = of_flight(lambda e: sentences(e.notes), default=())
    note_codes: Sequence[str | None] = of_flight(lambda e: codes(e.notes), default=())
    nuisances: Sequence[CarriedNuisance]
    worth: Sequence[InformationGain] | None = of_flight(lambda e: e.worth, OMIT_NONE, default=None)


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

    seconds: float = of_rest(lambda p: float(p.used_s.sum()))
    start_s: float = of_rest(lambda p: float(p.stretches[0].seconds.start_s[0]))
    end_s: float = of_rest(lambda p: float(p.stretches[-1].seconds.end_s[-1]))
    ended_because: str = of_rest(lambda p: p.stretches[-1].seconds.moved)
    angle_random_walk_deg_sqrt_h: Sequence[float] = of_rest(lambda p: p.walk_deg_sqrt_h.tolist())
    noise_over_model: float = of_rest(lambda p: p.noise_scale)
    earth_rate_sigma_deg_h: Sequence[float] = of_rest(
        lambda p: np.sqrt(p.of_mean(p.earth.covariance)).tolist()
    )
    roll_deg: float
    pitch_deg: float
    heading_known: bool = of_rest(lambda p: bool((p.earth.heading_deg_h == 0.0).all()))
    bin_s: float
    bins: int
    stretches: Sequence[StretchDocument] | None = field(default=None, metadata=OMIT_NONE)
    left_out: Sequence[Span] | None = of_rest(
        lambda p: [span.in_words() for span in p.left_out] or None, OMIT_NONE, default=None
    )


@dataclass(frozen=True, kw_only=True)
class UnitMarksDocument:
    """What identifies the unit of a session: names with their unit at the end, values, the
    covariance of what does not repeat, and the pattern that thermometers heat up by; against how
    many earlier sessions they were held, and the chi2 of that (None where the store has none).
    """

    names: Sequence[str] = of_marks(lambda marks: marks.names)
    value: Sequence[float] = of_marks(lambda marks: marks.value.tolist())
    covariance: Sequence[Sequence[float]] = of_marks(lambda marks: marks.covariance.tolist())
    heat: Sequence[float] = of_marks(lambda marks: marks.heat.tolist())
    sessions: int = 0
    chi2: float | None = None
    dof: int | None = None
    limit: float | None = None


@dataclass(frozen=True, kw_only=True)
class SessionDocument:
    """Everything a report shows of one run that was refused before it was estimated."""

    run_id: str = of_run(lambda run: run.header.run_id)
    sha256: str = of_run(lambda run: run.sha256)
    tail: str = of_run(lambda run: run.header.tail)
    start_utc: str = of_run(lambda run: run.header.start_utc)
    site: SiteDocument = of_run(lambda run: made(SiteDocument, run.header.site))
    outcome: Outcome | str
    reasons: Sequence[str]
    reason_codes: Sequence[str | None] = ()
    duration_s: float = of_run(lambda run: run.imu.end_s - run.imu.start_s)
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
