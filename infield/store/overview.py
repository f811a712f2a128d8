"""All units at a glance, in three queries however many there are. No hash is checked here: opening
a unit checks its own.
"""

from dataclasses import dataclass

from sqlalchemy import Connection, and_, func, inspect, select

from infield.store.rows import UnitKey, key_of
from infield.store.schema import contradiction, decision, merged_run, proposal, revision, tag, unit


@dataclass(frozen=True, kw_only=True)
class UnitSummary:
    """`undecided`: proposals without a decision; `contradictions`: sessions that contradict the
    active table.
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
    tagged = and_(revision.c.unit_id == tag.c.unit_id, revision.c.number == tag.c.number)
    named = (
        unit.c.id,
        unit.c.imu_serial,
        unit.c.gyro_technology,
        unit.c.gyro_mode,
        unit.c.twin_sha256,
    )
    query = select(
        *named, revision.c.number, revision.c.kind, revision.c.created_utc, revision.c.sha256
    )
    joined = query.select_from(unit.outerjoin(tag, active).outerjoin(revision, tagged))
    rows = c.execute(
        joined.order_by(unit.c.imu_serial, unit.c.gyro_technology, unit.c.gyro_mode)
    ).all()
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
    if not inspect(c).has_table(proposal.name):
        return {}
    same = and_(
        decision.c.unit_id == proposal.c.unit_id, decision.c.proposal_number == proposal.c.number
    )
    query = select(proposal.c.unit_id, func.count().label("n")).select_from(
        proposal.outerjoin(decision, same)
    )
    return {
        r.unit_id: r.n
        for r in c.execute(
            query.where(decision.c.number.is_(None)).group_by(proposal.c.unit_id)
        ).all()
    }


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
