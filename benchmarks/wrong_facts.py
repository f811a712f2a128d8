"""How often a wrong fact about a session is found, against its size, and what it does where it is
not.

A session is written from the equations (`benchmarks.plain_sessions`), then one thing about it is
made wrong: where it stands, its clock, a scale, an axis, a thermometer, what its header says, the
unit itself. `update_calibration` sees the rest as it is. A session that changes the table by a
wrong fact is committed wrong where the table's error at the temperatures visited, over its sigma,
exceeds four on any gyro.

    python -m benchmarks.wrong_facts --units 20 --out facts.jsonl
    python -m benchmarks.wrong_facts --page facts.jsonl > page.md
"""

import argparse
import json
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import beta

from benchmarks.plain_sessions import (
    GRADES,
    SERIAL,
    Grade,
    Outing,
    Session,
    Unit,
    drawn_outing,
    made_unit,
    session,
)
from infield.session.pipeline import UnitHistory, update_calibration
from infield.session.results import UpdateResult
from infield.table.file import table_from_dict
from infield.table.thermal_table import ThermalTable
from ins.records import ImuLog, Run, TemperatureLog
from ins.twin_file import default_twin
from ins.units import DEG, DEG_PER_HOUR, MILLIRADIAN

NOW = datetime.fromisoformat("2026-03-02T00:00:00Z")  # of the update, the day after the sessions
STEP_AT_S = 2400.0  # of a bias step: in the middle of the parked time
TOO_FAR_SIGMAS = 4.0  # a committed error beyond is a wrong table
SCORED_EVERY_S = 60.0
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


def as_it_is(run: Run, size: float, axis: int) -> Run:
    """Nothing: what is wrong was simulated."""
    return run


def sign_turned(run: Run, size: float, axis: int) -> Run:
    """Of gyro x."""
    turned = _imu(run).dtheta_rad * np.array([-1.0, 1.0, 1.0])
    return replace(run, imu=replace(_imu(run), dtheta_rad=turned))


def swapped(run: Run, size: float, axis: int) -> Run:
    """Gyros x and y."""
    return replace(run, imu=replace(_imu(run), dtheta_rad=_imu(run).dtheta_rad[:, [1, 0, 2]]))


def in_the_future(run: Run, size: float, axis: int) -> Run:
    """The start by so many days after the update."""
    start = (NOW + timedelta(days=size)).strftime("%Y-%m-%dT%H:%M:%SZ")
    return replace(run, header=replace(run.header, start_utc=start))


def declared_compensated(run: Run, size: float, axis: int) -> Run:
    return replace(run, header=replace(run.header, applied_table_sha256="0" * 64))


def _rough_fog(size: float) -> Grade:
    """A ring laser's table, and noise that is all of fibre-optic size."""
    return replace(GRADES["rlg"], arw=size, flicker=size, walk=size, turn_on=1.5 * size)


RECORDINGS = {
    1.0: {"receiver": True},
    2.0: {"receiver": False},
    3.0: {"receiver": False, "rounds": 0},
}


@dataclass(frozen=True)
class Fact:
    """What is made wrong of a run, its unit, and the sizes tried; or, by its size, what the gyros
    are (grade), how the outing is drawn (outing), which technology the log declares, and whether
    its table was taken out of it.
    """

    change: Change
    unit: str
    sizes: tuple[float, ...]
    grade: Callable[[float], Grade] = lambda size: GRADES["rlg"]
    outing: Callable[[float, int], dict[str, Any]] = lambda size, axis: {}
    technology: str = "rlg"
    compensated: bool = False


def _curve(size: float) -> Grade:
    return replace(GRADES["rlg"], curve=size)


def _lag(size: float, axis: int) -> dict[str, Any]:
    """Of 600 s on one gyro."""
    return {"lag_s": 600.0, "lag_deg_h_degC": tuple(size * np.eye(3)[axis])}


