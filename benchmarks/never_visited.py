"""The least that any estimator can know of a gyro where no session ever came, apart from the filter
and from the tables' own algebra.

    python -m benchmarks.never_visited limits 100 116 > limits.jsonl   units 100 to 115, a line each
    python -m benchmarks.never_visited drawn 100 104 > drawn.jsonl     the same learnt from draws
    python -m benchmarks.never_visited hours 100 116 > hours.jsonl     a held-out hour at the limit
    python -m benchmarks.never_visited summary limits.jsonl drawn.jsonl hours.jsonl

A unit ages by a curve c(T) of a known Gaussian law: a shift of 0.006 deg/h on all temperatures and
a smooth shape of 0.004 deg/h over 30 degC. Session k shows c at the temperatures of its gyros plus
what this power-on departs by (turn-on, flicker, random walk of the rate) plus white noise. All of
it is Gaussian, so the conditional mean of c given everything that was shown is the best of all
estimators in mean square, and its variance the limit:

    V = C(T, T) - C(T, S) (C(S, S) + D)^-1 C(S, T)

with S the temperatures of all bins of all sessions and D, one block a session, the covariance of a
session's departures. `limits`: D is that of departures drawn from the simulator. `drawn`: nothing
of this formula is used; units and sessions are drawn from the simulator, and the best linear
estimator is learnt by least squares from two thirds of them and scored on the others. `hours`: the
held-out hour of `benchmarks.flight_units` with tables whose errors are drawn from the limit.
"""

import json
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from benchmarks import free_inertial
from benchmarks.flight_units import (
    AMBIENT_DEGC,
    COMMON_DEG_H,
    FLOWN_S,
    GRID_DEGC,
    HEADINGS_DEG,
    LATITUDES_DEG,
    LENGTH_DEGC,
    NEAR_DEGC,
    SESSIONS,
    SHAPE_DEG_H,
    TECHNOLOGY,
    WARMS_DEGC,
    Flown,
    drawn_unit,
)
from benchmarks.flight_update import NODES_DEGC, THERMAL
from infield.table.file import table_from_dict
from ins.records import AXES
from ins.twin_file import default_twin
from ins.units import HOUR
from trajectories.simulator.imperfections import gyro_session_bias
from trajectories.simulator.session import SessionPlan, simulate_run
from trajectories.simulator.thermal import ThermalHistory
from trajectories.simulator.unit_truth import aged_unit

BIN_S = 300.0
SLOW_HZ = 0.1  # of departures: 30 rows a bin
DEPARTURES = 3000  # draws of three gyros: variances known to 1.5 %
UNITS = 6000  # draws of three gyros for 165 bins: least squares learns 1.4 % of a variance too much
LEARNT = 2.0 / 3.0
EXACT_DEG_H = 1e-6  # of a curve that is known
MORE_SESSIONS = (5, 10, 20, 40, 80)
DRAWS = 4  # tables a unit of the held-out hour

Line = Mapping[str, Any]


def thermal(ambient_degC: float) -> ThermalHistory:
    """Of a session that parks and flies."""
    return replace(
        THERMAL,
        ambient_degC=ambient_degC,
        start_degC=ambient_degC,
        settled_degC=ambient_degC + WARMS_DEGC,
    )


def temperatures(seed: int, sessions: int, every_s: float) -> NDArray:
    """Of gyro x in each session (sessions, n); the first five are those of the study."""
    ambient = np.random.default_rng([20, seed]).uniform(*AMBIENT_DEGC, sessions)
    at = np.arange(0.5 * every_s, FLOWN_S, every_s)
    return np.stack([thermal(float(a)).at(at).gyro_degC[:, 0] for a in ambient])


def never(seed: int) -> NDArray:
    """Which of the grid (n,) bool the five sessions never came within NEAR_DEGC of."""
    seen = temperatures(seed, SESSIONS, 60.0).ravel()
    return np.asarray(np.abs(GRID_DEGC[:, None] - seen).min(axis=1) > NEAR_DEGC)


def law(one: NDArray, other: NDArray) -> NDArray:
    """C (n, m) [(deg/h)^2]."""
    apart = (one[:, None] - other) / LENGTH_DEGC
    return np.asarray(COMMON_DEG_H**2 + SHAPE_DEG_H**2 * np.exp(-0.5 * apart**2))


