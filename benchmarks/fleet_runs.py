"""A made-up fleet with known truth for `recal fleet update`: runs of many aged units at 10 Hz, some
of them bad on purpose.

    python benchmarks/fleet_runs.py OUT [--units 200] [--runs 10] [--seed 1]

OUT/runs/SERIAL/NN: 30 min parked, then a taxi with two turns, one power-on every four weeks,
another start temperature and heading each; OUT/recal.db: the factory tables; OUT/truth.json: each
unit's true curve and what each run is meant to be (KINDS). `benchmarks/fleet_score.py` compares
what the fleet update made of them with it.
"""

import argparse
import json
import shutil
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from infield.store.table_store import TableStore
from ins.records import AXES, Run, Site, TwinModel
from ins.units import DEG
from trajectories.runs.directory import write_run
from trajectories.simulator.motions import lay
from trajectories.simulator.segments import Park, Segment, Stop, Straight, Turn
from trajectories.simulator.sensors import IdealSensors, ideal_sensors
from trajectories.simulator.session import SessionPlan, simulate_run
from trajectories.simulator.thermal import STARTS, thermal_history
from trajectories.simulator.truth import build_truth
from trajectories.simulator.unit_truth import UnitTruth, aged_unit

RATE_HZ = 10.0
HEADINGS_DEG = np.arange(0.0, 360.0, 45.0)
GRID_DEGC = np.arange(-20.0, 66.0, 1.0)
FIRST_START = datetime(2026, 2, 1, 5, 0, tzinfo=UTC)
PARKED_S, SHORT_S = 1800.0, 240.0
KINDS = {  # kind of run: share of all
    "sound": 0.93,
    "cut file": 0.01,
    "broken run.json": 0.01,
    "no temperature": 0.01,
    "too short": 0.01,
    "another unit's": 0.01,
    "copy of the one before": 0.01,
    "clock at 1970": 0.01,
}
# one unit in so many steps away from its table at half time, gyro x
STEPPED_EVERY, STEP_DEG_H = 25, 0.05


def taxi(parked_s: float) -> tuple[Segment, ...]:
    """Parked, two legs after right turns, stops."""
    leg = (Turn(angle_deg=90.0), Straight(duration_s=60.0), Stop(duration_s=60.0))
    return (Park(duration_s=parked_s), *leg, *leg)


@lru_cache(maxsize=32)
def ideal(heading_deg: float, parked_s: float) -> IdealSensors:
    site = Site(lat_rad=45 * DEG, lon_rad=7 * DEG, height_m=250.0)
    segments = taxi(parked_s) if parked_s > SHORT_S else (Park(duration_s=parked_s),)
    return ideal_sensors(build_truth(lay(segments), site, heading_rad=heading_deg * DEG), RATE_HZ)


def make_unit(out: Path, index: int, runs: int, seed: int) -> dict[str, Any]:
    """One unit's runs on disk; what is true of it."""
    rng = np.random.default_rng([seed, index])
    unit = aged_unit(rng, imu_serial=f"SN-{index:04d}")
    other = aged_unit(rng, imu_serial=unit.imu_serial)
    steps = index % STEPPED_EVERY == STEPPED_EVERY - 1
    made: list[dict[str, Any]] = []
    for k in range(runs):
        kind = str(rng.choice(list(KINDS), p=list(KINDS.values()))) if k else "sound"
        stepped = steps and k >= runs // 2
        path = out / "runs" / unit.imu_serial / f"{k:02d}"
        if kind == "copy of the one before":
            shutil.copytree(path.with_name(f"{k - 1:02d}"), path)
            made.append(
                {**made[-1], "path": str(path.relative_to(out)), "kind": kind, "stepped": False}
            )
            continue
        start = str(rng.choice(list(STARTS)))
        run = simulate(other if kind == "another unit's" else unit, k, start, kind, rng)
        run = stepped_run(run) if stepped else run
        write_run(path, run)
        spoil(path, kind)
        T = run.temperature.gyro_degC if run.temperature is not None else np.array([])
        visited = [float(T.min()), float(T.max())] if T.size else None
        made.append(
            {
                "path": str(path.relative_to(out)),
                "kind": kind,
                "stepped": stepped,
                "visited_degC": visited,
            }
        )
    return {"unit": unit, "runs": made, "steps": steps}


def simulate(unit: UnitTruth, k: int, start: str, kind: str, rng: np.random.Generator) -> Run:
    """One power-on."""
    parked_s = SHORT_S if kind == "too short" else PARKED_S
    run = simulate_run(
        ideal(float(rng.choice(HEADINGS_DEG)), parked_s),
        thermal_history(start, rng=rng),
        unit,
        TwinModel(),
        rng=rng,
        plan=SessionPlan(
            run_id=f"{unit.imu_serial}-{k:02d}",
            start_utc=(FIRST_START + timedelta(weeks=4 * k)).strftime("%Y-%m-%dT%H:%M:%SZ"),
        ),
    ).run
    if kind == "clock at 1970":
        run = replace(run, header=replace(run.header, start_utc="1970-01-01T00:00:12Z"))
    return replace(run, temperature=None) if kind == "no temperature" else run


def stepped_run(run: Run) -> Run:
    """Gyro x reads more by the step."""
    imu = run.imu.whole()
    dtheta = imu.dtheta_rad.copy()
    dtheta[:, 0] += STEP_DEG_H * DEG / 3600.0 * imu.dt_s
    return replace(run, imu=replace(imu, dtheta_rad=dtheta))


def spoil(path: Path, kind: str) -> None:
    """What a bad day does to the files."""
    if kind == "cut file":
        data = (path / "imu.parquet").read_bytes()
        (path / "imu.parquet").write_bytes(data[: len(data) // 2])
    if kind == "broken run.json":
        (path / "run.json").write_text((path / "run.json").read_text()[:-40])


def main(out: Path, units: int, runs: int, seed: int) -> None:
    out.mkdir(parents=True)
    truth: dict[str, Any] = {"seed": seed, "grid_degC": GRID_DEGC.tolist(), "units": {}}
    with TableStore.open(f"sqlite:///{out}/recal.db", create=True) as store:
        for index in range(units):
            made = make_unit(out, index, runs, seed)
            unit: UnitTruth = made["unit"]
            store.import_table(unit.factory_table(np.arange(-20.0, 61.0, 10.0)))
            curve = {axis: unit.bias_deg_h(axis, GRID_DEGC).tolist() for axis in AXES}
            truth["units"][unit.imu_serial] = {
                "bias_deg_h": curve,
                "steps": made["steps"],
                "runs": made["runs"],
            }
    (out / "truth.json").write_text(json.dumps(truth))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("out", type=Path)
    parser.add_argument("--units", type=int, default=200)
    parser.add_argument("--runs", type=int, default=10)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    main(given.out, given.units, given.runs, given.seed)
