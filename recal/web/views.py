"""What the templates show, as plain values: rows of tables, provenance, addresses, the health of
each unit of a store. Reads nothing, decides nothing.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from enum import IntEnum, StrEnum
from typing import Any
from urllib.parse import quote, urlencode

import numpy as np

from ins.records import AXES
from recal.service.inputs.records import TableDocument, ThermalTable
from recal.service.priors.records import ForecastReport, UnitForecast
from recal.service.results.pages import decimals_for
from recal.service.store import FullProposal, Revision, SessionEvidence, UnitKey, UnitSummary
from recal.service.tables import change_between

STATE_LOOKS = {"open": "fair", "out of date": "none", "approved": "good", "rejected": "bad"}


NodeRow = tuple[float, ...]  # of a table
OLD_DAYS = 365.0  # of a table; chosen: 1 year, a laboratory's usual interval (docs/serve.md)
SOON_DAYS = 90.0  # before the drift passes the limit; chosen: 3 months (docs/serve.md)
DAY_S = 86400.0


@dataclass(frozen=True, kw_only=True)
class TableRows:
    """Per gyro: temperature, bias, expanded uncertainty U(k=2); and the decimals that show them."""

    axes: Mapping[str, Sequence[NodeRow]]
    decimals: int


@dataclass(frozen=True, kw_only=True)
class ChangeRows(TableRows):
    """Per gyro: temperature, before, U, after, U, change; and the row of the largest change."""

    largest: Mapping[str, NodeRow]


@dataclass(frozen=True, kw_only=True)
class ProvenanceChange:
    """Runs (id, hash) that only one of two tables names; kept: how many both do."""

    added: Sequence[tuple[str, str]]
    gone: Sequence[tuple[str, str]]
    kept: int
    same_table: bool


@dataclass(frozen=True, kw_only=True)
class ContradictionRow:
    """A session against the active table; gyros: axis, temperature, bias less the table's, U."""

    run_id: str
    sha256: str
    start_utc: str
    gyros: Sequence[tuple[str, float, float, float]]


def address(path: str, unit: UnitKey | None = None, **more: Any) -> str:
    """A link: any serial fits into it."""
    key = {} if unit is None else dict(zip(("serial", "technology", "mode"), unit.key))
    query = urlencode({**key, **more}, quote_via=quote)
    return f"{path}?{query}" if query else path


def table_rows(table: ThermalTable) -> TableRows:
    """Per gyro: temperature, bias, expanded uncertainty U(k=2); and the decimals that show them."""
    axes = {}
    for k, axis in enumerate(AXES):
        nodes = table.temperature_degC[k]
        columns = (nodes, table.bias_deg_h(axis, nodes), 2.0 * table.sigma_deg_h(axis, nodes))
        axes[axis] = [tuple(map(float, row)) for row in zip(*columns)]
    sigmas: list[float | None] = [row[2] / 2 for rows in axes.values() for row in rows]
    return TableRows(axes=axes, decimals=decimals_for(sigmas))


def change_rows(before: Revision, after: Revision | FullProposal) -> ChangeRows:
    """Per gyro the rows of `change_between`: T, before, U, after, U, change."""
    axes = {}
    for axis in AXES:
        c = change_between(before, after, axis)
        columns = (
            c.temperature_degC,
            c.before_deg_h,
            2.0 * c.sigma_before_deg_h,
            c.after_deg_h,
            2.0 * c.sigma_after_deg_h,
            c.change_deg_h,
        )
        axes[axis] = [tuple(map(float, row)) for row in zip(*columns)]
    sigmas: list[float | None] = [
        row[k] / 2 for rows in axes.values() for row in rows for k in (2, 4)
    ]
    largest = {axis: max(rows, key=lambda row: abs(row[5])) for axis, rows in axes.items()}
    return ChangeRows(axes=axes, decimals=decimals_for(sigmas), largest=largest)


def provenance_change(before: Revision, after: Revision) -> ProvenanceChange:
    """What the two tables were made from: runs that only one of them names, and their facts."""
    old, new = (_runs(r.table_dict) for r in (before, after))
    return ProvenanceChange(
        added=[run for key, run in new.items() if key not in old],
        gone=[run for key, run in old.items() if key not in new],
        kept=sum(key in old for key in new),
        same_table=before.sha256 == after.sha256,
    )


def _runs(table: TableDocument) -> dict[str, tuple[str, str]]:
    """Runs in a table's provenance by content hash: id, hash."""
    listed = table.get("provenance", {}).get("runs") or []
    runs = [
        (
            (str(r.get("run_id", "")), str(r.get("sha256", "")))
            if isinstance(r, dict)
            else ("", str(r))
        )
        for r in listed
    ]
    return {sha256: (run_id, sha256) for run_id, sha256 in runs}


def contradiction_rows(
    evidence: Sequence[SessionEvidence], table: ThermalTable
) -> list[ContradictionRow]:
    """What each session says against the active table: per gyro its bias less the table's, with
    U(k=2) of the difference.
    """
    rows = []
    for e in evidence:
        apart, sigma_table = e.departure(table)
        sigma = (np.diag(e.covariance) + sigma_table**2) ** 0.5
        gyros = zip(
            AXES, map(float, e.temperature_degC), map(float, apart), map(float, 2.0 * sigma)
        )
        rows.append(
            ContradictionRow(
                run_id=e.run_id, sha256=e.run_sha256, start_utc=e.start_utc, gyros=list(gyros)
            )
        )
    return rows


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
    drifts = {} if forecast is None else {f.key: f for f in forecast.units}
    found = []
    for unit in units:
        drift = drifts.get(unit.unit.key)
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
