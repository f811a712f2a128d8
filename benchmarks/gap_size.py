"""How large a planted effect is: norm of the whitened difference between a trial's runs with and
without it.

For noise: the size of equal information, sqrt(2 KL), KL = n/2 (rho - 1 - ln rho) summed over octave
bands.
"""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from scipy.fft import dct

from benchmarks.gap_trials.trial import Trial
from infield.table.file import table_from_dict
from simreal.evidence.run_view import RunView, view_run
from simreal.evidence.whitened import SENSORS, Evidence

NOISY = (
    "gyro_angle_random_walk",
    "gyro_bias_instability",
    "gyro_rate_random_walk",
    "gyro_gauss_markov",
    "gyro_quantization",
    "gyro_noise_thermal",
    "accel_noise",
    "platform_sway",
    "odometer_quantization",
    "one_over_f_noise",
    "jittered_stamps",
)
CLOSE = 0.05  # a size within so much of the wanted one is good


def views_of(trial: Trial, runs: Sequence) -> list[RunView]:
    """The runs as the diagnosis sees them."""
    table = table_from_dict(trial.table, name="trial")
    views = [view_run(run, k, table, trial.twin) for k, run in enumerate(runs)]
    return [v for v in views if not isinstance(v, str)]


def delta_of(trial: Trial, without: Evidence) -> float:
    """The size of what is planted in a trial."""
    planted = Evidence(views_of(trial, trial.runs), trial.twin)
    noisy = any(p.effect in NOISY for p in trial.truth)
    total = 0.0
    for a, b in zip(planted.runs, without.runs):
        n = min(a.z.size, b.z.size)
        if a.z.size != b.z.size:
            # the effect moved the end of the parked stretch: not comparable
            if a.parked.bins != b.parked.bins:
                return 0.0
            n = SENSORS * a.parked.bins
        d = a.z[:n] - b.z[:n]
        if not noisy:
            total += float(d @ d)
            continue
        total += 2.0 * _slow_information(d, a.parked.bins) + 2.0 * _quick_information(
            a.scatter, b.scatter
        )
        rest = d[SENSORS * a.parked.bins :]
        total += 2.0 * _information(1.0 + float(np.mean(rest**2)), rest.size) if rest.size else 0.0
    return float(np.sqrt(total))


def _slow_information(d: np.ndarray, bins: int) -> float:
    out = 0.0
    for c in range(SENSORS):
        y = dct(d[c * bins : (c + 1) * bins], norm="ortho")
        edges = [0, 1, 2, 4, 8, 16, 32, 64, 128, 256, bins]
        for low, high in pairwise(edges):
            if high > low and low < bins:
                out += _information(1.0 + float(np.mean(y[low:high] ** 2)), min(high, bins) - low)
    return out


def _quick_information(a, b) -> float:
    out = 0.0
    for c in range(SENSORS):
        for band in range(a.dof.shape[1]):
            n = float(a.dof[c, band].sum())
            if n > 0:
                ratio = float(
                    (a.ratio[c, band] * a.dof[c, band]).sum()
                    / (b.ratio[c, band] * b.dof[c, band]).sum()
                )
                out += _information(max(ratio, 1e-3), n)
    return out


def _information(rho: float, n: float) -> float:
    return 0.5 * n * (rho - 1.0 - np.log(rho))


def scaled(trial: Trial, wanted: float, *, tries: int = 4) -> tuple[Trial, float]:
    """The trial with its effects (all by one factor) at the wanted size, and the size reached."""
    without = Evidence(views_of(trial, trial.runs_without), trial.twin)
    size = 1.0
    reached = 0.0
    for _ in range(tries):
        trial = trial.with_sizes([size] * len(trial.truth))
        reached = delta_of(trial, without)
        if abs(reached - wanted) < CLOSE * wanted or reached == 0.0:
            break
        power = 0.6 if any(p.effect in NOISY for p in trial.truth) else 1.0
        size *= (wanted / reached) ** power
    return trial, reached
