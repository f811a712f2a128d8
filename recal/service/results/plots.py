"""Figures of results as plotly's Python package shows them, from the specification that the pages
hold: panels side by side.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from infield.reports.drawing import (
    BLACK,
    DASHED,
    NEW,
    OLD,
    Line,
    Marks,
    Panel,
    drawn_temperatures,
    specification,
)
from infield.table.thermal_table import ThermalTable
from ins.records import AXES, InputError
from recal.service.results.update_summary import Points

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

COLUMNS = 3
PLOT_EXTRA = "a plot needs plotly: pip install 'strapdown-recal[plot]'"


def figure_of(panels: Sequence[Panel]) -> "Figure":
    """Panels as one Figure, COLUMNS in a row, with one legend of all names.

    Returns
    -------
    plotly.graph_objects.Figure
        A notebook shows it; `.write_html(path)` writes it.

    Raises
    ------
    InputError
        Where plotly is not installed.
    """
    try:
        from plotly.graph_objects import Figure
    except ImportError:
        raise InputError(PLOT_EXTRA) from None
    return Figure(specification(panels, columns=min(COLUMNS, len(panels))))


def update_panels(before: ThermalTable, after: ThermalTable, points: Points) -> list[Panel]:
    """Bias against temperature, before and after, a panel for each gyro: both tables with U(k=2)
    bands, the points with theirs.
    """
    panels = []
    for axis in AXES:
        lines = []
        tables = zip((before, after), (OLD, NEW), (DASHED, ""), ("before", "after"))
        for table, colour, dash, name in tables:
            T = drawn_temperatures(table.temperature_degC[AXES.index(axis)])
            bias, band = table.bias_deg_h(axis, T), 2.0 * table.sigma_deg_h(axis, T)
            line = Line(T, bias, colour, name, dash=dash, low=bias - band, high=bias + band)
            lines.append(line)
        seen = points.of(axis)
        T = np.array([point.temperature_degC for point in seen])
        bias = np.array([point.bias_deg_h for point in seen])
        band = 2.0 * np.array([point.sigma_deg_h for point in seen])
        low, high = bias - band, bias + band
        marks = Marks(T, bias, "o", BLACK, "points, U(k=2)", size=2.5, low=low, high=high)
        panels.append(
            Panel(
                items=[*lines, marks],
                title=f"Gyro {axis}",
                x_label="gyro temperature [°C]",
                y_label="bias [deg/h]",
            )
        )
    return panels
