"""Learnt priors and decisions about them as records: read with every hash checked. Every function
works inside the caller's transaction.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from sqlalchemy import Connection, inspect, select, union

from infield.store.database import store_name
from infield.store.errors import RowFault
from infield.store.proposal_rows import Decided
from infield.store.rows import row_sha256, text_sha256
from infield.store.schema import priors, priors_decision
from ins.documents import UNWRITTEN


@dataclass(frozen=True, kw_only=True)
class PriorsDecision:
    """What a person decided about learnt priors."""

    number: int
    priors_number: int
    verdict: str
    decided_utc: str
    decided_by: str
    reason: str
    record_sha256: str

    def words(self) -> str:
        """For people, after "priors 3 were"."""
        return f"{self.verdict} by {self.decided_by} on {self.decided_utc} ({self.reason})"


@dataclass(frozen=True, kw_only=True)
class PriorsRecord:
    """Priors of a technology as they were learnt. state: in use, open, approved (not in use now) or
    rejected; decisions: oldest first.
    """

    gyro_technology: str
    number: int
    state: str
    learnt_utc: str
    learnt_by: str
    note: str
    sha256: str
    decisions: tuple[PriorsDecision, ...]
    priors_json: str = field(metadata=UNWRITTEN)
    record_sha256: str = field(metadata=UNWRITTEN)


IN_USE, OPEN = "in use", "open"


def priors_of(c: Connection, technology: str) -> list[PriorsRecord]:
    """All of a technology, oldest first; none from a store older than the table of them."""
    if not inspect(c).has_table(priors.name):
        return []
    rows = c.execute(
        select(priors).where(priors.c.gyro_technology == technology).order_by(priors.c.number)
    ).all()
    decided = _decisions(c, technology)
    approved = [d.priors_number for d in decided if d.verdict == Decided.APPROVED]
    in_use = approved[-1] if approved else 0
    before, found = "", []
    for number, row in enumerate(rows, start=1):
        values = dict(row._mapping)
        intact = text_sha256(values["priors_json"]) == values["sha256"]
        if not intact or values["number"] != number:
            raise _changed(c, technology, f"priors {values['number']}")
        if values["record_sha256"] != record_of_priors(values, before):
            raise _changed(c, technology, f"priors {number}")
        before = values["record_sha256"]
        own = tuple(d for d in decided if d.priors_number == number)
        state = own[-1].verdict if own else OPEN
        found.append(
            PriorsRecord(**values, state=IN_USE if number == in_use else state, decisions=own)
        )
    return found


def _decisions(c: Connection, technology: str) -> list[PriorsDecision]:
    """Of a technology, oldest first, the chain checked."""
    query = select(priors_decision).where(priors_decision.c.gyro_technology == technology)
    before, found = "", []
    for number, row in enumerate(c.execute(query.order_by(priors_decision.c.number)), start=1):
        values = dict(row._mapping)
        record = record_of_decision(values, before)
        if values["number"] != number or values["record_sha256"] != record:
            raise _changed(c, technology, f"decision {values['number']} about priors")
        before = record
        del values["gyro_technology"]
        found.append(PriorsDecision(**values))
    return found


def record_of_priors(values: Mapping[str, str | int], before: str) -> str:
    """The hash of a row without its text (its hash is in it), and of the record before it."""
    left_out = ("priors_json", "record_sha256")
    return row_sha256([before, {k: v for k, v in values.items() if k not in left_out}])


def record_of_decision(values: Mapping[str, str | int], before: str) -> str:
    """The hash of a decision's row and of the decision before it."""
    return row_sha256([before, {k: v for k, v in values.items() if k != "record_sha256"}])


def priors_faults(c: Connection) -> Iterable[str]:
    """What is broken in the priors of each technology."""
    if not inspect(c).has_table(priors.name):
        return
    named = union(select(priors.c.gyro_technology), select(priors_decision.c.gyro_technology))
    for technology in c.execute(named).scalars().all():
        try:
            priors_of(c, technology)
        except RowFault as fault:
            yield fault.row


def _changed(c: Connection, technology: str, row: str) -> RowFault:
    what = f"{technology}: {row}: the row was changed or is missing, its hash does not match"
    return RowFault(f"store {store_name(c.engine.url)}: {what}", what)
