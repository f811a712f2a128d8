"""What documents say of thermal models: what those of all models share, and what update.json and
replay.json say of a stored model in use (`thermal_model`).

residual_table: the table less the model's settled part; text: a line for each run.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from infield.table.thermal_table import ThermalTable
from infield.thermal.found_effects import FoundEffect
from infield.thermal.reasons import ThermalNote, ThermalVerdict
from infield.thermal.stored_model import Removed, StoredModel, residual_table, taken_out
from infield.thermal.study import ThermalStudy
from ins.documents import MadeOf, made
from ins.records import AXES, TwinModel
from ins.verdicts import because, codes, sentence, sentences

of = MadeOf[ThermalStudy]()
of_twin = MadeOf[TwinModel]()
of_model = MadeOf[StoredModel]()
of_effect = MadeOf[FoundEffect]()


@dataclass(frozen=True, kw_only=True)
class ThermalDocument:
    """What the document of each thermal model begins with."""

    schema: str
    verdict: ThermalVerdict = of(lambda study: study.verdict)
    reasons: Sequence[str] = of(lambda study: sentences(study.reasons))
    reason_codes: Sequence[str | None] = of(lambda study: codes(study.reasons))
    notes: Sequence[str]
    note_codes: Sequence[str | None]
    version: str
    imu_serial: str
    gyro_technology: str


@dataclass(frozen=True, kw_only=True)
class NoiseModelDocument:
    """The noise that a thermal model was fitted against."""

    source: str = of_twin(lambda twin: twin.source)
    white: str = "scatter of the runs' own ten-second sums"
    turn_on_deg_h: float = of_twin(lambda twin: twin.gyro.turn_on_deg_h)
    bias_instability_deg_h: float = of_twin(lambda twin: twin.gyro.bias_instability_deg_h)
    rate_random_walk_deg_h_sqrt_h: float = of_twin(
        lambda twin: twin.gyro.rate_random_walk_deg_h_sqrt_h
    )


@dataclass(frozen=True, kw_only=True)
class ThermalLevel:
    """The mean of K_T, or K1, and whether it is known apart from Earth rate."""

    value_deg_h: float
    sigma_deg_h: float
    known: bool


@dataclass(frozen=True, kw_only=True)
class ThermalResidualDocument:
    """One gyro's table less the model's settled part."""

    temperature_degC: Sequence[float]
    bias_deg_h: Sequence[float]


@dataclass(frozen=True, kw_only=True)
class ThermalUseDocument:
    """A model in use."""

    file: str = of_model(lambda stored: stored.name)
    schema: str = of_model(lambda stored: stored.schema)
    sha256: str = of_model(lambda stored: stored.sha256)
    part: str = "rates"
    runs: Sequence[Removed]
    residual_table: Mapping[str, ThermalResidualDocument]
    text: Sequence[str]


def use_document(
    stored: StoredModel, removed: Sequence[Removed], table: ThermalTable
) -> ThermalUseDocument:
    """The document of a model that left some runs, beside a table."""
    residual = residual_table(stored, table)
    return made(
        ThermalUseDocument,
        stored,
        runs=removed,
        residual_table={
            axis: ThermalResidualDocument(temperature_degC=T.tolist(), bias_deg_h=bias.tolist())
            for axis, (T, bias) in residual.items()
        },
        text=sentences(taken_out(stored, removed)),
    )


@dataclass(frozen=True, kw_only=True)
class FoundEffectDocument:
    """An effect of the twin that left the log of a run before the table: its RMS on each gyro, and
    how well it is known.
    """

    run_id: str
    effect: str = of_effect(lambda found: found.effect)
    target: str = of_effect(lambda found: found.target)
    rms_deg_h: Mapping[str, float] = of_effect(lambda f: dict(zip(AXES, f.rms_deg_h.tolist())))
    sigma_deg_h: Mapping[str, float] = of_effect(lambda f: dict(zip(AXES, f.sigma_deg_h.tolist())))
    text: str


def found_effect_document(run_id: str, found: FoundEffect) -> FoundEffectDocument:
    """What to say of an effect that left the log of a run."""
    note = because(
        ThermalNote.EFFECT_TAKEN_OUT,
        run_id=run_id,
        effect=found.effect,
        target=found.target,
        rms_deg_h=float(np.max(found.rms_deg_h)),
        sigma_deg_h=float(np.max(found.sigma_deg_h)),
    )
    return made(FoundEffectDocument, found, run_id=run_id, text=sentence(note))
