"""`fleet forecast`: for each unit of a store, when its drift will pass a limit, and the session
that would put that off the longest. `recal.forecast/1`.
"""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from enum import StrEnum
from pathlib import Path

import numpy as np

from infield.learning.forecast import (
    HORIZON_YEARS,
    LEVEL_GYROS,
    LIMIT_NM_H,
    Outlook,
    Paths,
    UnitState,
    expected_passage,
    state_of,
    works_at,
)
from infield.learning.learn import Learnt, Parameters
from infield.learning.likelihood import FleetLikelihood
from infield.learning.parameters import OF_POINTS, WIDTHS, PriorName, defaults_of, logs_of
from infield.learning.stored_sessions import StoredSession, StoredUnit
from infield.store.errors import NoStore
from infield.store.rows import Revision
from infield.store.table_store import TableStore
from infield.table.thermal_table import DAYS_PER_YEAR
from ins.records import InputError
from ins.verdicts import Reason, because, sentence
from recal.service.inputs.unit_inputs import open_store
from recal.service.priors.document import TechnologyPriors
from recal.service.priors.forecast_page import NOT_LEARNT, forecast_html, outlook_words
from recal.service.priors.reasons import ForecastReason
from recal.service.priors.records import (
    BestSession,
    DriftTrend,
    ForecastReport,
    NoForecast,
    UnitForecast,
)
from recal.service.priors.stored_sessions import EPOCH, stored_units
from recal.service.priors.use import APPROVED, DEFAULT, chosen_priors
from recal.service.results.files import program_version
from recal.service.results.result import Result

# Mean temperature of a session below or above which it counts as a cold or a hot start: packaged
# starts at -5, 20 and 45 degC lie on either side (trajectories/simulator/thermal.py).
COLD_degC, HOT_degC = 10.0, 30.0
TREND_YEARS = np.arange(0.0, HORIZON_YEARS + 0.1, 0.25)  # a point of the trend each quarter
DATE, ISSUED = "%Y-%m-%d", "%Y-%m-%dT%H:%M:%SZ"
OTHER_STEPS = 2  # of a forecast: the sessions are read, the report is written
MOST_URGENT = 25  # units of a technology on a page that is about more than them


class ForecastVerdict(StrEnum):
    """What came of a forecast."""

    OK = "ok"
    REFUSED = "refused"


@dataclass(frozen=True, kw_only=True)
class ForecastRequest:
    """What to forecast.

    Parameters
    ----------
    store_url : str
        The store of tables.
    limit_nm_h : float
        The limit of the drift in NM/h.
    technology : {'rlg', 'fog', 'mems'}, optional
        Only units of rlg, fog or mems. Default: all.
    priors : str
        As of `recal update`.
    sessions : bool
        Also which session would help.
    most : int, optional
        How many units of each technology, those whose mean drift passes first.
    now : datetime, optional
        From when on; else the time of this machine.
    output : path, optional
        The folder to write to.
    """

    store_url: str
    limit_nm_h: float = LIMIT_NM_H
    technology: str | None = None
    priors: str = APPROVED
    sessions: bool = True
    most: int | None = None
    now: datetime | None = None
    output: Path | None = None


@dataclass(frozen=True, repr=False, eq=False)
class Forecast(Result[ForecastReport]):
    """Units by urgency."""

    FOLDER = "recal-fleet-forecast"

    def lines(self, *, verbose: bool = False) -> list[str]:
        """The most urgent units first."""
        return summary(self.record, most=None if verbose else UNITS_TOLD)


UNITS_TOLD = 10  # units on the terminal


def forecast(
    request: ForecastRequest, told: Callable[[str], None] = lambda words: None
) -> Forecast:
    """Forecast every unit; writes forecast.json and forecast.html unless told not to.

    told: what is being done, each unit with its number of how many.

    Raises
    ------
    InputError
        Where there is no store, or it cannot be read.
    """
    store = open_store(request.store_url)
    if store is None:
        raise NoStore(f"no store at {request.store_url}")
    told("reading the sessions of the store")
    document = forecast_of(store, request, told)
    told("writing the report")
    result = Forecast(document, page=lambda: forecast_html(document))
    result.write(request.output)
    return result


def forecast_steps(request: ForecastRequest) -> int:
    """How often `forecast` tells what is being done, at most: a unit of which the store keeps no
    session is not forecast.
    """
    store = open_store(request.store_url)
    if store is None:
        return OTHER_STEPS
    technologies = [u.unit.gyro_technology for u in store.units()]
    wanted = [t for t in technologies if t != "mems" and request.technology in (None, t)]
    counts = Counter(wanted).values()
    return OTHER_STEPS + sum(min(n, request.most or n) for n in counts)


