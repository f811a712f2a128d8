"""The availability study as a page and a figure, from its records; simulates nothing."""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import norm

from benchmarks.availability_session import KINDS, PARKED_S, REFERENCES, SPREAD
from ins.records import GYRO_TECHNOLOGIES

NAME = "availability_study"
Z_95 = float(norm.ppf(0.975))
USUAL = (1 / 1.5, 1.5)  # strengths that count as the usual one
WRONG_SIGMAS = 4.0  # an accepted axis beyond this is wrong with confidence
COLOURS = {"rlg": "#c81e1e", "fog": "#1b7fbd", "mems": "#2e8b57"}
Record = dict[str, Any]


@dataclass(frozen=True, kw_only=True)
class Share:
    """Sessions of a kind, and how many of them."""

    count: int
    of: int

    def wilson(self) -> tuple[float, float]:
        """95 % interval.  Source: Wilson (1927)."""
        if self.of == 0:
            return 0.0, 1.0
        p, z2 = self.count / self.of, Z_95**2
        centre = (p + z2 / (2 * self.of)) / (1 + z2 / self.of)
        spread = np.sqrt(p * (1 - p) / self.of + z2 / (4 * self.of**2)) * Z_95 / (1 + z2 / self.of)
        return max(float(centre - spread), 0.0), min(float(centre + spread), 1.0)

    def __str__(self) -> str:
        if self.of == 0:
            return "none run"
        low, high = self.wilson()
        return f"{100 * self.count / self.of:.0f} % ({100 * low:.0f} to {100 * high:.0f})"


@dataclass(frozen=True, kw_only=True)
class Study:
    """Records of the sessions, and of those of an older revision."""

    records: Sequence[Record]
    before: Sequence[Record] = ()


def write_page(study: Study, folder: Path) -> None:
    """availability_study.md and .svg in a folder."""
    (folder / f"{NAME}.md").write_text(page(study), encoding="utf-8")
    _draw(study.records, study.before, folder / f"{NAME}.svg")


def page(study: Study) -> str:
    """The study in Markdown."""
    records, before = study.records, study.before
    now, old = sessions_of(records), sessions_of(before)
    parts = [
        _introduction(now, old),
        "## In short\n",
        _short(now, old),
        "## By environment\n",
        _by_environment(now, old),
        "## By environment and technology\n",
        _by_technology(now, records),
        "## Why not\n",
        _reasons(now),
    ]
    return "\n".join([*parts, METHOD])


def sessions_of(records: Sequence[Record]) -> list[Record]:
    """The sessions without their yardsticks."""
    return [r for r in records if r["index"] < REFERENCES]


def accepted(records: Sequence[Record]) -> Share:
    """How many end in an accepted update."""
    return Share(count=sum(r["outcome"] == "accepted" for r in records), of=len(records))


def at_usual_strength(records: Sequence[Record]) -> list[Record]:
    """Those whose strength is about 1."""
    low, high = USUAL
    return [r for r in records if low <= r["strength"] <= high]


def squared_error(records: Sequence[Record], key: str = "normalised") -> tuple[float, float]:
    """Mean squared error over variance of the accepted sessions' mean biases, and half its 95 %
    interval over sessions; NaN where there are fewer than two.
    """
    values = [np.mean(np.square(r[key])) for r in _good(records) if key in r]
    if len(values) < 2:
        return float("nan"), float("nan")
    return float(np.mean(values)), float(Z_95 * np.std(values, ddof=1) / np.sqrt(len(values)))


def sigma_ratio(records: Sequence[Record], all_records: Sequence[Record]) -> float:
    """RMS of the accepted sessions' sigma over that of the calm hour at the same station."""
    calm = {(r["technology"], r["station"]): r for r in all_records if r["index"] >= REFERENCES}
    ratios = []
    for r in _good(records):
        measure = calm.get((r["technology"], r["station"]), {}).get("sigma_deg_h")
        if measure is not None:
            ratios.append(np.divide(r["sigma_deg_h"], measure))
    return float(np.sqrt(np.mean(np.square(ratios)))) if ratios else float("nan")


def _good(records: Sequence[Record]) -> list[Record]:
    return [r for r in records if r["outcome"] == "accepted" and "normalised" in r]


def _wrong(records: Sequence[Record]) -> Share:
    """Accepted sessions with an axis beyond WRONG_SIGMAS."""
    good = _good(records)
    far = sum(float(np.max(np.abs(r["normalised"]))) > WRONG_SIGMAS for r in good)
    return Share(count=far, of=len(good))


