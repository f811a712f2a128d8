"""replay.html: the replay document and its curves as one page that fetches nothing. Computes
nothing.
"""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from alignment.reasons import WITH_HEADING
from infield.replay.drift import DRIFT_CLASSES
from infield.replay.free_inertial import TableReplay
from infield.replay.reasons import ReplayVerdict
from infield.reports.aided_figures import LOG_GROUP, TIME, aided_figures, map_panel
from infield.reports.documents.aided import AidedFlightDocument
from infield.reports.documents.replay import ReplayDocument
from infield.reports.drawing import (
    BLACK,
    DASHED,
    DOTTED,
    GREY,
    NEW,
    OLD,
    PANEL_POINTS,
    Item,
    Line,
    Marks,
    Panel,
    ShadedSpan,
    thinned,
)
from infield.reports.page import number, render_page
from ins.attitude import euler_from_dcm, wrap_pi
from ins.documents import plain
from ins.units import DEG, KNOT, NAUTICAL_MILE

COLOURS = {"previous": OLD, "active": NEW}
DASHES = {"previous": DASHED, "active": ""}
RAW = "raw gyro output"
SHORT_NM = 0.1  # a drift of less, 185 m, is drawn in metres
LEAST_M = 0.01  # half the width of a drawing of less: no axis in 1e-5 m
BANNERS = {
    ReplayVerdict.REPLAYED: "good",
    ReplayVerdict.REFUSED: "none",
    ReplayVerdict.INCONSISTENT: "bad",
}
SINCE = "time since navigation began [min]"
FIGURES = ("radial", "velocity", "wander", "attitude", "closer", "gnss", "reference")
WANDER_PX = 430


def render(document: ReplayDocument) -> str:
    """The page of replay.json, with the curves of the flights that it is of."""
    result, data = document.result, plain(document)
    return render_page(
        "replay.html.j2",
        d=data,
        tables={t["role"]: t for t in data["tables"]},
        banner=BANNERS[document.verdict],
        headline=_headline(document),
        told=verdict_words(document),
        free=_figures(document),
        aided=aided_figures(result),
        map=map_panel(result),
        labels={t.choice.role: _label(t) for t in result.tables},
    )


def verdict_words(document: ReplayDocument) -> str:
    """What the flights say of the tables; "replayed" would only say that they were flown."""
    if document.verdict is not ReplayVerdict.REPLAYED:
        return str(document.verdict)
    difference = document.difference
    if difference is None or difference.rate_nm_h is None:
        return "navigated; no two tables to compare"
    if difference.significant is None:
        return "flown with two tables, the sigma of their difference is not known"
    if not difference.significant:
        return "no significant difference between the tables"
    less = difference.rate_nm_h.change < 0.0
    return f"the active table drifts significantly {'less' if less else 'more'} than the previous"


def _headline(document: ReplayDocument) -> str:
    """The result in one sentence."""
    if document.verdict is ReplayVerdict.REFUSED:
        return "No table could be flown: " + "; ".join(document.reasons)
    tables = {t.role: t for t in document.tables}
    active, previous = tables.get("active"), tables.get("previous")
    if active is None or active.alignment.verdict not in WITH_HEADING:
        assert isinstance(document.aided, AidedFlightDocument)
        start_s = number(document.aided.start.time_s, 0)
        return f"No free-inertial flight; navigated with GNSS from {start_s} s on."
    if active.parked is None:
        return "The vehicle rolls within a minute of its alignment: no parked drift to measure."
    after, hours = active.parked.rate_nm_h, active.parked.hours
    if previous is None or previous.parked is None:
        return f"Parked drift {number(after)} NM/h over {hours * 60:.0f} min."
    before = previous.parked.rate_nm_h
    sigma = document.difference.sigma_rate_nm_h if document.difference else None
    spread = "" if sigma is None else f" ± {number(sigma)}"
    return (
        f"Parked drift over {hours * 60:.0f} min: {number(before)} NM/h with the previous table,"
        f" {number(after)} NM/h with the active one"
        f" ({number(after - before, sign=True)}{spread} NM/h, 1 sigma)."
    )


