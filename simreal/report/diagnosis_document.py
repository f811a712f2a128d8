"""diagnosis.json (`recal.diagnosis/1`, formats.md section 5): a diagnosis as plain values. Computes
nothing but units.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from ins.records import Run, TwinModel
from ins.units import DEG_PER_HOUR, MICRO_G
from simreal.declared.twin_effects import SLOW
from simreal.effects.base import GYROS, Effect
from simreal.effects.catalogue import catalogue
from simreal.inference.causes import Cause, Rival
from simreal.inference.diagnosis import Diagnosis, Place
from simreal.inference.user_level import UserLevel
from simreal.twin.write_back import effect_items, processes_of

SCHEMA = "recal.diagnosis/1"
REFUSED = "refused"


def diagnosis_document(
    diagnosis: Diagnosis,
    runs: Sequence[Run],
    *,
    version: str,
    seed: int,
    table_sha256: str = "",
    hold_out: Sequence[str] = (),
    users: Sequence[UserLevel] = (),
    record_next: Sequence[str] = (),
    notes: Sequence[str] = (),
) -> dict[str, Any]:
    """The document of a diagnosis of these runs; `table_sha256` empty: the twin has no table;
    `notes` beside its own.
    """
    run_ids = [v.name for v in diagnosis.views]
    return {
        **_head(diagnosis.verdict, diagnosis.sentence, (), diagnosis.twin, version),
        "gap": {"score": diagnosis.score, "floor": diagnosis.floor, "p_value": diagnosis.p_value},
        "where": [_place(p) for p in diagnosis.where],
        "causes": [_cause(c, bars, run_ids) for c, bars in zip(diagnosis.causes, diagnosis.bars)],
        "unexplained": {
            "present": diagnosis.left_present,
            "p_value": diagnosis.p_value_after,
            "share": diagnosis.left_share,
            "looks_like": diagnosis.looks_like,
        },
        "not_testable": [
            {"effect": name, "needs": needs, **({"target": target} if target else {})}
            for name, needs, target in diagnosis.not_testable
        ],
        "gap_after": {"score": diagnosis.score_after, "p_value": diagnosis.p_value_after},
        "user_level": [_user(u) for u in users],
        "record_next": list(record_next),
        "cells": _cells(diagnosis),
        "runs": [_run(run, diagnosis, hold_out) for run in runs],
        "not_looked_at": [{"run_id": name, "why": why} for name, why in diagnosis.unused],
        "notes": [*notes, *diagnosis.notes, *_table_note(table_sha256)],
        "alpha": diagnosis.alpha,
        "threshold_nats": diagnosis.threshold,
        "replicates": diagnosis.replicates,
        "seed": seed,
        "table_sha256": table_sha256 or None,
    }


def refused_document(
    reasons: Sequence[tuple[str, str]],
    runs: Sequence[Run],
    twin: TwinModel,
    *,
    version: str,
    alpha: float,
    seed: int,
) -> dict[str, Any]:
    """The document where no run can be looked at: reasons by run id, no gap stated and none
    denied.
    """
    said = [f"run {name}: {why}" for name, why in reasons]
    nothing = {"score": None, "p_value": None}
    return {
        **_head(REFUSED, "No run can be looked at: " + "; ".join(said) + ".", said, twin, version),
        "gap": {"score": None, "floor": None, "p_value": None},
        "where": [],
        "causes": [],
        "unexplained": {"present": None, "p_value": None, "share": None, "looks_like": ""},
        "not_testable": [
            {"effect": name, "needs": "a parked stretch"}
            for name in sorted({e.name for e in catalogue()})
        ],
        "gap_after": nothing,
        "user_level": [],
        "record_next": ["Park for 5 minutes or more after power-on, then repeat."],
        "cells": [],
        "runs": [{"run_id": r.header.run_id, "sha256": r.sha256, "used": False} for r in runs],
        "not_looked_at": [{"run_id": name, "why": why} for name, why in reasons],
        "notes": [],
        "alpha": alpha,
        "threshold_nats": None,
        "replicates": 0,
        "seed": seed,
        "table_sha256": None,
    }


def summary(document: dict[str, Any]) -> list[str]:
    """The result in a few lines for people."""
    lines = [f"{document['imu_serial'] or document['gyro_technology']}: {document['sentence']}"]
    if document["verdict"] == REFUSED:
        return lines
    gap, after = document["gap"], document["gap_after"]
    lines.append(
        f"  gap score {gap['score']:.2f} (floor {gap['floor']:.2f}, p {p_text(gap['p_value'])}),"
        f" with what was found {after['score']:.2f} (p {p_text(after['p_value'])})"
    )
    for cause in document["causes"]:
        lines += _cause_lines(cause)
    lines += [f"  navigation, run {u['run_id']}: {_user_line(u)}" for u in document["user_level"]]
    lines += [f"  run {r['run_id']} not looked at: {r['why']}" for r in document["not_looked_at"]]
    lines += [f"  {note}" for note in document["notes"]]
    lines += [f"  record next: {text}" for text in document["record_next"]]
    return lines


def _head(
    verdict: str, sentence: str, reasons: Sequence[str], twin: TwinModel, version: str
) -> dict[str, Any]:
    return {
        "schema": SCHEMA,
        "verdict": verdict,
        "sentence": sentence,
        "reasons": list(reasons),
        "imu_serial": twin.imu_serial,
        "gyro_technology": twin.gyro_technology,
        "twin": twin.source,
        "version": version,
    }


def _table_note(table_sha256: str) -> tuple[str, ...]:
    return () if table_sha256 else ("the twin has no table: the whole thermal bias counts as gap",)


def _place(p: Place) -> dict[str, Any]:
    return {
        "channel": p.channel,
        "phase": p.phase,
        "temperature_degC": None if p.temperature_degC is None else list(p.temperature_degC),
        "frequency_hz": list(p.frequency_hz),
        "time_s": list(p.time_s),
        "share": p.share,
    }


def _cause(
    c: Cause, bars: Sequence[tuple[str, str, float]], run_ids: Sequence[str]
) -> dict[str, Any]:
    s = c.shrink
    return {
        "effect": c.effect,
        "target": c.target,
        "probability": min(c.probability, 1.0),
        "confounded_with": _confounded(c),
        "parameters": _parameters(c),
        "shrink": (
            None
            if s is None
            else {
                "fraction": s.fraction,
                "interval_95": list(s.interval_95),
                "held_out": s.held_out,
                "how": s.how,
                "size": s.size,
                "too_small": s.too_small,
            }
        ),
        "id": c.id,
        "named": c.named,
        "resolved": c.resolved,
        "repeats": c.class_,
        "run_id": c.run_id,
        "size": c.size,
        "rivals": [_rival(r) for r in c.rivals],
        "posterior": [
            {"effect": name, "target": target, "probability": p} for name, target, p in bars
        ],
        "rms": {channel: _rms(channel, v) for channel, v in c.rms.items()},
        "nodes": list(c.nodes),
        "values": list(c.values),
        "twin_effects": effect_items(c, run_ids),
    }


def _confounded(c: Cause) -> list[str]:
    """Names of the rivals; of a slow variation the processes first."""
    return list(
        dict.fromkeys([*processes_of(c), *(r.effect for r in c.rivals if r.effect != c.effect)])
    )


def _rival(r: Rival) -> dict[str, Any]:
    cosine = r.cosine if np.isfinite(r.cosine) else None
    return {"effect": r.effect, "target": r.target, "probability": r.probability, "cosine": cosine}


def _rms(channel: str, value: float) -> dict[str, Any]:
    return (
        {"value": value / DEG_PER_HOUR, "unit": "deg/h"}
        if channel in GYROS
        else {"value": value / MICRO_G, "unit": "ug"}
    )


def _parameters(c: Cause) -> dict[str, Any]:
    effect = next((e for e in catalogue() if e.id == c.id), None)
    shapes = () if effect is None else [p.name for p in effect.shape]
    out = {}
    for name, p in c.parameters.items():
        sigma = p.sigma if np.isfinite(p.sigma) else _bound_sigma(effect, name)
        out[name] = {
            "value": p.value,
            "sigma": sigma,
            "unit": p.unit,
            "usual": None if p.usual is None else list(p.usual),
            "unusual": p.unusual,
            "sigma_from": "fit" if np.isfinite(p.sigma) else None if sigma is None else "bounds",
            "below_declared": c.class_ == "S" and p.value < 0 and name not in shapes,
        }
    return out


def _bound_sigma(effect: Effect | None, name: str) -> float | None:
    """Of a shape parameter that the fit does not narrow: the sigma of anything between its bounds;
    None: no bounds.
    """
    shape = next((p for p in effect.shape if p.name == name), None) if effect is not None else None
    return None if shape is None else float((shape.high - shape.low) / np.sqrt(12.0))


def _user(u: UserLevel) -> dict[str, Any]:
    with_, without = (
        dict(zip(("rate_nm_h", "speed_m_s"), pair)) for pair in zip(u.rate_nm_h, u.speed_m_s)
    )
    return {
        "run_id": u.run_id,
        "align_s": u.align_s,
        "navigated_s": u.navigated_s,
        "heading_change_arcmin": u.heading_change_arcmin,
        "with": with_,
        "without": without,
    }


def _cells(diagnosis: Diagnosis) -> list[dict[str, Any]]:
    before, after = diagnosis.cells, diagnosis.cells_after
    located, located_after = before.located, after.located
    return [
        {
            "channel": cell.channel,
            "moving": cell.moving,
            "frequency_hz": [
                cell.frequency_hz[0],
                cell.frequency_hz[1] if np.isfinite(cell.frequency_hz[1]) else None,
            ],
            "dof": float(before.dof[k]),
            "rho": float(before.rho[k]),
            "nats": float(before.nats[k]),
            "located": bool(located[k]),
            "rho_after": float(after.rho[k]),
            "nats_after": float(after.nats[k]),
            "located_after": bool(located_after[k]),
        }
        for k, cell in enumerate(before.cells)
    ]


def _run(run: Run, diagnosis: Diagnosis, hold_out: Sequence[str]) -> dict[str, Any]:
    header = run.header
    said: dict[str, Any] = {
        "run_id": header.run_id,
        "sha256": run.sha256,
        "start_utc": header.start_utc,
        "used": False,
    }
    view = next((v for v in diagnosis.views if v.name == header.run_id), None)
    if view is None:
        return said
    moves = view.history is not None
    return {
        **said,
        "used": True,
        "parked_s": [view.start_s, view.end_s],
        "moves": moves,
        "held_out": header.run_id in hold_out,
    }


def p_text(value: float) -> str:
    """A p-value in two digits."""
    return f"{value:.2g}" if value > 1e-300 else "under 1e-300"


def _cause_lines(cause: dict[str, Any]) -> list[str]:
    at = f", run {cause['run_id']}" if cause["run_id"] else ""
    lines = [
        f"  {cause['effect']} on {cause['target']}{at}: probability {cause['probability']:.2f},"
        f" {cause['size']:.0f} sigma"
    ]
    for name, p in list(cause["parameters"].items())[:4]:
        sigma = "" if p["sigma"] is None else f" +- {p['sigma']:.2g}"
        lines.append(
            f"    {name} {p['value']:.4g}{sigma} {p['unit']}"
            + (
                " (implausibly large)"
                if p["unusual"]
                else " (less than declared)"
                if p["below_declared"]
                else ""
            )
        )
    if cause["confounded_with"]:
        words = (
            "as a process"
            if cause["effect"] == SLOW
            else "nearly the same"
            if cause["resolved"]
            else "may also be"
        )
        lines.append(f"    {words}: {', '.join(cause['confounded_with'])}")
    if s := cause["shrink"]:
        low, high = s["interval_95"]
        small = "; too small there to quantify" if s["too_small"] else ""
        lines.append(
            f"    shrinks the gap by {100 * s['fraction']:.0f} % ({100 * low:.0f} to"
            f" {100 * high:.0f} %), {s['how']}{small}"
        )
    return lines


def _user_line(u: dict[str, Any]) -> str:
    a, b = u["with"], u["without"]
    return (
        f"{a['rate_nm_h']:.2f} -> {b['rate_nm_h']:.2f} NM/h, {a['speed_m_s']:.2f} ->"
        f" {b['speed_m_s']:.2f} m/s after {u['navigated_s'] / 60:.0f} min, alignment"
        f" {u['heading_change_arcmin']:+.2f} arcmin"
    )
