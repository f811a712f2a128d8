"""Estimator sigma, actual RMS error and Cramer-Rao bound of each gyro, for all rows of physics.md
6.7 and the realistic taxi.

A run is simulated once, with satellites, and estimated in four ways: with and without them (taken
out of the run), with and without the parked-attitude constraint. Rows and seeds are those of the
tests (`tests.scenarios.study`).
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import chain

import numpy as np

from benchmarks.accuracy_summary import BELOW, GOAL, WORDS, summarise
from benchmarks.cramer_rao import Sights, Spread, bias_bound
from benchmarks.navigation_response import navigation_response
from benchmarks.study import Record, Work, table
from infield.session.acceptance import assess_estimate
from infield.session.points import observability
from infield.session.settings import SessionSettings
from ins.records import Site, Survey, TwinModel
from ins.units import DEG, MILLIRADIAN
from ins.verdicts import WEAK_BELOW
from tests.reference_motions import PARKED_S, reference_motion
from tests.scenarios.study import (
    DEFAULT_TWIN,
    REFERENCE_TWIN,
    Outcome,
    estimated,
    simulated_session,
)
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


def bounds(name: str, lat_deg: float) -> list[Record]:
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


def sessions(name: str, lat_deg: float, seed: int) -> list[Record]:
    """Scores of one seed, each way."""
    row = ROWS[name]
    base, found = ideal_run(row, lat_deg), []
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
        settings = SessionSettings(hold_heading=hold)
        outcome = estimated(made, run, row.twin, sigma_deg_h=SIGMA_DEG_H, settings=settings)
        head = {"row": name, "lat_deg": lat_deg, "gnss": gnss, "hold": hold, "seed": seed}
        found.append({**head, **_scores(outcome, _north_east_down(base), hold)})
    return found


def _survey(row: Row, seed: int) -> Survey | None:
    """A surveyor's heading with an error of its own."""
    if row.survey_mrad is None:
        return None
    sigma = row.survey_mrad * MILLIRADIAN
    off = sigma * float(np.random.default_rng([seed, SURVEY_SEED]).standard_normal())
    return Survey(heading_rad=off, sigma_heading_rad=sigma)


