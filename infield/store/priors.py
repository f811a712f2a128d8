"""Priors learnt from the sessions of a technology: kept like tables, with a revision, an approval
and their history.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from sqlalchemy import Connection, insert, inspect, select, union

from infield.store.database import Database
from infield.store.errors import RowFault, UnknownUnit
from infield.store.proposal_rows import Decided
from infield.store.rows import (
    chained_sha256,
    now_of,
    row_fault,
    signed_line,
    signed_text,
    text_sha256,
)
from infield.store.schema import priors, priors_decision
from ins.documents import UNWRITTEN
from ins.records import GYRO_TECHNOLOGIES, InputError


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
        if values["record_sha256"] != priors_sha256(values, before):
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
        record = chained_sha256(values, before)
        if values["number"] != number or values["record_sha256"] != record:
            raise _changed(c, technology, f"decision {values['number']} about priors")
        before = record
        del values["gyro_technology"]
        found.append(PriorsDecision(**values))
    return found


def priors_sha256(values: Mapping[str, str | int], before: str) -> str:
    """The hash of a row without its text (its hash is in it), and of the record before it."""
    return chained_sha256(values, before, without=("priors_json",))


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
    return row_fault(
        c, f"{technology}: {row}: the row was changed or is missing, its hash does not match"
    )


class PriorsStore:
    """The part of the table store that holds what was learnt of a technology."""

    _database: Database

    def keep_priors(
        self, technology: str, priors_json: str, *, by: str = "", note: str = ""
    ) -> PriorsRecord:
        """Append priors, open until somebody decides; the newest again is not kept twice."""
        values: dict[str, str | int] = {
            "gyro_technology": technology,
            "learnt_by": signed_line(by, "by", needed=False),
            "note": signed_text(note, "note", needed=False),
            "sha256": text_sha256(priors_json),
        }

        def work(c: Connection) -> PriorsRecord:
            before = priors_of(c, technology)
            if before and before[-1].sha256 == values["sha256"]:
                return before[-1]
            numbered = {**values, "number": len(before) + 1, "learnt_utc": now_of(c)}
            record = priors_sha256(numbered, before[-1].record_sha256 if before else "")
            text = {"priors_json": priors_json, "record_sha256": record}
            c.execute(insert(priors).values(**numbered, **text))
            return priors_of(c, technology)[-1]

        return self._database.write(work)

    def priors(self, technology: str | None = None) -> list[PriorsRecord]:
        """All (of one technology), oldest first, every chain checked."""
        wanted = GYRO_TECHNOLOGIES if technology is None else (technology,)
        with self._database.reading() as c:
            return [record for name in wanted for record in priors_of(c, name)]

    def priors_in_use(self, technology: str) -> PriorsRecord | None:
        """The priors that the last approval names, None without one."""
        return next((r for r in self.priors(technology) if r.state == IN_USE), None)

    def decide_priors(
        self, technology: str, number: int, verdict: str, *, by: str, reason: str
    ) -> PriorsRecord:
        """Approve priors, which puts them to use, or reject them. Priors that were approved before
        may be approved again; those in use are rejected by approving others.
        """
        if verdict not in tuple(Decided):
            raise InputError(f"verdict {verdict[:40]!r}, needed approved or rejected")
        by, reason = signed_line(by, "by"), signed_text(reason, "reason")

        def work(c: Connection) -> PriorsRecord:
            kept = priors_of(c, technology)
            if not kept:
                raise UnknownUnit(f"the store holds no priors of {technology}: recal fleet learn")
            if not 1 <= number <= len(kept):
                raise InputError(f"{technology}: no priors {number}, needed 1 to {len(kept)}")
            chosen = kept[number - 1]
            if chosen.state == IN_USE:
                raise InputError(f"{technology}: priors {number} are in use")
            if chosen.state == Decided.REJECTED:
                raise InputError(
                    f"{technology}: priors {number} were {chosen.decisions[-1].words()} before"
                )
            decisions = sorted((d for r in kept for d in r.decisions), key=lambda d: d.number)
            values: dict[str, str | int] = {
                "gyro_technology": technology,
                "number": len(decisions) + 1,
                "priors_number": number,
                "verdict": verdict,
                "decided_utc": now_of(c),
                "decided_by": by,
                "reason": reason,
            }
            record = chained_sha256(values, decisions[-1].record_sha256 if decisions else "")
            c.execute(insert(priors_decision).values(**values, record_sha256=record))
            return priors_of(c, technology)[number - 1]

        return self._database.write(work)
