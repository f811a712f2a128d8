"""`recal.thermal_rlg/1`: what came of the runs as one JSON document; the report draws it,
`rlg_model` reads it back.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from infield.reports.documents.spans import span_document
from infield.thermal.gradient_fit import RESIDUAL_S, AxisModel, Choice, Residual
from infield.thermal.gradient_runs import GradientRun
from infield.thermal.gradient_terms import COLLINEAR, TERMS, UNITS
from infield.thermal.held_out import RlgHeldOut
from infield.thermal.rlg_gradient import GradientStudy
from infield.thermal.rlg_model import SCHEMA
from ins.verdicts import plain

ENOUGH = 1.2  # held-out residual over the noise floor, above which something is missing


def rlg_document(
    study: GradientStudy, *, checks: Sequence[RlgHeldOut] = (), version: str
) -> dict[str, Any]:
    """The result of a study, refused or fitted."""
    first, gyro = study.runs[0].blocks, study.twin.gyro
    axes = {a.axis: _axis(a, study.reference_degC) for a in study.axes}
    return {
        "schema": SCHEMA,
        "verdict": (
            "refused" if study.refused else "inconsistent" if study.inconsistent else "fitted"
        ),
        "reasons": [*study.refused, *study.inconsistent],
        "notes": [*study.notes, *_missing(study)],
        "version": version,
        "imu_serial": first.imu_serial,
        "gyro_technology": first.gyro_technology,
        "runs": [_run(run) for run in study.runs],
        "remounted": study.remounted,
        "noise_model": {
            "source": study.twin.source,
            "white": "scatter of the runs' own ten-second sums",
            "turn_on_deg_h": gyro.turn_on_deg_h,
            "bias_instability_deg_h": gyro.bias_instability_deg_h,
            "rate_random_walk_deg_h_sqrt_h": gyro.rate_random_walk_deg_h_sqrt_h,
        },
        "model": (
            "b = K1 + K2 T + K3 T^2 + K4 dT/dt + K5 T dT/dt + K6x Tdiff_x + K6y Tdiff_y + K6z"
            " Tdiff_z + rest(T), T = temperature less the reference, dT/dt in degC/min"
        ),
        "reference_temperature_degC": study.reference_degC,
        "validation": study.validation,
        "residual_of_s": RESIDUAL_S,
        "axes": axes,
        "check": [_check(found) for found in checks],
    }


def _missing(study: GradientStudy) -> list[str]:
    """Where the model does not foretell what was held out."""
    return [
        f"gyro {a.axis}: the held-out residual is"
        f" {a.held_out.model_deg_h / a.held_out.noise_deg_h:.2f} times its noise, needed"
        f" {ENOUGH:g}: something is missing, or too few runs hold the terms apart"
        for a in study.axes
        if a.held_out.model_deg_h > ENOUGH * a.held_out.noise_deg_h
    ]


def _run(run: GradientRun) -> dict[str, Any]:
    b = run.blocks
    T, rate = b.temperature_degC[run.usable], b.rate_degC_min[run.usable]
    return {
        "run_id": b.run_id,
        "sha256": b.sha256,
        "minutes": run.minutes,
        "heading_known": b.heading_known,
        "temperature_degC": [float(T.min()), float(T.max())] if T.size else None,
        "rate_degC_min": [float(rate.min()), float(rate.max())] if rate.size else None,
        "lines": {
            axis: float(np.ptp(run.gradient_degC[run.usable, "xyz".index(axis)]))
            for axis in run.lines
        },
        "sigma_block_deg_h": b.sigma_deg_h.tolist(),
        "sigma_rate_degC_min": run.sigma_rate_degC_min.tolist(),
        "sigma_gradient_degC": run.sigma_gradient_degC.tolist(),
        "excluded": [plain(span_document(span)) for span in b.excluded],
    }


def _axis(a: AxisModel, reference_degC: float) -> dict[str, Any]:
    n, gone = len(TERMS), {found.term: found for found in a.collinear}
    terms = {
        name: {
            "value": float(a.theta[k]),
            "sigma": float(a.sigma[k]) if name in a.used else None,
            "unit": UNITS[name],
            "state": (
                "used"
                if name in a.used
                else (
                    "collinear"
                    if name in gone
                    else "not better on held-out data"
                    if name in a.not_better
                    else "no data"
                )
            ),
        }
        for k, name in enumerate(TERMS)
    }
    return {
        "temperature_degC": list(a.range_degC),
        "terms": terms,
        "covariance": a.covariance[:n, :n].tolist(),
        "about_zero_degC": about_zero(a, reference_degC),
        "level": {
            "value_deg_h": float(a.theta[0]),
            "sigma_deg_h": float(a.sigma[0]),
            "known": a.level_known,
        },
        "rest": {
            "temperature_degC": a.nodes_degC.tolist(),
            "bias_deg_h": a.theta[n:].tolist(),
            "sigma_deg_h": a.sigma[n:].tolist(),
            "prior_sigma_deg_h": a.choice.rest_deg_h,
        },
        "condition": {
            "used": a.condition,
            "all": a.condition_all,
            "all_uncentred": a.condition_uncentred,
            "limit": COLLINEAR,
        },
        "collinear": [
            {
                "term": f.term,
                "with": list(f.others),
                "condition": f.condition,
                "noise_share": f.noise_share,
                "text": f.words(),
            }
            for f in a.collinear
        ],
        "orders": [_order(choice) for choice in a.orders],
        "held_out": _residual(a.held_out),
        "leave_one_run_out": None if a.by_run is None else _residual(a.by_run),
        "temperature_only": {
            name: float(a.temperature_only[k]) for k, name in enumerate(TERMS[:3])
        },
        "residual_over_sigma": float(np.sqrt(a.scatter)),
        "minutes": a.rows,
    }


def about_zero(a: AxisModel, reference_degC: float) -> dict[str, float]:
    """The terms as the document writes them, T counted from 0 degC: K1..K5 mix, K6 is what it
    was.
    """
    K1, K2, K3, K4, K5, *lines = (float(v) for v in a.theta[: len(TERMS)])
    r = reference_degC
    values = (K1 - K2 * r + K3 * r**2, K2 - 2.0 * K3 * r, K3, K4 - K5 * r, K5, *lines)
    return dict(zip(TERMS, values))


def _order(choice: Choice) -> dict[str, Any]:
    return {
        "terms": list(choice.used),
        "rest_deg_h": choice.rest_deg_h,
        "held_out_chi2": choice.chi2,
    }


def _residual(r: Residual) -> dict[str, Any]:
    return {
        **vars(r),
        "over_temperature_only": r.model_deg_h / r.temperature_only_deg_h,
        "over_noise": r.model_deg_h / r.noise_deg_h,
    }


def _check(found: RlgHeldOut) -> dict[str, Any]:
    rows = {}
    for axis, (before, table_alone, after, causal) in (
        (a, v.tolist()) for a, v in found.rms_deg_h.items()
    ):
        rows[axis] = {
            "before_deg_h": before,
            "temperature_only_deg_h": table_alone,
            "after_deg_h": after,
            "causal_after_deg_h": causal,
            "noise_deg_h": found.noise_deg_h[axis],
            "over_temperature_only": after / table_alone,
            "over_noise": after / found.noise_deg_h[axis],
            "means": int(found.means[axis][0].size),
        }
    b = found.run.blocks
    return {
        "run_id": b.run_id,
        "sha256": b.sha256,
        "share_inside": found.share_inside,
        "axes": rows,
    }
