"""Every row of a store against every other: what was changed, deleted, moved or written by
something else.

The chain of record hashes finds a changed or moved row and a hole; the tags, merged runs,
contradictions and approved proposals, which point into the chain, find revisions cut off at its
end. Who rewrites all of these together can only be found with something kept elsewhere: the head,
or a report (`heads_missing`, `report_faults`). Nothing is written.
"""

import itertools
import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

from sqlalchemy import Connection, Table, and_, exc, insert, inspect, select, text

from infield.store.database import schema_of, store_name
from infield.store.errors import RowFault, StoreError
from infield.store.priors_rows import priors_faults
from infield.store.proposal_rows import policy_faults, proposals_of, read_full
from infield.store.rows import (
    UnitKey,
    contradiction_sha256,
    key_of,
    provenance_runs,
    record_sha256,
    runs_held,
    text_sha256,
    unit_of_table,
)
from infield.store.schema import (
    GUARDED,
    SCHEMA_REVISION,
    contradiction,
    decision,
    merged_run,
    proposal,
    revision,
    tag,
    unit,
)
from infield.table.file import table_from_dict
from ins.documents import INLINE
from ins.json_file import JsonObject
from ins.records import InputError
from ins.twin_file import twin_from_dict
from ins.verdicts import Outcome

Rows = dict[int, dict[str, Any]]  # revisions by their number
LEAST_HEAD = 12  # digits of a head that a person types; 12 hexadecimal ones are 48 bits


@dataclass(frozen=True, kw_only=True)
class UnitCheck:
    """One unit: how many revisions, the record hash of the newest, what is broken."""

    unit: UnitKey = field(metadata=INLINE)
    revisions: int
    head_sha256: str | None
    faults: tuple[str, ...]


class StoreVerdict(StrEnum):
    """Whether the rows of a store fit each other."""

    INTACT = "intact"
    BROKEN = "broken"


@dataclass(frozen=True)
class StoreCheck:
    """All units, and what is broken but belongs to none of them."""

    units: tuple[UnitCheck, ...]
    faults: tuple[str, ...]

    @property
    def intact(self) -> bool:
        return not self.faults and not any(u.faults for u in self.units)

    @property
    def verdict(self) -> StoreVerdict:
        return StoreVerdict.INTACT if self.intact else StoreVerdict.BROKEN


def check_store(c: Connection) -> StoreCheck:
    """Everything in the store, read in one transaction."""
    units = c.execute(
        select(unit).order_by(unit.c.imu_serial, unit.c.gyro_technology, unit.c.gyro_mode)
    ).all()
    return StoreCheck(tuple(_checked(c, row) for row in units), tuple(_store_faults(c)))


def lock_unit(c: Connection, key: UnitKey) -> Any:
    """The unit's row, made if new, held until the transaction ends. StoreError where `verify`
    would find the store or this unit broken: nothing is built on rows that do not fit each other.
    """
    same_key = [getattr(unit.c, name) == value for name, value in vars(key).items()]
    query = select(unit).where(and_(*same_key)).with_for_update()
    row = c.execute(query).one_or_none()
    faults = list(_store_faults(c))
    if row is None:
        faults += _renamed(c)
        c.execute(insert(unit).values(**vars(key)))
        row = c.execute(query).one()
    else:
        faults += _checked(c, row).faults
    if faults:
        raise StoreError(
            f"store {store_name(c.engine.url)}: {key}: not written: the store is broken:"
            f" {faults[0]}; recal table verify says all"
        )
    return row


def _renamed(c: Connection) -> Iterable[str]:
    """Units whose first row was written under another key: none is made beside them."""
    first = select(unit, revision).join(revision).where(revision.c.number == 1)
    for row in c.execute(first).all():
        values = {column.name: row._mapping[column] for column in revision.c}
        if values["record_sha256"] != record_sha256(key_of(row), values, ""):
            yield f"{key_of(row)}: revision 1 is of another unit, or was changed"


def _store_faults(c: Connection) -> Iterable[str]:
    """What is broken but belongs to no unit."""
    yield from (*_damage(c), *_orphans(c), *priors_faults(c), *policy_faults(c))


def _checked(c: Connection, row: Any) -> UnitCheck:
    """One unit; a row that SQLite lets be of any type, or of bytes that are no text, breaks this
    unit alone.
    """
    try:
        return _check_unit(c, row)
    except (TypeError, ValueError, AttributeError, exc.OperationalError) as error:
        if c.dialect.name != "sqlite":
            raise
        said = str(getattr(error, "orig", error)).partition("\n")[0]
        return UnitCheck(
            unit=key_of(row),
            revisions=0,
            head_sha256=None,
            faults=(f"a row cannot be read: {said}",),
        )


GUARDS_ON = text(
    "SELECT t.relname FROM pg_trigger g JOIN pg_class t ON t.oid = g.tgrelid WHERE g.tgname ="
    " 'recal_append_only' AND g.tgenabled IN ('O', 'A') AND t.relnamespace ="
    " current_schema()::regnamespace"
)


