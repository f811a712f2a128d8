"""Charts as inline SVG, written here: panels of lines, bands, marks and bars, one below the other.

Every drawing of a page goes this way: matplotlib took 40 % of the CPU of an update. Lengths are
points of the drawing, 72 to the inch; it fetches nothing, and equal charts give equal text.

Decision: docs/decisions/0074-charts-as-svg.md.
"""

import hashlib
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np
from markupsafe import Markup, escape
from numpy.typing import ArrayLike, NDArray

from infield.reports.figures import (
    FIGURE_WIDTH,
    LEAST_LETTER_PX,
    LETTER,
    PANEL_HEIGHT,
    PANEL_WIDTH,
    SVG_DPI,
)
from ins.robust import runs_of_true
from ins.verdicts import LARGEST_PLAIN

EDGE_COLOUR, GRID_COLOUR = "#8C959F", "#E3E8ED"
TITLE_PT = 10.0
LINE_PT = 1.25 * LETTER  # from one line of text to the next
TICK_PT, GAP_PT = 3.5, 4.0  # a tick's length; between tick, label and title
FAR_PT = TICK_PT + 3 * GAP_PT + 2 * LETTER  # ticks, numbers and name of a far edge
ROOM_SHARE = 0.05  # of the data's span, left free at either end of an axis
BESIDE_HANDLE_PT, HANDLE_PT = 17.0, 19.0  # length of a line in a legend
ROUND_STEPS = (1.0, 2.0, 2.5, 5.0, 10.0)
MOST_ALONG_AXIS = 9
FEWEST_TICKS = 2  # 1 says where it is, and no scale
# chosen: 0.0001 is six letters, a tenth of a panel; labels of smaller steps have an exponent
LEAST_PLAIN = 1e-4
# Advance of DejaVu Sans in parts of the letter size, which the style sheet asks for.
LETTER_ADVANCE = {
    " ": 0.32,
    ".": 0.32,
    ",": 0.32,
    ":": 0.34,
    "i": 0.28,
    "l": 0.28,
    "j": 0.28,
    "t": 0.39,
}
LETTER_ADVANCE |= {"f": 0.35, "r": 0.41, "(": 0.39, ")": 0.39, "[": 0.39, "]": 0.39, "/": 0.34}
LETTER_ADVANCE |= {"\u2212": 0.84, "m": 0.97, "w": 0.82, "W": 0.99, "M": 0.86, "°": 0.5, "-": 0.36}
USUAL_ADVANCE, CAPITAL_ADVANCE = 0.62, 0.7
DASHED, DASH_DOT, DOTTED = "5.5 2.4", "9.6 2.4 1.5 2.4", "1.5 2.4"
DOT = "."  # a mark that is one point of a path: for clouds
# chosen: 1e-300, in place of what has no logarithm: far outside of every drawing
LEAST_POSITIVE = 1e-300


def text_width(text: str, letter: float = LETTER) -> float:
    """About how long a text is drawn."""
    advances = (
        LETTER_ADVANCE.get(c, CAPITAL_ADVANCE if c.isupper() else USUAL_ADVANCE) for c in text
    )
    return letter * sum(advances)


@dataclass(frozen=True)
class Place:
    """Where a panel's axes lie in the drawing, and what values its edges stand for."""

    left: float
    top: float
    width: float
    height: float
    x: tuple[float, float]
    y: tuple[float, float]
    x_log: bool = False
    y_log: bool = False

    def across(self, values: ArrayLike) -> NDArray:
        """Values of x as points of the drawing."""
        return self.left + self.width * _share(values, self.x, self.x_log)

    def down(self, values: ArrayLike) -> NDArray:
        """Values of y as points of the drawing."""
        return self.top + self.height * (1.0 - _share(values, self.y, self.y_log))


def _share(values: ArrayLike, limits: tuple[float, float], log: bool) -> NDArray:
    """How far along an axis values lie: 0 at its first limit, 1 at its second."""
    (first, second), seen = limits, np.asarray(values, dtype=float)
    if log:
        first, second = math.log10(first), math.log10(second)
        seen = np.log10(np.maximum(seen, LEAST_POSITIVE))
    return (seen - first) / (second - first)


