"""Updates with a twin fitted to an earlier hour of the unit, against updates with the defaults of
its technology, where the true noise is another one.

    python -m benchmarks.twin_updates run FIRST LAST -o updates.jsonl
    python -m benchmarks.twin_updates table updates.jsonl

Each unit (ring laser, fibre optic, MEMS in turn) has sizes of noise 0.3 to 3 times the defaults,
each drawn apart. An hour of it parked at 10 Hz is fitted; an hour parked and a taxi, another
power-on, are updated three times: with the defaults, with the fitted twin, with the true one. The
squared error of the mean bias of each gyro over its variance is 1 where sigma is right.
"""

import argparse
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import recal
from benchmarks.availability import SIGMA_DEG_H, Station, ideal_run, stations
from infield.session.estimate import SessionEstimate
from infield.session.pipeline import UnitHistory, update_calibration
from infield.session.points import mean_rows
from infield.table.file import table_from_dict, table_sha256, table_to_dict
from ins.records import Site, TwinModel
from ins.twin_file import default_twin
from ins.units import DEG
from trajectories.simulator.motions import lay
from trajectories.simulator.segments import Park
from trajectories.simulator.sensors import IdealSensors, ideal_sensors
from trajectories.simulator.session import SimulatedRun, simulate_run
from trajectories.simulator.thermal import thermal_history
from trajectories.simulator.truth import build_truth
from trajectories.simulator.unit_truth import aged_unit

TECHNOLOGIES = ("rlg", "fog", "mems")
FACTOR = 1.0 / 0.3
NOISE = {
    "gyro": ("arw_deg_sqrt_h", "bias_instability_deg_h", "rate_random_walk_deg_h_sqrt_h"),
    "accel": ("vrw_ug_sqrt_hz", "bias_instability_ug", "rate_random_walk_ug_sqrt_h"),
    "vehicle": ("sway_m_s", "yaw_creep_arcsec_sqrt_h"),
}
COMMON_SHARE = 0.7  # of the ageing's variance, as a table without covariance has it


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.twin_updates", description=__doc__)
    commands = parser.add_subparsers(dest="command", required=True)
    run = commands.add_parser("run")
    run.add_argument("first", type=int)
    run.add_argument("last", type=int)
    run.add_argument("-o", "--output", type=Path, required=True)
    table = commands.add_parser("table")
    table.add_argument("updates", type=Path, nargs="+")
    options = parser.parse_args()
    if options.command == "run":
        for seed in range(options.first, options.last):
            with options.output.open("a", encoding="utf-8") as out:
                out.write(json.dumps(one_unit(seed)) + "\n")
        return
    lines = [line for path in options.updates for line in path.read_text().splitlines()]
    print("\n".join(table_lines([json.loads(line) for line in lines])))


def drawn_twin(technology: str, rng: np.random.Generator) -> TwinModel:
    """A twin whose sizes of noise are off the defaults by factors to FACTOR either way."""
    twin = default_twin(technology)
    for section, keys in NOISE.items():
        record = getattr(twin, section)
        for key in keys:
            factor = float(np.exp(rng.uniform(-1.0, 1.0) * np.log(FACTOR)))
            record = replace(record, **{key: factor * getattr(record, key)})
        twin = replace(twin, **{section: record})
    return twin


def parked_hour(station: Station) -> IdealSensors:
    """The noise-free hour that is fitted."""
    site = Site(lat_rad=station.lat_deg * DEG, lon_rad=7 * DEG, height_m=250.0)
    motion = lay((Park(duration_s=3600.0),))
    return ideal_sensors(build_truth(motion, site, heading_rad=station.heading_deg * DEG), 10.0)


def one_unit(seed: int) -> dict:
    """Squared errors over variance of one unit's update, under three twins."""
    rng = np.random.default_rng([seed, 167])
    technology = TECHNOLOGIES[seed % len(TECHNOLOGIES)]
    true = drawn_twin(technology, rng)
    sigma = SIGMA_DEG_H[technology]
    unit = aged_unit(
        rng,
        gyro_technology=technology,
        ageing_offset_deg_h=sigma * np.sqrt(COMMON_SHARE),
        ageing_shape_deg_h=sigma * np.sqrt(1.0 - COMMON_SHARE),
    )
    station = stations()[int(rng.integers(len(stations())))]
    thermal = thermal_history("ambient", rng=rng)
    earlier = simulate_run(parked_hour(station), thermal, unit, true, rng=rng)
    made = simulate_run(
        ideal_run(station), thermal_history(station.start, rng=rng), unit, true, rng=rng
    )
    fitted = recal.fit_twin(earlier.run).twin
    found = {"seed": seed, "technology": technology}
    twins = {"defaults": default_twin(technology), "fitted": fitted, "true": true}
    for name, twin in twins.items():
        found[name] = None if twin is None else squares(made, unit.factory_table(), twin)
    return found


def squares(made: SimulatedRun, factory: dict, twin: TwinModel) -> list[float] | None:
    """Squared error over variance of each gyro's mean bias; None where the session is refused."""
    table = table_from_dict(factory, name="factory")
    history = UnitHistory(parent_sha256=table_sha256(table_to_dict(table)))
    (session,) = update_calibration([made.run], table, twin, history=history).sessions
    estimate = session.estimate
    if estimate is None or not session.verdict.accepted:
        return None
    A = mean_rows(estimate)
    error = A @ (estimate.bins.table_deg_h + estimate.mean_deg_h - _true_bins(estimate, made))
    variance = np.diag(A @ estimate.covariance @ A.T)
    return [float(v) for v in error**2 / variance]


def _true_bins(estimate: SessionEstimate, made: SimulatedRun) -> NDArray:
    """True total bias over each bin, in the order of the bins (3N,)."""
    truth = []
    for start_s, end_s in zip(estimate.bins.start_s, estimate.bins.end_s):
        rows = (made.bias_time_s > start_s) & (made.bias_time_s <= end_s)
        truth.append(made.gyro_bias_true_deg_h[rows].mean(axis=0))
    return np.concatenate(truth)


def table_lines(units: list[dict]) -> list[str]:
    """Mean squared errors over variance, by technology and twin."""
    head = "| unit | twin | accepted | squared error over variance | standard error | largest |"
    lines = [head, "|" + "---|" * 6]
    for technology in TECHNOLOGIES:
        own = [u for u in units if u["technology"] == technology]
        for name in ("defaults", "fitted", "true") if own else ():
            kept = [u[name] for u in own if u[name] is not None]
            if not kept:
                lines.append(f"| {technology} | {name} | 0 of {len(own)} | | | |")
                continue
            values = np.array(kept)
            means = values.mean(axis=1)
            error = means.std(ddof=1) / np.sqrt(len(means)) if len(means) > 1 else np.nan
            lines.append(
                f"| {technology} | {name} | {len(kept)} of {len(own)} | {values.mean():.2f}"
                f" | {error:.2f} | {values.max():.1f} |"
            )
    return lines


if __name__ == "__main__":
    main()