def _damage(c: Connection) -> Iterable[str]:
    """What SQLite finds wrong with its own file; on PostgreSQL the triggers that are off."""
    if c.dialect.name == "postgresql" and schema_of(c) == SCHEMA_REVISION:
        for name in sorted(set(GUARDED) - set(c.execute(GUARDS_ON).scalars())):
            yield f"{name}: its trigger recal_append_only is off or gone"
    if c.dialect.name == "sqlite":
        for (said,) in c.exec_driver_sql("PRAGMA integrity_check(5)").all():
            if said != "ok":
                yield f"the file is damaged: {said}"


def _orphans(c: Connection) -> Iterable[str]:
    """One statement a table, so that a unit that another transaction makes meanwhile is whole."""
    for table in (revision, tag, merged_run, contradiction, proposal, decision):
        if not _has(c, table):
            continue
        ownerless = table.c.unit_id.not_in(select(unit.c.id))
        if lost := c.execute(select(table.c.unit_id).where(ownerless).distinct()).all():
            yield (
                f"{table.name}: rows of {len(lost)} unit{'s' if len(lost) > 1 else ''} that the"
                " store does not hold"
            )


def _has(c: Connection, table: Table) -> bool:
    return inspect(c).has_table(table.name)


def _check_unit(c: Connection, row: Any) -> UnitCheck:
    found = c.execute(
        select(revision).where(revision.c.unit_id == row.id).order_by(revision.c.number)
    ).all()
    rows: Rows = {stored.number: dict(stored._mapping) for stored in found}
    tags: dict[str, int] = {
        t.name: t.number for t in c.execute(select(tag).where(tag.c.unit_id == row.id)).all()
    }
    only_proposed = not rows and not tags and _has(c, proposal) and bool(proposals_of(c, row))
    faults = (
        []
        if only_proposed
        else [
            *_holes(rows, tags),
            *(fault for k in rows for fault in _revision_faults(key_of(row), rows, k)),
            *_tag_faults(rows, tags),
            *_merged_faults(c, row, rows, tags),
        ]
    )
    faults += [
        *_twin_faults(row, rows),
        *_contradiction_faults(c, row, rows),
        *_proposal_faults(c, row, rows),
    ]
    head = str(rows[max(rows)]["record_sha256"]) if rows else None
    return UnitCheck(unit=key_of(row), revisions=len(rows), head_sha256=head, faults=tuple(faults))


def _holes(rows: Rows, tags: dict[str, int]) -> Iterable[str]:
    for before, number in itertools.pairwise([0, *sorted({*rows, *tags.values(), 1})]):
        if number > before + 2:
            yield f"revisions {before + 1} to {number - 1} are missing"
        elif number == before + 2:
            yield f"revision {before + 1} is missing"
        if number not in rows:
            names = [name for name, tagged in tags.items() if tagged == number]
            tagged_so = f", though tagged {' and '.join(names)}" if names else ""
            yield f"revision {number} is missing{tagged_so}"


def _revision_faults(key: UnitKey, rows: Rows, number: int) -> Iterable[str]:
    """One row by itself, and against the row before it."""
    row, before, name = rows[number], rows.get(number - 1), f"revision {number}"
    if text_sha256(row["table_json"]) != row["sha256"]:
        yield f"{name}: the table was changed, its hash does not match"
    if before is not None or number == 1:
        link = before["record_sha256"] if before else ""
        if row["record_sha256"] != record_sha256(
            key, {k: v for k, v in row.items() if k != "record_sha256"}, link
        ):
            yield (
                f"{name}: the row, or its link to the one before, was changed: the record hash does"
                " not match"
            )
        if row["parent_sha256"] != (before["sha256"] if before else None):
            yield f"{name}: parent_sha256 is not the hash of the table before it"
    if (row["kind"] == "factory") != (number == 1):
        yield f"{name}: its kind is {row['kind']}"
    if (
        row["kind"] == "rollback"
        and rows.get(row["restored_number"], row)["table_json"] != row["table_json"]
    ):
        yield f"{name}: it is not the table of revision {row['restored_number']}"
    yield from _text_faults(key, row, name)


def _text_faults(key: UnitKey, row: dict[str, Any], name: str) -> Iterable[str]:
    """The texts of a row: a table of this unit, a report of this table."""
    try:
        if unit_of_table(table_from_dict(json.loads(row["table_json"]), name=name)) != UnitKey(
            **vars(key)
        ):
            yield f"{name}: the table is of another unit"
    except (InputError, ValueError) as error:
        yield f"{name}: the table cannot be read: {error}"
    report = _report(row["report_json"])
    if report is None:
        yield f"{name}: the report cannot be read"
        return
    for report_key, column in (
        ("table_after_sha256", "sha256"),
        ("table_before_sha256", "parent_sha256"),
    ):
        if report.get(report_key, row[column]) != row[column]:
            yield f"{name}: the report is of another table ({report_key})"


def _report(report_json: str | None) -> JsonObject | None:
    try:
        report = json.loads(report_json or "{}")
    except ValueError:
        return None
    return report if isinstance(report, dict) else None


