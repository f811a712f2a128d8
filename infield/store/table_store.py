"""The table store: append-only revisions of each unit's thermal table, tags `factory` and `active`,
its twin.

A unit is (imu_serial, gyro_technology, gyro_mode). A revision holds the exact table text, whose
SHA-256 is the table's content hash; a record hash chains each revision to the one before. Both are
checked on every read.
"""

import itertools
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from sqlalchemy import Connection, and_, func, inspect, or_, select, update

from infield.session.disagreement import SessionEvidence
from infield.store.database import Database, store_exists, utc_now
from infield.store.errors import (
    RevisionMoved,
    RowFault,
    RunAlreadyMerged,
    StoreConflict,
    UnknownTableHash,
    UnknownUnit,
)
from infield.store.priors import PriorsStore
from infield.store.proposal_rows import Approval, PolicyRecord, policy_of, set_policy
from infield.store.proposals import (
    FullProposal,
    Proposal,
    ProposalStore,
    commit_revision,
    signed_note,
)
from infield.store.rows import (
    BY_KEY,
    MergedRun,
    NewRevision,
    Revision,
    UnitKey,
    UnitRecord,
    active_number_of,
    active_revision,
    append_contradictions,
    append_revision,
    find_unit,
    key_of,
    last_number,
    provenance_runs,
    read_contradictions,
    read_revision,
    row_fault,
    runs_held,
    runs_of,
    set_runs,
    signed_line,
    signed_text,
    tag_number,
    text_sha256,
    unit_of_table,
    units_with,
)
from infield.store.schema import contradiction, decision, merged_run, proposal, revision, tag, unit
from infield.store.verify import StoreCheck, check_store, heads_missing, lock_unit, report_faults
from infield.table.file import canonical_json, table_from_dict, table_to_dict
from infield.table.thermal_table import ThermalTable
from ins.json_file import JsonObject
from ins.records import InputError, TableDocument, TwinModel
from ins.twin_file import twin_from_dict, twin_to_dict

TAGGED = and_(revision.c.unit_id == tag.c.unit_id, revision.c.number == tag.c.number)


@dataclass(frozen=True, kw_only=True)
class UnitSummary:
    """`undecided`: proposals that wait for a decision, not those that are out of date;
    `contradictions`: sessions that contradict the active table.
    """

    unit: UnitKey
    active_number: int
    kind: str
    created_utc: str
    sha256: str
    has_twin: bool
    undecided: int
    contradictions: int


def read_overview(c: Connection) -> list[UnitSummary]:
    """Every unit that has a table, or a proposal for its first one (active_number 0), by key."""
    undecided, contradicted = _undecided(c), _contradictions(c)
    active = and_(tag.c.unit_id == unit.c.id, tag.c.name == "active")
    named = (unit.c.id, *BY_KEY, unit.c.twin_sha256)
    query = select(
        *named, revision.c.number, revision.c.kind, revision.c.created_utc, revision.c.sha256
    )
    joined = query.select_from(unit.outerjoin(tag, active).outerjoin(revision, TAGGED))
    rows = c.execute(joined.order_by(*BY_KEY)).all()
    return [
        UnitSummary(
            unit=key_of(row),
            active_number=row.number or 0,
            kind=row.kind or "",
            created_utc=row.created_utc or "",
            sha256=row.sha256 or "",
            has_twin=row.twin_sha256 is not None,
            undecided=undecided.get(row.id, 0),
            contradictions=contradicted.get(row.id, 0),
        )
        for row in rows
        if row.number or row.id in undecided
    ]


def _undecided(c: Connection) -> dict[int, int]:
    """How many proposals of each unit are open; what has become out of date is not counted."""
    if not inspect(c).has_table(proposal.name):
        return {}
    same = and_(
        decision.c.unit_id == proposal.c.unit_id, decision.c.proposal_number == proposal.c.number
    )
    active = and_(tag.c.unit_id == proposal.c.unit_id, tag.c.name == "active")
    joined = proposal.outerjoin(decision, same).outerjoin(tag, active).outerjoin(revision, TAGGED)
    base_is_active = or_(revision.c.sha256.is_(None), revision.c.sha256 == proposal.c.parent_sha256)
    query = select(proposal.c.unit_id, func.count().label("n")).select_from(joined)
    found = query.where(decision.c.number.is_(None), base_is_active)
    return {r.unit_id: r.n for r in c.execute(found.group_by(proposal.c.unit_id)).all()}


