"""Proposals and decisions as records: read with every hash checked. Every function works inside the
caller's transaction.
"""

import json
import unicodedata
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

from sqlalchemy import Connection, and_, func, insert, inspect, select

from infield.store.database import NUMBERING_LOCK, store_name
from infield.store.errors import RowFault, SamePerson
from infield.store.rows import MergedRun, UnitKey, key_of, now_of, row_sha256, text_sha256
from infield.store.schema import decision, policy, proposal, revision, tag, unit
from infield.table.file import table_from_dict
from infield.table.thermal_table import ThermalTable
from ins.documents import INLINE, UNWRITTEN, written_as
from ins.json_file import JsonObject
from ins.records import TableDocument


class Decided(StrEnum):
    """What became of a proposal."""

    APPROVED = "approved"
    REJECTED = "rejected"


STORED_TEXTS = ("table_json", "report_json", "first_table_json")
LIGHT = [column for column in proposal.c if column.name not in STORED_TEXTS]


@dataclass(frozen=True, kw_only=True)
class Decision:
    """What a person decided; `revision_number`: the revision that an approved proposal became."""

    verdict: str
    decided_utc: str
    decided_by: str = field(metadata=written_as("by"))
    reason: str
    revision_number: int | None = field(metadata=written_as("revision"))
    number: int = field(metadata=UNWRITTEN)
    proposal_number: int = field(metadata=UNWRITTEN)
    record_sha256: str = field(metadata=UNWRITTEN)

    def words(self) -> str:
        """For people, after "proposal 3 was"."""
        return f"{self.verdict} by {self.decided_by} on {self.decided_utc} ({self.reason})"


@dataclass(frozen=True, kw_only=True)
class Proposal:
    """An update that was put forward, without its texts. state: open, out of date (another table is
    active by now), approved or rejected.
    """

    unit: UnitKey = field(metadata=INLINE)
    number: int = field(metadata=written_as("proposal"))
    state: str
    proposed_utc: str
    proposed_by: str
    parent_sha256: str
    sha256: str
    note: str
    runs: tuple[MergedRun, ...]
    decision: Decision | None
    report_sha256: str = field(metadata=UNWRITTEN)
    record_sha256: str = field(metadata=UNWRITTEN)


@dataclass(frozen=True, kw_only=True)
class FullProposal(Proposal):
    """A proposal with its texts, and where the unit's decisions stand."""

    table_json: str = field(metadata=UNWRITTEN)
    report_json: str = field(metadata=UNWRITTEN)
    first_table_json: str | None = field(metadata=UNWRITTEN)
    decisions_before: int = field(metadata=UNWRITTEN)
    last_decision_sha256: str = field(metadata=UNWRITTEN)

    @property
    def table_dict(self) -> TableDocument:
        """The proposed table as formats.md section 2 writes it."""
        document: TableDocument = json.loads(self.table_json)
        return document

    @property
    def table(self) -> ThermalTable:
        return table_from_dict(self.table_dict, name=f"{self.unit} proposal {self.number}")

    @property
    def report(self) -> JsonObject:
        """The update document as it was proposed."""
        document: JsonObject = json.loads(self.report_json)
        return document


def proposals_of(c: Connection, row: Any) -> list[Proposal]:
    """All proposals of one unit, oldest first."""
    return _read(c, [row])


def next_number(c: Connection) -> int:
    """The number of the store's next proposal, no other transaction can get it. In a store older
    than schema 0006 each unit counted for itself.
    """
    if c.dialect.name == "postgresql":
        c.execute(select(func.pg_advisory_xact_lock(NUMBERING_LOCK)))
    return (c.execute(select(func.max(proposal.c.number))).scalar() or 0) + 1


def proposals_of_all(c: Connection) -> list[Proposal]:
    """All proposals by unit; none from a store older than the table of them."""
    if not inspect(c).has_table(proposal.name):
        return []
    return _read(
        c,
        c.execute(
            select(unit).order_by(unit.c.imu_serial, unit.c.gyro_technology, unit.c.gyro_mode)
        ).all(),
    )


