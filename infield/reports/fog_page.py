"""thermal_fog.html: the ramp document as one page that fetches nothing. Computes nothing."""

from collections.abc import Mapping

import numpy as np

from infield.reports.documents.fog import FittedAxis, FogDocument
from infield.reports.drawing import (
    BLACK,
    DASHED,
    DOT,
    DOTTED,
    GREY,
    NEW,
    OLD,
    ORANGE,
    Band,
    Item,
    Line,
    Marks,
    Panel,
    ShadedSpan,
    spanned,
)
from infield.reports.page import render_page
from infield.thermal.fog.model import HeldOutResidual
from infield.thermal.fog.piecewise import Piecewise
from infield.thermal.reasons import ThermalVerdict
from ins.documents import plain
from ins.records import AXES

INTERVAL_COLOUR = f"{ORANGE}20"  # an eighth of it
LABELS = {"K_T": "K_T [deg/h]", "K_delta": "K_delta [deg/h per degC/min]"}


def render(document: FogDocument) -> str:
    """The page of thermal_fog.json, with the blocks of the held-out ramps."""
    return render_page(
        "fog_ramps.html.j2",
        d=plain(document),
        good=document.verdict is ThermalVerdict.FITTED,
        coefficients={axis: coefficient_panels(axis, a) for axis, a in document.axes.items()},
        checks=[(found.run.run_id, _check_panels(found)) for found in document.check],
    )


def coefficient_panels(axis: str, fitted: FittedAxis) -> list[Panel]:
    """Both coefficients of one gyro over temperature: band, piecewise model with breakpoints, the
    document's subtraction.
    """
    T, panels = np.array(fitted.temperature_degC), []
    for name, key in (("K_T", "K_T_deg_h"), ("K_delta", "K_delta_deg_h_per_degC_min")):
        value, sigma = (np.array(getattr(fitted, part)) for part in (key, f"sigma_{key}"))
        curve: Piecewise = getattr(fitted.piecewise, name)
        marks = curve.breakpoints
        spans = []
        for mark in marks:
            low, high = mark.interval_95_degC
            spans.append(ShadedSpan(low, high, INTERVAL_COLOUR))
            spans.append(ShadedSpan(mark.temperature_degC, mark.temperature_degC, GREY))
        items: list[Item] = [
            Band(T, value - 2 * sigma, value + 2 * sigma, NEW, 0.25, "2 sigma"),
            Line(T, value, NEW, "exact separation"),
        ]
        if fitted.document is not None:
            subtracted = np.array(getattr(fitted.document, key), dtype=float)
            items.append(Line(T, subtracted, OLD, "subtraction", dash=DASHED))
        pieces = curve(T)
        if name == "K_T":
            pieces = pieces - np.mean(pieces)
        items.append(Line(T, pieces, BLACK, "piecewise", width=1.3, dash=DOTTED))
        panels.append(
            Panel(
                items=items,
                title=f"gyro {axis}: {name}",
                x_label="temperature [degC]",
                y_label=LABELS[name],
                spans=spans,
                group=f"gyro {axis}",
            )
        )
    return panels


def _check_panels(found: HeldOutResidual) -> list[Panel]:
    """Gyro output of a held-out ramp before and after, each less its mean."""
    clouds: dict[str, list[Line | Marks]] = {}
    for k, axis in enumerate(AXES):
        rows = found.rows[:, k]
        if rows.any():
            t = found.run.time_s[rows] / 60.0
            raw, left = found.run.bias_deg_h[rows, k], found.left_deg_h[rows, k]
            clouds[axis] = [
                Marks(t, raw - raw.mean(), DOT, GREY, "uncompensated", size=2.2),
                Marks(t, left - left.mean(), DOT, NEW, "compensated", size=2.2),
            ]
    return before_and_after(clouds, found.run.run_id)


def before_and_after(clouds: Mapping[str, list[Line | Marks]], run_id: str) -> list[Panel]:
    """Each gyro's output over a held-out run [min], what is drawn by axis, on one scale."""
    items = [item for drawn in clouds.values() for item in drawn]
    shared = spanned([item.y for item in items])
    return [
        Panel(
            items=list(drawn),
            label=f"gyro {axis}: held-out run {run_id} before and after compensation",
            title=f"gyro {axis}",
            x_label="time [min]",
            y_label="bias [deg/h]",
            y_limits=shared,
            group=run_id,
        )
        for axis, drawn in clouds.items()
    ]
