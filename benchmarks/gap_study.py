"""Blind trials of `recal diagnose`: drawn, brought to their size, diagnosed without their truth,
and scored by the questions of issue 4.
"""

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from benchmarks import gap_scores as scores
from benchmarks.gap_shrink import true_shrink
from benchmarks.gap_size import scaled, views_of
from benchmarks.gap_trials.other_forms import OTHER_FORMS
from benchmarks.gap_trials.trial import Planted, Trial, draw_noise_trial, draw_trial
from benchmarks.study import Record, Work, share, table
from infield.table.file import table_from_dict
from ins.errors.catalogue import catalogue
from simreal.evidence.whitened import CHANNELS, Evidence
from simreal.inference.causes import Cause
from simreal.inference.diagnosis import DEFAULT_ALPHA, Diagnosis, DiagnosisSettings, diagnose
from simreal.report.diagnosis_words import verdict_sentence

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
    """A kind of trial. title: what the page calls it; wanted: size in sigmas, 0 where there is none
    to set; without: the true effect is not in the catalogue; names: the effects it is drawn from,
    None for all.

    first_seed: added to the study's seeds, so that no two cells share a trial.
    """

    title: str
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
    "12": StudyCell(title="one effect, 12 sigma", first_seed=0, wanted=12.0),
    "none": StudyCell(title="no effect", first_seed=100_000, effects=0),
    "8": StudyCell(title="one effect, 8 sigma", first_seed=200_000, wanted=8.0),
    "without": StudyCell(
        title="true effect not in the catalogue", first_seed=300_000, wanted=12.0, without=True
    ),
    "cold": StudyCell(
        title="one cold hour, 12 sigma", first_seed=400_000, wanted=12.0, plan="one_cold"
    ),
    "two": StudyCell(
        title="two effects, 12 sigma each", first_seed=500_000, wanted=12.0, effects=2
    ),
    "noise": StudyCell(title="declared noise 5 % off", first_seed=600_000, noise_off=0.05),
    "5": StudyCell(title="one effect, 5 sigma", first_seed=700_000, wanted=5.0),
    "pyins": StudyCell(
        title="pyins source, 12 sigma", first_seed=800_000, wanted=12.0, source="pyins"
    ),
    "20": StudyCell(title="one effect, 20 sigma", first_seed=900_000, wanted=20.0),
    "none5": StudyCell(title="no effect, --alpha 0.05", first_seed=100_000, effects=0, alpha=0.05),
    "pyins_none": StudyCell(
        title="pyins source, no effect", first_seed=800_000, effects=0, source="pyins"
    ),
    "forms": StudyCell(
        title="physics in another form, 12 sigma", first_seed=1_200_000, wanted=12.0, names=FORMS
    ),
    "motion": StudyCell(
        title="one effect on odometer, vehicle or GNSS, 12 sigma",
        first_seed=1_000_000,
        wanted=12.0,
        names=MOTION,
    ),
    "motion_without": StudyCell(
        title="the same, the true effect not in the catalogue",
        first_seed=1_000_000,
        wanted=12.0,
        without=True,
        names=MOTION,
    ),
}


