"""What `update.json` (formats.md, section 5) holds, as records; `documents.update` fills them.

What formats.md does not promise of a file may be missing from an older one: it has a default here.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum

from infield.reports.documents.alignment import NoiseFit
from infield.reports.documents.session_records import (
    EstimatedDocument,
    HeadingError,
    SessionDocument,
)
from infield.reports.documents.thermal import FoundEffectDocument, ThermalUseDocument
from infield.session.disagreement import BiasStep
from infield.session.flown.gates import FlightTerm
from infield.session.hysteresis import ThermalTerm
from infield.session.points import AxisObservability
from infield.session.results import UpdateResult
from infield.table.merge import AXIS_Z_LIMIT, MergeResult
from ins.documents import OMIT_NONE, MadeOf, Null, from_json, made
from ins.json_file import JsonObject
from ins.records import Run, Span, TableDocument
from ins.twin_file import TwinDocument
from ins.verdicts import Observability, Outcome, codes, differs, sentences

of = MadeOf[UpdateResult]()
of_merge = MadeOf[MergeResult]()
of_run = MadeOf[Run]()


@dataclass(frozen=True, kw_only=True)
class RunDocument:
    """A run and its content hash."""

    run_id: str = of_run(lambda run: run.header.run_id)
    sha256: str = of_run(lambda run: run.sha256)


@dataclass(frozen=True, kw_only=True)
class PointDocument:
    """The total bias of one gyro over one bin; time_s: its centre; phase: the one it lies in.

    sigma_common_deg_h: of the error that all points of this gyro and run share; sigma_own_deg_h: of
    what is the point's own. Their squares add up to that of sigma_deg_h.
    """

    axis: str
    time_s: float
    temperature_degC: float
    bias_deg_h: float
    sigma_deg_h: float
    temperature_rate_degC_min: float = 0.0
    start_s: float | None = None
    duration_s: float | None = None
    gradient_degC: float | None = None
    sigma_temperature_degC: float | None = None
    sigma_temperature_rate_degC_min: float | None = None
    run_id: str | None = None
    run_sha256: str | None = None
    applied_table_sha256: str | None = None
    observability: Observability | str | None = None
    phase: str | None = None
    sigma_common_deg_h: float | None = None
    sigma_own_deg_h: float | None = None


@dataclass(frozen=True, kw_only=True)
class MergeDocument:
    """One session against the table."""

    run_id: str
    nis: float = of_merge(lambda merged: merged.nis)
    dof: int = of_merge(lambda merged: merged.dof)
    band_999: Sequence[float] = of_merge(lambda merged: merged.band)
    axis_shift_sigmas: Sequence[float] = of_merge(lambda merged: merged.axis_z.tolist())
    axis_shift_limit_sigmas: float = AXIS_Z_LIMIT


@dataclass(frozen=True, kw_only=True)
class ConsistencyDocument:
    """The residuals of all sessions against the noise model; None without any."""

    nis_mean: float | None
    dof: int
    band_95: Sequence[float] | None
    band_999: Sequence[float] | None = None
    merge: Sequence[MergeDocument] = ()


@dataclass(frozen=True, kw_only=True)
class BudgetDocument:
    """A term of the session's mean bias alone, one sigma."""

    axis: str
    term: str
    sigma_deg_h: float


@dataclass(frozen=True, kw_only=True)
class VarianceShares:
    """Where the variance of the new table comes from: shares by source (`VarianceSource`), which
    add up to 1. Of one node, or (temperature_degC null) of the mean over the temperatures visited.
    """

    axis: str
    temperature_degC: float | None
    sigma_deg_h: float
    shares: Mapping[str, float]


@dataclass(frozen=True, kw_only=True)
class MethodDocument:
    """By what the numbers were made."""

    name: str
    program: str
    version: str


@dataclass(frozen=True, kw_only=True)
class PredictedEffect:
    """What the change means at the temperatures visited, the new table taken as the better one."""

    level_change_deg_h: float
    drift_removed_nm_h: float
    drift_left_sigma_nm_h: float
    heading_removed_mrad: float
    heading_left_sigma_mrad: float
    temperature_degC: tuple[float, float]

    @property
    def significant(self) -> bool:
        """Whether the drift that is removed is more than chance makes it in 19 of 20 cases."""
        return differs(self.drift_removed_nm_h, self.drift_left_sigma_nm_h)


@dataclass(frozen=True, kw_only=True)
class ZeroRateEffect:
    """The change of the table over the temperatures of the last merged session, its level and its
    shape apart.
    """

    level_change_deg_h: float
    shape_change_deg_h: float
    level_left_sigma_deg_h: float
    shape_left_sigma_deg_h: float
    turn_on_deg_h: float
    earth_rate_deg_h: float
    temperature_degC: tuple[float, float]


@dataclass(frozen=True, kw_only=True)
class ChangeDocument:
    """A node of the new table beside the old table at its temperature."""

    axis: str
    temperature_degC: float
    before_deg_h: float
    U_before_k2_deg_h: float
    after_deg_h: float
    U_after_k2_deg_h: float
    change_deg_h: float


@dataclass(frozen=True, kw_only=True)
class DisagreementDocument:
    """Where several sessions agree against the table, and whether that was followed."""

    steps: Sequence[BiasStep] = of(lambda result: result.steps)
    accepted: bool = of(lambda result: result.step_accepted)


