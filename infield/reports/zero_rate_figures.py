"""Drawings of an update report for sessions without a heading: the shape of a bias over
temperature, levels taken out.

A MEMS gyro starts with another level each time, hundreds of times what it changes by over a
warm-up: beside the levels the shape, which is what a table is for, would not be seen.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from infield.reports.documents.session_records import EstimatedDocument
from infield.reports.documents.update_records import PointDocument, UpdateDocument
from infield.reports.figures import (
    NEW,
    OLD,
    PANEL_WIDTH,
    axis_text,
    in_style,
    new_figure,
    robust_limits,
    svg_text,
    thinned,
)
from infield.reports.update_figures import SESSION_COLOURS, seen_points
from infield.table.thermal_table import ThermalTable
from ins.records import AXES

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MARGIN_DEGC = 3.0  # beside the visited temperatures


@in_style
def shape_drawing(
    document: UpdateDocument, axis: str, before: ThermalTable, after: ThermalTable | None
) -> Markup | None:
    """Bias of one gyro less each run's own level, with the tables less theirs; None without
    points.
    """
    points = seen_points(document, axis)
    if not points:
        return None
    T_all = np.array([p.temperature_degC for p in points])
    reference = float(np.median(T_all))
    figure, axes = new_figure(width=PANEL_WIDTH, height=3.3)
    ax, inner, outer = axes[0, 0], [], []
    T = np.linspace(T_all.min() - MARGIN_DEGC, T_all.max() + MARGIN_DEGC, 121)
    for table, colour, line in ((before, OLD, "--"), (after, NEW, "-")):
        if table is None:
            continue
        value, sigma = _less_level(table, axis, T, reference)
        ax.fill_between(
            T, value - 2 * sigma, value + 2 * sigma, color=colour, alpha=0.16, linewidth=0
        )
        ax.plot(T, value, line, color=colour)
        inner.append(value)
        outer += [value - 2 * sigma, value + 2 * sigma]
    inner.append(_draw_runs(ax, document, points, axis, after or before, reference))
    ax.set_ylim(*robust_limits(np.concatenate(inner), np.concatenate(outer), spans=0.5))
    axis_text(
        ax,
        title=f"Gyro {axis}: shape over temperature",
        x="gyro temperature [°C]",
        y="bias less level [deg/h]",
    )
    return svg_text(
        figure,
        f"Shape of the bias of gyro {axis} over temperature, the level of each run taken out",
    )


def _less_level(
    table: ThermalTable, axis: str, T: NDArray, reference_degC: float
) -> tuple[NDArray, NDArray]:
    """Bias less that at the reference temperature, and the sigma of the difference [deg/h]."""
    rows = table.basis(axis, T) - table.basis(axis, [reference_degC])
    variance = np.einsum("ki,ij,kj->k", rows, table.covariance, rows)
    return rows @ table.parameters, np.sqrt(np.maximum(variance, 0.0))


def _draw_runs(
    ax: "Axes",
    document: UpdateDocument,
    points: Sequence[PointDocument],
    axis: str,
    table: ThermalTable,
    reference_degC: float,
) -> NDArray:
    """Points of each run less the run's mean departure from the table, white noise as their
    sigma.
    """
    drawn = []
    for number, session in enumerate(document.sessions):
        mine = [p for p in points if p.run_id == session.run_id]
        zero_rate = session.zero_rate if isinstance(session, EstimatedDocument) else None
        if not mine or zero_rate is None:
            continue
        T, bias, duration = thinned(
            [p.temperature_degC for p in mine],
            [p.bias_deg_h for p in mine],
            [p.duration_s for p in mine],
        )
        shape = _less_level(table, axis, T, reference_degC)[0]
        y = bias - np.mean(bias - shape)
        walk = zero_rate.angle_random_walk_deg_sqrt_h[AXES.index(axis)]
        sigma, colour = (
            walk / np.sqrt(duration / 3600.0),
            SESSION_COLOURS[number % len(SESSION_COLOURS)],
        )
        ax.errorbar(T, y, sigma, fmt="o", color=colour, markersize=2.5, elinewidth=0.5, alpha=0.7)
        drawn.append(y)
    return np.concatenate(drawn) if drawn else np.empty(0)
