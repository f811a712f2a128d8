"""Updates put forward for review, and the decisions about them: append-only rows, each chained to
the one before.

A proposal holds what a commit needs. Approving it commits by the same rules as
`TableStore.commit_update`: where another table is active by now, the approval is refused and the
update has to be made again.

Decision: docs/decisions/0022-sqlite-journal.md.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from sqlalchemy import Connection, insert

from infield.store.database import Database
from infield.store.errors import AlreadyRejected, RunAlreadyMerged, TableMoved, UnknownUnit
from infield.store.proposal_rows import (
    Decided,
    Decision,
    FullProposal,
    Proposal,
    next_number,
    proposals_of,
    proposals_of_all,
    read_full,
    record_of_decision,
    record_of_proposal,
    require_second_person,
)
from infield.store.rows import (
    MergedRun,
    NewRevision,
    Revision,
    append_revision,
    find_unit,
    key_of,
    last_number,
    now_of,
    runs_held,
    set_runs,
    tagged,
    text_sha256,
    unit_of_table,
)
from infield.store.schema import decision, proposal
from infield.store.verify import lock_unit
from infield.table.file import canonical_json, table_to_dict
from infield.table.thermal_table import ThermalTable
from ins.records import LONGEST_NAME, InputError, TableDocument
from ins.verdicts import Outcome

# characters; chosen: two screens of 25 lines of 80
LONGEST_STORED_REASON = 4000

__all__ = ["Decision", "FullProposal", "Proposal", "ProposalStore"]


class ProposalStore:
    """The part of the table store that holds what waits for a decision."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def propose(
        self,
        parent_sha256: str,
        table: ThermalTable,
        runs: Sequence[MergedRun],
        report_json: str,
        *,
        first_table: TableDocument | None = None,
        by: str,
        note: str = "",
    ) -> Proposal:
        """Keep an update for review; arguments as for `TableStore.commit_update`. The active table
        stays as it is.

        The same update that still waits is returned, not kept twice, unless a note says more.
        Raises StoreConflict and
        RunAlreadyMerged as a commit would, AlreadyRejected where the same update was rejected and
        `note` does not say why it comes again.
        """
        if table.provenance.get("parent_sha256") != parent_sha256:
            raise ValueError(
                "provenance.parent_sha256 is not the parent that the update is proposed for"
            )
        first = None if first_table is None else canonical_json(first_table)
        if first is not None and text_sha256(first) != parent_sha256:
            raise ValueError("the first table is not the parent that the update is proposed for")
        text = canonical_json(table_to_dict(table))
        values: dict[str, Any] = {
            "proposed_by": signed_line(by, "by"),
            "parent_sha256": parent_sha256,
            "sha256": text_sha256(text),
            "report_sha256": text_sha256(report_json),
            "runs_json": json.dumps([[run.run_id, run.sha256] for run in runs]),
            "note": signed_text(note, "note", needed=False),
        }

        def work(c: Connection) -> Proposal:
            row = lock_unit(c, unit_of_table(table))
            known = last_number(c, row) > 0
            if known or first is None:
                require_mergeable(c, row, parent_sha256, runs)
            before = proposals_of(c, row)
            if (again := _the_same(before, values)) is not None:
                return again
            number = next_number(c)
            texts = {
                "table_json": text,
                "report_json": report_json,
                "first_table_json": None if known else first,
            }
            numbered = {**values, "proposed_utc": now_of(c), "number": number, "unit_id": row.id}
            record = record_of_proposal(
                key_of(row), numbered, before[-1].record_sha256 if before else ""
            )
            c.execute(insert(proposal).values(**numbered, **texts, record_sha256=record))
            return proposals_of(c, row)[-1]

        return self._database.write(work)

    def proposals(
        self,
        serial: str | None = None,
        technology: str | None = None,
        mode: str | None = None,
        *,
        state: str | None = None,
    ) -> list[Proposal]:
        """All proposals (of the units that match; in one state), by unit, oldest first, every chain
        checked.
        """
        wanted = {"imu_serial": serial, "gyro_technology": technology, "gyro_mode": mode}
        with self._database.reading() as c:
            return [
                found
                for found in proposals_of_all(c)
                if all(value in (None, getattr(found.unit, name)) for name, value in wanted.items())
                and state in (None, found.state)
            ]

    def proposal(
        self,
        number: int,
        serial: str | None = None,
        technology: str | None = None,
        mode: str | None = None,
    ) -> FullProposal:
        """One proposal with its table and its report."""
        wanted = (serial, technology, mode)
        with self._database.reading() as c:
            if not proposals_of_all(c):
                raise UnknownUnit("the store holds no proposal")
            return read_full(c, find_unit(c, *wanted, proposal_number=number), number)

    def decide(
        self,
        number: int,
        verdict: str,
        serial: str | None = None,
        technology: str | None = None,
        mode: str | None = None,
        *,
        by: str,
        reason: str,
    ) -> Proposal:
        """Approve or reject a proposal, once; `verdict` is "approved" or "rejected". Approved, it
        becomes active.

        Raises SamePerson where who approves is who put it forward (`infield.store.proposal_rows`),
        StoreConflict if another table than its parent is active by now, RunAlreadyMerged if that
        holds one of its runs, InputError if it was decided before, or `by` or `reason` are missing.
        """
        if verdict not in tuple(Decided):
            raise InputError(f"verdict {verdict[:40]!r}, needed approved or rejected")
        by, reason = signed_line(by, "by"), signed_text(reason, "reason")
        wanted = (serial, technology, mode)

        def work(c: Connection) -> Proposal:
            row = lock_unit(c, key_of(find_unit(c, *wanted, proposal_number=number)))
            full = read_full(c, row, number)
            if full.decision is not None:
                raise InputError(
                    f"{full.unit}: proposal {number} was {full.decision.words()} before"
                )
            if verdict == Decided.APPROVED:
                what = f"{full.unit}: proposal {number}"
                require_second_person(c, full.proposed_by, by, what)
            values = {
                "unit_id": row.id,
                "number": full.decisions_before + 1,
                "proposal_number": number,
                "verdict": verdict,
                "decided_utc": now_of(c),
                "decided_by": by,
                "reason": reason,
                "revision_number": (
                    _commit(c, row, full, by, reason) if verdict == Decided.APPROVED else None
                ),
            }
            record = record_of_decision(
                full.unit, values, full.record_sha256, full.last_decision_sha256
            )
            c.execute(insert(decision).values(**values, record_sha256=record))
            return next(p for p in proposals_of(c, row) if p.number == number)

        return self._database.write(work)


