"""Figures: panels of lines, bands, marks and boxes as specifications in JSON, which plotly draws.

A page holds a specification beside each figure, and the library once (`scripts/`, MIT licence,
fetches nothing); `result.plot()` hands the same specification to plotly's Python package.
Texts are escaped: plotly would obey tags in them.

Decision: docs/decisions/0088-plotly-draws.md.
"""

import json
import re
from base64 import b64encode
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from html import escape
from importlib.resources import files
from typing import Protocol, TypeAlias

import numpy as np
from markupsafe import Markup
from numpy.typing import ArrayLike, NDArray

from ins.robust import runs_of_true

MAX_POINTS = 2000  # of a curve
PANEL_POINTS = 1000  # of a curve in a panel: 4 for each pixel across, so that a reader can zoom
CURVE_POINTS = 121  # of a table's curve beside its nodes
MAX_DOTS = 700  # of a cloud: 2 or 3 for each pixel across a panel; each is an element of the page

BLACK, ORANGE, SKY, GREEN = "#000000", "#E69F00", "#56B4E9", "#009E73"
YELLOW, BLUE, VERMILLION, PURPLE = "#F0E442", "#0072B2", "#D55E00", "#CC79A7"
GREY, PALE = "#59636E", "#C9D1D9"
OLD, NEW = VERMILLION, BLUE  # the table before and the table after, everywhere
CURVE_COLOURS = (BLACK, GREEN, PURPLE, BLUE, VERMILLION, SKY, ORANGE, GREY)  # in turn
AXIS_COLOURS = {"x": BLACK, "y": GREEN, "z": PURPLE}


def thinned(
    *columns: ArrayLike | Sequence[float | None], most: int = MAX_POINTS
) -> tuple[NDArray, ...]:
    """Columns of equal length with at most so many rows kept, evenly, first and last among them;
    null is NaN.
    """
    arrays = [np.array(c, dtype=float) for c in columns]
    n = len(arrays[0])
    rows = np.unique(np.linspace(0, n - 1, min(n, most)).round().astype(int)) if n else np.arange(0)
    return tuple(a[rows] for a in arrays)


def drawn_temperatures(nodes_degC: NDArray) -> NDArray:
    """Where the curve of a table with these nodes (n,) is drawn: at them and evenly between."""
    return np.union1d(nodes_degC, np.linspace(nodes_degC[0], nodes_degC[-1], CURVE_POINTS))


def robust_limits(
    inner: ArrayLike, outer: ArrayLike = (), *, spans: float = 1.5
) -> tuple[float, float]:
    """Axis limits that hold all of `inner`, and `outer` (wide bands, vague points) as far as it
    goes `spans` beyond.
    """
    core = np.asarray(inner, dtype=float)
    core = core[np.isfinite(core)]
    if not core.size:
        return -1.0, 1.0
    low, high = float(core.min()), float(core.max())
    span = max(high - low, 1e-6 * max(abs(low), abs(high)), 1e-9)
    wide = np.asarray(outer, dtype=float)
    wide = np.clip(wide[np.isfinite(wide)], low - spans * span, high + spans * span)
    low, high = min([low, *wide.tolist()]), max([high, *wide.tolist()])
    pad = 0.06 * max(high - low, span)
    return low - pad, high + pad


Json: TypeAlias = bool | int | float | str | Sequence["Json"] | Mapping[str, "Json"] | None
Trace: TypeAlias = dict[str, Json]

