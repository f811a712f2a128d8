"""The accuracy study as a page, a figure and a summary file; computes nothing."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from benchmarks.accuracy_summary import BELOW, GOAL, WORDS

NAME = "accuracy"
AXES = ("north", "east", "down")
FIGURE_LATITUDE_DEG = 45.0
WAY_NAMES = {
    (False, True): "wheels, parked heading",
    (False, False): "wheels",
    (True, True): "wheels, parked heading, GNSS",
    (True, False): "wheels, GNSS",
}
COLOURS = {
    (False, True): "#1b4f9c",
    (False, False): "#7a7a7a",
    (True, True): "#c81e1e",
    (True, False): "#d08a00",
}
SHORT = {WORDS[0]: "o", WORDS[1]: "w", WORDS[2]: "n"}
HEAD = f"""# Accuracy against the Cramer-Rao bound

Written by `python -m benchmarks.accuracy_study`; figures as measured, in 0.001 deg/h unless said.

Each session aligns and parks for 70 min and then does what its row says (physics.md 6.7). The error is that of the
session-mean bias of the gyros along north, east (of the first heading) and down. For each of them the page shows

- **sigma**: what the estimator claims (RMS over the runs);
- **RMS**: its actual error against truth;
- **bound**: the Bayesian Cramer-Rao bound from the simulator's truth model, computed apart from the filter
  (`benchmarks/cramer_rao.py`). No estimator that sees the same can do better on average.

Reference scenario: prior 0.01 deg/h, ARW 0.002 deg/sqrt(h), 10 ug/sqrt(Hz), accelerometers 50 ug, yaw creep 5 arcsec in
70 min, sway 1 mm/s; crab is 1 mrad and side motion 15 mm/s in the rows of 6.7, 0 and 20 mm/s in the realistic taxi. The
estimator is told of neither crab (prior 10 mrad) nor lever arm (prior 5 m). Four ways: with and without GNSS, with and
without the parked-attitude constraint ("held"). Seeds are the same in every cell, so neighbouring cells scatter alike.

The goal is RMS within {GOAL} of the bound where the axis is observable (bound below 0.9 of its prior). A sigma below {BELOW}
of the bound would be a claim that nobody can keep. Bands are 95 %, two-sided chi-square: NEES of the three mean biases,
NIS of all measurements; outside its band a figure is bold. Verdicts of the axes: o observed, w weak, n not observable; the
share of the runs where they differ from what the bound itself calls for is given after them.

What the differences come from: [accuracy_notes.md](accuracy_notes.md).

