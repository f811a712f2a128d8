"""thermal_rlg.html: the gradient document as one page that fetches nothing. Draws; computes no
figure of its own.
"""

import numpy as np
from markupsafe import Markup

from infield.reports.documents.rlg import RlgDocument
from infield.reports.figures import (
    BLACK,
    GREY,
    NEW,
    OLD,
    ORANGE,
    axis_text,
    in_style,
    new_figure,
    svg_text,
)
from infield.reports.page import render_page
from infield.thermal.gradient_runs import GradientRun
from infield.thermal.reasons import ThermalVerdict
from infield.thermal.rlg.fit import AxisModel, five_minute_means
from infield.thermal.rlg.held_out import RlgHeldOut
from infield.thermal.rlg.terms import TERMS, columns
from ins.records import AXES
from ins.verdicts import plain

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
        drawings={
            a.axis: [
                (run.blocks.run_id, fit_drawing(a, run, study.reference_degC)) for run in study.runs
            ]
            for a in study.axes
        },
        orders={a.axis: order_drawing(a) for a in study.axes},
        checks=[(found.run.blocks.run_id, _check_drawing(found)) for found in document.held_out],
    )


@in_style
def fit_drawing(a: AxisModel, run: GradientRun, reference_degC: float) -> Markup:
    """One gyro over one run: five-minute means less their mean with the fit, and what each kind of
    term gives to it.
    """
    figure, axes = new_figure(1, 2, height=2.9)
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
    left, right = axes[0]
    left.plot(t, means[:, 0], ".", color=GREY, markersize=3.5, label="measured")
    left.plot(t, means[:, 2], color=OLD, linestyle="--", linewidth=1.1, label="temperature alone")
    left.plot(t, means[:, 1], color=NEW, label="model")
    for column, (name, colour, line) in enumerate(
        (("temperature", BLACK, "-"), ("rate", ORANGE, "--"), ("gradients", NEW, "-.")), start=3
    ):
        right.plot(t, means[:, column], color=colour, linestyle=line, label=name)
    axis_text(
        left, title=f"gyro {a.axis}, run {b.run_id}", x="time [min]", y="bias less its mean [deg/h]"
    )
    axis_text(right, title="what each kind of term gives", x="time [min]", y="deg/h")
    # above the curves, not over them
    figure.legend(*left.get_legend_handles_labels(), loc="outside upper left", ncols=3)
    figure.legend(*right.get_legend_handles_labels(), loc="outside upper right", ncols=3)
    return svg_text(
        figure, f"Bias of gyro {a.axis} over run {b.run_id}: measured, model and parts of the model"
    )


@in_style
def order_drawing(a: AxisModel) -> Markup:
    """Held-out chi2 a row over the number of terms; the chosen order marked."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    figure, axes = new_figure(1, 1, height=2.3)
    ax = axes[0, 0]
    sizes, chi2 = [len(c.used) for c in a.orders], [c.chi2 for c in a.orders]
    ax.plot(sizes, chi2, "o-", color=GREY, markersize=4)
    ax.plot(
        len(a.used),
        a.choice.chi2,
        "o",
        color=NEW,
        markersize=8,
        label="chosen: " + " ".join(a.used),
    )
    ax.set_xticks(sizes)
    ax.set_yscale("log")
    ax.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    ax.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    ax.yaxis.set_minor_formatter(NullFormatter())
    axis_text(ax, title=f"gyro {a.axis}: order", x="terms", y="held-out chi2 a row")
    ax.legend(loc="best")
    return svg_text(figure, f"Held-out misfit of gyro {a.axis} over the number of terms")


@in_style
def _check_drawing(found: RlgHeldOut) -> Markup:
    """Five-minute means of a held-out run before and after, each less its mean."""
    figure, axes = new_figure(1, 3, height=2.8, sharey=True)
    for k, axis in enumerate(AXES):
        ax = axes[0, k]
        if axis in found.means:
            time_s, values = found.means[axis]
            for column, (name, colour, mark) in enumerate(
                (
                    ("uncompensated", GREY, "."),
                    ("temperature alone", OLD, "--"),
                    ("model", NEW, "-"),
                    ("real time", BLACK, ":"),
                )
            ):
                ax.plot(
                    time_s / 60.0,
                    values[:, column],
                    mark,
                    color=colour,
                    markersize=3,
                    linewidth=1.2,
                    label=name,
                )
        axis_text(ax, title=f"gyro {axis}", x="time [min]", y="bias [deg/h]" if k == 0 else "")
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=4)
    return svg_text(figure, f"Held-out run {found.run.blocks.run_id} before and after compensation")
