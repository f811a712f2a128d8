"""Alignment in windows of two minutes while people board: heading error against its sigma.

    python -m benchmarks.availability_windows --logs 24 -o windows.jsonl

cuts windows out of half an hour of a ring-laser unit with its table and aligns in each alone, in
`calm` and in `boarding` of two strengths. The mean rates of a log with people aboard (physics.md
8.3) change by degrees an hour from minute to minute; that is a tilt of a milliradian a minute, and
boarding of strength 10 on the airliner of docs/environments.md.
"""

import argparse
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

import recal
from infield.table.file import table_from_dict
from ins.records import Site
from ins.twin_file import default_twin
from ins.units import DEG
from tests.cut import cut_run
from trajectories.simulator.environments.kinds import Environment
from trajectories.simulator.motions import lay
from trajectories.simulator.segments import Park
from trajectories.simulator.sensors import ideal_sensors
from trajectories.simulator.session import SessionPlan, simulate_run
from trajectories.simulator.thermal import thermal_history
from trajectories.simulator.truth import build_truth
from trajectories.simulator.unit_truth import aged_unit

LOG_S, WINDOW_S = 1800.0, 120.0
RATE_HZ = 50.0
AROUND = (("calm", 1.0), ("boarding", 1.0), ("boarding", 10.0))
LAT_DEG, HEADING_DEG = 34.0, 90.6  # of that log


def log_windows(kind: str, strength: float, seed: int, count: int) -> list[dict[str, Any]]:
    """Records of some windows of one log, evenly apart: all of one unit, whose bias they share, so
    that many units say more than many windows.
    """
    rng = np.random.default_rng([seed, 120])
    site = Site(lat_rad=LAT_DEG * DEG, lon_rad=7 * DEG, height_m=250.0)
    motion = lay([Park(duration_s=LOG_S)], alignment_s=LOG_S)
    ideal = ideal_sensors(build_truth(motion, site, heading_rad=HEADING_DEG * DEG), RATE_HZ)
    unit = aged_unit(rng, gyro_technology="rlg")
    twin = default_twin("rlg")
    plan = SessionPlan(environments=(Environment(kind=kind, strength=strength),), with_phases=False)
    made = simulate_run(ideal, thermal_history("ambient"), unit, twin, rng=rng, plan=plan)
    table = table_from_dict(unit.factory_table(), name="factory")
    found = []
    for start_s in np.linspace(0.0, LOG_S - WINDOW_S, count):
        window = cut_run(made.run, start_s, start_s + WINDOW_S)
        aligned = recal.align(window, table, twin)
        at_s = aligned.document["time_s"]
        heading_rad = np.interp(at_s, made.reference.time_s, made.reference.heading_rad)
        error_deg = aligned.heading_deg - heading_rad / DEG
        found.append(
            {
                "kind": kind,
                "strength": strength,
                "seed": seed,
                "start_s": float(start_s),
                "verdict": str(aligned.verdict),
                "error_deg": float((error_deg + 180.0) % 360.0 - 180.0),
                "sigma_deg": aligned.sigma_heading_deg,
            }
        )
    return found


def window_table(records: Sequence[dict[str, Any]]) -> str:
    """A Markdown table."""
    rows = [
        "| around | windows | aligned | error over sigma, RMS | sigma, deg RMS | error, deg RMS |",
        "|---|---|---|---|---|---|",
    ]
    for kind, strength in AROUND:
        some = [r for r in records if (r["kind"], r["strength"]) == (kind, strength)]
        good = [r for r in some if r["verdict"] == "aligned"]
        if not good:
            rows.append(f"| `{kind}` of {strength:g} | {len(some)} | 0 | | | |")
            continue
        error, sigma = (np.array([r[key] for r in good]) for key in ("error_deg", "sigma_deg"))
        rows.append(
            f"| `{kind}` of {strength:g} | {len(some)} | {len(good)} |"
            f" {np.sqrt(np.mean((error / sigma) ** 2)):.2f} | {np.sqrt(np.mean(sigma**2)):.3f} |"
            f" {np.sqrt(np.mean(error**2)):.3f} |"
        )
    return "\n".join(rows) + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--logs", type=int, default=24)
    parser.add_argument("--windows", type=int, default=3, help="of each log")
    parser.add_argument("-o", "--output", type=Path, default=Path("windows.jsonl"))
    options = parser.parse_args()
    records: list[dict[str, Any]] = []
    for seed in range(options.logs):
        for kind, strength in AROUND:
            records += log_windows(kind, strength, seed, options.windows)
            lines = [json.dumps(record) for record in records]
            options.output.write_text("\n".join([*lines, ""]), encoding="utf-8")
    print(window_table(records))


if __name__ == "__main__":
    main()
