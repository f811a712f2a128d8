"""Updates with a twin fitted to an earlier hour of the unit, against updates with the defaults of
its technology, where the true noise is another one.

Each unit (ring laser, fibre optic, MEMS in turn) has sizes of noise 0.3 to 3 times the defaults,
each drawn apart. An hour of it parked at 10 Hz is fitted; an hour parked and a taxi, another
power-on, are updated three times: with the defaults, with the fitted twin, with the true one. The
squared error of the mean bias of each gyro over its variance is 1 where sigma is right.
"""

from dataclasses import replace

import numpy as np

import recal
from benchmarks.availability import SIGMA_DEG_H, Station, ideal_run, stations, true_bins
from benchmarks.study import Work, table
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
    error = A @ (estimate.bins.table_deg_h + estimate.mean_deg_h - true_bins(estimate, made))
    variance = np.diag(A @ estimate.covariance @ A.T)
    return [float(v) for v in error**2 / variance]


def run(work: Work, *, units: int = 200, first: int = 0) -> str:
    found = work.each(one_unit, [(seed,) for seed in range(first, first + units)])
    rows = []
    for technology in TECHNOLOGIES:
        own = [u for u in found if u["technology"] == technology]
        rows += [row(technology, name, own) for name in ("defaults", "fitted", "true") if own]
    head = ("unit", "twin", "accepted", "squared error over variance", "standard error", "largest")
    return table(head, rows)


def row(technology: str, name: str, own: list[dict]) -> list[str]:
    """Mean squared errors over variance of a technology under a twin."""
    values = np.array([u[name] for u in own if u[name] is not None])
    taken = f"{len(values)} of {len(own)}"
    if not len(values):
        return [technology, name, taken, "", "", ""]
    means = values.mean(axis=1)
    error = means.std(ddof=1) / np.sqrt(len(means)) if len(means) > 1 else np.nan
    figures = [f"{values.mean():.2f}", f"{error:.2f}", f"{values.max():.1f}"]
    return [technology, name, taken, *figures]
