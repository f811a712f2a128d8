"""What the store says of a unit's table today, and what makes it stale."""

from dataclasses import replace
from datetime import datetime

import numpy as np

from recal.fleet.document_records import Criteria, TableFacts
from recal.service.store import DEFAULT_SIGMA_deg_h, TableStore, UnitRecord, moment

STALE_DAYS = 365.0  # chosen: 1 year
STALE_SHARE = 0.5  # of the sigma that tables of the technology come with
CRITERIA = Criteria(
    stale_after_days=STALE_DAYS,
    stale_sigma_deg_h={name: STALE_SHARE * sigma for name, sigma in DEFAULT_SIGMA_deg_h.items()},
    stale_contradictions=1,
    surprise_sigmas=3.0,
)


def table_facts(store: TableStore, record: UnitRecord, now: datetime) -> TableFacts:
    """Age since the newest data in it, sigma (RMS over the nodes of the level gyros), sessions that
    contradict it.
    """
    unit, revision = record.unit, record.active
    table = revision.table
    sigma = np.concatenate([table.sigma_deg_h(k, table.temperature_degC[k]) for k in (0, 1)])
    against = store.contradictions(unit.imu_serial, unit.gyro_technology, unit.gyro_mode)
    facts = TableFacts(
        revision=revision.number,
        kind=revision.kind,
        sha256=revision.sha256,
        created_utc=table.created_utc,
        stored_utc=revision.created_utc,
        age_days=round((now - moment(table.created_utc)).total_seconds() / 86400.0, 1),
        sigma_deg_h=float(np.sqrt(np.mean(sigma**2))),
        contradictions=len(against),
        contradicted_by=[evidence.run_id for evidence in against[-5:]],
        stale=(),
    )
    return replace(facts, stale=_stale(facts, unit.gyro_technology))


def _stale(facts: TableFacts, technology: str) -> list[str]:
    """Why the table needs attention; empty where it does not."""
    most = STALE_SHARE * DEFAULT_SIGMA_deg_h[technology]
    reasons = []
    if facts.contradictions:
        several = facts.contradictions > 1
        words = "sessions contradict it" if several else "session contradicts it"
        reasons.append(f"{facts.contradictions} {words}")
    if facts.age_days > STALE_DAYS:
        reasons.append(f"its newest data are {facts.age_days:.0f} days old")
    if facts.sigma_deg_h > most:
        reasons.append(f"sigma {facts.sigma_deg_h:.4f} deg/h over its nodes, above {most:g}")
    return reasons
