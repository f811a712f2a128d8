"""False alarms of thermometers that round: no effect at all, noise from 0.1 to 10 resolutions.

    python -m benchmarks.gap_nulls [TRIALS] [--first 0] [--minutes 15] [--until HH:MM]
        [-o ROWS.jsonl]

Each trial is a run that warms up while it stands. Its thermometers are written anew: the truth,
air that wanders by `WANDER_DEGC` (a Gauss-Markov process that the twin knows nothing of), white
noise of NOISES resolutions, and rounding, all declared in the twin but the air. The whole diagnosis
is made,
with the whole catalogue, and it should find nothing. A row is appended to the output as its trial
is done; what was interrupted goes on where it stopped.
"""

import argparse
import json
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from scipy.signal import lfilter
from scipy.stats import beta

from benchmarks.gap_trials.runs import NODES_DEGC
from benchmarks.gap_trials.trial import Trial, draw_trial
from infield.table.file import table_from_dict
from ins.records import Run, TwinModel
from simreal.inference.diagnosis import Diagnosis, DiagnosisSettings, diagnose

RESOLUTION_DEGC = 0.01
NOISES = (0.1, 0.2, 0.5, 0.7, 1.0, 2.0, 5.0, 10.0)  # in resolutions
WANDER_DEGC, WANDER_S = 0.004, 20.0
REPLICATES = 150


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.gap_nulls", description=__doc__)
    parser.add_argument("trials", type=int, nargs="?", default=400)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--minutes", type=float, default=15.0)
    parser.add_argument("--until", default="", help="UTC, HH:MM: begin no trial later")
    parser.add_argument("-o", "--output", type=Path)
    options = parser.parse_args()
    wanted = range(options.first, options.first + options.trials)
    rows = [row for row in _kept(options.output) if row["seed"] in wanted]
    done = {row["seed"] for row in rows}
    for seed in wanted:
        if options.until and datetime.now(UTC).strftime("%H:%M") >= options.until:
            break
        if seed in done:
            continue
        noise = NOISES[seed % len(NOISES)]
        found = diagnosed(seed, noise, 60.0 * options.minutes)
        thermal = any(c.target == "temperature" for c in found.causes) or (
            found.left_present and any(p.channel == "temperature" for p in found.where)
        )
        rows.append(
            {
                "seed": seed,
                "noise": noise,
                "alarm": found.verdict != "no_gap",
                "thermometer": thermal,
                "p_value": found.p_value,
                "said": found.sentence,
            }
        )
        if options.output:
            with options.output.open("a", encoding="utf-8") as file:
                file.write(json.dumps(rows[-1]) + "\n")
    for line in summary(rows):
        print(line)


def _kept(output: Path | None) -> list[dict]:
    """Rows of an earlier call."""
    if output is None or not output.exists():
        return []
    return [json.loads(line) for line in output.read_text(encoding="utf-8").splitlines()]


def diagnosed(seed: int, noise: float, parked_s: float) -> Diagnosis:
    """The diagnosis of one null."""
    trial = draw_trial(8000 + seed, effects=0, plan="one_cold", parked_s=parked_s, with_gnss=False)
    twin = replace(
        trial.twin,
        temperature=replace(
            trial.twin.temperature,
            noise_degC=noise * RESOLUTION_DEGC,
            resolution_degC=RESOLUTION_DEGC,
        ),
    )
    table = table_from_dict(trial.table, name="trial")
    return diagnose(
        [read_anew(trial, twin, seed)], twin, table, DiagnosisSettings(replicates=REPLICATES)
    )


def read_anew(trial: Trial, twin: TwinModel, seed: int) -> Run:
    """The run with thermometers that the twin's noise and resolution describe, in air that
    wanders.
    """
    run, seen = trial.runs_without[0], trial.seen[0]
    rng, log = np.random.default_rng([seed, 9]), run.temperature
    assert log is not None
    true = np.stack(
        [np.interp(log.time_s, seen.time_s - 0.5 * seen.dt_s, T) for T in seen.gyro_degC.T], axis=1
    )
    keep = np.exp(-float(np.median(np.diff(log.time_s))) / WANDER_S)
    kicks = np.sqrt(1.0 - keep**2) * WANDER_DEGC * rng.standard_normal(log.time_s.size)
    air = lfilter([1.0], [1.0, -keep], kicks)[:, None]
    step, sigma = twin.temperature.resolution_degC, twin.temperature.noise_degC
    read = step * np.round((true + air + sigma * rng.standard_normal(true.shape)) / step)
    return replace(
        run, temperature=replace(log, gyro_degC=np.clip(read, NODES_DEGC[0], NODES_DEGC[-1]))
    )


def summary(rows: list[dict]) -> list[str]:
    """Alarms of all trials and of each noise, with the interval of Clopper and Pearson."""
    out = [_line("all", rows)]
    out += [_line(f"noise {n:g} resolutions", [r for r in rows if r["noise"] == n]) for n in NOISES]
    return out


def _line(name: str, rows: list[dict]) -> str:
    n, alarms = len(rows), sum(r["alarm"] for r in rows)
    thermal = sum(r["thermometer"] for r in rows)
    low = beta.ppf(0.025, alarms, n - alarms + 1) if alarms else 0.0
    high = beta.ppf(0.975, alarms + 1, n - alarms) if alarms < n else 1.0
    return (
        f"{name}: {alarms} of {n} alarms ({100 * low:.1f} to {100 * high:.1f} %),"
        f" {thermal} of the thermometers"
    )


if __name__ == "__main__":
    main()
