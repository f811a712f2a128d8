"""Time series that a reader can zoom: a drawing, the numbers behind it, and the script that shows
them.

Without JavaScript the drawing stays, and a page fetches nothing: the script library (uPlot, MIT
licence, `scripts/uPlot.LICENSE`) stands in the page.
"""

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from importlib.resources import files
from itertools import cycle

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from infield.reports.figures import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    PURPLE,
    SKY,
    VERMILLION,
    axis_text,
    in_style,
    new_figure,
    svg_text,
)

DIGITS = 6  # significant ones of a number in the page: a pixel of a drawing is a thousandth of it
CURVE_COLOURS = (BLACK, GREEN, PURPLE, BLUE, VERMILLION, SKY, ORANGE, GREY)
DRAWN_HEIGHT = 2.5  # inches


@dataclass(frozen=True, kw_only=True)
class ZoomCurve:
    """One line: its name, values (n,), and the least and greatest of the rows behind each value
    (n,) where there are such.
    """

    name: str
    values: NDArray
    low: NDArray | None = None
    high: NDArray | None = None


@dataclass(frozen=True, kw_only=True)
class ZoomFigure:
    """Lines over time (n,), [s] unless `x_name` says otherwise; spans: stretches (start, end) that
    are shaded.
    """

    title: str
    unit: str
    time_s: NDArray
    curves: Sequence[ZoomCurve]
    spans: Sequence[tuple[float, float]] = ()
    x_name: str = "time [s]"


def zoom_figure(figure: ZoomFigure, caption: str = "") -> Markup:
    """The figure as an element of a page; `zoom_script` is needed once on the page."""
    label = f"{figure.title} over time"
    return Markup(
        '<figure class="wide zoom"><div class="drawing">{}</div>'
        '<script type="application/json">{}</script><figcaption>{}</figcaption></figure>'
    ).format(_drawing(figure, label), Markup(_numbers(figure)), caption)


@lru_cache(maxsize=1)
def zoom_script() -> Markup:
    """The library and what uses it, for the end of a page."""
    folder = files("infield.reports") / "scripts"
    texts = [(folder / name).read_text("utf-8") for name in ("uPlot.iife.min.js", "zoom.js")]
    return Markup("".join(f"<script>{text}</script>\n" for text in texts))


@in_style
def _drawing(figure: ZoomFigure, label: str) -> Markup:
    drawn, grid = new_figure(height=DRAWN_HEIGHT)
    ax = grid[0, 0]
    for start_s, end_s in figure.spans:
        ax.axvspan(start_s, end_s, color="#E3E8ED", linewidth=0)
    for curve, colour in _coloured(figure):
        if curve.low is not None and curve.high is not None:
            ax.fill_between(
                figure.time_s, curve.low, curve.high, color=colour, alpha=0.2, linewidth=0
            )
        ax.plot(figure.time_s, curve.values, color=colour, linewidth=1.1, label=curve.name)
    ax.margins(x=0)
    axis_text(ax, x=figure.x_name, y=figure.unit)
    if len(figure.curves) > 1:
        drawn.legend(loc="outside upper center", ncols=min(len(figure.curves), 5))
    return svg_text(drawn, label)


def _numbers(figure: ZoomFigure) -> str:
    """The numbers as JSON that ends no element."""
    told = {
        "unit": figure.unit,
        "x_name": figure.x_name,
        "x": _column(figure.time_s),
        "curves": [
            {
                "name": curve.name,
                "colour": colour,
                "values": _column(curve.values),
                **({} if curve.low is None else {"low": _column(curve.low)}),
                **({} if curve.high is None else {"high": _column(curve.high)}),
            }
            for curve, colour in _coloured(figure)
        ],
        "spans": [{"start": start_s, "end": end_s} for start_s, end_s in figure.spans],
    }
    text = json.dumps(told, separators=(",", ":"), allow_nan=False)
    return text.replace("<", "\\u003c").replace("&", "\\u0026")


def _coloured(figure: ZoomFigure) -> Iterator[tuple[ZoomCurve, str]]:
    return zip(figure.curves, cycle(CURVE_COLOURS))


def _column(values: NDArray) -> list[float | None]:
    """Rounded numbers, null where there is none."""
    return [float(f"{v:.{DIGITS}g}") if np.isfinite(v) else None for v in values.tolist()]
