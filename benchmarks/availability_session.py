"""One session of the availability study: an hour parked in an environment, then taxi, and its
update.

The unit, its noise and the place are drawn apart from the environment, so that a session in `calm`
at the same station is the yardstick of sigma: what the same hour gives where nothing moves.
"""

import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from alignment.motion.kinds import DISTURBED, STILL
from infield.session.estimate import SessionEstimate
from infield.session.pipeline import UnitHistory, update_calibration
from infield.session.points import mean_rows
from infield.session.results import SessionResult, UpdateResult
from infield.table.file import table_from_dict, table_sha256, table_to_dict
from ins.records import GYRO_TECHNOLOGIES, Site
from ins.twin_file import default_twin
from ins.units import DEG
from trajectories.simulator.environments.kinds import Environment, EnvironmentKind
from trajectories.simulator.motions import reference_motion
from trajectories.simulator.sensors import IdealSensors, ideal_sensors
from trajectories.simulator.session import SessionPlan, SimulatedRun, simulate_run
from trajectories.simulator.thermal import STARTS, thermal_history
from trajectories.simulator.truth import build_truth
from trajectories.simulator.unit_truth import aged_unit

PARKED_S, RATE_HZ = 3600.0, 10.0
SPREAD = 0.5  # of the logarithm of strength: two thirds lie between 0.6 and 1.6
# Ageing of a table, one sigma: physics.md 6.8 for rlg; of the size of blank tables for the others.
SIGMA_DEG_H = {"rlg": 0.0072, "fog": 0.02, "mems": 30.0}
COMMON_SHARE = 0.7  # of the ageing's variance, as a table without covariance has it
STATIONS = 12
LATITUDES_DEG = (-45.0, 0.0, 30.0, 45.0, 60.0)
HEADINGS_DEG = np.arange(0.0, 360.0, 15.0)
REFERENCES = 1_000_000  # seeds of the calm yardsticks, apart from those of the sessions
KINDS = tuple(kind.value for kind in EnvironmentKind)


@dataclass(frozen=True, kw_only=True)
class Draw:
    """What one session is: number, environment, strength, technology, station."""

    index: int
    seed: int
    environment: str
    strength: float
    technology: str
    station: int


@dataclass(frozen=True)
class Station:
    """Where and how a unit is powered on."""

    lat_deg: float
    heading_deg: float
    start: str


def draw(index: int, seed: int) -> Draw:
    """Session `index` of a study; 27 in a row hold every environment with every technology."""
    rng = np.random.default_rng([seed, index])
    row = int(np.random.default_rng([seed, index // 27, 27]).permutation(27)[index % 27])
    return Draw(
        index=index,
        seed=seed,
        environment=KINDS[row % len(KINDS)],
        strength=float(np.exp(SPREAD * rng.standard_normal())),
        technology=GYRO_TECHNOLOGIES[row // len(KINDS)],
        station=int(rng.integers(STATIONS)),
    )


def yardstick(technology: str, station: int, seed: int) -> Draw:
    """The calm session that gives sigma its yardstick."""
    return Draw(
        index=REFERENCES + station,
        seed=seed,
        environment="calm",
        strength=1.0,
        technology=technology,
        station=station,
    )


@lru_cache(maxsize=1)
def stations() -> tuple[Station, ...]:
    """The stations of every study."""
    rng = np.random.default_rng(15)
    starts = list(STARTS)
    return tuple(
        Station(
            float(rng.choice(LATITUDES_DEG)),
            float(rng.choice(HEADINGS_DEG)),
            starts[k % len(starts)],
        )
        for k in range(STATIONS)
    )


@lru_cache(maxsize=STATIONS)
def ideal_run(station: Station) -> IdealSensors:
    """The noise-free hour and taxi at a station."""
    site = Site(lat_rad=station.lat_deg * DEG, lon_rad=7 * DEG, height_m=250.0)
    _, motion = reference_motion("realistic_taxi", parked_s=PARKED_S)
    return ideal_sensors(build_truth(motion, site, heading_rad=station.heading_deg * DEG), RATE_HZ)


def study_session(one: Draw) -> dict[str, Any]:
    """Simulates, updates and scores one session."""
    rng = np.random.default_rng([one.seed, one.index, 1])
    station, sigma = stations()[one.station], SIGMA_DEG_H[one.technology]
    unit = aged_unit(
        rng,
        gyro_technology=one.technology,
        ageing_offset_deg_h=sigma * np.sqrt(COMMON_SHARE),
        ageing_shape_deg_h=sigma * np.sqrt(1 - COMMON_SHARE),
    )
    twin = default_twin(one.technology)
    around = Environment(kind=one.environment, strength=min(one.strength, 10.0))
    made = simulate_run(
        ideal_run(station),
        thermal_history(station.start, rng=rng),
        unit,
        twin,
        rng=rng,
        plan=SessionPlan(run_id=f"a{one.index}", environments=(around,)),
    )
    table = table_from_dict(unit.factory_table(), name="factory")
    began = time.process_time()
    history = UnitHistory(parent_sha256=table_sha256(table_to_dict(table)))
    result = update_calibration([made.run], table, twin, history=history)
    return {**asdict(one), **_scored(result, made), "cpu_s": round(time.process_time() - began, 3)}


def _scored(result: UpdateResult, made: SimulatedRun) -> dict[str, Any]:
    (session,) = result.sessions
    found: dict[str, Any] = {
        "outcome": result.outcome.value,
        "reasons": [str(reason.code.value) for reason in session.verdict.reasons]
        or [str(reason.code.value) for reason in result.reasons],
    }
    estimate = session.estimate
    if estimate is None:
        return found
    return {**found, **_estimated(session, estimate, made)}


def _estimated(
    session: SessionResult, estimate: SessionEstimate, made: SimulatedRun
) -> Mapping[str, Any]:
    """Sigma, error and what was left out; normalised: error of the mean bias over its sigma."""
    truth = _true_bins(estimate, made)
    A = mean_rows(estimate)
    error = A @ (estimate.bins.table_deg_h + estimate.mean_deg_h - truth)
    sigma = np.sqrt(np.diag(A @ estimate.covariance @ A.T))
    before = np.sqrt(np.diag(A @ estimate.bins.prior @ A.T))
    found: dict[str, Any] = {
        "sigma_deg_h": sigma.tolist(),
        "sigma_before_deg_h": before.tolist(),
        "normalised": (error / sigma).tolist(),
        "still_s": float(estimate.motion.seconds(STILL)),
        "dropped_s": float(estimate.motion.seconds(DISTURBED)),
        "nis_mean": float(estimate.nis_mean),
        "heading_sigma_rad": float(estimate.sigma_heading_rad),
    }
    if session.points is not None:
        off = A @ (session.points.bias_deg_h - truth)
        size = np.sqrt(np.diag(A @ session.points.covariance @ A.T))
        found["points_sigma_deg_h"] = size.tolist()
        found["points_normalised"] = (off / size).tolist()
    return found


def _true_bins(estimate: SessionEstimate, made: SimulatedRun) -> NDArray:
    """True total bias over each bin, in the order of the bins (3N,)."""
    truth = []
    for start_s, end_s in zip(estimate.bins.start_s, estimate.bins.end_s):
        rows = (made.bias_time_s > start_s) & (made.bias_time_s <= end_s)
        truth.append(made.gyro_bias_true_deg_h[rows].mean(axis=0))
    return np.concatenate(truth)