def _introduction(now: Sequence[Record], old: Sequence[Record]) -> str:
    revisions = ", ".join(sorted({r["revision"] for r in now}))
    earlier = ", ".join(sorted({r["revision"] for r in old}))
    text = INTRODUCTION.format(
        count=len(now), parked_min=PARKED_S / 60, revisions=revisions, spread=SPREAD
    )
    if old:
        text += BEFORE.format(count=len(old), revisions=earlier)
    return text


def _short(now: Sequence[Record], old: Sequence[Record]) -> str:
    worst = min(KINDS, key=lambda kind: _share_of(at_usual_strength(_of(now, kind))))
    usual = accepted(at_usual_strength(_of(now, worst)))
    ratio, half = squared_error(now)
    lines = [
        f"- accepted over the mixed study: {accepted(now)}, wanted at least 95 %"
        + (f"; before {accepted(old)}" if old else ""),
        f"- lowest at its usual strength (0.67 to 1.5): `{worst}`, {usual}, wanted at least 90 %",
        f"- squared error over variance of accepted mean biases: {ratio:.2f} +- {half:.2f}, wanted"
        " 0.9 to 1.1",
        f"- accepted with an axis beyond {WRONG_SIGMAS:g} sigma: {_wrong(now)}",
        f"- CPU of an update, median: {np.median([r['cpu_s'] for r in now]):.2f} s"
        + (f"; before {np.median([r['cpu_s'] for r in old]):.2f} s" if old else ""),
    ]
    return "\n".join([*lines, ""])


def _share_of(records: Sequence[Record]) -> float:
    share = accepted(records)
    return share.count / share.of if share.of else 1.0


def _of(records: Sequence[Record], kind: str) -> list[Record]:
    return [r for r in records if r["environment"] == kind]


def _by_environment(now: Sequence[Record], old: Sequence[Record]) -> str:
    head = "| environment | sessions | accepted | at the usual strength | before | beyond 4 sigma |"
    rows = [head, "|---|---|---|---|---|---|"]
    for kind in (*KINDS, "all"):
        new, was = (list(r) if kind == "all" else _of(r, kind) for r in (now, old))
        cells = [
            f"`{kind}`" if kind != "all" else "all",
            str(len(new)),
            str(accepted(new)),
            str(accepted(at_usual_strength(new))),
            str(accepted(was)),
            str(_wrong(new)),
        ]
        rows.append("| " + " | ".join(cells) + " |")
    return "\n".join([*rows, ""])


def _by_technology(now: Sequence[Record], records: Sequence[Record]) -> str:
    head = (
        "| environment | gyros | sessions | accepted | sigma over calm | squared error over"
        " variance | of the points | dropped s | CPU s |"
    )
    rows = [head, "|---|---|---|---|---|---|---|---|---|"]
    for kind in KINDS:
        for technology in GYRO_TECHNOLOGIES:
            some = [r for r in _of(now, kind) if r["technology"] == technology]
            if some:
                rows.append(_technology_row(kind, technology, some, records))
    return "\n".join([*rows, ""])


def _technology_row(
    kind: str, technology: str, some: Sequence[Record], records: Sequence[Record]
) -> str:
    dropped = [r["dropped_s"] for r in _good(some)]
    cells = [
        f"`{kind}`",
        technology,
        str(len(some)),
        str(accepted(some)),
        _number(sigma_ratio(some, records)),
        _with_half(squared_error(some)),
        _with_half(squared_error(some, "points_normalised")),
        f"{np.mean(dropped):.0f}" if dropped else "",
        f"{np.mean([r['cpu_s'] for r in some]):.2f}",
    ]
    return "| " + " | ".join(cells) + " |"


def _number(value: float) -> str:
    return f"{value:.2f}" if np.isfinite(value) else ""


def _with_half(pair: tuple[float, float]) -> str:
    value, half = pair
    return f"{value:.2f} +- {half:.2f}" if np.isfinite(value) else ""


def _reasons(now: Sequence[Record]) -> str:
    rows = ["| environment | refused | inconsistent | reasons |", "|---|---|---|---|"]
    for kind in KINDS:
        bad = [r for r in _of(now, kind) if r["outcome"] != "accepted"]
        outcomes = Counter(r["outcome"] for r in bad)
        codes = Counter(code for r in bad for code in r["reasons"])
        named = ", ".join(f"`{code}` {n}" for code, n in codes.most_common())
        rows.append(f"| `{kind}` | {outcomes['refused']} | {outcomes['inconsistent']} | {named} |")
    return "\n".join([*rows, ""])


