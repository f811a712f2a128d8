"""What flights are worth to aged units: each through five sessions parked and taxiing (`ground`),
the same of which every other one flies (`half`), and five that all fly (`all`).

    python -m benchmarks.flight_units 100 130 > units.jsonl      units 100 to 129, one line each
    python -m benchmarks.flight_units hours units.jsonl > hours.jsonl   a held-out hour of each
    python -m benchmarks.flight_units summary units.jsonl hours.jsonl -o docs
    python -m benchmarks.recalibration_document docs/recalibration_study.json

What belongs to a unit (scale, misalignment, slopes, g-sensitivity, what vibration changes) is drawn
once and holds in all its sessions; ambient, heading and latitude differ from session to session.
Scored in RMS over level gyros: the temperatures that flights alone reach (`cold`), those that
sessions on the ground reach (`ground`), those that neither reaches (`never`); beside the sigma that
the tables state, and the least that any merge of these sessions could reach (`limit`): the Gaussian
posterior under the law that the units were drawn from, of sessions that show each bin to the angle
random walk alone. The held-out hour is that of `benchmarks.free_inertial` in the cold of a cruise.
"""

import json
import sys
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import block_diag

from benchmarks import free_inertial
from benchmarks.flight_errors import FlightErrors, with_flight_errors
from benchmarks.flight_update import (
    ANTENNA_M,
    FLIGHT,
    HEADINGS_DEG,
    LATITUDES_DEG,
    NODES_DEGC,
    RATE_HZ,
    THERMAL,
    drawn_errors,
    drawn_gyro,
    ideal_session,
)
from benchmarks.free_inertial import Flown
from infield.session.pipeline import UnitHistory, update_calibration
from infield.session.results import UpdateResult
from infield.session.settings import SessionSettings
from infield.table.file import table_from_dict, table_sha256, table_to_dict
from infield.table.merge import session_covariance
from infield.table.thermal_table import ThermalTable
from ins.records import AXES, TwinModel
from ins.twin_file import default_twin
from ins.units import HOUR
from trajectories.simulator.session import SessionPlan, simulate_run
from trajectories.simulator.thermal import ThermalHistory
from trajectories.simulator.unit_truth import UnitTruth, aged_unit

SESSIONS = 5
TECHNOLOGY = "rlg"
PLACES = 4  # headings and latitudes of `flight_update`
AMBIENT_DEGC = (-5.0, 20.0)
WARMS_DEGC = 22.0  # above ambient once the unit is warm
NEAR_DEGC = 2.0  # of a temperature that was visited
WITHIN_SIGMAS = 4.0
WAYS = {
    "ground": [False] * SESSIONS,
    "half": [k % 2 == 0 for k in range(SESSIONS)],
    "all": [True] * SESSIONS,
}
SPANS = ("cold", "ground", "never")
GRID_DEGC = np.arange(NODES_DEGC[0], NODES_DEGC[-1] + 0.5)
# as trajectories.simulator.unit_truth draws ageing
COMMON_DEG_H, SHAPE_DEG_H, LENGTH_DEGC = 0.006, 0.004, 30.0
LIMIT_BIN_S = 300.0
GROUND_S, FLOWN_S = 2300.0, 9900.0  # about, of a session without and with a flight
NAME = "recalibration_flights"


Line = Mapping[str, Any]


@dataclass(frozen=True)
class Unit:
    """A unit and what belongs to it."""

    seed: int
    truth: UnitTruth
    twin: TwinModel
    errors: FlightErrors


@dataclass(frozen=True)
class Told:
    """The table after some sessions, what each said, and which temperatures they visited (n, 3)."""

    table: ThermalTable
    outcomes: tuple[str, ...]
    joined: int
    visited: NDArray


def drawn_unit(seed: int) -> Unit:
    rng = np.random.default_rng([19, seed])
    twin = default_twin(TECHNOLOGY)
    truth = aged_unit(rng, gyro_technology=TECHNOLOGY)
    own = replace(twin, gyro=drawn_gyro(rng, twin.gyro, TECHNOLOGY))
    return Unit(seed, truth, own, drawn_errors(rng, TECHNOLOGY))


def ambients(seed: int) -> NDArray:
    """Of each session [degC]."""
    return np.random.default_rng([20, seed]).uniform(*AMBIENT_DEGC, SESSIONS)


