"""What identifies a unit, out of the reports that a store keeps of its sessions.

The history begins anew where a table came from outside: a unit that was repaired, or given another
serial, is imported again. Reports of older versions hold no marks and say nothing.
"""

import json
from typing import Any

import numpy as np

from infield.session.identity.marks import UnitMarks
from infield.store.rows import Revision, UnitKey
from infield.store.table_store import TableStore
from ins.units import DEG
from ins.verdicts import Outcome

# the newest; chosen: of 12 the mean adds 4 % to the sigma of a session, more adds less
MOST_HISTORY = 12


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
