"""R29, first draft: units aged by 0.0072 deg/h, five sessions each on mixed headings and starts."""

from functools import cache

import numpy as np
import pytest

from infield.pipeline import update_calibration
from infield.table_file import table_from_dict, table_sha256
from ins.records import Site, TwinModel
from ins.units import DEG
from trajectories.motions import reference_motion
from trajectories.sensors import ideal_sensors
from trajectories.simulate import simulate_run
from trajectories.thermal import STARTS, thermal_history
from trajectories.truth import build_truth
from trajectories.unit_truth import aged_unit

SESSIONS = 5
SITE = Site(lat_rad=45 * DEG, lon_rad=7 * DEG, height_m=250.0)


@cache
def taxi(heading_deg):
    _, motion = reference_motion("realistic_taxi")
    return ideal_sensors(build_truth(motion, SITE, heading_rad=heading_deg * DEG), 10.0)


def recalibrate(seed):
    """One unit through five sessions; level-gyro errors (visited temperatures) before and after, sigmas, outcomes."""
    rng = np.random.default_rng([seed, 29])
    unit, twin = aged_unit(rng), TwinModel(imu_serial="SN-0042")
    data = unit.factory_table()
    table = factory = table_from_dict(data, name="factory")
    visited, outcomes = [], []
    for k in range(SESSIONS):
        heading = float(rng.choice(np.arange(0, 360, 15)))
        simulated = simulate_run(
            taxi(heading), thermal_history(str(rng.choice(list(STARTS))), rng=rng), unit, twin, rng=rng,
            run_id=f"{seed}-{k}", start_utc=f"2026-03-0{k + 1}T05:00:00Z",
        )  # fmt: skip
        result = update_calibration([simulated.run], table, twin, parent_sha256=table_sha256(data))
        outcomes.append(result.outcome)
        table = result.after
        visited.append(simulated.temperature_true_degC[::60])
    T = np.concatenate(visited)
    before, after, sigma = [], [], []
    for i, axis in enumerate("xy"):
        truth = unit.bias_deg_h(axis, T[:, i])
        before.append(factory.bias_deg_h(i, T[:, i]) - truth)
        after.append(table.bias_deg_h(i, T[:, i]) - truth)
        sigma.append(table.sigma_deg_h(i, T[:, i]))
    return np.array(before), np.array(after), np.array(sigma), outcomes


@pytest.mark.parametrize("units", [pytest.param(3, id="3"), pytest.param(60, id="60", marks=pytest.mark.slow)])
def test_five_sessions_bring_an_aged_table_back(units, record_property):
    results = [recalibrate(seed) for seed in range(units)]
    before = np.sqrt(np.mean([np.mean(r[0] ** 2) for r in results]))
    after = np.sqrt(np.mean([np.mean(r[1] ** 2) for r in results]))
    nees = np.mean([np.mean((r[1] / r[2]) ** 2) for r in results])
    for name, value in (("before", before), ("after", after), ("nees", nees)):
        record_property(name, float(value))
    print(f"visited level gyros {before:.4f} -> {after:.4f} deg/h RMS, normalised squared error {nees:.2f}, {units} units")
    assert after < 0.5 * before
    outcomes = [o for r in results for o in r[3]]
    assert outcomes.count("accepted") >= 0.97 * len(outcomes) - 1
    if units >= 60:
        assert after <= 0.0030
        assert 0.8 <= nees <= 1.25