FACTS = {
    "nothing wrong": Fact(as_it_is, "", (0.0,)),
    "compensated, declared raw: table of": Fact(
        as_it_is, "deg/h", (0.01, 0.03, 0.06), grade=_curve, compensated=True
    ),
    "raw, declared compensated: table of": Fact(
        declared_compensated, "deg/h", (0.01, 0.03, 0.06), grade=_curve
    ),
    "thermal lag of 600 s": Fact(as_it_is, "deg/h per degC", (0.0012, 0.0024, 0.0048), outing=_lag),
    "temperatures of another run, longer by": Fact(as_it_is, "s", (-1600.0, 200.0, 1600.0)),
    "start in the future": Fact(in_the_future, "days", (2.0, 365.0, 3650.0)),
    "gyro x turned round, recording": Fact(
        sign_turned, "", tuple(RECORDINGS), outing=lambda size, axis: RECORDINGS[size]
    ),
    "x and y swapped, recording": Fact(
        swapped, "", tuple(RECORDINGS), outing=lambda size, axis: RECORDINGS[size]
    ),
    "fibre-optic, declared ring laser: noise": Fact(
        as_it_is, "deg/sqrt(h)", (0.002, 0.003, 0.006), grade=_rough_fog
    ),
    "ring laser, declared fibre-optic: noise": Fact(
        as_it_is, "deg/sqrt(h)", (0.001, 0.002, 0.003), grade=_rough_fog, technology="fog"
    ),
    "latitude": Fact(wrong_latitude, "deg", (0.03, 0.1, 0.3)),
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
    "another unit": Fact(as_it_is, "", (1.0,)),
}


def trial(name: str, size: float, seed: int) -> dict:
    """One session of one unit with one wrong fact: what was said, and the error of the table."""
    fact, rng, axis = FACTS[name], np.random.default_rng([seed, 57]), seed % 3
    grade = fact.grade(size)
    unit = made_unit(rng, grade)
    table = _table(unit, fact.technology)
    if name == "another unit":
        table = _table(made_unit(np.random.default_rng([seed, 58]), grade), fact.technology)
    outing = drawn_outing(rng, receiver=seed % 2 == 0)
    outing = replace(outing, **fact.outing(size, axis))
    made = session(rng, unit, outing, technology=fact.technology)
    run = fact.change(made.run, size, axis)
    if fact.compensated:
        run = less_table(run, unit)
    if name.startswith("temperatures"):
        run = replace(run, temperature=_other_temperatures(rng, unit, outing, made, size))
    twin = replace(default_twin(fact.technology), imu_serial=SERIAL)
    history = UnitHistory(applied_table=lambda sha256: table, now=NOW)
    result = update_calibration([run], table, twin, history=history)
    T = made.gyro_degC
    return {
        "fact": name,
        "size": size,
        "seed": seed,
        "outcome": str(result.outcome),
        "reasons": sorted({str(code) for code in _codes(result)}),
        "doubted": [str(s.fact) for s in result.sessions[0].doubted],
        "worst_sigmas": _worst(result, unit, T),
        "sigma_deg_h": float(np.mean([result.after.sigma_deg_h(k, T[:, k]) for k in (0, 1)])),
    }


def less_table(run: Run, unit: Unit) -> Run:
    """The log less its unit's factory curves at the temperatures read."""
    imu, log = _imu(run), _temperature(run)
    read = [np.interp(imu.time_s, log.time_s, column) for column in log.gyro_degC.T]
    bias = unit.factory(np.stack(read, axis=1)) * DEG_PER_HOUR
    return replace(run, imu=replace(imu, dtheta_rad=imu.dtheta_rad - bias * imu.dt_s[:, None]))


def _other_temperatures(
    rng: np.random.Generator, unit: Unit, outing: Outing, made: Session, longer_s: float
) -> TemperatureLog:
    """Those of another power-on of the unit, of another day."""
    another = drawn_outing(rng, rounds=0, parked_s=_imu(made.run).end_s + longer_s)
    return _temperature(session(rng, unit, another).run)


def _table(unit: Unit, technology: str) -> ThermalTable:
    return table_from_dict(unit.table(technology), name="factory")


def _codes(result: UpdateResult) -> list[str]:
    found: list[str] = []
    for reason in result.sessions[0].verdict.reasons:
        found.append(reason.code)
        inner = reason.values.get("found", ())
        found += [r.code for r in inner if hasattr(r, "code")]
    return found


def _worst(result: UpdateResult, unit: Unit, gyro_degC: NDArray) -> float:
    """Largest error over sigma of the table after, at the temperatures visited, all gyros."""
    T = gyro_degC[:: int(SCORED_EVERY_S)]
    off = [
        np.abs(result.after.bias_deg_h(k, T[:, k]) - truth) / result.after.sigma_deg_h(k, T[:, k])
        for k, truth in enumerate(unit.today(T).T)
    ]
    return float(np.max(off))


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
