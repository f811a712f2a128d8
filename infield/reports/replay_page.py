"""replay.html: the replay document and its curves as one page that fetches nothing. Computes
nothing.
"""

from typing import TYPE_CHECKING

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from alignment.reasons import WITH_HEADING
from infield.replay.drift import DRIFT_CLASSES
from infield.replay.free_inertial import ReplayResult, TableReplay
from infield.replay.reasons import ReplayVerdict
from infield.reports.aided_figures import aided_figures, map_figure
from infield.reports.documents.aided import AidedFlightDocument
from infield.reports.documents.replay import ReplayDocument
from infield.reports.figures import (
    BLACK,
    GREY,
    NEW,
    OLD,
    LineStyle,
    axis_text,
    in_style,
    new_figure,
    svg_text,
    thinned,
)
from infield.reports.page import number, render_page
from infield.reports.zoom import ZoomCurve, ZoomFigure, zoom_figure, zoom_script
from ins.attitude import euler_from_dcm, wrap_pi
from ins.units import DEG, KNOT, NAUTICAL_MILE
from ins.verdicts import plain

if TYPE_CHECKING:
    from matplotlib.axes import Axes

COLOURS = {"previous": OLD, "active": NEW}
LINES = {"previous": "--", "active": "-"}
RAW = "raw gyro output"
SHORT_NM = 0.1  # a drift of less, 185 m, is drawn in metres
LEAST_M = 0.01  # half the width of a drawing of less: no axis in 1e-5 m
BANNERS = {
    ReplayVerdict.REPLAYED: "good",
    ReplayVerdict.REFUSED: "none",
    ReplayVerdict.INCONSISTENT: "bad",
}
# of the drawings that zoom, in the order of `_quantities`
CLOSER = (("North velocity", "m/s"), ("East velocity", "m/s"), ("Heading, continuous", "deg"))
FIGURES = ("radial", "velocity", "wander", "attitude", "gnss", "reference")


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
        figures=_figures(result) | aided_figures(result) | {"map": map_figure(result)},
        labels={t.choice.role: _label(t) for t in result.tables},
        closer=[(figure.title, zoom_figure(figure)) for figure in _closer(document)],
        script=zoom_script(),
    )


def verdict_words(document: ReplayDocument) -> str:
    """What the flights say of the tables; "replayed" would only say that they were flown."""
    if document.verdict is not ReplayVerdict.REPLAYED:
        return str(document.verdict)
    difference = document.difference
    if difference is None or difference.rate_nm_h is None:
        return "flown, no drift of two tables to compare"
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


@in_style
def _figures(result: ReplayResult) -> dict[str, Markup | None]:
    """Drawings by name; None where there is nothing to show."""
    flown = [
        t
        for t in sorted(result.tables, key=lambda t: t.choice.role == "active")
        if t.history is not None
    ]
    found: dict[str, Markup | None] = dict.fromkeys(FIGURES)
    if any(t.parked is not None for t in flown):
        found["radial"] = _radial(flown)
        found["velocity"] = _velocity(flown)
        found["wander"] = _wander(flown)
    if flown:
        found["attitude"] = _attitude(flown)
    for name in ("gnss", "reference"):
        if any(getattr(t, name) is not None for t in flown):
            found[name] = _against(flown, name)
    return found


def _closer(document: ReplayDocument) -> list[ZoomFigure]:
    """Velocity and heading of each table's flight over the log, the parked span shaded."""
    flown = [t for t in document.result.tables if t.history is not None]
    if not flown:
        return []
    span = document.parked_span
    shaded = () if span is None else ((span.start_s, span.end_s),)
    time_s, _ = thinned(*[max((_time_s(t) for t in flown), key=len)] * 2)
    figures = []
    for k, (title, unit) in enumerate(CLOSER):
        curves = [
            ZoomCurve(name=_label(t), values=_over(time_s, _time_s(t), _quantities(t)[k]))
            for t in flown
        ]
        figures.append(
            ZoomFigure(title=title, unit=unit, time_s=time_s, curves=curves, spans=shaded)
        )
    return figures