![sigma, RMS and bound at 45 deg](accuracy.svg)
"""


def write(study: dict[str, Any], folder: Path) -> None:
    """accuracy.json, .md and .svg in a folder."""
    rounded = json.loads(json.dumps(study), parse_float=lambda text: float(f"{float(text):.4g}"))
    cells = ",\n".join(json.dumps(c) for c in rounded["cells"])
    text = f'{{"totals": {json.dumps(rounded["totals"])},\n"cells": [\n{cells}\n]}}\n'
    (folder / f"{NAME}.json").write_text(text, encoding="utf-8")
    (folder / f"{NAME}.md").write_text(page(study), encoding="utf-8")
    draw(study["cells"], folder / f"{NAME}.svg")


def page(study: dict[str, Any]) -> str:
    cells = study["cells"]
    totals = study["totals"]
    parts = [
        HEAD,
        "## In short\n",
        _totals(totals),
        _pooled(totals["pooled"]),
        "## Cells that miss\n",
        _misses(cells),
    ]
    for lat in sorted({c["lat_deg"] for c in cells}):
        parts += [f"## Latitude {lat:g} deg\n", _table([c for c in cells if c["lat_deg"] == lat])]
    return "\n".join(parts)


def _totals(t: dict[str, Any]) -> str:
    rms, sigma, nis = t["rms_over_bound"], t["sigma_over_bound"], t["nis"]
    n = t["observable_axes"]
    lines = [
        f"{t['runs']} sessions estimated in {t['cells']} cells, {t['failed']} failed",
        (
            f"RMS over bound on the {n} observable axes: {_range(rms)}; {t['within_goal']} within"
            f" {GOAL}, {t['goal_within_interval']} with {GOAL} inside or above the 95 % interval of"
            " the RMS"
        ),
        f"sigma over bound on all axes: {_range(sigma)}; {t['overconfident_axes']} below {BELOW}",
        f"NEES inside its band in {t['nees_inside']} cells of {t['cells']}",
        f"NIS inside its band in {t['nis_inside']} cells of {t['cells']}: {_range(nis)}",
        "NIS by kind of measurement: "
        + ", ".join(f"{kind} {nis:.3f}" for kind, (nis, _) in t["nis_by_kind"].items()),
        (
            f"verdicts agree with the bound's own in {100 * t['verdicts_agreed']:.2f} % of the runs"
            " and axes"
        ),
    ]
    return "".join(f"- {line}\n" for line in lines)


def _pooled(lines: Sequence[dict[str, Any]]) -> str:
    """The observable axes of all rows and latitudes together."""
    head = (
        "Over all rows and latitudes, observable axes only:\n\n| seen | axis | cells | RMS / bound"
        " | sigma / bound |\n"
    )
    return (
        head
        + "|---|---|---|---|---|\n"
        + "".join(
            f"| {WAY_NAMES[p['gnss'], p['hold']]} | {AXES[p['axis']]} | {p['cells']} |"
            f" {p['rms_over_bound']:.3f} | {p['sigma_over_bound']:.3f} |\n"
            for p in lines
        )
    )


def _range(spread: dict[str, float]) -> str:
    return (
        f"{spread['least']:.3f} to {spread['largest']:.3f} (RMS {spread['rms']:.3f})"
        if spread
        else "none"
    )


def _misses(cells: Sequence[dict[str, Any]]) -> str:
    """Everything beyond the goal, below the bound or outside a NEES band, by name."""
    lines = []
    for c in cells:
        if "rms_deg_h" not in c:
            lines.append(f"{_label(c)}: no run succeeded")
            continue
        for k, axis in enumerate(AXES):
            bound = c["bound_deg_h"][k]
            low, rms, high = (
                c[key][k] / bound for key in ("rms_low_deg_h", "rms_deg_h", "rms_high_deg_h")
            )
            if rms > GOAL and bound < 0.9 * c["prior_deg_h"][k]:
                lines.append(
                    f"{_label(c)}, {axis}: RMS {rms:.2f} of the bound ({low:.2f} to {high:.2f})"
                )
            if c["sigma_deg_h"][k] < BELOW * bound:
                lines.append(
                    f"{_label(c)}, {axis}: sigma {c['sigma_deg_h'][k] / bound:.3f} of the bound"
                )
        if not c["nees_band"][0] < c["nees"] < c["nees_band"][1]:
            lines.append(
                f"{_label(c)}: NEES {c['nees']:.2f}, band {c['nees_band'][0]:.2f} to"
                f" {c['nees_band'][1]:.2f}"
            )
        if c["failed"]:
            lines.append(f"{_label(c)}: {c['failed']} runs failed, {'; '.join(c['messages'])}")
    return "".join(f"- {line}\n" for line in lines) or "None.\n"


def _label(c: dict[str, Any]) -> str:
    return f"{c['row']}, {c['lat_deg']:g} deg, {WAY_NAMES[c['gnss'], c['hold']]}"


def _table(cells: Sequence[dict[str, Any]]) -> str:
    head = "| row | GNSS | held | runs | " + " | ".join(f"{a}: sigma / RMS / bound" for a in AXES)
    lines = [
        head + " | worst RMS / bound | NEES | NIS | verdicts |",
        "|---|---|---|---|" + "---|" * 7,
    ]
    for c in cells:
        if "rms_deg_h" not in c:
            continue
        mils = [
            " / ".join(
                f"{1e3 * c[key][k]:.2f}" for key in ("sigma_deg_h", "rms_deg_h", "bound_deg_h")
            )
            for k in range(3)
        ]
        seen = [k for k in range(3) if c["bound_deg_h"][k] < 0.9 * c["prior_deg_h"][k]]
        worst = max((c["rms_deg_h"][k] / c["bound_deg_h"][k] for k in seen), default=float("nan"))
        lines.append(
            f"| {c['row']} | {'yes' if c['gnss'] else ''} | {'yes' if c['hold'] else ''} |"
            f" {c['runs']} | {' | '.join(mils)} | {worst:.2f} | {_flag(c, 'nees')} |"
            f" {_flag(c, 'nis')} | {_verdicts(c)} |"
        )
    return "\n".join(lines) + "\n"


def _flag(c: dict[str, Any], name: str) -> str:
    """A mean square, bold outside its band."""
    low, high = c[f"{name}_band"]
    return f"{c[name]:.2f}" if low < c[name] < high else f"**{c[name]:.2f}**"


def _verdicts(c: dict[str, Any]) -> str:
    words = "".join(SHORT[max(v, key=lambda word: v[word])] for v in c["verdicts"])
    runs = c["runs"] - c["failed"]
    off = max(1 - v.get(e, 0) / runs if e else 0.0 for v, e in zip(c["verdicts"], c["expected"]))
    return f"{words} ({100 * off:.0f} % differ)" if off > 0 else words


def draw(cells: Sequence[dict[str, Any]], path: Path) -> None:
    """One panel an axis: bound as a bar, sigma as a ring, RMS with its 95 % interval as a dot; log
    scale.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

    shown = [c for c in cells if c["lat_deg"] == FIGURE_LATITUDE_DEG and "rms_deg_h" in c]
    rows = list(dict.fromkeys(c["row"] for c in shown))
    figure = Figure(figsize=(13.0, 2.0 + 0.52 * max(len(rows), 4)), layout="constrained")
    FigureCanvasAgg(figure)
    panels = figure.subplots(1, 3, sharey=True, sharex=True)
    ways = list(COLOURS)
    for k, panel in enumerate(panels):
        for c in shown:
            way = c["gnss"], c["hold"]
            of_row = [
                w
                for w in ways
                if any((d["row"], d["gnss"], d["hold"]) == (c["row"], *w) for d in shown)
            ]
            y = rows.index(c["row"]) + 0.19 * (of_row.index(way) - 0.5 * (len(of_row) - 1))
            bound, sigma, rms, low, high = (
                1e3 * c[key][k]
                for key in (
                    "bound_deg_h",
                    "sigma_deg_h",
                    "rms_deg_h",
                    "rms_low_deg_h",
                    "rms_high_deg_h",
                )
            )
            panel.plot([low, high], [y, y], color=COLOURS[way], linewidth=1.0)
            panel.plot([rms], [y], "o", color=COLOURS[way], markersize=3.0)
            panel.plot(
                [sigma],
                [y],
                "o",
                color=COLOURS[way],
                markersize=6.5,
                markerfacecolor="none",
                markeredgewidth=0.9,
            )
            panel.plot([bound, bound], [y - 0.09, y + 0.09], color="black", linewidth=2.0)
        _dress(panel, k, rows)
    marks = [
        Line2D(
            [],
            [],
            color="black",
            marker="|",
            linestyle="",
            markersize=9.0,
            markeredgewidth=2.0,
            label="bound",
        ),
        Line2D(
            [],
            [],
            color="black",
            marker="o",
            linestyle="",
            markerfacecolor="none",
            markersize=6.5,
            label="sigma",
        ),
        Line2D(
            [],
            [],
            color="black",
            marker="o",
            markersize=3.0,
            linewidth=1.0,
            label="RMS error, 95 % interval",
        ),
        *(Line2D([], [], color=COLOURS[w], linewidth=4.0, label=WAY_NAMES[w]) for w in ways),
    ]
    figure.legend(handles=marks, loc="outside lower center", ncols=4, frameon=False, fontsize=9)
    figure.savefig(path, metadata={"Date": None})


def _dress(panel: Any, axis: int, rows: Sequence[str]) -> None:
    panel.set_xscale("log")
    panel.set_xticks([1, 2, 3, 5, 10], labels=["1", "2", "3", "5", "10"])
    panel.minorticks_off()
    panel.set_xlabel("0.001 deg/h")
    panel.set_title(
        f"gyro along {AXES[axis]}" + ("" if axis == 2 else " (first heading)"), fontsize=10
    )
    panel.set_yticks(range(len(rows)), labels=rows, fontsize=9)
    panel.set_ylim(len(rows) - 0.5, -0.5)
    panel.grid(axis="x", color="#dddddd", linewidth=0.6)
    for edge in range(1, len(rows)):
        panel.axhline(edge - 0.5, color="#eeeeee", linewidth=0.8)
    panel.set_axisbelow(True)