class Item(Protocol):
    """What a panel draws; its name, where it has one, stands in the legend."""

    @property
    def name(self) -> str:
        """In the legend; empty for none."""

    def extent(self) -> tuple[NDArray, NDArray]:
        """Values of x and of y that the axes must show."""

    def drawn(self, place: Place) -> str:
        """As SVG."""

    def sample(self, x: float, y: float, length: float) -> str:
        """As SVG, for the legend: about y from x on."""


def _path(x: NDArray, y: NDArray) -> str:
    """Move and line commands through the points, to 0.1 of a point; not finite ones are left
    out, and those in the middle of a straight stretch.
    """
    x, y = np.round(x, 1), np.round(y, 1)
    parts = []
    for first, end in runs_of_true(np.isfinite(x) & np.isfinite(y)):
        px, py = _corners(x[first:end], y[first:end])
        points = [f"{a:g} {b:g}" for a, b in zip(px.tolist(), py.tolist())]
        parts.append("M" + "L".join(points if len(points) > 1 else points * 2))
    return "".join(parts)


def _corners(x: NDArray, y: NDArray) -> tuple[NDArray, NDArray]:
    """Without repeated points, and without those where y goes on as it was."""
    if len(x) < 3:
        return x, y
    moved = np.concatenate([[True], (np.diff(x) != 0) | (np.diff(y) != 0)])
    x, y = x[moved], y[moved]
    if len(x) < 3:
        return x, y
    flat = (y[1:-1] == y[:-2]) & (y[1:-1] == y[2:])
    upright = (x[1:-1] == x[:-2]) & (x[1:-1] == x[2:])
    between = (y[1:-1] - y[:-2]) * (y[2:] - y[1:-1]) >= 0
    keep = np.concatenate([[True], ~(flat | (upright & between)), [True]])
    return x[keep], y[keep]


@dataclass(frozen=True, eq=False)
class Line:
    """A line through points (n,)."""

    x: NDArray
    y: NDArray
    colour: str
    name: str = ""
    width: float = 1.5
    dash: str = ""

    def extent(self) -> tuple[NDArray, NDArray]:
        """All points."""
        return self.x, self.y

    def drawn(self, place: Place) -> str:
        """One path."""
        return self._element(_path(place.across(self.x), place.down(self.y)))

    def sample(self, x: float, y: float, length: float) -> str:
        """A stretch of it."""
        return self._element(f"M{x:.1f} {y:.1f}h{length:.1f}")

    def _element(self, path: str) -> str:
        dash = f' stroke-dasharray="{self.dash}"' if self.dash else ""
        return (
            f'<path d="{path}" fill="none" stroke="{self.colour}"'
            f' stroke-width="{self.width:g}"{dash}/>'
        )


@dataclass(frozen=True, eq=False)
class Band:
    """The area between two lines over x (n,)."""

    x: NDArray
    low: NDArray
    high: NDArray
    colour: str
    opacity: float
    name: str = ""

    def extent(self) -> tuple[NDArray, NDArray]:
        """Both edges."""
        return self.x, np.concatenate([self.low, self.high])

    def drawn(self, place: Place) -> str:
        """One closed path for each stretch of finite edges."""
        good = np.isfinite(self.x) & np.isfinite(self.low) & np.isfinite(self.high)
        across, low, high = place.across(self.x), place.down(self.low), place.down(self.high)
        path = ""
        for first, end in runs_of_true(good):
            there = slice(first, end)
            x = np.concatenate([across[there], across[there][::-1]])
            path += _path(x, np.concatenate([high[there], low[there][::-1]])) + "Z"
        return f'<path d="{path}" fill="{self.colour}" fill-opacity="{self.opacity:g}"/>'

    def sample(self, x: float, y: float, length: float) -> str:
        """A piece of the area."""
        return _rectangle(x, y - 3.5, length, 7.0, self.colour, self.opacity)


MARK_SHAPES = {  # about 0 0, of size 1
    "o": "M-.5 0a.5 .5 0 1 0 1 0a.5 .5 0 1 0 -1 0Z",
    "s": "M-.5 -.5h1v1h-1Z",
    "^": "M0 -.5L.5 .5H-.5Z",
    "v": "M0 .5L.5 -.5H-.5Z",
    "D": "M0 -.7L.7 0L0 .7L-.7 0Z",
    "x": "M-.5 -.5L.5 .5M-.5 .5L.5 -.5",
    "+": "M-.5 0H.5M0 -.5V.5",
}
LINE_MARKS = {"x", "+"}  # they enclose nothing