EDGE_COLOUR, GRID_COLOUR, PAGE_COLOUR = "#8C959F", "#E3E8ED", "#FFFFFF"
INKS = {  # what the style sheet turns in the dark, by the names that it has there
    BLACK: "var(--ink)",
    OLD: "var(--old)",
    NEW: "var(--new)",
    SKY: "var(--sky)",  # in the dark the new one is as blue
    GREY: "var(--soft)",
    PALE: "var(--pale)",
    PAGE_COLOUR: "var(--page)",
    GRID_COLOUR: "var(--shade)",
}
MOST_PLAIN = 64  # chosen: 64 numbers of a column stand in digits, for a session has fewer points
DIGITS = 6  # significant ones of a number in the page: a pixel of a drawing is a thousandth of it
LETTER_PX, TITLE_PX = 12, 13
WIDE_PX, PANEL_PX = 320, 290  # height of a figure as wide as the page, and of one of several
ROW_PX, LINE_PX, FRAME_PX = 26, 14, 96  # of a row of bars; a line of its label; around the rows
DOT_PX = 1.6  # pixels to the unit of a mark's size
STACKED_LEFT_PX = 66  # numbers of six letters: fields below one another begin alike
LEAST_FIELD_PX, LABEL_PX = 160, 6  # beside labels of rows: of the field at least; of a letter
# letters of an axis' name before it goes on in another line; chosen: 52 of 7 pixels are a phone's
MOST_LETTERS, FEWEST_LETTERS = 52, 24
DASHED, DASH_DOT, DOTTED = "dash", "dashdot", "dot"
SAMPLE_DASHES = {"": "", DASHED: "5 3", DASH_DOT: "7 2 2 2", DOTTED: "2 2"}
KEY_PX = 60  # above several panels, with their titles
KEY_ABOVE: Trace = {"orientation": "h", "x": 0, "y": 1, "yref": "container", "yanchor": "top"}
BAND_OPACITY = 0.18  # two bands that overlap are still told apart
STRIP_SHARE = 0.05  # of a panel's height: a named stretch above it
DOT = "."  # a small mark: for clouds
MARKS = {
    "o": "circle",
    "s": "square",
    "^": "triangle-up",
    "v": "triangle-down",
    "D": "diamond",
    "x": "x-thin-open",
    "+": "cross-thin-open",
    DOT: "circle",
}
LINE_MARKS = {"x", "+"}  # they enclose nothing
SIGNS = {"s": "■", "^": "▲", "v": "▼", "D": "◆", "x": "×", "+": "+"}
DECADES_LABELLED = 4  # fewer than three decades are labelled at 2 and 5 as well
WHOLE_TURN_deg = 360.0
FINE_TURN_deg = 60.0  # a heading that spans less is labelled in tenths
ROOM_SHARE = 0.05  # of the data's span, left free at either end of an axis
BRACKETED = re.compile(r"\[([^\]]+)\]")  # in the name of an axis
FONT = "system-ui, 'Segoe UI', Roboto, 'Helvetica Neue', Arial, sans-serif"


class Item(Protocol):
    """What a panel draws; its name, where it has one, stands in the key."""

    @property
    def name(self) -> str:
        """In the key; empty for none."""

    def traces(self) -> list[Trace]:
        """As plotly draws it, without the axes."""

    def sample(self) -> Markup:
        """How the key shows it."""


def _column(values: ArrayLike) -> Json:
    """Rounded numbers, null where there is none; many of them packed, as plotly unpacks them."""
    found = np.asarray(values, dtype=float).ravel()
    if found.size > MOST_PLAIN:
        packed = b64encode(found.astype("<f4").tobytes()).decode()
        return {"dtype": "f4", "bdata": packed}
    return [float(f"{v:.{DIGITS}g}") if np.isfinite(v) else None for v in found.tolist()]


def _clear(colour: str, opacity: float) -> str:
    """A colour as one with an opacity, which no line or mark of the trace shares."""
    return f"{colour}{round(255 * opacity):02X}" if opacity < 1.0 else colour


def _svg(content: Markup) -> Markup:
    return Markup(
        '<svg viewBox="0 0 24 10" width="24" height="10" aria-hidden="true">{}</svg>'
    ).format(content)


def _area_sample(colour: str, opacity: float) -> Markup:
    rectangle = '<rect y="1" width="24" height="8" fill="{}" fill-opacity="{}"/>'
    return _svg(Markup(rectangle).format(INKS.get(colour, colour), opacity))


class _Edged:
    """What has values y (n,) and, about them, a band or bars from low to high."""

    y: NDArray
    low: NDArray | None
    high: NDArray | None

    @property
    def edges(self) -> tuple[NDArray, NDArray]:
        """Least and greatest (n,), the values themselves where there is neither."""
        low = self.y if self.low is None else self.low
        return low, self.y if self.high is None else self.high


