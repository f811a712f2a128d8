"""Figures of requirement R19: the ring-laser gradient model over simulated units, on a run that
nothing was fitted to.

    python -m benchmarks.rlg_gradient_rates [UNITS]
        prints the table, puts it into docs/rlg_gradient.md, draws the svg

Each unit has its own curve, ageing and terms; its four runs are those of the scenarios
rlg_gradient_1, 2, 3 and check, IMU and thermometers simulated as a whole. 200 units: about 15 CPU
min.
"""

import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.stats import chi2

from infield.reports.documents.rlg import rlg_document
from infield.reports.figures import BLACK, GREY, NEW, OLD
from infield.thermal.gradient_runs import gradient_run
from infield.thermal.reasons import ThermalNote, ThermalReason
from infield.thermal.rlg.fit import five_minute_means
from infield.thermal.rlg.gradients import fit_gradients
from infield.thermal.rlg.held_out import RlgHeldOut, held_out_run
from infield.thermal.rlg.model import model_from_document
from infield.thermal.rlg.terms import TERMS
from ins.records import AXES, TemperatureNoise
from ins.verdicts import plain as as_plain
from tests.infield.gradient_cases import TWIN, Unit, case
from trajectories.simulator.scenario import Scenario, read_scenario, scenario_ideal, scenario_unit
from trajectories.simulator.session import SessionPlan, SimulatedRun, simulate_run
from trajectories.simulator.unit_truth import RATE_CENTRE_DEGC, UnitTruth

DOCS = Path(__file__).resolve().parent.parent / "docs"
PAGE, PICTURE = DOCS / "rlg_gradient.md", DOCS / "rlg_gradient.svg"
BEGIN, END = "<!-- figures: python -m benchmarks.rlg_gradient_rates -->", "<!-- end of figures -->"
FIT, CHECK = ("rlg_gradient_1", "rlg_gradient_2", "rlg_gradient_3"), "rlg_gradient_check"
UNITS = 200
FINE, COARSE = TemperatureNoise(), TemperatureNoise(noise_degC=0.03, resolution_degC=0.1)


@dataclass(frozen=True)
class Cell:
    """One gyro of one unit: RMS [deg/h] of the check run's five-minute means, and normalised errors
    of the terms.
    """

    before: float
    temperature_only: float
    after: float
    causal: float
    floor: float
    terms_alone_over_noise: float
    held_out_over_noise: float
    squared_error: float
    dof: int
    largest_error: float


def random_unit(scenario: Scenario, seed: int) -> Scenario:
    """The scenario with another unit: its curve, ageing and terms drawn; rate and own line never
    small.
    """
    rng = np.random.default_rng([seed, 19])

    def sizes(low: float, high: float) -> tuple[float, float, float]:
        x, y, z = (rng.uniform(low, high, 3) * rng.choice([-1.0, 1.0], 3)).tolist()
        return x, y, z

    unit = replace(
        scenario.unit,
        ageing_seed=seed,
        thermal_rate_deg_h_per_degC_min=sizes(0.02, 0.05),
        thermal_rate_slope_deg_h_per_degC2_min=sizes(0.0, 0.0008),
        gradient_deg_h_per_degC=sizes(0.015, 0.04),
        gradient_cross_deg_h_per_degC=sizes(0.0, 0.015),
    )
    return replace(scenario, unit=unit)


def unit_cells(
    seed: int, ideals: dict[str, Any], thermometer: TemperatureNoise
) -> tuple[list[Cell], RlgHeldOut]:
    """Fit a unit on its three runs, try it on the fourth."""
    runs: dict[str, SimulatedRun] = {}
    for k, name in enumerate((*FIT, CHECK)):
        scenario = random_unit(read_scenario(name), seed)
        unit, twin = scenario_unit(scenario), replace(scenario.twin, temperature=thermometer)
        runs[name] = simulate_run(
            ideals[name],
            scenario.thermal,
            unit,
            twin,
            rng=np.random.default_rng([seed, k]),
            plan=SessionPlan(run_id=name),
        )
    study = fit_gradients([gradient_run(runs[name].run, twin) for name in FIT], twin)
    found = held_out_run(
        runs[CHECK].run,
        model_from_document(as_plain(rlg_document(study, version=""))),
        study.axes,
        twin,
    )
    cells = []
    for a in study.axes:
        k = AXES.index(a.axis)
        at = [j for j, name in enumerate(TERMS) if name in a.used and j >= 3]
        error = a.theta[at] - true_terms(unit, k, study.reference_degC)[at]
        P = a.covariance[np.ix_(at, at)]
        before, plain, after, causal = found.rms_deg_h[a.axis].tolist()
        cells.append(
            Cell(
                before,
                plain,
                after,
                causal,
                _floor(scenario, unit, found, k),
                a.held_out.terms_deg_h / a.held_out.noise_deg_h,
                a.held_out.model_deg_h / a.held_out.noise_deg_h,
                float(error @ np.linalg.solve(P, error)),
                len(at),
                float(np.max(np.abs(error) / np.sqrt(np.diag(P)))),
            )
        )
    return cells, found


