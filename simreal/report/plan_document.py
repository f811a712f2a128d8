"""plan.json (`recal.plan/1`): a study as plain values. Computes nothing but units and sizes."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from simreal.plan.gram import ODDS_NATS, Contender, Told
from simreal.plan.pairs import INSEPARABLE, Judged
from simreal.plan.recordings import Recording
from simreal.plan.study import NULL_NATS, Plan, Study

SCHEMA = "recal.plan/1"
ALIKE_COS = 0.95  # members of a credible set above this cannot be told apart (effects.md, 3.4)


def plan_document(
    study: Study, *, lat_deg: float, without: Sequence[str], version: str
) -> dict[str, Any]:
    """The document of a study."""
    twin = study.twin
    return {
        "schema": SCHEMA,
        "verdict": "planned",
        "version": version,
        "noise_model": twin.source,
        "imu_serial": twin.imu_serial,
        "gyro_technology": twin.gyro_technology,
        "lat_deg": lat_deg,
        "without": list(without),
        "criteria": {"odds": 0.95, "odds_nats": ODDS_NATS, "alpha": 0.01, "null_nats": NULL_NATS},
        "pairs": [{"label": p.label, "a": _member(p.a), "b": _member(p.b)} for p in study.pairs],
        "given": (
            None if study.given is None else {**_plan(study.given, study), "run_ids": study.run_ids}
        ),
        "compared": [_plan(p, study) for p in study.compared],
        "steps": [_step(p, before) for before, p in zip((study.given, *study.steps), study.steps)],
        "recommended": _plan(study.chosen, study),
        "next": [_step(p, study.given) for p in study.next_best],
        "never": [_never(j) for j in study.reach.judged if j.margin_high < 1.0],
        "inseparable": [{"a": a, "b": b, "why": why} for a, b, why in INSEPARABLE],
    }


def _member(e: Contender) -> dict[str, Any]:
    return {"effect": e.effect.name, "target": e.target}


def _recording(r: Recording) -> dict[str, Any]:
    return {
        "recording": r.name,
        "words": r.words,
        "start": r.start,
        "heading_deg": r.heading_deg,
        "hours": r.hours,
        "taxi": r.taxi,
        "gnss": "gnss" in r.aids,
        "odometer": "odometer" in r.aids,
    }


def _step(plan: Plan, before: Plan | None) -> dict[str, Any]:
    return {
        **_recording(plan.recordings[-1]),
        "score": plan.score,
        "separates": _gained(before, plan),
    }


def _plan(plan: Plan, study: Study) -> dict[str, Any]:
    return {
        "name": plan.name,
        "score": plan.score,
        "hours": plan.hours,
        "recordings": [_recording(r) for r in plan.recordings],
        "pairs": [_judged(j, study) for j in plan.judged],
    }


def _judged(j: Judged, study: Study) -> dict[str, Any]:
    out: dict[str, Any] = {"label": j.pair.label, "verdict": j.verdict, "lacks": j.lacks}
    if not j.both:
        return out
    assert j.a is not None and j.b is not None
    return out | {
        "cos": j.cos,
        "delta_needed": j.delta_needed,
        "cos_typical": j.cos_typical,
        "delta_needed_typical": j.delta_needed_typical,
        "special_case": j.special,
        "a": _sizes(j.pair.a, j.a, study, special=j.special == "a"),
        "b": _sizes(j.pair.b, j.b, study, special=j.special == "b"),
    }


def _sizes(e: Contender, t: Told, study: Study, *, special: bool) -> dict[str, Any]:
    """Size of an effect in the runs, and the coefficients from which it is seen and told from its
    rival.

    special : a special case of its rival; where both fit, the simpler is preferred, so that it is
    told once it is seen.
    """
    seen = study.seen[e.key]
    needed = np.zeros_like(t.delta) if special else t.delta_needed
    told = np.maximum(needed, seen)
    with np.errstate(divide="ignore", invalid="ignore"):
        factors = {
            "seen_from": float(np.median(seen / t.delta)),
            "told_from": float(np.median(told / t.delta)),
        }
    usual = study.usual[e.key]
    return {
        **_member(e),
        "delta_usual": [float(np.median(t.delta_low)), float(np.median(t.delta_high))],
        "delta_seen": seen,
        "delta_needed": float(np.median(needed)),
        "coefficients": [
            {
                "name": c.name,
                "unit": c.unit,
                "usual": [float(u / r), float(u * r)],
                **{name: float(u * factor) for name, factor in factors.items()},
            }
            for c, u, r in zip(e.effect.coefficients, usual, e.reach)
        ],
    }


def _gained(before: Plan | None, after: Plan) -> list[str]:
    """Pairs that the last recording separates, at least where the effect is large."""
    old = [0.0] * len(after.judged) if before is None else [j.margin_high for j in before.judged]
    return [j.pair.label for j, b in zip(after.judged, old) if j.margin_high >= 1.0 > b]


def _never(j: Judged) -> dict[str, str]:
    if j.lacks:
        why = f"needs {j.lacks}"
    elif j.cos > ALIKE_COS:
        why = f"they look the same in all of the recordings together, |cos| {j.cos:.3f}"
    else:
        why = "too small to be seen at their usual size, even in all of the recordings together"
    return {"label": j.pair.label, "why": why}


def summary(document: dict[str, Any]) -> list[str]:
    """The plan in a few lines for people."""
    best, lines = document["recommended"], []
    done = sum(p["verdict"].startswith("separated") for p in best["pairs"])
    if document["given"] is not None:
        already = sum(p["verdict"].startswith("separated") for p in document["given"]["pairs"])
        lines.append(f"the given runs separate {already} of {len(best['pairs'])} pairs")
        if document["next"] and document["steps"]:
            first = document["steps"][0]
            lines.append(f"the one recording that helps most: {first['words']}" + _separates(first))
    n = len(best["recordings"])
    lines.append(
        f"{n} recording{'s' if n > 1 else ''}, {best['hours']:g} h: {done} of {len(best['pairs'])}"
        " pairs separated"
        if best["recordings"]
        else "no recording of the list separates more"
    )
    lines += [f"  {k + 1}. {r['words']}" for k, r in enumerate(best["recordings"])]
    for p in best["pairs"]:
        lines.append("  " + _pair_line(p))
    lines += [
        f"  not with any of these recordings: {n['label']} ({n['why']})" for n in document["never"]
    ]
    return lines


def _separates(step: dict[str, Any]) -> str:
    return f" (separates {', '.join(step['separates'])})" if step["separates"] else ""


def _pair_line(p: dict[str, Any]) -> str:
    """One pair: verdict, |cos|, and from which size each is told."""
    verdict = p["verdict"].replace("_", " ")
    if "cos" not in p:
        return f"{p['label']}: {verdict}, needs {p['lacks']}"
    told = "; ".join(
        f"{m['effect']} from"
        f" {', '.join(f'''{c['told_from']:.2g} {c['unit']}''' for c in m['coefficients'][:1])}"
        for m in (p["a"], p["b"])
    )
    return (
        f"{p['label']}: {verdict}, |cos| {p['cos']:.3f}, told at Delta"
        f" {p['delta_needed_typical']:.1f}: {told}"
    )
