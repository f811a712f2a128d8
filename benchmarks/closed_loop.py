"""What a diagnosis is worth to the update after it: an effect on a unit whose table has aged.

Three runs of a blind trial are diagnosed; the fourth is updated with the twin as it was, with what
was found and written, and, effect taken away, as it would have been. The table's error is that of
its level gyros at the temperatures of that update, its square over the variance stated there.
"""

from dataclasses import replace
from typing import cast

import numpy as np
from numpy.typing import NDArray

import recal
from benchmarks.gap_size import scaled
from benchmarks.gap_trials.runs import NODES_DEGC
from benchmarks.gap_trials.trial import draw_trial
from benchmarks.study import Record, Work, table
from infield.table.file import table_from_dict
from infield.table.thermal_table import ThermalTable
from ins.json_file import JsonObject
from ins.records import AxisDocument, Run, TableDocument, TwinModel
from ins.twin_file import twin_from_dict
from simreal.inference.diagnosis import DiagnosisSettings, diagnose
from simreal.report.diagnosis_words import verdict_sentence
from simreal.twin.write_back import twin_with_causes

NAMES = (
    "gyro_thermal_rate",
    "gyro_thermal_lag",
    "gyro_warmup_transient",
    "gyro_rate_ramp",
    "gyro_magnetic_sensitivity",
    "gyro_scale_factor",
)
SIZE = 15.0
AGED_DEG_H = (0.006, 0.004)  # a common shift and a smooth shape, as units of the simulator age
SHAPE_DEGC = 30.0
REPLICATES = 150


def aged(found: TableDocument, seed: int) -> TableDocument:
    """The table before it aged, its sigma that of the ageing."""
    rng = np.random.default_rng([seed, 77])
    apart = (NODES_DEGC[:, None] - NODES_DEGC) / SHAPE_DEGC
    root = np.linalg.cholesky(np.exp(-0.5 * apart**2) + 1e-9 * np.eye(NODES_DEGC.size))
    axes: dict[str, AxisDocument] = {}
    for axis, of in found["axes"].items():
        shift, shape = AGED_DEG_H
        change = shift * rng.standard_normal() + shape * root @ rng.standard_normal(len(root))
        before = np.array(of["bias_deg_h"]) - change
        sigma = [float(np.hypot(shift, shape))] * NODES_DEGC.size
        axes[axis] = {**of, "bias_deg_h": before.tolist(), "sigma_deg_h": sigma}
    return {**found, "axes": axes}


def unit(seed: int) -> Record:
    """One unit's three updates."""
    made, size = scaled(draw_trial(seed, names=NAMES), SIZE)
    true = cast(TableDocument, made.table)
    before = aged(true, seed)
    found = diagnose(
        made.runs[:3],
        made.twin,
        table_from_dict(before, name="aged"),
        DiagnosisSettings(replicates=REPLICATES, seed=seed),
    )
    names = [view.name for view in found.views]
    document = twin_with_causes(made.twin, found.causes, names, with_table=False)
    twin = twin_from_dict(cast(JsonObject, document), source="diagnosis", name="twin")
    last, without = made.runs[3], made.runs_without[3]
    return {
        "planted": f"{made.truth[0].effect} on {made.truth[0].target}",
        "size": size,
        "said": verdict_sentence(found),
        "written": [f"{e['effect']} on {e['target']}" for e in document["effects"]],
        "kept_out": [c.kept_out for c in found.causes],
        "as it was": _updated(last, made.twin, before, true),
        "with what was found": _updated(last, twin, before, true),
        "without the effect": _updated(without, made.twin, before, true),
    }


def _updated(run: Run, twin: TwinModel, before: TableDocument, true: TableDocument) -> list[float]:
    """RMS error after the update [deg/h], and squared error over variance, level gyros."""
    result = recal.update(run, table_from_dict(before, name="aged"), replace(twin, table=None))
    after = result.table
    T = np.array([p.temperature_degC for p in result.points])
    T = np.linspace(T.min(), T.max(), 10)
    errors, ratios = [], []
    for axis in "xy":
        truth = np.interp(T, NODES_DEGC, true["axes"][axis]["bias_deg_h"])
        error = np.asarray(after.bias_deg_h(axis, T)) - truth
        errors.append(error)
        ratios.append(error**2 / _variance(after, axis, T))
    return [float(np.sqrt(np.mean(np.square(errors)))), float(np.mean(ratios))]


def _variance(after: ThermalTable, axis: str, T: NDArray) -> NDArray:
    rows = after.basis("xyz".index(axis), T)
    return np.asarray(np.einsum("ij,jk,ik->i", rows, after.covariance, rows))


CASES = ("as it was", "with what was found", "without the effect")


def run(work: Work, *, units: int = 40, first: int = 7000) -> str:
    records = work.each(unit, [(seed,) for seed in range(first, first + units)])
    rows = []
    for case in CASES:
        values = np.array([r[case] for r in records])
        rms = float(np.sqrt(np.mean(values[:, 0] ** 2)))
        rows.append([case, f"{rms:.4f} deg/h", f"{values[:, 1].mean():.2f}", len(records)])
    return table(("the update", "error, level gyros", "squared error over variance", "units"), rows)
