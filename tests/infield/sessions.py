"""One simulated unit with a factory table and its sessions, for the tests of estimate, spine and
document.
"""

from dataclasses import replace
from functools import lru_cache
from itertools import pairwise

import numpy as np

from infield.session.log import find_rest, session_end
from infield.session.navigated.estimator import estimate_session
from infield.session.settings import SessionSettings
from infield.table.file import table_from_dict
from infield.table.thermal_table import ThermalTable
from infield.thermometer.gyro_temperature import gyro_temperature
from ins.records import Site
from ins.units import DEG, HOUR
from tests.scenarios.study import DEFAULT_TWIN
from trajectories.simulator.motions import lay
from trajectories.simulator.segments import Park, Stop, Straight, Turn
from trajectories.simulator.sensors import ideal_sensors
from trajectories.simulator.session import SessionPlan, simulate_run
from trajectories.simulator.thermal import thermal_history
from trajectories.simulator.truth import build_truth
from trajectories.simulator.unit_truth import aged_unit

TWIN = DEFAULT_TWIN
TAXI = (
    Park(duration_s=1800.0),
    Turn(angle_deg=90.0),
    Straight(duration_s=60.0),
    Stop(duration_s=60.0),
    Turn(angle_deg=90.0),
    Straight(duration_s=60.0),
    Stop(duration_s=60.0),
)
PARKED = (Park(duration_s=1800.0),)
SETTINGS = SessionSettings()


@lru_cache(maxsize=4)
def ideal_of(segments=TAXI, heading_deg=0.0):
    site = Site(lat_rad=45 * DEG, lon_rad=7 * DEG, height_m=250.0)
    return ideal_sensors(build_truth(lay(segments), site, heading_rad=heading_deg * DEG), 10.0)


@lru_cache(maxsize=1)
def unit():
    """One that has aged by 0.006 deg/h on each axis."""
    return aged_unit(np.random.default_rng(41))


@lru_cache(maxsize=1)
def factory_dict() -> dict:
    return unit().factory_table(np.arange(-20.0, 61.0, 10.0))


def factory() -> ThermalTable:
    return table_from_dict(factory_dict(), name="factory")


@lru_cache(maxsize=16)
def simulated(
    seed=1, segments=TAXI, start="ambient", start_utc="2026-03-01T05:00:00Z", heading_deg=0.0
):
    rng = np.random.default_rng([seed, 77])
    return simulate_run(
        ideal_of(segments, heading_deg),
        thermal_history(start),
        unit(),
        TWIN,
        rng=rng,
        plan=SessionPlan(run_id=f"run-{seed}", start_utc=start_utc),
    )


def estimate_of(run, table=None, settings=SETTINGS, twin=TWIN):
    return estimate_session(
        run,
        table or factory(),
        gyro_temperature(run.temperature),
        twin,
        settings,
        rest=find_rest(run),
        end_s=session_end(run),
    )


@lru_cache(maxsize=4)
def estimate(seed=1, segments=TAXI):
    return estimate_of(simulated(seed, segments).run)


def shifted(table, shift_deg_h):
    """The same table with every value moved by (x, y, z) [deg/h]."""
    beta = table.parameters.copy()
    for k in range(3):
        beta[table.values_of(k)] += shift_deg_h[k]
    return table.replaced(parameters=beta)


def true_bias(run, edges_s):
    """Bin means of the true gyro biases, (3N,) in the order of the session's bins [deg/h]."""
    rows = [(run.bias_time_s > a) & (run.bias_time_s <= b) for a, b in pairwise(edges_s)]
    return np.concatenate([run.gyro_bias_true_deg_h[r].mean(axis=0) for r in rows])


def with_header(run, **changes):
    return replace(run, header=replace(run.header, **changes))


def own_information_floor_deg_h(twin, seconds):
    """ARW / sqrt(t): no session knows a bias better than this from its own data."""
    return float(twin.gyro.arw_deg_sqrt_h / np.sqrt(seconds / HOUR))
