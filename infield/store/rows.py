"""Rows of the table store as records: find a unit, read and check a revision, append one.

Every function works inside the caller's transaction; InputError where a row is missing or was
changed.

Decision: docs/decisions/0022-sqlite-journal.md.
"""

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from datetime import datetime
from typing import Any

from sqlalchemy import (
    Connection,
    Select,
    Table,
    and_,
    delete,
    func,
    insert,
    inspect,
    select,
    update,
)

from infield.session.disagreement import SessionEvidence
from infield.store.database import store_name
from infield.store.errors import RowFault, StoreError, UnknownUnit
from infield.store.schema import contradiction, merged_run, proposal, revision, tag, unit
from infield.table.file import table_from_dict
from infield.table.thermal_table import ThermalTable
from ins.documents import INLINE, UNWRITTEN, written_as
from ins.records import InputError, TableDocument

# clocks of two machines; tests/infield/test_store_faults.py writes 4 min behind
CLOCK_SLACK_S = 300.0


@dataclass(frozen=True, kw_only=True, order=True)
class UnitKey:
    """What a table belongs to."""

    imu_serial: str
    gyro_technology: str
    gyro_mode: str = ""

    def __str__(self) -> str:
        mode = f", {self.gyro_mode}" if self.gyro_mode else ""
        return f"{self.imu_serial} ({self.gyro_technology}{mode})"


@dataclass(frozen=True, kw_only=True)
class MergedRun:
    """A run that a table was made from: its id for people, its content hash for the store."""

    run_id: str
    sha256: str


@dataclass(frozen=True, kw_only=True)
class Revision:
    """One stored table, in JSON without its texts. `runs` are those merged by this revision;
    `restored_number`: whose table a rollback is.
    """

    unit: UnitKey = field(metadata=INLINE)
    number: int = field(metadata=written_as("revision"))
    kind: str
    created_utc: str
    sha256: str
    parent_sha256: str | None
    restored_number: int | None = field(metadata=written_as("restored_revision"))
    note: str
    runs: tuple[MergedRun, ...]
    table_json: str = field(metadata=UNWRITTEN)
    report_json: str | None = field(metadata=UNWRITTEN)

    @property
    def table_dict(self) -> TableDocument:
        """The table as formats.md section 2 writes it."""
        document: TableDocument = json.loads(self.table_json)
        return document

    @property
    def table(self) -> ThermalTable:
        return table_from_dict(self.table_dict, name=f"{self.unit} revision {self.number}")


@dataclass(frozen=True, kw_only=True)
class NewRevision:
    """What a unit's next revision is to hold; the fields are those of `Revision`."""

    kind: str
    table_json: str
    runs: Sequence[MergedRun] = ()
    restored_number: int | None = None
    report_json: str | None = None
    note: str = ""


@dataclass(frozen=True, kw_only=True)
class UnitRecord:
    """A unit at a glance."""

    unit: UnitKey
    active: Revision
    factory_number: int
    has_twin: bool


def append_revision(c: Connection, row: Any, new: NewRevision) -> None:
    """The next revision of a unit, chained to the last, tagged `active` (the first also
    `factory`).
    """
    last = last_number(c, row)
    before = tagged(c, row, "active") if last else None
    now_utc = now_of(c)
    if before is not None and not c.get_execution_options().get("any_clock"):
        _require_later(before, now_utc)
    values: dict[str, Any] = {
        "unit_id": row.id,
        "number": last + 1,
        "kind": new.kind,
        "sha256": text_sha256(new.table_json),
        "created_utc": now_utc,
        "parent_sha256": before.sha256 if before else None,
        "table_json": new.table_json,
        "runs_json": json.dumps([[run.run_id, run.sha256] for run in new.runs]),
        "restored_number": new.restored_number,
        "report_json": new.report_json,
        "note": new.note,
    }
    values["record_sha256"] = record_sha256(key_of(row), values, _record_before(c, row, last + 1))
    c.execute(insert(revision).values(**values))
    if last == 0:
        for name in ("factory", "active"):
            c.execute(insert(tag).values(unit_id=row.id, name=name, number=1))
    else:
        c.execute(
            update(tag)
            .where(and_(tag.c.unit_id == row.id, tag.c.name == "active"))
            .values(number=last + 1)
        )


