"""Which channel and band scatter more than the twin says, over runs with no effect at all.

    python -m benchmarks.gap_null_cells [RUNS] [--first 0] [--minutes 30]

The runs of benchmarks.gap_nulls, looked at only: their squares by channel and band over what the
twin expects, summed over all runs. A sum that is off by more than 3 of its sigmas is where false
alarms beyond the level come from. No effect is sought, so a run takes a few seconds.
"""

import argparse
from collections import defaultdict
from dataclasses import replace

import numpy as np

from benchmarks.gap_nulls import NOISES, RESOLUTION_DEGC, read_anew
from benchmarks.gap_trials.trial import draw_trial
from infield.table.file import table_from_dict
from simreal.evidence.run_view import view_run
from simreal.evidence.whitened import SENSORS, Evidence
from simreal.inference.locate import cells_of, measure_cells
from simreal.inference.noise_hypotheses import Squares

SHOWN_SIGMAS = 2.0
Key = tuple[str, str]


def main() -> None:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.gap_null_cells", description=__doc__
    )
    parser.add_argument("runs", type=int, nargs="?", default=40)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--minutes", type=float, default=30.0)
    options = parser.parse_args()
    squares: dict[Key, list[tuple[float, float]]] = defaultdict(list)
    tails: dict[Key, list[tuple[float, float]]] = defaultdict(list)
    for seed in range(options.first, options.first + options.runs):
        evidence = null(seed, 60.0 * options.minutes)
        for key, rho, n in cells(evidence):
            squares[key].append((rho, n))
        for channel, kurtosis, n in kurtoses(evidence):
            tails[channel, "kurtosis"].append((kurtosis, n))
    for line in summary(squares, tails):
        print(line)


def null(seed: int, parked_s: float) -> Evidence:
    """The evidence of one run of benchmarks.gap_nulls."""
    noise = NOISES[seed % len(NOISES)] * RESOLUTION_DEGC
    trial = draw_trial(8000 + seed, effects=0, plan="one_cold", parked_s=parked_s, with_gnss=False)
    read = replace(trial.twin.temperature, noise_degC=noise, resolution_degC=RESOLUTION_DEGC)
    twin = replace(trial.twin, temperature=read)
    table = table_from_dict(trial.table, name="trial")
    view = view_run(read_anew(trial, twin, seed), 0, table, twin)
    assert not isinstance(view, str), view
    return Evidence([view], twin)


def cells(evidence: Evidence) -> list[tuple[Key, float, float]]:
    squares = Squares(evidence)
    found = cells_of(evidence, squares)
    ratio = squares.ratio(evidence.z[:, None])
    rho, n, _ = measure_cells(found, squares.dof, ratio)
    names = [(c.channel, "moving" if c.moving else f"band {c.octave}") for c in found]
    return [(name, float(r[0]), float(m)) for name, r, m in zip(names, rho, n)]


def kurtoses(evidence: Evidence) -> list[tuple[str, float, float]]:
    """Fourth moment less 3 of the parked rows of each sensor, and how many there are."""
    bins = evidence.runs[0].parked.bins
    z = evidence.z[: SENSORS * bins].reshape(SENSORS, bins)
    names = ("gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z")
    fourth = (z**4).mean(axis=1) - 3.0 * (z**2).mean(axis=1) ** 2
    return [(name, float(k), float(bins)) for name, k in zip(names, fourth)]


def summary(
    squares: dict[Key, list[tuple[float, float]]], tails: dict[Key, list[tuple[float, float]]]
) -> list[str]:
    """Every sum that is off by more than SHOWN_SIGMAS, the largest first; then how many were
    looked at.
    """
    found = []
    for key, values in squares.items():
        rho, n = np.array(values).T
        mean = float((n * rho).sum() / n.sum())
        found.append((mean, float((mean - 1.0) / np.sqrt(2.0 / n.sum())), key))
    for key, values in tails.items():
        fourth, n = np.array(values).T
        found.append(
            (float(fourth.mean()), float(fourth.mean() / np.sqrt(24.0 / n.mean() / n.size)), key)
        )
    found.sort(key=lambda item: -abs(item[1]))
    lines = [
        f"{channel}, {band}: {mean:.3f}, {sigmas:+.1f} sigmas"
        for mean, sigmas, (channel, band) in found
        if abs(sigmas) > SHOWN_SIGMAS
    ]
    return [*lines, f"{len(found)} sums, {len(next(iter(squares.values())))} runs"]


if __name__ == "__main__":
    main()
