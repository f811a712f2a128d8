"""What `recal fleet learn` finds of simulated fleets, and the dates of `recal fleet forecast`,
against the truth.

Learnt from eight sessions a unit; the ninth is held out, then merged, the dates are forecast, and
the unit ages on by the generator of `benchmarks.fleet_made`. The true drift is that of the unit's
true curve against the table in use, at the temperatures where the unit works, with its true turn-on
and flicker. A date says something of a unit that has one: neither passed today, nor beyond the
horizon.
"""

import time
from dataclasses import replace

import numpy as np

from benchmarks.fleet_made import NODES, made_fleet, wave
from benchmarks.study import Work
from infield.learning.forecast import (
    HORIZON_YEARS,
    LEVEL_GYROS,
    LIMIT_NM_H,
    Paths,
    state_of,
    works_at,
)
from infield.learning.learn import Learnt, learn
from infield.learning.likelihood import FleetLikelihood
from infield.learning.parameters import OF_POINTS, WIDTHS, PriorName, defaults_of, logs_of
from infield.learning.stored_sessions import covering

SESSIONS = 9
MEAN_DRIFT = 60.0  # NM/h for each deg/h of a level gyro, over Schuler periods: physics.md 6.3
# of the true ageing: an hour, later 1/300 of the time since today; a walk that is looked at so
# often passes a limit 1 % later than one that is always watched
FIRST_STEP_YEARS, LATER_STEPS = 1e-4, 1.0 / 300.0
FLICKER_SHARE = 0.664  # of the bias instability that a mean over a session keeps: physics.md 4
VISITED_WITHIN = 5.0  # degC of a point of the unit's sessions


def one_fleet(seed, spread):
    """Everything that is judged of one fleet: its last session is held out."""
    fleet, value = made_fleet(seed, spread=spread, sessions=SESSIONS)
    known = [without_last(m.kept) for m in fleet]
    began = time.process_time()
    found = learn(known)
    cpu_s = round(time.process_time() - began, 1)
    told = {
        name: {
            "true": value[name],
            "value": found.parameters[name].value,
            "low": found.parameters[name].interval_95[0],
            "high": found.parameters[name].interval_95[1],
            "sigma_log": found.parameters[name].sigma_log,
            "shown": found.parameters[name].shown,
        }
        for name in OF_POINTS
    }
    learnt = logs_of({name: found.parameters[name].value for name in OF_POINTS})
    thetas = {"learnt": learnt, "default": logs_of(defaults_of("rlg")), "true": logs_of(value)}
    whole = FleetLikelihood([m.kept for m in fleet])
    before = FleetLikelihood(known)
    sound = np.array([not m.outliers[-1] for m in fleet])
    document = {
        "seed": seed,
        "parameters": told,
        "effective": found.check.effective,
        "asked": found.check.draws,
        "settled": found.settled,
        "spread": spread,
        "cpu_s": cpu_s,
        "units": [
            {
                name: [found.of_units[u][name].value, *found.of_units[u][name].interval_95]
                for name in OF_POINTS
            }
            for u in range(len(fleet))
        ],
    }
    for name, theta in thetas.items():
        evidence = whole(theta)
        document[name] = {
            "nis": float(evidence.nis[sound, -1].sum() / evidence.dof[sound, -1].sum()),
            "log_likelihood": float(evidence.log_likelihood.sum()),
            **rms(fleet, before(theta)),
        }
    return document


def without_last(kept):
    return replace(kept, sessions=kept.sessions[:-1])


def rms(fleet, evidence):
    """RMS error of the level gyros' nodes, those near a session's points and the others.

    The truth is that of the held-out session, some months after the last known one: what a unit
    ages by in between is in every column.
    """
    errors = {"visited": [], "unvisited": []}
    for u, made in enumerate(fleet):
        table = covering(without_last(made.kept))
        seen = np.concatenate([s.temperature_degC for s in made.kept.sessions[:-1]])
        for axis in (0, 1):
            T = table.temperature_degC[axis]
            inside = np.isin(T, NODES)
            rows = np.r_[table.values_of(axis)][inside]
            error = evidence.mean[u, rows] - made.true.bias(axis, T[inside])
            near = np.min(np.abs(T[inside][:, None] - seen), axis=1) <= VISITED_WITHIN
            errors["visited"] += error[near].tolist()
            errors["unvisited"] += error[~near].tolist()
    return {
        name: float(np.sqrt(np.mean(np.square(values)))) if values else None
        for name, values in errors.items()
    }