def departures(rng: np.random.Generator, count: int) -> NDArray:
    """What power-ons depart by (3 count, bins) [deg/h], white noise of the bins in it."""
    gyro, rows = default_twin(TECHNOLOGY).gyro, int(BIN_S * SLOW_HZ)
    bins = int(FLOWN_S / BIN_S)
    white = gyro.arw_deg_sqrt_h * np.sqrt(HOUR / BIN_S)
    found = []
    for _ in range(count):
        bias = gyro_session_bias(rng, gyro, bins * rows, rate_hz=SLOW_HZ)
        means = bias.reshape(bins, rows, 3).mean(axis=1).T
        found.append(means + white * rng.standard_normal(means.shape))
    return np.concatenate(found)


@lru_cache(maxsize=1)
def departs() -> NDArray:
    """Covariance (bins, bins) of the departures of a session [(deg/h)^2]."""
    drawn = departures(np.random.default_rng([23, 0]), DEPARTURES)
    return drawn.T @ drawn / len(drawn)


def left(S: NDArray, D: NDArray) -> NDArray:
    """Covariance (n, n) over the grid of what is left of the law [(deg/h)^2]."""
    cross = law(S, GRID_DEGC)
    gain = np.linalg.solve(law(S, S) + D, cross)
    return np.asarray(law(GRID_DEGC, GRID_DEGC) - cross.T @ gain)


def limit(seed: int, sessions: int) -> NDArray:
    """What is left after sessions that all fly, merged as well as can be."""
    S = temperatures(seed, sessions, BIN_S)
    return left(S.ravel(), block_diag(*[departs()] * sessions))


