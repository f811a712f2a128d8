"""A recalibrated table becomes a unit's active one: the rows, inside the caller's transaction."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from sqlalchemy import Connection

from infield.store.errors import RunAlreadyMerged, TableMoved
from infield.store.rows import (
    MergedRun,
    NewRevision,
    Revision,
    append_revision,
    key_of,
    last_number,
    runs_held,
    set_runs,
    tagged,
)


@dataclass(frozen=True, kw_only=True)
class TableUpdate:
    """What a commit needs of an update. first_table_json: the table that a unit without revisions
    begins with; its hash is the parent's.
    """

    parent_sha256: str
    table_json: str
    runs: Sequence[MergedRun]
    report_json: str
    first_table_json: str | None = None


def commit_revision(c: Connection, row: Any, update: TableUpdate, *, note: str = "") -> Revision:
    """Append the update of a locked unit and make it active.

    Raises as `require_mergeable` does.
    """
    if last_number(c, row) == 0 and update.first_table_json is not None:
        first = NewRevision(
            kind="factory", table_json=update.first_table_json, note="technology default"
        )
        append_revision(c, row, first)
    require_mergeable(c, row, update.parent_sha256, update.runs)
    held = runs_held(c, row)
    new = NewRevision(
        kind="update",
        table_json=update.table_json,
        runs=update.runs,
        report_json=update.report_json,
        note=note,
    )
    append_revision(c, row, new)
    set_runs(c, row, held | {run.sha256 for run in update.runs})
    return tagged(c, row, "active")


def require_mergeable(
    c: Connection, row: Any, parent_sha256: str, runs: Sequence[MergedRun]
) -> None:
    """TableMoved if another table than the update's parent is active, RunAlreadyMerged if it
    holds one of the runs.
    """
    if last_number(c, row) == 0 or tagged(c, row, "active").sha256 != parent_sha256:
        raise TableMoved(
            f"{key_of(row)}: the active table is not {parent_sha256[:12]} now; update again"
        )
    held = runs_held(c, row)
    for run in runs:
        if run.sha256 in held:
            raise RunAlreadyMerged(
                f"{key_of(row)}: the active table already holds run {run.run_id}"
            )
