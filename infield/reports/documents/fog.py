"""`recal.thermal_fog/1`: what came of the ramps as one JSON document; the report draws it,
`fog_model` reads it back.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from infield.reports.documents.spans import span_document
from infield.thermal.fixed_point import FixedTable, fixed_table, worst_error_deg_h
from infield.thermal.fog_model import SCHEMA, FogModel, HeldOut, shifted
from infield.thermal.fog_ramps import AxisFit, Curves, RampStudy
from infield.thermal.piecewise import Breakpoint, Piecewise, PiecewisePair, piecewise_pair
from infield.thermal.ramp_runs import RampRun
from ins.records import AXES
from ins.verdicts import plain

DAY_S = 86400.0


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
    K_T = {
        a.axis: shifted(pairs[a.axis].K_T, 0.0 if a.level_known else a.level_deg_h)
        for a in study.axes
    }
    return pairs, FogModel(K_T, {axis: pair.K_delta for axis, pair in pairs.items()})


def fog_document(
    study: RampStudy,
    pairs: dict[str, PiecewisePair],
    model: FogModel,
    *,
    checks: Sequence[HeldOut] = (),
    allowed_deg_h: float,
    word_bits: int,
    version: str,
) -> dict[str, Any]:
    """The result of a study, refused or fitted."""
    runs = [("fast", r) for r in study.fast] + [("slow", r) for r in study.slow]
    first = runs[0][1]
    gyro = study.twin.gyro
    return {
        "schema": SCHEMA,
        "verdict": (
            "refused" if study.refused else "inconsistent" if study.inconsistent else "fitted"
        ),
        "reasons": [*study.refused, *study.inconsistent],
        "notes": list(study.notes),
        "version": version,
        "imu_serial": first.imu_serial,
        "gyro_technology": first.gyro_technology,
        "runs": [_run(role, run) for role, run in runs],
        "remounted": study.remounted,
        "noise_model": {
            "source": study.twin.source,
            "white": "scatter of the runs' own ten-second sums",
            "turn_on_deg_h": gyro.turn_on_deg_h,
            "bias_instability_deg_h": gyro.bias_instability_deg_h,
            "rate_random_walk_deg_h_sqrt_h": gyro.rate_random_walk_deg_h_sqrt_h,
        },
        "axes": {
            a.axis: _axis(a, pairs[a.axis], model, study, allowed_deg_h, word_bits)
            for a in study.axes
        },
        "check": [_check(found) for found in checks],
    }


def fixed_tables(model: FogModel, word_bits: int) -> dict[str, FixedTable]:
    """Tables x_kt, x_kd, ... of the fitted gyros."""
    found = {}
    for axis in model.K_T:
        found[f"{axis}_kt"] = fixed_table(model.K_T[axis], word_bits=word_bits)
        found[f"{axis}_kd"] = fixed_table(model.K_delta[axis], word_bits=word_bits)
    return found


def worst_rounding(
    model: FogModel, tables: dict[str, FixedTable], largest_rate: float
) -> dict[str, float]:
    """Worst rounding error [deg/h] of each gyro up to a rate."""
    return {
        axis: worst_error_deg_h(
            tables[f"{axis}_kt"],
            tables[f"{axis}_kd"],
            largest_rate=largest_rate,
            largest_K_delta=float(
                np.max(np.abs(curve(np.linspace(curve.edges_degC[0], curve.edges_degC[-1], 2001))))
            ),
        )
        for axis, curve in model.K_delta.items()
    }


def _run(role: str, run: RampRun) -> dict[str, Any]:
    return {
        "run_id": run.run_id,
        "sha256": run.sha256,
        "role": role,
        "blocks": int(run.time_s.size),
        "steady_blocks": int(run.steady.sum()),
        "heading_known": run.heading_known,
        "sigma_block_deg_h": run.sigma_deg_h.tolist(),
        "sigma_rate_degC_min": run.rate_sigma_degC_min.tolist(),
        "ramps": [
            {
                "direction": leg.direction,
                "low_degC": leg.low_degC,
                "high_degC": leg.high_degC,
                "rate_degC_min": leg.rate_degC_min,
                "start_s": float(run.time_s[leg.start]),
                "end_s": float(run.time_s[leg.end - 1]),
            }
            for leg in run.legs
        ],
        "excluded": [plain(span_document(span)) for span in run.excluded],
    }


def _axis(
    a: AxisFit,
    pair: PiecewisePair,
    model: FogModel,
    study: RampStudy,
    allowed: float,
    word_bits: int,
) -> dict[str, Any]:
    c, T = a.curves, a.curves.temperature_degC
    centre = np.eye(T.size) - 1.0 / T.size
    assert c.K_T_covariance is not None
    return {
        "temperature_degC": T.tolist(),
        "K_T_deg_h": (c.K_T_deg_h - a.level_deg_h).tolist(),
        "sigma_K_T_deg_h": np.sqrt(np.diag(centre @ c.K_T_covariance @ centre)).tolist(),
        "level": {
            "value_deg_h": a.level_deg_h,
            "sigma_deg_h": a.level_sigma_deg_h,
            "known": a.level_known,
        },
        "K_delta_deg_h_per_degC_min": c.K_delta.tolist(),
        "sigma_K_delta_deg_h_per_degC_min": _sigma(c),
        "residual_over_sigma": float(np.sqrt(a.scatter)),
        "up_down": _pair(a),
        "document": _document(a, study),
        "closed_forms": {"exact": _closed(a, a.two_ramps), "up_down": _closed(a, a.fast_ramps)},
        "inflections": {
            key: [_breakpoint(b) for b in found]
            for key, found in zip(("K_T", "K_delta"), pair.inflections)
        },
        "piecewise": {
            "K_T": _piecewise(model.K_T[a.axis]),
            "K_delta": _piecewise(model.K_delta[a.axis]),
            "bic": pair.bic,
            "residual_over_sigma": float(np.sqrt(pair.scatter)),
        },
        "slow_rate": _slow_rate(a, study, allowed),
        "fixed_point": _fixed_point(a.axis, model, study, word_bits),
    }


def _sigma(curves: Curves) -> list[float]:
    assert curves.K_delta_covariance is not None
    return np.sqrt(np.diag(curves.K_delta_covariance)).tolist()


def _pair(a: AxisFit) -> dict[str, Any] | None:
    """The fast ramp up and down alone, beside all runs."""
    if a.fast_pair is None:
        return None
    return {
        "K_delta_deg_h_per_degC_min": a.fast_pair.K_delta.tolist(),
        "sigma_K_delta_deg_h_per_degC_min": _sigma(a.fast_pair),
        "K_T_deg_h": (a.fast_pair.K_T_deg_h - a.fast_pair.K_T_deg_h.mean()).tolist(),
        "largest_difference_K_delta": float(np.max(np.abs(a.fast_pair.K_delta - a.curves.K_delta))),
    }


def _document(a: AxisFit, study: RampStudy) -> dict[str, Any] | None:
    """The document's subtraction and how far it is from the exact separation; gain: its K_delta
    over the exact one.
    """
    if a.document is None:
        return None
    seen = np.isfinite(a.document.K_delta)
    d, e = a.document.K_delta[seen], a.curves.K_delta[seen]
    offset = a.document.K_T_deg_h - a.curves.K_T_deg_h
    slow = max((run.rate for run in study.slow), default=0.0)
    return {
        "K_T_deg_h": (a.document.K_T_deg_h - np.mean(a.document.K_T_deg_h[seen])).tolist(),
        "K_delta_deg_h_per_degC_min": a.document.K_delta.tolist(),
        "gain": float(d @ e / (e @ e)) if seen.any() else None,
        "expected_gain": 1.0 - slow / max(run.rate for run in study.fast),
        "largest_difference_K_delta": float(np.max(np.abs(d - e))) if seen.any() else None,
        "largest_difference_K_T_deg_h": (
            float(np.max(np.abs((offset - np.mean(offset[seen]))[seen]))) if seen.any() else None
        ),
    }


def _closed(a: AxisFit, curves: Curves | None) -> dict[str, Any] | None:
    """A closed form on two ramps beside the fit: the rates are those of whole ramps there, so that
    their ends tell less.
    """
    if curves is None:
        return None
    off = np.abs(curves.K_delta - a.curves.K_delta)
    return {
        "K_T_deg_h": (curves.K_T_deg_h - np.nanmean(curves.K_T_deg_h)).tolist(),
        "K_delta_deg_h_per_degC_min": curves.K_delta.tolist(),
        "largest_difference_K_delta": float(np.nanmax(off)),
    }


def _slow_rate(a: AxisFit, study: RampStudy, allowed: float) -> dict[str, Any]:
    K = float(np.max(np.abs(a.curves.K_delta)))
    test = max(run.rate for run in study.fast)
    by_unit, by_test = admissible_slow_rate(K, K * test, test, allowed)
    slow = max((run.rate for run in study.slow), default=None)
    span = float(np.ptp(a.curves.temperature_degC))
    return {
        "allowed_gradient_term_deg_h": allowed,
        "K_per_degC_min": K,
        "K_at_test_rate_deg_h": K * test,
        "test_rate_degC_min": test,
        "largest_degC_min": by_unit,
        "largest_degC_min_K_at_test_rate": by_test,
        "mixed_up_degC_min": allowed / (K * test),
        "used_degC_min": slow,
        "admissible": None if slow is None else bool(slow <= by_unit),
        "days_one_way": span / by_unit * 60.0 / DAY_S,
        "fast_pair_hours": 2.0 * span / test / 60.0,
    }


def _fixed_point(axis: str, model: FogModel, study: RampStudy, word_bits: int) -> dict[str, Any]:
    only = FogModel({axis: model.K_T[axis]}, {axis: model.K_delta[axis]})
    tables = fixed_tables(only, word_bits)
    rate = max(run.rate for run in study.fast)
    return {
        "word_bits": word_bits,
        "largest_rate_degC_min": rate,
        "worst_rounding_deg_h": worst_rounding(only, tables, rate)[axis],
        "fraction_bits": {key[2:]: table.fraction_bits for key, table in tables.items()},
    }


def _breakpoint(b: Breakpoint) -> dict[str, Any]:
    return {
        "temperature_degC": b.temperature_degC,
        "interval_95_degC": [b.low_degC, b.high_degC],
        "sigma_degC": b.sigma_degC,
        "kind": b.kind,
    }


def _piecewise(curve: Piecewise) -> dict[str, Any]:
    return {
        "degree": curve.degree,
        "edges_degC": curve.edges_degC.tolist(),
        "coefficients": curve.coefficients.tolist(),
        "breakpoints": [_breakpoint(b) for b in curve.breakpoints],
    }


def _check(found: HeldOut) -> dict[str, Any]:
    ratio: NDArray = found.after_deg_h / found.before_deg_h
    causal: NDArray = found.causal_deg_h / found.before_deg_h
    return {
        "run_id": found.run.run_id,
        "sha256": found.run.sha256,
        "axes": {
            axis: {
                "before_deg_h": found.before_deg_h[k],
                "after_deg_h": found.after_deg_h[k],
                "ratio": ratio[k],
                "causal_after_deg_h": found.causal_deg_h[k],
                "causal_ratio": causal[k],
                "noise_deg_h": found.noise_deg_h[k],
                "blocks": int(found.rows[:, k].sum()),
            }
            for k, axis in enumerate(AXES)
            if np.isfinite(ratio[k])
        },
    }
