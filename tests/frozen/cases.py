"""The inputs of the frozen answers, by kind: each makes a run and gives the answer about it.

Simulated inputs are seeded; a recorded log is skipped where ../shared/data does not hold it.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import recal
from benchmarks import twin_fit
from benchmarks.gap_trials.trial import draw_noise_trial, draw_trial
from infield.table.file import json_text
from ins.twin_file import default_twin, twin_to_dict
from tests.frozen import answers
from tests.frozen import motion_runs as runs
from tests.frozen.motion import of_motion
from tests.infield import aided_cases, car_cases, flown_cases, mems_flights, mems_sessions, sessions
from trajectories.runs.directory import write_run
from trajectories.simulator.session import SessionPlan, simulate_run
from trajectories.simulator.unit_truth import aged_unit

LEFT_OUT = {  # of the runs of `motion_runs`: what a session of them would repeat
    "quiet park",
    "boarding in the first 30 s",
    "constant speed, inertial alone",
    "four azimuths, short and bumped",
    "chamber ramps",
    "chamber ramps, bumped and tilted",
    "chamber ramps on a turntable",
    "MEMS, two stands with phases",
    "MEMS flight with GNSS",
    "flight without phases or aids",
    "straight taxi",
    "taxi, all aids",
}
QUICK_SESSIONS = {"taxi with two stops", "gusts", "MEMS, two stands", "cold_parked_taxi", "flown 1"}
ROUGH = ("boarding", "loading", "ship", "gusty:2")


@dataclass(frozen=True)
class Frozen:
    """An input by name. quick: asked in the normal suite; needs: its file in ../shared/data."""

    name: str
    ask: Callable[[], answers.Answer]
    quick: bool = False
    needs: str = ""


# Sessions -----------------------------------------------------------------------------------------


def _of_case(make: Callable[[], runs.Case]) -> answers.Answer:
    case = make()
    return answers.of_session(recal.update(case.run, case.table, case.twin).to_dict())


def _scenario(name: str, seed: int, environment: str | None) -> answers.Answer:
    given = {} if environment is None else {"environments": [environment]}
    made = recal.simulate(name, seed=seed, rate_hz=10, **given)
    return answers.of_session(recal.update(made.run, made.table, made.twin).to_dict())


def _flown(seed: int) -> answers.Answer:
    made = flown_cases.flown(seed)
    found = recal.update(made.run, sessions.factory(), sessions.TWIN)
    return answers.of_session(found.to_dict())


def _mems_flown(seed: int) -> answers.Answer:
    made = mems_flights.flight(seed, turn_deg=90.0, with_gnss=True)
    found = recal.update(made.run, mems_sessions.blank(), mems_sessions.TWIN)
    return answers.of_session(found.to_dict())


def _sessions() -> list[Frozen]:
    named = [n for n in runs.SIMULATED if n.name not in LEFT_OUT][:28]
    found = [Frozen(n.name, partial(_of_case, n.make), n.name in QUICK_SESSIONS) for n in named]
    names = ("cold_parked_taxi", "hot_parked_taxi", "two_headings")
    for seed, name in enumerate(names, 50):
        found.append(Frozen(name, partial(_scenario, name, seed, None), name in QUICK_SESSIONS))
    for seed, rough in enumerate(ROUGH, 60):
        ask = partial(_scenario, "cold_parked_taxi", seed, rough)
        found.append(Frozen(f"rough, {rough}", ask))
    for seed in range(1, 4):
        found.append(Frozen(f"flown {seed}", partial(_flown, seed), seed == 1))
    for seed in range(1, 3):
        found.append(Frozen(f"MEMS flown {seed}", partial(_mems_flown, seed)))
    return found


# Aided logs ---------------------------------------------------------------------------------------


def _replayed(case: runs.Case) -> answers.Answer:
    return answers.of_aided(recal.replay(case.run, case.table, twin=case.twin).to_dict())


def _aided_flight(technology: str, park_s: float, seed: int) -> answers.Answer:
    twin = aided_cases.twin_of(technology)
    made = aided_cases.flown(aided_cases.ideal(park_s), twin, seed, technology)
    return _replayed(runs.Case(made.run, sessions.factory(), twin))


def _drive(seed: int) -> answers.Answer:
    run = car_cases.driven(seed).run
    run = replace(run, header=replace(run.header, gyro_technology="mems"))
    return _replayed(runs.Case(run, mems_sessions.blank(), default_twin("mems")))


def _recorded(make: Callable[[], runs.Case]) -> answers.Answer:
    return _replayed(make())


def _aided() -> list[Frozen]:
    found = []
    for technology, parks_s, seeds in (("rlg", (400.0,), 6), ("mems", (60.0, 0.5), 6)):
        for park_s in parks_s:
            for seed in range(seeds):
                name = f"{technology} flight {seed}, {park_s:g} s at rest"
                ask = partial(_aided_flight, technology, park_s, seed)
                found.append(Frozen(name, ask, seed == 0))
    found += [Frozen(f"drive {seed}", partial(_drive, seed)) for seed in range(5)]
    for named in runs.RECORDED[2:]:
        found.append(Frozen(named.name, partial(_recorded, named.make), needs=named.needs))
    return found


# Diagnoses ----------------------------------------------------------------------------------------


def _diagnosis(seed: int, plan: str, effects: int, source: str) -> answers.Answer:
    """A blind trial, its effects at their usual sizes, through files as a user gives them."""
    if effects < 0:
        trial = draw_noise_trial(seed, plan=plan, source=source)
    else:
        trial = draw_trial(seed, plan=plan, effects=effects, source=source)
    with TemporaryDirectory() as name:
        folder = Path(name)
        for k, run in enumerate(trial.runs):
            write_run(folder / f"run-{k}", run)
        (folder / "table.json").write_text(json_text(trial.table), "utf-8")
        twin = twin_to_dict(trial.twin) | {"table": "table.json"}
        (folder / "twin.json").write_text(json_text(twin), "utf-8")
        paths = [folder / f"run-{k}" for k in range(len(trial.runs))]
        return answers.of_diagnosis(recal.diagnose(paths, folder / "twin.json").to_dict())


KINDS_OF_DIAGNOSIS = (  # name, first seed, how many, plan, effects (-1: a wrong noise), source
    ("nothing", 0, 50, "four", 0, "trajectories"),
    ("one", 1000, 70, "four", 1, "trajectories"),
    ("one cold", 2000, 20, "one_cold", 1, "trajectories"),
    ("two", 3000, 40, "four", 2, "trajectories"),
    ("noise", 4000, 10, "four", -1, "trajectories"),
    ("pyins", 5000, 10, "four", 1, "pyins"),
)


# 3022: not answered within four minutes, a fault that is open; 3026: not asked
NOT_FROZEN = (3022, 3026)


def _diagnoses() -> list[Frozen]:
    found = []
    for name, first, count, plan, effects, source in KINDS_OF_DIAGNOSIS:
        for seed in range(first, first + count):
            if seed in NOT_FROZEN:
                continue
            ask = partial(_diagnosis, seed, plan, effects, source)
            quick = seed == first and name in ("nothing", "one cold")
            found.append(Frozen(f"{name} {seed}", ask, quick))
    return found


# Twin fits ----------------------------------------------------------------------------------------


def _fit(technology: str, seed: int) -> answers.Answer:
    rng = np.random.default_rng([seed, 36])
    made = simulate_run(
        twin_fit.parked_hour(technology),
        twin_fit.HISTORY,
        aged_unit(rng, gyro_technology=technology),
        twin_fit.drawn_twin(technology, rng),
        rng=rng,
        plan=SessionPlan(),
    )
    return answers.of_twin_fit(recal.fit_twin(made.run).to_dict())


def _twin_fits() -> list[Frozen]:
    cells = [(technology, seed) for technology in twin_fit.BASES for seed in range(10)]
    return [
        Frozen(f"{t} {seed}", partial(_fit, t, seed), t == "fog" and seed == 0) for t, seed in cells
    ]


# Motion -------------------------------------------------------------------------------------------


def _moved(make: Callable[[], runs.Case]) -> answers.Answer:
    return of_motion(make())


def _motion() -> list[Frozen]:
    return [
        Frozen(named.name, partial(_moved, named.make), named.quick, named.needs)
        for named in (*runs.SIMULATED, *runs.RECORDED)
    ]


CASES = {
    "motion": _motion(),
    "sessions": _sessions(),
    "aided": _aided(),
    "diagnoses": _diagnoses(),
    "twin_fits": _twin_fits(),
}
