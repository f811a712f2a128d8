"""How often a wrong fact about a session is found, against its size, and what it does where it is
not.

A session is simulated whole, then one thing about it is made wrong: where it stands, its clock, a
scale, an axis, a thermometer, the unit itself. `update_calibration` sees the rest as it is. A
session that changes the table by a wrong fact is committed wrong where the table's error at the
temperatures visited, over its sigma, exceeds four on any level gyro.

    python -m benchmarks.wrong_facts --units 10 --out facts.jsonl
    python -m benchmarks.wrong_facts --page facts.jsonl > page.md
"""

import argparse
import json
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.stats import beta

from benchmarks.recalibration_unit import OFFSET_DEG_H, SERIAL, SHAPE_DEG_H, TWINS, taxi
from infield.session.pipeline import update_calibration
from infield.session.results import UpdateResult
from infield.table.file import table_from_dict
from ins.records import AXES, ImuLog, Run, TemperatureLog
from ins.units import DEG, DEG_PER_HOUR, MILLIRADIAN
from trajectories.simulator.session import SessionPlan, simulate_run
from trajectories.simulator.thermal import STARTS, thermal_history
from trajectories.simulator.unit_truth import UnitTruth, aged_unit

STEP_AT_S = 2400.0  # of a bias step: in the middle of the parked time
TOO_FAR_SIGMAS = 4.0  # a committed error beyond is a wrong table
SCORED_EVERY_S = 60.0
LATITUDES_DEG = (-45.0, 30.0, 45.0, 60.0)
HEADINGS_DEG = (0.0, 60.0, 135.0, 240.0)
Change = Callable[[Run, float, int], Run]


def _imu(run: Run) -> ImuLog:
    assert isinstance(run.imu, ImuLog)
    return run.imu


def _temperature(run: Run) -> TemperatureLog:
    assert run.temperature is not None
    return run.temperature


def wrong_latitude(run: Run, size: float, axis: int) -> Run:
    site = replace(run.header.site, lat_rad=run.header.site.lat_rad + size * DEG)
    return replace(run, header=replace(run.header, site=site))


def wrong_height(run: Run, size: float, axis: int) -> Run:
    site = replace(run.header.site, height_m=run.header.site.height_m + size)
    return replace(run, header=replace(run.header, site=site))


def wrong_clock(run: Run, size: float, axis: int) -> Run:
    """Intervals longer by a share of themselves; the increments are what they were."""
    imu, factor = _imu(run), 1.0 + size
    return replace(run, imu=replace(imu, time_s=imu.time_s * factor, dt_s=imu.dt_s * factor))


def wrong_gyro_scale(run: Run, size: float, axis: int) -> Run:
    scale = np.ones(3)
    scale[axis] += size
    return replace(run, imu=replace(_imu(run), dtheta_rad=_imu(run).dtheta_rad * scale))


def wrong_gyro_axes(run: Run, size: float, axis: int) -> Run:
    """The gyro triad turned [mrad] about one of its axes against the accelerometers."""
    turned = np.zeros(3)
    turned[axis] = size * MILLIRADIAN
    dtheta = _imu(run).dtheta_rad
    return replace(run, imu=replace(_imu(run), dtheta_rad=dtheta - np.cross(turned, dtheta)))


def gyro_step(run: Run, size: float, axis: int) -> Run:
    imu = _imu(run)
    dtheta = imu.dtheta_rad.copy()
    late = imu.time_s > STEP_AT_S
    dtheta[late, axis] += size * DEG_PER_HOUR * imu.dt_s[late]
    return replace(run, imu=replace(imu, dtheta_rad=dtheta))


def all_gyro_thermometers(run: Run, size: float, axis: int) -> Run:
    log = _temperature(run)
    return replace(run, temperature=replace(log, gyro_degC=log.gyro_degC + size))


def gyro_thermometers_beside_the_block(run: Run, size: float, axis: int) -> Run:
    """The same where the block's thermometer is the only other one."""
    log = _temperature(all_gyro_thermometers(run, size, axis))
    return replace(run, temperature=replace(log, accel_degC=None))


def one_gyro_thermometer(run: Run, size: float, axis: int) -> Run:
    log = _temperature(run)
    gyro = log.gyro_degC.copy()
    gyro[:, axis] += size
    return replace(run, temperature=replace(log, gyro_degC=gyro))


def drifting_thermometer(run: Run, size: float, axis: int) -> Run:
    """The size is reached at the end of the log, in a straight line."""
    log = _temperature(run)
    gyro = log.gyro_degC.copy()
    gyro[:, axis] += size * log.time_s / log.time_s[-1]
    return replace(run, temperature=replace(log, gyro_degC=gyro))


def wrong_unit(run: Run, size: float, axis: int) -> Run:
    """Made by the simulation: `size` is the number of another unit."""
    return run


@dataclass(frozen=True)
class Fact:
    """What is made wrong, its unit, and the sizes tried."""

    change: Change
    unit: str
    sizes: tuple[float, ...]


