"""Drawings of results as matplotlib Figures, for those who go on with them in Python: panels as on
the pages, side by side.
"""

import io
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from infield.reports.charts import (
    DASHED,
    EDGE_COLOUR,
    GRID_COLOUR,
    TITLE_PT,
    Band,
    Item,
    Line,
    Marks,
    Panel,
    Uprights,
)
from infield.reports.figures import BLACK, LETTER, NEW, OLD, drawn_temperatures
from infield.table.thermal_table import ThermalTable
from ins.records import AXES
from recal.service.results.update_summary import Points

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLUMNS = 3
COLUMN_INCHES, ROW_INCHES, KEY_INCHES = 2.9, 2.8, 0.4  # three columns fit a notebook

STYLE: dict[str, float | str | bool | list[str]] = {
    "font.family": ["sans-serif"],
    "font.sans-serif": ["DejaVu Sans"],
    "font.size": LETTER,
    "axes.titlesize": TITLE_PT,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.labelsize": LETTER,
    "legend.fontsize": LETTER,
    "legend.frameon": False,
    "xtick.labelsize": LETTER,
    "ytick.labelsize": LETTER,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": GRID_COLOUR,
    "grid.linewidth": 0.7,
    "axes.edgecolor": EDGE_COLOUR,
    "axes.linewidth": 0.8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "lines.linewidth": 1.5,
    "axes.unicode_minus": True,
    "axes.formatter.useoffset": False,
}


def figure_of(panels: Sequence[Panel]) -> "Figure":
    """Panels of lines, bands, marks and uprights as one Figure, COLUMNS in a row, with one legend
    of all names. Made without pyplot; a notebook shows it.

    Raises
    ------
    TypeError
        For another item of a panel.
    """
    from matplotlib import rc_context, rcParamsDefault
    from matplotlib.figure import Figure

    class Shown(Figure):
        """A Figure that a notebook shows without pyplot."""

        def _repr_svg_(self) -> str:
            text = io.StringIO()
            with rc_context({"svg.fonttype": "none", "svg.hashsalt": "recal"}):
                self.savefig(text, format="svg", metadata={"Date": None})
            return text.getvalue()

    columns = min(COLUMNS, len(panels))
    rows = -(-len(panels) // columns)
    size = (COLUMN_INCHES * columns, ROW_INCHES * rows + KEY_INCHES)
    named: dict[str, Artist] = {}
    style: dict[Any, Any] = {**rcParamsDefault, **STYLE}
    with rc_context(style):  # whatever the user's matplotlibrc says
        figure = Shown(figsize=size, layout="constrained")
        grid = figure.subplots(rows, columns, squeeze=False)
        for ax in grid.flat[len(panels) :]:
            ax.set_visible(False)
        for panel, ax in zip(panels, grid.flat):
            for item in panel.items:
                _put(item, ax)
            ax.set(title=panel.title, xlabel=panel.x_label, ylabel=panel.y_label)
            ax.set_xscale("log" if panel.x_log else "linear")
            ax.set_yscale("log" if panel.y_log else "linear")
            handles, labels = ax.get_legend_handles_labels()
            named |= dict(zip(labels, handles))
        figure.legend(list(named.values()), list(named), loc="outside upper center", ncols=4)
    return figure


def _put(item: Item, ax: "Axes") -> None:
    label = item.name or "_"  # matplotlib lists no name that begins so
    match item:
        case Line(colour=colour, width=width):
            dash: Any = (0, tuple(map(float, item.dash.split()))) if item.dash else "-"
            ax.plot(item.x, item.y, color=colour, lw=width, linestyle=dash, label=label)
        case Band(colour=colour, opacity=alpha):
            ax.fill_between(
                item.x, item.low, item.high, color=colour, alpha=alpha, lw=0.0, label=label
            )
        case Marks(colour=colour, size=size):
            ax.plot(item.x, item.y, item.mark, color=colour, markersize=size, label=label)
        case Uprights(colour=colour, width=width):
            ax.vlines(item.x, item.low, item.high, colors=colour, lw=width, label=label)
        case _:
            raise TypeError(f"{type(item).__name__} is not drawn in a Figure")


def update_panels(before: ThermalTable, after: ThermalTable, points: Points) -> list[Panel]:
    """Bias against temperature, before and after, a panel for each gyro: both tables with U(k=2)
    bands, the points with theirs.
    """
    panels = []
    for axis in AXES:
        items: list[Item] = []
        tables = zip((before, after), (OLD, NEW), (DASHED, ""), ("before", "after"))
        for table, colour, dash, name in tables:
            T = drawn_temperatures(table.temperature_degC[AXES.index(axis)])
            bias, band = table.bias_deg_h(axis, T), 2.0 * table.sigma_deg_h(axis, T)
            items.append(Band(T, bias - band, bias + band, colour, 0.16))
            items.append(Line(T, bias, colour, name, dash=dash))
        seen = points.of(axis)
        T = np.array([point.temperature_degC for point in seen])
        bias = np.array([point.bias_deg_h for point in seen])
        band = 2.0 * np.array([point.sigma_deg_h for point in seen])
        items.append(Uprights(T, bias - band, bias + band, BLACK))
        items.append(Marks(T, bias, "o", BLACK, "points, U(k=2)", size=2.5))
        panels.append(
            Panel(
                items=items,
                title=f"Gyro {axis}",
                x_label="gyro temperature [°C]",
                y_label="bias [deg/h]",
            )
        )
    return panels
