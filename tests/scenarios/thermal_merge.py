"""Rates of what the merge does with odd sessions (R15 to R18), over sessions drawn from real ones
(thermal_sessions).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray

from infield.session.disagreement import find_steps
from infield.session.hysteresis import SessionLikelihood, joint_posterior
from infield.session.joint_update import with_thermal_terms
from infield.session.pipeline import UnitHistory, update_calibration
from infield.session.reasons import SessionReason, ThermalAction, ThermalKind
from infield.session.results import SessionResult
from infield.store.table_store import MergedRun, RunAlreadyMerged, TableStore
from infield.table.file import table_to_dict
from infield.table.merge import SessionPoints, session_covariance
from infield.table.thermal_table import EvenNodes, ThermalTable, default_table, prior_covariance
from ins.records import AXES
from ins.verdicts import Outcome
from tests.infield.point_merge import merge_points
from tests.scenarios.thermal_sessions import (
    SETTINGS,
    TWIN,
    aged_table,
    bins_of,
    draw,
    drawn_session,
    evidence_of,
    take,
    templates,
)

# ARW / sqrt(5 min), the floor of one five-minute point (requirements.md, head)
POINT_DEG_H = 0.0069
STARTS_OF_SPLIT = ("cold", "cooling")  # one session that warms, one that cools
NODE_LIMIT, FAR_LIMIT = 0.5, 0.1  # sigma: R16, R15


@dataclass(frozen=True)
class Count:
    """`hits` of `total` runs."""

    hits: int
    total: int


def _of_start(start: str, rng: np.random.Generator) -> SessionResult:
    """A template that starts so, on a random heading."""
    every = len(templates()) // 4
    return templates()[
        ("cold", "ambient", "hot", "cooling").index(start) * every + int(rng.integers(every))
    ]


def _any(rng: np.random.Generator, count: int) -> list[SessionResult]:
    return [templates()[k] for k in rng.integers(len(templates()), size=count)]


def _biases(
    sessions: Sequence[SessionResult], table: ThermalTable, nodes: NDArray
) -> list[NDArray]:
    return [bins_of(s, table).bins.H @ nodes for s in sessions]


def settled(rng: np.random.Generator, before: int) -> tuple[ThermalTable, NDArray]:
    """A table after so many honest sessions, and the unit's true node errors."""
    table = aged_table()
    nodes = draw(table.covariance, rng)
    chosen = _any(rng, before)
    return take(table, chosen, _biases(chosen, table, nodes), rng)[1], nodes


def far_nodes(runs: int, *, same_mean: bool, lengths: float = 1.0) -> Count:
    """R15: half an hour of data at one temperature against five hours, random tables; nodes more
    than so many lengths away.

    same_mean: the longer data say the same, so that only the weights differ; else their noise
    averages on.
    """
    hits = 0
    for seed in range(runs):
        rng = np.random.default_rng([seed, 15])
        length, sigma = rng.uniform(5.0, 30.0), 10.0 ** rng.uniform(-2.5, -1.7)
        table = default_table(
            imu_serial="S",
            gyro_technology="rlg",
            created_utc="2026-01-01T00:00:00Z",
            span=EvenNodes(spacing_degC=rng.choice([5.0, 10.0])),
        )
        nodes = table.temperature_degC
        P = prior_covariance(
            nodes, (np.full(nodes[0].size, sigma),) * 3, common_fraction=0.0, length_degC=length
        )
        table, at = table.replaced(covariance=P), rng.uniform(-20.0, 50.0)
        axis = int(rng.integers(3))
        truth = float(table.basis(axis, at)[0] @ draw(P, rng))
        own = _own(60)
        noisy = truth + draw(own, rng) + POINT_DEG_H * rng.standard_normal(60)
        y = np.full(60, noisy[:6].mean()) if same_mean else noisy
        ends = [_merged_at(table, axis, at, y[:n], own[:n, :n]) for n in (6, 60)]
        values = table.values_of(axis)
        moved = np.abs(ends[1] - ends[0])[values] / sigma
        hits += bool(np.all(moved[np.abs(nodes[axis] - at) > lengths * length] < FAR_LIMIT))
    return Count(hits, runs)


