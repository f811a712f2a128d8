"""False alarms of thermometers that round: no effect at all, noise from 0.1 to 10 resolutions.

Each trial is a run that warms up while it stands. Its thermometers are written anew: the truth,
air that wanders by `WANDER_DEGC` (a Gauss-Markov process that the twin knows nothing of), white
noise of NOISES resolutions, and rounding, all declared in the twin but the air. The whole diagnosis
is made,
with the whole catalogue, and it should find nothing.
"""

from dataclasses import replace

import numpy as np
from scipy.signal import lfilter

from benchmarks.gap_trials.runs import NODES_DEGC
from benchmarks.gap_trials.trial import Trial, draw_trial
from benchmarks.study import Record, Work, share, table
from infield.table.file import table_from_dict
from ins.records import Run, TwinModel
from simreal.inference.diagnosis import Diagnosis, DiagnosisSettings, diagnose
from simreal.report.diagnosis_words import verdict_sentence

RESOLUTION_DEGC = 0.01
NOISES = (0.1, 0.2, 0.5, 0.7, 1.0, 2.0, 5.0, 10.0)  # in resolutions
WANDER_DEGC, WANDER_S = 0.004, 20.0
REPLICATES = 150


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


def null(seed: int, minutes: float) -> Record:
    """What is said of one null."""
    noise = NOISES[seed % len(NOISES)]
    found = diagnosed(seed, noise, 60.0 * minutes)
    left = found.unexplained.present and any(p.channel == "temperature" for p in found.where)
    return {
        "noise": noise,
        "alarm": found.verdict != "no_gap",
        "thermometer": left or any(c.target == "temperature" for c in found.causes),
        "p_value": found.gap.p_value,
        "said": verdict_sentence(found),
    }


def row(name: str, of: list[Record]) -> list[object]:
    return [name, share(sum(r["alarm"] for r in of), len(of)), sum(r["thermometer"] for r in of)]


def run(work: Work, *, trials: int = 400, first: int = 0, minutes: float = 30.0) -> str:
    records = work.each(null, [(seed, minutes) for seed in range(first, first + trials)])
    by_noise = {n: [r for r in records if r["noise"] == n] for n in NOISES}
    rows = [row(f"{n:g} resolutions", of) for n, of in by_noise.items() if of]
    return table(("noise", "alarms", "of the thermometers"), [*rows, row("**all**", records)])
