"""How well a twin predicts updates of runs that it was not fitted to, before and after a diagnosis.

    python -m benchmarks.simulator_gap [UNITS] [--first 0] [--sigma 15] [-o FILE]

Each unit has four runs (generator of benchmarks.gap_trials, which shares no code with the
catalogue) and one planted effect. `diagnose` predicts each run from a fit to the other three, as
`recal diagnose --simulator` does; "not there" is the prediction of the same runs without the
effect, the least that any fit can reach.
"""

import argparse
import json
from pathlib import Path

from benchmarks.gap_size import scaled
from benchmarks.gap_trials.trial import Trial, draw_trial
from infield.table.file import table_from_dict
from simreal.inference.diagnosis import DiagnosisSettings, diagnose
from simreal.predict.document import QUANTITIES
from simreal.predict.held_out import Believed, HeldOutRun, predict_runs

NAMES = (
    "gyro_thermal_rate",
    "gyro_thermal_gradient",
    "gyro_thermal_linear",
    "gyro_magnetic_sensitivity",
    "accel_thermal",
)


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.simulator_gap", description=__doc__)
    parser.add_argument("units", type=int, nargs="?", default=5)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--sigma", type=float, default=15.0)
    parser.add_argument("-o", "--output", type=Path)
    options = parser.parse_args()
    rows = []
    for seed in range(options.first, options.first + options.units):
        rows.append(unit(seed, options.sigma))
        print(json.dumps(rows[-1]), flush=True)
    if options.output:
        options.output.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")


def unit(seed: int, sigma: float) -> dict:
    """Every quantity of one unit: the twin as it was, with what was found, with nothing planted."""
    name = NAMES[seed % len(NAMES)]
    drawn = draw_trial(9500 + seed, names=[name], plan="four", with_gnss=False)
    trial, _ = scaled(drawn, sigma)
    runs = predicted(trial)
    clean = predicted(trial, without=True)
    (planted,) = trial.truth
    out = {"seed": seed, "planted": f"{planted.effect} on {planted.target}"}
    out["found"] = sorted({f"{e} on {t}" for run in runs for e, t in run.found})
    for quantity in QUANTITIES:
        pairs = [(quantity.of(run.before), quantity.of(run.after)) for run in runs]
        before, after = ([d for d in side if d is not None] for side in zip(*pairs))
        least = [d for run in clean if (d := quantity.of(run.before)) is not None]
        gone = quantity.gone(before, after)
        out[quantity.name] = {
            "before": quantity.gap(before).measured,
            "after": quantity.gap(after).measured,
            "not_there": quantity.gap(least).measured,
            "gone": gone.fraction,
            "interval_95": gone.interval_95,
        }
    return out


def predicted(trial: Trial, *, without: bool = False) -> tuple[HeldOutRun, ...]:
    """The predictions of all runs; without: of the runs without the effect, with no effect in the
    catalogue.
    """
    table = table_from_dict(trial.table, name="truth")
    runs = trial.runs_without if without else trial.runs
    how = DiagnosisSettings(seed=trial.seed)
    if without:
        # 20: as few as give a threshold; nothing is named, the prediction is that of the twin
        how = DiagnosisSettings(seed=trial.seed, effects=(), replicates=20)
    found = diagnose(runs, trial.twin, table, how)
    believed = Believed(trial.twin, table, "")
    return predict_runs(runs, believed, table, how, found).runs


if __name__ == "__main__":
    main()