def _tag_faults(rows: Rows, tags: dict[str, int]) -> Iterable[str]:
    for name, wanted in (("factory", 1), ("active", max(rows, default=1))):
        if name not in tags:
            yield f"tag {name} is missing"
        elif tags[name] != wanted and tags[name] in rows:
            yield f"tag {name} is on revision {tags[name]}, needed {wanted}"


def _merged_faults(c: Connection, row: Any, rows: Rows, tags: dict[str, int]) -> Iterable[str]:
    """The runs said to be merged against those that the revisions name."""
    number, named = tags.get("active", 0), set()
    try:
        while rows[number]["kind"] in ("update", "rollback"):
            named |= {sha256 for _, sha256 in json.loads(rows[number]["runs_json"])}
            number = rows[number]["restored_number"] or number - 1
        named |= provenance_runs(json.loads(rows[number]["table_json"]))
    except (KeyError, ValueError, TypeError):
        return  # the rows it would be compared with are reported
    held = runs_held(c, row)
    for run in sorted(named - held):
        yield f"merged run {run[:12]} is missing"
    for run in sorted(held - named):
        yield f"merged run {run[:12]}: no revision that the active table stands on merged it"


def _twin_faults(row: Any, rows: Rows) -> Iterable[str]:
    if row.twin_json is None:
        if row.twin_sha256 is not None or row.twin_table_sha256 is not None:
            yield "twin: the record is missing"
        return
    if text_sha256(row.twin_json) != row.twin_sha256:
        yield "twin: the row was changed, its hash does not match"
        return
    try:
        twin_from_dict(json.loads(row.twin_json), source="twin", name="twin")
    except (InputError, ValueError) as error:
        yield f"twin: cannot be read: {error}"
    if row.twin_table_sha256 not in {r["sha256"] for r in rows.values()}:
        yield (
            f"twin: the table {str(row.twin_table_sha256)[:12]} that it was imported with is in no"
            " revision"
        )


def _contradiction_faults(c: Connection, row: Any, rows: Rows) -> Iterable[str]:
    if not _has(c, contradiction):
        return
    known = {r["sha256"] for r in rows.values()}
    for stored in c.execute(select(contradiction).where(contradiction.c.unit_id == row.id)).all():
        values, name = dict(stored._mapping), f"contradicting run {stored.run_sha256[:12]}"
        del values["unit_id"]
        if values.pop("record_sha256") != contradiction_sha256(row, values):
            yield f"{name}: the row was changed, its hash does not match"
        elif stored.table_sha256 not in known:
            yield (
                f"{name}: the table {stored.table_sha256[:12]} that it contradicts is in no"
                " revision"
            )


def _proposal_faults(c: Connection, row: Any, rows: Rows) -> Iterable[str]:
    try:
        found = proposals_of(c, row) if _has(c, proposal) else []
    except RowFault as fault:
        yield fault.row
        return
    for light in found:
        try:
            read_full(c, row, light.number)
        except RowFault as fault:
            yield fault.row
        became = light.decision.revision_number if light.decision else None
        if became is not None and rows.get(became, {}).get("sha256") != light.sha256:
            yield (
                f"proposal {light.number}: approved as revision {became}, which does not hold its"
                " table"
            )


def heads_missing(c: Connection, heads: Sequence[str]) -> list[str]:
    """Of record hashes written down earlier (at least 12 digits), what is said of those no longer
    in the store.
    """
    for head in heads:
        if len(head) < LEAST_HEAD or not set(head.lower()) <= set("0123456789abcdef"):
            raise InputError(f"head {head[:80]!r}, needed at least {LEAST_HEAD} hexadecimal digits")
    known = c.execute(select(revision.c.record_sha256)).scalars().all() if heads else []
    lost = [
        head for head in heads if not any(str(record).startswith(head.lower()) for record in known)
    ]
    return [
        f"head {head}: in no chain of the store: revisions were cut off or rewritten"
        for head in lost
    ]


def report_faults(c: Connection, name: str, document: JsonObject) -> list[str]:
    """What of a committed update's report, as written beside the store, is not what the store
    holds.
    """
    if document.get("verdict") != Outcome.COMMITTED:
        raise InputError(
            f"{name}: verdict {document.get('verdict')!r}, needed a report of a committed update"
        )
    found = c.execute(
        select(revision.c.report_json, revision.c.sha256)
        .join(unit)
        .where(unit.c.imu_serial == document.get("imu_serial"))
        .where(unit.c.gyro_technology == document.get("gyro_technology"))
        .where(revision.c.number == document.get("revision"))
    ).all()
    where = f"{name}: {document.get('imu_serial')} revision {document.get('revision')}"
    texts = [
        _report(stored.report_json)
        for stored in found
        if stored.sha256 == document.get("table_after_sha256")
    ]
    if not texts:
        return [f"{where} is {'another table in' if found else 'not in'} the store"]
    added = {"revision", "rollback_command"}  # known only once it is committed
    stored = texts[0] or {}
    differ = [k for k in sorted({*document, *stored} - added) if document.get(k) != stored.get(k)]
    return (
        [f"{where}: the report differs from the stored one in {', '.join(differ)}"]
        if differ
        else []
    )
