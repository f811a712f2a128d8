"""Which unit next? The health of each unit of a store, from what the store knows of it. Reads
nothing, decides nothing.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from enum import IntEnum, StrEnum

from recal.service.priors.records import ForecastReport, UnitForecast
from recal.service.store import UnitSummary

OLD_DAYS = 365.0  # of a table; chosen: 1 year, a laboratory's usual interval (docs/serve.md)
SOON_DAYS = 90.0  # before the drift passes the limit; chosen: 3 months (docs/serve.md)
DAY_S = 86400.0


class Health(IntEnum):
    """What a unit needs, the most urgent first: what a person has to decide, then what the
    forecast says; NO_FORECAST where nothing else is known and no forecast of it holds today.
    """

    CONTRADICTED = 0
    WAITS = 1
    BEYOND = 2
    SOON = 3
    NO_TABLE = 4
    OLD = 5
    NO_FORECAST = 6
    GOOD = 7


class Show(StrEnum):
    """Which units a list is of."""

    ALL = "all"
    NEXT = "next"
    WAITING = "waiting"
    NO_TWIN = "no_twin"


HEALTH_WORDS: Mapping[Health, tuple[str, str, str]] = {  # word, look, what to do
    Health.CONTRADICTED: ("contradicted", "bad", "Sessions contradict its table: look at them."),
    Health.BEYOND: ("beyond the limit", "bad", "Recalibrate it from its next session."),
    Health.WAITS: ("to decide", "fair", "A proposed update waits for a decision."),
    Health.SOON: ("near the limit", "fair", "Its drift passes the limit within a quarter."),
    Health.NO_TABLE: ("no table", "none", "It runs on the default of its technology."),
    Health.OLD: ("old table", "none", "Its table is older than a year."),
    Health.NO_FORECAST: ("unknown", "none", "No forecast of its drift holds today."),
    Health.GOOD: ("good", "good", ""),
}


@dataclass(frozen=True, kw_only=True)
class UnitHealth:
    """A unit of the list: what the store holds of it, what it needs, how old its table is, and its
    predicted drift where a forecast is at hand.
    """

    unit: UnitSummary
    health: Health
    age_days: float
    forecast: UnitForecast | None

    @property
    def words(self) -> tuple[str, str, str]:
        """The health in a word, its look, what to do."""
        return HEALTH_WORDS[self.health]

    @property
    def drift_nm_h(self) -> float:
        """Predicted drift now; -1 where there is no forecast, so that it sorts last."""
        return -1.0 if self.forecast is None else self.forecast.drift_now_nm_h


def unit_health(
    units: Sequence[UnitSummary], forecast: ForecastReport | None, now: datetime
) -> list[UnitHealth]:
    """The health of each unit."""
    limit = None if forecast is None else forecast.limit_nm_h
    drifts = {} if forecast is None else {_key(f): f for f in forecast.units}
    found = []
    for unit in units:
        key = (unit.unit.imu_serial, unit.unit.gyro_technology, unit.unit.gyro_mode)
        drift = drifts.get(key)
        age = _days(unit.created_utc, now)
        health = _health(unit, drift, limit, age, now)
        found.append(UnitHealth(unit=unit, health=health, age_days=age, forecast=drift))
    return found


def chosen(rows: Sequence[UnitHealth], show: Show) -> list[UnitHealth]:
    """The units that a filter lets through."""
    match show:
        case Show.NEXT:
            return [row for row in rows if row.health < Health.NO_FORECAST]
        case Show.WAITING:
            return [row for row in rows if row.unit.undecided]
        case Show.NO_TWIN:
            return [row for row in rows if not row.unit.has_twin]
    return list(rows)


def urgency(row: UnitHealth) -> tuple[int, float, float]:
    """What orders units by urgency: health, then drift, then age of the table."""
    return row.health, -row.drift_nm_h, -row.age_days


def _key(found: UnitForecast) -> tuple[str, str, str]:
    return found.imu_serial, found.gyro_technology, found.gyro_mode


def _health(
    unit: UnitSummary,
    drift: UnitForecast | None,
    limit_nm_h: float | None,
    age_days: float,
    now: datetime,
) -> Health:
    beyond = drift is not None and limit_nm_h is not None and drift.drift_now_nm_h > limit_nm_h
    until = None if drift is None else drift.date_95_utc
    tests = (
        (Health.CONTRADICTED, unit.contradictions > 0),
        (Health.WAITS, unit.undecided > 0),
        (Health.BEYOND, beyond),
        (Health.SOON, until is not None and -_days(until, now) < SOON_DAYS),
        (Health.NO_TABLE, not unit.active_number),
        (Health.OLD, age_days > OLD_DAYS),
        (Health.NO_FORECAST, drift is None),
    )
    return next((health for health, holds in tests if holds), Health.GOOD)


def _days(utc: str, now: datetime) -> float:
    """Days since a date of the store; 0 where there is none."""
    if not utc:
        return 0.0
    date = datetime.fromisoformat(utc.replace("Z", "+00:00"))
    if date.tzinfo is None:
        date = date.replace(tzinfo=now.tzinfo)
    return (now - date).total_seconds() / DAY_S
