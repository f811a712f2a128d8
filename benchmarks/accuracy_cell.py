"""One cell of the accuracy study: a row of physics.md 6.7 at a latitude, its bound, and seeded
sessions scored.

A run is simulated once, with satellites, and estimated in four ways: with and without them (taken
out of the run), with and without the parked-attitude constraint. Rows and seeds are those of the
tests (`tests.scenarios.study`).
"""

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

from benchmarks.cramer_rao import Sights, Spread, bias_bound
from benchmarks.navigation_response import navigation_response
from infield.session.acceptance import judge_estimate
from infield.session.points import observability
from infield.session.settings import SessionSettings
from ins.records import Site, Survey, TwinModel
from ins.units import DEG, MILLIRADIAN
from tests.scenarios.study import (
    DEFAULT_TWIN,
    REFERENCE_TWIN,
    Outcome,
    estimated,
    simulated_session,
)
from trajectories.simulator.motions import PARKED_S, reference_motion
from trajectories.simulator.sensors import IdealSensors, ideal_sensors
from trajectories.simulator.thermal import thermal_history
from trajectories.simulator.truth import build_truth

SIGMA_DEG_H = 0.01
SPREAD = Spread(common_deg_h=SIGMA_DEG_H * np.sqrt(0.7), shape_deg_h=SIGMA_DEG_H * np.sqrt(0.3))
START, RATE_HZ = "ambient", 10.0
# physics.md 6.7 assumes a crab prior of 1 mrad and 30 mm/s of white lateral noise: 2 s correlated
# 15 mm/s integrates alike
ROW_TWIN = replace(
    REFERENCE_TWIN, vehicle=replace(REFERENCE_TWIN.vehicle, lateral_noise_m_s=0.015, crab_mrad=1.0)
)
LATITUDES_DEG = (0.0, 30.0, 45.0, 60.0, 75.0)
# satellites, parked-attitude constraint
WAYS = ((False, True), (False, False), (True, True), (True, False))
SURVEY_SEED = 9


@dataclass(frozen=True)
class Row:
    """A scenario: reference motion, twin, length of the first rest [s], sigma of a surveyed heading
    [mrad].
    """

    motion: str
    twin: TwinModel = ROW_TWIN
    parked_s: float = PARKED_S
    survey_mrad: float | None = None
    every_latitude: bool = True


ROWS = {
    "70 min parked": Row("parked_only"),
    "straight taxi 300 s": Row("straight_taxi"),
    "taxi 300 s after 0>180": Row("taxi_0_180"),
    "taxi 300 s after 0>90": Row("taxi_0_90"),
    "taxi -90>+90, 300 s": Row("taxi_m90_p90_300"),
    "taxi -90>+90, 600 s": Row("taxi_m90_p90_600"),
    "taxi -90>+90, 300 s, stop 120 s": Row("taxi_m90_p90_300_stop_120"),
    "legs 90/180/90, three stops": Row("legs_90_180_90"),
    "turn 90, park 20 min": Row("turn_90_park_20min"),
    "turn 180, park 20 min": Row("turn_180_park_20min"),
    "turn 180, park 60 min": Row("turn_180_park_60min"),
    "realistic taxi": Row("realistic_taxi", REFERENCE_TWIN),
    "10 min alignment": Row("parked_only", parked_s=600.0, every_latitude=False),
    "130 min parked": Row("parked_only", parked_s=7800.0, every_latitude=False),
    "heading surveyed to 1 mrad": Row("parked_only", survey_mrad=1.0, every_latitude=False),
    "heading surveyed to 0.3 mrad": Row("parked_only", survey_mrad=0.3, every_latitude=False),
    "heading surveyed to 0.1 mrad": Row("parked_only", survey_mrad=0.1, every_latitude=False),
    "realistic taxi, flicker and walk": Row("realistic_taxi", DEFAULT_TWIN, every_latitude=False),
}


@lru_cache(maxsize=2)
def ideal_run(row: Row, lat_deg: float) -> IdealSensors:
    """The noise-free run of a row at a latitude."""
    heading, motion = reference_motion(row.motion, parked_s=row.parked_s)
    site = Site(lat_rad=lat_deg * DEG, lon_rad=7 * DEG, height_m=250.0)
    return ideal_sensors(build_truth(motion, site, heading_rad=heading), RATE_HZ)


