"""`recal.thermal_fog/1`: what came of the ramps as one JSON document; the report draws it,
`thermal.fog.model` reads it back.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from infield.reports.documents.thermal import NoiseModelDocument, ThermalDocument, ThermalLevel
from infield.thermal.fog.fixed_point import FixedTable, fixed_table, worst_error_deg_h
from infield.thermal.fog.model import SCHEMA, FogCurves, FogModel, HeldOutResidual, shifted
from infield.thermal.fog.piecewise import Breakpoint, Piecewise, PiecewisePair, piecewise_pair
from infield.thermal.fog.ramps import Curves, Hysteresis, RampFit, RampStudy
from infield.thermal.ramp_runs import RampRun
from ins.documents import MadeOf, made
from ins.verdicts import codes, sentences

DAY_S = 86400.0
of = MadeOf[RampStudy]()
of_axis = MadeOf[RampFit]()
of_pair = MadeOf[PiecewisePair]()


def admissible_slow_rate(
    K_per_degC_min: float, K_at_test_rate: float, test_rate: float, allowed_deg_h: float
) -> tuple[float, float]:
    """Largest slow rate [degC/min] for which the gradient term stays below `allowed_deg_h`, by both
    readings of the formula.

    K at 1 degC/min [deg/h per degC/min]: allowed / K. K as the bias at the test rate [deg/h]:
    test_rate allowed / K. One with the other's K errs by 1 / test_rate. Source: physics.md section
    5.
    """
    return allowed_deg_h / K_per_degC_min, test_rate * allowed_deg_h / K_at_test_rate


def fit_models(study: RampStudy) -> tuple[dict[str, PiecewisePair], FogModel]:
    """Piecewise curves of each fitted gyro, and the model in use: K_T less its level where that is
    not known.
    """
    pairs = {a.axis: piecewise_pair(a.reduced) for a in study.axes}
    gyros = {}
    for a in study.axes:
        level_deg_h = 0.0 if a.level_known else a.level_deg_h
        pair = pairs[a.axis]
        gyros[a.axis] = FogCurves(shifted(pair.K_T, level_deg_h), pair.K_delta)
    return pairs, FogModel(gyros)


@dataclass(frozen=True, kw_only=True)
class PairDocument:
    """The fast ramp up and down alone, beside all runs."""

    K_delta_deg_h_per_degC_min: Sequence[float]
    sigma_K_delta_deg_h_per_degC_min: Sequence[float]
    K_T_deg_h: Sequence[float]
    largest_difference_K_delta: float


@dataclass(frozen=True, kw_only=True)
class SubtractionDocument:
    """The document's subtraction and how far it is from the exact separation; gain: its K_delta
    over the exact one.
    """

    K_T_deg_h: Sequence[float]
    K_delta_deg_h_per_degC_min: Sequence[float]
    gain: float | None
    expected_gain: float
    largest_difference_K_delta: float | None
    largest_difference_K_T_deg_h: float | None


@dataclass(frozen=True, kw_only=True)
class ClosedFormDocument:
    """A closed form on two ramps beside the fit."""

    K_T_deg_h: Sequence[float]
    K_delta_deg_h_per_degC_min: Sequence[float]
    largest_difference_K_delta: float


@dataclass(frozen=True, kw_only=True)
class PiecewiseDocument:
    """Both piecewise curves, and how well they fit."""

    K_T: Piecewise
    K_delta: Piecewise
    bic: float = of_pair(lambda pair: pair.bic)
    residual_over_sigma: float = of_pair(lambda pair: float(np.sqrt(pair.scatter)))


@dataclass(frozen=True, kw_only=True)
class SlowRateDocument:
    """How slow a slow ramp must be, by both readings of the formula, and how long it takes."""

    allowed_gradient_term_deg_h: float
    K_per_degC_min: float
    K_at_test_rate_deg_h: float
    test_rate_degC_min: float
    largest_degC_min: float
    largest_degC_min_K_at_test_rate: float
    mixed_up_degC_min: float
    used_degC_min: float | None
    admissible: bool | None
    days_one_way: float
    fast_pair_hours: float


@dataclass(frozen=True, kw_only=True)
class FixedPointDocument:
    """The exported whole-number tables."""

    word_bits: int
    largest_rate_degC_min: float
    worst_rounding_deg_h: float
    fraction_bits: Mapping[str, int]


@dataclass(frozen=True, kw_only=True)
class FittedAxis:
    """One fitted gyro."""

    temperature_degC: Sequence[float] = of_axis(lambda a: a.curves.temperature_degC.tolist())
    K_T_deg_h: Sequence[float] = of_axis(lambda a: (a.curves.K_T_deg_h - a.level_deg_h).tolist())
    sigma_K_T_deg_h: Sequence[float]
    level: ThermalLevel = of_axis(lambda a: _level(a))
    K_delta_deg_h_per_degC_min: Sequence[float] = of_axis(lambda a: a.curves.K_delta.tolist())
    sigma_K_delta_deg_h_per_degC_min: Sequence[float] = of_axis(lambda a: _sigma(a.curves))
    residual_over_sigma: float = of_axis(lambda a: float(np.sqrt(a.scatter)))
    hysteresis: Hysteresis = of_axis(lambda a: a.hysteresis)
    up_down: PairDocument | None = of_axis(lambda a: _pair(a))
    document: SubtractionDocument | None
    closed_forms: Mapping[str, ClosedFormDocument | None] = of_axis(
        lambda a: {"exact": _closed(a, a.two_ramps), "up_down": _closed(a, a.fast_ramps)}
    )
    inflections: Mapping[str, Sequence[Breakpoint]]
    piecewise: PiecewiseDocument
    slow_rate: SlowRateDocument
    fixed_point: FixedPointDocument


@dataclass(frozen=True, kw_only=True)
class FogDocument(ThermalDocument):
    """thermal_fog.json; check: of the runs that were held out."""

    schema: str = SCHEMA
    runs: Sequence[RampRun]
    remounted: bool = of(lambda study: study.remounted)
    noise_model: NoiseModelDocument = of(lambda study: made(NoiseModelDocument, study.twin))
    axes: Mapping[str, FittedAxis]
    check: Sequence[HeldOutResidual]


@dataclass(frozen=True)
class FogExport:
    """What is asked of the exported model: the gradient term that a slow ramp may have [deg/h], and
    the bits of a fixed-point word.
    """

    allowed_deg_h: float
    word_bits: int


def fog_document(
    study: RampStudy,
    pairs: dict[str, PiecewisePair],
    model: FogModel,
    *,
    checks: Sequence[HeldOutResidual] = (),
    allowed_deg_h: float,
    word_bits: int,
    version: str,
) -> FogDocument:
    """The result of a study, refused or fitted."""
    runs = [replace(run, role="fast") for run in study.fast]
    runs += [replace(run, role="slow") for run in study.slow]
    export = FogExport(allowed_deg_h, word_bits)
    return made(
        FogDocument,
        study,
        notes=sentences(study.notes),
        note_codes=codes(study.notes),
        imu_serial=runs[0].imu_serial,
        gyro_technology=runs[0].gyro_technology,
        version=version,
        runs=runs,
        axes={a.axis: _axis(a, pairs[a.axis], model, study, export) for a in study.axes},
        check=checks,
    )


def fixed_tables(model: FogModel, word_bits: int) -> dict[str, FixedTable]:
    """Tables x_kt, x_kd, ... of the fitted gyros."""
    found = {}
    for axis, curves in model.gyros.items():
        found[f"{axis}_kt"] = fixed_table(curves.K_T, word_bits=word_bits)
        found[f"{axis}_kd"] = fixed_table(curves.K_delta, word_bits=word_bits)
    return found


def worst_rounding(
    model: FogModel, tables: dict[str, FixedTable], largest_rate: float
) -> dict[str, float]:
    """Worst rounding error [deg/h] of each gyro up to a rate."""
    found = {}
    for axis, curves in model.gyros.items():
        edges = curves.K_delta.edges_degC
        T = np.linspace(edges[0], edges[-1], 2001)
        found[axis] = worst_error_deg_h(
            tables[f"{axis}_kt"],
            tables[f"{axis}_kd"],
            largest_rate=largest_rate,
            largest_K_delta=float(np.max(np.abs(curves.K_delta(T)))),
        )
    return found


def _axis(
    a: RampFit, pair: PiecewisePair, model: FogModel, study: RampStudy, export: FogExport
) -> FittedAxis:
    gyro = model.gyros[a.axis]
    return made(
        FittedAxis,
        a,
        sigma_K_T_deg_h=_sigma_shape(a, pair).tolist(),
        document=_subtraction(a, study),
        inflections=dict(zip(("K_T", "K_delta"), pair.inflections)),
        piecewise=made(PiecewiseDocument, pair, K_T=gyro.K_T, K_delta=gyro.K_delta),
        slow_rate=_slow_rate(a, study, export.allowed_deg_h),
        fixed_point=_fixed_point(a.axis, model, study, export.word_bits),
    )


def _level(a: RampFit) -> ThermalLevel:
    value, sigma = a.level_deg_h, a.level_sigma_deg_h
    return ThermalLevel(value_deg_h=value, sigma_deg_h=sigma, known=a.level_known)


def _sigma_shape(a: RampFit, pair: PiecewisePair) -> NDArray:
    """Sigma of K_T less its mean."""
    c, T = a.curves, a.curves.temperature_degC
    centre = np.eye(T.size) - 1.0 / T.size
    assert c.K_T_covariance is not None
    sigma = np.sqrt(np.diag(centre @ c.K_T_covariance @ centre))
    if not any(mark.kind == "knee" for mark in pair.K_T.breakpoints):
        return np.asarray(sigma)
    return np.asarray(np.hypot(sigma, centre @ (c.K_T_deg_h - pair.K_T(T))))


def _sigma(curves: Curves) -> list[float]:
    assert curves.K_delta_covariance is not None
    return np.sqrt(np.diag(curves.K_delta_covariance)).tolist()


def _pair(a: RampFit) -> PairDocument | None:
    if a.fast_pair is None:
        return None
    K_T, K_delta = a.fast_pair.K_T_deg_h, a.fast_pair.K_delta
    return PairDocument(
        K_delta_deg_h_per_degC_min=K_delta.tolist(),
        sigma_K_delta_deg_h_per_degC_min=_sigma(a.fast_pair),
        K_T_deg_h=(K_T - K_T.mean()).tolist(),
        largest_difference_K_delta=float(np.max(np.abs(K_delta - a.curves.K_delta))),
    )


def _subtraction(a: RampFit, study: RampStudy) -> SubtractionDocument | None:
    if a.document is None:
        return None
    seen = np.isfinite(a.document.K_delta)
    d, e = a.document.K_delta[seen], a.curves.K_delta[seen]
    offset = a.document.K_T_deg_h - a.curves.K_T_deg_h
    gain = largest_K_delta = largest_K_T = None
    if seen.any():
        gain = float(d @ e / (e @ e))
        largest_K_delta = float(np.max(np.abs(d - e)))
        largest_K_T = float(np.max(np.abs((offset - np.mean(offset[seen]))[seen])))
    slow = max((run.rate for run in study.slow), default=0.0)
    return SubtractionDocument(
        K_T_deg_h=(a.document.K_T_deg_h - np.mean(a.document.K_T_deg_h[seen])).tolist(),
        K_delta_deg_h_per_degC_min=a.document.K_delta.tolist(),
        gain=gain,
        expected_gain=1.0 - slow / max(run.rate for run in study.fast),
        largest_difference_K_delta=largest_K_delta,
        largest_difference_K_T_deg_h=largest_K_T,
    )


def _closed(a: RampFit, curves: Curves | None) -> ClosedFormDocument | None:
    """The rates are those of whole ramps there, so that their ends tell less."""
    if curves is None:
        return None
    off = np.abs(curves.K_delta - a.curves.K_delta)
    return ClosedFormDocument(
        K_T_deg_h=(curves.K_T_deg_h - np.nanmean(curves.K_T_deg_h)).tolist(),
        K_delta_deg_h_per_degC_min=curves.K_delta.tolist(),
        largest_difference_K_delta=float(np.nanmax(off)),
    )


def _slow_rate(a: RampFit, study: RampStudy, allowed: float) -> SlowRateDocument:
    K = float(np.max(np.abs(a.curves.K_delta)))
    test = max(run.rate for run in study.fast)
    by_unit, by_test = admissible_slow_rate(K, K * test, test, allowed)
    slow = max((run.rate for run in study.slow), default=None)
    span = float(np.ptp(a.curves.temperature_degC))
    return SlowRateDocument(
        allowed_gradient_term_deg_h=allowed,
        K_per_degC_min=K,
        K_at_test_rate_deg_h=K * test,
        test_rate_degC_min=test,
        largest_degC_min=by_unit,
        largest_degC_min_K_at_test_rate=by_test,
        mixed_up_degC_min=allowed / (K * test),
        used_degC_min=slow,
        admissible=None if slow is None else bool(slow <= by_unit),
        days_one_way=span / by_unit * 60.0 / DAY_S,
        fast_pair_hours=2.0 * span / test / 60.0,
    )


def _fixed_point(
    axis: str, model: FogModel, study: RampStudy, word_bits: int
) -> FixedPointDocument:
    only = FogModel({axis: model.gyros[axis]})
    tables = fixed_tables(only, word_bits)
    rate = max(run.rate for run in study.fast)
    return FixedPointDocument(
        word_bits=word_bits,
        largest_rate_degC_min=rate,
        worst_rounding_deg_h=worst_rounding(only, tables, rate)[axis],
        fraction_bits={key[2:]: table.fraction_bits for key, table in tables.items()},
    )