def _require_later(before: Revision, now_utc: str) -> None:
    """InputError where the clock is behind the newest revision by more than clocks of several
    writers differ.
    """
    behind = datetime.fromisoformat(before.created_utc) - datetime.fromisoformat(now_utc)
    if behind.total_seconds() > CLOCK_SLACK_S:
        raise InputError(
            f"{before.unit}: the clock says {now_utc}, revision {before.number} was written at"
            f" {before.created_utc}: set the clock (--any-clock if that revision's was wrong);"
            " nothing written"
        )


def tagged(c: Connection, row: Any, name: str) -> Revision:
    """The revision that a tag points at; InputError where `active` is not on the last."""
    return read_revision(
        c, row, active_number_of(c, row) if name == "active" else tag_number(c, row, name)
    )


def active_number_of(c: Connection, row: Any) -> int:
    """The number of the active revision, 0 where the unit has none; InputError where it is not the
    last.
    """
    number, last = tag_number(c, row, "active"), last_number(c, row)
    if number != last:
        where = f"on revision {number}, not on the last ({last})" if number else "missing"
        said = f"store {store_name(c.engine.url)}: {key_of(row)}: tag active is {where}"
        raise StoreError(f"{said}: the store was changed by hand; recal table verify")
    return number


def read_revision(c: Connection, row: Any, number: int) -> Revision:
    """One revision, its content and its place in the chain checked."""
    found = c.execute(
        select(revision).where(and_(revision.c.unit_id == row.id, revision.c.number == number))
    )
    stored = found.one_or_none()
    if stored is None:
        last = last_number(c, row)
        needed = f"1 to {last}" if last > 1 else "1, the only one"
        raise InputError(f"{key_of(row)}: no revision {number}, needed {needed}")
    values = dict(stored._mapping)
    record = values.pop("record_sha256")
    content_intact = text_sha256(values["table_json"]) == values["sha256"]
    if not content_intact or record != record_sha256(
        key_of(row), values, _record_before(c, row, number)
    ):
        what = f"revision {number}: the row was changed, its hash does not match"
        raise RowFault(f"store {store_name(c.engine.url)}: {key_of(row)} {what}", what)
    runs = tuple(MergedRun(run_id=i, sha256=s) for i, s in json.loads(values.pop("runs_json")))
    del values["unit_id"]
    return Revision(unit=key_of(row), runs=runs, **values)


def runs_of(c: Connection, row: Any, of: Revision) -> set[str]:
    """All runs that a revision's table was made from: back to the table from outside that it stands
    on.
    """
    held: set[str] = set()
    while of.kind in ("update", "rollback"):
        held |= {run.sha256 for run in of.runs}
        of = read_revision(c, row, of.restored_number or of.number - 1)
    return held | provenance_runs(of.table_dict)


def units_with(rows_of: Table) -> Select:
    """The units that have at least one row there (revision or proposal): a proposal's unit may have
    no table yet.
    """
    return select(unit).where(unit.c.id.in_(select(rows_of.c.unit_id)))


def find_unit(
    c: Connection,
    serial: str | None,
    technology: str | None,
    mode: str | None,
    *,
    proposal_number: int | None = None,
) -> Any:
    """The one unit row that matches, with a table, or where a number is given with that proposal;
    None matches anything. UnknownUnit if none, InputError if several do.
    """
    having, what = (revision, "table") if proposal_number is None else (proposal, "proposal")
    query = units_with(having)
    rows = c.execute(query if serial is None else query.where(unit.c.imu_serial == serial)).all()
    if not rows:
        raise UnknownUnit(
            f"no {what} for serial {serial}" if serial is not None else f"the store holds no {what}"
        )
    wanted = [row for row in rows if technology in (None, row.gyro_technology)]
    known = "; ".join(str(key_of(row)) for row in rows[:8])
    if not wanted:
        raise InputError(
            f"serial {serial} is {known} in the store, not {technology}: another unit?"
        )
    wanted = [row for row in wanted if mode in (None, row.gyro_mode)]
    if not wanted:
        raise UnknownUnit(
            f"no {what} for serial {serial} in gyro mode {mode!r}; the store has {known}"
        )
    if proposal_number is not None:
        of_number = select(proposal.c.unit_id).where(proposal.c.number == proposal_number)
        owners = set(c.execute(of_number).scalars())
        wanted = [row for row in wanted if row.id in owners]
        if not wanted:
            of = "" if serial is None else f" of serial {serial}"
            raise InputError(f"no proposal {proposal_number}{of}; recal table proposals lists all")
    if len(wanted) > 1:
        raise InputError(
            f"the store holds several units ({known}): name one (serial, technology, mode)"
        )
    return wanted[0]