def _own(count: int) -> NDArray:
    return session_covariance(
        axis_index=np.zeros(count),
        time_s=300.0 * (np.arange(count) + 0.5),
        duration_s=np.full(count, 300.0),
        gyro=TWIN.gyro,
        run_length_s=300.0 * count,
    )


def _merged_at(table: ThermalTable, axis: int, at_degC: float, y: NDArray, own: NDArray) -> NDArray:
    n = y.size
    points = SessionPoints(
        axis_index=np.full(n, axis),
        time_s=300.0 * (np.arange(n) + 0.5),
        duration_s=np.full(n, 300.0),
        temperature_degC=np.full(n, at_degC),
        temperature_rate_degC_min=np.zeros(n),
        bias_deg_h=y,
        covariance=POINT_DEG_H**2 * np.eye(n),
        H=table.basis(axis, np.full(n, at_degC)),
    )
    return merge_points(table, points, own).candidate.parameters


def wrong_session(runs: int, *, before: int, part: str, least_deg_h: float = 0.03) -> Count:
    """R16: runs in which one session wrong by 0.03 to 0.06 deg/h moves no node by more than half a
    sigma.

    part: "whole", "second half" (of the time) or "warm half" (of its temperatures) of the session,
    one random axis.
    """
    hits = 0
    for seed in range(runs):
        rng = np.random.default_rng([seed, 16, before])
        table, nodes = settled(rng, before)
        (template,), axis = _any(rng, 1), int(rng.integers(3))
        data = bins_of(template, table)
        T = data.bins.temperature_degC[:, axis]
        k = np.arange(T.size)
        where = {"whole": k >= 0, "second half": k >= T.size / 2, "warm half": np.median(T) < T}[
            part
        ]
        wrong = np.zeros((T.size, 3))
        wrong[where, axis] = rng.choice([-1.0, 1.0]) * rng.uniform(least_deg_h, 2 * least_deg_h)
        found = drawn_session(template, table, data.bins.H @ nodes + wrong.ravel(), rng, day=20)
        assert found.merged is not None
        moved = np.abs(found.merged.table.parameters - table.parameters) / np.sqrt(
            np.diag(table.covariance)
        )
        hits += bool(np.max(moved) <= NODE_LIMIT)
    return Count(hits, runs)


def step_of_the_unit(runs: int, *, before: int, step_deg_h: float = 0.05) -> tuple[Count, Count]:
    """R16: runs in which a step is named on its axis by the third session; and in which no session
    was merged by then.
    """
    named = kept = 0
    for seed in range(runs):
        rng = np.random.default_rng([seed, 50, before])
        table, nodes = settled(rng, before)
        axis, size = int(rng.integers(3)), rng.choice([-1.0, 1.0]) * step_deg_h
        nodes = nodes.copy()
        nodes[table.values_of(axis)] += size
        chosen = _any(rng, 3)
        sessions, after = take(table, chosen, _biases(chosen, table, nodes), rng, day=20)
        evidence = [evidence_of(s, after) for s in sessions if not s.verdict.accepted]
        steps = find_steps(after, evidence)
        named += any(s.axis == AXES[axis] and abs(s.shift_deg_h - size) < 0.02 for s in steps)
        kept += not any(s.verdict.accepted for s in sessions)
    return Count(named, runs), Count(kept, runs)


def healthy_units(runs: int, *, sessions: int = 5) -> tuple[Count, Count, Count]:
    """Healthy units: those said to have stepped, sessions said to contradict, updates with a
    heating-cooling term.
    """
    stepped = contradicting = terms = 0
    for seed in range(runs):
        rng = np.random.default_rng([seed, 61])
        table = aged_table()
        nodes = draw(table.covariance, rng)
        chosen = _any(rng, sessions)
        found, after = take(table, chosen, _biases(chosen, table, nodes), rng)
        off = [s for s in found if not s.verdict.accepted]
        contradicting += len(off)
        stepped += bool(find_steps(after, [evidence_of(s, after) for s in off]))
        terms += any(t.found for t in with_thermal_terms(found, table, TWIN, SETTINGS)[0])
    return Count(stepped, runs), Count(contradicting, sessions * runs), Count(terms, runs)


@dataclass(frozen=True)
class SplitRates:
    """Named at all; acted upon (fitted or widened); so with the right description; mean squared
    normalised error of the visited nodes of that axis where it was.
    """

    named: Count
    found: Count
    right: Count
    normalised: float