def thermal_of(seed: int, k: int, *, flies: bool) -> ThermalHistory:
    """Of session k."""
    ambient = float(ambients(seed)[k])
    thermal: ThermalHistory = replace(
        THERMAL, ambient_degC=ambient, start_degC=ambient, settled_degC=ambient + WARMS_DEGC
    )
    if flies:
        return thermal
    return replace(thermal, flight_degC=0.0, flight_start_s=0.0, flight_end_s=0.0)


def session(
    unit: Unit, k: int, table: ThermalTable, *, flies: bool
) -> tuple[UpdateResult, NDArray]:
    """Session k of a unit against a table; its gyro temperatures (n, 3)."""
    rng = np.random.default_rng([21, unit.seed, k])
    ideal = ideal_session((unit.seed + k) % PLACES, RATE_HZ, FLIGHT if flies else ())
    thermal = thermal_of(unit.seed, k, flies=flies)
    plan = SessionPlan(with_gnss=True, gnss_lever_arm_m=ANTENNA_M, run_id=f"{unit.seed}-{k}")
    simulated = simulate_run(ideal, thermal, unit.truth, unit.twin, rng=rng, plan=plan)
    simulated = with_flight_errors(simulated, ideal, unit.errors, rng)
    parent = table_sha256(table_to_dict(table))
    believed = default_twin(TECHNOLOGY)
    history = UnitHistory(parent_sha256=parent)
    result = update_calibration([simulated.run], table, believed, history=history)
    minutes = np.arange(0.0, ideal.time_s[-1], 60.0)
    return result, thermal.at(minutes).gyro_degC


def through(unit: Unit, flies: Sequence[bool]) -> Told:
    """A unit's sessions, one after the other, from its factory table."""
    table = table_from_dict(unit.truth.factory_table(NODES_DEGC), name="factory table")
    outcomes: list[str] = []
    visited: list[NDArray] = []
    joined = 0
    for k, up in enumerate(flies):
        result, degC = session(unit, k, table, flies=up)
        table = result.after
        outcomes.append(result.outcome)
        visited.append(degC)
        flight = result.sessions[0].flight
        joined += flight is not None and flight.joined is not None
    return Told(table, tuple(outcomes), joined, np.concatenate(visited))


def scored(seed: int) -> Line:
    """One unit's line: error and sigma of its tables over GRID_DEGC, gyros x, y, z."""
    unit = drawn_unit(seed)
    after = {way: through(unit, flies) for way, flies in WAYS.items()}
    tables = {"before": _factory(unit), **{way: told.table for way, told in after.items()}}
    curves = {
        name: [_curve(table, unit.truth, k) for k in range(3)] for name, table in tables.items()
    }
    return {
        "seed": seed,
        "outcomes": {way: told.outcomes for way, told in after.items()},
        "joined": {way: told.joined for way, told in after.items()},
        "curves": curves,
        "visited": {
            way: [_near(told.visited[:, k]).tolist() for k in range(3)]
            for way, told in after.items()
        },
    }


def _factory(unit: Unit) -> ThermalTable:
    return table_from_dict(unit.truth.factory_table(NODES_DEGC), name="factory table")


def _curve(table: ThermalTable, truth: UnitTruth, k: int) -> list[list[float]]:
    """Error and sigma of a table, gyro k [deg/h]."""
    error = table.bias_deg_h(k, GRID_DEGC) - truth.bias_deg_h(AXES[k], GRID_DEGC)
    return [error.tolist(), table.sigma_deg_h(k, GRID_DEGC).tolist()]


def _near(visited: NDArray) -> NDArray:
    """Temperatures (n,) bool of the grid that were visited."""
    return np.asarray(np.abs(GRID_DEGC[:, None] - visited).min(axis=1) <= NEAR_DEGC)


def _spans(line: Line, k: int) -> Mapping[str, NDArray]:
    """Where in the grid each span of gyro k is (n,) bool."""
    ground, flown = (np.array(line["visited"][way][k]) for way in ("ground", "all"))
    return {"cold": flown & ~ground, "ground": ground, "never": ~flown & ~ground}


