"""The priors that a store keeps: listed, approved, rejected."""

from collections.abc import Sequence
from dataclasses import dataclass, field

from infield.store.errors import NoStore
from infield.store.priors_rows import PriorsRecord
from infield.store.table_store import TableStore
from ins.documents import OMIT_NONE
from recal.service.inputs.unit_inputs import open_store
from recal.service.priors.stored_sessions import SessionLeftOut
from recal.service.results.result import Result

FORECAST_SCHEMA = "recal.forecast/1"


@dataclass(frozen=True, kw_only=True)
class PriorsList:
    """What `recal fleet priors --json` prints."""

    schema: str = "recal.priors_list/1"
    store: str
    priors: Sequence[PriorsRecord]


@dataclass(frozen=True, repr=False, eq=False)
class ListedPriors(Result[PriorsList]):
    """The priors of a store."""

    def lines(self, *, verbose: bool = False) -> list[str]:
        """One line each, and one for each decision."""
        lines = []
        for row in self.record.priors:
            by = f" by {row.learnt_by}" if row.learnt_by else ""
            lines.append(
                f"{row.gyro_technology} priors {row.number}  {row.state:9s} learnt"
                f" {row.learnt_utc}{by}  {row.sha256[:12]}{'  ' if row.note else ''}{row.note}"
            )
            lines += [f"  {decision.words()}" for decision in row.decisions]
        return lines or ["the store holds no priors: recal fleet learn"]


def listed_priors(store_url: str) -> ListedPriors:
    """All priors of a store; InputError where there is none."""
    store = open_store(store_url)
    if store is None:
        raise NoStore(f"no store at {store_url}")
    return ListedPriors(PriorsList(store=store.name, priors=store.priors()))


def decide(
    store_url: str, technology: str, number: int, verdict: str, *, by: str, reason: str
) -> ListedPriors:
    """Approve or reject priors; the list of this one record.

    Parameters
    ----------
    store_url : str
        The store of tables.
    technology : str
        The technology: rlg, fog or mems.
    number : int
        The number of the priors.
    verdict : str
        approved or rejected.
    by : str
        The name of who decides.
    reason : str
        Why, kept with the decision.
    """
    if open_store(store_url) is None:
        raise NoStore(f"no store at {store_url}")
    with TableStore.open(store_url, create=True) as store:
        record = store.decide_priors(technology, number, verdict, by=by, reason=reason)
        return ListedPriors(PriorsList(store=store.name, priors=[record]))


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