@dataclass(frozen=True, eq=False)
class Line(_Edged):
    """A line through points (n,); low, high (n,): the edges of a band around it."""

    x: NDArray
    y: NDArray
    colour: str
    name: str = ""
    width: float = 1.5
    dash: str = ""
    low: NDArray | None = None
    high: NDArray | None = None

    def traces(self) -> list[Trace]:
        """The band below, and the line."""
        line: dict[str, Json] = {"color": self.colour, "width": self.width}
        if self.dash:
            line["dash"] = self.dash
        found: Trace = {"mode": "lines", "x": _column(self.x), "y": _column(self.y), "line": line}
        if self.low is None or self.high is None:
            return [found]
        return [*Band(self.x, self.low, self.high, self.colour, BAND_OPACITY).traces(), found]

    def sample(self) -> Markup:
        """A stretch of it."""
        path = '<path d="M0 5h24" stroke="{}" stroke-width="2" stroke-dasharray="{}"/>'
        colour, dash = INKS.get(self.colour, self.colour), SAMPLE_DASHES[self.dash]
        return _svg(Markup(path).format(colour, dash or "none"))


@dataclass(frozen=True, eq=False)
class Band:
    """The area between two lines over x (n,)."""

    x: NDArray
    low: NDArray
    high: NDArray
    colour: str
    opacity: float
    name: str = ""

    def traces(self) -> list[Trace]:
        """One closed line around each stretch of finite edges."""
        good = np.isfinite(self.x) & np.isfinite(self.low) & np.isfinite(self.high)
        gap = np.array([np.nan])
        x: list[NDArray] = []
        y: list[NDArray] = []
        for first, end in runs_of_true(good):
            there = slice(first, end)
            x += [self.x[there], self.x[there][::-1], gap]
            y += [self.high[there], self.low[there][::-1], gap]
        return [_area(x, y, _clear(self.colour, self.opacity))]

    def sample(self) -> Markup:
        """A piece of the area."""
        return _area_sample(self.colour, self.opacity)


def _area(
    x: Sequence[ArrayLike], y: Sequence[ArrayLike], colour: str, edge_px: float = 0.0
) -> Trace:
    """Closed lines that are filled, NaN between two of them."""
    return {
        "mode": "lines",
        "x": _column(np.concatenate(x)) if x else [],
        "y": _column(np.concatenate(y)) if y else [],
        "fill": "toself",
        "fillcolor": colour,
        "line": {"width": edge_px, "color": colour},
        "hoverinfo": "skip",
    }


@dataclass(frozen=True, eq=False)
class Marks(_Edged):
    """A mark (a key of MARKS) at each point (n,); low, high (n,): the ends of a bar through it."""

    x: NDArray
    y: NDArray
    mark: str
    colour: str
    name: str = ""
    size: float = 4.0
    hollow: bool = False
    low: NDArray | None = None
    high: NDArray | None = None

    def traces(self) -> list[Trace]:
        """The marks with their bars."""
        marker: dict[str, Json] = {
            "symbol": MARKS[self.mark] + ("-open" if self.hollow else ""),
            "color": self.colour,
            "size": round(DOT_PX * self.size, 1),
        }
        if self.hollow or self.mark in LINE_MARKS:
            marker["line"] = {"width": 1.4}
        found: Trace = {
            "mode": "markers",
            "x": _column(self.x),
            "y": _column(self.y),
            "marker": marker,
        }
        if self.low is not None and self.high is not None:
            found["error_y"] = {
                "type": "data",
                "symmetric": False,
                "array": _column(self.high - self.y),
                "arrayminus": _column(self.y - self.low),
                "color": self.colour,
                "thickness": 1,
                "width": 0,
            }
        return [found]

    def sample(self) -> Markup:
        """One mark."""
        sign = SIGNS.get(self.mark, "○" if self.hollow else "●")
        colour = INKS.get(self.colour, self.colour)
        text = '<text x="12" y="9" text-anchor="middle" font-size="12" fill="{}">{}</text>'
        return _svg(Markup(text).format(colour, sign))