def _contradictions(c: Connection) -> dict[int, int]:
    if not inspect(c).has_table(contradiction.name):
        return {}
    same = and_(
        merged_run.c.unit_id == contradiction.c.unit_id,
        merged_run.c.run_sha256 == contradiction.c.run_sha256,
    )
    query = select(contradiction.c.unit_id, func.count().label("n")).select_from(
        contradiction.outerjoin(merged_run, same)
    )
    grouped = query.where(merged_run.c.run_sha256.is_(None)).group_by(contradiction.c.unit_id)
    return {r.unit_id: r.n for r in c.execute(grouped).all()}


__all__ = [
    "FullProposal",
    "MergedRun",
    "Proposal",
    "Revision",
    "RunAlreadyMerged",
    "StoreConflict",
    "TableStore",
    "UnitKey",
    "UnitRecord",
    "UnitSummary",
    "UnknownUnit",
    "require_same_unit",
    "store_exists",
]


class TableStore(ProposalStore, PriorsStore):
    """Thermal tables by unit. Every method raises InputError where the store cannot be read or is
    damaged.
    """

    @classmethod
    def open(
        cls,
        url: str,
        create: bool = False,
        *,
        any_clock: bool = False,
        clock: Callable[[], str] = utc_now,
    ) -> "TableStore":
        """The store at an SQLAlchemy URL; with `create` made, or migrated, if need be, else
        InputError if missing.

        A clock more than 300 s behind a unit's newest revision writes nothing, unless `any_clock`.
        clock: tells the time that rows get, ISO 8601 in UTC.
        """
        return cls(Database(url, create=create, any_clock=any_clock, clock=clock))

    def reports(self, serial: str, technology: str, mode: str) -> list[Revision]:
        """All revisions of a unit whose runs the active table holds, and those without runs, oldest
        first: what its sessions were found to say.
        """
        history = self.history(serial, technology, mode)
        with self._database.reading() as c:
            held = runs_held(c, find_unit(c, serial, technology, mode))
        return [r for r in history if not r.runs or any(run.sha256 in held for run in r.runs)]

    def close(self) -> None:
        self._database.close()

    def __enter__(self) -> "TableStore":
        return self

    def __exit__(self, *exc_info: object) -> None:
        self.close()

    @property
    def name(self) -> str:
        """The URL without its password."""
        return self._database.name

    def units(self) -> list[UnitRecord]:
        """All units, by key."""
        with self._database.reading() as c:
            rows = c.execute(units_with(revision).order_by(*BY_KEY)).all()
            return [
                UnitRecord(
                    unit=key_of(row),
                    active=active_revision(c, row),
                    factory_number=tag_number(c, row, "factory"),
                    has_twin=row.twin_json is not None,
                )
                for row in rows
            ]

    def overview(self) -> list[UnitSummary]:
        """All units in short, quick for hundreds of them: their rows are not checked against their
        hashes here.
        """
        with self._database.reading() as c:
            return read_overview(c)

    def undecided(self) -> int:
        """How many proposals wait for a decision, of all units together."""
        with self._database.reading() as c:
            return sum(_undecided(c).values())

    def active(
        self, serial: str | None = None, technology: str | None = None, mode: str | None = None
    ) -> Revision:
        """The revision in use. None matches anything; UnknownUnit where nothing matches, InputError
        where several.
        """
        with self._database.reading() as c:
            return active_revision(c, find_unit(c, serial, technology, mode))

    def previous(
        self, serial: str | None = None, technology: str | None = None, mode: str | None = None
    ) -> Revision | None:
        """The revision before the active one; None for a unit's first."""
        with self._database.reading() as c:
            row = find_unit(c, serial, technology, mode)
            number = active_number_of(c, row) - 1
            return read_revision(c, row, number) if number >= 1 else None

    def revision(
        self,
        number: int,
        serial: str | None = None,
        technology: str | None = None,
        mode: str | None = None,
    ) -> Revision:
        """One revision by its number."""
        with self._database.reading() as c:
            return read_revision(c, find_unit(c, serial, technology, mode), number)

    def history(
        self, serial: str | None = None, technology: str | None = None, mode: str | None = None
    ) -> list[Revision]:
        """All revisions of a unit, oldest first, the whole chain checked."""
        with self._database.reading() as c:
            row = find_unit(c, serial, technology, mode)
            revisions = [read_revision(c, row, k) for k in range(1, last_number(c, row) + 1)]
            for before, after in itertools.pairwise(revisions):
                if after.parent_sha256 != before.sha256:
                    what = f"revision {after.number}: parent hash broken"
                    raise row_fault(c, what, f"{after.unit} ")
            active_number_of(c, row)
            return revisions

    def verify(
        self, heads: Sequence[str] = (), reports: Mapping[str, JsonObject] | None = None
    ) -> StoreCheck:
        """Every row against every other; also that heads and reports (by name) kept elsewhere are
        still in the store.
        """
        with self._database.reading() as c:
            found = check_store(c)
            outside = [
                fault
                for name, document in (reports or {}).items()
                for fault in report_faults(c, name, document)
            ]
            return StoreCheck(found.units, (*found.faults, *heads_missing(c, heads), *outside))

    def by_sha256(self, sha256: str) -> Revision:
        """The table with this content hash, of any unit (to undo what a unit had applied);
        UnknownTableHash if there is none.
        """
        with self._database.reading() as c:
            found = (
                select(revision.c.unit_id, revision.c.number)
                .where(revision.c.sha256 == sha256)
                .limit(1)
            )
            row = c.execute(found).one_or_none()
            if row is None:
                raise UnknownTableHash(f"store {self.name}: no table with sha256 {sha256}")
            owner = c.execute(select(unit).where(unit.c.id == row.unit_id)).one()
            return read_revision(c, owner, row.number)

    def has_run(self, run_sha256: str, serial: str | None = None) -> bool:
        """Whether the active table of a unit (None: of any) holds this run; one that a rollback
        took out does not.
        """
        query = (
            select(merged_run.c.run_sha256).join(unit).where(merged_run.c.run_sha256 == run_sha256)
        )
        if serial is not None:
            query = query.where(unit.c.imu_serial == serial)
        with self._database.reading() as c:
            return c.execute(query.limit(1)).one_or_none() is not None

    def twin(
        self, serial: str | None = None, technology: str | None = None, mode: str | None = None
    ) -> TwinModel | None:
        """The unit's twin record, None where none was imported; its `table` is the path as
        imported, unopened.
        """
        with self._database.reading() as c:
            row = find_unit(c, serial, technology, mode)
        if row.twin_json is None:
            return None
        where = f"store {self.name}: twin of {key_of(row)}"
        if text_sha256(row.twin_json) != row.twin_sha256:
            what = "the row was changed, its hash does not match"
            raise RowFault(f"{where}: {what}", f"twin: {what}")
        return twin_from_dict(json.loads(row.twin_json), source=where, name=where)

    def policy(self) -> PolicyRecord:
        """Who may approve in this store."""
        with self._database.reading() as c:
            return policy_of(c)

    def set_policy(self, approval: Approval, *, by: str, reason: str = "") -> PolicyRecord:
        """Say who may approve from now on; what was said before stays on record."""
        by, reason = signed_line(by, "by"), signed_text(reason, "reason", needed=False)
        return self._database.write(lambda c: set_policy(c, approval, by=by, reason=reason))

    def import_table(
        self,
        table: TableDocument,
        *,
        twin: TwinModel | None = None,
        note: str = "",
        one_person: str | None = None,
    ) -> Revision:
        """A table from outside becomes active; the first is tagged `factory`. The active one again:
        no new revision, unless a note says more than that one's.

        Runs named in its provenance count as merged. The twin becomes the unit's record; serial and
        technology of the two must agree. one_person: who says that from now on one person may put
        updates forward and approve them in this store.
        """
        checked = table_from_dict(table, name="table")
        key = unit_of_table(checked)
        require_same_unit(table, twin)

        def work(c: Connection) -> Revision:
            row = lock_unit(c, key)
            last, text = last_number(c, row), canonical_json(table)
            if one_person is not None:
                set_policy(c, Approval.ONE_PERSON, by=signed_line(one_person, "by"))
            if twin is not None:
                twin_json = json.dumps(twin_to_dict(twin), sort_keys=True)
                c.execute(
                    update(unit)
                    .where(unit.c.id == row.id)
                    .values(
                        twin_json=twin_json,
                        twin_sha256=text_sha256(twin_json),
                        twin_table_sha256=text_sha256(text),
                    )
                )
            if last and (active := active_revision(c, row)).sha256 == text_sha256(text):
                if note in ("", active.note):
                    return active
            kind = "import" if last else "factory"
            append_revision(c, row, NewRevision(kind=kind, table_json=text, note=note))
            set_runs(c, row, provenance_runs(table))
            return active_revision(c, row)

        return self._database.write(work)

    def commit_update(
        self,
        parent_sha256: str,
        table: ThermalTable,
        runs: Sequence[MergedRun],
        report_json: str,
        *,
        first_table: TableDocument | None = None,
        note: str = "",
    ) -> Revision:
        """A recalibrated table becomes active, in one transaction or not at all.

        `table.provenance["parent_sha256"]` must be `parent_sha256`, the hash of the table it was
        made from. Where the unit is not in the store yet, `first_table` is that table, and becomes
        its factory revision.

        Raises StoreConflict if another table is active by now, RunAlreadyMerged if it holds one of
        the runs.
        """
        text = canonical_json(table_to_dict(table))
        if table.provenance.get("parent_sha256") != parent_sha256:
            raise ValueError(
                "provenance.parent_sha256 is not the parent that the update is committed to"
            )

        first = None if first_table is None else canonical_json(first_table)
        new = NewRevision(
            kind="update", table_json=text, runs=runs, report_json=report_json, note=note
        )

        def work(c: Connection) -> Revision:
            return commit_revision(c, lock_unit(c, unit_of_table(table)), parent_sha256, new, first)

        return self._database.write(work)

    def remember_contradictions(
        self, serial: str, technology: str, mode: str, evidence: Sequence[SessionEvidence]
    ) -> int:
        """Keep what sessions said that contradicted the active table, which stays; the number of
        new rows.
        """

        def work(c: Connection) -> int:
            row = lock_unit(c, key_of(find_unit(c, serial, technology, mode)))
            return append_contradictions(c, row, active_revision(c, row).sha256, evidence)

        return self._database.write(work)

    def contradictions(
        self, serial: str, technology: str, mode: str
    ) -> tuple[SessionEvidence, ...]:
        """What is remembered of sessions that contradicted the table and that it does not hold by
        now.
        """
        with self._database.reading() as c:
            return read_contradictions(c, find_unit(c, serial, technology, mode))

    def rollback(
        self,
        serial: str | None = None,
        to: int | str = "factory",
        technology: str | None = None,
        mode: str | None = None,
        *,
        by: str,
        reason: str,
        active_number: int | None = None,
    ) -> Revision:
        """A new revision with the bits of an old one: its number, "factory" or "previous". Its note
        names who took the table back and why, and a rollback that the active one is already.

        StoreConflict where another revision than `active_number` (None: any) is active by now,
        InputError where `by` or `reason` are missing.
        """
        note = signed_note(by, reason, "rolled back by ")

        def work(c: Connection) -> Revision:
            row = lock_unit(c, key_of(find_unit(c, serial, technology, mode)))
            active = active_number_of(c, row)
            if active_number not in (None, active):
                raise RevisionMoved(
                    f"{key_of(row)}: revision {active} is active now, not {active_number}; look"
                    " again"
                )
            names = {"factory": tag_number(c, row, "factory"), "previous": active - 1}
            number = names.get(to, 0) if isinstance(to, str) else to
            if to == "previous" and not number:
                raise InputError(
                    f"{key_of(row)}: revision {active} is active, there is none before it"
                )
            if number == active:
                raise InputError(
                    f"{key_of(row)}: revision {number} is the active one, nothing to roll back"
                )
            target = read_revision(c, row, number)
            undone = read_revision(c, row, active)
            again = f"rollback of a rollback (revision {active}): "
            restored = NewRevision(
                kind="rollback",
                table_json=target.table_json,
                restored_number=number,
                note=again + note if undone.kind == "rollback" else note,
            )
            append_revision(c, row, restored)
            set_runs(c, row, runs_of(c, row, target))
            return active_revision(c, row)

        return self._database.write(work)


def require_same_unit(table: TableDocument, twin: TwinModel | None) -> None:
    """InputError where a twin is of another technology, or names another serial, than the table it
    comes with.
    """
    serial, technology = table["imu_serial"], table["gyro_technology"]
    if twin is not None and (
        twin.imu_serial not in ("", serial) or twin.gyro_technology != technology
    ):
        raise InputError(
            f"twin of {twin.imu_serial or 'any'} ({twin.gyro_technology}), the table is of {serial}"
            f" ({technology})"
        )
