"""A store, or a unit in it, that an update would make without being asked to.

A mistyped store must not pass for a new one, nor a unit with an invented table for its own.

Decision: docs/decisions/0022-sqlite-journal.md.
"""

import json
from typing import Any, NoReturn

import numpy as np

from infield.session.identity.marks import UnitMarks
from infield.store.database import store_name
from infield.store.errors import StoreNotAskedFor, UnitNotInStore
from infield.store.rows import Revision
from infield.store.table_store import TableStore, UnitKey
from ins.units import DEG
from ins.verdicts import Outcome

UNITS_NAMED = 8  # units of a store that one line names; chosen: 8 serials of ten characters
# the newest; chosen: of 12 the mean adds 4 % to the sigma of a session, more adds less
MOST_HISTORY = 12


def refuse_store(url: str, key: UnitKey) -> NoReturn:
    """StoreNotAskedFor: there is no store, and what would make one."""
    raise StoreNotAskedFor(
        f"no store at {store_name(url)}, where the table of {key} was looked for: recal table"
        " import TABLE makes one, or --new-store with --new-unit"
    )


def require_unit(store: TableStore | None, key: UnitKey) -> None:
    """UnitNotInStore where the store (None: one that is yet to be made) holds no table of a unit;
    the line names the units that it holds.
    """
    held = [] if store is None else [u.unit for u in store.overview() if u.active_number]
    if key in held:
        return
    where = "a new store" if store is None else f"store {store.name}"
    shown = ", ".join(str(unit) for unit in held[:UNITS_NAMED])
    more = f" and {len(held) - UNITS_NAMED} more" if len(held) > UNITS_NAMED else ""
    raise UnitNotInStore(
        f"{where} holds no table of {key}, it holds {shown or 'no unit'}{more}: recal table import"
        f" TABLE, or --new-unit to begin with the default of {key.gyro_technology}"
    )


def known_marks(store: TableStore, key: UnitKey) -> tuple[UnitMarks, ...]:
    """The marks of the sessions that a unit's table holds, oldest first."""
    revisions = store.reports(key.imu_serial, key.gyro_technology, key.gyro_mode)
    begun = [k for k, one in enumerate(revisions) if one.kind in ("factory", "import")]
    found: list[UnitMarks] = []
    for revision in reversed(revisions[begun[-1] :] if begun else revisions):
        found = [*_of_report(revision), *found]
        if len(found) >= MOST_HISTORY:
            break
    return tuple(found[-MOST_HISTORY:])


def _of_report(revision: Revision) -> list[UnitMarks]:
    """The marks of the accepted sessions of a revision's report, those that can be read."""
    if revision.report_json is None:
        return []
    try:
        sessions = json.loads(revision.report_json).get("sessions", [])
        held = [s for s in sessions if s.get("outcome") == Outcome.ACCEPTED]
        return [_marks(s["unit_marks"], s["site"]) for s in held if s.get("unit_marks")]
    except (AttributeError, KeyError, TypeError, ValueError):
        return []


def _marks(told: Any, site: Any) -> UnitMarks:
    """From JSON; ValueError where the marks do not fit each other."""
    names = tuple(str(name) for name in told["names"])
    value = np.array(told["value"], dtype=float)
    covariance = np.array(told["covariance"], dtype=float)
    heat = np.array(told["heat"], dtype=float)
    if not value.shape == heat.shape == (len(names),) or covariance.shape != (len(names),) * 2:
        raise ValueError("as many values as names, and their covariance")
    np.linalg.cholesky(covariance)
    return UnitMarks(
        names=names,
        value=value,
        covariance=covariance,
        heat=heat,
        lat_rad=float(site["lat_deg"]) * DEG,
        lon_rad=float(site["lon_deg"]) * DEG,
    )