@dataclass(frozen=True, eq=False)
class Uprights:
    """Upright bars from low to high at x (n,)."""

    x: NDArray
    low: NDArray
    high: NDArray
    colour: str
    width: float = 1.0
    opacity: float = 1.0
    name: str = ""

    def traces(self) -> list[Trace]:
        """One line with gaps."""
        gaps = np.full(len(self.x), np.nan)
        return [
            {
                "mode": "lines",
                "x": _column(np.stack([self.x, self.x, gaps], axis=-1)),
                "y": _column(np.stack([self.low, self.high, gaps], axis=-1)),
                "line": {"color": self.colour, "width": self.width},
                "opacity": self.opacity,
                "hoverinfo": "skip",
            }
        ]

    def sample(self) -> Markup:
        """One bar."""
        path = '<path d="M12 0v10" stroke="{}" stroke-width="{}" stroke-opacity="{}"/>'
        colour = INKS.get(self.colour, self.colour)
        return _svg(Markup(path).format(colour, max(self.width, 1.5), self.opacity))


@dataclass(frozen=True, eq=False)
class Boxes:
    """Rectangles from x to x and y to y: rows (left, right, bottom, top). least: width of their
    edge [px], so that a narrow one is seen.
    """

    rows: Sequence[tuple[float, float, float, float]]
    colour: str
    opacity: float = 1.0
    name: str = ""
    least: float = 0.0

    def traces(self) -> list[Trace]:
        """All of them as one trace."""
        x = [[a, b, b, a, a, np.nan] for a, b, _, _ in self.rows]
        y = [[c, c, d, d, c, np.nan] for _, _, c, d in self.rows]
        return [_area(x, y, _clear(self.colour, self.opacity), self.least)]

    def sample(self) -> Markup:
        """A piece of the area."""
        return _area_sample(self.colour, self.opacity)


@dataclass(frozen=True, eq=False)
class Cells:
    """Rectangles with a colour each, and what is said of one below the pointer: rows (left, right,
    bottom, top, colour, words).
    """

    rows: Sequence[tuple[float, float, float, float, str, str]]
    name: str = ""

    def traces(self) -> list[Trace]:
        """Bars on linear axes."""
        left, right, bottom, top, colours, words = zip(*self.rows)
        return [
            {
                "type": "bar",
                "x": _column(0.5 * (np.array(left) + np.array(right))),
                "width": _column(np.array(right) - np.array(left)),
                "base": _column(bottom),
                "y": _column(np.array(top) - np.array(bottom)),
                "marker": {"color": list(colours), "line": {"width": 0}},
                "hovertext": [escape(text) for text in words],
                "hoverinfo": "text" if any(words) else "skip",
            }
        ]

    def sample(self) -> Markup:
        """Nothing: a cell has words of its own."""
        return Markup()


@dataclass(frozen=True, eq=False)
class Texts:
    """Words in the drawing: rows (x, y, text, colour, bold), about y, from x on or about x."""

    rows: Sequence[tuple[float, float, str, str, bool]]
    middle: bool = True
    name: str = ""

    def traces(self) -> list[Trace]:
        """One trace of words."""
        texts = [escape(text, quote=False) for _, _, text, _, _ in self.rows]
        bold = [row[4] for row in self.rows]
        return [
            {
                "mode": "text",
                "x": _column([row[0] for row in self.rows]),
                "y": _column([row[1] for row in self.rows]),
                "text": [f"<b>{t}</b>" if heavy else t for t, heavy in zip(texts, bold)],
                "textposition": "middle center" if self.middle else "middle right",
                "textfont": {"color": [row[3] for row in self.rows], "size": LETTER_PX - 1},
                "cliponaxis": False,
                "hoverinfo": "skip",
            }
        ]

    def sample(self) -> Markup:
        """Nothing: words explain themselves."""
        return Markup()


@dataclass(frozen=True)
class ShadedSpan:
    """A stretch of x that is shaded, or a line where it begins and ends at once."""

    start: float
    end: float
    colour: str = GRID_COLOUR


@dataclass(frozen=True)
class Strip:
    """A named stretch of x: a coloured strip above a panel."""

    start: float
    end: float
    name: str
    colour: str


@dataclass(frozen=True)
class FarEdge:
    """Another scale of the same axis: values of the near one with their labels, and its name."""

    ticks: Sequence[tuple[float, str]]
    label: str


