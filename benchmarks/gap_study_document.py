"""The gap study as a page, a figure and a summary file; computes nothing."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

NAME = "gap_study"
TITLES = {
    "none": "no effect",
    "none5": "no effect, --alpha 0.05",
    "20": "one effect, 20 sigma",
    "12": "one effect, 12 sigma",
    "8": "one effect, 8 sigma",
    "5": "one effect, 5 sigma",
    "cold": "one cold hour, 12 sigma",
    "two": "two effects, 12 sigma each",
    "noise": "declared noise 5 % off",
    "without": "true effect not in the catalogue",
    "pyins": "pyins source, 12 sigma",
    "pyins_none": "pyins source, no effect",
    "forms": "physics in another form, 12 sigma",
    "motion": "one effect on odometer, vehicle or GNSS, 12 sigma",
    "motion_without": "the same, the true effect not in the catalogue",
}
HEAD = """# Blind trials of the diagnosis

Written by `python -m benchmarks.gap_study`; figures as measured, whether they reach their goal or not.

Each trial draws an effect, its target, its parameters and the noise by seed (`benchmarks/gap_trials`, which shares no code
with `simreal`), brings it to its size (norm of the whitened difference of the runs with and without it, within 25 %) and
hands the runs, the twin and its table to `simreal.inference.diagnosis.diagnose`. Four runs of an hour parked and a taxi (cold, ambient,
hot, cooling; four headings) unless said; "pyins" simulates with that program instead of ours. The diagnosis was mended
while trials were run, from earlier trials of other seeds; those below come from the commits named, their seeds not used
before them.