def signed_note(by: str, reason: str, what: str = "") -> str:
    """The note of a revision that a person answers for; InputError where name or reason is
    missing.
    """
    return f"{what}{signed_line(by, 'by')}: {signed_text(reason, 'reason')}"


def _commit(c: Connection, row: Any, full: FullProposal, by: str, reason: str) -> int:
    """The proposal becomes the active table; the number of its revision."""
    report = json.loads(full.report_json)
    signed = {"proposal": full.number, "approved_by": by, "approved_because": reason}
    committed = {**report, "verdict": Outcome.COMMITTED.value, **signed}
    approved = TableUpdate(
        parent_sha256=full.parent_sha256,
        table_json=full.table_json,
        runs=full.runs,
        report_json=json.dumps(committed, indent=1, allow_nan=False) + "\n",
        first_table_json=full.first_table_json,
    )
    note = signed_note(by, reason, f"proposal {full.number} approved by ")
    return commit_revision(c, row, approved, note=note).number


def _the_same(before: Sequence[Proposal], values: dict[str, Any]) -> Proposal | None:
    """The proposal of this very update that still waits."""
    keys = ("parent_sha256", "sha256")
    runs = [tuple(run) for run in json.loads(values["runs_json"])]
    same = [
        p
        for p in before
        if all(getattr(p, key) == values[key] for key in keys)
        and [(run.run_id, run.sha256) for run in p.runs] == runs
    ]
    if not same:
        return None
    last = same[-1]
    if last.decision is None and values["note"] in ("", last.note):
        return last
    if last.state == Decided.REJECTED and last.decision and not values["note"]:
        raise AlreadyRejected(
            f"{last.unit}: the same update was {last.decision.words()} as proposal {last.number}; a"
            " note must say why it comes again"
        )
    return None


def signed_line(text: str, name: str, *, needed: bool = True) -> str:
    """A name, trimmed; InputError where it is empty, too long or no single line."""
    text = text.strip()
    if (needed and not text) or len(text) > LONGEST_NAME or not text.isprintable():
        raise InputError(
            f"{name}: got {text[:40]!r}, needed a name of at most {LONGEST_NAME} printable"
            " characters on one line"
        )
    return text


def signed_text(text: str, name: str, *, needed: bool = True) -> str:
    """A reason, trimmed; InputError where it is empty or too long."""
    text = "\n".join(line.rstrip() for line in text.strip().splitlines())
    if (
        (needed and not text)
        or len(text) > LONGEST_STORED_REASON
        or not all(c.isprintable() or c in "\n\t" for c in text)
    ):
        raise InputError(
            f"{name}: got {len(text)} characters, needed 1 to {LONGEST_STORED_REASON} printable"
            " ones that say why"
        )
    return text


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