@dataclass(frozen=True, eq=False)
class Marks:
    """A mark (a key of MARK_SHAPES, or DOT) at each point (n,)."""

    x: NDArray
    y: NDArray
    mark: str
    colour: str
    name: str = ""
    size: float = 4.0
    hollow: bool = False

    def extent(self) -> tuple[NDArray, NDArray]:
        """All points."""
        return self.x, self.y

    def drawn(self, place: Place) -> str:
        """One path of all marks."""
        return self._element(place.across(self.x), place.down(self.y))

    def sample(self, x: float, y: float, length: float) -> str:
        """One mark."""
        return self._element(np.array([x + 0.5 * length]), np.array([y]))

    def _element(self, x: NDArray, y: NDArray) -> str:
        good = np.isfinite(x) & np.isfinite(y)
        if self.mark == DOT:
            path = "".join(
                f"M{a:.1f} {b:.1f}h0" for a, b in zip(x[good].tolist(), y[good].tolist())
            )
            return (
                f'<path class="dots" d="{path}" fill="none" stroke="{self.colour}"'
                f' stroke-linecap="round" stroke-width="{self.size:g}"/>'
            )
        outline = self.hollow or self.mark in LINE_MARKS
        fill = "none" if outline else self.colour
        shape = MARK_SHAPES[self.mark]
        uses = "".join(
            f'<path transform="translate({a:.1f} {b:.1f})scale({self.size:g})" d="{shape}"/>'
            for a, b in zip(x[good].tolist(), y[good].tolist())
        )
        edge = f' stroke="{self.colour}" stroke-width="{0.9 / self.size:.2f}"' if outline else ""
        return f'<g class="marks" fill="{fill}"{edge}>{uses}</g>'


@dataclass(frozen=True, eq=False)
class Uprights:
    """Upright bars from low to high at x (n,)."""

    x: NDArray
    low: NDArray
    high: NDArray
    colour: str
    width: float = 0.7
    opacity: float = 1.0
    name: str = ""

    def extent(self) -> tuple[NDArray, NDArray]:
        """All ends."""
        return self.x, np.concatenate([self.low, self.high])

    def drawn(self, place: Place) -> str:
        """One path."""
        rows = zip(
            place.across(self.x).tolist(),
            place.down(self.low).tolist(),
            place.down(self.high).tolist(),
        )
        path = "".join(f"M{x:.1f} {a:.1f}V{b:.1f}" for x, a, b in rows if np.isfinite(x + a + b))
        return (
            f'<path d="{path}" fill="none" stroke="{self.colour}" stroke-width="{self.width:g}"'
            f' stroke-opacity="{self.opacity:g}"/>'
        )

    def sample(self, x: float, y: float, length: float) -> str:
        """One bar."""
        middle = x + 0.5 * length
        return f'<path d="M{middle:.1f} {y - 4:.1f}v8" stroke="{self.colour}"/>'


def _rectangle(x: float, y: float, width: float, height: float, colour: str, alpha: float) -> str:
    return (
        f'<rect x="{x:.1f}" y="{y:.1f}" width="{max(width, 0.0):.1f}" height="{height:.1f}"'
        f' fill="{colour}" fill-opacity="{alpha:g}"/>'
    )


@dataclass(frozen=True, eq=False)
class Boxes:
    """Rectangles from x to x and y to y: rows (left, right, bottom, top); bottom and top None reach
    over the panel's whole height. least: their least width.
    """

    rows: Sequence[tuple[float, float, float | None, float | None]]
    colour: str
    opacity: float = 1.0
    name: str = ""
    least: float = 0.0

    def extent(self) -> tuple[NDArray, NDArray]:
        """Edges that were given."""
        x = [value for row in self.rows for value in row[:2]]
        y = [value for row in self.rows for value in row[2:] if value is not None]
        return np.array(x), np.array(y)

    def drawn(self, place: Place) -> str:
        """A rectangle each."""
        found = ""
        for left, right, bottom, top in self.rows:
            x, end = place.across([left, right]).tolist()
            low = place.y[0] if bottom is None else bottom
            high = place.y[1] if top is None else top
            y, foot = sorted(place.down([low, high]).tolist())
            width = max(end - x, self.least)
            found += _rectangle(x, y, width, foot - y, self.colour, self.opacity)
        return found

    def sample(self, x: float, y: float, length: float) -> str:
        """A piece of the area."""
        return _rectangle(x, y - 3.5, length, 7.0, self.colour, self.opacity)