def record_of(name: str, seed: int) -> Record:
    """The record of one trial; `skipped` says why where its size was out of reach."""
    cell = CELLS[name]
    trial, reached = _drawn(cell, cell.first_seed + seed)
    record: Record = {
        "cell": name,
        "seed": seed,
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
    found = diagnose(trial.runs, trial.twin, table, settings)
    spent = {
        "cpu_s": round(time.process_time() - start, 2),
        "wall_s": round(time.perf_counter() - wall, 2),
    }
    return {**record, **spent, **said(found), **_against_truth(trial, found)}


def said(found: Diagnosis) -> Record:
    """What a diagnosis says."""
    return {
        "verdict": found.verdict,
        "sentence": verdict_sentence(found),
        "p_value": found.gap.p_value,
        "p_left": found.gap_after.p_value,
        "looks_like": found.unexplained.looks_like,
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
        "class": c.repeats,
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


def run(
    work: Work, *, seeds: int = 20, first: int = 0, cells: tuple[str, ...] = tuple(CELLS)
) -> str:
    asked = [(cell, seed) for seed in range(first, first + seeds) for cell in cells]
    records = work.each(record_of, asked)
    whole = [r for r in records if "verdict" in r]
    counts = [(CELLS[cell].title, *_counts(cell, records)) for cell in cells]
    bins = [_bin(b) for b in scores.calibration(whole)]
    cpu_s = [r["cpu_s"] for r in whole]
    head = ("reported probability", "answers", "mean reported", "share right (95 %)", "difference")
    parts = [
        "## All answers\n",
        table(ANSWERS, [row for q in scores.QUESTIONS if (row := _answer(q, whole))]),
        "## Trials\n",
        table(("trials", "diagnosed", "size out of reach"), counts),
        "## Calibration\n",
        table(head, bins),
        "CPU time of a diagnosis: median"
        f" {np.median(cpu_s):.1f} s, at most {np.max(cpu_s):.1f} s.\n"
        if cpu_s
        else "",
        "## Trials that miss\n",
        "".join(f"- {miss_line(r)}\n" for r in whole if misses(r)) or "None.\n",
    ]
    return "\n".join(parts)


ANSWERS = ("trials", "question", "share (95 %)", "goal", "")


def _answer(question: scores.Question, records: Sequence[Record]) -> tuple[str, ...] | None:
    """A row of the page; None where no record has an answer."""
    found = scores.answer(question, records)
    if found is None:
        return None
    goal, status = "-", ""
    if question.goal is not None:
        goal = f"{'at most' if question.at_most else 'at least'} {100 * question.goal:.0f} %"
        status = STATUS[found["met"], found["shown"]]
    said = share(found["k"], found["n"])
    return CELLS[question.cell].title, question.words, said, goal, status


# met, and whether the whole interval lies on one side of the goal
STATUS = {
    (True, True): "met",
    (True, False): "open",
    (False, True): "**missed**",
    (False, False): "**open, wrong side**",
}


def _counts(cell: str, records: Sequence[Record]) -> tuple[int, int]:
    own = [r for r in records if r["cell"] == cell]
    skipped = sum("skipped" in r for r in own)
    return len(own) - skipped, skipped


def _bin(b: Record) -> tuple[str, ...]:
    right, (low, high) = b["right"] / b["claims"], b["interval_95"]
    return (
        f"{b['low']:g} to {b['high']:g}",
        f"{b['claims']}",
        f"{b['claimed']:.3f}",
        f"{right:.3f} ({low:.2f} to {high:.2f})",
        f"{right - b['claimed']:+.3f}",
    )


def misses(record: Record) -> bool:
    """Whether the trial is not as it should be (what to look into)."""
    cell = record["cell"]
    if not record["planted"]:
        return scores.alarm(record)
    if cell == "noise":
        return not scores.as_noise(record)
    if cell == "without":
        return scores.named_falsely(record) or not scores.where_right(record)
    right = scores.on_top(record)
    if cell in ("cold", "5"):
        lost = not right and not scores.set_or_unresolved(record)
        return lost or scores.wrong_and_confident(record)
    elsewhere = len(record["planted"]) == 1 and not scores.where_right(record)
    return not right or scores.covered(record) is False or elsewhere


def miss_line(record: Record) -> str:
    """One line: cell and seed, what was planted, what was said and where."""
    planted = " + ".join(f"{p['effect']}/{p['target']}" for p in record["planted"]) or "nothing"
    causes = [f"{c['effect']}/{c['target']} {c['probability']:.2f}" for c in record["causes"]]
    where = ", ".join(f"{c} {s:.2f}" for c, s in record["where"][:2])
    return (
        f"{record['cell']}:{record['seed']} planted {planted} -> {record['verdict']}:"
        f" {'; '.join(causes) or 'no cause'}; where {where}; p {record['p_value']:.2g}"
    )
