"""plan.html: the document as one page that fetches nothing. Computes nothing."""

import math
from collections.abc import Sequence

import numpy as np

from infield.reports.drawing import (
    BLUE,
    PALE,
    VERMILLION,
    Boxes,
    Item,
    Line,
    Panel,
    Uprights,
    rows_height,
)
from infield.reports.page import render_page
from simreal.plan.pairs import PairVerdict
from simreal.report.plan_document import EffectSizes, PlanOfRecordings, PlanReport

BADGES = {
    PairVerdict.SEPARATED: "good",
    PairVerdict.SEPARATED_WHEN_LARGE: "fair",
    PairVerdict.NOT_SEPARATED: "bad",
    PairVerdict.NOT_TESTABLE: "none",
}
PLAN_WORDS = {
    PairVerdict.SEPARATED: "separated",
    PairVerdict.SEPARATED_WHEN_LARGE: "only when large",
    PairVerdict.NOT_SEPARATED: "not separated",
    PairVerdict.NOT_TESTABLE: "not testable",
}
TICKS = (0.1, 1.0, 4.0, 10.0, 100.0)
FLOOR_DELTA, ROOF_DELTA = 0.1, 200.0  # of the drawing


def plan_html(document: PlanReport) -> str:
    """The page of a document made by `plan_document`."""
    given = () if document.given is None else (document.given,)
    return render_page(
        "plan.html.j2",
        "simreal.report",
        d=document,
        headline=headline(document),
        banner=_banner(document.recommended),
        badges=BADGES,
        words=PLAN_WORDS,
        plans=[*given, *document.compared],
        seen_text=lambda m: sizes_text([coefficient(c.seen_from, c.unit) for c in m.coefficients]),
        told_text=lambda m: sizes_text([coefficient(c.told_from, c.unit) for c in m.coefficients]),
        usual_text=usual_text,
        sizes=_sizes(document.recommended),
    )


def headline(document: PlanReport) -> str:
    """The plan in one sentence."""
    best = document.recommended
    large = sum(p.verdict is PairVerdict.SEPARATED_WHEN_LARGE for p in best.pairs)
    n, pairs = len(best.recordings), len(best.pairs)
    beside = " beside the given runs" if document.given is not None else ""
    if not n:
        return f"No recording of the list separates more{beside}."
    tail = f", {large} of them only when the effect is large" if large else ""
    many, verb = ("", "separates") if n == 1 else ("s", "separate")
    return (
        f"{n} recording{many}{beside} ({best.hours:g} h) {verb} {best.separated} of {pairs}"
        f" pair{'s' if pairs > 1 else ''}{tail}."
    )


def sizes_text(texts: Sequence[str]) -> str:
    """The sizes of an effect's coefficients; equal ones once."""
    each = " each" if len(texts) > 1 else ""
    return texts[0] + each if len(set(texts)) == 1 else ", ".join(texts)


def usual_text(member: EffectSizes) -> str:
    """The usual ranges of an effect's coefficients; equal ones once."""
    texts = [span(c.usual) for c in member.coefficients]
    return texts[0] if len(set(texts)) == 1 else ", ".join(texts)


def coefficient(value: float | None, unit: str) -> str:
    """A size with its unit, two digits; "never" where there is none."""
    return "never" if value is None or not math.isfinite(value) else f"{two_digits(value)} {unit}"


def two_digits(value: float) -> str:
    """A positive number with two significant digits, plain from 0.0001 to 99999."""
    if not 1e-4 <= value < 1e5:
        return f"{value:.1e}"
    digits = math.floor(math.log10(value))
    return f"{round(value, 1 - digits):.{max(1 - digits, 0)}f}"


def span(usual: Sequence[float]) -> str:
    """A usual range."""
    return f"{two_digits(usual[0])} to {two_digits(usual[1])}"


def _banner(best: PlanOfRecordings) -> str:
    verdicts = {p.verdict for p in best.pairs}
    if verdicts == {PairVerdict.SEPARATED}:
        return "good"
    return "fair" if any(v.separates for v in verdicts) else "none"


def _sizes(best: PlanOfRecordings) -> Panel | None:
    """Usual size of each effect of each pair in the plan, and the size from which it is told from
    its rival.
    """
    rows: list[tuple[EffectSizes, EffectSizes]] = []  # an effect and its rival
    for p in best.pairs:
        if p.a is not None and p.b is not None:
            rows += [(p.a, p.b), (p.b, p.a)]
    if not rows:
        return None
    usual = [np.clip(m.delta_usual, FLOOR_DELTA, ROOF_DELTA).tolist() for m, _ in rows]
    needed = [min(max(m.delta_needed, m.delta_seen), ROOF_DELTA) for m, _ in rows]
    y = np.arange(len(rows), dtype=float)
    ends = np.array([FLOOR_DELTA, ROOF_DELTA])
    between: list[Item] = [Line(ends, np.full(2, k + 0.5), PALE, width=0.6) for k in y[3::4]]
    return Panel(
        label="Usual size of each effect in the plan, and from which on it is told",
        items=[
            *between,
            Boxes(
                [(low, high, k - 0.14, k + 0.14) for k, (low, high) in enumerate(usual)],
                BLUE,
                0.55,
                name="usual size",
            ),
            Uprights(
                np.array(needed),
                y - 0.3,
                y + 0.3,
                VERMILLION,
                width=2.2,
                name="told from its rival from here on",
            ),
        ],
        x_label="size [sigmas of the noise of the whole plan]",
        x_limits=(FLOOR_DELTA, ROOF_DELTA),
        y_limits=(len(rows) - 0.4, -0.6),
        x_log=True,
        x_ticks=[(value, f"{value:g}") for value in TICKS],
        y_ticks=[
            (float(k), f"{m.effect}\n(rival {other.effect})") for k, (m, other) in zip(y, rows)
        ],
        grid_y=False,
        height=rows_height(len(rows), lines=2),
    )