def _time_s(t: TableReplay) -> NDArray:
    assert t.history is not None
    return t.history.time_s


def _quantities(t: TableReplay) -> tuple[NDArray, NDArray, NDArray]:
    """What CLOSER names, over the flight."""
    assert t.history is not None
    heading = euler_from_dcm(t.history.C_nb)[2]
    v_n = t.history.v_n_m_s
    return v_n[:, 0], v_n[:, 1], np.unwrap(wrap_pi(heading)) / DEG


def _over(time_s: NDArray, own_s: NDArray, values: NDArray) -> NDArray:
    """Values at other times, NaN before and after their own."""
    return np.interp(time_s, own_s, values, left=np.nan, right=np.nan)


def _label(t: TableReplay) -> str:
    return f"{t.choice.role} table" if t.choice.table is not None else RAW


def _style(t: TableReplay) -> LineStyle:
    role = t.choice.role
    return {"color": COLOURS[role], "linestyle": LINES[role], "label": _label(t)}


def _radial(flown: list[TableReplay]) -> Markup:
    """Radial error while parked, with the predicted sigma of each table and the drift classes where
    they come near.
    """
    figure, axes = new_figure(height=3.4)
    parked = [t.parked for t in flown if t.parked is not None]
    predicted = [t.predicted for t in flown if t.predicted is not None]
    top = max(float(p.radial_m.max()) for p in parked)
    top = max([top, *(float(p.sigma_radial_m.max()) for p in predicted)])
    unit, name = _unit_of(top)
    ax = axes[0, 0]
    for t in flown:
        if t.parked is None:
            continue
        minutes, radial = thinned(t.parked.time_s / 60, t.parked.radial_m / unit)
        ax.plot(minutes, radial, **_style(t))
        if t.predicted is not None:
            minutes, sigma = thinned(t.predicted.time_s / 60, t.predicted.sigma_radial_m / unit)
            ax.plot(
                minutes,
                sigma,
                color=COLOURS[t.choice.role],
                linestyle=":",
                linewidth=1.2,
                label=f"predicted 1 sigma, {_label(t)}",
            )
    _draw_classes(ax, top / NAUTICAL_MILE)
    ax.set_ylim(0.0, 1.08 * max(top, LEAST_M) / unit)
    axis_text(
        ax,
        title="Radial position error while parked",
        x="time since navigation began [min]",
        y=f"error [{name}]",
    )
    ax.legend(loc="upper left")
    return svg_text(figure, "Radial position error while parked over time, by table")


def _unit_of(top_m: float) -> tuple[float, str]:
    """Unit [m] of a drawing of drifts up to `top_m`, and its name."""
    return (NAUTICAL_MILE, "NM") if top_m > SHORT_NM * NAUTICAL_MILE else (1.0, "m")


def _draw_classes(ax: "Axes", top: float) -> None:
    """The 2T+2 and 3T+3 limits, where they lie within the drawing."""
    low, high = ax.get_xlim()
    x = np.array([max(low, 0.0), high])
    for (name, slope, offset), line in zip(DRIFT_CLASSES, ("-.", "-")):
        if offset < top:
            ax.plot(
                x,
                slope * x / 60 + offset,
                color=GREY,
                linestyle=line,
                linewidth=1.0,
                label=f"{name} NM",
            )
    ax.set_xlim(low, high)


def _velocity(flown: list[TableReplay]) -> Markup:
    """North and east velocity while parked: all of it is error."""
    figure, axes = new_figure(1, 2, height=3.0, sharey=True)
    for t in flown:
        if t.parked is None:
            continue
        minutes, north, east = thinned(t.parked.time_s / 60, *t.parked.velocity_m_s.T)
        axes[0, 0].plot(minutes, north, **_style(t))
        axes[0, 1].plot(minutes, east, **_style(t))
    axis_text(
        axes[0, 0],
        title="North velocity",
        x="time since navigation began [min]",
        y="velocity [m/s]",
    )
    axis_text(axes[0, 1], title="East velocity", x="time since navigation began [min]")
    axes[0, 0].legend(loc="best")
    return svg_text(figure, "North and east velocity while parked, by table")


