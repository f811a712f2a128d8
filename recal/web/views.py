"""What the templates show, as plain values: rows of tables, provenance, addresses. Reads nothing,
decides nothing.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any
from urllib.parse import quote, urlencode

import numpy as np

from ins.records import AXES
from recal.service.inputs.records import TableDocument, ThermalTable
from recal.service.priors.records import UnitForecast
from recal.service.results.pages import decimals_for
from recal.service.store import FullProposal, Revision, SessionEvidence, UnitKey
from recal.service.tables import change_between

STATE_LOOKS = {"open": "fair", "out of date": "none", "approved": "good", "rejected": "bad"}


NodeRow = tuple[float, ...]  # of a table


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
    key = (
        {}
        if unit is None
        else {"serial": unit.imu_serial, "technology": unit.gyro_technology, "mode": unit.gyro_mode}
    )
    query = urlencode({**key, **more}, quote_via=quote)
    return f"{path}?{query}" if query else path


def forecast_address(row: UnitForecast) -> str:
    """The page of a unit of a forecast."""
    return address(
        "/unit", serial=row.imu_serial, technology=row.gyro_technology, mode=row.gyro_mode
    )


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
