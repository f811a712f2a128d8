"""How often a check of a right twin calls it wrong, and how often it finds a wrong one, where
people and wind move the vehicle.

    python -m benchmarks.twin_check run FIRST LAST -o sessions.jsonl
    python -m benchmarks.twin_check table sessions.jsonl
    python -m benchmarks.twin_check bands rlg gusty

Each session is 40 minutes parked at 100 Hz with the default twin of its technology; technologies
(RLG, FOG, MEMS) and environments take turns. It is checked with the twin that made it, and with
twins that declare one size half or twice as large. `bands` prints, of one such session, the power
of each channel over the declared one, band by band.
"""

import argparse
import json
import time
from collections.abc import Iterator
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from ins.records import Run, Site, TwinModel
from ins.twin_file import default_twin
from ins.units import DEG
from simreal.report.twin_check_document import cell_words
from simreal.twin.fit.agreement import MISFIT_P, agreement
from simreal.twin.fit.streams import stream_of
from trajectories.simulator.environments.kinds import Environment
from trajectories.simulator.motions import lay
from trajectories.simulator.segments import Park
from trajectories.simulator.sensors import IdealSensors, ideal_sensors
from trajectories.simulator.session import SessionPlan, simulate_run
from trajectories.simulator.thermal import thermal_history
from trajectories.simulator.truth import build_truth
from trajectories.simulator.unit_truth import aged_unit

TECHNOLOGIES = ("rlg", "fog", "mems")
ENVIRONMENTS = ("calm", "gusty", "boarding", "ship")
SIZES = (
    ("gyro", "arw_deg_sqrt_h"),
    ("gyro", "bias_instability_deg_h"),
    ("accel", "vrw_ug_sqrt_hz"),
    ("accel", "bias_instability_ug"),
)
FACTORS = (0.5, 2.0)


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.twin_check", description=__doc__)
    commands = parser.add_subparsers(dest="command", required=True)
    run = commands.add_parser("run")
    run.add_argument("first", type=int)
    run.add_argument("last", type=int)
    run.add_argument("-o", "--output", type=Path, required=True)
    table = commands.add_parser("table")
    table.add_argument("sessions", type=Path, nargs="+")
    bands = commands.add_parser("bands")
    bands.add_argument("technology", choices=TECHNOLOGIES)
    bands.add_argument("environment", choices=ENVIRONMENTS)
    options = parser.parse_args()
    if options.command == "run":
        for seed in range(options.first, options.last):
            with options.output.open("a", encoding="utf-8") as out:
                out.write(json.dumps(one_session(seed)) + "\n")
    elif options.command == "table":
        lines = [line for path in options.sessions for line in path.read_text().splitlines()]
        print("\n".join(table_lines([json.loads(line) for line in lines])))
    else:
        print("\n".join(band_lines(options.technology, options.environment)))


@lru_cache(maxsize=1)
def _ideal() -> IdealSensors:
    site = Site(lat_rad=45 * DEG, lon_rad=7 * DEG, height_m=250.0)
    motion = lay((Park(duration_s=2400.0),))
    truth = build_truth(motion, site, heading_rad=0.6, roll_rad=0.01, pitch_rad=-0.02)
    return ideal_sensors(truth, 100.0)


def session(technology: str, environment: str, seed: int) -> tuple[TwinModel, Run]:
    """A parked session and the twin that made it."""
    rng = np.random.default_rng([seed, 161])
    twin = default_twin(technology)
    unit = aged_unit(rng, gyro_technology=technology)
    plan = SessionPlan(environments=(Environment(kind=environment),))
    made = simulate_run(_ideal(), thermal_history("ambient"), unit, twin, rng=rng, plan=plan)
    return twin, made.run


def one_session(seed: int) -> dict:
    """One session under its own twin, and under wrong ones."""
    technology = TECHNOLOGIES[seed % len(TECHNOLOGIES)]
    environment = ENVIRONMENTS[seed // len(TECHNOLOGIES) % len(ENVIRONMENTS)]
    twin, run = session(technology, environment, seed)
    stream = stream_of(run, twin)
    found = {"seed": seed, "technology": technology, "environment": environment}
    if stream is None:
        return found | {"verdict": "refused"}
    began = time.process_time()
    right = agreement([stream], twin)
    cpu_s = time.process_time() - began
    if right is None:
        return found | {"verdict": "refused"}
    wrong = {}
    for name, factor, other in wrong_twins(twin):
        seen = agreement([stream], other)
        wrong[f"{name} {factor:g}"] = seen is not None and not seen.fits
    return found | {
        "verdict": "fits" if right.fits else "does not fit",
        "p_value": right.p_value,
        "cells": [cell_words(c) for c in right.misfits],
        "cpu_s": cpu_s,
        "wrong": wrong,
    }


def wrong_twins(twin: TwinModel) -> Iterator[tuple[str, float, TwinModel]]:
    """The name of a size, a factor, and a twin that declares the size so much larger."""
    for section, key in SIZES:
        record = getattr(twin, section)
        for factor in FACTORS:
            off = replace(record, **{key: factor * getattr(record, key)})
            yield f"{section}.{key}", factor, replace(twin, **{section: off})


def table_lines(sessions: list[dict]) -> list[str]:
    """False notes and notes on wrong twins, by technology and environment."""
    head = "| unit | environment | sessions | too little rest | right twin called wrong"
    lines = [head + " | found: white noise off by 2 | found: flicker off by 2 |", "|" + "---|" * 7]
    for technology in TECHNOLOGIES:
        for environment in ENVIRONMENTS:
            own = [s for s in sessions if s["technology"] == technology]
            own = [s for s in own if s["environment"] == environment]
            if own:
                lines.append(_row(technology, environment, own))
    judged = [s for s in sessions if s["verdict"] != "refused"]
    false = sum(s["verdict"] != "fits" for s in judged)
    cpu = np.median([s["cpu_s"] for s in judged])
    lines += ["", f"{false} of {len(judged)} right twins called wrong (stated: {MISFIT_P:.0%});"]
    lines.append(f"CPU of a check once the seconds are read: {cpu:.3f} s (median).")
    return lines


def _row(technology: str, environment: str, own: list[dict]) -> str:
    judged = [s for s in own if s["verdict"] != "refused"]
    false = sum(s["verdict"] != "fits" for s in judged)
    white = [v for s in judged for k, v in s["wrong"].items() if "instability" not in k]
    flicker = [v for s in judged for k, v in s["wrong"].items() if "instability" in k]
    return (
        f"| {technology} | {environment} | {len(own)} | {len(own) - len(judged)}"
        f" | {false} of {len(judged)} | {sum(white)} of {len(white)}"
        f" | {sum(flicker)} of {len(flicker)} |"
    )


def band_lines(technology: str, environment: str) -> list[str]:
    """What a check sees of each channel, band by band."""
    twin, run = session(technology, environment, 1)
    stream = stream_of(run, twin)
    seen = None if stream is None else agreement([stream], twin)
    if seen is None:
        return ["too little rest"]
    return [
        f"{c.channel:8s} {c.low_hz:6.3g} to {c.high_hz:6.3g} Hz  {c.ratio:10.4g}"
        f" times the declared power, {c.dof:6.0f} degrees of freedom, {c.of}"
        for c in seen.cells
    ]


if __name__ == "__main__":
    main()
