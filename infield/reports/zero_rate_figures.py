"""Drawings of an update report for sessions without a heading: the shape of a bias over
temperature, levels taken out.

A MEMS gyro starts with another level each time, hundreds of times what it changes by over a
warm-up: beside the levels the shape, which is what a table is for, would not be seen.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from infield.reports.documents.session_records import EstimatedDocument
from infield.reports.documents.update_records import PointDocument, UpdateDocument
from infield.reports.drawing import Item, Marks, Panel
from infield.reports.figures import NEW, OLD, robust_limits, thinned
from infield.reports.update_figures import TEMPERATURE_AXIS, run_marks, seen_points, table_curve
from infield.table.thermal_table import ThermalTable
from ins.records import AXES

MARGIN_DEGC = 3.0  # beside the visited temperatures


def shape_panel(
    document: UpdateDocument, axis: str, before: ThermalTable, after: ThermalTable | None
) -> Panel | None:
    """Bias of one gyro less each run's own level, with the tables less theirs; None without
    points.
    """
    points = seen_points(document, axis)
    if not points:
        return None
    T_all = np.array([p.temperature_degC for p in points])
    reference = float(np.median(T_all))
    T = np.linspace(T_all.min() - MARGIN_DEGC, T_all.max() + MARGIN_DEGC, 121)
    curves = [
        table_curve(name, T, *_less_level(table, axis, T, reference), colour=colour)
        for table, name, colour in ((before, "stored table", OLD), (after, "new table", NEW))
        if table is not None
    ]
    outer = [edge for curve in curves for edge in curve.edges]
    runs = _run_marks(document, points, axis, after or before, reference)
    inner = np.concatenate([*(curve.y for curve in curves), *(marks.y for marks in runs)])
    items: list[Item] = [*curves, *runs]
    return Panel(
        title=f"Gyro {axis}: shape over temperature",
        items=items,
        x_label=TEMPERATURE_AXIS,
        y_label="bias less level [deg/h]",
        label=f"Shape of the bias of gyro {axis} over temperature, the level of each run taken out",
        y_limits=robust_limits(inner, np.concatenate(outer), spans=0.5),
        group="shapes",
    )


def _less_level(
    table: ThermalTable, axis: str, T: NDArray, reference_degC: float
) -> tuple[NDArray, NDArray]:
    """Bias less that at the reference temperature, and the sigma of the difference [deg/h]."""
    rows = table.basis(axis, T) - table.basis(axis, [reference_degC])
    variance = np.einsum("ki,ij,kj->k", rows, table.covariance, rows)
    return rows @ table.parameters, np.sqrt(np.maximum(variance, 0.0))


def _run_marks(
    document: UpdateDocument,
    points: Sequence[PointDocument],
    axis: str,
    table: ThermalTable,
    reference_degC: float,
) -> list[Marks]:
    """Points of each run less the run's mean departure from the table, white noise as their
    sigma.
    """
    found = []
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
        walk = zero_rate.angle_random_walk_deg_sqrt_h[AXES.index(axis)]
        y, sigma = bias - np.mean(bias - shape), walk / np.sqrt(duration / 3600.0)
        found.append(run_marks(f"run {number + 1}", "o", T, y, sigma, number))
    return found