def true_terms(unit: UnitTruth, k: int, reference_degC: float) -> NDArray:
    """What the truth has of K4, K5 and K6 with temperatures counted from a reference (8,); K1..K3
    are no part of it.
    """
    out = np.zeros(len(TERMS))
    slope = unit.thermal_rate_slope_deg_h_per_degC2_min[k]
    out[3], out[4] = (
        unit.thermal_rate_deg_h_per_degC_min[k] + slope * (reference_degC - RATE_CENTRE_DEGC),
        slope,
    )
    out[5 + k] = unit.gradient_deg_h_per_degC[k]
    out[5 + (k + 1) % 3] = unit.gradient_cross_deg_h_per_degC[k]
    return out


def _floor(scenario: Scenario, unit: UnitTruth, found: RlgHeldOut, k: int) -> float:
    """RMS of the check run's own noise: its means less the true thermal bias, over the same
    rows.
    """
    b = found.run.blocks
    t = np.arange(0.0, b.time_s[-1] + 60.0)
    felt = scenario.thermal.at(t)
    thermal = unit.bias_history_deg_h(felt.gyro_degC, 1.0, felt.gradient_degC)[:, k]
    total = np.r_[0.0, np.cumsum(thermal)]
    minute = (
        np.interp(b.time_s + 30.0, t, total[1:]) - np.interp(b.time_s - 30.0, t, total[1:])
    ) / 60.0
    seen = found.means[AXES[k]][0]
    means, time_s, _ = five_minute_means(b.time_s, (b.bias_deg_h[:, k] - minute)[:, None])
    near = np.abs(time_s[:, None] - seen).min(axis=1) < 200.0
    left = means[near, 0]
    return float(np.std(left))


def refusals(units: int) -> Iterator[tuple[str, str, str]]:
    """What cannot be carried, on minute means: unforced soaks, warming alone, no lines."""
    named = refused = without = 0
    for seed in range(units):
        rng = np.random.default_rng([seed, 7])
        unit = Unit(rng, wave=0.003)
        rate = rng.uniform(0.6, 1.4)
        study = fit_gradients(
            [case(rng, unit, heater=0.0, rate=r, run_id=str(r)) for r in (rate, 0.6 * rate)], TWIN
        )
        named += all(f"K6{a.axis}" in [f.term for f in a.collinear] for a in study.axes)
        study = fit_gradients(
            [case(rng, unit, back=False, soak=0, heater=0.0, rate=0.6 * rate)], TWIN
        )
        refused += ThermalReason.ONE_SIDED in [why.code for why in study.refused]
        study = fit_gradients([case(rng, unit, with_lines=False)], TWIN)
        without += bool(study.axes) and study.notes[0].code is ThermalNote.NO_LINES
    yield (
        "soak without a heater: each gyro's own line named as one with K4 and dropped",
        f"{named} of {units}",
        "all",
    )
    yield "warming alone at a steady rate refused as one-sided", f"{refused} of {units}", "all"
    yield "no gradient column: fitted without, and said", f"{without} of {units}", "all"


