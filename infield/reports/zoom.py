"""Time series that a reader can zoom: a drawing, the numbers behind it, and the script that shows
them.

Without JavaScript the drawing stays, and a page fetches nothing: the script library (uPlot, MIT
licence, `scripts/uPlot.LICENSE`) stands in the page.

Decision: docs/decisions/0052-zoom.md.
"""

import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from functools import lru_cache
from importlib.resources import files
from itertools import cycle
from typing import TypedDict

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from infield.reports.charts import (
    DASHED,
    DOT,
    GRID_COLOUR,
    Band,
    Boxes,
    Item,
    Line,
    Marks,
    Panel,
    Uprights,
    chart,
)
from infield.reports.figures import (
    BLACK,
    BLUE,
    FIGURE_WIDTH,
    GREEN,
    GREY,
    ORANGE,
    PANEL_HEIGHT,
    PANEL_WIDTH,
    PURPLE,
    SKY,
    VERMILLION,
)

DIGITS = 6  # significant ones of a number in the page: a pixel of a drawing is a thousandth of it
CURVE_COLOURS = (BLACK, GREEN, PURPLE, BLUE, VERMILLION, SKY, ORANGE, GREY)
DRAWN_HEIGHT = 2.5  # inches
BAND_ALPHA = 0.18  # of a band: two that overlap are still told apart
BAR_MARK, HOLLOW_MARK, NODE_MARK = "|", "O", "n"
POINT_MARKS = {"^": "^", "v": "v", "o": "o", "x": "x", "s": "s", NODE_MARK: "s", HOLLOW_MARK: "o"}
POINT_MARKS |= {DOT: DOT}
INKS = {BLACK: "var(--ink)", VERMILLION: "var(--old)", BLUE: "var(--new)", GREY: "var(--soft)"}
MARK_SIZES = {NODE_MARK: 2.8, DOT: 1.8}  # points; 4 of the others


@dataclass(frozen=True, kw_only=True)
class ZoomCurve:
    """One line: its name, values (n,), and the least and greatest of the rows behind each value
    (n,) where there are such.

    x: (n,) where it differs from the figure's; mark: points (a key of `POINT_MARKS`) with
    bars from low to high, or BAR_MARK, the bars alone; no line then. A curve of an empty name is
    not in the legend.
    """

    name: str
    values: NDArray
    low: NDArray | None = None
    high: NDArray | None = None
    x: NDArray | None = None
    mark: str = ""
    colour: str = ""
    dashed: bool = False

    @property
    def edges(self) -> tuple[NDArray, NDArray]:
        """Least and greatest (n,), the values themselves where there are none."""
        low = self.values if self.low is None else self.low
        high = self.values if self.high is None else self.high
        return low, high


@dataclass(frozen=True)
class ZoomStrip:
    """A named stretch of time, as a coloured strip along the top of a drawing that is live."""

    start: float
    end: float
    name: str
    colour: str


@dataclass(frozen=True, kw_only=True)
class ZoomFigure:
    """Lines over time (n,), [s] unless `x_name` says otherwise; spans: stretches (start, end) that
    are shaded.

    limits: least and greatest value that the y axis shows; circle: values are degrees, labelled in
    [0, 360); log: the y axis is logarithmic; group: drawings of one group and one x axis zoom
    together; panel: one of several side by side, with its title.
    """

    title: str
    unit: str
    time_s: NDArray
    curves: Sequence[ZoomCurve]
    spans: Sequence[tuple[float, float]] = ()
    strips: Sequence[ZoomStrip] = ()
    x_name: str = "time [s]"
    label: str = ""
    limits: tuple[float, float] | None = None
    circle: bool = False
    log: bool = False
    group: str = ""
    panel: bool = False


def zoom_figure(figure: ZoomFigure, caption: str = "") -> Markup:
    """The figure as an element of a page; `zoom_script` is needed once on the page."""
    drawing = _drawing(figure, figure.label or f"{figure.title} over time")
    return zoomed(drawing, [figure], caption, wide=not figure.panel)


def zoomed(
    drawing: Markup, figures: Sequence[ZoomFigure], caption: str = "", *, wide: bool = True
) -> Markup:
    """A drawing that was made elsewhere, with the figures that take its place where there is
    JavaScript.
    """
    numbers = (
        Markup('<script type="application/json">{}</script>').format(Markup(_numbers(figure)))
        for figure in figures
    )
    return Markup(
        '<figure class="{}zoom"><div class="drawing">{}</div>{}<figcaption>{}</figcaption></figure>'
    ).format("wide " if wide else "", drawing, Markup("").join(numbers), caption)


def zoom_panels(figures: Sequence[ZoomFigure], caption: str = "") -> Markup:
    """Figures side by side, with a key of the names of their curves where there are two or more."""
    names: dict[str, Markup] = {}
    for figure in figures:
        for curve, colour in _coloured(figure):
            names.setdefault(curve.name, _swatch(curve, colour))
    names.pop("", None)
    rows = (Markup("<li>{}{}</li>").format(swatch, name) for name, swatch in names.items())
    key = Markup('<ul class="key">{}</ul>').format(Markup("").join(rows))
    return Markup('{}{}<div class="panels">{}</div>').format(
        Markup('<p class="soft">{}</p>').format(caption) if caption else "",
        key if len(names) > 1 else "",
        Markup("").join(zoom_figure(figure) for figure in figures),
    )