@dataclass(frozen=True, eq=False)
class Texts:
    """Words in the drawing: rows (x, y, text, colour, bold), about y, from x on or about x."""

    rows: Sequence[tuple[float, float, str, str, bool]]
    middle: bool = True
    name: str = ""

    def extent(self) -> tuple[NDArray, NDArray]:
        """Where they stand."""
        return np.array([row[0] for row in self.rows]), np.array([row[1] for row in self.rows])

    def drawn(self, place: Place) -> str:
        """A text each."""
        found, anchor = "", "middle" if self.middle else "start"
        for x, y, text, colour, bold in self.rows:
            more = f' fill="{colour}"' + (' font-weight="bold"' if bold else "")
            down = float(place.down(y)) + 0.36 * LETTER
            found += _text(float(place.across(x)), down, text, anchor, more)
        return found

    def sample(self, x: float, y: float, length: float) -> str:
        """Nothing: words explain themselves."""
        return ""


@dataclass(kw_only=True)
class Panel:
    """Axes and what they show, the first item at the bottom.

    share: of the chart's height beside the other panels; limits None: by the items. ticks: value
    and label each, None for round numbers; circle: values of y are degrees, labelled in [0, 360).
    legend: "" (none), "above" (the whole chart), "beside" the panel or "below" the chart.
    upright: labels of x are turned by 90 deg; bare: no grid, ticks or edges. equal: one scale for x
    and y; far: ticks and a name of the top edge and of the right one.
    """

    items: list[Item] = field(default_factory=list)
    title: str = ""
    x_label: str = ""
    y_label: str = ""
    share: float = 1.0
    x_limits: tuple[float, float] | None = None
    y_limits: tuple[float, float] | None = None
    x_log: bool = False
    y_log: bool = False
    x_ticks: Sequence[tuple[float, str]] | None = None
    y_ticks: Sequence[tuple[float, str]] | None = None
    x_step: float | None = None
    y_step: float | None = None
    x_room: float = ROOM_SHARE
    circle: bool = False
    grid_y: bool = True
    legend: str = ""
    upright: bool = False
    bare: bool = False
    equal: bool = False
    far: tuple["FarEdge", "FarEdge"] | None = None

    @property
    def named(self) -> list[Item]:
        """What the legend lists."""
        return [item for item in self.items if item.name]

    def limits(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Of x and of y."""
        extents = [item.extent() for item in self.items]
        return (
            self.x_limits or spanned([x for x, _ in extents], self.x_room, self.x_log),
            self.y_limits or spanned([y for _, y in extents], ROOM_SHARE, self.y_log),
        )


@dataclass(frozen=True)
class FarEdge:
    """Another scale of the same axis: values of the near one with their labels, and its name."""

    ticks: Sequence[tuple[float, str]]
    label: str


def spanned(
    values: Sequence[NDArray], room: float = ROOM_SHARE, log: bool = False
) -> tuple[float, float]:
    """Least and greatest of all, with room at either end; positive ones where `log`."""
    found = np.concatenate([np.asarray(v, dtype=float).ravel() for v in values] or [np.zeros(0)])
    found = found[np.isfinite(found)]
    if log:
        decades = np.log10(found[found > LEAST_POSITIVE])
        low, high = spanned([decades], room) if decades.size else (-1.0, 0.0)
        return 10.0**low, 10.0**high
    if not found.size:
        return 0.0, 1.0
    low, high = float(found.min()), float(found.max())
    span = high - low
    if span <= 1e-9 * max(abs(low), abs(high), 1e-9):
        half = 0.05 * max(abs(low), abs(high)) or 0.05
        return low - half, high + half
    return low - room * span, high + room * span


def round_step(span: float, most: int) -> float:
    """The least round step that makes at most so many of the span."""
    raw = span / max(most, 1)
    decade = 10.0 ** math.floor(math.log10(raw))
    return next(decade * s for s in ROUND_STEPS if decade * s >= raw * (1.0 - 1e-9))


def ticks_of(limits: tuple[float, float], step: float) -> list[float]:
    """Multiples of the step within the limits."""
    low, high = limits
    first, last = math.ceil(low / step - 1e-6), math.floor(high / step + 1e-6)
    return [k * step for k in range(first, last + 1)]


WHOLE_TURN_deg = 360.0  # in [0, 360) all its multiples are 0


def tick_labels(values: Sequence[float], step: float, *, circle: bool = False) -> list[str]:
    """Numbers to the digits that the step needs, with a true minus. Whole turns of a circle are
    told as such: each of them would be 0.
    """
    if circle and step < WHOLE_TURN_deg:
        return [f"{round(value, 4) % 360.0:g}" for value in values]
    most = max((abs(value) for value in values), default=0.0)
    if most >= LARGEST_PLAIN or step < LEAST_PLAIN:
        texts = [f"{value:.4g}" for value in values]
    else:
        decimals = max(0, -math.floor(math.log10(step) + 1e-9))
        # of a step of 2.5 the second digit counts as well
        decimals += round(step / 10.0**-decimals, 6) % 1.0 > 0.0
        texts = [f"{value:.{decimals}f}" for value in values]
    return [text.replace("-", "\u2212") for text in texts]


_Ticks = Sequence[tuple[float, str]]


def _y_ticks(panel: Panel, limits: tuple[float, float], height: float) -> _Ticks:
    if panel.y_ticks is not None:
        return list(panel.y_ticks)
    most = int(np.clip(height / (2.0 * LETTER), 1, MOST_ALONG_AXIS))
    if panel.y_log:
        return log_ticks(limits, most)
    step = panel.y_step or round_step(limits[1] - limits[0], most)
    values = ticks_of(limits, step)
    return list(zip(values, tick_labels(values, step, circle=panel.circle)))


def _x_ticks(panel: Panel, limits: tuple[float, float], width: float) -> _Ticks:
    """As many as stand beside each other."""
    if panel.x_ticks is not None:
        return list(panel.x_ticks)
    for most in range(MOST_ALONG_AXIS, 0, -1):
        ticks = log_ticks(limits, most) if panel.x_log else round_ticks(limits, most, panel.x_step)
        if sum(text_width(label) + LETTER for _, label in ticks) <= width:
            break
    return ticks


def round_ticks(
    limits: tuple[float, float], most: int, step: float | None = None
) -> list[tuple[float, str]]:
    """At most so many round numbers within the limits, and one more; or multiples of a step."""
    step = step or round_step(limits[1] - limits[0], most)
    values = ticks_of(limits, step)
    return list(zip(values, tick_labels(values, step)))


def whole_step(span: float, most: int) -> float:
    """The least round step between whole numbers that makes at most so many of the span."""
    return max(1.0, float(math.ceil(round_step(span, most))))


def log_ticks(limits: tuple[float, float], most: int = MOST_ALONG_AXIS) -> list[tuple[float, str]]:
    """Ticks of a logarithmic axis: 1, 2 and 5 of each decade, 1 alone or whole decades farther
    apart, the first of these with at most so many of them; round numbers where there is no decade
    to stand in.
    """
    low, high = limits
    first, last = math.floor(math.log10(low)), math.ceil(math.log10(high))
    decades = range(first, last + 1)
    for steps, apart in (((1, 2, 5), 1), ((1, 3), 1), *(((1,), n) for n in range(1, len(decades)))):
        # not 10.0**k: 10.0**-4 * 1 is 1e-04 with a last digit of its own
        values = [float(f"{m}e{k}") for k in decades if k % apart == 0 for m in steps]
        values = [value for value in values if low * (1 - 1e-9) <= value <= high * (1 + 1e-9)]
        if len(values) <= most:
            break
    if len(values) < FEWEST_TICKS:
        return round_ticks(limits, max(most - 1, FEWEST_TICKS))
    return [(value, f"{value:g}".replace("-", "\u2212")) for value in values]


def _text(x: float, y: float, text: str, anchor: str = "middle", more: str = "") -> str:
    return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}"{more}>{escape(text)}</text>'


def _upright(x: float, y: float, text: str, anchor: str = "middle") -> str:
    """Read from below."""
    return _text(x, y, text, anchor, f' transform="rotate(-90 {x:.1f} {y:.1f})"')


def chart(
    panels: Sequence[Panel], label: str, *, width: float = FIGURE_WIDTH, height: float = 2.8
) -> Markup:
    """The panels, one below the other over the same x, as an SVG element for a page; width and
    height in inches, `label` is read aloud.
    """
    return _Chart(panels, SVG_DPI * width, SVG_DPI * height).svg(label)


def side_by_side(panels: Sequence[Panel], label: str, *, height: float = PANEL_HEIGHT) -> Markup:
    """Each panel as a drawing of its own, one below the other on a phone, and above them one key of
    all names; label: of each drawing, after the panel's title; height in inches.
    """
    named = {item.name: item for panel in panels for item in panel.named}
    sample = '<svg class="sample" viewBox="0 0 24 10" width="24" height="10" aria-hidden="true">'
    key = Markup("").join(
        Markup(f"<li>{sample}{item.sample(1.0, 5.0, 22.0)}</svg>{escape(name)}</li>")
        for name, item in named.items()
    )
    drawings = (chart([p], f"{p.title}: {label}", width=PANEL_WIDTH, height=height) for p in panels)
    return Markup('<ul class="key">{}</ul>{}').format(key, in_panels(drawings))


def in_panels(drawings: Iterable[Markup]) -> Markup:
    """Drawings of panels as elements of a page: side by side, one below the other on a phone."""
    figure = Markup('<figure><div class="drawing">{}</div></figure>')
    return Markup('<div class="panels">{}</div>').format(
        Markup("").join(figure.format(drawing) for drawing in drawings)
    )


class _Chart:
    """The layout: heights first, since they say how many labels y has, then widths, then x."""

    def __init__(self, panels: Sequence[Panel], width: float, height: float) -> None:
        self._panels, self._width, self._height = panels, width, height
        self._above = self._rows("above")
        self._below = self._rows("below")
        limits = [panel.limits() for panel in panels]
        low, high = min(x[0] for x, _ in limits), max(x[1] for x, _ in limits)
        self._x = panels[-1].x_limits or (low, high)
        places = self._heights()
        self._y_ticks = [
            _y_ticks(panel, y, place[1]) for panel, (_, y), place in zip(panels, limits, places)
        ]
        left, right = self._left(), self._right()
        self._places = [
            Place(left, top, width - left - right, tall, self._x, y, panel.x_log, panel.y_log)
            for (top, tall), panel, (_, y) in zip(places, panels, limits)
        ]
        self._places = [_equal(p) if q.equal else p for p, q in zip(self._places, panels)]

    def _rows(self, where: str) -> list[list[Item]]:
        """The lines of a legend above or below the chart: as many entries as find room."""
        rows: list[list[Item]] = []
        room = 0.0
        for item in (i for panel in self._panels if panel.legend == where for i in panel.named):
            needed = HANDLE_PT + GAP_PT + text_width(item.name) + 2 * LETTER
            if not rows or room < needed:
                rows.append([])
                room = self._width
            rows[-1].append(item)
            room -= needed
        return rows

    def _heights(self) -> list[tuple[float, float]]:
        """Top and height of each panel's axes."""
        top = 0.5 * LETTER + LINE_PT * len(self._above)
        top += FAR_PT if self._panels[0].far else 0.0
        last = self._panels[-1]
        foot = TICK_PT + GAP_PT + 2.0 + LINE_PT * len(self._below)
        foot += LINE_PT if last.x_label else 0.0
        foot += max(text_width(t) for _, t in last.x_ticks or ()) if last.upright else LETTER
        heads = [LINE_PT + GAP_PT if panel.title else 0.0 for panel in self._panels]
        gaps = LETTER * (len(self._panels) - 1)
        free = self._height - top - foot - sum(heads) - gaps
        shares = sum(panel.share for panel in self._panels)
        found = []
        for panel, head in zip(self._panels, heads):
            top += head
            tall = max(free * panel.share / shares, LETTER)
            found.append((top, tall))
            top += tall + LETTER
        return found

    def _left(self) -> float:
        labels = [text_width(label) for ticks in self._y_ticks for _, label in ticks]
        named = any(panel.y_label for panel in self._panels)
        return (
            max(labels, default=0.0) + TICK_PT + GAP_PT + (LINE_PT + GAP_PT if named else 0.0) + 2.0
        )

    def _right(self) -> float:
        beside = [
            2 * GAP_PT + BESIDE_HANDLE_PT + GAP_PT + text_width(item.name)
            for panel in self._panels
            if panel.legend == "beside"
            for item in panel.named
        ]
        far = [
            FAR_PT - LETTER + max((text_width(label) for _, label in panel.far[1].ticks), default=0)
            for panel in self._panels
            if panel.far
        ]
        return max([*beside, *far, 0.9 * LETTER * 1.5]) + 2.0

    def svg(self, label: str) -> Markup:
        """The whole element."""
        seen = [self._panel(k) for k in range(len(self._panels))]
        body = "".join(seen) + self._legend_rows()
        digest = hashlib.sha256((body + label).encode()).hexdigest()[:8]
        body = body.replace(_CLIP, f"c{digest}-")
        least = f"--least:{self._width * LEAST_LETTER_PX / LETTER:.0f}px"
        return Markup(
            f'<svg viewBox="0 0 {self._width:g} {self._height:g}" style="{least}" role="img"'
            f' aria-label="{escape(label)}"><g font-size="{LETTER}">{body}</g></svg>'
        )

    def _panel(self, k: int) -> str:
        panel, place = self._panels[k], self._places[k]
        last = k == len(self._panels) - 1
        ticks = _x_ticks(panel if last else self._panels[-1], self._x, place.width)
        clip = (
            f'<clipPath id="{_CLIP}{k}"><rect x="{place.left:.1f}" y="{place.top - 1:.1f}"'
            f' width="{place.width:.1f}" height="{place.height + 2:.1f}"/></clipPath>'
        )
        items = "".join(item.drawn(place) for item in panel.items)
        return (
            f"{clip}{self._axes(k, ticks)}"
            f'<g clip-path="url(#{_CLIP}{k})">{items}</g>'
            f"{self._labels(k, ticks if last else [])}{self._beside(k)}{self._far(k)}"
        )

    def _far(self, k: int) -> str:
        """Edges, ticks, numbers and names at the top and at the right."""
        far, place = self._panels[k].far, self._places[k]
        if far is None:
            return ""
        above, aside = far
        right, foot = place.left + place.width, place.top + place.height
        marks, found = f"M{place.left:.1f} {place.top:.1f}H{right:.1f}V{foot:.1f}", ""
        for value, text in _within(above.ticks, place.x):
            at = float(place.across(value))
            marks += f"M{at:.1f} {place.top:.1f}v-{TICK_PT}"
            found += _text(at, place.top - TICK_PT - GAP_PT, text)
        longest = 0.0
        for value, text in _within(aside.ticks, place.y):
            at = float(place.down(value))
            marks += f"M{right:.1f} {at:.1f}h{TICK_PT}"
            found += _text(right + TICK_PT + GAP_PT, at + 0.36 * LETTER, text, "start")
            longest = max(longest, text_width(text))
        up = place.top - TICK_PT - 2 * GAP_PT - LETTER
        found += _text(place.left + 0.5 * place.width, up, above.label)
        beyond = right + TICK_PT + 2 * GAP_PT + longest + LETTER
        found += _upright(beyond, place.top + 0.5 * place.height, aside.label)
        return (
            f'<path class="axes" d="{marks}" fill="none" stroke="{EDGE_COLOUR}"'
            f' stroke-width=".8"/>{found}'
        )

    def _axes(self, k: int, x_ticks: _Ticks) -> str:
        """Grid, ticks and the two edges."""
        panel, place = self._panels[k], self._places[k]
        foot, right = place.top + place.height, place.left + place.width
        if panel.bare:
            return ""
        grid = marks = ""
        for value, _ in _within(x_ticks, place.x):
            at = float(place.across(value))
            grid += f"M{at:.1f} {place.top:.1f}V{foot:.1f}"
            marks += f"M{at:.1f} {foot:.1f}v{TICK_PT}"
        for value, _ in _within(self._y_ticks[k], place.y):
            at = float(place.down(value))
            grid += f"M{place.left:.1f} {at:.1f}H{right:.1f}" if panel.grid_y else ""
            marks += f"M{place.left:.1f} {at:.1f}h-{TICK_PT}"
        edges = f"M{place.left:.1f} {place.top:.1f}V{foot:.1f}H{right:.1f}"
        return (
            f'<path d="{grid}" fill="none" stroke="{GRID_COLOUR}" stroke-width=".7"/>'
            f'<path class="axes" d="{edges}{marks}" fill="none" stroke="{EDGE_COLOUR}"'
            ' stroke-width=".8"/>'
        )

    def _labels(self, k: int, x_ticks: _Ticks) -> str:
        """Numbers along the axes, their names, the title."""
        panel, place = self._panels[k], self._places[k]
        foot, found = place.top + place.height, ""
        for value, text in _within(x_ticks, place.x):
            at = float(place.across(value))
            if panel.upright:
                found += _upright(at + 0.36 * LETTER, foot + TICK_PT + GAP_PT, text, "end")
            else:
                found += _text(at, foot + TICK_PT + GAP_PT + 0.75 * LETTER, text)
        for value, text in _within(self._y_ticks[k], place.y):
            at = float(place.down(value)) + 0.36 * LETTER
            found += _text(place.left - TICK_PT - GAP_PT, at, text, "end")
        if panel.x_label:
            down = foot + TICK_PT + GAP_PT + 0.75 * LETTER + LINE_PT + 1.0
            found += _text(place.left + 0.5 * place.width, down, panel.x_label)
        if panel.y_label:
            found += _upright(LETTER, place.top + 0.5 * place.height, panel.y_label)
        if panel.title:
            bold = f' font-weight="bold" font-size="{TITLE_PT:g}"'
            found += _text(place.left, place.top - GAP_PT - 2.0, panel.title, "start", bold)
        return found

    def _beside(self, k: int) -> str:
        """The legend at the right of a panel."""
        panel, place = self._panels[k], self._places[k]
        if panel.legend != "beside":
            return ""
        x = place.left + place.width + 2 * GAP_PT
        y = place.top + 0.5 * place.height - 0.5 * LINE_PT * (len(panel.named) - 1)
        found = ""
        for number, item in enumerate(panel.named):
            found += _entry(item, x, y + LINE_PT * number, BESIDE_HANDLE_PT)
        return found

    def _legend_rows(self) -> str:
        """The legends above and below the chart, each row in the middle."""
        found = ""
        starts = ((self._above, 0.75 * LETTER), (self._below, self._height - 0.6 * LETTER))
        for rows, first in starts:
            for number, row in enumerate(rows):
                lengths = [HANDLE_PT + GAP_PT + text_width(item.name) + 2 * LETTER for item in row]
                x = 0.5 * (self._width - sum(lengths) + 2 * LETTER)
                back = (
                    LINE_PT * (len(rows) - 1 - number) if rows is self._below else -LINE_PT * number
                )
                for item, length in zip(row, lengths):
                    found += _entry(item, x, first - back, HANDLE_PT)
                    x += length
        return found


def _equal(place: Place) -> Place:
    """The same middle, and as many points to a unit of x as to one of y."""
    wide, tall = place.x[1] - place.x[0], place.y[1] - place.y[0]
    scale = min(place.width / wide, place.height / tall)
    return replace(
        place,
        left=place.left + 0.5 * (place.width - scale * wide),
        top=place.top + 0.5 * (place.height - scale * tall),
        width=scale * wide,
        height=scale * tall,
    )


_CLIP = "\u0000clip"  # stands for the id of a clip path until the drawing's hash is known


def _entry(item: Item, x: float, y: float, handle: float) -> str:
    return item.sample(x, y, handle) + _text(
        x + handle + GAP_PT, y + 0.36 * LETTER, item.name, "start"
    )


def _within(ticks: _Ticks, limits: tuple[float, float]) -> Iterator[tuple[float, str]]:
    low, high = min(limits), max(limits)
    room = 1e-6 * (high - low)
    return ((value, text) for value, text in ticks if low - room <= value <= high + room)
