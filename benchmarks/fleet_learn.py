"""What `recal fleet learn` finds of simulated fleets, against the truth.

Example: nice -n 5 .venv/bin/python -m benchmarks.fleet_learn --fleets 40 --out FLEETS.jsonl

A line a fleet; --summary prints the figures of docs/fleet_learn.md from such a file, and
benchmarks/fleet_forecast.py judges the dates that follow from it.
"""

import argparse
import json
import os
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.fleet_made import NODES, made_fleet
from infield.learning.kept import covering
from infield.learning.learn import learn
from infield.learning.likelihood import FleetLikelihood
from infield.learning.parameters import OF_POINTS, defaults_of, logs_of

VISITED_WITHIN = 5.0  # degC of a point of the unit's sessions


def one_fleet(seed, **options):
    """Everything that is judged of one fleet, as a line of JSON: its last session is held out."""
    sessions = options.get("sessions", 8)
    fleet, value = made_fleet(seed, **{**options, "sessions": sessions + 1})
    known = [without_last(m.kept) for m in fleet]
    began = time.process_time()
    found = learn(known)
    cpu_s = round(time.process_time() - began, 1)
    told = {
        name: {
            "true": value[name],
            "value": found.parameters[name].value,
            "low": found.parameters[name].interval_95[0],
            "high": found.parameters[name].interval_95[1],
            "sigma_log": found.parameters[name].sigma_log,
            "shown": found.parameters[name].shown,
        }
        for name in OF_POINTS
    }
    learnt = logs_of({name: found.parameters[name].value for name in OF_POINTS})
    thetas = {"learnt": learnt, "default": logs_of(defaults_of("rlg")), "true": logs_of(value)}
    whole = FleetLikelihood([m.kept for m in fleet])
    before = FleetLikelihood(known)
    sound = np.array([not m.outliers[-1] for m in fleet])
    document = {
        "seed": seed,
        "parameters": told,
        "effective": found.check.effective,
        "asked": found.check.draws,
        "settled": found.settled,
        "options": options,
        "cpu_s": cpu_s,
        "units": [
            {
                name: [found.of_units[u][name].value, *found.of_units[u][name].interval_95]
                for name in OF_POINTS
            }
            for u in range(len(fleet))
        ],
    }
    for name, theta in thetas.items():
        evidence = whole(theta)
        document[name] = {
            "nis": float(evidence.nis[sound, -1].sum() / evidence.dof[sound, -1].sum()),
            "log_likelihood": float(evidence.log_likelihood.sum()),
            **rms(fleet, before(theta)),
        }
    return document


def without_last(kept):
    return replace(kept, sessions=kept.sessions[:-1])


def rms(fleet, evidence):
    """RMS error of the level gyros' nodes, those near a session's points and the others.

    The truth is that of the held-out session, some months after the last known one: what a unit
    ages by in between is in every column.
    """
    errors = {"visited": [], "unvisited": []}
    for u, made in enumerate(fleet):
        table = covering(without_last(made.kept))
        seen = np.concatenate([s.temperature_degC for s in made.kept.sessions[:-1]])
        for axis in (0, 1):
            T = table.temperature_degC[axis]
            inside = np.isin(T, NODES)
            rows = np.r_[table.values_of(axis)][inside]
            error = evidence.mean[u, rows] - made.true.bias(axis, T[inside])
            near = np.min(np.abs(T[inside][:, None] - seen), axis=1) <= VISITED_WITHIN
            errors["visited"] += error[near].tolist()
            errors["unvisited"] += error[~near].tolist()
    return {
        name: float(np.sqrt(np.mean(np.square(values)))) if values else None
        for name, values in errors.items()
    }


def summary(lines):
    """Figures over all fleets, as text."""
    told = []
    inside, count = 0, 0
    for name in OF_POINTS:
        rows = [line["parameters"][name] for line in lines]
        held = [row["low"] <= row["true"] <= row["high"] for row in rows]
        z = [np.log(row["value"] / row["true"]) / row["sigma_log"] for row in rows]
        width = np.median([row["sigma_log"] for row in rows])
        shown = np.mean([row["shown"] for row in rows])
        inside, count = inside + sum(held), count + len(held)
        told.append(
            f"{name:28s} held {np.mean(held):6.1%}  squared error over variance"
            f" {np.mean(np.square(z)):.2f}  sigma (log) {width:.2f}  shown in {shown:.0%}"
        )
    told.append(f"all parameters: held {inside / count:.1%} of {count}")
    for which in ("learnt", "default", "true"):
        nis = [line[which]["nis"] for line in lines]
        told.append(
            f"{which:8s} next session: squared innovation mean {np.mean(nis):.3f}, median"
            f" {np.median(nis):.3f}, from {min(nis):.2f} to {max(nis):.2f}"
        )
    for place in ("visited", "unvisited"):
        values = {
            which: np.sqrt(
                np.mean([line[which][place] ** 2 for line in lines if line[which][place]])
            )
            for which in ("learnt", "default", "true")
        }
        told.append(
            f"{place:10s} RMS learnt {values['learnt']:.5f}, defaults {values['default']:.5f}, true"
            f" priors {values['true']:.5f} deg/h: {values['learnt'] / values['true']:.3f} of true"
        )
    told.append(f"CPU {np.median([line['cpu_s'] for line in lines]):.1f} s a fleet (median)")
    return told


def main(arguments=None):
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--fleets", type=int, default=40)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--spread", type=float, default=0.0)
    parser.add_argument("--out", type=Path)
    parser.add_argument("--summary", type=Path)
    asked = parser.parse_args(arguments)
    if asked.summary:
        lines = [json.loads(line) for line in asked.summary.read_text().splitlines()]
        print("\n".join(summary(lines)))
        return
    lines = []
    for seed in range(asked.first, asked.first + asked.fleets):
        lines.append(one_fleet(seed, spread=asked.spread))
        if asked.out:
            with asked.out.open("a") as file:
                file.write(json.dumps(lines[-1]) + "\n")
    print("\n".join(summary(lines)))


if __name__ == "__main__":
    main()
