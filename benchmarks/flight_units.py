"""What flights are worth to aged units: each through five sessions parked and taxiing, and through
the same number of which every other one flies, with the same receiver.

    python benchmarks/flight_units.py 0 40 > units.jsonl      units 0 to 39, one line each
    python benchmarks/flight_units.py summary units.jsonl ...

What belongs to a unit (scale, misalignment, slopes, g-sensitivity, what vibration changes) is drawn
once and holds in all its sessions; ambient, heading and latitude differ from session to session.
Scored in RMS over level gyros: the temperatures that flights alone reach (`cold`), those that
sessions on the ground reach (`ground`), those that neither reach (`never`), and the drift of an
hour in the cold by the errors of the level gyros there.
"""

import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.flight_errors import FlightErrors, with_flight_errors
from benchmarks.flight_update import (
    ANTENNA_M,
    FLIGHT,
    NODES_DEGC,
    RATE_HZ,
    THERMAL,
    drawn_errors,
    drawn_gyro,
    ideal_session,
)
from infield.session.pipeline import UnitHistory, update_calibration
from infield.session.results import UpdateResult
from infield.table.file import table_from_dict, table_sha256, table_to_dict
from infield.table.thermal_table import ThermalTable
from ins.records import AXES, TwinModel
from ins.twin_file import default_twin
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


def session(
    unit: Unit, k: int, table: ThermalTable, *, flies: bool
) -> tuple[UpdateResult, NDArray]:
    """Session k of a unit against a table; its gyro temperatures (n, 3)."""
    rng = np.random.default_rng([21, unit.seed, k])
    ideal = ideal_session((unit.seed + k) % PLACES, RATE_HZ, FLIGHT if flies else ())
    ambient = float(ambients(unit.seed)[k])
    thermal: ThermalHistory = replace(
        THERMAL, ambient_degC=ambient, start_degC=ambient, settled_degC=ambient + WARMS_DEGC
    )
    if not flies:
        thermal = replace(thermal, flight_degC=0.0, flight_start_s=0.0, flight_end_s=0.0)
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


def scored(seed: int) -> dict[str, object]:
    """One unit's line."""
    unit = drawn_unit(seed)
    ground = through(unit, [False] * SESSIONS)
    half = through(unit, [k % 2 == 0 for k in range(SESSIONS)])
    factory = table_from_dict(unit.truth.factory_table(NODES_DEGC), name="factory table")
    tables = {"before": factory, "ground": ground.table, "half": half.table}
    spans: dict[str, dict[str, list[float]]] = {}
    worst: dict[str, float] = {}
    for k, axis in enumerate(AXES[:2]):
        grid = np.arange(NODES_DEGC[0], NODES_DEGC[-1] + 0.5)
        truth = unit.truth.bias_deg_h(axis, grid)
        of_ground, of_half = _near(grid, ground.visited[:, k]), _near(grid, half.visited[:, k])
        where = {"cold": of_half & ~of_ground, "ground": of_ground, "never": ~of_half & ~of_ground}
        for name, table in tables.items():
            error = table.bias_deg_h(k, grid) - truth
            for span, at in where.items():
                one = spans.setdefault(span, {}).setdefault(name, [])
                one.append(float(np.mean(error[at] ** 2)))
            if name != "before":
                visited = of_half if name == "half" else of_ground
                ratio = np.abs(error / table.sigma_deg_h(k, grid))[visited]
                worst[name] = max(worst.get(name, 0.0), float(ratio.max()))
    return {
        "seed": seed,
        "outcomes": {"ground": ground.outcomes, "half": half.outcomes},
        "joined": half.joined,
        "mean_squares": spans,
        "worst_sigmas": worst,
    }


def _near(grid: NDArray, visited: NDArray) -> NDArray:
    """Temperatures (n,) bool of a grid that were visited."""
    return np.asarray(np.abs(grid[:, None] - visited).min(axis=1) <= NEAR_DEGC)


def summary(paths: Sequence[Path]) -> None:
    """Print what the lines say together."""
    lines = [json.loads(text) for path in paths for text in path.read_text().splitlines()]
    print(f"{len(lines)} units of {SESSIONS} sessions")
    for way in ("ground", "half"):
        outcomes = [o for line in lines for o in line["outcomes"][way]]
        counts = {o: outcomes.count(o) for o in sorted(set(outcomes))}
        worst = np.array([line["worst_sigmas"][way] for line in lines])
        beyond = int(np.sum(worst > WITHIN_SIGMAS))
        print(f"{way}: {counts}, worst node {worst.max():.1f} sigmas, {beyond} units beyond 4")
    print("flights joined:", sum(line["joined"] for line in lines))
    for span in ("cold", "ground", "never"):
        told = []
        for name in ("before", "ground", "half"):
            squares = [v for line in lines for v in line["mean_squares"][span][name]]
            told.append(f"{name} {np.sqrt(np.nanmean(squares)):.5f}")
        print(f"{span}: RMS [deg/h] " + ", ".join(told))


def main(arguments: Sequence[str]) -> None:
    if arguments[0] == "summary":
        summary([Path(name) for name in arguments[1:]])
        return
    for seed in range(int(arguments[0]), int(arguments[1])):
        print(json.dumps(scored(seed)), flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