@dataclass(kw_only=True)
class Panel:
    """Axes and what they show, the first item at the bottom.

    limits None: by the items; from first to second, so (3, -1) counts downwards. ticks: value and
    label each, None for round numbers; step: of these, None for as many as find room. label: read
    aloud. spans: what is shaded; strips above the field. group: panels of one group zoom along x
    together. circle: values of y are degrees, labelled in [0, 360). upright: labels of x are
    turned; bare: no grid, ticks or edges; equal: one scale for x and y; far: ticks and a name of
    the top edge and of the right one. height, left [px]: of the panel; of its margin, at least.
    """

    items: list[Item] = field(default_factory=list)
    title: str = ""
    label: str = ""
    x_label: str = ""
    y_label: str = ""
    x_limits: tuple[float, float] | None = None
    y_limits: tuple[float, float] | None = None
    x_log: bool = False
    y_log: bool = False
    x_ticks: Sequence[tuple[float, str]] | None = None
    y_ticks: Sequence[tuple[float, str]] | None = None
    x_step: float | None = None
    y_step: float | None = None
    spans: Sequence[ShadedSpan] = ()
    strips: Sequence[Strip] = ()
    group: str = ""
    circle: bool = False
    grid_y: bool = True
    upright: bool = False
    bare: bool = False
    equal: bool = False
    far: tuple[FarEdge, FarEdge] | None = None
    height: int = 0
    left: int = 10


def rows_height(rows: int, lines: int = 1) -> int:
    """Height [px] of a panel with so many labelled rows, each label of so many lines."""
    return FRAME_PX + (ROW_PX + LINE_PX * (lines - 1)) * rows


def spanned(values: Sequence[NDArray]) -> tuple[float, float]:
    """Least and greatest of all, with room at either end."""
    found = np.concatenate([np.asarray(v, dtype=float).ravel() for v in values] or [np.zeros(0)])
    found = found[np.isfinite(found)]
    if not found.size:
        return 0.0, 1.0
    low, high = float(found.min()), float(found.max())
    span = high - low
    if span <= 1e-9 * max(abs(low), abs(high), 1e-9):
        half = 0.05 * max(abs(low), abs(high)) or 0.05
        return low - half, high + half
    return low - ROOM_SHARE * span, high + ROOM_SHARE * span


# ---- the specification