def limit_variance(seed: int, flies: Sequence[bool]) -> NDArray:
    """Variance over the grid (n,) [(deg/h)^2] of a level gyro's curve, once sessions that show each
    bin of it to the angle random walk are merged by the law that it was drawn from.
    """
    gyro = default_twin(TECHNOLOGY).gyro
    white = gyro.arw_deg_sqrt_h**2 * HOUR / LIMIT_BIN_S
    degC: list[NDArray] = []
    own: list[NDArray] = []
    for k, up in enumerate(flies):
        end_s = FLOWN_S if up else GROUND_S
        at = np.arange(0.5 * LIMIT_BIN_S, end_s, LIMIT_BIN_S)
        degC.append(thermal_of(seed, k, flies=up).at(at).gyro_degC[:, 0])
        departs = session_covariance(
            axis_index=np.zeros(at.size, dtype=np.int64),
            time_s=at,
            duration_s=np.full(at.size, LIMIT_BIN_S),
            gyro=gyro,
            run_length_s=end_s,
            sigma_misalignment_mrad=np.full(3, SessionSettings().sigma_misalignment_mrad),
        )
        own.append(departs + white * np.eye(at.size))
    T = np.concatenate(degC)
    gain = np.linalg.solve(_law(T, T) + block_diag(*own), _law(T, GRID_DEGC)).T
    return np.diag(_law(GRID_DEGC, GRID_DEGC) - gain @ _law(T, GRID_DEGC))


def _law(one: NDArray, other: NDArray) -> NDArray:
    """Covariance of ageing at temperatures (n, m) [(deg/h)^2]."""
    apart = (one[:, None] - other) / LENGTH_DEGC
    return np.asarray(COMMON_DEG_H**2 + SHAPE_DEG_H**2 * np.exp(-0.5 * apart**2))


def hour_of(line: Line) -> Line:
    """A held-out hour in the cold, after an hour's alignment, with each table of a unit: position
    error at its end, north and east [m].
    """
    unit = drawn_unit(int(line["seed"]))
    rng = np.random.default_rng([22, unit.seed])
    k = int(rng.integers(PLACES))
    sensors = free_inertial.ideal("flight", LATITUDES_DEG[k], HEADINGS_DEG[k])
    ambient = float(rng.uniform(*AMBIENT_DEGC))
    thermal = replace(
        THERMAL,
        ambient_degC=ambient,
        start_degC=ambient,
        settled_degC=ambient + WARMS_DEGC,
        flight_start_s=HOUR + 600.0,
        flight_end_s=2.0 * HOUR,
    )
    plan = SessionPlan(run_id=f"hour-{unit.seed}")
    simulated = simulate_run(sensors, thermal, unit.truth, unit.twin, rng=rng, plan=plan)
    tables = {name: _flown(unit, line["curves"][name]) for name in ("before", *WAYS)}
    tables["perfect"] = _flown(unit, [[0.0 * GRID_DEGC, 1e-4 + 0.0 * GRID_DEGC]] * 3)
    believed = default_twin(TECHNOLOGY)
    hours = {
        name: free_inertial.fly_with(table, simulated, believed) for name, table in tables.items()
    }
    return {"seed": unit.seed, "end_m": {n: [h.north_m, h.east_m] for n, h in hours.items()}}


def _flown(unit: Unit, curves: Sequence[Sequence[ArrayLike]]) -> Flown:
    """A table to fly with, of which a line says errors and sigmas."""

    def bias(k: int, degC: NDArray) -> NDArray:
        true = unit.truth.bias_deg_h(AXES[k], degC)
        return np.asarray(true + np.interp(degC, GRID_DEGC, np.asarray(curves[k][0])))

    data = unit.truth.factory_table(GRID_DEGC)
    for k, axis in enumerate(AXES):
        data["axes"][axis]["sigma_deg_h"] = np.asarray(curves[k][1]).tolist()
    return Flown(bias, table_from_dict(data, name="believed"))


def summary(lines: Sequence[Line], hours: Sequence[Line]) -> Line:
    """What the lines say together."""
    spans: dict[str, dict[str, dict[str, float]]] = {}
    for span in SPANS:
        spans[span] = {}
        for way in ("before", *WAYS):
            error, sigma, least = _mean_squares(lines, span, way)
            spans[span][way] = {
                "rms_deg_h": float(np.sqrt(error)),
                "sigma_deg_h": float(np.sqrt(sigma)),
                "limit_deg_h": float(np.sqrt(least)),
            }
    outcomes = {w: dict(Counter(o for x in lines for o in x["outcomes"][w])) for w in WAYS}
    return {
        "units": len(lines),
        "sessions": SESSIONS,
        "outcomes": outcomes,
        "joined": {way: sum(line["joined"][way] for line in lines) for way in WAYS},
        "spans": spans,
        "hours": _hours(hours) if hours else None,
    }


