"""An update as a matplotlib Figure: bias against temperature, before and after."""

from typing import TYPE_CHECKING

import numpy as np

from infield.reports.figures import NEW, OLD, axis_text, in_style
from infield.table.thermal_table import ThermalTable
from ins.records import AXES
from recal.service.results.update_words import Points

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

FIGURE_INCHES = (10.0, 3.2)
CURVE_POINTS = 121


@in_style
def update_figure(before: ThermalTable, after: ThermalTable, points: Points) -> "Figure":
    """A panel for each gyro: both tables with U(k=2) bands, the points with theirs."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=FIGURE_INCHES, layout="constrained")
    axes = figure.subplots(1, 3)
    for ax, axis in zip(axes, AXES):
        _panel(ax, axis, (before, after), points)
    axes[0].legend(loc="best")
    return figure


def _panel(
    ax: "Axes", axis: str, tables: tuple[ThermalTable, ThermalTable], points: Points
) -> None:
    for table, colour, dashes, name in zip(tables, (OLD, NEW), ("--", "-"), ("before", "after")):
        nodes = table.temperature_degC[AXES.index(axis)]
        T = np.union1d(nodes, np.linspace(nodes[0], nodes[-1], CURVE_POINTS))
        bias, band = table.bias_deg_h(axis, T), 2.0 * table.sigma_deg_h(axis, T)
        ax.fill_between(T, bias - band, bias + band, color=colour, alpha=0.16, linewidth=0)
        ax.plot(T, bias, dashes, color=colour, label=name)
    seen = points.of(axis)
    ax.errorbar(
        [point.temperature_degC for point in seen],
        [point.bias_deg_h for point in seen],
        [2.0 * point.sigma_deg_h for point in seen],
        fmt="o",
        color="black",
        markersize=2.5,
        elinewidth=0.6,
        label="points, U(k=2)",
    )
    axis_text(ax, title=f"Gyro {axis}", x="gyro temperature [°C]", y="bias [deg/h]")
