"""`recal table`: stored tables as they are found, compared, decided on and told of."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from infield.store.database import holds_store
from infield.store.errors import StoreRefused
from infield.store.proposal_rows import Approval, PolicyRecord
from infield.store.table_store import FullProposal, Proposal, TableStore
from infield.store.table_store import Revision as Revision
from infield.store.verify import StoreCheck, UnitCheck
from infield.store.verify import StoreVerdict as StoreVerdict
from infield.table.file import export_command as export_command
from infield.table.thermal_table import ThermalTable
from ins.documents import INLINE, OMIT_NONE, plain, to_json
from ins.json_file import JsonObject, read_json_object
from ins.records import InputError, TableDocument
from ins.verdicts import Outcome
from recal.service.results.files import output_directory, write_files

APPROVAL_WORDS = {
    Approval.TWO_PEOPLE: "two people: somebody else than its proposer approves an update",
    Approval.ONE_PERSON: "one person may put an update forward and approve it",
}
MAX_DIGITS = 10  # of a revision number, less one: 9 digits fit 32 bits (2,147,483,647)


def other_technology(opened: TableStore, table: TableDocument) -> str | None:
    """What speaks against this table's gyro_technology: the store knows its serial as another."""
    serial, technology = table["imu_serial"], table["gyro_technology"]
    held = [u.unit for u in opened.units() if u.unit.imu_serial == serial]
    if not held or any(unit.gyro_technology == technology for unit in held):
        return None
    return (
        f"gyro_technology {technology}, the store holds {', '.join(map(str, held))}: another unit?"
    )


def set_policy(url: str, one_person: bool | None, *, by: str, reason: str) -> PolicyRecord:
    """The store's rule, a new one first where it is given; NoStore where there is no store."""
    if one_person is None or not holds_store(url):
        with TableStore.open(url) as opened:
            return opened.policy()
    approval = Approval.ONE_PERSON if one_person else Approval.TWO_PEOPLE
    with TableStore.open(url, create=True) as opened:
        return opened.set_policy(approval, by=by, reason=reason)


def policy_line(rule: PolicyRecord) -> str:
    """Who may approve, and who said so."""
    words = APPROVAL_WORDS[rule.approval]
    if not rule.number:
        return words
    why = f": {rule.reason}" if rule.reason else ""
    return f"{words} (policy {rule.number}, by {rule.set_by} on {rule.set_utc}{why})"


def find_revision(
    opened: TableStore, name: str, serial: str | None, technology: str | None, mode: str | None
) -> Revision:
    """A revision by number or tag; InputError where there is none."""
    key = opened.active(serial, technology, mode).unit.key
    if name == "previous":
        found = opened.previous(*key)
        if found is None:
            raise InputError(f"serial {key[0]}: revision 1 is active, there is none before it")
        return found
    if name in ("active", "factory"):
        record = next(u for u in opened.units() if u.unit.key == key)
        return opened.revision(
            {"active": record.active.number, "factory": record.factory_number}[name], *key
        )
    return opened.revision(revision_number(name), *key)


def revision_number(name: str) -> int:
    need(
        name.isdecimal() and len(name) < MAX_DIGITS,
        f"revision {name[:40]!r}, needed a number, factory, previous or active",
    )
    return int(name)


@dataclass(frozen=True, kw_only=True)
class AxisDifference:
    """Two tables of one gyro, (n,) at the nodes of either."""

    temperature_degC: NDArray
    before_deg_h: NDArray
    after_deg_h: NDArray
    change_deg_h: NDArray
    sigma_before_deg_h: NDArray
    sigma_after_deg_h: NDArray


class HasTable(Protocol):
    """A revision, a proposal or a file."""

    @property
    def table(self) -> ThermalTable:
        """What it holds."""


