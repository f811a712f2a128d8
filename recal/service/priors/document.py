"""`recal.priors/1` (formats.md, section 6): what the sessions kept in a store say of each
technology, of its types and of its units.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from infield.learning.learn import Learnt, LearntFleet, Parameters
from infield.learning.parameters import UNITS, defaults_of
from ins.documents import OMIT_NONE, from_json
from ins.json_file import Json
from ins.records import InputError
from ins.verdicts import Outcome, Reason, because, sentences
from recal.service.priors.reasons import PriorsReason
from recal.service.priors.stored_sessions import SessionLeftOut

PRIORS_SCHEMA = "recal.priors/1"
OUTLIER_NAMED = 0.5  # probability from which a session is named: 1 to 1
HOW_LEARNT = (
    "marginal likelihood of the session points with their covariances; turn-on, flicker, random"
    " walk, ageing, heading errors and table nodes integrated out; log-normal priors about the"
    " defaults; which sessions are outliers summed over; weighted draws of the posterior"
)


@dataclass(frozen=True, kw_only=True)
class PriorScope:
    """The parameters of a technology, a type or a unit; those not shown are the defaults'."""

    name: str
    units: int
    sessions: int
    parameters: Mapping[str, Learnt]


@dataclass(frozen=True, kw_only=True)
class OutlierSession:
    """A session that departs from the others as a whole."""

    imu_serial: str
    run_id: str
    probability: float


@dataclass(frozen=True, kw_only=True)
class PriorsCheck:
    """Squared innovation of the sessions over its expectation, each session against what was known
    before it, outliers left out: with what was learnt, and with the defaults. draws, effective: of
    the check of the curvature.
    """

    squared_innovation: float | None
    squared_innovation_defaults: float | None
    draws: int
    effective_draws: float
    from_draws: bool


@dataclass(frozen=True, kw_only=True)
class TechnologyPriors:
    """What was learnt of one technology; revision: under which it is kept in the store."""

    gyro_technology: str
    technology: PriorScope
    types: Sequence[PriorScope]
    units: Sequence[PriorScope]
    outliers: Sequence[OutlierSession]
    check: PriorsCheck
    notes: Sequence[str] = ()
    note_codes: Sequence[str] = ()
    revision: int | None = field(default=None, metadata=OMIT_NONE)


@dataclass(frozen=True, kw_only=True)
class PriorsReport:
    """The whole file."""

    schema: str = PRIORS_SCHEMA
    verdict: Outcome | str
    reasons: Sequence[str]
    reason_codes: Sequence[str]
    store: str | None
    issued_utc: str
    version: str
    method: str = HOW_LEARNT
    technologies: Sequence[TechnologyPriors] = ()
    left_out: Sequence[SessionLeftOut] = ()


def technology_priors(found: LearntFleet) -> TechnologyPriors:
    """The document of one technology."""
    notes = _notes(found)
    defaults = defaults_of(found.technology)

    def scope(name: str, of: Parameters, units: int, sessions: int) -> PriorScope:
        return PriorScope(
            name=name,
            units=units,
            sessions=sessions,
            parameters={
                str(n): replace(learnt, default=defaults[n], unit=UNITS[n])
                for n, learnt in of.items()
            },
        )

    kinds = [unit.kind for unit in found.units]
    return TechnologyPriors(
        gyro_technology=found.technology,
        technology=scope(found.technology, found.parameters, len(found.units), found.sessions),
        types=[
            scope(
                name,
                parameters,
                kinds.count(name),
                sum(len(unit.sessions) for unit in found.units if unit.kind == name),
            )
            for name, parameters in found.types.items()
        ],
        units=[
            scope(unit.name, parameters, 1, len(unit.sessions))
            for unit, parameters in zip(found.units, found.of_units)
        ],
        outliers=_outliers(found),
        check=_check(found),
        notes=sentences(notes),
        note_codes=[note.code.value for note in notes],
    )


def _outliers(found: LearntFleet) -> list[OutlierSession]:
    told = []
    for u, unit in enumerate(found.units):
        for k, session in enumerate(unit.sessions):
            probability = float(found.evidence.outlier[u, k])
            if probability >= OUTLIER_NAMED:
                told.append(
                    OutlierSession(
                        imu_serial=unit.imu_serial, run_id=session.run_id, probability=probability
                    )
                )
    return told


def _check(found: LearntFleet) -> PriorsCheck:
    sound = (found.evidence.outlier < OUTLIER_NAMED) & (found.evidence.dof > 0)
    dof = float(found.evidence.dof[sound].sum())
    squared = [float(e.nis[sound].sum()) / dof for e in (found.evidence, found.defaults) if dof]
    learnt, default = squared or (None, None)
    return PriorsCheck(
        squared_innovation=learnt,
        squared_innovation_defaults=default,
        draws=found.check.draws,
        effective_draws=found.check.effective,
        from_draws=found.check.used,
    )


def _notes(found: LearntFleet) -> list[Reason]:
    """What these sessions cannot say."""
    hidden = [str(name) for name, learnt in found.parameters.items() if not learnt.shown]
    notes = []
    if hidden:
        notes.append(because(PriorsReason.FEW_SESSIONS, sessions=found.sessions, hidden=hidden))
    if len({unit.imu_serial for unit in found.units}) == 1:
        notes.append(because(PriorsReason.ONE_UNIT))
    if not found.settled:
        notes.append(because(PriorsReason.NOT_SETTLED))
    return notes


def priors_of(data: Mapping[str, Json], *, name: str) -> PriorsReport:
    """The document that a file or a store holds; InputError where it is none."""
    if data.get("schema") != PRIORS_SCHEMA:
        raise InputError(f"{name}: schema {data.get('schema')!r}, needed {PRIORS_SCHEMA!r}")
    return from_json(PriorsReport, data, name=name)