FACTS = {
    "nothing wrong": Fact(wrong_unit, "", (0.0,)),
    "latitude": Fact(wrong_latitude, "deg", (0.03, 0.1, 0.3, 1.0)),
    "height": Fact(wrong_height, "m", (100.0, 1000.0)),
    "time base": Fact(wrong_clock, "", (1e-4, 1e-3, 1e-2)),
    "gyro scale": Fact(wrong_gyro_scale, "", (3e-4, 1e-3, 3e-3, 1e-2)),
    "gyro axes turned": Fact(wrong_gyro_axes, "mrad", (0.3, 1.0, 3.0)),
    "step of one gyro": Fact(gyro_step, "deg/h", (0.01, 0.03, 0.1)),
    "all gyro thermometers off": Fact(all_gyro_thermometers, "degC", (3.0, 10.0, 20.0)),
    "gyro thermometers off, block logged": Fact(
        gyro_thermometers_beside_the_block, "degC", (10.0, 20.0)
    ),
    "one gyro thermometer off": Fact(one_gyro_thermometer, "degC", (3.0, 10.0)),
    "drifting thermometer": Fact(drifting_thermometer, "degC", (1.0, 3.0, 10.0)),
    "another unit": Fact(wrong_unit, "", (1.0,)),
}


def trial(name: str, size: float, seed: int) -> dict:
    """One session of one unit with one wrong fact: what was said, and the error of the table."""
    rng = np.random.default_rng([seed, 57])
    twin = TWINS["default"]
    unit, table = _unit(rng)
    told = unit
    if name == "another unit":
        _, table = _unit(np.random.default_rng([seed, 58]))
    lat, heading = LATITUDES_DEG[seed % 4], HEADINGS_DEG[(seed // 4 + seed) % 4]
    start = tuple(STARTS)[(seed // 2) % len(STARTS)]
    thermal = thermal_history(start, rng=rng)
    simulated = simulate_run(
        taxi(lat, heading), thermal, told, twin, rng=rng, plan=SessionPlan(run_id=f"{name}-{seed}")
    )
    wrong = FACTS[name].change(simulated.run, size, seed % 3)
    result = update_calibration([wrong], table, twin)
    T = thermal.at(np.arange(0.0, simulated.bias_time_s[-1], SCORED_EVERY_S)).gyro_degC
    return {
        "fact": name,
        "size": size,
        "seed": seed,
        "outcome": str(result.outcome),
        "reasons": sorted({str(code) for code in _codes(result)}),
        "worst_sigmas": _worst(result, unit, T),
        "sigma_deg_h": float(np.mean([result.after.sigma_deg_h(k, T[:, k]) for k in (0, 1)])),
        **_shifts(result),
    }


def _unit(rng: np.random.Generator):
    unit = aged_unit(
        rng, ageing_offset_deg_h=OFFSET_DEG_H, ageing_shape_deg_h=SHAPE_DEG_H, imu_serial=SERIAL
    )
    return unit, table_from_dict(unit.factory_table(), name="factory")


def _shifts(result: UpdateResult) -> dict:
    session = result.sessions[0]
    if session.merged is None:
        return {}
    return {
        "axis_z": session.merged.axis_z.tolist(),
        "nis": session.merged.nis / max(session.merged.dof, 1),
    }


def _codes(result: UpdateResult) -> list[str]:
    found: list[str] = []
    for reason in result.sessions[0].verdict.reasons:
        found.append(reason.code)
        inner = reason.values.get("found", ())
        found += [r.code for r in inner if hasattr(r, "code")]
    return found


def _worst(result: UpdateResult, unit: UnitTruth, T: NDArray) -> float:
    """Largest error over sigma of the table after, at the temperatures visited, all gyros."""
    worst = []
    for k, axis in enumerate(AXES):
        error = result.after.bias_deg_h(k, T[:, k]) - unit.bias_deg_h(axis, T[:, k])
        worst.append(np.max(np.abs(error / result.after.sigma_deg_h(k, T[:, k]))))
    return float(max(worst))


def _interval(hits: int, count: int) -> tuple[float, float]:
    """Clopper-Pearson, 95 %."""
    low = float(beta.ppf(0.025, hits, count - hits + 1)) if hits else 0.0
    high = float(beta.ppf(0.975, hits + 1, count - hits)) if hits < count else 1.0
    return low, high


def summary(records: list[dict]) -> list[str]:
    """Table rows: fact, size, share found with its interval, share committed beyond four sigma."""
    lines = []
    for name, fact in FACTS.items():
        for size in fact.sizes:
            of = [r for r in records if r["fact"] == name and r["size"] == size]
            if not of:
                continue
            found = sum(r["outcome"] != "accepted" for r in of)
            wrong = [
                r for r in of if r["outcome"] == "accepted" and r["worst_sigmas"] > TOO_FAR_SIGMAS
            ]
            committed = [r["worst_sigmas"] for r in of if r["outcome"] == "accepted"]
            low, high = _interval(found, len(of))
            worst = f"{max(committed):.1f}" if committed else "-"
            lines.append(
                f"| {name} | {size:g} {fact.unit} | {found} of {len(of)}"
                f" ({100 * low:.0f} to {100 * high:.0f} %) | {len(wrong)} | {worst} |"
            )
    return lines


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--units", type=int, default=5)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--fact", action="append")
    parser.add_argument("--out", type=Path)
    parser.add_argument("--page", type=Path)
    options = parser.parse_args()
    if options.page:
        records = [json.loads(line) for line in options.page.read_text().splitlines()]
        print("\n".join(summary(records)))
        return
    records = []
    for name in options.fact or FACTS:
        for size in FACTS[name].sizes:
            for seed in range(options.first, options.first + options.units):
                records.append(trial(name, size, seed))
                if options.out:
                    with options.out.open("a") as out:
                        out.write(json.dumps(records[-1]) + "\n")
            done = [r for r in records if r["fact"] == name and r["size"] == size]
            print(summary(done)[-1], file=sys.stderr, flush=True)


if __name__ == "__main__":
    main()