def read_full(c: Connection, row: Any, number: int) -> FullProposal:
    """One proposal that the unit has, with its texts; RowFault where it was changed."""
    found = proposals_of(c, row)
    light = next(p for p in found if p.number == number)
    query = select(proposal.c.table_json, proposal.c.report_json, proposal.c.first_table_json)
    texts = c.execute(
        query.where(and_(proposal.c.unit_id == row.id, proposal.c.number == number))
    ).one()
    first_intact = (
        texts.first_table_json is None or text_sha256(texts.first_table_json) == light.parent_sha256
    )
    if (text_sha256(texts.table_json), text_sha256(texts.report_json)) != (
        light.sha256,
        light.report_sha256,
    ) or not first_intact:
        raise _changed(c, light.unit, f"proposal {number}")
    decided = sorted((p.decision for p in found if p.decision), key=lambda d: d.number)
    return FullProposal(
        **vars(light),
        **texts._mapping,
        decisions_before=len(decided),
        last_decision_sha256=decided[-1].record_sha256 if decided else "",
    )


def record_of_proposal(key: UnitKey, values: Mapping[str, Any], before: str) -> str:
    """The hash of a proposal's row without its texts (their hashes are in it), and of the record
    before it.
    """
    content = {c.name: values[c.name] for c in LIGHT if c.name not in ("unit_id", "record_sha256")}
    return row_sha256([before, vars(key), content])


def record_of_decision(
    key: UnitKey, values: Mapping[str, Any], of_proposal: str, before: str
) -> str:
    """The hash of a decision's row, of its proposal's record and of the decision before it."""
    content = {k: v for k, v in values.items() if k not in ("unit_id", "record_sha256")}
    return row_sha256([before, of_proposal, vars(key), content])


def _read(c: Connection, units: Any) -> list[Proposal]:
    """The proposals of some units, in three queries however many there are."""
    decided: dict[int, list[Any]] = {}
    for stored in c.execute(select(decision).order_by(decision.c.unit_id, decision.c.number)).all():
        decided.setdefault(stored.unit_id, []).append(stored)
    ids = {row.id for row in units}
    only = proposal.c.unit_id.in_(ids) if len(ids) == 1 else proposal.c.unit_id.is_not(None)
    rows: dict[int, list[Any]] = {}
    for stored in c.execute(
        select(*LIGHT).where(only).order_by(proposal.c.unit_id, proposal.c.number)
    ).all():
        rows.setdefault(stored.unit_id, []).append(stored)
    if not rows:
        return []
    joined = and_(
        tag.c.unit_id == revision.c.unit_id,
        tag.c.number == revision.c.number,
        tag.c.name == "active",
    )
    active = {
        r.unit_id: r.sha256
        for r in c.execute(select(revision.c.unit_id, revision.c.sha256).join(tag, joined)).all()
    }
    return [
        found
        for row in units
        if row.id in rows
        for found in _one_unit(
            c, key_of(row), rows[row.id], decided.get(row.id, []), active.get(row.id)
        )
    ]


def _one_unit(
    c: Connection, key: UnitKey, rows: list[Any], decided: list[Any], active_sha256: str | None
) -> list[Proposal]:
    """A unit's proposals with their decisions, both chains checked."""
    before, records = "", {}
    for stored in rows:
        if stored.record_sha256 != record_of_proposal(key, stored._mapping, before):
            raise _changed(c, key, f"proposal {stored.number}")
        before = records[stored.number] = stored.record_sha256
    decisions = _decisions(c, key, decided, records)
    found = []
    for stored in rows:
        values = {k: v for k, v in stored._mapping.items() if k != "unit_id"}
        runs = tuple(MergedRun(run_id=i, sha256=s) for i, s in json.loads(values.pop("runs_json")))
        decided_so = decisions.get(stored.number)
        state = "open" if active_sha256 in (None, stored.parent_sha256) else "out of date"
        if decided_so is not None:
            state = decided_so.verdict
        found.append(Proposal(unit=key, **values, runs=runs, state=state, decision=decided_so))
    return found