def forecast_of(
    store: TableStore, request: ForecastRequest, told: Callable[[str], None] = lambda words: None
) -> ForecastReport:
    """Every unit of an open store; writes nothing. told: as of `forecast`."""
    now = request.now or datetime.now(UTC)
    every, left_out = stored_units(store)
    newest = {(u.gyro_technology, u.imu_serial, u.gyro_mode): u for u in every}
    chosen = [u for u in newest.values() if request.technology in (None, u.gyro_technology)]
    found: list[UnitForecast] = []
    without: list[NoForecast] = []
    left = 0
    for technology in dict.fromkeys(unit.gyro_technology for unit in chosen):
        units = [unit for unit in chosen if unit.gyro_technology == technology]
        if technology == "mems":
            why = sentence(because(ForecastReason.FINDS_NO_HEADING))
            without += [NoForecast(imu_serial=u.imu_serial, why=why) for u in units]
            continue
        forecasts = _Technology(store, units, request, now).forecasts(told)
        left += len(units) - len(forecasts)
        found += forecasts
    found.sort(key=lambda f: (f.date_95_utc or "9999", -f.drift_now_nm_h))
    return ForecastReport(
        verdict=ForecastVerdict.OK if found else ForecastVerdict.REFUSED,
        reasons=[] if found else [sentence(_why_none(store, request, without))],
        store=store.name,
        issued_utc=now.strftime(ISSUED),
        version=program_version(),
        limit_nm_h=request.limit_nm_h,
        units=found,
        without=without,
        less_urgent=left or None,
        left_out=left_out,
    )


def most_urgent(store: TableStore) -> ForecastReport:
    """The units of each technology that pass the limit first, for a page that is about more than
    them; refused where the store's sessions cannot be read.
    """
    request = ForecastRequest(store_url=store.name, most=MOST_URGENT)
    try:
        return forecast_of(store, request)
    except InputError as error:
        return ForecastReport(
            verdict=ForecastVerdict.REFUSED,
            reasons=[str(error)],
            store=store.name,
            issued_utc=datetime.now(UTC).strftime(ISSUED),
            version=program_version(),
            limit_nm_h=request.limit_nm_h,
            units=[],
        )


def _why_none(store: TableStore, request: ForecastRequest, without: Sequence[NoForecast]) -> Reason:
    """Why no unit could be forecast."""
    of = f" of {request.technology}" if request.technology else ""
    if without:
        return because(ForecastReason.NONE_NAVIGATES, store=store.name, of=of)
    return because(ForecastReason.NO_UNIT, store=store.name, of=of)


class _Technology:
    """The units of one technology, with the parameters that they go by."""

    def __init__(
        self,
        store: TableStore,
        units: Sequence[StoredUnit],
        request: ForecastRequest,
        now: datetime,
    ) -> None:
        self._units, self._request = units, request
        self._now, self._year = now, (now - EPOCH).total_seconds() / 86400.0 / DAYS_PER_YEAR
        technology = units[0].gyro_technology
        self._rests_on, self._priors = _priors(request.priors, store, technology)
        values = [self._values(unit) for unit in units]
        self._value = values
        theta = np.array([logs_of({n: v[n].value for n in OF_POINTS}) for v in values])
        self._evidence = FleetLikelihood(units)(theta)
        self._candidates = _candidates(units) if request.sessions else {}
        self._active = {record.unit.key: record.active for record in store.units()}

    def forecasts(self, told: Callable[[str], None]) -> list[UnitForecast]:
        """Of the most urgent units."""
        states = [self._state(u) for u in range(len(self._units))]
        limit, year = self._request.limit_nm_h, self._year
        order = sorted(
            range(len(states)),
            key=lambda u: expected_passage(states[u], self._value[u], limit, year=year),
        )
        found: list[UnitForecast] = []
        chosen = order[: self._request.most]
        for u in chosen:
            serial = self._units[u].imu_serial
            told(
                f"{serial}, unit {len(found) + 1} of {len(chosen)} {self._units[u].gyro_technology}"
            )
            found.append(self._one(states[u], u))
        return found

    def _state(self, u: int) -> UnitState:
        unit = self._units[u]
        table = self._revision(unit).table
        return state_of(unit, self._evidence.mean[u], self._evidence.covariance[u], table)

    def _revision(self, unit: StoredUnit) -> Revision:
        return self._active[unit.imu_serial, unit.gyro_technology, unit.gyro_mode]

    def _values(self, unit: StoredUnit) -> dict[PriorName, Learnt]:
        """Of the unit where it was learnt from, else of its technology, else the defaults."""
        scopes = [] if self._priors is None else [self._priors.technology]
        if self._priors is not None:
            scopes += [s for s in self._priors.units if s.name == unit.name]
        said: dict[str, Learnt] = {}
        for scope in scopes:
            said |= scope.parameters
        defaults = defaults_of(unit.gyro_technology)
        return {
            name: said.get(name, Learnt.normal(defaults[name], WIDTHS[name], shown=False, n=0))
            for name in OF_POINTS
        }

    def _one(self, state: UnitState, u: int) -> UnitForecast:
        unit, value = self._units[u], self._value[u]
        active = self._revision(unit)
        T = works_at(unit)
        paths = Paths(value, T, seed=u)
        seen = self._ahead(paths, state)
        mean = state.level_error(T)[0]
        expected = float(np.sqrt(np.sum(mean**2) / len(T[0])))
        return UnitForecast(
            imu_serial=unit.imu_serial,
            gyro_technology=unit.gyro_technology,
            gyro_mode=unit.gyro_mode,
            revision=active.number,
            sessions=len(unit.sessions),
            last_session_utc=self._date(state.year - self._year),
            drift_now_nm_h=float(seen.median[0]),
            drift_now_95_nm_h=float(seen.high[0]),
            expected_bias_deg_h=expected,
            date_50_utc=self._date(seen.year_50),
            date_95_utc=self._date(seen.year_95),
            temperature_degC=(float(min(t.min() for t in T)), float(max(t.max() for t in T))),
            rests_on=self._rests_on,
            trend=DriftTrend(
                date_utc=[str(self._date(y)) for y in TREND_YEARS],
                median_nm_h=np.interp(TREND_YEARS, seen.years, seen.median).tolist(),
                high_nm_h=np.interp(TREND_YEARS, seen.years, seen.high).tolist(),
            ),
            best_session=self._best(paths, state, value, seen),
        )

    def _ahead(self, paths: Paths, state: UnitState) -> Outlook:
        return paths.ahead(state, year=self._year, limit_nm_h=self._request.limit_nm_h)

    def _best(
        self, paths: Paths, state: UnitState, value: Parameters, seen: Outlook
    ) -> BestSession | None:
        """The kind of session that puts the 95 % date off the longest; None where none does."""
        tried = [
            (self._ahead(paths, state.with_session(s, value, self._year)), words, s)
            for words, s in self._candidates.items()
        ]
        better = [t for t in tried if t[0].year_95 > seen.year_95]
        if not better:
            return None
        after, words, session = max(better, key=lambda t: (t[0].year_95, t[0].year_50))
        level = np.isin(session.axis_index, LEVEL_GYROS)
        T = session.temperature_degC[level]
        gained = min(after.year_95, seen.years[-1]) - seen.year_95
        return BestSession(
            text=f"{words}, {T.min():.0f} to {T.max():.0f} degC",
            temperature_degC=(float(T.min()), float(T.max())),
            taxi=bool(session.heading_source),
            date_50_utc=self._date(after.year_50),
            date_95_utc=self._date(after.year_95),
            gained_days=float(DAYS_PER_YEAR * gained),
        )

    def _date(self, years: float) -> str | None:
        if not np.isfinite(years):
            return None
        return (self._now + timedelta(days=DAYS_PER_YEAR * years)).strftime(DATE)


