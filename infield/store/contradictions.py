"""Sessions that contradicted a unit's table, kept in its store: rows in and out, each with its
hash.

Every function works inside the caller's transaction.
"""

import json
from collections.abc import Sequence
from typing import Any

from sqlalchemy import Connection, insert, inspect, select

from infield.session.disagreement import SessionEvidence
from infield.store.database import store_name
from infield.store.errors import RowFault
from infield.store.rows import key_of, now_of, row_sha256, runs_held
from infield.store.schema import contradiction

ARRAYS = ("temperature_degC", "bias_deg_h", "bend_deg_h", "covariance")
RUN_TEXTS = ("run_id", "run_sha256", "start_utc")


def append_contradictions(
    c: Connection, row: Any, table_sha256: str, evidence: Sequence[SessionEvidence]
) -> int:
    """Write down what is not there yet; how many rows that were."""
    known = set(
        c.execute(
            select(contradiction.c.run_sha256).where(contradiction.c.unit_id == row.id)
        ).scalars()
    )
    new = {e.run_sha256: e for e in evidence if e.run_sha256 not in known}
    for e in new.values():
        values = {
            "run_sha256": e.run_sha256,
            "recorded_utc": now_of(c),
            "table_sha256": table_sha256,
            "evidence_json": _to_json(e),
        }
        c.execute(
            insert(contradiction).values(
                unit_id=row.id, **values, record_sha256=contradiction_sha256(row, values)
            )
        )
    return len(new)


def read_contradictions(c: Connection, row: Any) -> tuple[SessionEvidence, ...]:
    """All of a unit but those of runs that its table holds by now; none from a store older than the
    table of them.
    """
    if not inspect(c).has_table(contradiction.name):
        return ()
    held, found = runs_held(c, row), []
    for stored in c.execute(select(contradiction).where(contradiction.c.unit_id == row.id)).all():
        values = dict(stored._mapping)
        record, _ = values.pop("record_sha256"), values.pop("unit_id")
        if record != contradiction_sha256(row, values):
            what = f"the row of contradicting run {values['run_sha256'][:12]} was changed"
            raise RowFault(f"store {store_name(c.engine.url)}: {key_of(row)}: {what}", what)
        if values["run_sha256"] not in held:
            found.append(SessionEvidence(**json.loads(values["evidence_json"])))
    return tuple(found)


def _to_json(evidence: SessionEvidence) -> str:
    values = {name: getattr(evidence, name) for name in RUN_TEXTS}
    return json.dumps(
        {**values, **{name: getattr(evidence, name).tolist() for name in ARRAYS}}, sort_keys=True
    )


def contradiction_sha256(row: Any, values: dict[str, Any]) -> str:
    return row_sha256([vars(key_of(row)), values])
