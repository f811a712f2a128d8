"""One blind trial of the gap study: drawn, brought to its size, diagnosed without its truth,
written down as a record.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from benchmarks.gap_size import scaled, views_of
from benchmarks.gap_study_oracle import oracle_of
from benchmarks.gap_study_shrink import true_shrink
from benchmarks.gap_trials.other_forms import OTHER_FORMS
from benchmarks.gap_trials.trial import Planted, Trial, draw_noise_trial, draw_trial
from infield.table.file import table_from_dict
from simreal.effects.catalogue import catalogue
from simreal.evidence.whitened import CHANNELS, Evidence
from simreal.inference.causes import Cause
from simreal.inference.diagnosis import DEFAULT_ALPHA, Diagnosis, DiagnosisSettings, diagnose

# effects that show on odometer, side slip and GNSS: free functions of the motion compete with them
MOTION = (
    "odometer_scale",
    "odometer_time_offset",
    "wheel_slip",
    "odometer_boresight",
    "lever_arm",
    "side_slip",
    "gnss_lever_arm_or_latency",
)
FORMS = tuple(effect.name for effect in OTHER_FORMS)
REACHED = 0.25  # a trial whose size is further off the wanted one is not diagnosed
MOST_PLACES = 3


@dataclass(frozen=True, kw_only=True)
class StudyCell:
    """A kind of trial. wanted: size in sigmas, 0 where there is none to set; without: the true
    effect is not in the catalogue; names: the effects it is drawn from, None for all.

    first_seed: added to the study's seeds, so that no two cells share a trial.
    """

    first_seed: int
    wanted: float = 0.0
    effects: int = 1
    plan: str = "four"
    source: str = "trajectories"
    noise_off: float = 0.0
    without: bool = False
    alpha: float = DEFAULT_ALPHA
    names: tuple[str, ...] | None = None


CELLS = {
    "12": StudyCell(first_seed=0, wanted=12.0),
    "none": StudyCell(first_seed=100_000, effects=0),
    "8": StudyCell(first_seed=200_000, wanted=8.0),
    "without": StudyCell(first_seed=300_000, wanted=12.0, without=True),
    "cold": StudyCell(first_seed=400_000, wanted=12.0, plan="one_cold"),
    "two": StudyCell(first_seed=500_000, wanted=12.0, effects=2),
    "noise": StudyCell(first_seed=600_000, noise_off=0.05),
    "5": StudyCell(first_seed=700_000, wanted=5.0),
    "pyins": StudyCell(first_seed=800_000, wanted=12.0, source="pyins"),
    "20": StudyCell(first_seed=900_000, wanted=20.0),
    "none5": StudyCell(first_seed=100_000, effects=0, alpha=0.05),
    "pyins_none": StudyCell(first_seed=800_000, effects=0, source="pyins"),
    "forms": StudyCell(first_seed=1_200_000, wanted=12.0, names=FORMS),
    "motion": StudyCell(first_seed=1_000_000, wanted=12.0, names=MOTION),
    "motion_without": StudyCell(first_seed=1_000_000, wanted=12.0, without=True, names=MOTION),
}
Record = dict[str, Any]


def record_of(
    name: str, seed: int, *, commit: str, diagnosing: Callable[..., Diagnosis] = diagnose
) -> Record:
    """The record of one trial; `skipped` says why where its size was out of reach."""
    cell = CELLS[name]
    trial, reached = _drawn(cell, cell.first_seed + seed)
    record: Record = {
        "cell": name,
        "seed": seed,
        "commit": commit,
        "wanted": cell.wanted,
        "reached": [round(r, 3) for r in reached],
        "alpha": cell.alpha,
        "planted": [_planted(p) for p in trial.truth],
    }
    if cell.wanted and any(abs(r / cell.wanted - 1.0) > REACHED for r in reached):
        return {**record, "skipped": "size out of reach"}
    table = table_from_dict(trial.table, name="trial")
    names = {n for p in trial.truth for n in (p.effect, *p.answers)}
    effects = tuple(e for e in catalogue() if e.name not in names) if cell.without else None
    start, wall = time.process_time(), time.perf_counter()
    settings = DiagnosisSettings(alpha=cell.alpha, seed=seed, effects=effects)
    found = diagnosing(trial.runs, trial.twin, table, settings)
    spent = {
        "cpu_s": round(time.process_time() - start, 2),
        "wall_s": round(time.perf_counter() - wall, 2),
    }
    answers = {**record, **spent, **said(found), **_against_truth(trial, found)}
    if cell.wanted and effects is None and len(reached) == 1:
        answers["oracle"] = oracle_of(trial, reached[0], found.attribution, alpha=cell.alpha)
    return answers


def said(found: Diagnosis) -> Record:
    """What a diagnosis says."""
    return {
        "verdict": found.verdict,
        "sentence": found.sentence,
        "p_value": found.p_value,
        "p_left": found.p_value_after,
        "looks_like": found.looks_like,
        "where": [[p.channel, round(p.share, 4)] for p in found.where[:MOST_PLACES]],
        "causes": [_cause(c) for c in found.causes],
    }


def _planted(p: Planted) -> Record:
    return {
        "effect": p.effect,
        "target": p.target,
        "size": p.size,
        "answers": list(p.answers),
        "targets": list(p.targets),
        "confounded": list(p.confounded),
        "parameters": p.parameters,
    }


def _cause(c: Cause) -> Record:
    rivals = [[r.effect, r.target, round(r.probability, 5)] for r in c.rivals]
    shrink = None if c.shrink is None else [c.shrink.fraction, *c.shrink.interval_95, c.shrink.size]
    return {
        "effect": c.effect,
        "target": c.target,
        "probability": round(c.probability, 6),
        "named": c.named,
        "class": c.class_,
        "run_id": c.run_id,
        "size": round(c.size, 3),
        "rivals": rivals,
        "shrink": shrink,
        "held_out": None if c.shrink is None else c.shrink.how,
    }


def _drawn(cell: StudyCell, seed: int) -> tuple[Trial, list[float]]:
    """The trial, each of its effects at the wanted size by itself, and the sizes reached."""
    if cell.noise_off:
        return draw_noise_trial(seed, plan=cell.plan, off=cell.noise_off, source=cell.source), []
    trial = draw_trial(
        seed, plan=cell.plan, effects=cell.effects, names=cell.names, source=cell.source
    )
    alone = [scaled(replace(trial, truth=(p,)), cell.wanted) for p in trial.truth]
    if len(alone) == 1:
        return alone[0][0], [alone[0][1]]
    return trial.with_sizes([t.truth[0].size for t, _ in alone]), [reached for _, reached in alone]


def _against_truth(trial: Trial, found: Diagnosis) -> Record:
    """Shares of the planted effect's whitened energy by channel, and the true shrink of each cause
    (None: not defined).
    """
    if not trial.truth:
        return {}
    evidence = found.attribution.evidence
    without = Evidence(views_of(trial, trial.runs_without), trial.twin, evidence.extra)
    if without.size != evidence.size:
        return {"energy": {}, "true_shrink": []}
    s = evidence.z - without.z
    return {
        "energy": energy_by_channel(evidence.rows.channel, s),
        "true_shrink": true_shrink(found, s),
    }


def energy_by_channel(channel: Sequence[int], s: Sequence[float]) -> dict[str, float]:
    """Share of |s|^2 by channel name, largest first, above 1 %."""
    total = np.bincount(np.asarray(channel), np.square(s), minlength=len(CHANNELS))
    share = total / max(float(total.sum()), 1e-300)
    return {CHANNELS[k]: round(float(share[k]), 4) for k in np.argsort(-share) if share[k] > 0.01}
