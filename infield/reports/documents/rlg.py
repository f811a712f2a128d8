"""`recal.thermal_rlg/1`: what came of the runs as one JSON document; the report draws it,
`thermal.rlg.model` reads it back.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np

from infield.reports.documents.thermal import (
    NoiseModelDocument,
    ThermalDocument,
    ThermalLevel,
    said_of,
)
from infield.thermal.ramp_runs import GradientRun
from infield.thermal.reasons import ThermalNote
from infield.thermal.rlg.fit import RESIDUAL_S, AxisModel, Condition, Residual, TermChoice
from infield.thermal.rlg.gradients import GradientStudy, RlgHeldOut
from infield.thermal.rlg.lag import Lag
from infield.thermal.rlg.model import SCHEMA
from infield.thermal.rlg.terms import TERM_UNITS, TERMS, Collinear
from ins.documents import UNWRITTEN
from ins.records import AXES, Span
from ins.verdicts import Reason, because

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

    run_id: str
    sha256: str
    minutes: int
    heading_known: bool
    temperature_degC: Sequence[float] | None
    rate_degC_min: Sequence[float] | None
    lines: Mapping[str, float]
    sigma_block_deg_h: Sequence[float]
    sigma_rate_degC_min: Sequence[float]
    sigma_gradient_degC: Sequence[float]
    excluded: Sequence[Span]


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

    temperature_degC: Sequence[float]
    bias_deg_h: Sequence[float]
    sigma_deg_h: Sequence[float]
    prior_sigma_deg_h: float


@dataclass(frozen=True, kw_only=True)
class RlgAxisDocument:
    """One fitted gyro."""

    temperature_degC: Sequence[float]
    terms: Mapping[str, TermDocument]
    covariance: Sequence[Sequence[float]]
    about_zero_degC: Mapping[str, float]
    level: ThermalLevel
    rest: RlgRestDocument
    condition: Condition
    collinear: Sequence[Collinear]
    orders: Sequence[TermChoice]
    held_out: Residual
    leave_one_run_out: Residual | None
    temperature_only: Mapping[str, float]
    residual_over_sigma: float
    lag: Lag
    minutes: int


@dataclass(frozen=True, kw_only=True)
class RlgDocument(ThermalDocument):
    """thermal_rlg.json; check: of the runs that were held out; study: what its page is drawn
    from.
    """

    schema: str = SCHEMA
    runs: Sequence[RlgRunDocument]
    remounted: bool
    noise_model: NoiseModelDocument
    model: str = MODEL
    reference_temperature_degC: float
    validation: str
    residual_of_s: float = RESIDUAL_S
    axes: Mapping[str, RlgAxisDocument]
    check: Sequence[RlgHeldOut]
    study: GradientStudy = field(repr=False, compare=False, metadata=UNWRITTEN)


def rlg_document(
    study: GradientStudy, *, checks: Sequence[RlgHeldOut] = (), version: str
) -> RlgDocument:
    """The result of a study, refused or fitted."""
    notes = [*study.notes, *_missing(study)]
    return RlgDocument(
        **said_of(study, notes, study.runs[0].blocks, version),
        runs=[_run(run) for run in study.runs],
        reference_temperature_degC=study.reference_degC,
        validation=study.validation,
        axes={a.axis: _axis(a, study.reference_degC) for a in study.axes},
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


def _run(run: GradientRun) -> RlgRunDocument:
    b = run.blocks
    T, rate = b.temperature_degC[run.usable], b.rate_degC_min[run.usable]
    gradient = run.gradient_degC[run.usable]
    return RlgRunDocument(
        run_id=b.run_id,
        sha256=b.sha256,
        minutes=run.minutes,
        heading_known=b.heading_known,
        temperature_degC=[float(T.min()), float(T.max())] if T.size else None,
        rate_degC_min=[float(rate.min()), float(rate.max())] if rate.size else None,
        lines={axis: float(np.ptp(gradient[:, AXES.index(axis)])) for axis in run.lines},
        sigma_block_deg_h=b.sigma_deg_h.tolist(),
        sigma_rate_degC_min=run.sigma_rate_degC_min.tolist(),
        sigma_gradient_degC=run.sigma_gradient_degC.tolist(),
        excluded=b.excluded,
    )


def _axis(a: AxisModel, reference_degC: float) -> RlgAxisDocument:
    n = len(TERMS)
    return RlgAxisDocument(
        temperature_degC=a.range_degC,
        terms={name: _term(a, k) for k, name in enumerate(TERMS)},
        covariance=a.covariance[:n, :n].tolist(),
        about_zero_degC=about_zero(a, reference_degC),
        level=ThermalLevel(
            value_deg_h=float(a.theta[0]), sigma_deg_h=float(a.sigma[0]), known=a.level_known
        ),
        rest=RlgRestDocument(
            temperature_degC=a.nodes_degC.tolist(),
            bias_deg_h=a.theta[n:].tolist(),
            sigma_deg_h=a.sigma[n:].tolist(),
            prior_sigma_deg_h=a.choice.rest_deg_h,
        ),
        condition=a.condition,
        collinear=a.collinear,
        orders=a.orders,
        held_out=a.held_out,
        leave_one_run_out=a.by_run,
        temperature_only={name: float(a.temperature_only[k]) for k, name in enumerate(TERMS[:3])},
        residual_over_sigma=float(np.sqrt(a.scatter)),
        lag=a.lag,
        minutes=a.rows,
    )


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