def _decisions(
    c: Connection, key: UnitKey, decided: list[Any], records: dict[int, str]
) -> dict[int, Decision]:
    """Decisions by the number of their proposal."""
    before, found = "", {}
    for number, stored in enumerate(decided, start=1):
        values = {k: v for k, v in stored._mapping.items() if k != "unit_id"}
        record = record_of_decision(key, values, records.get(stored.proposal_number, ""), before)
        if stored.number != number or stored.record_sha256 != record:
            raise _changed(c, key, f"decision {stored.number}")
        before = stored.record_sha256
        found[stored.proposal_number] = Decision(**values)
    return found


def _changed(c: Connection, key: UnitKey, row: str) -> RowFault:
    what = f"{row}: the row was changed or is missing, its hash does not match"
    return RowFault(f"store {store_name(c.engine.url)}: {key} {what}", what)


class Approval(StrEnum):
    """Whether one person may put an update forward and approve it."""

    TWO_PEOPLE = "two_people"
    ONE_PERSON = "one_person"


@dataclass(frozen=True, kw_only=True)
class PolicyRecord:
    """A rule of the store; number 0: the one that a store begins with, which nobody set."""

    number: int = 0
    approval: Approval = Approval.TWO_PEOPLE
    set_utc: str = ""
    set_by: str = ""
    reason: str = ""
    record_sha256: str = ""


def policy_of(c: Connection) -> PolicyRecord:
    """The rule in force, the chain checked; that of two people in a store older than the table."""
    if not inspect(c).has_table(policy.name):
        return PolicyRecord()
    found = PolicyRecord()
    for row in c.execute(select(policy).order_by(policy.c.number)).all():
        values = dict(row._mapping)
        record = values.pop("record_sha256")
        wrong_number = values["number"] != found.number + 1
        if wrong_number or record != row_sha256([found.record_sha256, values]):
            what = f"policy {values['number']}: the row was changed, its hash does not match"
            raise RowFault(f"store {store_name(c.engine.url)}: {what}", what)
        values["approval"] = Approval(values["approval"])
        found = PolicyRecord(**values, record_sha256=record)
    return found


def set_policy(c: Connection, approval: Approval, *, by: str, reason: str = "") -> PolicyRecord:
    """Append a rule; the one in force again is not kept twice."""
    before = policy_of(c)
    if before.approval == approval:
        return before
    values: dict[str, Any] = {
        "number": before.number + 1,
        "approval": approval.value,
        "set_utc": now_of(c),
        "set_by": by,
        "reason": reason,
    }
    record = row_sha256([before.record_sha256, values])
    c.execute(insert(policy).values(**values, record_sha256=record))
    return policy_of(c)


def policy_faults(c: Connection) -> Iterable[str]:
    """What is broken in the rules."""
    try:
        policy_of(c)
    except RowFault as fault:
        yield fault.row


def require_second_person(c: Connection, proposed_by: str, approved_by: str, what: str) -> None:
    """SamePerson where the store's rule is that two people answer for an update and these two are
    not shown to be two.
    """
    if policy_of(c).approval == Approval.ONE_PERSON:
        return
    if not proposed_by:
        raise SamePerson(
            f"{what} names nobody who put it forward, so {approved_by} cannot be shown to be a"
            " second person: update again with --propose --by NAME, or reject it"
        )
    if _folded(proposed_by) == _folded(approved_by):
        raise SamePerson(
            f"{what} was put forward by {proposed_by}: somebody else approves it (recal table"
            " policy --one-person makes a store without this rule)"
        )


def _folded(name: str) -> str:
    """The name as it is compared: white space, case and ways to write a letter do not tell two
    people apart.
    """
    folded = unicodedata.normalize("NFKC", unicodedata.normalize("NFKC", name).casefold())
    return " ".join(folded.split())