def _figures(document: ReplayDocument) -> dict[str, list[Panel]]:
    """Panels by the name of their figure; none where there is nothing to show."""
    flown = [
        t
        for t in sorted(document.result.tables, key=lambda t: t.choice.role == "active")
        if t.history is not None
    ]
    found: dict[str, list[Panel]] = {name: [] for name in FIGURES}
    parked = [t for t in flown if t.parked is not None]
    if parked:
        found["radial"] = [_radial(parked)]
        found["velocity"] = list(_parked_velocity(parked))
        found["wander"] = [_wander(parked)]
    if flown:
        found["attitude"] = list(_attitude(flown))
        found["closer"] = list(_closer(document, flown))
    for name in ("gnss", "reference"):
        drifts = [(t, drift) for t in flown if (drift := getattr(t, name)) is not None]
        if drifts:
            found[name] = list(_against(drifts, name))
    return found


def _label(t: TableReplay) -> str:
    return f"{t.choice.role} table" if t.choice.table is not None else RAW


def _curve(t: TableReplay, x: NDArray, values: NDArray) -> Line:
    return Line(x, values, COLOURS[t.choice.role], _label(t))


def _panel(
    title: str,
    y_label: str,
    x_label: str,
    curves: Sequence[Line],
    *,
    limits: tuple[float, float] | None = None,
    spans: Sequence[ShadedSpan] = (),
) -> Panel:
    """Curves over time; panels over the same time zoom together."""
    return Panel(
        title=title,
        items=list(curves),
        label=f"{title}, by table",
        x_label=x_label,
        y_label=y_label,
        y_limits=limits,
        spans=spans,
        group=LOG_GROUP if x_label == TIME else "since",
    )


def _radial(parked: list[TableReplay]) -> Panel:
    """Radial error while parked, with the predicted sigma of each table and the drift classes where
    they come near.
    """
    errors = [t.parked.radial_m for t in parked if t.parked is not None]
    top = max(float(error.max()) for error in errors)
    predicted = [t.predicted for t in parked if t.predicted is not None]
    top = max([top, *(float(p.sigma_radial_m.max()) for p in predicted)])
    unit, name = _unit_of(top)
    curves = []
    for t in parked:
        assert t.parked is not None
        minutes, radial = thinned(t.parked.time_s / 60, t.parked.radial_m / unit)
        curves.append(_curve(t, minutes, radial))
        if t.predicted is not None:
            minutes, sigma = thinned(t.predicted.time_s / 60, t.predicted.sigma_radial_m / unit)
            words = f"predicted 1 sigma, {_label(t)}"
            curves.append(Line(minutes, sigma, COLOURS[t.choice.role], words, dash=DASHED))
    panel = _panel(
        "Radial position error while parked",
        f"error [{name}]",
        SINCE,
        [*curves, *_classes(curves, top)],
        limits=(0.0, 1.08 * max(top, LEAST_M) / unit),
    )
    panel.title = ""
    return panel


def _unit_of(top_m: float) -> tuple[float, str]:
    """Unit [m] of a drawing of drifts up to `top_m`, and its name."""
    return (NAUTICAL_MILE, "NM") if top_m > SHORT_NM * NAUTICAL_MILE else (1.0, "m")


def _classes(curves: Sequence[Line], top_m: float) -> list[Line]:
    """The 2T+2 and 3T+3 limits over the same minutes, where they lie within the drawing of drifts
    up to `top_m`.
    """
    ends = [c.x[[0, -1]] for c in curves]
    x = np.array([max(min(float(e[0]) for e in ends), 0.0), max(float(e[1]) for e in ends)])
    return [
        Line(x, slope * x / 60 + offset, GREY, f"{name} NM", width=1.0, dash=DOTTED)
        for name, slope, offset in DRIFT_CLASSES
        if offset < top_m / NAUTICAL_MILE
    ]


def _parked_velocity(parked: list[TableReplay]) -> Iterator[Panel]:
    """North and east velocity while parked: all of it is error."""
    errors = [(t, t.parked.time_s, t.parked.velocity_m_s) for t in parked if t.parked is not None]
    return _velocities(errors, "velocity while parked", SINCE)


