"""Predictions of `recal watch`: the sigma of each gyro 10 and 20 min ahead, against the sigma that
the session has then.

Each session is a scenario with an environment of its own, parked at least until then, seen at a
moment between 10 and 40 min.
"""

from dataclasses import replace

import numpy as np

from benchmarks.study import Record, Work, share, table
from infield.session.pipeline import update_calibration
from infield.session.results import UpdateResult
from infield.table.thermal_table import ThermalTable
from ins.records import ImuLog, Run, TwinModel
from ins.units import MINUTE
from recal.service.simulate import simulate
from simreal.plan.ahead import outlook, stay
from trajectories.runs.directory import run_sha256
from trajectories.simulator.environments.kinds import EnvironmentKind

SCENARIOS = ("cold_parked_taxi", "ambient_parked_taxi", "cooling_parked_taxi", "hot_parked_taxi")
AHEAD_MIN = (10.0, 20.0)
WITHIN = 0.1
LATEST_MIN = 45.0  # so that the vehicle still stands 20 min later, and rows of 65 min suffice


def seen_until(run: Run, until_s: float) -> Run:
    """A run as its recorder had it at that time."""
    imu = run.imu.between(-np.inf, until_s)
    log = run.temperature
    assert log is not None
    before = log.time_s <= until_s
    columns = {k: v[before] for k, v in vars(log).items() if isinstance(v, np.ndarray)}
    short = replace(run, imu=imu, temperature=replace(log, **columns), phases=())
    assert isinstance(imu, ImuLog)
    return replace(short, sha256=run_sha256(short))


def updated(run: Run, until_s: float, table_: ThermalTable, twin: TwinModel) -> UpdateResult:
    return update_calibration([seen_until(run, until_s)], table_, twin)


def predicted(seed: int) -> Record:
    """Ratios of predicted to later sigma, by minutes ahead."""
    kinds = [kind.value for kind in EnvironmentKind if kind is not EnvironmentKind.SHIP]
    kind, scenario = kinds[seed % len(kinds)], SCENARIOS[seed // len(kinds) % len(SCENARIOS)]
    made = simulate(scenario, seed=9000 + seed, rate_hz=10.0, environments=[kind])
    now_s = float(np.random.default_rng(seed).uniform(10.0, LATEST_MIN) * MINUTE)
    now = updated(made.run, now_s, made.table, made.twin)
    ratios = {}
    for found in outlook(now, [stay(minutes) for minutes in AHEAD_MIN]):
        later = updated(made.run, now_s + found.duration_s, made.table, made.twin)
        if later.sessions[0].seen:
            sigma = np.array([axis.sigma_after_deg_h for axis in later.sessions[0].seen])
            ratio = np.array(found.sigma_deg_h) / sigma
            ratios[f"{found.duration_s / MINUTE:.0f}"] = ratio.tolist()
    return {"seed": seed, "environment": kind, "now_min": now_s / MINUTE, "ratios": ratios}


def run(work: Work, *, sessions: int = 40, first: int = 0) -> str:
    records = work.each(predicted, [(seed,) for seed in range(first, first + sessions)])
    rows = []
    for minutes in AHEAD_MIN:
        of = [r["ratios"][f"{minutes:.0f}"] for r in records if f"{minutes:.0f}" in r["ratios"]]
        worst = np.abs(np.log(np.array(of))).max(axis=1) if of else np.zeros(0)
        good = int(np.count_nonzero(worst <= np.log1p(WITHIN)))
        most = f"{100 * np.expm1(worst.max()):.1f} %" if of else "-"
        rows.append([f"{minutes:.0f} min", share(good, len(of)), most, len(records) - len(of)])
    head = ("ahead", "all three gyros within 10 %", "largest error", "not predicted")
    return table(head, rows)
