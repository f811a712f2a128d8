"""Figures and drawn reports of the page, each made once: tables never change, so their hashes are
the keys.
"""

import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable, Sequence
from concurrent.futures import Future
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

import numpy as np
from markupsafe import Markup

from ins.records import AXES
from recal.service.inputs.records import ThermalTable
from recal.service.priors.forecast import most_urgent
from recal.service.priors.forecast_page import trend_panels
from recal.service.priors.records import ForecastReport
from recal.service.results.pages import (
    DASHED,
    DOTTED,
    GREY,
    NEW,
    OLD,
    VERMILLION,
    Item,
    Marks,
    Panel,
    drawn_temperatures,
    panels,
    robust_limits,
)
from recal.service.results.pages import Line as Curve
from recal.service.store import SessionEvidence, TableStore

MOST_KEPT = 64  # chosen: the latest 64; one that is gone is drawn again when asked for
MOST_SESSIONS_DRAWN = 20  # sessions of a drawing, the latest; chosen: more hide each other
LINES = {
    "factory": (GREY, DOTTED),
    "previous": (OLD, DASHED),
    "active": (NEW, ""),
    "before": (OLD, DASHED),
    "after": (NEW, ""),
}


@dataclass(frozen=True)
class TableLine:
    """One table of a figure under its name (a key of LINES), with words for the key."""

    name: str
    sha256: str
    table: ThermalTable
    words: str


class Once:
    """What takes long is made once for each key, and the last `most` are kept. Who asks for the
    same waits for it; other keys are made meanwhile.
    """

    def __init__(self, most: int) -> None:
        self._most = most
        self._kept: OrderedDict[Hashable, Future[Any]] = OrderedDict()
        self._lock = threading.Lock()

    def of(self, key: Hashable, make: Callable[[], Any]) -> Any:
        """What `make` gives, or gave before; what it raises is raised, and not kept."""
        with self._lock:
            found = self._kept.get(key)
            mine = found is None
            if found is None:
                found = self._kept[key] = Future()
            self._kept.move_to_end(key)
            while len(self._kept) > self._most:
                self._kept.popitem(last=False)
        if mine:
            try:
                found.set_result(make())
            except BaseException as error:
                found.set_exception(error)
                with self._lock:
                    self._kept.pop(key, None)
        return found.result()

    def at_hand(self, key: Hashable) -> Any:
        """What was made under the key, None where it was not, or is not yet."""
        with self._lock:
            found = self._kept.get(key)
        return found.result() if found is not None and found.done() else None


class Drawings:
    """The last figures, by what they show."""

    def __init__(self) -> None:
        self._once = Once(MOST_KEPT).of

    def bias_panels(
        self, lines: Sequence[TableLine], against: Sequence[SessionEvidence] = ()
    ) -> Markup:
        """Bias against temperature of the three gyros, a line for each table, U(k=2) bands but for
        the factory one; against: sessions that contradict the last table, a point with its U each.
        """
        seen = against[-MOST_SESSIONS_DRAWN:]
        shown = ((line.name, line.sha256, line.words) for line in lines)
        key = ("bias", *shown, *(e.run_sha256 for e in seen))
        found: Markup = self._once(
            key, lambda: panels(_bias_panel(axis, lines, seen) for axis in AXES)
        )
        return found

    def trend(self, key: Hashable, document: ForecastReport) -> Markup:
        """The drift of the most urgent units against the limit."""

        found: Markup = self._once(("trend", key), lambda: panels(trend_panels(document)))
        return found

    def page(self, key: Hashable, draw: Callable[[], str]) -> str:
        """A whole report that takes seconds to draw."""
        page: str = self._once(("page", key), draw)
        return page


def _bias_panel(axis: str, lines: Sequence[TableLine], against: Sequence[SessionEvidence]) -> Panel:
    items: list[Item] = []
    inner, outer, band = [], [], np.zeros(0)
    for line in lines:
        colour, dash = LINES[line.name]
        nodes = line.table.temperature_degC[AXES.index(axis)]
        T = drawn_temperatures(nodes)
        bias, sigma = line.table.bias_deg_h(axis, T), line.table.sigma_deg_h(axis, T)
        low = high = None
        if line.name != "factory":  # a band for it, too, would hide the others
            low, high = bias - 2 * sigma, bias + 2 * sigma
            band = np.concatenate([low, high])
            outer.append(band)
        items.append(Curve(T, bias, colour, line.words, dash=dash, low=low, high=high))
        items.append(Marks(nodes, line.table.bias_deg_h(axis, nodes), "s", colour, size=2.8))
        inner.append(bias)
    if against:
        points = _points(AXES.index(axis), against)
        items.append(points)
        outer += points.edges
    # the band of the last table is seen whole: of a flat table nothing else gives the axis a scale
    limits = robust_limits(np.concatenate([*inner, band]), np.concatenate(outer), spans=8.0)
    label = (
        f"Bias of gyro {axis} against temperature: {', '.join(line.name for line in lines)} table"
    )
    if against:
        label += f", and {len(against)} session{'s' if len(against) > 1 else ''} against it"
    return Panel(
        items=items,
        title=f"Gyro {axis}: bias against temperature",
        label=label,
        x_label="gyro temperature [°C]",
        y_label="bias [deg/h]",
        y_limits=limits,
        group="tables",
    )


def _points(k: int, sessions: Sequence[SessionEvidence]) -> Marks:
    """Each session's bias of gyro k with U(k=2)."""
    T = np.array([session.temperature_degC[k] for session in sessions])
    bias = np.array([session.bias_deg_h[k] - session.bend_deg_h[k] for session in sessions])
    expanded = 2.0 * np.sqrt([session.covariance[k][k] for session in sessions])
    low, high = bias - expanded, bias + expanded
    name = "session that contradicts it, U(k=2)"
    return Marks(T, bias, "D", VERMILLION, name, size=5.0, low=low, high=high)


class Forecasts:
    """The latest forecast, by what it rests on."""

    def __init__(self) -> None:
        self._made = Once(1)

    def of(self, store: TableStore) -> tuple[Hashable, ForecastReport]:
        """A key that changes with it, and the forecast."""
        key = _key_of(store)
        return key, self._made.of(key, lambda: most_urgent(store))

    def at_hand(self, store: TableStore) -> ForecastReport | None:
        """The forecast where it is made already and still holds; making it takes seconds."""
        found: ForecastReport | None = self._made.at_hand(_key_of(store))
        return found


def _key_of(store: TableStore) -> Hashable:
    """What a forecast rests on, and the day."""
    tables = tuple((unit.unit, unit.sha256) for unit in store.overview())
    priors = tuple((p.gyro_technology, p.number, p.state) for p in store.priors())
    return datetime.now(UTC).date(), tables, priors