def summary(lines):
    """Figures over all fleets, as text."""
    told = []
    inside, count = 0, 0
    for name in OF_POINTS:
        rows = [line["parameters"][name] for line in lines]
        held = [row["low"] <= row["true"] <= row["high"] for row in rows]
        z = [np.log(row["value"] / row["true"]) / row["sigma_log"] for row in rows]
        width = np.median([row["sigma_log"] for row in rows])
        shown = np.mean([row["shown"] for row in rows])
        inside, count = inside + sum(held), count + len(held)
        told.append(
            f"{name:28s} held {np.mean(held):6.1%}  squared error over variance"
            f" {np.mean(np.square(z)):.2f}  sigma (log) {width:.2f}  shown in {shown:.0%}"
        )
    told.append(f"all parameters: held {inside / count:.1%} of {count}")
    for which in ("learnt", "default", "true"):
        nis = [line[which]["nis"] for line in lines]
        told.append(
            f"{which:8s} next session: squared innovation mean {np.mean(nis):.3f}, median"
            f" {np.median(nis):.3f}, from {min(nis):.2f} to {max(nis):.2f}"
        )
    for place in ("visited", "unvisited"):
        values = {
            which: np.sqrt(
                np.mean([line[which][place] ** 2 for line in lines if line[which][place]])
            )
            for which in ("learnt", "default", "true")
        }
        told.append(
            f"{place:10s} RMS learnt {values['learnt']:.5f}, defaults {values['default']:.5f}, true"
            f" priors {values['true']:.5f} deg/h: {values['learnt'] / values['true']:.3f} of true"
        )
    told.append(f"CPU {np.median([line['cpu_s'] for line in lines]):.1f} s a fleet (median)")
    return told


def learnt_values(line):
    """Of each unit of a fleet, as `recal fleet forecast` takes them from approved priors."""
    return [
        {
            name: Learnt(unit[name][0], 0.0, (unit[name][1], unit[name][2]), True, 0)
            for name in OF_POINTS
        }
        for unit in line["units"]
    ]


def dates_of(line, limit_nm_h):
    """Dates of a fleet by what was learnt of it and by the defaults."""
    return {
        "learnt": dates(line, learnt_values(line), limit_nm_h),
        "defaults": dates(line, default_values(len(line["units"])), limit_nm_h),
    }


def default_values(count):
    """Of units of which nothing was learnt."""
    defaults = defaults_of("rlg")
    value = {n: Learnt.normal(defaults[n], WIDTHS[n], shown=False, n=0) for n in OF_POINTS}
    return [value] * count


def dates(line, values, limit_nm_h):
    """Of each unit: 50 % date, 95 % date, and when the true drift passed [years from the last
    session].
    """
    fleet, _ = made_fleet(line["seed"], spread=line["spread"], sessions=SESSIONS)
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


def dates_told(name, found):
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


def judged(seed, spread, limit_nm_h):
    """A fleet with the dates that follow from what was learnt of it."""
    line = one_fleet(seed, spread)
    return {**line, "dates": dates_of(line, limit_nm_h)}


def run(
    work: Work, *, fleets: int = 40, first: int = 0, spread: float = 0.0, limit: float = LIMIT_NM_H
) -> str:
    """spread: of the units' own parameters; limit: of the drift, NM/h."""
    lines = work.each(judged, [(seed, spread, limit) for seed in range(first, first + fleets)])
    told = summary(lines)
    for name in ("learnt", "defaults"):
        dates = [one for line in lines for one in line["dates"][name]]
        told.append(dates_told(f"{name} priors", dates))
    return "".join(f"- {line}\n" for line in told)