def _wander(flown: list[TableReplay]) -> Markup:
    """Where the parked solution wanders to, on a plain grid."""
    figure, axes = new_figure(width=4.8, height=4.4)
    ax = axes[0, 0]
    for t in flown:
        if t.parked is not None:
            east, north = thinned(t.parked.position_m[:, 1], t.parked.position_m[:, 0])
            ax.plot(east, north, **_style(t))
            ax.plot(east[-1], north[-1], marker="o", color=COLOURS[t.choice.role])
    ax.plot(
        0.0,
        0.0,
        marker="+",
        markersize=11,
        markeredgewidth=1.8,
        color=BLACK,
        linestyle="none",
        label="true",
    )
    _square(ax)
    axis_text(ax, title="Computed position while parked", x="east [m]", y="north [m]")
    ax.legend(loc="best")
    return svg_text(figure, "Computed position while parked on a plain grid, by table")


def _square(ax: "Axes") -> None:
    """Equal scales, and a field that is not a sliver."""
    (x0, x1), (y0, y1) = ax.get_xlim(), ax.get_ylim()
    half = max(0.5 * max(x1 - x0, y1 - y0), LEAST_M)
    ax.set_xlim(0.5 * (x0 + x1) - half, 0.5 * (x0 + x1) + half)
    ax.set_ylim(0.5 * (y0 + y1) - half, 0.5 * (y0 + y1) + half)
    ax.set_aspect("equal")


def _attitude(flown: list[TableReplay]) -> Markup:
    """Roll, pitch and heading from the end of the alignment to the end of the log."""
    figure, axes = new_figure(1, 3, height=2.8)
    for t in flown:
        assert t.history is not None
        roll, pitch, heading = euler_from_dcm(t.history.C_nb)
        angles = [roll / DEG, pitch / DEG, np.unwrap(wrap_pi(heading)) / DEG]
        minutes, *columns = thinned(t.history.time_s / 60, *angles)
        for ax, angle in zip(axes[0], columns):
            ax.plot(minutes, angle, **_style(t))
    for ax, name in zip(axes[0], ("Roll", "Pitch", "Heading, continuous")):
        axis_text(ax, title=name, x="time of the log [min]", y="angle [deg]")
    axes[0, 0].legend(loc="best")
    return svg_text(figure, "Roll, pitch and heading, by table")


def _against(flown: list[TableReplay], name: str) -> Markup:
    """Radial and speed error against an outside track after the parked span."""
    figure, axes = new_figure(1, 2, height=3.0)
    what = {"gnss": "GNSS", "reference": "the reference (scoring only)"}[name]
    drifts = [(t, d) for t in flown if (d := getattr(t, name)) is not None]
    top = max(float(d.radial_m.max()) for _, d in drifts)
    unit, short = _unit_of(top)
    for t, drift in drifts:
        minutes, radial, speed = thinned(
            drift.time_s / 60, drift.radial_m / unit, drift.speed_m_s / KNOT
        )
        axes[0, 0].plot(minutes, radial, **_style(t))
        axes[0, 1].plot(minutes, speed, **_style(t))
    _draw_classes(axes[0, 0], top / NAUTICAL_MILE)
    axes[0, 0].set_ylim(0.0, 1.08 * max(top, LEAST_M) / unit)
    axes[0, 1].set_ylim(bottom=0.0)
    axis_text(
        axes[0, 0],
        title=f"Radial error against {what}",
        x="time since navigation began [min]",
        y=f"error [{short}]",
    )
    axis_text(
        axes[0, 1],
        title="Velocity error, horizontal",
        x="time since navigation began [min]",
        y="error [kt]",
    )
    axes[0, 0].legend(loc="best")
    return svg_text(
        figure, f"Radial and velocity error against {what} after the parked span, by table"
    )