def _draw(records: Sequence[Record], before: Sequence[Record], path: Path) -> None:
    """Accepted share by environment with its interval, and sigma over calm."""
    import matplotlib
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    now, old = sessions_of(records), sessions_of(before)
    with matplotlib.rc_context({"svg.hashsalt": NAME, "svg.fonttype": "none", "font.size": 9.0}):
        figure = Figure(figsize=(9.5, 4.2), layout="constrained")
        FigureCanvasAgg(figure)
        left, right = figure.subplots(1, 2, sharey=True)
        _shares(left, now, old)
        _bars(right, now, lambda some: sigma_ratio(some, records))
        right.axvline(1.0, color="#7a7a7a", linewidth=0.8)
        right.set_xlabel("sigma over that of the calm hour, accepted sessions")
        figure.savefig(path, metadata={"Date": None})


def _shares(axis: Any, now: Sequence[Record], old: Sequence[Record]) -> None:
    for records, colour, shift, label in (
        (now, "#111111", -0.12, "this revision"),
        (old, "#d08a00", 0.12, "before"),
    ):
        shares = [accepted(_of(records, kind)) for kind in KINDS]
        if not any(share.of for share in shares):
            continue
        middle = np.array([100 * share.count / max(share.of, 1) for share in shares])
        ends = 100 * np.array([share.wilson() for share in shares])
        y = np.arange(len(KINDS)) + shift
        spread = np.abs(np.stack([middle - ends[:, 0], ends[:, 1] - middle]))
        axis.errorbar(middle, y, xerr=spread, fmt="o", color=colour, markersize=4, label=label)
    axis.axvline(90.0, color="#7a7a7a", linewidth=0.8)
    axis.set_yticks(range(len(KINDS)), KINDS)
    axis.invert_yaxis()
    axis.set_xlim(-2, 102)
    axis.set_xlabel("accepted, % (95 % intervals)")
    axis.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2, frameon=False)


def _bars(axis: Any, now: Sequence[Record], value: Callable[[list[Record]], float]) -> None:
    for k, technology in enumerate(GYRO_TECHNOLOGIES):
        some = [r for r in now if r["technology"] == technology]
        x = [value(_of(some, kind)) for kind in KINDS]
        y = np.arange(len(KINDS)) + 0.2 * (k - 1)
        axis.plot(x, y, "s", color=COLOURS[technology], markersize=4, label=technology)
    axis.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3, frameon=False)


INTRODUCTION = """# Does a parked hour end in a table?

Written by `python -m benchmarks.availability --page docs`; figures as measured. {count} sessions at {revisions}.

Each session is {parked_min:.0f} min parked in one of nine [environments](environments.md), then the realistic taxi without satellites or wheels, at 10 Hz, of one aged unit with its factory table: rlg aged
by 0.0072 deg/h, fog by 0.02, mems by 30. Environment and technology are drawn in balanced rounds of 27, the strength from a lognormal about 1 (sigma of its logarithm {spread}), place, heading and thermal
start from twelve stations. The estimator knows the unit's twin and nothing of the environment.

![accepted share and sigma by environment](availability_study.svg)

"""
BEFORE = """*Before* are {count} sessions, the first of the same draws, at {revisions}.

"""
METHOD = """## How to read it

- **accepted**: share of sessions whose update is accepted, with the 95 % interval of Wilson (1927). Not accepted is refused or inconsistent; the reasons are counted by their codes.
- **at the usual strength**: the same of those between 0.67 and 1.5.
- **sigma over calm**: RMS over sessions and gyros of the sigma of the session-mean bias, over that of the same technology and station in `calm`. It is no Cramer-Rao bound: where nothing
  moves the estimator is within 8 % of the bound ([accuracy](accuracy.md)), and an environment can only raise the bound, so the ratio to the bound of that environment is smaller than this one.
- **squared error over variance**: of the session-mean biases (three gyros, with the table) of accepted sessions against the simulated truth; 1 is honest. The interval is over sessions. *Of the points*:
  the same of the session's own points without the table; a gyro that the session does not show has a wide sigma there and draws the mean below 1.
- **dropped s**: parked seconds that the estimator left out, mean over accepted sessions.
- **CPU s**: of the update alone.

Same records, same page: the records (JSON lines) are not kept in the repository; `--count`, `--seed` make them again.
"""
