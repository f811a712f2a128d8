"""Rates of the alignment's latitude test and of the repair of clipping and shocks, from seeded runs
with known truth.
"""

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from alignment import gyrocompass
from alignment.reasons import AlignmentReason
from infield.session.log import find_rest, session_end
from infield.session.navigated.estimator import estimate_session
from infield.session.points import mean_rows
from infield.session.settings import SessionSettings
from infield.thermometer.gyro_temperature import gyro_temperature
from ins.records import AXES, Run, TwinModel
from ins.units import DEG
from tests.alignment.parked import PRIOR_DEG_H, TEN_MINUTES, ideal_of, simulate
from tests.faults import stuck_at_full_scale
from tests.scenarios.gate_study import GUARD_S, log_uniform
from tests.scenarios.study import DEFAULT_TWIN, REFERENCE_TWIN, ideal, prior_table, table_to_zero
from trajectories.simulator.session import simulate_run
from trajectories.simulator.thermal import thermal_history
from trajectories.simulator.unit_truth import aged_unit

LATITUDES_DEG = (-60.0, -30.0, 0.0, 30.0, 45.0, 60.0, 75.0)
TWINS = {"reference": REFERENCE_TWIN, "default": DEFAULT_TWIN}


def latitude_found(seed: int, offset_deg: float, twin: TwinModel) -> tuple[bool, bool]:
    """Ten minutes of alignment with a latitude entered wrong by the offset: is it named, is the
    alignment not given?
    """
    rng = np.random.default_rng([seed, 20260702])
    lat_deg, heading_deg = float(rng.choice(LATITUDES_DEG)), float(rng.integers(0, 8) * 45)
    run = simulate(
        ideal_of(TEN_MINUTES, lat_deg=lat_deg, heading_deg=heading_deg), 3000 + seed, twin=twin
    ).run
    entered = lat_deg + offset_deg * (
        1.0 if abs(lat_deg + offset_deg) < 78.0 and rng.random() < 0.5 else -1.0
    )
    sigma = np.sqrt(
        PRIOR_DEG_H**2 + twin.gyro.turn_on_deg_h**2 + twin.gyro.bias_instability_deg_h**2
    )
    result = gyrocompass.align(
        run.imu,
        replace(run.header.site, lat_rad=entered * DEG),
        twin,
        bias_sigma_deg_h=np.full(3, sigma),
    )
    named = result.verdict == "inconsistent" and any(
        reason.code is AlignmentReason.WRONG_LATITUDE for reason in result.reasons
    )
    return named, result.verdict != "aligned"


@dataclass(frozen=True)
class Burst:
    """A saturated sensor within the parked hour: was it listed with its guard, and how far is the
    session moved?

    moved (3,): mean gyro biases with less without the burst, in sigmas of the session; widened
    (3,): ratio of the sigmas.
    """

    sensor: str
    rows: int
    total: float
    listed: bool
    moved: np.ndarray
    widened: np.ndarray


@lru_cache(maxsize=1)
def _session(seed: int) -> Run:
    rng = np.random.default_rng([seed, 20260703])
    unit = aged_unit(
        rng,
        ageing_offset_deg_h=PRIOR_DEG_H * np.sqrt(0.7),
        ageing_shape_deg_h=PRIOR_DEG_H * np.sqrt(0.3),
        table=table_to_zero(),
    )
    return simulate_run(
        ideal("realistic_taxi"), thermal_history("ambient"), unit, REFERENCE_TWIN, rng=rng
    ).run


def burst(seed: int) -> Burst:
    """The reference session (10 min + 60 min parked, taxi) with and without a sensor stuck at full
    scale for 1 to 10 rows.
    """
    rng = np.random.default_rng([seed, 20260704])
    sensor = str(rng.choice(["gyro", "accelerometer"]))
    axis = AXES[rng.integers(3)]
    rows = int(rng.integers(1, 11))
    total = log_uniform(rng, 0.005, 0.5) if sensor == "gyro" else log_uniform(rng, 0.05, 20.0)
    total *= float(rng.choice([-1.0, 1.0]))
    at_s, run = float(rng.uniform(120.0, 4000.0)), _session(seed)
    mean, sigma, _ = _estimate(run)
    bad = stuck_at_full_scale(run, sensor=sensor, axis=axis, at_s=at_s, rows=rows, total=total)
    moved, widened, spans = _estimate(bad)
    end_s = at_s + rows / run.imu.rate_hz
    listed = any(
        s.start_s <= at_s and s.end_s >= end_s + GUARD_S - 1.0 and s.reason in ("clipping", "shock")
        for s in spans
    )
    return Burst(sensor, rows, total, listed, (moved - mean) / sigma, widened / sigma)


def _estimate(run: Run) -> tuple[np.ndarray, np.ndarray, tuple]:
    """Mean gyro biases (3,), their sigmas (3,) [deg/h], and what was excluded."""
    estimate = estimate_session(
        run,
        prior_table(),
        gyro_temperature(run.temperature),
        REFERENCE_TWIN,
        SessionSettings(),
        rest=find_rest(run),
        end_s=session_end(run),
    )
    A = mean_rows(estimate)
    sigma = np.sqrt(np.diag(A @ estimate.covariance @ A.T))
    return A @ estimate.mean_deg_h, sigma, estimate.solution.motion.excluded()
