"""Drawing for reports: one style, one palette (Okabe-Ito, told apart by the colour-blind), figures
as small inline SVG.

`@in_style` on a function that does: `new_figure` -> draw on its axes -> `svg_text`. matplotlib is
imported inside functions only, and never pyplot.
"""

import hashlib
import re
from collections.abc import Callable, Sequence
from functools import wraps
from typing import TYPE_CHECKING, Any, ParamSpec, TypedDict, TypeVar

import numpy as np
from markupsafe import Markup, escape
from numpy.typing import ArrayLike, NDArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure

FIGURE_WIDTH = 10.0  # inches: a drawing as wide as the page
# inches: one of two or three side by side, one below the other on a phone; it is narrow, and its
# bands want room
PANEL_WIDTH, PANEL_HEIGHT = 4.3, 3.0
SVG_DPI = 72  # of a drawing as SVG: a unit is a point
MAX_POINTS = 2000  # of a curve
PANEL_POINTS = 1000  # of a curve in a panel: 4 for each pixel across, so that a reader can zoom
MAX_DOTS = 700  # of a cloud: 2 or 3 for each pixel across a panel; each is an element of the page

BLACK, ORANGE, SKY, GREEN = "#000000", "#E69F00", "#56B4E9", "#009E73"
YELLOW, BLUE, VERMILLION, PURPLE = "#F0E442", "#0072B2", "#D55E00", "#CC79A7"
GREY, PALE = "#59636E", "#C9D1D9"
OLD, NEW = VERMILLION, BLUE  # the table before and the table after, everywhere
AXIS_COLOURS = {"x": BLACK, "y": GREEN, "z": PURPLE}
AXIS_LINES = {"x": "-", "y": "--", "z": "-."}

LETTER = 9.5  # in points of the drawing; chosen: 11 px where a drawing is as wide as the page
LEAST_LETTER_PX = (
    11.05  # on a screen: a drawing that would have smaller ones scrolls in its own box
)
_STYLE: dict[str, float | str | bool | list[str]] = {
    "font.family": ["sans-serif"],
    "font.sans-serif": ["DejaVu Sans"],
    "font.size": LETTER,
    "axes.titlesize": 10.0,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.labelsize": LETTER,
    "legend.fontsize": LETTER,
    "legend.frameon": False,
    "xtick.labelsize": LETTER,
    "ytick.labelsize": LETTER,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#E3E8ED",
    "grid.linewidth": 0.7,
    "axes.edgecolor": "#8C959F",
    "axes.linewidth": 0.8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "lines.linewidth": 1.5,
    "axes.unicode_minus": True,
    "axes.formatter.useoffset": False,
    "text.parse_math": False,
    "path.simplify_threshold": 0.2,
    "svg.fonttype": "none",
    "svg.hashsalt": "recal",
}


class LineStyle(TypedDict, total=False):
    """How matplotlib draws a line or its points."""

    color: str
    linestyle: str
    linewidth: float
    alpha: float
    marker: str
    markersize: float
    fmt: str
    zorder: int
    label: str


_P = ParamSpec("_P")
_R = TypeVar("_R")


def in_style(draw: Callable[_P, _R]) -> Callable[_P, _R]:
    """Decorator: all that the function draws takes the reports' style, whatever matplotlibrc
    says.
    """

    @wraps(draw)
    def styled(*args: _P.args, **kwargs: _P.kwargs) -> _R:
        from matplotlib import rc_context, rcParamsDefault

        style: dict[Any, Any] = {**rcParamsDefault, **_STYLE}
        with rc_context(style):
            return draw(*args, **kwargs)

    return styled


@in_style
def new_figure(
    rows: int = 1,
    columns: int = 1,
    *,
    width: float = FIGURE_WIDTH,
    height: float = 2.8,
    **subplots: Any,
) -> tuple["Figure", NDArray]:
    """A figure (inches) in the reports' style and its axes (rows, columns); `subplots` goes to
    Figure.subplots.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    return figure, figure.subplots(rows, columns, squeeze=False, **subplots)


@in_style
def svg_text(figure: "Figure", label: str) -> Markup:
    """The figure as an SVG element for a page; `label` is read aloud. It fetches nothing; equal
    figures, equal text.
    """
    import io

    for axes in figure.axes:
        for axis in (axes.xaxis, axes.yaxis):
            _plain_decades(axis)
    # laid out here, once: savefig draws everything twice where a layout is still to be found
    engine = figure.get_layout_engine()
    if engine is not None:
        figure.dpi = SVG_DPI
        engine.execute(figure)
        figure.set_layout_engine(None)  # "none" would still draw twice
    buffer = io.StringIO()
    figure.savefig(buffer, format="svg", metadata={"Date": None}, transparent=True)
    return Markup(_slim(buffer.getvalue(), label))  # matplotlib escapes the texts in it


def _plain_decades(axis: "Axis") -> None:
    """Numbers as they are along a logarithmic axis: the reports draw no mathematics, so that a
    power of ten would stand there as its source.
    """
    from matplotlib.ticker import FuncFormatter, LogFormatter, LogFormatterMathtext

    if isinstance(axis.get_major_formatter(), LogFormatterMathtext):
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    if isinstance(axis.get_minor_formatter(), LogFormatterMathtext):
        few = LogFormatter(minor_thresholds=(1, 0.4))
        few.set_axis(axis)
        few.set_locs(axis.get_minorticklocs())
        axis.set_minor_formatter(FuncFormatter(lambda value, _: few(value) and f"{value:.3g}"))


def _slim(svg: str, label: str) -> str:
    """Without prolog, metadata, name spaces and unused ids, coordinates to 0.01 pt; ids unique to
    this drawing.
    """
    svg = svg[svg.index("<svg") :]
    svg = re.sub(r"<metadata>.*?</metadata>\s*", "", svg, flags=re.DOTALL)
    svg = re.sub(r"<!--.*?-->\s*|<defs>\s*<style.*?</style>\s*</defs>", "", svg, flags=re.DOTALL)
    svg = svg.replace("xlink:href=", "href=").replace(
        "font-family: 'DejaVu Sans', sans-serif; ", ""
    )
    svg = re.sub(r' transform="rotate\(-0 [^"]*"', "", svg)
    digest = hashlib.sha256((svg + label).encode()).hexdigest()[:8]
    used = sorted(set(re.findall(r'(?:url\(|href=")#([^)"]+)', svg)))
    names = {old: f"f{digest}-{k}" for k, old in enumerate(used)}
    svg = re.sub(r' id="([^"]*)"', lambda m: f' id="{names[m[1]]}"' if m[1] in names else "", svg)
    svg = re.sub(r'(url\(|href=")#([^)"]+)', lambda m: f"{m[1]}#{names[m[2]]}", svg)
    svg = re.sub(
        r'(?<= )(?:d|x|y|transform)="[^"]*"', lambda m: re.sub(r"(\.\d\d)\d+", r"\1", m[0]), svg
    )
    box = re.search(r'viewBox="[^"]*"', svg)
    width = float(box[0].split()[2]) if box else 0.0
    least = f"--least:{width * LEAST_LETTER_PX / LETTER:.0f}px"
    head = f'<svg {box[0] if box else ""} style="{least}" role="img" aria-label="{escape(label)}">'
    return re.sub(r"\n\s*", "\n", head + svg[svg.index(">") + 1 :]).strip()


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


def axis_text(ax: "Axes", *, title: str = "", x: str = "", y: str = "") -> None:
    """Title, left, and labels with their units."""
    ax.set_title(title)
    ax.set_xlabel(x)
    ax.set_ylabel(y)