@dataclass(frozen=True, kw_only=True)
class PriorsUse:
    """The learnt priors that the update went by: source (`approved` or a file), scope (the unit,
    else its technology), and their values by name; text: the same for people.
    """

    source: str
    gyro_technology: str
    scope: str
    revision: int | None
    sha256: str | None
    parameters: Mapping[str, float]
    text: str


@dataclass(frozen=True, kw_only=True)
class EffectsOutcome:
    """What an update said, in the numbers that found effects move; None where it has none.

    merge_nis: of all sessions against the table, per degree of freedom.
    """

    verdict: Outcome | str
    heading_error: HeadingError
    nis_mean: float | None
    merge_nis: float | None
    level_change_deg_h: float | None
    drift_removed_nm_h: float | None


@dataclass(frozen=True, kw_only=True)
class EffectsCompared:
    """The update with the twin's effects out of the log, as it stands, and with them left in."""

    taken_out: EffectsOutcome
    left_in: EffectsOutcome


class ProposalState(StrEnum):
    """Where a proposal stands; out of date: another table is active by now."""

    OPEN = "open"
    OUT_OF_DATE = "out of date"
    APPROVED = "approved"
    REJECTED = "rejected"


@dataclass(frozen=True, kw_only=True)
class DecisionDocument:
    """What was decided on a proposal; revision: that an approved one became."""

    by: str
    decided_utc: str
    reason: str
    revision: int | None = None


@dataclass(frozen=True, kw_only=True)
class UpdateDocument:
    """The whole file. Tables and noise model stand as formats.md writes them.

    conflicts: with other writers, before the table was estimated against the active one;
    remembered: what became of contradicting sessions; proposal: under which number it is kept,
    proposal_state and decision: what has become of it since.
    new_unit: what an update of a unit without a table rests on.
    noise_note: that sigma rests on the defaults of the technology, where it does; noise_fit:
    whether the noise model fits the runs.
    """

    schema: str
    verdict: Outcome | str
    reasons: Sequence[str] = of(lambda result: sentences(result.reasons))
    reason_codes: Sequence[str | None] = of(lambda result: codes(result.reasons), default=())
    imu_serial: str = of(lambda result: result.before.imu_serial)
    gyro_technology: str | None = of(lambda result: result.before.gyro_technology, default=None)
    runs: Sequence[RunDocument] = of(lambda r: [made(RunDocument, s.run) for s in r.sessions])
    heading_error: HeadingError
    observability: Mapping[str, AxisObservability]
    points: Sequence[PointDocument]
    excluded: Sequence[Span]
    consistency: ConsistencyDocument
    table_before: TableDocument
    table_after: TableDocument
    uncertainty_budget: Sequence[BudgetDocument]
    variance_shares: Sequence[VarianceShares] = ()
    table_before_sha256: str | None = None
    table_after_sha256: str | None = None
    method: MethodDocument | None = None
    issued_utc: str | None = None
    store: str | None = None
    revision: int | None = None
    rollback_command: str | None = None
    decision_rule: str | None = None
    noise_model: TwinDocument | None = None
    new_unit: Sequence[str] | None = field(default=None, metadata=OMIT_NONE)
    noise_source: str | None = field(default=None, metadata=OMIT_NONE)
    noise_note: str | None = field(default=None, metadata=OMIT_NONE)
    noise_fit: NoiseFit | None = field(default=None, metadata=OMIT_NONE)
    priors: PriorsUse | None = field(default=None, metadata=OMIT_NONE)
    assumptions: Sequence[str] = ()
    predicted_effect: PredictedEffect | None = None
    zero_rate_effect: ZeroRateEffect | Null | None = field(default=None, metadata=OMIT_NONE)
    changes: Sequence[ChangeDocument] = ()
    hysteresis: Sequence[ThermalTerm] = of(lambda result: result.terms, default=())
    flight_terms: Sequence[FlightTerm] | None = of(
        lambda result: result.flight_terms or None, OMIT_NONE, default=None
    )
    disagreement: DisagreementDocument | None = of(
        lambda result: made(DisagreementDocument, result), default=None
    )
    sessions: Sequence[EstimatedDocument | SessionDocument] = ()
    thermal_model: ThermalUseDocument | None = field(default=None, metadata=OMIT_NONE)
    found_effects: Sequence[FoundEffectDocument] | None = field(default=None, metadata=OMIT_NONE)
    effects_compared: EffectsCompared | None = field(default=None, metadata=OMIT_NONE)
    conflicts: Sequence[str] | None = field(default=None, metadata=OMIT_NONE)
    remembered: str | None = field(default=None, metadata=OMIT_NONE)
    proposal: int | None = field(default=None, metadata=OMIT_NONE)
    proposal_state: ProposalState | None = field(default=None, metadata=OMIT_NONE)
    decision: DecisionDocument | None = field(default=None, metadata=OMIT_NONE)

    @property
    def run_ids(self) -> list[str]:
        """Of the sessions, in their order."""
        return [session.run_id for session in self.sessions]


def update_of(data: JsonObject) -> UpdateDocument:
    """The update that an `update.json` holds, of this version or an older one.

    Parameters
    ----------
    data : Mapping
        From JSON.

    Returns
    -------
    document : UpdateDocument

    Raises
    ------
    InputError
        Where it is none.
    """
    return from_json(UpdateDocument, data, name="not an update document")
