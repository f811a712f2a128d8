"""Does a parked hour end in a table? Hours in every environment, then taxi, and their updates.

The unit, its noise and the place are drawn apart from the environment, so that a session in `calm`
at the same station is the yardstick of sigma: what the same hour gives where nothing moves.
"""

import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm

from alignment.motion.kinds import DISTURBED, STILL
from benchmarks.study import Record, Work, table
from infield.session.estimate import SessionEstimate
from infield.session.pipeline import UnitHistory, update_calibration
from infield.session.points import mean_rows
from infield.session.results import SessionResult, UpdateResult
from infield.table.file import table_from_dict, table_sha256, table_to_dict
from ins.records import GYRO_TECHNOLOGIES, Site
from ins.twin_file import default_twin
from ins.units import DEG
from trajectories.simulator.environments.kinds import Environment, EnvironmentKind
from trajectories.simulator.motions import reference_motion
from trajectories.simulator.sensors import IdealSensors, ideal_sensors
from trajectories.simulator.session import SessionPlan, SimulatedRun, simulate_run
from trajectories.simulator.thermal import STARTS, thermal_history
from trajectories.simulator.truth import build_truth
from trajectories.simulator.unit_truth import aged_unit

PARKED_S, RATE_HZ = 3600.0, 10.0
SPREAD = 0.5  # of the logarithm of strength: two thirds lie between 0.6 and 1.6
# Ageing of a table, one sigma: physics.md 6.8 for rlg; of the size of blank tables for the others.
SIGMA_DEG_H = {"rlg": 0.0072, "fog": 0.02, "mems": 30.0}
COMMON_SHARE = 0.7  # of the ageing's variance, as a table without covariance has it
STATIONS = 12
LATITUDES_DEG = (-45.0, 0.0, 30.0, 45.0, 60.0)
HEADINGS_DEG = np.arange(0.0, 360.0, 15.0)
REFERENCES = 1_000_000  # seeds of the calm yardsticks, apart from those of the sessions
KINDS = tuple(kind.value for kind in EnvironmentKind)


@dataclass(frozen=True, kw_only=True)
class Draw:
    """What one session is: number, environment, strength, technology, station."""

    index: int
    seed: int
    environment: str
    strength: float
    technology: str
    station: int


@dataclass(frozen=True)
class Station:
    """Where and how a unit is powered on."""

    lat_deg: float
    heading_deg: float
    start: str


