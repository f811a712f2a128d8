"""Priors learnt from the sessions of a technology: kept like tables, with a revision, an approval
and their history.
"""

from sqlalchemy import Connection, insert

from infield.store.database import Database
from infield.store.errors import UnknownUnit
from infield.store.priors_rows import (
    IN_USE,
    PriorsRecord,
    priors_of,
    record_of_decision,
    record_of_priors,
)
from infield.store.proposal_rows import Decided
from infield.store.proposals import signed_line, signed_text
from infield.store.rows import now_of, text_sha256
from infield.store.schema import priors, priors_decision
from ins.records import GYRO_TECHNOLOGIES, InputError


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
            record = record_of_priors(numbered, before[-1].record_sha256 if before else "")
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
            record = record_of_decision(values, decisions[-1].record_sha256 if decisions else "")
            c.execute(insert(priors_decision).values(**values, record_sha256=record))
            return priors_of(c, technology)[number - 1]

        return self._database.write(work)