def change_between(before: HasTable, after: HasTable, axis: str) -> AxisDifference:
    """Both tables at the nodes of either, one axis."""
    old, new, k = before.table, after.table, "xyz".index(axis)
    T = np.union1d(old.temperature_degC[k], new.temperature_degC[k])
    return AxisDifference(
        temperature_degC=T,
        before_deg_h=old.bias_deg_h(axis, T),
        after_deg_h=new.bias_deg_h(axis, T),
        change_deg_h=new.bias_deg_h(axis, T) - old.bias_deg_h(axis, T),
        sigma_before_deg_h=old.sigma_deg_h(axis, T),
        sigma_after_deg_h=new.sigma_deg_h(axis, T),
    )


def line_of(r: Revision) -> str:
    runs = f"  {len(r.runs)} run{'s' if len(r.runs) > 1 else ''}" if r.runs else ""
    return f"revision {r.number}  {r.kind:8}  {r.created_utc}  {r.sha256[:12]}{runs}"


def need(condition: object, otherwise: str) -> None:
    if not condition:
        raise InputError(otherwise)


@dataclass(frozen=True, kw_only=True)
class VerifyReport:
    """`recal.verify/1`; faults: those of no unit; revisions: by unit."""

    schema: str = "recal.verify/1"
    store: str
    verdict: StoreVerdict
    reasons: Sequence[str]
    faults: Sequence[str]
    units: Sequence[UnitCheck]
    revisions: Mapping[str, int]


def verify(url: str, heads: Sequence[str], reports: Sequence[Path]) -> VerifyReport:
    """Whether everything in the store is as it was written."""
    given = {str(path): read_json_object(path) for path in reports}
    with TableStore.open(url) as opened:
        return check_document(opened.verify(heads, given), opened.name)


def check_document(check: StoreCheck, store: str) -> VerifyReport:
    """The result; `faults` by unit, and those of no unit."""
    reasons = [f"{u.unit}: {fault}" for u in check.units for fault in u.faults]
    return VerifyReport(
        store=store,
        verdict=check.verdict,
        reasons=[*check.faults, *reasons],
        faults=check.faults,
        units=check.units,
        revisions={str(u.unit): u.revisions for u in check.units},
    )


@dataclass(frozen=True, kw_only=True)
class DecisionReport:
    """`recal.decision/1`; proposal: None, and codes, where the store refused it."""

    schema: str = "recal.decision/1"
    verdict: str
    reasons: Sequence[str] = ()
    reason_codes: Sequence[str] | None = field(default=None, metadata=OMIT_NONE)
    proposal: Proposal | None = field(default=None, metadata=INLINE)


def decide(
    url: str,
    decision: tuple[int, str],
    unit: tuple[str | None, str | None, str | None],
    by: str,
    reason: str,
) -> tuple[DecisionReport, Proposal | None]:
    """The decision on a proposal, (its number, "approved" or "rejected"); None where the store
    refused it.
    """
    number, verdict = decision
    with TableStore.open(url) as opened:
        try:
            decided = opened.decide(number, verdict, *unit, by=by, reason=reason)
        except StoreRefused as error:
            refused = DecisionReport(
                verdict=Outcome.REFUSED, reasons=[str(error)], reason_codes=[str(error.code)]
            )
            return refused, None
    return DecisionReport(verdict=verdict, proposal=decided), decided


def proposed_document(full: FullProposal) -> JsonObject:
    """The update document of a proposal, with its number and what has become of it."""
    found = {**full.report, "proposal": full.number, "proposal_state": full.state}
    return found if full.decision is None else {**found, "decision": plain(full.decision)}


def write_proposal(full: FullProposal, output: Path) -> None:
    """The proposal's update.json and update.html, in a directory."""
    # a store's list loads no page
    from infield.reports.documents.update_records import update_of
    from infield.reports.update_page import update_html

    directory, document = output_directory(output, "table"), proposed_document(full)
    texts = {"update.json": to_json(document), "update.html": update_html(update_of(document))}
    write_files({directory / name: text for name, text in texts.items()})
