"""Drawings and drawn reports of the page, each made once: tables never change, so their hashes are
the keys.

matplotlib keeps its style in one place for all threads, so one thread draws at a time.
"""

import re
import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from ins.records import AXES
from recal.service.inputs.records import ThermalTable
from recal.service.priors.forecast_page import trend_drawing
from recal.service.priors.forecast_records import ForecastDocument
from recal.service.results.pages import (
    GREY,
    NEW,
    OLD,
    PANEL_WIDTH,
    VERMILLION,
    axis_text,
    in_style,
    new_figure,
    robust_limits,
    svg_text,
)
from recal.service.store import SessionEvidence

MOST_KEPT = 64  # chosen: the latest 64; one that is gone is drawn again when asked for
MOST_SESSIONS_DRAWN = 20  # sessions of a drawing, the latest; chosen: more hide each other
LINES = {
    "factory": (GREY, ":"),
    "previous": (OLD, "--"),
    "active": (NEW, "-"),
    "before": (OLD, "--"),
    "after": (NEW, "-"),
}
_STYLE_ATTRIBUTE = re.compile(r' style="([^"]*)"')


@dataclass(frozen=True)
class Line:
    """One table of a drawing under its name (a key of LINES)."""

    name: str
    sha256: str
    table: ThermalTable


class Drawings:
    """The last drawings, by what they show."""

    def __init__(self) -> None:
        self._kept: OrderedDict[Hashable, Any] = OrderedDict()
        self._lock = threading.Lock()

    def bias_panels(
        self, lines: Sequence[Line], against: Sequence[SessionEvidence] = ()
    ) -> list[Markup]:
        """Bias against temperature of the three gyros, a line for each table, U(k=2) bands but for
        the factory one; against: sessions that contradict the last table, a point with its U each.
        """
        seen = against[-MOST_SESSIONS_DRAWN:]
        key = ("bias", *((line.name, line.sha256) for line in lines), *(e.run_sha256 for e in seen))
        return self._once(key, lambda: [_bias_panel(axis, lines, seen) for axis in AXES])

    def trend(self, key: Hashable, document: ForecastDocument) -> Markup:
        """The drift of the most urgent units against the limit."""

        def drawn() -> Markup:
            return without_style_attributes(trend_drawing(document) or Markup(""))

        found: Markup = self._once(("trend", key), drawn)
        return found

    def page(self, key: Hashable, draw: Callable[[], str]) -> str:
        """A whole report that takes seconds to draw."""
        return self._once(("page", key), draw)

    def _once(self, key: Hashable, make: Callable[[], Any]) -> Any:
        with self._lock:
            if key not in self._kept:
                self._kept[key] = make()
                while len(self._kept) > MOST_KEPT:
                    self._kept.popitem(last=False)
            self._kept.move_to_end(key)
            return self._kept[key]


def without_style_attributes(svg: Markup) -> Markup:
    """The drawing with its styles as attributes of their own, which a strict
    Content-Security-Policy lets stand.
    """

    def attributes(found: re.Match[str]) -> str:
        pairs = (part.partition(":") for part in found[1].split(";") if part.strip())
        return "".join(f' {name.strip()}="{value.strip()}"' for name, _, value in pairs)

    return Markup(_STYLE_ATTRIBUTE.sub(attributes, svg))


@in_style
def _bias_panel(axis: str, lines: Sequence[Line], against: Sequence[SessionEvidence]) -> Markup:
    figure, axes = new_figure(width=PANEL_WIDTH, height=3.3)
    ax, inner, outer, band = axes[0, 0], [], [], np.zeros(0)
    for line in lines:
        colour, dashes = LINES[line.name]
        nodes = line.table.temperature_degC[AXES.index(axis)]
        T = np.union1d(nodes, np.linspace(nodes[0], nodes[-1], 121))
        bias, sigma = line.table.bias_deg_h(axis, T), line.table.sigma_deg_h(axis, T)
        if line.name != "factory":  # a band for it, too, would hide the others
            ax.fill_between(
                T, bias - 2 * sigma, bias + 2 * sigma, color=colour, alpha=0.16, linewidth=0
            )
            band = np.concatenate([bias - 2 * sigma, bias + 2 * sigma])
            outer.append(band)
        ax.plot(T, bias, dashes, color=colour)
        ax.plot(nodes, line.table.bias_deg_h(axis, nodes), "s", color=colour, markersize=2.8)
        inner.append(bias)
    for session in against:
        outer.append(_point(ax, AXES.index(axis), session))
    # the band of the last table is seen whole: of a flat table nothing else gives the axis a scale
    ax.set_ylim(*robust_limits(np.concatenate([*inner, band]), np.concatenate(outer), spans=8.0))
    axis_text(
        ax,
        title=f"Gyro {axis}: bias against temperature",
        x="gyro temperature [°C]",
        y="bias [deg/h]",
    )
    label = (
        f"Bias of gyro {axis} against temperature: {', '.join(line.name for line in lines)} table"
    )
    if against:
        label += f", and {len(against)} session{'s' if len(against) > 1 else ''} against it"
    return without_style_attributes(svg_text(figure, label))


def _point(ax: Any, k: int, session: SessionEvidence) -> NDArray:
    """Draw a session's bias of gyro k with U(k=2); the ends of its bar (2,) [deg/h]."""
    T = session.temperature_degC[k]
    bias = session.bias_deg_h[k] - session.bend_deg_h[k]
    expanded = 2.0 * session.covariance[k][k] ** 0.5
    look = {"color": VERMILLION, "markersize": 5, "elinewidth": 1.4, "capsize": 3}
    ax.errorbar(T, bias, yerr=expanded, fmt="D", **look)
    return np.array([bias - expanded, bias + expanded])