def _swatch(curve: ZoomCurve, colour: str) -> Markup:
    """How a key shows a curve: in the ink that `zoom.js` draws it with, in the dark as well."""
    colour = INKS.get(colour, colour)
    if curve.mark:
        sign = {"x": "\u00d7", BAR_MARK: "|"}.get(curve.mark, "\u25cf")
        return Markup('<span class="mark" style="color:{}">{}</span>').format(colour, sign)
    if curve.dashed:
        ground = f"repeating-linear-gradient(90deg,{colour} 0 .4em,transparent .4em .65em)"
    else:
        ground = colour
    return Markup('<span class="swatch" style="background:{}"></span>').format(ground)


@lru_cache(maxsize=1)
def zoom_script() -> Markup:
    """The library and what uses it, for the end of a page."""
    folder = files("infield.reports") / "scripts"
    texts = [(folder / name).read_text("utf-8") for name in ("uPlot.iife.min.js", "zoom.js")]
    return Markup("".join(f"<script>{text}</script>\n" for text in texts))


def _drawing(figure: ZoomFigure, label: str) -> Markup:
    items: list[Item] = []
    if figure.spans:
        items.append(Boxes([(*span, None, None) for span in figure.spans], GRID_COLOUR))
    for curve, colour in _coloured(figure):
        items += _items(figure, curve, colour)
    panel = Panel(
        items=items,
        x_label=figure.x_name,
        y_label=figure.unit,
        y_limits=figure.limits,
        circle=figure.circle,
        y_log=figure.log,
    )
    if figure.panel:
        panel.title = figure.title
        return chart([panel], label, width=PANEL_WIDTH, height=PANEL_HEIGHT)
    panel.x_room = 0.0
    panel.legend = "above" if len(figure.curves) > 1 else ""
    return chart([panel], label, width=FIGURE_WIDTH, height=DRAWN_HEIGHT)


def _items(figure: ZoomFigure, curve: ZoomCurve, colour: str) -> list[Item]:
    """A line with its band, points with their bars, or bars alone."""
    x = figure.time_s if curve.x is None else curve.x
    low, high = curve.edges
    if curve.mark == BAR_MARK:
        return [Uprights(x, low, high, colour, width=4.0, opacity=0.55)]
    known = curve.low is not None and curve.high is not None
    if not curve.mark:
        line = Line(
            x,
            curve.values,
            colour,
            name=curve.name,
            width=1.5 if figure.panel else 1.1,
            dash=DASHED if curve.dashed else "",
        )
        return [Band(x, low, high, colour, BAND_ALPHA), line] if known else [line]
    marks = Marks(
        x,
        curve.values,
        POINT_MARKS[curve.mark],
        colour,
        size=MARK_SIZES.get(curve.mark, 4.0),
        hollow=curve.mark == HOLLOW_MARK,
    )
    return [Uprights(x, low, high, colour), marks] if known else [marks]


def _numbers(figure: ZoomFigure) -> str:
    """The numbers as JSON that ends no element; what is as usual is left out."""
    told = {
        "unit": figure.unit,
        "x_name": figure.x_name,
        "group": figure.group,
        "title": figure.title if figure.panel else "",
        "circle": figure.circle,
        "log": figure.log,
        "limits": figure.limits,
        "x": _column(figure.time_s),
        "curves": [_curve_numbers(curve, colour) for curve, colour in _coloured(figure)],
        "spans": [{"start": start_s, "end": end_s} for start_s, end_s in figure.spans],
        "strips": [asdict(strip) for strip in figure.strips],
    }
    text = json.dumps(told, separators=(",", ":"), allow_nan=False)
    return text.replace("<", "\\u003c").replace("&", "\\u0026")


class _CurveNumbers(TypedDict, total=False):
    """A curve as the script of the page reads it."""

    name: str
    colour: str
    mark: str
    dashed: bool
    x: list[float | None]
    values: list[float | None]
    low: list[float | None]
    high: list[float | None]


def _curve_numbers(curve: ZoomCurve, colour: str) -> _CurveNumbers:
    found = _CurveNumbers(name=curve.name, colour=colour, values=_column(curve.values))
    if curve.mark:
        found["mark"] = curve.mark
    if curve.dashed:
        found["dashed"] = True
    if curve.x is not None:
        found["x"] = _column(curve.x)
    if curve.low is not None and curve.high is not None:
        found["low"], found["high"] = _column(curve.low), _column(curve.high)
    return found


def _coloured(figure: ZoomFigure) -> Iterator[tuple[ZoomCurve, str]]:
    for curve, colour in zip(figure.curves, cycle(CURVE_COLOURS)):
        yield curve, curve.colour or colour


def _column(values: NDArray) -> list[float | None]:
    """Rounded numbers, null where there is none."""
    return [float(f"{v:.{DIGITS}g}") if np.isfinite(v) else None for v in values.tolist()]