def specification(panels: Sequence[Panel], columns: int = 1) -> dict[str, Json]:
    """What plotly draws: traces and layout of the panels, so many side by side.

    One panel is what a page shows in a place of its own; several are what `result.plot()` gives,
    with a key.
    """
    data: list[Json] = []
    layout = _common_layout()
    shapes: list[Json] = []
    named: set[str] = set()
    rows = -(-len(panels) // columns)
    for number, panel in enumerate(panels):
        suffix = str(number + 1) if number else ""
        for item in panel.items:
            data += _drawn(item, panel, suffix, named)
        layout |= _axes(panel, suffix, columns, rows, number)
        if panel.far:
            data.append({"x": [None], "y": [None], "xaxis": "x9", "yaxis": "y9"})
        shapes += _shapes(panel, suffix)
    layout["shapes"] = shapes
    _titles(layout, panels, columns, rows)
    return {"data": data, "layout": layout}


def _common_layout() -> dict[str, Json]:
    return {
        "font": {"family": FONT, "size": LETTER_PX, "color": BLACK},
        "paper_bgcolor": PAGE_COLOUR,
        "plot_bgcolor": PAGE_COLOUR,
        "hoverlabel": {
            "bgcolor": PAGE_COLOUR,
            "bordercolor": EDGE_COLOUR,
            "font": {"color": BLACK, "size": LETTER_PX},
            "namelength": -1,
        },
        "barmode": "overlay",
        "bargap": 0,
        "showlegend": False,
        "autosize": True,
    }


def _drawn(item: Item, panel: Panel, suffix: str, named: set[str]) -> list[Json]:
    """The traces of an item with their axes, name and words; the first of a name in the key."""
    found: list[Json] = []
    name = escape(item.name, quote=False)
    for trace in item.traces():
        whole: Trace = {"type": "scatter", "showlegend": False, **trace}
        if suffix:
            whole |= {"xaxis": f"x{suffix}", "yaxis": f"y{suffix}"}
        if "hoverinfo" not in trace:
            whole["hovertemplate"] = _said(panel, named=bool(name))
            if panel.circle and isinstance(item, Line):
                whole["customdata"] = _column(item.y % WHOLE_TURN_deg)
        if name:
            whole |= {"name": name, "legendgroup": name, "meta": item.name}
        found.append(whole)
    if name and found and name not in named:
        named.add(name)
        last = found[-1]
        assert isinstance(last, dict)
        last["showlegend"] = True
    return found


def _said(panel: Panel, *, named: bool) -> str:
    """What stands beside the pointer: x and y with their units."""
    ways = ("%{x:.6~g}", "%{customdata:.6~g}" if panel.circle else "%{y:.5~g}")
    units = (BRACKETED.search(panel.x_label), BRACKETED.search(panel.y_label))
    texts = [
        way + (f" {escape(unit[1], quote=False)}" if unit else "") for way, unit in zip(ways, units)
    ]
    name = "%{fullData.name}" if named else ""
    return f"{texts[0]}<br>{texts[1]}<extra>{name}</extra>"


def _axes(panel: Panel, suffix: str, columns: int, rows: int, number: int) -> dict[str, Json]:
    """Both axes of a panel, and those of its far edges."""
    beside = _longest_label(panel)  # takes from the width
    x = _axis(
        _lines(panel.x_label, max(MOST_LETTERS - beside, FEWEST_LETTERS)),
        panel.x_limits,
        panel.x_ticks,
        log=panel.x_log,
        bare=panel.bare,
    )
    y = _axis(
        _lines(panel.y_label, MOST_LETTERS),
        panel.y_limits,
        panel.y_ticks,
        log=panel.y_log,
        bare=panel.bare,
    )
    x["anchor"], y["anchor"] = f"y{suffix}", f"x{suffix}"
    for axis, step in ((x, panel.x_step), (y, panel.y_step)):
        if step is not None:
            axis |= {"tick0": 0, "dtick": step}
    if panel.upright:
        x["tickangle"] = -90
    if not panel.grid_y:
        y["showgrid"] = False
    if panel.circle:
        y["labelalias"] = _turns(panel)
    if panel.equal:
        y |= {"scaleanchor": f"x{suffix}", "scaleratio": 1}
    if columns * rows > 1:
        x["domain"], y["domain"] = _domains(columns, rows, number)
    found: dict[str, Json] = {f"xaxis{suffix}": x, f"yaxis{suffix}": y}
    if panel.far:
        for way, side, edge, near in (
            ("x", "top", panel.far[0], panel.x_limits),
            ("y", "right", panel.far[1], panel.y_limits),
        ):
            found[f"{way}axis9"] = _axis(
                _lines(edge.label, MOST_LETTERS), near, edge.ticks, log=False, bare=False
            ) | {
                "side": side,
                "overlaying": way,
                "matches": way,
                "anchor": "y" if way == "x" else "x",
                "showgrid": False,
            }
    return found


def _axis(
    label: str,  # escaped
    limits: tuple[float, float] | None,
    ticks: Sequence[tuple[float, str]] | None,
    *,
    log: bool,
    bare: bool,
) -> dict[str, Json]:
    found: dict[str, Json] = {
        "automargin": True,
        "zeroline": False,
        "showline": not bare,
        "linecolor": EDGE_COLOUR,
        "gridcolor": GRID_COLOUR,
        "showgrid": not bare,
        "ticks": "" if bare else "outside",
        "ticklen": 4,
        "tickcolor": EDGE_COLOUR,
        "exponentformat": "power",
        "minexponent": 5,
    }
    if label:
        found["title"] = {"text": label, "standoff": 6}
    if log:
        found |= {"type": "log", "exponentformat": "none", "nticks": DECADES_LABELLED}
    if limits is not None:
        ends = np.log10(limits) if log else np.array(limits, dtype=float)
        found["range"] = [float(end) for end in ends]
    if ticks is not None:
        found["tickmode"] = "array"
        found["tickvals"] = [float(value) for value, _ in ticks]
        lines = [escape(text, quote=False).replace("\n", "<br>") for _, text in ticks]
        found["ticktext"] = lines
    return found


def _lines(text: str, longest: int) -> str:
    """A name of an axis, broken where a phone's width ends."""
    lines = [""]
    for word in text.split(" "):
        if lines[-1] and len(lines[-1]) + len(word) > longest:
            lines.append("")
        lines[-1] += f" {word}" if lines[-1] else word
    return "<br>".join(escape(line, quote=False) for line in lines)


def _turns(panel: Panel) -> dict[str, Json]:
    """Labels of a heading that goes on beyond north: what it would be in [0, 360)."""
    seen = [np.asarray(getattr(item, "y", [])) for item in panel.items]
    low, high = panel.y_limits or spanned(seen)
    steps = 1 if high - low > FINE_TURN_deg else 10
    labels: dict[str, Json] = {}
    for k in range(int(np.floor(low)) * steps, int(np.ceil(high)) * steps + 1):
        value = k / steps
        if 0.0 <= value < WHOLE_TURN_deg:
            continue
        text, turned = f"{value:.10g}".replace("-", "\u2212"), f"{value % WHOLE_TURN_deg:.10g}"
        labels[text] = turned
        if steps > 1 and value == round(value):
            labels[f"{text}.0"] = turned  # beside labels in tenths
    return labels


def _domains(columns: int, rows: int, number: int) -> tuple[list[Json], list[Json]]:
    """Shares of a figure that the field of a panel has across and up."""
    row, column = divmod(number, columns)
    wide, tall = 1.0 / columns, 1.0 / rows
    gap_x, gap_y = (0.22 * wide if columns > 1 else 0.0), (0.3 * tall if rows > 1 else 0.0)
    left, top = column * (wide + gap_x / columns), 1.0 - row * (tall + gap_y / rows)
    width = wide - gap_x * (columns - 1) / columns
    height = tall - gap_y * (rows - 1) / rows
    return [left, min(left + width, 1.0)], [max(top - height, 0.0), top]


def _shapes(panel: Panel, suffix: str) -> list[Json]:
    """Shaded stretches and strips."""
    stretches = [(span.start, span.end, span.colour, 0.0, 1.0) for span in panel.spans]
    for strip in panel.strips:
        stretches.append((strip.start, strip.end, strip.colour, 1.0, 1.0 + STRIP_SHARE))
    return [
        {
            "type": "rect",
            "xref": f"x{suffix}",
            "yref": f"y{suffix} domain",
            "x0": float(start),
            "x1": float(end),
            "y0": foot,
            "y1": top,
            "fillcolor": colour,
            "line": {"width": 1, "color": colour},
            "layer": "below",
        }
        for start, end, colour, foot, top in stretches
    ]


def _titles(layout: dict[str, Json], panels: Sequence[Panel], columns: int, rows: int) -> None:
    """A title above each panel, the margins, the height, and a key where there are several."""
    title_font: dict[str, Json] = {"size": TITLE_PX, "weight": 600}
    if len(panels) == 1:
        (panel,) = panels
        top = 30 if panel.title else 10
        layout["margin"] = {"l": panel.left, "r": 14, "t": top, "b": 10}
        layout["height"] = panel.height or PANEL_PX
        if panel.title:
            layout["title"] = {
                "text": escape(panel.title, quote=False),
                "font": title_font,
                "x": 0,
                "xref": "container",
                "xanchor": "left",
                "y": 1,
                "yref": "container",
                "yanchor": "top",
                "pad": {"t": 6},
            }
        return
    annotations: list[Json] = []
    for number, panel in enumerate(panels):
        x, y = _domains(columns, rows, number)
        annotations.append(
            {
                "text": escape(panel.title, quote=False),
                "font": title_font,
                "x": x[0],
                "y": y[1],
                "xref": "paper",
                "yref": "paper",
                "xanchor": "left",
                "yanchor": "bottom",
                "showarrow": False,
            }
        )
    layout["annotations"] = annotations
    layout["margin"] = {"l": 10, "r": 14, "t": KEY_PX, "b": 10}
    layout["height"] = rows * PANEL_PX + KEY_PX
    layout["showlegend"] = True
    layout["legend"] = dict(KEY_ABOVE)


# ---- elements of a page


def figure(panel: Panel, caption: str = "") -> Markup:
    """A figure as wide as the page, its key above it; `page_script` is needed once on the page."""
    panel.height = panel.height or WIDE_PX
    return Markup('<div class="plots">{}{}</div>').format(
        _key([panel]), _element(panel, "wide ", caption)
    )


def panels(shown: Iterable[Panel], caption: str = "") -> Markup:
    """Figures side by side, one below the other on a phone, and above them one key."""
    held = list(shown)
    return Markup('<div class="plots">{}{}<div class="panels">{}</div></div>').format(
        Markup('<p class="soft">{}</p>').format(caption) if caption else "",
        _key(held),
        Markup("").join(_element(panel) for panel in held),
    )


def stack(shown: Iterable[Panel], caption: str = "") -> Markup:
    """Figures as wide as the page, one below the other, with one key."""
    held = list(shown)
    for panel in held:
        panel.left = STACKED_LEFT_PX
    return Markup('<div class="plots">{}{}{}</div>').format(
        _key(held),
        Markup("").join(_element(panel, "wide ") for panel in held),
        Markup('<p class="soft">{}</p>').format(caption) if caption else "",
    )


def _element(panel: Panel, look: str = "", caption: str = "") -> Markup:
    """A place for the drawing, and its specification."""
    label = panel.label or panel.title or panel.y_label
    return Markup(
        '<figure class="{}plot" data-group="{}" data-least="{}"><div class="scroll"><div'
        ' class="drawing" role="img" aria-label="{}"></div></div>'
        '<script type="application/json">{}</script>{}</figure>'
    ).format(
        look,
        f"{panel.group} {panel.x_label}" if panel.group else "",
        _least_px(panel),
        label,
        Markup(_inert(specification([panel]))),
        Markup("<figcaption>{}</figcaption>").format(caption) if caption else "",
    )


def _least_px(panel: Panel) -> int:
    """Below this width a drawing scrolls: a row's label would leave no room for the row."""
    return LEAST_FIELD_PX + LABEL_PX * _longest_label(panel)


def _longest_label(panel: Panel) -> int:
    """Letters of the longest line among the labels of rows."""
    labels = [text for _, text in panel.y_ticks or ()]
    return max((len(line) for text in labels for line in text.split("\n")), default=0)


def _inert(value: Json) -> str:
    """JSON that ends no element of a page."""
    text = json.dumps(value, separators=(",", ":"), allow_nan=False)
    return text.replace("<", "\\u003c").replace("&", "\\u0026")


def _names(shown: Sequence[Panel]) -> list[str]:
    """Of what the panels draw, each once; one that a panel adds follows what stands before it
    there, else all.
    """
    names: list[str] = []
    for panel in shown:
        place = len(names)
        for name in [item.name for item in panel.items if item.name]:
            if name not in names:
                names.insert(place, name)
            place = names.index(name) + 1
    return names


def _key(shown: Sequence[Panel]) -> Markup:
    """Each name of the panels with a sample, once; a press hides and shows what it names."""
    drawn: dict[str, Markup] = {}
    for panel in shown:
        for item in panel.items:
            if item.name:
                drawn.setdefault(item.name, item.sample())
    samples = {name: drawn[name] for name in _names(shown)}
    named = len(samples)
    for strip in (strip for panel in shown for strip in panel.strips):
        samples.setdefault(strip.name, _area_sample(strip.colour, 1.0))
    if len(samples) < 2:
        return Markup()
    button = Markup('<button type="button" aria-pressed="true" data-name="{1}">{0}{1}</button>')
    rows = []
    for number, (name, sample) in enumerate(samples.items()):
        shown_so = button.format(sample, name) if number < named else sample + name
        rows.append(Markup("<li>{}</li>").format(shown_so))
    return Markup('<ul class="key">{}</ul>').format(Markup("").join(rows))


SCRIPTS = ("plotly-basic.min.js", "figures.js")


@lru_cache(maxsize=1)
def script_texts() -> tuple[str, ...]:
    """The library, and what shows a page's figures with it."""
    folder = files("infield.reports") / "scripts"
    return tuple((folder / name).read_text("utf-8") for name in SCRIPTS)


@lru_cache(maxsize=1)
def page_script() -> Markup:
    """Both as elements for the end of a page, and what is said where no script runs."""
    elements = "".join(f"<script>{text}</script>\n" for text in script_texts())
    return Markup(elements)