- **right on top**: the most probable cause has the planted name and target; **in the set**: it or one of its rivals does.
- **inseparable effects**: names that these recordings can hardly tell from the planted one, given by the trial.
- **wrong and confident**: a name at over 0.9, and neither it nor a rival is right. Generic answers are no names.
- **honestly unresolved**: a set with none over 0.9, or a verdict that something is left.
- **first place right**: the first entry of `where` is the target's channel; for an effect on the vehicle or the site, a
  channel that holds a fifth of its whitened energy or more. Some effects on one sensor show mostly in another channel (a
  size effect of an accelerometer in the odometer's innovations), so the page also says whether the first place holds a
  fifth of the planted energy, whatever the target.
- **oracle**: how often an answer that knows the noise, the catalogue with its priors, and that there is one effect of this size,
  is right and raises an alarm, on the same rows ([gap_oracle.md](gap_oracle.md)); then the diagnosis on the same trials. Trials with a noise effect
  are not in it, and it answers for one effect only. It weighs effects by the catalogue's priors, while the trials draw them evenly: it can be beaten.
- **true shrink**: the same quotient on the same held-out rows, from the planted difference itself (not for noise).

What the misses come from, as far as looked into: [gap_study_notes.md](gap_study_notes.md).

Intervals are Clopper-Pearson, 95 %. A goal is met or missed where the whole interval lies on one side of it, else open:
with few trials most are.
"""


def write(summary: dict[str, Any], folder: Path) -> None:
    """gap_study.json, .md and .svg in a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    rounded = json.loads(json.dumps(summary), parse_float=lambda text: float(f"{float(text):.4g}"))
    (folder / f"{NAME}.json").write_text(json.dumps(rounded, indent=1) + "\n", encoding="utf-8")
    (folder / f"{NAME}.md").write_text(page(summary), encoding="utf-8")
    draw(summary["answers"], folder / f"{NAME}.svg")


def page(summary: dict[str, Any]) -> str:
    parts = [
        HEAD,
        f"Commits: {', '.join(summary['commits'])}.\n",
        f"![shares and goals]({NAME}.svg)\n",
    ]
    missed = [a for a in summary["answers"] if a["met"] is False]
    parts += [
        "## On the wrong side of the goal\n",
        "".join(f"- {line(a)}\n" for a in missed) or "None.\n",
    ]
    parts += [
        "## All answers\n",
        _answers(summary["answers"]),
        "## Trials\n",
        _counts(summary["cells"]),
    ]
    parts += ["## Calibration\n", _calibration(summary["calibration"])]
    cost = summary["cpu_s"]
    if cost:
        parts.append(
            f"CPU time of a diagnosis: median {cost['median']:.1f} s, at most {cost['most']:.1f}"
            " s.\n"
        )
    if summary["speed"]:
        parts += [
            "## Time and memory of one diagnosis\n",
            f"```\n{summary['speed'].strip()}\n```\n",
        ]
    parts += [
        "## Trials that miss\n",
        "".join(f"- {text}\n" for text in summary["misses"]) or "None.\n",
    ]
    parts += [_earlier(summary["earlier"])] if summary["earlier"] else []
    return "\n".join(parts)


def line(a: dict[str, Any]) -> str:
    """An answer in words."""
    return (
        f"{TITLES[a['cell']]}: {a['words']} {_share(a)}, goal"
        f" {_goal(a)}{'' if a['shown'] else ' (open)'}"
    )


def _share(a: dict[str, Any]) -> str:
    low, high = a["interval_95"]
    return (
        f"{a['k']} of {a['n']} = {100 * a['k'] / a['n']:.1f} % ({100 * low:.0f} to"
        f" {100 * high:.0f})"
    )


def _goal(a: dict[str, Any]) -> str:
    return (
        "-"
        if a["goal"] is None
        else f"{'at most' if a['at_most'] else 'at least'} {100 * a['goal']:.0f} %"
    )


def _status(a: dict[str, Any]) -> str:
    if a["met"] is None:
        return ""
    if a["shown"]:
        return "met" if a["met"] else "**missed**"
    return "open" if a["met"] else "**open, wrong side**"


def _answers(answers: Sequence[dict[str, Any]]) -> str:
    rows = [
        "| trials | question | share (95 %) | oracle; diagnosis on the same | goal | |",
        "|---|---|---|---|---|---|",
    ]
    rows += [
        f"| {TITLES[a['cell']]} | {a['words']} | {_share(a)} | {_ceiling(a)} | {_goal(a)}"
        f" | {_status(a)} |"
        for a in answers
    ]
    return "\n".join(rows) + "\n"


def _ceiling(a: dict[str, Any]) -> str:
    """What the oracle reaches on the same trials, where it judged any."""
    seen = a.get("oracle")
    return "" if seen is None else f"{seen['right']}; {seen['ours']} of {seen['trials']}"


def _counts(cells: dict[str, dict[str, int]]) -> str:
    rows = ["| trials | diagnosed | size out of reach | failed |", "|---|---|---|---|"]
    for name, title in TITLES.items():
        c = cells.get(name, {"diagnosed": 0, "skipped": 0, "failed": 0})
        rows.append(f"| {title} | {c['diagnosed']} | {c['skipped']} | {c['failed']} |")
    return "\n".join(rows) + "\n"


def _calibration(bins: Sequence[dict[str, Any]]) -> str:
    """Over the members of the first set of all one-effect trials; the goal is a difference of 0.1
    at most.
    """
    rows = [
        "| reported probability | answers | mean reported | share right (95 %) | difference |",
        "|---|---|---|---|---|",
    ]
    for b in bins:
        share, (low, high) = b["right"] / b["claims"], b["interval_95"]
        rows.append(
            f"| {b['low']:g} to {b['high']:g} | {b['claims']} | {b['claimed']:.3f} | {share:.3f}"
            f" ({low:.2f} to {high:.2f}) | {share - b['claimed']:+.3f} |"
        )
    return (
        "\n".join(rows)
        + "\n\nGoal: a difference of 0.1 at most; inseparable effects are not counted as right"
        " here.\n"
    )


def _earlier(commits: Sequence[dict[str, Any]]) -> str:
    """What the trials of earlier commits said, which led to changes."""
    rows = [
        "## Earlier commits\n",
        "| commit | trials | question | share (95 %) | goal |",
        "|---|---|---|---|---|",
    ]
    rows += [
        f"| {c['commit']} | {TITLES[a['cell']]} | {a['words']} | {_share(a)} | {_goal(a)} |"
        for c in commits
        for a in c["answers"]
    ]
    return "\n".join(rows) + "\n"


def draw(answers: Sequence[dict[str, Any]], path: Path) -> None:
    """Shares with intervals, and the goals."""
    import matplotlib

    matplotlib.use("Agg")
    matplotlib.rcParams["svg.hashsalt"] = NAME
    from matplotlib.figure import Figure

    shown = [a for a in answers if a["goal"] is not None]
    figure = Figure(figsize=(9, 0.32 * len(shown) + 1.0), layout="constrained")
    axes = figure.add_subplot()
    for y, a in enumerate(shown):
        low, high = a["interval_95"]
        colour = "#1b4f9c" if a["met"] else "#c81e1e"
        axes.plot([100 * low, 100 * high], [y, y], color=colour, lw=1.5)
        axes.plot(100 * a["k"] / a["n"], y, "o", color=colour, ms=5)
        axes.plot(100 * a["goal"], y, "|", color="black", ms=12, mew=2)
    axes.set_yticks(
        range(len(shown)),
        [f"{TITLES[a['cell']]}: {a['words']} ({a['n']})" for a in shown],
        fontsize=7,
    )
    axes.set_ylim(len(shown) - 0.5, -0.5)
    axes.set_xlim(-2, 102)
    axes.set_xlabel("share of the trials [%], 95 % interval; bar: goal; red: wrong side of it")
    axes.grid(axis="x", alpha=0.3)
    figure.savefig(path, metadata={"Date": None})
