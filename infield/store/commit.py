"""A recalibrated table becomes a unit's active one: the rows, inside the caller's transaction."""

from collections.abc import Sequence
from typing import Any

from sqlalchemy import Connection

from infield.store.errors import RunAlreadyMerged, TableMoved
from infield.store.rows import (
    MergedRun,
    Revision,
    append_revision,
    key_of,
    last_number,
    runs_held,
    set_runs,
    tagged,
)


def commit_revision(
    c: Connection,
    row: Any,
    *,
    parent_sha256: str,
    table_json: str,
    runs: Sequence[MergedRun],
    report_json: str,
    first_table_json: str | None = None,
    note: str = "",
    now_utc: str | None = None,
) -> Revision:
    """Append the update of a locked unit and make it active; a unit without revisions begins with
    `first_table_json`.

    Raises as `require_mergeable` does.
    """
    if last_number(c, row) == 0 and first_table_json is not None:
        append_revision(
            c,
            row,
            kind="factory",
            table_json=first_table_json,
            note="technology default",
            now_utc=now_utc,
        )
    require_mergeable(c, row, parent_sha256, runs)
    held = runs_held(c, row)
    append_revision(
        c,
        row,
        kind="update",
        table_json=table_json,
        runs=runs,
        report_json=report_json,
        note=note,
        now_utc=now_utc,
    )
    set_runs(c, row, held | {run.sha256 for run in runs})
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
