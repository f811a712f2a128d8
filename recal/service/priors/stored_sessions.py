"""The sessions that a store keeps, as the likelihood takes them.

They are in the reports of the revisions: points with their joint covariance, the crab of each taxi.
A unit's history begins anew where a table came from outside, or was widened for a step.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime

import numpy as np

from infield.learning.stored_sessions import StoredSession, StoredUnit, ordered
from infield.reports.documents.session_records import EstimatedDocument
from infield.reports.documents.update_records import UpdateDocument, update_of
from infield.reports.update_page import estimated_of
from infield.session.disagreement import SessionEvidence, utc
from infield.session.reasons import Nuisance
from infield.store.rows import Revision
from infield.store.table_store import TableStore, UnitRecord
from infield.table.thermal_table import DAYS_PER_YEAR
from ins.records import AXES, InputError
from ins.units import HOUR
from ins.verdicts import Outcome

EPOCH = datetime(2000, 1, 1, tzinfo=UTC)
# a session that contradicted its table is remembered as one mean a gyro: it stands for an hour
CONTRADICTION_S = HOUR


@dataclass(frozen=True)
class SessionLeftOut:
    """A session that cannot be learnt from, and why."""

    imu_serial: str
    run_id: str
    why: str


def year_of(utc_text: str) -> float:
    """A time as years since EPOCH."""
    return (utc(utc_text) - EPOCH).total_seconds() / 86400.0 / DAYS_PER_YEAR


def stored_units(store: TableStore) -> tuple[list[StoredUnit], list[SessionLeftOut]]:
    """Every unit's sessions, a unit twice where its table came from outside in between."""
    units: list[StoredUnit] = []
    left_out: list[SessionLeftOut] = []
    for record in store.units():
        of_unit = _Unit(record, left_out)
        for revision in store.reports(*record.unit.key):
            of_unit.take(revision)
        of_unit.remember(store.contradictions(*record.unit.key))
        units += of_unit.ended()
    return units, left_out


class _Unit:
    """The history of one unit, told revision by revision."""

    def __init__(self, record: UnitRecord, left_out: list[SessionLeftOut]) -> None:
        self._record, self._left_out = record, left_out
        self._begun: list[StoredUnit] = []
        self._sessions: list[StoredSession] = []
        self._first: Revision | None = None
        self._last: Revision | None = None

    def take(self, revision: Revision) -> None:
        """The sessions of a revision, or a new beginning."""
        stepped = _steps(revision) > (0 if self._last is None else _steps(self._last))
        if self._first is None or revision.kind in ("factory", "import") or stepped:
            self._end()
            self._first = revision
        elif revision.report_json is not None:
            self._read(revision)
        self._last = revision

    def remember(self, evidence: Sequence[SessionEvidence]) -> None:
        """Sessions that contradicted the table, as one point a gyro."""
        self._sessions += [_of_contradiction(e) for e in evidence]

    def ended(self) -> list[StoredUnit]:
        """Everything that was told."""
        self._end()
        return self._begun

    def _end(self) -> None:
        if self._first is not None:
            table, key = self._first.table, self._record.unit
            since = year_of(table.created_utc)
            self._begun.append(
                StoredUnit(
                    imu_serial=key.imu_serial,
                    gyro_technology=key.gyro_technology,
                    gyro_mode=key.gyro_mode,
                    table=table,
                    year=since,
                    sessions=ordered(self._sessions),
                )
            )
        self._sessions = []

    def _read(self, revision: Revision) -> None:
        assert revision.report_json is not None
        serial = self._record.unit.imu_serial
        try:
            document = update_of(json.loads(revision.report_json))
        except InputError as error:
            why = f"the report of revision {revision.number} cannot be read ({error})"
            self._left_out.append(SessionLeftOut(serial, "", why))
            return
        for session in estimated_of(document):
            if session.outcome != Outcome.ACCEPTED:
                continue
            try:
                self._sessions.append(_of_document(document, session))
            except InputError as error:
                self._left_out.append(SessionLeftOut(serial, session.run_id, str(error)))


def _steps(revision: Revision) -> int:
    return len(revision.table_dict.get("provenance", {}).get("accepted_steps", []))


def _of_document(document: UpdateDocument, session: EstimatedDocument) -> StoredSession:
    """A session as its report tells it; InputError where the report lacks the covariance."""
    points = [p for p in document.points if p.run_sha256 == session.sha256]
    covariance = session.points_covariance_deg_h2
    if not covariance or len(covariance) != len(points):
        raise InputError("its report holds no joint covariance of the points (an older version)")
    noise = document.noise_model or {}
    vehicle = noise.get("vehicle", {})
    creep = vehicle.get("yaw_creep_arcsec_sqrt_h", 0.0)
    source = session.heading_error.source if session.heading_error else None
    return StoredSession(
        run_id=session.run_id,
        run_sha256=session.sha256,
        year=year_of(session.start_utc),
        axis_index=np.array([AXES.index(p.axis) for p in points]),
        temperature_degC=np.array([p.temperature_degC for p in points]),
        time_s=np.array([p.time_s for p in points]),
        duration_s=np.array([1.0 if p.duration_s is None else p.duration_s for p in points]),
        bias_deg_h=np.array([p.bias_deg_h for p in points]),
        covariance=np.array(covariance, dtype=float),
        run_length_s=session.duration_s,
        yaw_creep_arcsec_sqrt_h=float(creep) if isinstance(creep, int | float) else 0.0,
        crab_mrad=_crab(session),
        heading_source=str(source or ""),
    )


def _crab(session: EstimatedDocument) -> tuple[float, float] | None:
    """What the taxi measured of the crab, without what was believed before."""
    taxi = session.taxi
    for found in taxi.always if taxi else ():
        if found.nuisance != Nuisance.CRAB or not found.sigma:
            continue
        information = found.sigma[0] ** -2.0 - found.prior_sigma[0] ** -2.0
        if information <= 0.0:
            return None
        return found.value[0] * found.sigma[0] ** -2.0 / information, information**-0.5
    return None


def _of_contradiction(e: SessionEvidence) -> StoredSession:
    return StoredSession(
        run_id=e.run_id,
        run_sha256=e.run_sha256,
        year=year_of(e.start_utc),
        axis_index=np.arange(len(AXES)),
        temperature_degC=e.temperature_degC,
        time_s=np.full(len(AXES), 0.5 * CONTRADICTION_S),
        duration_s=np.full(len(AXES), CONTRADICTION_S),
        bias_deg_h=e.bias_deg_h - e.bend_deg_h,
        covariance=e.covariance,
        run_length_s=CONTRADICTION_S,
        yaw_creep_arcsec_sqrt_h=0.0,
    )
