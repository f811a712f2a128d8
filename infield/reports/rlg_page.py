"""thermal_rlg.html: the gradient document as one page that fetches nothing. Draws; computes no
figure of its own.
"""

import numpy as np

from infield.reports.documents.rlg import RlgDocument
from infield.reports.drawing import (
    BLACK,
    DASH_DOT,
    DASHED,
    DOT,
    DOTTED,
    GREY,
    NEW,
    OLD,
    ORANGE,
    Line,
    Marks,
    Panel,
)
from infield.reports.fog_page import before_and_after
from infield.reports.page import render_page
from infield.thermal.ramp_runs import GradientRun
from infield.thermal.reasons import ThermalVerdict
from infield.thermal.rlg.fit import AxisModel, five_minute_means
from infield.thermal.rlg.gradients import RlgHeldOut
from infield.thermal.rlg.terms import TERMS, columns
from ins.documents import plain
from ins.records import AXES

RATES = np.array([name in ("K4", "K5") for name in TERMS])
SETTLED = np.array([name in ("K1", "K2", "K3") for name in TERMS])


def render(document: RlgDocument) -> str:
    """The page of thermal_rlg.json, with the means of its runs."""
    study = document.study
    return render_page(
        "rlg_gradient.html.j2",
        d=plain(document),
        good=document.verdict is ThermalVerdict.FITTED,
        terms=TERMS,
        fits={
            a.axis: [fit_panels(a, run, study.reference_degC) for run in study.runs]
            for a in study.axes
        },
        orders={a.axis: order_panel(a) for a in study.axes},
        checks=[(found.run.blocks.run_id, _check_panels(found)) for found in document.check],
    )


def fit_panels(a: AxisModel, run: GradientRun, reference_degC: float) -> list[Panel]:
    """One gyro over one run: five-minute means less their mean with the fit, and what each kind of
    term gives to it.
    """
    k, b = AXES.index(a.axis), run.blocks
    rows = np.flatnonzero(run.usable)
    X = columns(
        b.temperature_degC[rows, k],
        b.rate_degC_min[rows, k],
        run.gradient_degC[rows],
        reference_degC,
        a.nodes_degC,
    )
    n = len(TERMS)
    kinds = [
        X[:, :n][:, SETTLED] @ a.theta[:n][SETTLED] + X[:, n:] @ a.theta[n:],
        X[:, :n][:, RATES] @ a.theta[:n][RATES],
    ]
    kinds.append(X @ a.theta - sum(kinds))
    values = np.column_stack([b.bias_deg_h[rows, k], X @ a.theta, X @ a.temperature_only, *kinds])
    means, time_s, _ = five_minute_means(b.time_s[rows], values)
    t, means = time_s / 60.0, means - means.mean(axis=0)
    parts = (("temperature", BLACK, ""), ("rate", ORANGE, DASHED), ("gradients", NEW, DASH_DOT))
    left = Panel(
        items=[
            Marks(t, means[:, 0], DOT, GREY, "measured", size=2.8),
            Line(t, means[:, 2], OLD, "temperature alone", width=1.1, dash=DASHED),
            Line(t, means[:, 1], NEW, "model"),
        ],
        title=f"gyro {a.axis}, run {b.run_id}",
        x_label="time [min]",
        y_label="bias less its mean [deg/h]",
        group=f"{a.axis} {b.run_id}",
    )
    right = Panel(
        items=[
            Line(t, means[:, column], colour, name, dash=dash)
            for column, (name, colour, dash) in enumerate(parts, start=3)
        ],
        title="what each kind of term gives",
        x_label="time [min]",
        y_label="[deg/h]",
        group=f"{a.axis} {b.run_id}",
    )
    return [left, right]


def order_panel(a: AxisModel) -> Panel:
    """Held-out chi2 a row over the number of terms; the chosen order marked."""
    sizes = np.array([len(c.terms) for c in a.orders], dtype=float)
    chi2 = np.array([c.held_out_chi2 for c in a.orders])
    chosen = np.array([float(len(a.used))]), np.array([a.choice.held_out_chi2])
    return Panel(
        items=[
            Line(sizes, chi2, GREY),
            Marks(sizes, chi2, "o", GREY, "tried"),
            Marks(*chosen, "o", NEW, "chosen: " + " ".join(a.used), size=8.0),
        ],
        label=f"Held-out misfit of gyro {a.axis} over the number of terms",
        x_label="terms",
        y_label="held-out chi2 a row",
        x_ticks=[(size, f"{size:g}") for size in sizes.tolist()],
        y_log=True,
    )


def _check_panels(found: RlgHeldOut) -> list[Panel]:
    """Five-minute means of a held-out run before and after, each less its mean."""
    drawn: dict[str, list[Line | Marks]] = {}
    for axis, (time_s, values) in found.means.items():
        t = time_s / 60.0
        drawn[axis] = [
            Marks(t, values[:, 0], DOT, GREY, "uncompensated", size=2.6),
            Line(t, values[:, 1], OLD, "temperature alone", width=1.2, dash=DASHED),
            Line(t, values[:, 2], NEW, "model", width=1.2),
            Line(t, values[:, 3], BLACK, "real time", width=1.2, dash=DOTTED),
        ]
    return before_and_after(drawn, found.run.blocks.run_id)