def split(runs: int, *, kind: str, split_deg_h: float = 0.0, sigmas: float = 0.0) -> SplitRates:
    """R17: a warm-up and a cooling session of a unit that reads otherwise while it warms, on one
    random axis.

    split_deg_h: mean difference between the two sessions; or `sigmas` times the sigma of the fitted
    term.
    """
    named = found = right = 0
    kind = ThermalKind(kind)
    normalised = []
    for seed in range(runs):
        rng = np.random.default_rng([seed, 17])
        table, axis = aged_table(), int(rng.integers(3))
        nodes = draw(table.covariance, rng)
        chosen = [_of_start(start, rng) for start in STARTS_OF_SPLIT]
        data = [bins_of(s, table) for s in chosen]
        D = [d.regressor(kind)[:, axis] for d in data]
        if sigmas:
            size = sigmas * _sigma_of(table, data, kind, axis)
        else:
            size = split_deg_h / (D[0][axis::3].mean() - D[1][axis::3].mean())
        truths = [d.bins.H @ nodes + size * column for d, column in zip(data, D)]
        sessions, _ = take(table, chosen, truths, rng)
        terms, _, after = with_thermal_terms(sessions, table, TWIN, SETTINGS)
        term = terms[axis]
        named += term.found or term.action is ThermalAction.SPLIT_OR_WRONG_SESSION
        found, right = found + term.found, right + (term.found and term.kind == kind)
        if after is not None and term.found and term.kind == kind:
            seen = np.any(
                [d.bins.H[:, table.values_of(axis)].max(axis=0) > 0.5 for d in data], axis=0
            )
            e = (after.parameters - nodes)[table.values_of(axis)]
            normalised.append(
                np.mean((e**2 / np.diag(after.covariance)[table.values_of(axis)])[seen])
            )
    mean = float(np.mean(normalised)) if normalised else np.nan
    return SplitRates(Count(named, runs), Count(found, runs), Count(right, runs), mean)


def _sigma_of(
    table: ThermalTable, data: Sequence[SessionLikelihood], kind: str, axis: int
) -> float:
    """Sigma of a fitted term on one axis; it does not depend on what was measured."""
    return float(np.sqrt(joint_posterior(table, data, kind).terms_covariance[axis, axis]))


def same_run_twice(runs: int) -> Count:
    """R18: a run that the stored table holds, given again in a random order among others: refused,
    no bit changes.
    """
    hits = 0
    with (
        TemporaryDirectory() as folder,
        TableStore.open(f"sqlite:///{folder}/recal.db", create=True) as store,
    ):
        revision = store.import_table(table_to_dict(aged_table()))
        rng = np.random.default_rng(18)
        known: list[SessionResult] = []
        for _ in range(runs):
            (template,) = _any(rng, 1)
            run = replace(template.run, sha256=f"{int(rng.integers(2**62)):064x}")
            known.append(replace(template, run=run))
            table = revision.table.replaced(
                parameters=revision.table.parameters
                + 1e-4 * rng.standard_normal(revision.table.n_parameters),
                provenance={
                    "parent_sha256": revision.sha256,
                    "runs": [{"run_id": "r", "sha256": run.sha256}],
                },
            )
            revision = store.commit_update(
                revision.sha256, table, [MergedRun(run_id="r", sha256=run.sha256)], "{}"
            )
            again = [known[k].run for k in rng.permutation(len(known))[:3]]
            result = update_calibration(
                again,
                revision.table,
                TWIN,
                history=UnitHistory(parent_sha256=revision.sha256, already_merged=store.has_run),
            )
            held = [r.values["reason"].code for r in result.reasons]
            refused = result.outcome is Outcome.REFUSED and all(
                code is SessionReason.ALREADY_MERGED for code in held
            )
            same = np.array_equal(result.after.parameters, revision.table.parameters)
            try:
                store.commit_update(
                    revision.sha256,
                    table.replaced(provenance={"parent_sha256": revision.sha256, "runs": []}),
                    [MergedRun(run_id="r", sha256=again[0].sha256)],
                    "{}",
                )
            except RunAlreadyMerged:
                hits += refused and same and store.active().sha256 == revision.sha256
    return Count(hits, runs)
