"""The update report: one self-contained HTML page drawn from the update document alone; all numbers
come from there.

Written to be read twice: the verdict, its reason and three figures in ten seconds; everything
behind them below, with the items of ISO/IEC 17025:2017, 7.8.2 to 7.8.6 (identification, dates,
conditions, method, results with U(k=2), decision rule and statement of conformity, what is out of
scope).
"""

import shlex
from itertools import count, cycle
from typing import Any

from markupsafe import Markup

from infield.reports import update_figures as figures
from infield.reports import zero_rate_figures
from infield.reports.page import decimals_for, number, render_page
from infield.table.file import table_from_dict
from infield.table.thermal_table import ThermalTable
from ins.records import AXES
from ins.verdicts import Observability, Outcome

VERDICTS = {  # verdict: word, look, symbol
    "committed": ("Committed", "good", "\u2714"),
    "proposed": ("Proposed", "fair", "\u25c6"),
    "refused": ("Refused", "none", "\u25a0"),
    "inconsistent": ("Inconsistent", "bad", "\u2716"),
}
BADGES = {
    "observed": ("observed", "good"),
    "weak": ("weak", "fair"),
    "not_observable": ("not observable", "none"),
}
SOURCES = {
    "turns": "turns in the taxi",
    "stops": "stops on another heading",
    "gnss": "the GNSS track",
    "odometer": "the odometer",
    "survey": "a surveyed heading",
    "combined": "several sources together",
}
OUTCOMES = {
    "accepted": ("merged", "good"),
    "refused": ("left out", "none"),
    "inconsistent": ("inconsistent", "bad"),
}


def update_html(document: dict[str, Any]) -> str:
    """The report of an update (`update.json`, formats.md section 5): committed, proposed, refused
    or inconsistent.
    """
    before, after = _table(document, "table_before"), _table(document, "table_after")
    sessions = [_session(document, k) for k in range(len(document.get("sessions", [])))]
    changes = document.get("changes") or []
    return render_page(
        "update.html.j2",
        d=document,
        verdict=VERDICTS.get(document["verdict"], (str(document["verdict"]), "none", "\u25a0")),
        statement=_statement(document),
        axes=[_axis(document, axis) for axis in AXES],
        decimals=_decimals(document),
        changed=_changed(document),
        bias_drawings=_bias_drawings(document, before, after),
        shape_drawings=_shape_drawings(document, before, after),
        has_points=any(figures.seen_points(document, axis) for axis in AXES),
        run_key=_run_key(document),
        changes={axis: [row for row in changes if row["axis"] == axis] for axis in AXES},
        agreement=(
            figures.agreement_drawing(document)
            if document["consistency"].get("nis_mean") is not None
            else None
        ),
        kinds=sorted({kind for s in sessions for kind in s.get("measurements", {})}),
        sessions=sessions,
        budget=_budget(document),
        noise=_noise(document),
        commands=_commands(document),
        sources=SOURCES,
        outcomes=OUTCOMES,
        nis_words=_nis_words,
        band=_band,
        temperature_words=_temperature_words,
        hysteresis_words=_hysteresis_words,
    )


def _table(document: dict[str, Any], key: str) -> ThermalTable | None:
    return table_from_dict(document[key], name=key) if document.get(key) else None


def _changed(document: dict[str, Any]) -> bool:
    """Does the document hold a table that differs from the stored one (also where it was not
    committed)?
    """
    return bool(document.get("table_after")) and document["table_after"] != document.get(
        "table_before"
    )


def _decimals(document: dict[str, Any]) -> int:
    """Decimals for deg/h that give the smallest uncertainty of the page two digits."""
    sigmas = [seen["sigma_after_deg_h"] for seen in document["observability"].values()]
    return decimals_for(sigmas + [row["U_after_k2_deg_h"] for row in document.get("changes") or []])