def key_of(row: Any) -> UnitKey:
    """The key of a unit row."""
    return UnitKey(
        imu_serial=row.imu_serial, gyro_technology=row.gyro_technology, gyro_mode=row.gyro_mode
    )


def unit_of_table(table: ThermalTable) -> UnitKey:
    """The unit that a table says it belongs to."""
    return UnitKey(
        imu_serial=table.imu_serial,
        gyro_technology=table.gyro_technology,
        gyro_mode=table.gyro_mode,
    )


def last_number(c: Connection, row: Any) -> int:
    """The number of a unit's newest revision, 0 where it has none."""
    return (
        c.execute(select(func.max(revision.c.number)).where(revision.c.unit_id == row.id)).scalar()
        or 0
    )


def tag_number(c: Connection, row: Any, name: str) -> int:
    """The revision number under a tag, 0 where it is not set."""
    return (
        c.execute(
            select(tag.c.number).where(and_(tag.c.unit_id == row.id, tag.c.name == name))
        ).scalar()
        or 0
    )


def _record_before(c: Connection, row: Any, number: int) -> str:
    query = select(revision.c.record_sha256).where(
        and_(revision.c.unit_id == row.id, revision.c.number == number - 1)
    )
    return c.execute(query).scalar() or ""


def record_sha256(key: UnitKey, values: dict[str, Any], before: str) -> str:
    content = {
        k: v for k, v in values.items() if k not in ("unit_id", "record_sha256", "table_json")
    }
    return row_sha256([before, vars(key), content])


def runs_held(c: Connection, row: Any) -> set[str]:
    """Content hashes of the runs that the active table holds."""
    return set(
        c.execute(select(merged_run.c.run_sha256).where(merged_run.c.unit_id == row.id)).scalars()
    )


def set_runs(c: Connection, row: Any, runs: set[str]) -> None:
    """Write down which runs the active table holds: those not there yet, and away with those it
    holds no more.
    """
    held = runs_held(c, row)
    for sha256 in sorted(held - runs):
        c.execute(
            delete(merged_run).where(
                and_(merged_run.c.unit_id == row.id, merged_run.c.run_sha256 == sha256)
            )
        )
    for sha256 in sorted(runs - held):
        c.execute(insert(merged_run).values(unit_id=row.id, run_sha256=sha256))


def provenance_runs(table: TableDocument) -> set[str]:
    """Content hashes in `provenance.runs`: plain, or under the key sha256."""
    runs = table.get("provenance", {}).get("runs") or []
    return {
        s
        for s in (r.get("sha256") if isinstance(r, dict) else r for r in runs)
        if isinstance(s, str) and s
    }


def now_of(c: Connection) -> str:
    """The time written into rows: the store's clock, ISO 8601 in UTC."""
    return str(c.get_execution_options()["clock"]())


def row_sha256(content: Any) -> str:
    """SHA-256 of a row's columns; bytes, which no column of a store holds, give a hash that no row
    was written with.
    """
    return text_sha256(
        json.dumps(content, sort_keys=True, default=lambda value: {"not a text": repr(value)})
    )


def text_sha256(text: Any) -> str:
    """SHA-256 of a text, hexadecimal; what is no text (bytes put into the column by hand) has none
    and equals no hash.
    """
    return hashlib.sha256(text.encode()).hexdigest() if isinstance(text, str) else "not a text"


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
