"""The recalibration study as a page and a figure; computes nothing.

    python -m benchmarks.recalibration_document docs/recalibration_study.json

draws them again from the figures of a study that was run before.
"""

import json
import sys
from pathlib import Path
from typing import Any

from benchmarks.recalibration_unit import EXACT, HERMITE, KINDS, OLD, OURS, PERFECT

NAME = "recalibration_study"
COLOURS = {
    OLD: "#7a7a7a",
    "overwrite with the session mean": "#d08a00",
    "global cubic": "#b5179e",
    "newest per bin": "#7b5e3b",
    "independent-variance merge": "#1b7fbd",
    EXACT: "#111111",
    OURS: "#c81e1e",
    PERFECT: "#2e8b57",
}
SCENARIOS = {
    "reference": "Reference scenario: no flicker, no random walk of the rate, no turn-on",
    "default": (
        "Default twin: flicker 0.002 deg/h, random walk 0.002 deg/h/sqrt(h), turn-on 0.003 deg/h"
    ),
}


def plain(name: str) -> str:
    """A rule without its kind of points."""
    for kind in KINDS:
        name = name.removesuffix(f", {kind}")
    return name


def write(study: dict[str, Any], folder: Path) -> None:
    """recalibration_study.json, .md and .svg in a folder."""
    (folder / f"{NAME}.json").write_text(json.dumps(study, indent=1) + "\n", encoding="utf-8")
    (folder / f"{NAME}.md").write_text(page(study), encoding="utf-8")
    draw(study, folder / f"{NAME}.svg")


def page(study: dict[str, Any]) -> str:
    """The study in Markdown."""
    first = next(iter(study["scenarios"].values()))
    parts = [
        INTRODUCTION.format(
            units=first["units"], sessions=first["sessions"], revision=study["revision"]
        )
    ]
    for name, scenario in study["scenarios"].items():
        parts += [f"## {SCENARIOS[name]}\n", _targets(scenario), _table(scenario), _hours(scenario)]
    return "\n".join([*parts, METHOD])


def _targets(scenario: dict[str, Any]) -> str:
    rows = ["| requirement R29 | needed | got | |", "|---|---|---|---|"]
    for t in scenario["targets"]:
        rows.append(
            f"| {t['what']} | {t['needed']} | {t['got']:.4g} |"
            f" {'met' if t['met'] else '**missed**'} |"
        )
    return "\n".join(rows) + "\n"