def draw(index: int, seed: int) -> Draw:
    """Session `index` of a study; 27 in a row hold every environment with every technology."""
    rng = np.random.default_rng([seed, index])
    row = int(np.random.default_rng([seed, index // 27, 27]).permutation(27)[index % 27])
    return Draw(
        index=index,
        seed=seed,
        environment=KINDS[row % len(KINDS)],
        strength=float(np.exp(SPREAD * rng.standard_normal())),
        technology=GYRO_TECHNOLOGIES[row // len(KINDS)],
        station=int(rng.integers(STATIONS)),
    )


def yardstick(technology: str, station: int, seed: int) -> Draw:
    """The calm session that gives sigma its yardstick."""
    return Draw(
        index=REFERENCES + station,
        seed=seed,
        environment="calm",
        strength=1.0,
        technology=technology,
        station=station,
    )


@lru_cache(maxsize=1)
def stations() -> tuple[Station, ...]:
    """The stations of every study."""
    rng = np.random.default_rng(15)
    starts = list(STARTS)
    return tuple(
        Station(
            float(rng.choice(LATITUDES_DEG)),
            float(rng.choice(HEADINGS_DEG)),
            starts[k % len(starts)],
        )
        for k in range(STATIONS)
    )


@lru_cache(maxsize=STATIONS)
def ideal_run(station: Station) -> IdealSensors:
    """The noise-free hour and taxi at a station."""
    site = Site(lat_rad=station.lat_deg * DEG, lon_rad=7 * DEG, height_m=250.0)
    _, motion = reference_motion("realistic_taxi", parked_s=PARKED_S)
    return ideal_sensors(build_truth(motion, site, heading_rad=station.heading_deg * DEG), RATE_HZ)


def study_session(one: Draw) -> Record:
    """Simulates, updates and scores one session."""
    rng = np.random.default_rng([one.seed, one.index, 1])
    station, sigma = stations()[one.station], SIGMA_DEG_H[one.technology]
    unit = aged_unit(
        rng,
        gyro_technology=one.technology,
        ageing_offset_deg_h=sigma * np.sqrt(COMMON_SHARE),
        ageing_shape_deg_h=sigma * np.sqrt(1 - COMMON_SHARE),
    )
    twin = default_twin(one.technology)
    around = Environment(kind=one.environment, strength=min(one.strength, 10.0))
    made = simulate_run(
        ideal_run(station),
        thermal_history(station.start, rng=rng),
        unit,
        twin,
        rng=rng,
        plan=SessionPlan(run_id=f"a{one.index}", environments=(around,)),
    )
    table = table_from_dict(unit.factory_table(), name="factory")
    began = time.process_time()
    history = UnitHistory(parent_sha256=table_sha256(table_to_dict(table)))
    result = update_calibration([made.run], table, twin, history=history)
    return {**asdict(one), **_scored(result, made), "cpu_s": round(time.process_time() - began, 3)}


def _scored(result: UpdateResult, made: SimulatedRun) -> Record:
    (session,) = result.sessions
    found: Record = {
        "outcome": result.outcome.value,
        "reasons": [str(reason.code.value) for reason in session.verdict.reasons]
        or [str(reason.code.value) for reason in result.reasons],
    }
    estimate = session.estimate
    if estimate is None:
        return found
    return {**found, **_estimated(session, estimate, made)}


def _estimated(session: SessionResult, estimate: SessionEstimate, made: SimulatedRun) -> Record:
    """Sigma, error and what was left out; normalised: error of the mean bias over its sigma."""
    truth = true_bins(estimate, made)
    A = mean_rows(estimate)
    error = A @ (estimate.bins.table_deg_h + estimate.mean_deg_h - truth)
    sigma = np.sqrt(np.diag(A @ estimate.covariance @ A.T))
    before = np.sqrt(np.diag(A @ estimate.bins.prior @ A.T))
    found: Record = {
        "sigma_deg_h": sigma.tolist(),
        "sigma_before_deg_h": before.tolist(),
        "normalised": (error / sigma).tolist(),
        "still_s": float(estimate.motion.seconds(STILL)),
        "dropped_s": float(estimate.motion.seconds(DISTURBED)),
        "nis_mean": float(estimate.nis_mean),
        "heading_sigma_rad": float(estimate.sigma_heading_rad),
    }
    if session.points is not None:
        off = A @ (session.points.bias_deg_h - truth)
        size = np.sqrt(np.diag(A @ session.points.covariance @ A.T))
        found["points_sigma_deg_h"] = size.tolist()
        found["points_normalised"] = (off / size).tolist()
    return found


def true_bins(estimate: SessionEstimate, made: SimulatedRun) -> NDArray:
    """True total bias over each bin, in the order of the bins (3N,)."""
    truth = []
    for start_s, end_s in zip(estimate.bins.start_s, estimate.bins.end_s):
        rows = (made.bias_time_s > start_s) & (made.bias_time_s <= end_s)
        truth.append(made.gyro_bias_true_deg_h[rows].mean(axis=0))
    return np.concatenate(truth)


Z_95 = float(norm.ppf(0.975))
USUAL = (1 / 1.5, 1.5)  # strengths that count as the usual one
WRONG_SIGMAS = 4.0  # an accepted axis beyond this is wrong with confidence
BY_KIND = ("environment", "sessions", "accepted", "at the usual strength", "beyond 4 sigma")
BY_GYROS = ("environment", "gyros", "sessions", "accepted", "sigma over calm")
BY_GYROS += ("squared error over variance", "of the points", "dropped s", "CPU s")


def session(index: int, seed: int) -> Record:
    return study_session(draw(index, seed))


def calm_session(technology: str, station: int, seed: int) -> Record:
    return study_session(yardstick(technology, station, seed))


def run(work: Work, *, count: int = 1200, seed: int = 1) -> str:
    places = [(kind, station, seed) for kind in GYRO_TECHNOLOGIES for station in range(STATIONS)]
    calm = {(r["technology"], r["station"]): r for r in work.each(calm_session, places)}
    found = work.each(session, [(index, seed) for index in range(count)])
    by_kind = {kind: [r for r in found if r["environment"] == kind] for kind in KINDS}
    by_gyros = [
        (kind, gyros, [r for r in of if r["technology"] == gyros])
        for kind, of in by_kind.items()
        for gyros in GYRO_TECHNOLOGIES
    ]
    parts = [
        "## In short\n",
        "".join(f"- {line}\n" for line in in_short(found, by_kind)),
        "## By environment\n",
        table(BY_KIND, [_kind_row(kind, of) for kind, of in {**by_kind, "all": found}.items()]),
        "## By environment and technology\n",
        table(BY_GYROS, [_gyros_row(kind, name, of, calm) for kind, name, of in by_gyros if of]),
        "## Why not\n",
        table(
            ("environment", "refused", "inconsistent", "reasons"),
            [_reasons_row(kind, of) for kind, of in by_kind.items()],
        ),
    ]
    return "\n".join(parts)


def in_short(found: Sequence[Record], by_kind: dict[str, list[Record]]) -> list[str]:
    usual = {kind: at_usual_strength(of) for kind, of in by_kind.items()}
    usual = {kind: of for kind, of in usual.items() if of}
    worst = min(usual, key=lambda kind: np.mean([r["outcome"] == "accepted" for r in usual[kind]]))
    ratio = with_half(squared_error(found))
    return [
        f"accepted over the mixed study: {accepted(found)}, wanted at least 95 %",
        f"lowest at its usual strength (0.67 to 1.5): `{worst}`, {accepted(usual[worst])}, wanted"
        " at least 90 %",
        f"squared error over variance of accepted mean biases: {ratio}, wanted 0.9 to 1.1",
        f"accepted with an axis beyond {WRONG_SIGMAS:g} sigma: {_wrong(found)}",
        f"CPU of an update, median: {np.median([r['cpu_s'] for r in found]):.2f} s",
    ]


def wilson(count: int, of: int) -> tuple[float, float]:
    """95 % interval of a share.  Source: Wilson (1927)."""
    p, z2 = count / of, Z_95**2
    centre = (p + z2 / (2 * of)) / (1 + z2 / of)
    spread = np.sqrt(p * (1 - p) / of + z2 / (4 * of**2)) * Z_95 / (1 + z2 / of)
    return max(float(centre - spread), 0.0), min(float(centre + spread), 1.0)


def _share(hits: Sequence[bool]) -> str:
    if not hits:
        return "none run"
    low, high = wilson(sum(hits), len(hits))
    return f"{100 * sum(hits) / len(hits):.0f} % ({100 * low:.0f} to {100 * high:.0f})"


def accepted(records: Sequence[Record]) -> str:
    """How many end in an accepted update."""
    return _share([r["outcome"] == "accepted" for r in records])


def at_usual_strength(records: Sequence[Record]) -> list[Record]:
    """Those whose strength is about 1."""
    low, high = USUAL
    return [r for r in records if low <= r["strength"] <= high]


def squared_error(records: Sequence[Record], key: str = "normalised") -> tuple[float, float]:
    """Mean squared error over variance of the accepted sessions' mean biases, and half its 95 %
    interval over sessions; NaN where there are fewer than two.
    """
    values = [np.mean(np.square(r[key])) for r in _good(records) if key in r]
    if len(values) < 2:
        return float("nan"), float("nan")
    return float(np.mean(values)), float(Z_95 * np.std(values, ddof=1) / np.sqrt(len(values)))


def with_half(pair: tuple[float, float]) -> str:
    value, half = pair
    return f"{value:.2f} +- {half:.2f}" if np.isfinite(value) else ""


def sigma_ratio(records: Sequence[Record], calm: dict[tuple[str, int], Record]) -> str:
    """RMS of the accepted sessions' sigma over that of the calm hour at the same station."""
    pairs = [(r, calm.get((r["technology"], r["station"]), {})) for r in _good(records)]
    ratios = [np.divide(r["sigma_deg_h"], c["sigma_deg_h"]) for r, c in pairs if "sigma_deg_h" in c]
    return f"{np.sqrt(np.mean(np.square(ratios))):.2f}" if ratios else ""


def _good(records: Sequence[Record]) -> list[Record]:
    return [r for r in records if r["outcome"] == "accepted" and "normalised" in r]


def _wrong(records: Sequence[Record]) -> str:
    """Accepted sessions with an axis beyond WRONG_SIGMAS."""
    worst = [float(np.max(np.abs(r["normalised"]))) for r in _good(records)]
    return _share([w > WRONG_SIGMAS for w in worst])


def _kind_row(kind: str, of: Sequence[Record]) -> list[object]:
    return [f"`{kind}`", len(of), accepted(of), accepted(at_usual_strength(of)), _wrong(of)]


def _gyros_row(
    kind: str, gyros: str, of: Sequence[Record], calm: dict[tuple[str, int], Record]
) -> list[object]:
    dropped = [r["dropped_s"] for r in _good(of)]
    return [
        f"`{kind}`",
        gyros,
        len(of),
        accepted(of),
        sigma_ratio(of, calm),
        with_half(squared_error(of)),
        with_half(squared_error(of, "points_normalised")),
        f"{np.mean(dropped):.0f}" if dropped else "",
        f"{np.mean([r['cpu_s'] for r in of]):.2f}",
    ]


def _reasons_row(kind: str, of: Sequence[Record]) -> list[object]:
    bad = [r for r in of if r["outcome"] != "accepted"]
    outcomes = Counter(r["outcome"] for r in bad)
    codes = Counter(code for r in bad for code in r["reasons"])
    named = ", ".join(f"`{code}` {n}" for code, n in codes.most_common())
    return [f"`{kind}`", outcomes["refused"], outcomes["inconsistent"], named]