def _velocities(
    tracks: Sequence[tuple[TableReplay, NDArray, NDArray]],
    title: str,
    x_label: str,
    spans: Sequence[ShadedSpan] = (),
) -> Iterator[Panel]:
    """North and east of velocities (n, 2 or 3) [m/s] at times (n,) [s], a curve for each table."""
    for k, name in enumerate(("North", "East")):
        curves = []
        for t, time_s, velocity_m_s in tracks:
            minutes, velocity = thinned(time_s / 60, velocity_m_s[:, k], most=PANEL_POINTS)
            curves.append(_curve(t, minutes, velocity))
        yield _panel(f"{name} {title}", "velocity [m/s]", x_label, curves, spans=spans)


def _wander(parked: list[TableReplay]) -> Panel:
    """Where the parked solution wanders to, on a plain grid."""
    items: list[Item] = []
    tracks = [np.zeros((1, 2))]
    for t in parked:
        assert t.parked is not None
        tracks.append(t.parked.position_m[:, :2])
        colour, dash = COLOURS[t.choice.role], DASHES[t.choice.role]
        east, north = thinned(t.parked.position_m[:, 1], t.parked.position_m[:, 0])
        items.append(Line(east, north, colour, _label(t), dash=dash))
        items.append(Marks(east[-1:], north[-1:], "o", colour, size=6.0))
    items.append(Marks(np.zeros(1), np.zeros(1), "+", BLACK, "true", size=9.0))
    y_limits, x_limits = _square(*np.concatenate(tracks).T)
    return Panel(
        items=items,
        label="Computed position while parked on a plain grid, by table",
        x_label="east [m]",
        y_label="north [m]",
        x_limits=x_limits,
        y_limits=y_limits,
        equal=True,
        height=WANDER_PX,
    )


def _square(x: NDArray, y: NDArray) -> tuple[tuple[float, float], tuple[float, float]]:
    """Limits of equal spans around all values, and a field that is not a sliver."""
    middles = [0.5 * float(values.min() + values.max()) for values in (x, y)]
    half = max(0.55 * max(float(np.ptp(x)), float(np.ptp(y))), LEAST_M)
    return (middles[0] - half, middles[0] + half), (middles[1] - half, middles[1] + half)


def _angles(t: TableReplay) -> tuple[NDArray, ...]:
    """Minutes of the log; roll, pitch, heading without jumps [deg]."""
    assert t.history is not None
    roll, pitch, heading = euler_from_dcm(t.history.C_nb)
    return (t.history.time_s / 60, roll / DEG, pitch / DEG, np.unwrap(wrap_pi(heading)) / DEG)


def _attitude(flown: list[TableReplay]) -> Iterator[Panel]:
    """Roll, pitch and heading from the end of the alignment to the end of the log."""
    columns = [thinned(*_angles(t), most=PANEL_POINTS) for t in flown]
    for k, name in enumerate(("Roll", "Pitch", "Heading, continuous"), start=1):
        curves = [_curve(t, found[0], found[k]) for t, found in zip(flown, columns)]
        yield _panel(name, "angle [deg]", TIME, curves)


def _closer(document: ReplayDocument, flown: list[TableReplay]) -> Iterator[Panel]:
    """Velocity of each table's flight over the log, the parked span shaded."""
    span = document.parked_span
    shaded = () if span is None else (ShadedSpan(span.start_s / 60, span.end_s / 60),)
    tracks = [(t, t.history.time_s, t.history.v_n_m_s) for t in flown if t.history is not None]
    return _velocities(tracks, "velocity", TIME, spans=shaded)


def _against(drifts: Sequence[tuple[TableReplay, Any]], name: str) -> Iterator[Panel]:
    """Radial and speed error against an outside track after the parked span."""
    what = {"gnss": "GNSS", "reference": "the reference"}[name]
    top = max(float(drift.radial_m.max()) for _, drift in drifts)
    unit, short = _unit_of(top)
    radials, speeds = [], []
    for t, drift in drifts:
        minutes, radial, speed = thinned(
            drift.time_s / 60, drift.radial_m / unit, drift.speed_m_s / KNOT, most=PANEL_POINTS
        )
        radials.append(_curve(t, minutes, radial))
        speeds.append(_curve(t, minutes, speed))
    yield _panel(
        f"Radial error against {what}",
        f"error [{short}]",
        SINCE,
        [*radials, *_classes(radials, top)],
        limits=(0.0, 1.08 * max(top, LEAST_M) / unit),
    )
    yield _panel("Velocity error, horizontal", "error [kt]", SINCE, speeds)