def _statement(document: dict[str, Any]) -> dict[str, str]:
    """One sentence of why and one of what to do with it."""
    sessions = document.get("sessions", [])
    merged = sum(s["outcome"] == Outcome.ACCEPTED for s in sessions)
    runs = "The run" if len(sessions) == 1 else f"{merged} of {len(sessions)} runs"
    reasons = document["reasons"] or ["no reason is on record"]
    refused = reasons[0] if len(reasons) == 1 else "Nothing can be merged, for these reasons:"
    contrary = (
        reasons[0] if len(reasons) == 1 else "The data contradict the model or the stored table:"
    )
    partly = ", ".join(
        axis
        for axis, seen in document["observability"].items()
        if seen["verdict"] == Observability.NOT_OBSERVABLE
    )
    limits = f" Gyro {partly}: not observable, it rests on its prior." if partly else ""
    revision = (
        f" as revision {document['revision']}" if document.get("revision") is not None else ""
    )
    return {
        "committed": {
            "why": f"{runs} passed every gate of the decision rule and changed the table.{limits}",
            "use": (
                f"In use: the new table is stored{revision}. The command that takes it back ends"
                " this page."
            ),
        },
        "proposed": {
            "why": f"{runs} passed every gate of the decision rule.{limits}",
            "use": _use_of_proposal(document),
        },
        "refused": {
            "why": refused,
            "use": "Keep using the stored table: nothing was written to it.",
        },
        "inconsistent": {
            "why": contrary,
            "use": (
                "Do not use: the data contradict the model or the stored table. Nothing was"
                " committed."
            ),
        },
    }.get(document["verdict"], {"why": "; ".join(reasons), "use": "Unknown verdict: do not use."})


def _use_of_proposal(document: dict[str, Any]) -> str:
    """What to do with an update that no store holds, or that one keeps for review."""
    if document.get("proposal") is None:
        return (
            "Not in use yet: nothing was stored. Read this page, then run the same command with"
            " --commit."
        )
    return (
        f"Not in use yet: it waits as proposal {document['proposal']} to be approved or rejected."
        " Read this page first."
    )


def _axis(document: dict[str, Any], axis: str) -> dict[str, Any]:
    """What the first card says of one gyro."""
    seen = document["observability"].get(axis)
    rows = [row for row in document.get("changes") or [] if row["axis"] == axis]
    word, look = (
        BADGES.get(seen["verdict"], (str(seen["verdict"]), "none"))
        if seen
        else ("not estimated", "none")
    )
    return {
        "axis": axis,
        "seen": seen,
        "word": word,
        "look": look,
        "help": _help(document, seen),
        "largest": max(rows, key=lambda row: abs(row["change_deg_h"]), default=None),
    }


def _help(document: dict[str, Any], seen: dict[str, Any] | None) -> str:
    """What would make this gyro better known."""
    if document["verdict"] == Outcome.INCONSISTENT:
        return "explain the contradiction first"
    if seen is None:
        return "see the reason above"
    return seen["advice"] or "nothing more needed"


def _bias_drawings(
    document: dict[str, Any], before: ThermalTable | None, after: ThermalTable | None
) -> list[tuple[str, Markup, bool]]:
    """Per gyro: its name, the drawing and whether it shows points."""
    if before is None:
        return []
    run_ids = [s["run_id"] for s in document.get("sessions", [])]
    new = after if _changed(document) else None
    return [
        (
            axis,
            figures.bias_drawing(document, axis, before, new, run_ids),
            bool(figures.seen_points(document, axis)),
        )
        for axis in AXES
    ]


def _shape_drawings(
    document: dict[str, Any], before: ThermalTable | None, after: ThermalTable | None
) -> list[Markup]:
    """Of sessions without a heading: the shapes alone, which the levels of their power-ons would
    hide.
    """
    if before is None or not any("zero_rate" in s for s in document.get("sessions", [])):
        return []
    new = after if _changed(document) else None
    return [
        d
        for d in (zero_rate_figures.shape_drawing(document, axis, before, new) for axis in AXES)
        if d
    ]


def _run_key(document: dict[str, Any]) -> list[tuple[int, str, str]]:
    """Number, id and colour of each run with points; empty where there is one run."""
    run_ids = [s["run_id"] for s in document.get("sessions", [])]
    drawn = {p.get("run_id") for axis in AXES for p in figures.seen_points(document, axis)}
    key = zip(count(1), run_ids, cycle(figures.SESSION_COLOURS))
    return [row for row in key if row[1] in drawn] if len(run_ids) > 1 else []


