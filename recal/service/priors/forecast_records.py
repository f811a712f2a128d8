"""`recal.forecast/1` (formats.md, section 6), as records."""

from collections.abc import Sequence
from dataclasses import dataclass, field

from ins.documents import OMIT_NONE
from recal.service.priors.stored_sessions import SessionLeftOut

FORECAST_SCHEMA = "recal.forecast/1"


@dataclass(frozen=True, kw_only=True)
class DriftTrend:
    """The drift from now on, a point a quarter: median of the paths, and what 5 % of them pass."""

    date_utc: Sequence[str]
    median_nm_h: Sequence[float]
    high_nm_h: Sequence[float]


@dataclass(frozen=True, kw_only=True)
class BestSession:
    """The session that would put the 95 % date off the longest, of the kinds that the fleet has
    recorded; dates after it.
    """

    text: str
    temperature_degC: tuple[float, float]
    taxi: bool
    date_50_utc: str | None
    date_95_utc: str | None
    gained_days: float


@dataclass(frozen=True, kw_only=True)
class UnitForecast:
    """One unit. drift_now_nm_h: median, 5 % exceed drift_now_95_nm_h; expected_bias_deg_h: RMS of
    what the sessions say the table in use is off by; date_50_utc: by then half the paths have
    passed the limit, date_95_utc: until then 95 % stay below it; None: beyond the horizon.
    """

    imu_serial: str
    gyro_technology: str
    gyro_mode: str
    revision: int
    sessions: int
    last_session_utc: str | None
    drift_now_nm_h: float
    drift_now_95_nm_h: float
    expected_bias_deg_h: float
    date_50_utc: str | None
    date_95_utc: str | None
    temperature_degC: tuple[float, float]
    rests_on: str
    trend: DriftTrend
    best_session: BestSession | None = field(default=None, metadata=OMIT_NONE)


@dataclass(frozen=True, kw_only=True)
class NoForecast:
    """A unit without one, and why."""

    imu_serial: str
    why: str


@dataclass(frozen=True, kw_only=True)
class ForecastReport:
    """The whole file; units by urgency; less_urgent: how many more there are, which were not
    forecast; left_out: sessions that could not be taken into account.
    """

    schema: str = FORECAST_SCHEMA
    verdict: str
    reasons: Sequence[str]
    store: str
    issued_utc: str
    version: str
    limit_nm_h: float
    units: Sequence[UnitForecast]
    without: Sequence[NoForecast] = ()
    less_urgent: int | None = field(default=None, metadata=OMIT_NONE)
    left_out: Sequence[SessionLeftOut] = ()