def _priors(choice: str, store: TableStore, technology: str) -> tuple[str, TechnologyPriors | None]:
    """What the forecast of a technology rests on."""
    name, found, _ = chosen_priors(choice, store, technology)
    untold = "" if choice == DEFAULT else f" ({NOT_LEARNT})"
    return name or f"defaults of {technology}, each known to a factor of 3{untold}", found


def _candidates(units: Sequence[StoredUnit]) -> dict[str, StoredSession]:
    """Kinds of sessions that this fleet has recorded, the newest of each: by temperature, and by
    whether the taxi showed the heading.
    """
    kinds: dict[str, StoredSession] = {}
    sessions = sorted((s for unit in units for s in unit.sessions), key=lambda s: s.year)
    for session in sessions:
        if session.axis_index.size <= 3:
            continue  # a contradiction, remembered by its mean alone
        mean = float(session.temperature_degC.mean())
        start = "a cold" if mean < COLD_degC else "a hot" if mean > HOT_degC else "an ambient"
        taxi = "with a taxi" if session.heading_source else "parked alone"
        kinds[f"{start} start {taxi}"] = session
    return kinds


def summary(document: ForecastReport, *, most: int | None = UNITS_TOLD) -> list[str]:
    """The result in a few lines for people."""
    limit = f"{document.limit_nm_h:g} NM/h"
    count = len(document.units)
    lines = [f"forecast: {count} unit{'' if count == 1 else 's'}, limit {limit}"]
    lines += [f"  because {why}" for why in document.reasons]
    for unit in document.units[:most]:
        line = f"  {unit.imu_serial}: {unit.drift_now_nm_h:.2f} NM/h now; "
        line += outlook_words(unit, document)
        best = unit.best_session
        lines.append(
            line + (f"; {best.text} puts it off by {best.gained_days:.0f} days" if best else "")
        )
    left = len(document.units) - len(document.units[:most])
    lines += [f"  and {left} more in forecast.json"] if left else []
    for rests_on in dict.fromkeys(unit.rests_on for unit in document.units):
        lines.append(f"  ageing and turn-on from {rests_on}")
    lines += [f"  {item.imu_serial}: {item.why}" for item in document.without[:most]]
    whys = Counter(item.why for item in document.left_out)
    return [*lines, *(f"  {count} sessions left out: {why}" for why, count in whys.items())]
