"""Aged tables without any effect: what the diagnosis says of them, and what an update makes of its
twin.

    python -m benchmarks.aged_tables run FIRST LAST -o aged.jsonl
    python -m benchmarks.aged_tables table aged.jsonl

Each unit has the packaged parked-and-taxi scenarios (cold, ambient, hot, cooling) at 10 Hz with its
factory table, and has aged by 0.0072 deg/h RMS, as the table's sigma says. The four sessions are
diagnosed, then updated with the unit's own twin and with the one that the diagnosis wrote. Errors
are of the table against the true unit, at the temperatures that the sessions visited.
"""

import argparse
import json
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from infield.session.pipeline import update_calibration
from infield.table.file import table_from_dict
from infield.table.thermal_table import ThermalTable
from ins.records import Run, TwinModel
from ins.twin_file import default_twin, twin_from_dict
from recal.service.inputs.twin_effects import without_found_effects
from simreal.inference.diagnosis import Diagnosis, diagnose
from simreal.twin.write_back import twin_with_causes
from trajectories.simulator.scenario import read_scenario, simulate_scenario
from trajectories.simulator.unit_truth import UnitTruth

SESSIONS = {
    "cold_parked_taxi": "2026-03-01T05:00:00Z",
    "ambient_parked_taxi": "2026-04-12T06:30:00Z",
    "hot_parked_taxi": "2026-06-20T11:00:00Z",
    "cooling_parked_taxi": "2026-06-21T05:00:00Z",
}
RATE_HZ = 10.0
SCORED_TEMPERATURES = 50
SEED = 3500


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.aged_tables", description=__doc__)
    commands = parser.add_subparsers(dest="command", required=True)
    run = commands.add_parser("run")
    run.add_argument("first", type=int)
    run.add_argument("last", type=int)
    run.add_argument("-o", "--output", type=Path, required=True)
    table = commands.add_parser("table")
    table.add_argument("units", type=Path)
    options = parser.parse_args()
    if options.command == "run":
        for seed in range(options.first, options.last):
            with options.output.open("a", encoding="utf-8") as out:
                out.write(json.dumps(one_unit(seed)) + "\n")
        return
    lines = options.units.read_text(encoding="utf-8").splitlines()
    print("\n".join(table_lines([json.loads(line) for line in lines])))


def sessions_of(seed: int) -> tuple[list[Run], UnitTruth]:
    """Four power-ons of one aged unit, and its truth."""
    runs, units = [], []
    for k, (name, start_utc) in enumerate(SESSIONS.items()):
        plan = read_scenario(name)
        plan = replace(
            plan,
            imu=replace(plan.imu, rate_hz=RATE_HZ),
            unit=replace(plan.unit, ageing_seed=SEED + seed),
            run=replace(plan.run, start_utc=start_utc),
        )
        simulated, unit = simulate_scenario(plan, seed=len(SESSIONS) * seed + k)
        runs.append(simulated.run)
        units.append(unit)
    return runs, units[-1]


def one_unit(seed: int) -> dict:
    """What is said of one unit, and how far off its table is before and after its updates."""
    runs, unit = sessions_of(seed)
    factory = table_from_dict(unit.factory_table(), name="factory")
    twin = replace(default_twin(unit.gyro_technology), imu_serial=unit.imu_serial)
    begun = time.process_time()
    found = diagnose(runs, twin, factory)
    diagnosed_s = time.process_time() - begun
    written = twin_with_causes(twin, found.causes, [v.name for v in found.views], with_table=False)
    diagnosed = twin_from_dict(written, source="diagnosed", name="twin.json")
    T = _visited(found)
    return {
        "seed": seed,
        "verdict": found.verdict,
        "sentence": found.sentence,
        "causes": [
            {"effect": c.effect, "target": c.target, "probability": c.probability, "size": c.size}
            for c in found.causes
        ],
        "written": [f"{e['effect']}@{e['target']}" for e in written.get("effects", [])],
        "before": _error(unit, factory, T),
        "without_twin": _error(unit, _updated(runs, factory, twin), T),
        "with_twin": _error(unit, _updated(runs, factory, diagnosed), T),
        "cpu_s": round(diagnosed_s, 1),
    }


def _updated(runs: list[Run], table: ThermalTable, twin: TwinModel) -> ThermalTable:
    """The table after an update that takes what the twin lists out of the log."""
    less, believed, _ = without_found_effects(runs, twin, table)
    return update_calibration(less, table, believed).after


def _visited(found: Diagnosis) -> NDArray:
    """Temperatures between the coldest and the warmest that the sessions visited (k,) [degC]."""
    seen = [v.telemetry.temperature_degC for v in found.views]
    every = np.concatenate([T.ravel() for T in seen if T is not None])
    return np.linspace(every.min(), every.max(), SCORED_TEMPERATURES)


def _error(unit: UnitTruth, table: ThermalTable, T: NDArray) -> dict:
    """Mean error of each gyro's table, its sigma and the RMS error [deg/h]."""
    out = {}
    for axis in "xyz":
        rows = table.basis(axis, T)
        error = rows @ table.parameters - unit.bias_deg_h(axis, T)
        mean = rows.mean(axis=0)
        out[axis] = {
            "mean": float(error.mean()),
            "sigma": float(np.sqrt(mean @ table.covariance @ mean)),
            "rms": float(np.sqrt(np.mean(error**2))),
        }
    return out


def table_lines(units: list[dict]) -> list[str]:
    """What was named, and the tables' errors before and after."""
    alarms = [u for u in units if any(c["effect"] != "table_aged" for c in u["causes"])]
    named = [u for u in units if any(c["effect"] == "table_aged" for c in u["causes"])]
    taken = [u for u in units if u["written"]]
    out = [
        f"{len(units)} units: table_aged named in {len(named)}, another cause in {len(alarms)},"
        f" {sum(u['verdict'] == 'no_gap' for u in units)} without a gap;"
        f" effects written for an update in {len(taken)}",
        "| table | RMS error | error over sigma, RMS | largest |",
        "|" + "---|" * 4,
    ]
    for key in ("before", "without_twin", "with_twin"):
        every = [u[key][axis] for u in units for axis in "xyz"]
        rms = np.sqrt(np.mean([e["rms"] ** 2 for e in every]))
        ratio = np.array([e["mean"] / e["sigma"] for e in every])
        out.append(
            f"| {key.replace('_', ' ')} | {rms:.4f} deg/h | {np.sqrt(np.mean(ratio**2)):.2f}"
            f" | {np.abs(ratio).max():.1f} |"
        )
    return out


if __name__ == "__main__":
    main()
