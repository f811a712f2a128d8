"""Who may approve: the store's rule, append-only like everything else, the last row in force.

Every function works inside the caller's transaction.
"""

import unicodedata
from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

from sqlalchemy import Connection, insert, inspect, select

from infield.store.database import store_name
from infield.store.errors import RowFault, SamePerson
from infield.store.rows import now_of, row_sha256
from infield.store.schema import policy


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