def _table(scenario: dict[str, Any]) -> str:
    count = scenario["sessions"]
    rows = [
        (
            "| rule | points | visited | with the other points | unvisited | worst session | not"
            " worse by 0.001 | by 0.004 | worst increase | e2/sigma2 |"
        ),
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for name in scenario["shown"]:
        rule, error = scenario["rules"][name], scenario["rules"][name]["normalised_squared_error"]
        kind = name.removeprefix(plain(name)).removeprefix(", ")
        others = [
            scenario["rules"][f"{plain(name)}, {k}"]["visited_deg_h"][-1]
            for k in KINDS
            if kind and k != kind
        ]
        kept = [
            f"{100 * rule[key][w]:.1f}"
            for w in ("0.001", "0.004")
            for key in ("not_worse", "gyro_not_worse")
        ]
        cells = [
            _bold(plain(name)),
            kind or "-",
            f"{rule['visited_deg_h'][-1]:.4f}",
            f"{others[0]:.4f}" if others else "-",
            f"{rule['unvisited_deg_h'][-1]:.4f}",
            f"{rule['worst_session_deg_h']:.4f}",
            f"{kept[0]} ({kept[1]}) %",
            f"{kept[2]} ({kept[3]}) %",
            f"{rule['worst_increase_deg_h']:+.4f}",
            "-" if error is None else f"{error:.2f}",
        ]
        rows.append(f"| {' | '.join(cells)} |")
    said = ", ".join(f"{n} {outcome}" for outcome, n in scenario["outcomes"].items())
    return (
        f"Level gyros after {count} sessions, RMS over units in deg/h ({scenario['units'] * count}"
        f" sessions: {said}):\n\n" + "\n".join(rows) + "\n"
    )


def _hours(scenario: dict[str, Any]) -> str:
    profiles = scenario["hours"]
    if not profiles:
        return ""
    columns = (
        "RMS at the end",
        "of which the table",
        "mean over the hour",
        "old / this",
        "this / perfect",
    )
    head = "".join(f" {profile}: {' | '.join(columns)} |" for profile in profiles)
    rows = [f"| table |{head}", "|---|" + "---|" * len(columns) * len(profiles)]
    for name in next(iter(profiles.values())):
        cells = "".join(_hour_cells(hours[name]) for hours in profiles.values())
        rows.append(f"| {_bold(plain(name))} |{cells}")
    return (
        "Free-inertial position error in the hour after a 60 min alignment:\n\n"
        + "\n".join(rows)
        + "\n"
    )


def _hour_cells(hour: dict[str, Any]) -> str:
    metres = (hour["final_rms_m"], hour["table_rms_m"], hour["mean_m"])
    ratios = (hour["gain"], hour["over_perfect"])
    cells = [f"{m:.0f} m" for m in metres] + [
        f"{r['value']:.2f} ({r['low']:.2f}-{r['high']:.2f})" for r in ratios
    ]
    return f" {' | '.join(cells)} |"


def _bold(name: str) -> str:
    return f"**{name}**" if name == OURS else name


def draw(study: dict[str, Any], path: Path) -> None:
    """One row of panels a scenario: visited and unvisited RMS by session, free-inertial error."""
    import matplotlib

    matplotlib.use("agg")
    import matplotlib.pyplot as plt

    scenarios = study["scenarios"]
    with plt.rc_context({"svg.hashsalt": NAME, "svg.fonttype": "none", "font.size": 9.0}):
        figure, axes = plt.subplots(
            len(scenarios),
            3,
            figsize=(12.5, 0.9 + 3.7 * len(scenarios)),
            squeeze=False,
            width_ratios=(1.0, 1.0, 1.15),
        )
        for row, (name, scenario) in zip(axes, scenarios.items()):
            _by_session(
                row[0], scenario, "visited_deg_h", f"{name}: temperatures of the five sessions"
            )
            _by_session(row[1], scenario, "unvisited_deg_h", f"{name}: temperatures never visited")
            _bars(row[2], scenario, f"{name}: free-inertial, after one hour")
        handles, labels = axes[0][0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="lower center", ncol=4, frameon=False)
        figure.tight_layout(rect=(0.0, 0.32 / len(scenarios) / 2.0, 1.0, 1.0))
        figure.savefig(path, metadata={"Date": None} if path.suffix == ".svg" else None)
        plt.close(figure)


def _by_session(axis: Any, scenario: dict[str, Any], key: str, title: str) -> None:
    for name in scenario["shown"]:
        if name == HERMITE:
            continue
        values = [1e3 * v for v in scenario["rules"][name][key]]
        style = (
            {"linestyle": "--", "marker": "o", "markerfacecolor": "none", "markersize": 8.0}
            if name == EXACT
            else {"marker": ".", "linewidth": 2.5 if name == OURS else 1.5}
        )
        axis.plot(
            range(len(values)), values, color=COLOURS[plain(name)], label=plain(name), **style
        )
    axis.set(
        title=title, xlabel="sessions", ylabel="level gyros, RMS error [0.001 deg/h]", yscale="log"
    )
    axis.set_xticks(range(len(values)))
    ticks = [1, 1.5, 2, 3, 5, 7, 10, 15, 20, 30]
    low, high = axis.get_ylim()
    axis.set_yticks(
        [t for t in ticks if low <= t <= high], [f"{t:g}" for t in ticks if low <= t <= high]
    )
    axis.minorticks_off()
    axis.grid(alpha=0.25)


def _bars(axis: Any, scenario: dict[str, Any], title: str) -> None:
    profiles = scenario["hours"]
    names = list(next(iter(profiles.values()), {}))
    for k, (profile, hours) in enumerate(profiles.items()):
        at = [i + 0.4 * (k - 0.5) for i in range(len(names))]
        values = [hours[name]["final_rms_m"] for name in names]
        colours = [COLOURS[plain(name)] for name in names]
        axis.barh(at, values, height=0.36, color=colours, alpha=1.0 if k == 0 else 0.5)
        for y, value in zip(at, values):
            axis.text(value, y, f" {value:.0f} m, {profile}", va="center", fontsize=7.0)
    axis.set(title=title, xlabel="RMS radial position error [m]", yticks=range(len(names)))
    axis.set_yticklabels(
        [
            plain(name)
            .replace(" with the ", "\nwith the ")
            .replace("-variance merge", "-\nvariance merge")
            for name in names
        ],
        fontsize=8.0,
    )
    axis.invert_yaxis()
    axis.margins(x=0.42)


INTRODUCTION = """# Recalibration study: five sessions against what people use today

{units} units whose thermal table has aged by 0.0072 deg/h (1 sigma; common shift 0.006, smooth shape 0.004 over 30
degC), {sessions} sessions each: 70 min parked and a realistic taxi with turns and stops, on random headings (15 deg
apart), thermal starts (cold, ambient, hot, cooling) and latitudes (-45, 0, 30, 45, 60 deg), no GNSS, no odometer, no
surveyed heading. Requirement R29; regenerated by

    python -m benchmarks.recalibration_study --jobs 2

(this page: revision {revision}).

![RMS by session and free-inertial error](recalibration_study.svg)
"""

METHOD = """## How it is measured

*Visited*: both level gyros against the true curve at the gyro temperatures of all the sessions, once a minute.
*Unvisited*: at the whole degrees of the factory table (-10 to 50 degC) that no session came within 2 degC of. *Worst
session*: the largest RMS error, at the temperatures of that session, that any table had right after it. *Not worse*:
share of committed sessions after which the RMS error at the temperatures of that session is not larger than before by
more than so much: of both level gyros together, in brackets of each gyro counted alone; "committed" is every
session but, for recal, those it did not accept. *e2/sigma2*: mean squared error over the stated variance, at visited
temperatures, of the rules that state one (1 is honest).

*Baselines* (`benchmarks/baselines.py`) get the factory table and the points that recal's own filter makes of the
session, which is more than the tools of their kind have: they know nothing of heading. Two kinds of points were tried
for each, and the better one is shown: *measured*, the points of `update.json`, each temperature for itself;
*smoothed*, the same measurement where the departure from the factory table is a constant and a small smooth curve of
the true size of ageing. All but the cubic correct the factory table instead of replacing it.

*Exact Bayesian merge* (`benchmarks/exact_merge.py`): the joint Gaussian posterior of all sessions so far in one
batch, with the prior that the units were drawn from; it commits everything. No merge of these sessions can be
expected to do better. Where recal differs from it, its gates did it: a sound session refused (the list `reasons` in the
JSON), or a heating-cooling term seen where there is none (how often: `docs/rates_thermal.md`).

*Cubic Hermite table*: the same sessions merged by the same code into a table of values and slopes; its factory slopes
are those of the true factory curve, which saves the straight lines' error between nodes 10 degC apart.

*Free-inertial hour* (`benchmarks/free_inertial.py`): a new power-on of each unit (heading, start and latitude random
again), 60 min of alignment with the table in question, then an hour with nothing but a damped height: parked, or a
turn, taxi, take-off, climb and cruise at 180 m/s. *Perfect table*: the true thermal curve; all other errors remain.
*Of which the table*: RMS distance at the end to where the perfect table comes to with the same noise. Intervals in
brackets: 90 %, bootstrap over units. Without noise and from the true start, the flight is navigated to 6 cm.

The north gyro's error drifts in full, 1.22 R b t after an hour; the east gyro's is cancelled by the heading that it
makes the alignment find, as long as heading and temperature stay (`tests/scenarios/test_recalibration.py` checks both,
and the vertical gyro's, against the closed forms). The perfect table's own error limits every ratio of old to new:
parked it is the angle random walk of alignment and navigation, 0.002 deg/h each; in flight also the accelerometers'
turn-on, which the alignment's tilt cancels until the vehicle turns (50 micro-g in the reference scenario, 30 in the
default twin); with the default twin also the gyros' turn-on of 0.003 deg/h, which no table holds.
"""


if __name__ == "__main__":
    source = Path(sys.argv[1])
    write(json.loads(source.read_text(encoding="utf-8")), source.parent)
