"""`recal.thermal_rlg/1`: what came of the runs as one JSON document; the report draws it,
`thermal.rlg.model` reads it back.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from infield.reports.documents.thermal import NoiseModelDocument, ThermalDocument, ThermalLevel
from infield.thermal.ramp_runs import GradientRun
from infield.thermal.reasons import ThermalNote
from infield.thermal.rlg.fit import RESIDUAL_S, AxisModel, Condition, Residual, TermChoice
from infield.thermal.rlg.gradients import GradientStudy, RlgHeldOut
from infield.thermal.rlg.lag import Lag
from infield.thermal.rlg.model import SCHEMA
from infield.thermal.rlg.terms import TERM_UNITS, TERMS, Collinear
from ins.documents import UNWRITTEN, MadeOf, made
from ins.records import AXES, Span
from ins.verdicts import Reason, because, codes, sentences

of = MadeOf[GradientStudy]()
of_run = MadeOf[GradientRun]()
of_axis = MadeOf[AxisModel]()
ENOUGH = 1.2  # held-out residual over the noise floor, above which something is missing: R19
MODEL = (
    "b = K1 + K2 T + K3 T^2 + K4 dT/dt + K5 T dT/dt + K6x Tdiff_x + K6y Tdiff_y + K6z"
    " Tdiff_z + rest(T), T = temperature less the reference, dT/dt in degC/min"
)


class TermState(StrEnum):
    """Why a term is in the model or not."""

    USED = "used"
    COLLINEAR = "collinear"
    NOT_BETTER = "not better on held-out data"
    NO_DATA = "no data"


@dataclass(frozen=True, kw_only=True)
class RlgRunDocument:
    """One run at rest; ranges are None without usable rows."""

    run_id: str = of_run(lambda run: run.blocks.run_id)
    sha256: str = of_run(lambda run: run.blocks.sha256)
    minutes: int = of_run(lambda run: run.minutes)
    heading_known: bool = of_run(lambda run: run.blocks.heading_known)
    temperature_degC: Sequence[float] | None = of_run(
        lambda run: _range(run.blocks.temperature_degC[run.usable])
    )
    rate_degC_min: Sequence[float] | None = of_run(
        lambda run: _range(run.blocks.rate_degC_min[run.usable])
    )
    lines: Mapping[str, float] = of_run(lambda run: _lines(run))
    sigma_block_deg_h: Sequence[float] = of_run(lambda run: run.blocks.sigma_deg_h.tolist())
    sigma_rate_degC_min: Sequence[float] = of_run(lambda run: run.sigma_rate_degC_min.tolist())
    sigma_gradient_degC: Sequence[float] = of_run(lambda run: run.sigma_gradient_degC.tolist())
    excluded: Sequence[Span] = of_run(lambda run: run.blocks.excluded)


@dataclass(frozen=True, kw_only=True)
class TermDocument:
    """One of K1..K6; sigma None where it is not used."""

    value: float
    sigma: float | None
    unit: str
    state: TermState


@dataclass(frozen=True, kw_only=True)
class RlgRestDocument:
    """What of the curve over temperature is no parabola."""

    temperature_degC: Sequence[float] = of_axis(lambda a: a.nodes_degC.tolist())
    bias_deg_h: Sequence[float] = of_axis(lambda a: a.theta[len(TERMS) :].tolist())
    sigma_deg_h: Sequence[float] = of_axis(lambda a: a.sigma[len(TERMS) :].tolist())
    prior_sigma_deg_h: float = of_axis(lambda a: a.choice.rest_deg_h)


@dataclass(frozen=True, kw_only=True)
class RlgAxisDocument:
    """One fitted gyro."""

    temperature_degC: Sequence[float] = of_axis(lambda a: a.range_degC)
    terms: Mapping[str, TermDocument] = of_axis(
        lambda a: {name: _term(a, k) for k, name in enumerate(TERMS)}
    )
    covariance: Sequence[Sequence[float]] = of_axis(
        lambda a: a.covariance[: len(TERMS), : len(TERMS)].tolist()
    )
    about_zero_degC: Mapping[str, float]
    level: ThermalLevel = of_axis(lambda a: _level(a))
    rest: RlgRestDocument = of_axis(lambda a: made(RlgRestDocument, a))
    condition: Condition = of_axis(lambda a: a.condition)
    collinear: Sequence[Collinear] = of_axis(lambda a: a.collinear)
    orders: Sequence[TermChoice] = of_axis(lambda a: a.orders)
    held_out: Residual = of_axis(lambda a: a.held_out)
    leave_one_run_out: Residual | None = of_axis(lambda a: a.by_run)
    temperature_only: Mapping[str, float] = of_axis(
        lambda a: {name: float(a.temperature_only[k]) for k, name in enumerate(TERMS[:3])}
    )
    residual_over_sigma: float = of_axis(lambda a: float(np.sqrt(a.scatter)))
    lag: Lag = of_axis(lambda a: a.lag)
    minutes: int = of_axis(lambda a: a.rows)


@dataclass(frozen=True, kw_only=True)
class RlgDocument(ThermalDocument):
    """thermal_rlg.json; check: of the runs that were held out; study: what its page is drawn
    from.
    """

    schema: str = SCHEMA
    runs: Sequence[RlgRunDocument]
    remounted: bool = of(lambda study: study.remounted)
    noise_model: NoiseModelDocument = of(lambda study: made(NoiseModelDocument, study.twin))
    model: str = MODEL
    reference_temperature_degC: float = of(lambda study: study.reference_degC)
    validation: str = of(lambda study: study.validation)
    residual_of_s: float = RESIDUAL_S
    axes: Mapping[str, RlgAxisDocument]
    check: Sequence[RlgHeldOut]
    study: GradientStudy = field(repr=False, compare=False, metadata=UNWRITTEN)


def rlg_document(
    study: GradientStudy, *, checks: Sequence[RlgHeldOut] = (), version: str
) -> RlgDocument:
    """The result of a study, refused or fitted."""
    notes = [*study.notes, *_missing(study)]
    return made(
        RlgDocument,
        study,
        notes=sentences(notes),
        note_codes=codes(notes),
        imu_serial=study.runs[0].blocks.imu_serial,
        gyro_technology=study.runs[0].blocks.gyro_technology,
        version=version,
        runs=[made(RlgRunDocument, run) for run in study.runs],
        axes={
            a.axis: made(RlgAxisDocument, a, about_zero_degC=about_zero(a, study.reference_degC))
            for a in study.axes
        },
        check=checks,
        study=study,
    )


def _missing(study: GradientStudy) -> list[Reason]:
    """Where the model does not foretell what was held out."""
    return [
        because(
            ThermalNote.HELD_OUT_WORSE,
            axis=a.axis,
            times=a.held_out.model_deg_h / a.held_out.noise_deg_h,
            needed=ENOUGH,
        )
        for a in study.axes
        if a.held_out.model_deg_h > ENOUGH * a.held_out.noise_deg_h
    ]


def _range(values: NDArray) -> list[float] | None:
    return [float(values.min()), float(values.max())] if values.size else None


def _lines(run: GradientRun) -> dict[str, float]:
    """How far each gradient that has a thermometer goes."""
    gradient = run.gradient_degC[run.usable]
    return {axis: float(np.ptp(gradient[:, AXES.index(axis)])) for axis in run.lines}


def _level(a: AxisModel) -> ThermalLevel:
    value, sigma = float(a.theta[0]), float(a.sigma[0])
    return ThermalLevel(value_deg_h=value, sigma_deg_h=sigma, known=a.level_known)


def _term(a: AxisModel, k: int) -> TermDocument:
    name = TERMS[k]
    return TermDocument(
        value=float(a.theta[k]),
        sigma=float(a.sigma[k]) if name in a.used else None,
        unit=TERM_UNITS[name],
        state=_state(a, name),
    )


def _state(a: AxisModel, name: str) -> TermState:
    if name in a.used:
        return TermState.USED
    if name in {found.term for found in a.collinear}:
        return TermState.COLLINEAR
    return TermState.NOT_BETTER if name in a.not_better else TermState.NO_DATA


def about_zero(a: AxisModel, reference_degC: float) -> dict[str, float]:
    """The terms as the document writes them, T counted from 0 degC: K1..K5 mix, K6 is what it
    was.
    """
    K1, K2, K3, K4, K5, *lines = (float(v) for v in a.theta[: len(TERMS)])
    r = reference_degC
    values = (K1 - K2 * r + K3 * r**2, K2 - 2.0 * K3 * r, K3, K4 - K5 * r, K5, *lines)
    return dict(zip(TERMS, values))
