"""Dates of `recal fleet forecast` against when the true drift of simulated units passes the limit.

Example: nice -n 5 .venv/bin/python -m benchmarks.fleet_forecast FLEETS.jsonl

FLEETS.jsonl is what `python -m benchmarks.fleet_learn --out` wrote: what was learnt of each fleet
from eight sessions a unit. The ninth is merged, the dates are forecast, and the unit ages on by the
generator of benchmarks/fleet_made.py. The true drift is that of the unit's true curve against the
table in use, at the temperatures where the unit works, with its true turn-on and flicker.

A date says something of a unit that has one: neither passed today, nor beyond the horizon.
"""

import argparse
import json
from pathlib import Path

import numpy as np

from benchmarks.fleet_made import made_fleet, wave
from infield.learning.forecast import (
    HORIZON_YEARS,
    LEVEL_GYROS,
    LIMIT_NM_H,
    Paths,
    state_of,
    works_at,
)
from infield.learning.kept import covering
from infield.learning.learn import Learnt
from infield.learning.likelihood import FleetLikelihood
from infield.learning.parameters import OF_POINTS, WIDTHS, PriorName, defaults_of, logs_of

SESSIONS = 9
MEAN_DRIFT = 60.0  # NM/h for each deg/h of a level gyro, over Schuler periods: physics.md 6.3
# of the true ageing: an hour, later 1/300 of the time since today; a walk that is looked at so
# often passes a limit 1 % later than one that is always watched
FIRST_STEP_YEARS, LATER_STEPS = 1e-4, 1.0 / 300.0
FLICKER_SHARE = 0.664  # of the bias instability that a mean over a session keeps: physics.md 4


def learnt_values(line):
    """Of each unit of a fleet, as `recal fleet forecast` takes them from approved priors."""
    return [
        {
            name: Learnt(unit[name][0], 0.0, (unit[name][1], unit[name][2]), True, 0)
            for name in OF_POINTS
        }
        for unit in line["units"]
    ]


def default_values(count):
    """Of units of which nothing was learnt."""
    defaults = defaults_of("rlg")
    value = {n: Learnt.normal(defaults[n], WIDTHS[n], shown=False, n=0) for n in OF_POINTS}
    return [value] * count


def dates(line, values, limit_nm_h):
    """Of each unit: 50 % date, 95 % date, and when the true drift passed [years from the last
    session].
    """
    fleet, _ = made_fleet(line["seed"], **{**line["options"], "sessions": SESSIONS})
    thetas = np.array([logs_of({n: v[n].value for n in OF_POINTS}) for v in values])
    evidence = FleetLikelihood([m.kept for m in fleet])(thetas)
    found = []
    for u, made in enumerate(fleet):
        first = covering(made.kept)
        n = sum(t.size for t in first.temperature_degC)
        in_use = first.replaced(parameters=first.parameters + evidence.mean[u, :n])
        state = state_of(made.kept, evidence.mean[u], evidence.covariance[u], in_use)
        T = works_at(made.kept)
        seen = Paths(values[u], T, seed=u).ahead(state, year=state.year, limit_nm_h=limit_nm_h)
        rng = np.random.default_rng([line["seed"], u, 7])
        passed = true_passage(made.true, in_use, T, rng, limit_nm_h)
        found.append([seen.year_50, seen.year_95, passed])
    return found


def true_passage(true, table, T, rng, limit_nm_h):
    """Years until the true drift passes the limit, the unit ageing on in steps of its own."""
    value = true.value
    error = [true.bias(a, T[a]) - table.bias_deg_h(a, T[a]) for a in LEVEL_GYROS]
    flicker = FLICKER_SHARE * value[PriorName.FLICKER]
    start = 2.0 * (value[PriorName.TURN_ON] ** 2 + flicker**2)
    year = 0.0
    while year < HORIZON_YEARS:
        drift = MEAN_DRIFT * np.sqrt(sum(np.mean(e**2) for e in error) + start)
        if drift > limit_nm_h:
            return year
        dt = max(FIRST_STEP_YEARS, LATER_STEPS * year)
        for a in LEVEL_GYROS:
            level = value[PriorName.AGEING_COMMON] * np.sqrt(dt) * rng.standard_normal()
            size = value[PriorName.AGEING_SHAPE] * np.sqrt(dt)
            error[a] = error[a] + level + wave(rng, size, value[PriorName.LENGTH])(T[a])
        year += dt
    return np.inf


def told(name, found):
    """How often the dates of these units were right."""
    year_50, year_95, passed = np.array(found).T
    judged_50 = (year_50 > 0.0) & np.isfinite(year_50)
    judged_95 = (year_95 > 0.0) & np.isfinite(year_95)
    late = np.mean(passed[judged_50] >= year_50[judged_50])
    safe = np.mean(passed[judged_95] >= year_95[judged_95])
    return (
        f"{name}: not yet passed at the 50 % date {late:.1%} of {judged_50.sum()} units (median"
        f" {np.median(year_50[judged_50]):.2f} years), at the 95 % date {safe:.1%} of"
        f" {judged_95.sum()} ({np.median(year_95[judged_95]):.2f} years)"
    )


def main(arguments=None):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("fleets", type=Path)
    parser.add_argument("--limit", type=float, default=LIMIT_NM_H, help="NM/h")
    parser.add_argument("--most", type=int, default=None, help="fleets")
    parser.add_argument("--defaults", action="store_true", help="forecasts by the defaults, too")
    asked = parser.parse_args(arguments)
    lines = [json.loads(line) for line in asked.fleets.read_text().splitlines()][: asked.most]
    by_learnt, by_default = [], []
    for line in lines:
        by_learnt += dates(line, learnt_values(line), asked.limit)
        if asked.defaults:
            by_default += dates(line, default_values(len(line["units"])), asked.limit)
    print(told("learnt priors", by_learnt))
    if by_default:
        print(told("defaults", by_default))


if __name__ == "__main__":
    main()
