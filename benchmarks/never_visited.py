"""The least that any estimator can know of a gyro where no session ever came, apart from the filter
and from the tables' own algebra.

A unit ages by a curve c(T) of a known Gaussian law: a shift of 0.006 deg/h on all temperatures and
a smooth shape of 0.004 deg/h over 30 degC. Session k shows c at the temperatures of its gyros plus
what this power-on departs by (turn-on, flicker, random walk of the rate) plus white noise. All of
it is Gaussian, so the conditional mean of c given everything that was shown is the best of all
estimators in mean square, and its variance the limit:

    V = C(T, T) - C(T, S) (C(S, S) + D)^-1 C(S, T)

with S the temperatures of all bins of all sessions and D, one block a session, the covariance of a
session's departures. `limits`: D is that of departures drawn from the simulator. `drawn`: nothing
of this formula is used; units and sessions are drawn from the simulator, and the best linear
estimator is learnt by least squares from two thirds of them and scored on the others.
"""

from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from benchmarks.flight_update import NODES_DEGC, THERMAL
from benchmarks.study import Work, table
from ins.twin_file import default_twin
from ins.units import HOUR
from trajectories.simulator.imperfections import gyro_session_bias
from trajectories.simulator.thermal import ThermalHistory
from trajectories.simulator.unit_truth import aged_unit

BIN_S = 300.0
SLOW_HZ = 0.1  # of departures: 30 rows a bin
DEPARTURES = 3000  # draws of three gyros: variances known to 1.5 %
UNITS = 6000  # draws of three gyros for 165 bins: least squares learns 1.4 % of a variance too much
LEARNT = 2.0 / 3.0
EXACT_DEG_H = 1e-6  # of a curve that is known
SESSIONS = 5
TECHNOLOGY = "rlg"
AMBIENT_DEGC = (-5.0, 20.0)
WARMS_DEGC = 22.0  # above ambient once the unit is warm
NEAR_DEGC = 2.0  # of a temperature that was visited
FLOWN_S = 9900.0  # about, of a session with a flight
GRID_DEGC = np.arange(NODES_DEGC[0], NODES_DEGC[-1] + 0.5)
# as trajectories.simulator.unit_truth draws ageing
COMMON_DEG_H, SHAPE_DEG_H, LENGTH_DEGC = 0.006, 0.004, 30.0
MORE_SESSIONS = (5, 10, 20, 40, 80)

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


def run(work: Work, *, first: int = 100, units: int = 16, drawn: int = 3) -> str:
    """units: of which the limits are worked; drawn: of which they are learnt from draws too."""
    found = work.each(limits, [(seed,) for seed in range(first, first + units)])
    names = found[0]["never"]
    squares = {
        name: [np.mean([line[span][name] for line in found]) for span in ("never", "cold")]
        for name in names
    }
    rows = [[name, *(f"{np.sqrt(s):.5f}" for s in squares[name])] for name in names]
    text = table(("what is known", "where no session came, deg/h", "in the cold, deg/h"), rows)
    learnt_of = work.each(learnt, [(seed,) for seed in range(first, first + drawn)])
    told = [[f"{np.sqrt(line[key]):.5f}" for key in ("drawn", "formula")] for line in learnt_of]
    return text + "\n" + table(("learnt from draws, deg/h", "formula, deg/h"), told)