def rows(cells: list[Cell]) -> Iterator[tuple[str, str, str]]:
    """The figures of R19."""

    def column(name: str) -> NDArray:
        return np.array([getattr(cell, name) for cell in cells])

    after, floor = column("after"), column("floor")
    for what, ratio, limit in (
        ("held-out run, model over temperature alone", after / column("temperature_only"), 0.5),
        ("held-out run, model over its noise", after / floor, 1.2),
        ("the same in real-time order", column("causal") / floor, 1.2),
    ):
        low, middle, high = np.percentile(ratio, [5, 50, 95])
        yield (
            f"{what}: median, 5 to 95 %, share within",
            f"{middle:.2f}, {low:.2f} to {high:.2f}, {np.mean(ratio <= limit):.1%}",
            f"{limit:g}",
        )
    pooled = [
        np.sqrt(np.mean(after**2) / np.mean(below**2))
        for below in (floor, column("temperature_only"))
    ]
    yield (
        "all held-out runs pooled, RMS over noise; over temperature alone",
        f"{pooled[0]:.2f}; {pooled[1]:.2f}",
        "1.2; 0.5",
    )
    causal = np.sqrt(np.mean(column("causal") ** 2) / np.mean(floor**2))
    yield "the same in real-time order, over noise", f"{causal:.2f}", "1.2"
    median = (
        f"{np.median(column('terms_alone_over_noise')):.2f};"
        f" {np.median(column('held_out_over_noise')):.2f}"
    )
    yield "held-out stretches over noise, median: K1 to K6 alone; with the rest", median, "1.2"
    dof = column("dof").sum()
    low, high = chi2.ppf([0.025, 0.975], dof) / dof
    nees = column("squared_error").sum() / dof
    exact = f"{dof} terms; {low:.2f} to {high:.2f} if exact"
    yield f"K4 to K6: mean squared normalised error ({exact})", f"{nees:.2f}", "0.8 to 1.25"
    yield (
        "gyros with every kept term within 3 sigma",
        f"{np.mean(column('largest_error') <= 3.0):.1%}",
        "",
    )


def page(cells: list[Cell], coarse: list[Cell], units: int, few: int, seconds: float) -> str:
    """The table as Markdown."""
    body = [
        f"{units} units of three gyros, {seconds / 60:.0f} CPU min.",
        "",
        "| | measured | needed |",
        "| --- | --- | --- |",
    ]
    body += [
        f"| {what} | {value} | {needed} |"
        for what, value, needed in (*rows(cells), *refusals(units))
    ]
    after, floor = (np.array([getattr(c, name) for c in coarse]) for name in ("after", "floor"))
    body.append(
        f"| thermometers and lines in steps of 0.1 degC ({few} units): held-out run over its noise,"
        f" pooled | {np.sqrt(np.mean(after**2) / np.mean(floor**2)):.2f} | |"
    )
    return "\n".join(body)


def drawing(found: RlgHeldOut, cells: list[Cell]) -> Figure:
    """A held-out run of one gyro before and after; the ratios of all units."""
    figure = Figure(figsize=(10.0, 3.0), layout="constrained")
    left, right = figure.subplots(1, 2)
    time_s, values = found.means["x"]
    for column, (name, colour, mark) in enumerate(
        (
            ("uncompensated", GREY, "."),
            ("temperature alone", OLD, "--"),
            ("model", NEW, "-"),
            ("model, real time", BLACK, ":"),
        )
    ):
        left.plot(time_s / 60.0, values[:, column], mark, color=colour, markersize=4, label=name)
    left.set(
        title="held-out run, gyro x, means over five minutes",
        xlabel="time [min]",
        ylabel="bias less its mean [deg/h]",
    )
    left.legend(loc="best")
    bins = np.arange(0.5, 6.01, 0.125)
    for name, colour, style in (("temperature_only", OLD, "--"), ("after", NEW, "-")):
        ratio = np.array([getattr(c, name) / c.floor for c in cells])
        right.hist(
            np.clip(ratio, 0.5, 6.0),
            bins,
            histtype="step",
            color=colour,
            linestyle=style,
            linewidth=1.5,
            label={"after": "model", "temperature_only": "temperature alone"}[name],
        )
    right.axvline(1.2, color=GREY, linewidth=1.0)
    right.set(
        title=f"held-out residual over its noise, {len(cells)} gyros",
        xlabel="ratio (line: 1.2)",
        ylabel="gyros",
    )
    right.legend(loc="best")
    return figure


def main(units: int = UNITS) -> None:
    """Measure, print, write."""
    start = time.process_time()
    ideals = {name: scenario_ideal(read_scenario(name)) for name in (*FIT, CHECK)}
    cells: list[Cell] = []
    first: RlgHeldOut | None = None
    for seed in range(units):
        more, found = unit_cells(seed, ideals, FINE)
        cells, first = cells + more, first or found
    few = max(units // 10, 1)
    coarse = [cell for seed in range(few) for cell in unit_cells(seed, ideals, COARSE)[0]]
    text = page(cells, coarse, units, few, time.process_time() - start)
    sys.stdout.write(text + "\n")
    before, rest = PAGE.read_text(encoding="utf-8").split(BEGIN)
    PAGE.write_text(
        before + BEGIN + "\n" + text + "\n" + END + rest.split(END)[1], encoding="utf-8"
    )
    assert first is not None
    drawing(first, cells).savefig(PICTURE, metadata={"Date": None})


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else UNITS)