def _mean_squares(lines: Sequence[Line], span: str, way: str) -> NDArray:
    """Of errors, sigmas and limits of the level gyros (3,) [(deg/h)^2]."""
    found: list[tuple[float, float, float]] = []
    for line in lines:
        flies = WAYS.get(way)
        prior = np.full(GRID_DEGC.size, COMMON_DEG_H**2 + SHAPE_DEG_H**2)
        least = prior if flies is None else limit_variance(int(line["seed"]), flies)
        for k in (0, 1):
            at = _spans(line, k)[span]
            if at.any():
                error, sigma = (np.array(row)[at] for row in line["curves"][way][k])
                squares = np.mean(error**2), np.mean(sigma**2), np.mean(least[at])
                found.append((float(squares[0]), float(squares[1]), float(squares[2])))
    return np.mean(found, axis=0)


def _hours(hours: Sequence[Line]) -> Line:
    """RMS distance at the end of the hour with each table [m], and how much of what a perfect table
    would take off the old one's each takes off; over units with all of them.
    """
    ends = {n: np.array([h["end_m"][n] for h in hours]) for n in hours[0]["end_m"]}
    whole = np.all([np.isfinite(end).all(axis=1) for end in ends.values()], axis=0)
    rms = {n: float(np.sqrt(np.mean(np.sum(e[whole] ** 2, axis=1)))) for n, e in ends.items()}
    share = {n: rms["perfect"] / rms[n] for n in rms}
    return {"units": int(whole.sum()), "rms_m": rms, "of_perfect_gain": share}


def section(found: Line) -> str:
    """The study's part on flights, in Markdown."""
    rows = [
        "| five sessions | cold | limit | on the ground | limit | never visited | limit |",
        "|---|---|---|---|---|---|---|",
    ]
    for way, words in WORDS.items():
        cells = [
            f"{found['spans'][span][way][key]:.4f}"
            for span in SPANS
            for key in ("rms_deg_h", "limit_deg_h")
        ]
        rows.append(f"| {words} | {' | '.join(cells)} |")
    parts = [INTRODUCTION.format(**found), "\n".join(rows), METHOD.format(**found)]
    hours = found["hours"]
    if hours:
        lines = ["| table | RMS at the end | old / this over old / perfect |", "|---|---|---|"]
        for name, words in {**WORDS, "perfect": "perfect table"}.items():
            share = 100.0 * hours["of_perfect_gain"][name]
            lines.append(f"| {words} | {hours['rms_m'][name]:.0f} m | {share:.0f} % |")
        parts += [HOUR_WORDS.format(**hours), "\n".join(lines)]
    return "\n\n".join(parts) + "\n"


WORDS = {
    "before": "do nothing",
    "ground": "recal, on the ground",
    "half": "recal, three of the five fly",
    "all": "**recal, flights as well** (all five park and fly)",
}
INTRODUCTION = """## Flights as well

{units} units, aged as above (`python -m benchmarks.flight_units`): five sessions each that park
and taxi for 40 min with a receiver, against the same with a flight of 1.8 h after it; default
twin, further nuisances of the [flights](flight_update.md) drawn from their priors. Level gyros,
RMS over units in deg/h: at temperatures that flights alone reach (*cold*), that sessions on the
ground reach, and that no session came within 2 degC of, from -30 to 50 degC."""
METHOD = """*Limit*: the RMS error that no merge of these sessions can better: Gaussian posterior
under the very law that the units were drawn from, sessions that show five minutes of a gyro to its
angle random walk, and turn-on, flicker and random walk of the rate as simulated; a mean over
units, of which so few may lie 10 % beside it. Flights
joined: {joined[half]} of the sessions with three flights, {joined[all]} of those with five."""
HOUR_WORDS = """A held-out hour of each unit ({units} units): 60 min of alignment, take-off, climb
and cruise with gyros cooling to the temperatures of a cruise, nothing but a damped height."""


def main(arguments: Sequence[str]) -> None:
    """Run what the head of this module shows."""
    kind, names = arguments[0], list(arguments[1:])
    if kind == "hours":
        for line in _read(names):
            print(json.dumps(hour_of(line)), flush=True)
        return
    if kind == "summary":
        folder = Path(names.pop()) if "-o" in names else None
        lines = _read([name for name in names if name != "-o"])
        of_hours = [line for line in lines if "end_m" in line]
        found = summary([line for line in lines if "curves" in line], of_hours)
        print(section(found))
        if folder is not None:
            text = json.dumps(found, indent=1) + "\n"
            (folder / f"{NAME}.json").write_text(text, encoding="utf-8")
        return
    for seed in range(int(kind), int(names[0])):
        print(json.dumps(scored(seed)), flush=True)


def _read(names: Sequence[str]) -> list[Line]:
    return [json.loads(text) for name in names for text in Path(name).read_text().splitlines()]


if __name__ == "__main__":
    main(sys.argv[1:])