def limits(seed: int) -> Line:
    """Limits of one unit: mean squares where no session came [(deg/h)^2]."""
    at = never(seed)
    S = temperatures(seed, SESSIONS, BIN_S).ravel()
    white = default_twin(TECHNOLOGY).gyro.arw_deg_sqrt_h ** 2 * HOUR / BIN_S
    turn_on = np.full((S.size // SESSIONS,) * 2, default_twin(TECHNOLOGY).gyro.turn_on_deg_h ** 2)
    alone = block_diag(*[turn_on] * SESSIONS)
    eye = np.eye(S.size)
    known = {
        "law": law(GRID_DEGC, GRID_DEGC),
        "curve known": left(S, EXACT_DEG_H**2 * eye),
        "white noise alone": left(S, white * eye),
        "turn-on alone": left(S, alone + EXACT_DEG_H**2 * eye),
        "turn-on and white noise": left(S, alone + white * eye),
        **{f"{n} sessions": limit(seed, n) for n in MORE_SESSIONS},
    }
    cold = ~at & (GRID_DEGC < 0.0)
    return {
        "seed": seed,
        "never": {name: float(np.diag(P)[at].mean()) for name, P in known.items()},
        "cold": {name: float(np.diag(P)[cold].mean()) for name, P in known.items()},
        "outside_degC": [float(S.min() - GRID_DEGC[0]), float(GRID_DEGC[-1] - S.max())],
    }


def learnt(seed: int) -> Line:
    """The limit of one unit's sessions as least squares learns it from drawn units."""
    rng, at = np.random.default_rng([24, seed]), never(seed)
    S = temperatures(seed, SESSIONS, BIN_S).ravel()
    shown, true = [], []
    for _ in range(UNITS):
        unit = aged_unit(rng, gyro_technology=TECHNOLOGY)
        shown.append(np.stack([curve(S) for curve in unit.ageing_deg_h]))
        true.append(np.stack([curve(GRID_DEGC[at]) for curve in unit.ageing_deg_h]))
    X, Y = np.concatenate(shown), np.concatenate(true)
    X = X + np.hstack([departures(rng, UNITS) for _ in range(SESSIONS)])
    n = int(LEARNT * len(X))
    gain = np.linalg.lstsq(X[:n], Y[:n], rcond=None)[0]
    return {
        "seed": seed,
        "drawn": float(np.mean((Y[n:] - X[n:] @ gain) ** 2)),
        "formula": float(np.diag(limit(seed, SESSIONS))[at].mean()),
    }


def hour(seed: int) -> Line:
    """Position errors at the end of the held-out hour [m] with tables that are off by what the
    limit leaves, with the factory's and with a perfect one.
    """
    unit, rng = drawn_unit(seed), np.random.default_rng([22, seed])
    k = int(rng.integers(len(HEADINGS_DEG)))
    sensors = free_inertial.ideal("flight", LATITUDES_DEG[k], HEADINGS_DEG[k])
    flown = replace(
        thermal(float(rng.uniform(*AMBIENT_DEGC))),
        flight_start_s=HOUR + 600.0,
        flight_end_s=2.0 * HOUR,
    )
    plan = SessionPlan(run_id=f"hour-{seed}")
    simulated = simulate_run(sensors, flown, unit.truth, unit.twin, rng=rng, plan=plan)
    P = limit(seed, SESSIONS)
    value, vector = np.linalg.eigh(P)
    root = vector * np.sqrt(np.maximum(value, 0.0))
    factory = table_from_dict(unit.truth.factory_table(NODES_DEGC), name="factory table")

    def of_factory(axis: int, degC: NDArray) -> NDArray:
        return np.asarray(factory.bias_deg_h(axis, degC))

    def off_by(errors: NDArray) -> Callable[[int, NDArray], NDArray]:
        def bias(axis: int, degC: NDArray) -> NDArray:
            true = unit.truth.bias_deg_h(AXES[axis], degC)
            return np.asarray(true + np.interp(degC, GRID_DEGC, errors[axis]))

        return bias

    biases: dict[str, Callable[[int, NDArray], NDArray]] = {
        "before": of_factory,
        "perfect": off_by(np.zeros((3, GRID_DEGC.size))),
    }
    for draw in range(DRAWS):
        errors = np.random.default_rng([25, seed, draw]).standard_normal((3, GRID_DEGC.size))
        biases[f"limit {draw}"] = off_by(errors @ root.T)
    sigma = {"before": np.full(GRID_DEGC.size, unit.truth.sigma_deg_h)}
    at_limit, exact = np.sqrt(np.diag(P)), np.full(GRID_DEGC.size, 1e-4)
    ends = {}
    for name, bias in biases.items():
        believed = unit.truth.factory_table(GRID_DEGC)
        told = sigma.get(name, exact if name == "perfect" else at_limit)
        for axis in AXES:
            believed["axes"][axis]["sigma_deg_h"] = told.tolist()
        table = Flown(bias, table_from_dict(believed, name="believed"))
        end = free_inertial.fly_with(table, simulated, default_twin(TECHNOLOGY))
        ends[name] = [end.north_m, end.east_m]
    return {"seed": seed, "end_m": ends}


def summary(lines: Sequence[Line]) -> None:
    """Print what the lines say together."""
    of_limits = [line for line in lines if "never" in line]
    for span in ("never", "cold") if of_limits else ():
        for name in of_limits[0][span]:
            rms = np.sqrt(np.mean([line[span][name] for line in of_limits]))
            print(f"{span}, {name}: {rms:.5f} deg/h ({len(of_limits)} units)")
    for line in lines:
        if "drawn" in line:
            drawn, formula = np.sqrt([line["drawn"], line["formula"]])
            print(
                f"unit {line['seed']}: learnt from draws {drawn:.5f}, formula {formula:.5f} deg/h"
            )
    hours = [line["end_m"] for line in lines if "end_m" in line]
    if hours:
        whole = [h for h in hours if np.isfinite([*h.values()]).all()]
        square = {
            name: float(np.mean([np.sum(np.square(h[name])) for h in whole])) for name in whole[0]
        }
        added = {name: _added(whole, name) for name in square if name != "perfect"}
        at_limit = np.mean([value for name, value in added.items() if name.startswith("limit")])
        perfect, limit_m, before = np.sqrt([square["perfect"], at_limit, added["before"]])
        share = perfect / np.hypot(perfect, limit_m)
        print(f"{len(whole)} hours: perfect {perfect:.0f} m, limit adds {limit_m:.0f} m,", end=" ")
        print(f"factory {before:.0f} m: old over limit {100.0 * share:.1f} % of old over perfect")


def _added(hours: Sequence[Mapping[str, Sequence[float]]], name: str) -> float:
    """Mean square distance from where a perfect table comes to with the same noise [m^2]."""
    apart = [np.subtract(hour[name], hour["perfect"]) for hour in hours]
    return float(np.mean(np.sum(np.square(apart), axis=1)))


def main(arguments: Sequence[str]) -> None:
    """Run what the head of this module shows."""
    kind, rest = arguments[0], arguments[1:]
    if kind == "summary":
        return summary(
            [json.loads(s) for name in rest for s in Path(name).read_text().splitlines()]
        )
    of_unit = {"limits": limits, "drawn": learnt, "hours": hour}[kind]
    for seed in range(int(rest[0]), int(rest[1])):
        print(json.dumps(of_unit(seed)), flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
