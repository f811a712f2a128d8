"""What a diagnosis is worth to the updates after it: a thermal rate found on three runs, then ten.

    python -m benchmarks.closed_loop [UNITS] [--first 0] [--sigma 12] [-o FILE]

Each unit has a true table and a rate-dependent bias (generator of benchmarks.gap_trials).
`diagnose` sees its first three runs; the twin that it writes goes into ten updates of ten later
runs, one after the other, from a table that is off by a draw of its own sigma. The same ten are
made with the twin as it was, and with the effect not there at all ("known"). Scored at the visited
temperatures of the level gyros: RMS error, and squared error over the variance that the table says.
"""

import argparse
import json
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks.gap_size import scaled
from benchmarks.gap_trials import runs as trial_runs
from benchmarks.gap_trials.trial import Trial, draw_trial, lay_over
from infield.table.file import table_from_dict
from infield.table.thermal_table import ThermalTable
from ins.records import Run
from ins.twin_file import twin_from_dict
from recal.service.update import update
from simreal.inference.diagnosis import DiagnosisSettings, diagnose
from simreal.twin.write_back import twin_with_causes

UPDATES, DIAGNOSED = 10, 3
START_SIGMA_DEG_H = 0.01
LEVEL = ("x", "y")
EVERY_S = 300.0  # temperatures that are scored


@dataclass(frozen=True)
class Later:
    """A run after the diagnosis, with the effect and without it, and what it visited."""

    run: Run
    known: Run
    visited_degC: np.ndarray


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.closed_loop", description=__doc__)
    parser.add_argument("units", type=int, nargs="?", default=3)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--sigma", type=float, default=12.0)
    parser.add_argument("-o", "--output", type=Path)
    options = parser.parse_args()
    rows = [
        row
        for seed in range(options.first, options.first + options.units)
        for row in unit(seed, options.sigma)
    ]
    for line in summary(rows):
        print(line)
    if options.output:
        text = json.dumps({"rows": rows, "summary": summary(rows)}, indent=1)
        options.output.write_text(text + "\n", encoding="utf-8")


def unit(seed: int, sigma: float) -> list[dict]:
    """Rows of one unit: a row an update and a way."""
    drawn = draw_trial(9000 + seed, names=["gyro_thermal_rate"], plan="four", with_gnss=False)
    trial, _ = scaled(drawn, sigma)
    found = diagnose(
        trial.runs[:DIAGNOSED],
        trial.twin,
        table_from_dict(trial.table, name="truth"),
        DiagnosisSettings(seed=seed),
    )
    names = [view.name for view in found.views]
    written = twin_with_causes(trial.twin, found.causes, names, with_table=True)
    with_found = twin_from_dict(json.loads(json.dumps(written)), source="twin", name="twin")
    later = later_runs(trial, seed)
    start = start_table(trial, seed)
    ways = {
        "twin as it was": (trial.twin, [x.run for x in later]),
        "found effects": (with_found, [x.run for x in later]),
        "known": (trial.twin, [x.known for x in later]),
    }
    causes = [f"{c.effect} on {c.target}" for c in found.causes]
    truth = table_from_dict(trial.table, name="truth")
    out = []
    for way, (twin, runs) in ways.items():
        table = start
        for number, (run, ride) in enumerate(zip(runs, later)):
            table = update(run, table, replace(twin, table=None)).table
            errors, normalised = scores(table, truth, ride.visited_degC)
            out.append(
                {
                    "seed": seed,
                    "way": way,
                    "update": number + 1,
                    "rms_deg_h": errors,
                    "normalised": normalised,
                    "causes": causes,
                    "planted": [f"{p.effect} on {p.target}" for p in trial.truth],
                }
            )
    return out


def later_runs(trial: Trial, seed: int) -> list[Later]:
    """Ten runs of the unit after those that were diagnosed."""
    plan = replace(trial_runs.plan_named("four"), with_gnss=False)
    out: list[Later] = []
    for block in range(-(-UPDATES // len(plan.starts))):
        bases = trial_runs.base_runs(
            50000 + 100 * seed + block, plan, table=trial.table, twin=trial.twin
        )
        for base in bases:
            warm = base.seen.gyro_degC[:: int(EVERY_S / base.seen.dt_s)]
            out.append(Later(lay_over(base, trial.truth), base.run, warm))
    return out[:UPDATES]


def start_table(trial: Trial, seed: int) -> ThermalTable:
    """The unit's table of before: off by a constant of each gyro, drawn from its sigma."""
    rng = np.random.default_rng([seed, 12])
    axes = {}
    for axis, entry in trial.table["axes"].items():
        off = START_SIGMA_DEG_H * float(rng.standard_normal())
        axes[axis] = {
            **entry,
            "bias_deg_h": [b + off for b in entry["bias_deg_h"]],
            "sigma_deg_h": [START_SIGMA_DEG_H] * len(entry["bias_deg_h"]),
        }
    return table_from_dict({**trial.table, "axes": axes}, name="start")


def scores(
    table: ThermalTable, truth: ThermalTable, visited_degC: np.ndarray
) -> tuple[float, float]:
    """RMS error [deg/h] and mean squared error over variance at visited temperatures."""
    square, ratio = [], []
    for k, _ in enumerate(LEVEL):
        T = visited_degC[:, k]
        error = table.bias_deg_h(k, T) - truth.bias_deg_h(k, T)
        square.append(error**2)
        ratio.append(error**2 / table.sigma_deg_h(k, T) ** 2)
    return float(np.sqrt(np.mean(square))), float(np.mean(ratio))


def summary(rows: list[dict]) -> list[str]:
    """Both scores of each way over all units and updates, and what was found."""
    out = []
    for way in dict.fromkeys(r["way"] for r in rows):
        own = [r for r in rows if r["way"] == way]
        rms = float(np.sqrt(np.mean([r["rms_deg_h"] ** 2 for r in own])))
        normalised = float(np.mean([r["normalised"] for r in own]))
        out.append(
            f"{way}: visited RMS {rms:.4f} deg/h, squared error over variance {normalised:.2f}"
            f" ({len(own)} updates)"
        )
    for seed in dict.fromkeys(r["seed"] for r in rows):
        first = next(r for r in rows if r["seed"] == seed)
        said = "; ".join(first["causes"]) or "nothing"
        out.append(f"unit {seed}: planted {'; '.join(first['planted'])}, found {said}")
    return out


if __name__ == "__main__":
    main()
