"""What issue 4 asks of the gap study, each question with its cell, score and goal, answered over
records.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks import gap_study_scores as scores
from benchmarks.gap_study_scores import Record


@dataclass(frozen=True)
class Question:
    """score: of a record, None where it does not apply. goal: the share wanted, None where none is;
    at_most: its sense.
    """

    cell: str
    words: str
    score: Callable[[Record], bool | None]
    goal: float | None = None
    at_most: bool = False


def _of_size(cell: str, top: float | None, inside: float | None) -> tuple[Question, ...]:
    return (
        Question(cell, "right effect and target on top", scores.on_top, top),
        Question(cell, "in the credible set", scores.in_set, inside),
        Question(
            cell,
            "in the set, inseparable effects counted",
            lambda r: scores.in_set(r, confounded=True),
        ),
        Question(cell, "wrong and confident", scores.wrong_and_confident),
        Question(
            cell,
            "wrong and confident, inseparable effects excused",
            lambda r: scores.wrong_and_confident(r, confounded=True),
        ),
        Question(cell, "first place right", scores.where_right),
        Question(cell, "first place holds a fifth of the effect's energy", scores.where_energy),
        Question(cell, "shrink interval covers the true shrink", scores.covered, 0.90),
    )


def _set_or_unresolved(record: Record) -> bool:
    return scores.in_set(record) or scores.unresolved(record)


QUESTIONS = (
    Question("none", "false alarms at the default level", scores.alarm, 0.02, True),
    Question(
        "none",
        "p-value below 0.05 (the level a user sets)",
        lambda r: r["p_value"] < 0.05,
        0.05,
        True,
    ),
    Question("none5", "false alarms at --alpha 0.05", scores.alarm, 0.05, True),
    *_of_size("20", 0.93, 0.97),
    *_of_size("12", 0.93, 0.97),
    *_of_size("8", 0.85, 0.95),
    *_of_size("5", None, None),
    Question("5", "in the set or honestly unresolved", _set_or_unresolved, 0.85),
    Question("cold", "wrong and confident", scores.wrong_and_confident, 0.03, True),
    Question(
        "cold",
        "wrong and confident, inseparable effects excused",
        lambda r: scores.wrong_and_confident(r, confounded=True),
    ),
    Question("cold", "right effect and target on top", scores.on_top),
    Question("cold", "in the credible set", scores.in_set),
    Question("two", "both named", scores.on_top, 0.85),
    Question("two", "both in their sets", scores.in_set),
    Question("noise", "named as noise of the right channel", scores.as_noise),
    Question("noise", "a drift named", scores.as_drift, 0.0, True),
    Question("without", "another effect's name at over 0.9", scores.named_falsely, 0.10, True),
    Question(
        "without",
        "the same, inseparable effects excused",
        lambda r: scores.named_falsely(r, confounded=True),
    ),
    Question("without", "first place right", scores.where_right, 0.90),
    Question("without", "first place holds a fifth of the effect's energy", scores.where_energy),
    *_of_size("pyins", 0.93, 0.97),
    *_of_size("motion", None, None),
    Question(
        "forms",
        "right effect or a stated neighbour in the set",
        lambda r: scores.in_set(r, confounded=True),
        0.90,
    ),
    Question(
        "forms",
        "wrong and confident, neighbours excused",
        lambda r: scores.wrong_and_confident(r, confounded=True),
        0.03,
        True,
    ),
    Question("motion_without", "another effect's name at over 0.9", scores.named_falsely),
    Question("motion_without", "first place right", scores.where_right),
    Question("pyins_none", "false alarms at the default level", scores.alarm, 0.02, True),
)


def summarise(records: Sequence[Record]) -> dict[str, Any]:
    """Answers, counts, calibration, cost and the trials that miss."""
    whole = [r for r in records if "verdict" in r]
    return {
        "commits": list(dict.fromkeys(r["commit"] for r in records)),
        "cells": counts(records),
        "answers": [a for a in (answer(q, whole) for q in QUESTIONS) if a],
        "calibration": scores.calibration(whole),
        "cpu_s": _spread([r["cpu_s"] for r in whole]),
        "misses": [miss_line(r) for r in records if misses(r)],
    }


def by_commit(records: Sequence[Record]) -> list[dict[str, Any]]:
    """Answers to the questions with a goal, commit by commit, in the order of the records."""
    out = []
    for commit in dict.fromkeys(r["commit"] for r in records):
        whole = [r for r in records if r["commit"] == commit and "verdict" in r]
        answers = [a for q in QUESTIONS if q.goal is not None and (a := answer(q, whole))]
        out.append({"commit": commit, "answers": answers})
    return out


def counts(records: Sequence[Record]) -> dict[str, dict[str, int]]:
    """By cell: diagnosed, skipped (the size was out of reach), failed."""
    out: dict[str, dict[str, int]] = {}
    for record in records:
        cell = out.setdefault(record["cell"], {"diagnosed": 0, "skipped": 0, "failed": 0})
        cell[
            "skipped" if "skipped" in record else "failed" if "failed" in record else "diagnosed"
        ] += 1
    return out


def answer(question: Question, records: Sequence[Record]) -> dict[str, Any] | None:
    """The share and its interval; None where no record has an answer.

    met: the share is on the good side of the goal; shown: the whole interval is on one side of it.
    """
    said = [
        s
        for s in (question.score(r) for r in records if r["cell"] == question.cell)
        if s is not None
    ]
    if not said:
        return None
    k, n = sum(said), len(said)
    low, high = scores.interval(k, n)
    met, shown = None, None
    if question.goal is not None:
        met = k / n <= question.goal if question.at_most else k / n >= question.goal
        shown = not low <= question.goal <= high
    return {
        "cell": question.cell,
        "words": question.words,
        "oracle": _oracle(question, records),
        "k": k,
        "n": n,
        "interval_95": (low, high),
        "goal": question.goal,
        "at_most": question.at_most,
        "met": met,
        "shown": shown,
    }


def _oracle(question: Question, records: Sequence[Record]) -> dict[str, int] | None:
    """On the trials of this question that the oracle judged too: how often it is right, and how
    often the diagnosis is; None where it judged none, or of another question.
    """
    if question.score is not scores.on_top:
        return None
    own = [r for r in records if r["cell"] == question.cell]
    judged = [r for r in own if scores.oracle_on_top(r) is not None]
    if not judged:
        return None
    right = [r for r in judged if scores.oracle_on_top(r)]
    ours = [r for r in judged if scores.on_top(r)]
    return {"right": len(right), "ours": len(ours), "trials": len(judged)}


def misses(record: Record) -> bool:
    """Whether the trial is not as it should be (what to look into)."""
    if "failed" in record:
        return True
    if "verdict" not in record:
        return False
    cell = record["cell"]
    if not record["planted"]:
        return scores.alarm(record)
    if cell == "noise":
        return not scores.as_noise(record)
    if cell == "without":
        return scores.named_falsely(record) or not scores.where_right(record)
    right = scores.on_top(record)
    if cell in ("cold", "5"):
        lost = not right and not scores.in_set(record) and not scores.unresolved(record)
        return lost or scores.wrong_and_confident(record)
    return (
        not right
        or scores.covered(record) is False
        or (len(record["planted"]) == 1 and not scores.where_right(record))
    )


def miss_line(record: Record) -> str:
    """One line: cell, seed and commit, what was planted, what was said."""
    head = f"{record['cell']}:{record['seed']} ({record['commit']})"
    if "failed" in record:
        return f"{head} failed: {record['failed']} ({' '.join(record['at'][-2:])})"
    planted = " + ".join(f"{p['effect']}/{p['target']}" for p in record["planted"]) or "nothing"
    said = "; ".join(_said(c) for c in record["causes"]) or "no cause"
    where = ", ".join(f"{c} {s:.2f}" for c, s in record["where"][:2])
    truth = ", ".join("-" if t is None else f"{t:.2f}" for t in record.get("true_shrink", []))
    parts = [f"{head} planted {planted} -> {record['verdict']}: {said}", f"where {where}"]
    parts += [f"true shrink {truth}"] if truth else []
    if record["looks_like"] or not record["causes"]:
        parts.append(
            f"left looks like {record['looks_like'] or '-'}, p {record['p_value']:.2g}, p left"
            f" {record['p_left']:.2g}"
        )
    return "; ".join(parts)


def _said(cause: Record) -> str:
    rivals = ", ".join(f"{e}/{t} {p:.2f}" for e, t, p in cause["rivals"][:4])
    shrink = cause["shrink"]
    tail = f" shrink {shrink[0]:.2f} [{shrink[1]:.2f}, {shrink[2]:.2f}]" if shrink else ""
    return (
        f"{cause['effect']}/{cause['target']} {cause['probability']:.2f}"
        + (f" (or {rivals})" if rivals else "")
        + tail
    )


def _spread(values: Sequence[float]) -> dict[str, float]:
    if not values:
        return {}
    return {"median": float(np.median(values)), "most": float(np.max(values))}
