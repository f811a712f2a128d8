"""Simulated against estimated, source by source: each error of the list put at its usual size into
a session that parks and taxis, or flies where only that shows it, and the session estimated without
being told.

Square: squared error over variance of the session's mean biases, three gyros a seed; 1 of right
sigmas. Where an estimator carries the error its sigma has to hold, where it does not the biases
have to stay honest, or the diagnosis of the same run has to name it. A gyro's error is part of its
bias as far as it shows at rest. The errors are put in by their own declarations
(`simreal.twin.inject`): what is checked is the estimator, not the declaration.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from benchmarks.study import Work, table
from infield.session.estimate import SessionEstimate
from infield.session.one_run import take_run
from infield.session.settings import SessionSettings
from ins.errors.base import GYROS, ErrorSource
from ins.errors.catalogue import catalogue, effects_named
from ins.errors.telemetry import PARKED, Telemetry
from ins.records import Run
from ins.units import DEG_PER_HOUR
from simreal.declared.twin_effects import TwinEffect
from simreal.evidence.run_view import view_run
from simreal.inference.diagnosis import DiagnosisSettings, diagnose
from simreal.twin.inject import injected
from tests.simreal import runs
from trajectories.simulator.session import SimulatedRun

HEAD = ("error", "recipes that carry it", "motion", "sessions", "refused", "square", "largest")
HEAD += ("named by the diagnosis",)
NOTHING = "nothing"  # the same sessions as they are
TESTED = 0.99  # share of right sigmas whose squares lie in the interval
MOTIONS = {"taxi": runs.TAXI, "flight": runs.FLIGHT}


def run(work: Work, *, seeds: int = 20, named: int = 2, only: str = "") -> str:
    """The table. named: runs that are diagnosed where the biases are not honest."""
    names = [name for name in (NOTHING, *_names()) if only in name]
    found = work.each(one_session, [(name, seed) for name in names for seed in range(seeds)])
    by_name = {name: [r for r in found if r["error"] == name] for name in names}
    wrong = [name for name, records in by_name.items() if _beyond(records)]
    told = work.each(one_diagnosis, [(name, seed) for name in wrong for seed in range(named)])
    rows = [_row(name, by_name[name], told) for name in names]
    return table(HEAD, rows)


def _names() -> list[str]:
    return [e.name for e in catalogue() if e.id == e.name and e.diagnosed and not e.out_of_reach]


class Made(NamedTuple):
    """A session without the error, its run with it, what its gyros were given (n, 3) [rad/s] at the
    instants of the motion, and which motion it is.
    """

    plain: SimulatedRun
    run: Run
    added_rad_s: NDArray
    telemetry: Telemetry
    motion: str


def _made(name: str, seed: int) -> Made | None:
    """None where neither motion shows the error."""
    rng = np.random.default_rng([seed, 77])
    for motion, segments in MOTIONS.items():
        plain = runs.simulated(seed=seed, segments=segments, aids=True)
        telemetry = view_run(plain.run, 0, runs.table(), runs.twin_of()).telemetry
        nothing = np.zeros((telemetry.n, 3))
        if name == NOTHING:
            return Made(plain, plain.run, nothing, telemetry, motion)
        source = _source(name)
        target = source.targets[seed % len(source.targets)]
        if source.needs([telemetry], target):
            continue
        effect = TwinEffect(source, target, _sizes(source, rng), _shape(source, telemetry))
        put = injected(plain.run, telemetry, [effect], rng)
        of_gyro = put.trace.gyro_rad_s if target in GYROS else None  # else the body did turn
        added = nothing if of_gyro is None else of_gyro
        return Made(plain, put.run, added, telemetry, motion)
    return None


def _source(name: str) -> ErrorSource:
    source = effects_named(name)[0]
    assert isinstance(source, ErrorSource)
    return source


def _sizes(source: ErrorSource, rng: np.random.Generator) -> tuple[float, ...]:
    """In the middle of what is usual; signs drawn."""
    return tuple(
        float(np.sqrt(c.low * c.high) * (rng.choice([-1.0, 1.0]) if c.signed else 1.0))
        for c in source.coefficients
    )


def _shape(source: ErrorSource, run: Telemetry) -> dict[str, float]:
    """In the middle of what is usual, times in the middle of the run."""
    middle = 0.5 * (run.time_s[0] + run.time_s[-1])
    return {
        s.name: float(middle if s.of_time else np.sqrt(s.low * s.high) if s.low > 0.0 else 0.5)
        for s in source.shape
    }


def one_session(name: str, seed: int) -> dict[str, Any]:
    """Squares of the mean biases (3,) over their variances; none of a session that was refused."""
    made = _made(name, seed)
    record: dict[str, Any] = {"error": name, "motion": "", "squares": []}
    if made is None:
        return record
    record["motion"] = made.motion
    result = take_run(made.run, runs.table(), runs.twin_of(), SessionSettings(), repeated=False)
    if result.verdict.accepted and result.estimate is not None:
        flight = result.flight
        joined = None if flight is None else flight.joined
        record["squares"] = _squares(joined or result.estimate, made)
    return record


def _squares(estimate: SessionEstimate, made: Made) -> list[float]:
    bins, n, run = estimate.bins, estimate.bins.start_s.size, made.telemetry
    rests = run.kind == PARKED
    at_rest = made.added_rad_s[rests] / DEG_PER_HOUR
    unit = made.plain.bias_time_s, made.plain.gyro_bias_true_deg_h
    true = np.stack(
        [_mean(*unit, a, b) + _mean(run.time_s[rests], at_rest, a, b) for a, b in _spans(bins)]
    )
    error = (bins.table_deg_h + estimate.mean_deg_h).reshape(-1, 3) - true
    mean = np.kron(np.full(n, 1.0 / n), np.eye(3))
    variance = np.diag(mean @ estimate.covariance @ mean.T)
    return [float(square) for square in error.mean(axis=0) ** 2 / variance]


def _spans(bins: Any) -> list[tuple[float, float]]:
    return list(zip(bins.start_s, bins.end_s))


def _mean(time_s: NDArray, values: NDArray, start_s: float, end_s: float) -> NDArray:
    """Over a span (3,); of the nearest row where none lies in it."""
    rows = (time_s > start_s) & (time_s <= end_s)
    if not rows.any():
        return np.asarray(values[np.argmin(np.abs(time_s - 0.5 * (start_s + end_s)))])
    return np.asarray(values[rows].mean(axis=0))


def one_diagnosis(name: str, seed: int) -> dict[str, Any]:
    """What the diagnosis names of the same run."""
    made = _made(name, seed)
    assert made is not None
    found = diagnose([made.run], runs.twin_of(), runs.table(), DiagnosisSettings())
    return {"error": name, "causes": [cause.effect for cause in found.causes]}


def _beyond(records: Sequence[dict[str, Any]]) -> bool:
    """Whether the squares are more than right sigmas have."""
    squares = [square for r in records for square in r["squares"]]
    return bool(squares) and sum(squares) > chi2.ppf(0.5 + 0.5 * TESTED, len(squares))


def _row(name: str, records: list[dict[str, Any]], told: list[dict[str, Any]]) -> tuple[str, ...]:
    priors = () if name == NOTHING else _source(name).priors
    recipes = sorted({word for prior in priors for word in prior.recipes.split()})
    motions = sorted({r["motion"] for r in records} - {""})
    shown = [r for r in records if r["motion"]]
    squares = [square for r in shown for square in r["squares"]]
    refused = sum(not r["squares"] for r in shown)
    causes = [", ".join(t["causes"]) or "nothing" for t in told if t["error"] == name]
    return (
        f"`{name}`",
        ", ".join(recipes) or "-",
        ", ".join(motions) or "no motion here shows it",
        str(len(shown)),
        str(refused),
        f"{np.mean(squares):.2f}" if squares else "-",
        f"{np.sqrt(max(squares)):.1f}" if squares else "-",
        "; ".join(causes) or "-",
    )
