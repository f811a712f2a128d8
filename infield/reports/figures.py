"""What all figures of reports share: one palette (Okabe-Ito, told apart by the
colour-blind), how many points they have at most.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

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
