"""thermal_fog.html: the ramp document as one page that fetches nothing. Computes nothing."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from markupsafe import Markup

from infield.reports.documents.fog import AxisDocument, CurveDocument, FogDocument
from infield.reports.figures import (
    AXIS_COLOURS,
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
from infield.thermal.fog.model import HeldOut, curve_from
from infield.thermal.reasons import ThermalVerdict
from ins.records import AXES
from ins.verdicts import plain

K_T, K_DELTA = "K_T [deg/h]", "K_delta [deg/h per degC/min]"


def render(document: FogDocument) -> str:
    """The page of thermal_fog.json, with the blocks of the held-out ramps."""
    return render_page(
        "fog_ramps.html.j2",
        d=plain(document),
        good=document.verdict is ThermalVerdict.FITTED,
        drawings={axis: coefficient_drawing(axis, a) for axis, a in document.axes.items()},
        checks=[(found.run.run_id, _check_drawing(found)) for found in document.held_out],
    )


@dataclass(frozen=True, kw_only=True)
class _Coefficient:
    """One coefficient of a gyro; subtracted: by the document's subtraction; less_mean: drawn so."""

    name: str
    label: str
    value: Sequence[float]
    sigma: Sequence[float]
    subtracted: Sequence[float] | None
    curve: CurveDocument
    less_mean: bool = False


def _coefficients(fitted: AxisDocument) -> tuple[_Coefficient, _Coefficient]:
    document, piecewise = fitted.document, fitted.piecewise
    return (
        _Coefficient(
            name="K_T",
            label=K_T,
            value=fitted.K_T_deg_h,
            sigma=fitted.sigma_K_T_deg_h,
            subtracted=document.K_T_deg_h if document else None,
            curve=piecewise.K_T,
            less_mean=True,
        ),
        _Coefficient(
            name="K_delta",
            label=K_DELTA,
            value=fitted.K_delta_deg_h_per_degC_min,
            sigma=fitted.sigma_K_delta_deg_h_per_degC_min,
            subtracted=document.K_delta_deg_h_per_degC_min if document else None,
            curve=piecewise.K_delta,
        ),
    )


@in_style
def coefficient_drawing(axis: str, fitted: AxisDocument) -> Markup:
    """Both coefficients of one gyro over temperature: band, piecewise model with breakpoints, the
    document's subtraction.
    """
    figure, axes = new_figure(1, 2, height=3.2)
    T = np.array(fitted.temperature_degC)
    for ax, row in zip(axes[0], _coefficients(fitted)):
        value, sigma = np.array(row.value), np.array(row.sigma)
        ax.fill_between(
            T,
            value - 2 * sigma,
            value + 2 * sigma,
            color=NEW,
            alpha=0.25,
            linewidth=0,
            label="2 sigma",
        )
        ax.plot(T, value, color=NEW, label="exact separation")
        if row.subtracted is not None:
            ax.plot(
                T,
                np.array(row.subtracted, dtype=float),
                color=OLD,
                linestyle="--",
                label="subtraction",
            )
        pieces = curve_from(plain(row.curve))(T)
        if row.less_mean:
            pieces = pieces - np.mean(pieces)
        ax.plot(T, pieces, color=BLACK, linestyle=":", linewidth=1.3, label="piecewise")
        for mark in row.curve.breakpoints:
            ax.axvline(mark.temperature_degC, color=GREY, linestyle=":", linewidth=1.2)
            ax.axvspan(*mark.interval_95_degC, color=ORANGE, alpha=0.12, linewidth=0)
        axis_text(ax, title=f"gyro {axis}: {row.name}", x="temperature [degC]", y=row.label)
        ax.legend(loc="best")
    return svg_text(figure, f"Temperature and rate coefficient of gyro {axis} over temperature")


@in_style
def _check_drawing(found: HeldOut) -> Markup:
    """Gyro output of a held-out ramp before and after, each less its mean."""
    figure, axes = new_figure(1, 3, height=2.8, sharey=True)
    for k, axis in enumerate(AXES):
        ax, rows = axes[0, k], found.rows[:, k]
        if rows.any():
            raw = found.run.bias_deg_h[rows, k]
            left = found.left_deg_h[rows, k]
            t = found.run.time_s[rows] / 60.0
            ax.plot(t, raw - raw.mean(), ".", color=GREY, markersize=2.5, label="uncompensated")
            ax.plot(
                t,
                left - left.mean(),
                ".",
                color=AXIS_COLOURS.get(axis, BLACK),
                markersize=2.5,
                label="compensated",
            )
        axis_text(ax, title=f"gyro {axis}", x="time [min]", y="bias [deg/h]" if k == 0 else "")
        if k == 0 and rows.any():
            ax.legend(loc="best")
    return svg_text(figure, f"Held-out ramp {found.run.run_id} before and after compensation")
