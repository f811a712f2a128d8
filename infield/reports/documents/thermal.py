"""What documents say of thermal models: what those of all models share, and what update.json and
replay.json say of a stored model in use (`thermal_model`).

residual_table: the table less the model's settled part; text: a line for each run.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from infield.table.thermal_table import ThermalTable
from infield.thermal.found_effects import FoundEffect
from infield.thermal.ramp_runs import RampRun
from infield.thermal.reasons import ThermalNote, ThermalVerdict
from infield.thermal.stored_model import Removed, StoredModel, residual_table, taken_out
from infield.thermal.study import ThermalStudy
from ins.records import AXES, TwinModel
from ins.verdicts import Reason, because, codes, sentence, sentences


@dataclass(frozen=True, kw_only=True)
class ThermalDocument:
    """What the document of each thermal model begins with."""

    schema: str
    verdict: ThermalVerdict
    reasons: Sequence[str]
    reason_codes: Sequence[str | None]
    notes: Sequence[str]
    note_codes: Sequence[str | None]
    version: str
    imu_serial: str
    gyro_technology: str


def said_of(study: ThermalStudy, notes: Sequence[Reason], run: RampRun, version: str) -> Any:
    """The fields of `ThermalDocument` and what else all documents of a study say of it, by name.
    run: one of the unit.
    """
    return {
        "verdict": study.verdict,
        "reasons": sentences(study.reasons),
        "reason_codes": codes(study.reasons),
        "notes": sentences(notes),
        "note_codes": codes(notes),
        "version": version,
        "imu_serial": run.imu_serial,
        "gyro_technology": run.gyro_technology,
        "remounted": study.remounted,
        "noise_model": noise_model(study.twin),
    }


@dataclass(frozen=True, kw_only=True)
class NoiseModelDocument:
    """The noise that a thermal model was fitted against."""

    source: str
    white: str = "scatter of the runs' own ten-second sums"
    turn_on_deg_h: float
    bias_instability_deg_h: float
    rate_random_walk_deg_h_sqrt_h: float


def noise_model(twin: TwinModel) -> NoiseModelDocument:
    gyro = twin.gyro
    return NoiseModelDocument(
        source=twin.source,
        turn_on_deg_h=gyro.turn_on_deg_h,
        bias_instability_deg_h=gyro.bias_instability_deg_h,
        rate_random_walk_deg_h_sqrt_h=gyro.rate_random_walk_deg_h_sqrt_h,
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

    file: str
    schema: str
    sha256: str
    part: str = "rates"
    runs: Sequence[Removed]
    residual_table: Mapping[str, ThermalResidualDocument]
    text: Sequence[str]


def use_document(
    stored: StoredModel, removed: Sequence[Removed], table: ThermalTable
) -> ThermalUseDocument:
    """The document of a model that left some runs, beside a table."""
    residual = residual_table(stored, table)
    return ThermalUseDocument(
        file=stored.name,
        schema=stored.schema,
        sha256=stored.sha256,
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
    effect: str
    target: str
    rms_deg_h: Mapping[str, float]
    sigma_deg_h: Mapping[str, float]
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
    return FoundEffectDocument(
        run_id=run_id,
        effect=found.effect,
        target=found.target,
        rms_deg_h=dict(zip(AXES, found.rms_deg_h.tolist())),
        sigma_deg_h=dict(zip(AXES, found.sigma_deg_h.tolist())),
        text=sentence(note),
    )
