"""Results of an update: of each run, and of all together."""

from dataclasses import dataclass, field

from infield.session.acceptance import Verdict
from infield.session.disagreement import BiasStep, SessionEvidence
from infield.session.estimate import SessionEstimate
from infield.session.flown.gates import FlightEvidence, FlightTerm
from infield.session.hysteresis import ThermalTerm
from infield.session.identity.history import Likeness
from infield.session.identity.marks import UnitMarks
from infield.session.navigated.claim_chain import ClaimChain
from infield.session.points import AxisObservability
from infield.session.settings import SessionSettings
from infield.session.wrong_facts import Suspicion
from infield.table.merge import MergeResult, SessionPoints
from infield.table.thermal_table import AgeingModel, ThermalTable
from infield.thermometer.gyro_temperature import GyroTemperature
from ins.records import Run, TwinModel
from ins.verdicts import Outcome, Reason


@dataclass(frozen=True)
class SessionResult:
    """One run's part in an update; `estimate` and what follows are None where it was refused
    before. doubted: wrong facts that it resembles, but not beyond doubt. flight: None where the run
    does not fly with a receiver. marks: what identifies its unit; likeness: against the unit's
    history, None where there is none.
    """

    run: Run
    verdict: Verdict
    temperature: GyroTemperature | None = None
    estimate: SessionEstimate | None = None
    seen: tuple[AxisObservability, ...] = ()
    points: SessionPoints | None = None
    merged: MergeResult | None = None
    chain: ClaimChain | None = None
    doubted: tuple[Suspicion, ...] = ()
    flight: FlightEvidence | None = None
    marks: UnitMarks | None = None
    likeness: Likeness | None = None


@dataclass(frozen=True)
class UpdateResult:
    """outcome: accepted, refused or inconsistent; `after` is `before` where nothing was merged.

    terms: heating against cooling, per axis; steps: where several sessions agree against the table;
    step_accepted: the table was widened for them; evidence: what is worth remembering of sessions
    that contradict the table; flight_terms: gyros in flight against at rest, over all flights.
    """

    outcome: Outcome
    reasons: tuple[Reason, ...]
    before: ThermalTable
    after: ThermalTable
    sessions: tuple[SessionResult, ...]
    twin: TwinModel
    settings: SessionSettings
    ageing: AgeingModel
    merged_runs: tuple[Run, ...] = field(default_factory=tuple)
    terms: tuple[ThermalTerm, ...] = ()
    steps: tuple[BiasStep, ...] = ()
    step_accepted: bool = False
    evidence: tuple[SessionEvidence, ...] = ()
    flight_terms: tuple[FlightTerm, ...] = ()