def _session(document: dict[str, Any], k: int) -> dict[str, Any]:
    """One run of the document with its drawings; excluded spans go to the first run of that id."""
    session = document["sessions"][k]
    first = all(s["run_id"] != session["run_id"] for s in document["sessions"][:k])
    spans = [
        s
        for s in document["excluded"]
        if first and s.get("run_id", session["run_id"]) == session["run_id"]
    ]
    reasons: dict[str, list[float]] = {}
    for span in spans:
        reasons.setdefault(span["reason"], []).append(span["end_s"] - span["start_s"])
    return {
        **session,
        "number": k + 1,
        "spans": spans,
        "span_totals": [
            (reason, len(lengths), sum(lengths)) for reason, lengths in reasons.items()
        ],
        "timeline": figures.timeline_drawing(session, spans),
        "residual_drawings": [(axis, figures.residual_drawing(session, axis)) for axis in AXES],
        "coverage_drawing": figures.coverage_drawing(session),
        "chain_drawings": [
            d for d in (figures.chain_drawing(session, way) for way in ("north", "east")) if d
        ],
    }


def _budget(document: dict[str, Any]) -> list[dict[str, Any]]:
    """Terms in rows, gyros in columns, each with its share of the longest bar."""
    entries = document["uncertainty_budget"]
    longest = max((e["sigma_deg_h"] for e in entries), default=1.0) or 1.0
    rows = []
    for term in dict.fromkeys(e["term"] for e in entries):
        found = {e.get("axis", "x"): e["sigma_deg_h"] for e in entries if e["term"] == term}
        cells = [(found.get(axis), 100.0 * found.get(axis, 0.0) / longest) for axis in AXES]
        rows.append({"term": term, "cells": cells})
    return rows


def _noise(document: dict[str, Any]) -> list[tuple[str, str, str]]:
    """The noise model as rows: group, key with its unit, value."""
    rows = []
    for group, values in (document.get("noise_model") or {}).items():
        for key, value in values.items() if isinstance(values, dict) else ():
            text = (
                ", ".join(f"{v:g}" for v in value)
                if isinstance(value, list | tuple)
                else f"{value:g}"
            )
            rows.append((group, key, text))
    return rows


def _commands(document: dict[str, Any]) -> dict[str, str]:
    """Commands that a reader may copy; texts from files are quoted for the shell."""
    store = f" --store {shlex.quote(document['store'])}" if document.get("store") else ""
    serial = f" --serial {shlex.quote(document['imu_serial'])}"
    commit = " --commit" if document["verdict"] == Outcome.COMMITTED else ""
    used = document.get("thermal_model")
    model = f" --thermal-model {shlex.quote(used['file'])}" if used else ""
    return {
        "rollback": (
            document.get("rollback_command") or f"recal table rollback{store}{serial} --to previous"
        ),
        "history": f"recal table list{store}{serial}",
        "approve": f"recal table approve {document.get('proposal')}{store}{serial} --reason WHY",
        "reproduce": (
            f"recal update RUN{' ...' if len(document['runs']) > 1 else ''}{store}{model}{commit}"
        ),
        "export": f"recal table export{store}{serial} -o table.json",
    }


def _band(band: list[float] | None, decimals: int) -> str:
    return f"{number(band[0], decimals)} to {number(band[1], decimals)}" if band else ""


def _nis_words(consistency: dict[str, Any]) -> str:
    """Where the mean NIS lies, in words."""
    nis, band_95, band_999 = (consistency.get(k) for k in ("nis_mean", "band_95", "band_999"))
    if band_95 and band_95[0] <= nis <= band_95[1]:
        return f"Inside its 95 % band ({_band(band_95, 2)}): the noise model describes the data."
    if band_999 and band_999[0] <= nis <= band_999[1]:
        return f"Outside its 95 % band, inside its 99.9 % band ({_band(band_999, 2)})."
    if band_999 and nis > band_999[1]:
        return (
            f"Above its 99.9 % band ({_band(band_999, 2)}): the data hold more than the noise"
            " model."
        )
    return f"Below its bands (95 %: {_band(band_95, 2)}): quieter than the noise model says."


def _temperature_words(temperature: dict[str, Any]) -> str:
    """Range per gyro, and what is wrong with the thermometers."""
    ranges = zip(temperature["min_degC"], temperature["max_degC"])
    faults = "; ".join(temperature.get("faults") or [])
    return (
        "; ".join(f"{number(low, 1)} to {number(high, 1)}" for low, high in ranges)
        + " \u00b0C"
        + (f"; {faults}" if faults else "")
    )


def _hysteresis_words(terms: list[dict[str, Any]]) -> str:
    """Was a difference between heating and cooling looked for, and what was done about it?"""
    return (
        "; ".join(term["text"] for term in terms) + "."
        if terms
        else "not tested: no run was merged."
    )