def _scores(outcome: Outcome, order: list[int], hold: bool) -> Record:
    seen = observability(outcome.estimate, hold_heading=hold)
    tally = outcome.estimate.solution.filter.tally
    return {
        "error_deg_h": outcome.error_deg_h[order].tolist(),
        "sigma_deg_h": outcome.sigma_deg_h[order].tolist(),
        "verdicts": [outcome.verdicts[k] for k in order],
        "outcome": assess_estimate(outcome.estimate, seen).outcome,
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


AXES = ("north", "east", "down")
WAY_NAMES = {
    (False, True): "wheels, parked heading",
    (False, False): "wheels",
    (True, True): "wheels, parked heading, GNSS",
    (True, False): "wheels, GNSS",
}
SHORT = dict(zip(WORDS, "own"))
POOLED = ("seen", "axis", "cells", "RMS / bound", "sigma / bound")
CELLS = ("row", "GNSS", "held", "runs", *(f"{axis}: sigma / RMS / bound" for axis in AXES))
CELLS += ("worst RMS / bound", "NEES", "NIS", "verdicts")


def run(
    work: Work,
    *,
    runs: int = 50,
    rows: tuple[str, ...] = tuple(ROWS),
    latitudes: tuple[float, ...] = LATITUDES_DEG,
) -> str:
    cells = [(name, lat) for lat in latitudes for name in rows if ways(ROWS[name], lat)]
    kept = list(chain(*work.each(bounds, cells)))
    kept += chain(*work.each(sessions, [(*cell, seed) for seed in range(runs) for cell in cells]))
    found = summarise(kept, list(ROWS))
    parts = ["## In short\n", _totals(found["totals"])]
    parts += ["Over all rows and latitudes, observable axes only:\n"]
    parts += [table(POOLED, [_pooled(p) for p in found["totals"]["pooled"]])]
    parts += [
        "## Cells that miss\n",
        "".join(f"- {m}\n" for m in misses(found["cells"])) or "None.\n",
    ]
    for lat in latitudes:
        of = [_cell(c) for c in found["cells"] if c["lat_deg"] == lat]
        parts += [f"## Latitude {lat:g} deg\n", table(CELLS, of)]
    return "\n".join(parts)


def _totals(t: Record) -> str:
    lines = [
        f"{t['runs']} sessions estimated in {t['cells']} cells",
        f"RMS over bound on the {t['observable_axes']} observable axes:"
        f" {_range(t['rms_over_bound'])}; {t['within_goal']} within {GOAL},"
        f" {t['goal_within_interval']} with {GOAL} inside or above the 95 % interval of the RMS",
        f"sigma over bound on all axes: {_range(t['sigma_over_bound'])};"
        f" {t['overconfident_axes']} below {BELOW}",
        f"NEES inside its band in {t['nees_inside']} cells of {t['cells']}",
        f"NIS inside its band in {t['nis_inside']} cells of {t['cells']}: {_range(t['nis'])}",
        "NIS by kind of measurement: "
        + ", ".join(f"{kind} {nis:.3f}" for kind, (nis, _) in t["nis_by_kind"].items()),
        f"verdicts agree with the bound's own in {100 * t['verdicts_agreed']:.2f} % of the runs"
        " and axes",
    ]
    return "".join(f"- {line}\n" for line in lines)


def _pooled(p: Record) -> tuple[object, ...]:
    ratios = (f"{p[key]:.3f}" for key in ("rms_over_bound", "sigma_over_bound"))
    return WAY_NAMES[p["gnss"], p["hold"]], AXES[p["axis"]], p["cells"], *ratios


def _range(spread: dict[str, float]) -> str:
    return "{least:.3f} to {largest:.3f} (RMS {rms:.3f})".format(**spread) if spread else "none"


def misses(cells: list[Record]) -> Iterator[str]:
    """Everything beyond the goal, below the bound or outside a NEES band, by name."""
    for c in cells:
        label = f"{c['row']}, {c['lat_deg']:g} deg, {WAY_NAMES[c['gnss'], c['hold']]}"
        for k, axis in enumerate(AXES):
            bound = c["bound_deg_h"][k]
            if c["rms_deg_h"][k] > GOAL * bound and bound < WEAK_BELOW * c["prior_deg_h"][k]:
                low, rms, high = (c[f"rms{end}_deg_h"][k] / bound for end in ("_low", "", "_high"))
                yield f"{label}, {axis}: RMS {rms:.2f} of the bound ({low:.2f} to {high:.2f})"
            if c["sigma_deg_h"][k] < BELOW * bound:
                yield f"{label}, {axis}: sigma {c['sigma_deg_h'][k] / bound:.3f} of the bound"
        low, high = c["nees_band"]
        if not low < c["nees"] < high:
            yield f"{label}: NEES {c['nees']:.2f}, band {low:.2f} to {high:.2f}"


def _cell(c: Record) -> list[str]:
    """A row of the page."""
    keys = ("sigma_deg_h", "rms_deg_h", "bound_deg_h")
    mils = [" / ".join(f"{1e3 * c[key][k]:.2f}" for key in keys) for k in range(3)]
    ratio = [rms / bound for rms, bound in zip(c["rms_deg_h"], c["bound_deg_h"])]
    seen = [k for k in range(3) if c["bound_deg_h"][k] < WEAK_BELOW * c["prior_deg_h"][k]]
    worst = max((ratio[k] for k in seen), default=float("nan"))
    of = ["yes" if c[key] else "" for key in ("gnss", "hold")]
    flags = [_flag(c, "nees"), _flag(c, "nis"), _verdicts(c)]
    return [c["row"], *of, f"{c['runs']}", *mils, f"{worst:.2f}", *flags]


def _flag(c: Record, name: str) -> str:
    """A mean square, bold outside its band."""
    low, high = c[f"{name}_band"]
    return f"{c[name]:.2f}" if low < c[name] < high else f"**{c[name]:.2f}**"


def _verdicts(c: Record) -> str:
    """The commonest of each axis, and the share that differs from what the bound calls for."""
    words = "".join(SHORT[max(v, key=lambda word: v[word])] for v in c["verdicts"])
    pairs = [(v, e) for v, e in zip(c["verdicts"], c["expected"]) if e]
    off = max((1 - v.get(e, 0) / c["runs"] for v, e in pairs), default=0.0)
    return f"{words} ({100 * off:.0f} % differ)" if off > 0 else words