def ways(row: Row, lat_deg: float) -> tuple[tuple[bool, bool], ...]:
    """How a row is estimated at a latitude: all four ways, or what the table of physics.md 6.7 asks
    for; () for none.
    """
    if row.every_latitude:
        return WAYS
    return WAYS[:1] if lat_deg == 45.0 else ()


def bounds(name: str, lat_deg: float) -> list[dict[str, Any]]:
    """Bound of each way: sigma of the session-mean bias along north, east (first heading) and down,
    deg/h.
    """
    row = ROWS[name]
    base = ideal_run(row, lat_deg)
    response = navigation_response(base)
    middle_s = 0.5 * (response.nominal.time_s[1:] + response.nominal.time_s[:-1])
    gyro_degC = thermal_history(START).at(middle_s).gyro_degC
    found = []
    for gnss, hold in ways(row, lat_deg):
        surveyed = None if row.survey_mrad is None else row.survey_mrad * MILLIRADIAN
        sights = Sights(gnss=gnss, hold_heading=hold, surveyed_sigma_rad=surveyed)
        bound = bias_bound(base, response, gyro_degC, row.twin, SPREAD, sights)
        order = _north_east_down(base)
        found.append(
            {
                "row": name,
                "lat_deg": lat_deg,
                "gnss": gnss,
                "hold": hold,
                "bound_deg_h": bound.sigma_deg_h[order].tolist(),
                "prior_deg_h": bound.sigma_prior_deg_h[order].tolist(),
                "heading_bound_rad": bound.sigma_heading_rad,
            }
        )
    return found


def sessions(name: str, lat_deg: float, seeds: range) -> list[dict[str, Any]]:
    """Scores of each seed and way, as plain values; an estimator that fails is a score with its
    message.
    """
    row = ROWS[name]
    base, found = ideal_run(row, lat_deg), []
    for seed in seeds:
        made = simulated_session(
            base,
            seed,
            twin=row.twin,
            sigma_deg_h=SIGMA_DEG_H,
            start=START,
            with_gnss=True,
            survey=_survey(row, seed),
        )
        for gnss, hold in ways(row, lat_deg):
            run = made.run if gnss else replace(made.run, gnss=None)
            head = {"row": name, "lat_deg": lat_deg, "gnss": gnss, "hold": hold, "seed": seed}
            try:
                outcome = estimated(
                    made,
                    run,
                    row.twin,
                    sigma_deg_h=SIGMA_DEG_H,
                    settings=SessionSettings(hold_heading=hold),
                )
            except (ArithmeticError, ValueError) as error:
                found.append({**head, "failed": f"{type(error).__name__}: {error}"})
                continue
            found.append({**head, **_scores(outcome, _north_east_down(base), hold)})
    return found


def _survey(row: Row, seed: int) -> Survey | None:
    """A surveyor's heading with an error of its own."""
    if row.survey_mrad is None:
        return None
    sigma = row.survey_mrad * MILLIRADIAN
    off = sigma * float(np.random.default_rng([seed, SURVEY_SEED]).standard_normal())
    return Survey(heading_rad=off, sigma_heading_rad=sigma)


def _scores(outcome: Outcome, order: list[int], hold: bool) -> dict[str, Any]:
    seen = observability(outcome.estimate, hold_heading=hold)
    tally = outcome.estimate.solution.filter.tally
    return {
        "error_deg_h": outcome.error_deg_h[order].tolist(),
        "sigma_deg_h": outcome.sigma_deg_h[order].tolist(),
        "verdicts": [outcome.verdicts[k] for k in order],
        "outcome": judge_estimate(outcome.estimate, seen).outcome,
        "nees": outcome.nees,
        "nis_mean": outcome.nis_mean,
        "dof": outcome.dof,
        "nis_by_kind": {kind: [float(tally.nis[kind]), int(tally.dof[kind])] for kind in tally.nis},
        "heading_normalised": float(outcome.heading_normalised),
        "sigma_heading_rad": outcome.sigma_heading_rad,
    }


def _north_east_down(base: IdealSensors) -> list[int]:
    """Gyros that lie along north, east and down on the first heading (a multiple of 90 deg; signs
    do not matter).
    """
    return [1, 0, 2] if abs(base.C_nb[0, 0, 0]) < 0.5 else [0, 1, 2]
