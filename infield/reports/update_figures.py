"""The drawings of an update report, each from the update document's own numbers (formats.md,
section 5).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from infield.reports.charts import DASH_DOT, DASHED, Boxes, Item, Line, Marks, Panel, chart
from infield.reports.documents.session import HEATING_DEG_C_MIN
from infield.reports.documents.session_records import (
    ChainRow,
    EstimatedDocument,
    PhaseDocument,
    SessionDocument,
    TemperatureDocument,
    VelocityDocument,
)
from infield.reports.documents.spans import SpanDocument
from infield.reports.documents.update_records import PointDocument, UpdateDocument
from infield.reports.figures import (
    AXIS_COLOURS,
    BLACK,
    GREEN,
    GREY,
    NEW,
    OLD,
    ORANGE,
    PALE,
    PANEL_WIDTH,
    PURPLE,
    SKY,
    YELLOW,
    drawn_temperatures,
    robust_limits,
    thinned,
)
from infield.reports.zoom import BAR_MARK, HOLLOW_MARK, NODE_MARK, ZoomCurve, ZoomFigure, ZoomStrip
from infield.table.thermal_table import ThermalTable
from ins.records import AXES
from ins.verdicts import Observability

SESSION_COLOURS = (BLACK, GREEN, PURPLE, ORANGE, SKY)  # of the runs' points, in turn
VAGUE = 4.0  # a point this many times the median sigma may run out of the frame: 1/16 of the weight
PHASE_COLOURS = {
    "alignment": SKY,
    "extended_alignment": "#A9D8F5",
    "parked": GREEN,
    "taxi": ORANGE,
    "takeoff": YELLOW,
    "flight": PALE,
    "landing": YELLOW,
}
MINUTE = 60.0
AXIS_DASHES = {"x": "", "y": DASHED, "z": DASH_DOT}
LEAST_RATIO = 1e-4  # where a logarithmic axis of ratios begins at the latest
TIME_AXIS, TEMPERATURE_AXIS = "time [min]", "gyro temperature [°C]"
HEADING_UNIT = "heading [deg]"
WAYS = {1: ("^", "heating"), -1: ("v", "cooling"), 0: ("o", "settled")}  # of a point: mark, word


def seen_points(document: UpdateDocument, axis: str) -> list[PointDocument]:
    """The points of an axis that carry something of their own: not those of a run that did not
    observe it.
    """
    return [
        p
        for p in document.points
        if p.axis == axis and p.observability != Observability.NOT_OBSERVABLE
    ]


def bias_figure(
    document: UpdateDocument, axis: str, before: ThermalTable, after: ThermalTable | None
) -> ZoomFigure:
    """Bias against temperature of one gyro: the stored table, the new one (None: unchanged), the
    points.
    """
    points = seen_points(document, axis)
    curves: list[ZoomCurve] = []
    inner: list[NDArray] = []
    outer: list[NDArray] = []
    for table, name, colour in ((before, "stored table", OLD), (after, "new table", NEW)):
        if table is None:
            continue
        nodes = table.temperature_degC[AXES.index(axis)]
        T = drawn_temperatures(nodes)
        line = table_curve(
            name, T, table.bias_deg_h(axis, T), table.sigma_deg_h(axis, T), colour=colour
        )
        at_nodes = table.bias_deg_h(axis, nodes)
        curves += [
            line,
            ZoomCurve(name="", values=at_nodes, x=nodes, mark=NODE_MARK, colour=colour),
        ]
        inner.append(line.values)
        outer += line.edges
    marks, seen = _point_curves(points, document.run_ids)
    inner.append(seen)
    if not points:
        inner += outer  # nothing but the bands to show: all of them
    return ZoomFigure(
        title=f"Gyro {axis}: bias against temperature",
        unit="bias [deg/h]",
        time_s=T,
        curves=[*curves, *marks],
        x_name=TEMPERATURE_AXIS,
        label=(
            f"Bias of gyro {axis} against temperature: tables before and after,"
            f" {len(points)} points"
        ),
        limits=robust_limits(np.concatenate(inner), np.concatenate(outer), spans=0.8),
        group="tables",
        panel=True,
    )


def table_curve(
    name: str, T: NDArray, bias_deg_h: NDArray, sigma_deg_h: NDArray, *, colour: str
) -> ZoomCurve:
    """A table over temperature with its band of 2 sigma to either side; the stored one is
    dashed.
    """
    return ZoomCurve(
        name=name,
        values=bias_deg_h,
        low=bias_deg_h - 2 * sigma_deg_h,
        high=bias_deg_h + 2 * sigma_deg_h,
        x=T,
        colour=colour,
        dashed=colour == OLD,
    )


def _point_curves(
    points: Sequence[PointDocument], run_ids: list[str]
) -> tuple[list[ZoomCurve], NDArray]:
    """Points with 1 sigma; up-triangles heating, down-triangles cooling, circles settled; and what
    must be seen.
    """
    if not points:
        return [], np.empty(0)
    T, bias, sigma = thinned(
        [p.temperature_degC for p in points],
        [p.bias_deg_h for p in points],
        [p.sigma_deg_h if p.sigma_own_deg_h is None else p.sigma_own_deg_h for p in points],
    )
    run, rate = thinned(
        [run_ids.index(p.run_id) if p.run_id in run_ids else 0 for p in points],
        [p.temperature_rate_degC_min or 0.0 for p in points],
    )
    way = np.where(np.abs(rate) < HEATING_DEG_C_MIN, 0, np.sign(rate))
    curves = []
    for number in np.unique(run).astype(int):
        for sign, (mark, word) in WAYS.items():
            rows = (run == number) & (way == sign)
            if rows.any():
                name = f"run {number + 1}, {word}"
                curves.append(marked_curve(name, mark, T[rows], bias[rows], sigma[rows], number))
    shared = _common_curves(points, run_ids)
    sure = sigma <= VAGUE * np.median(sigma)
    ends = [end for curve in shared for end in curve.edges]
    return [*curves, *shared], np.concatenate([(bias - sigma)[sure], (bias + sigma)[sure], *ends])


def marked_curve(
    name: str, mark: str, x: NDArray, values: NDArray, sigma: NDArray, number: int
) -> ZoomCurve:
    """Points of the run of this number (from 0), with 1 sigma to either side."""
    return ZoomCurve(
        name=name,
        values=values,
        low=values - sigma,
        high=values + sigma,
        x=x,
        mark=mark,
        colour=SESSION_COLOURS[number % len(SESSION_COLOURS)],
    )


def _common_curves(points: Sequence[PointDocument], run_ids: list[str]) -> list[ZoomCurve]:
    """A bar at the right of each run's points: what they share, 1 sigma to either side of their
    median.
    """
    warmest = max(p.temperature_degC for p in points)
    width = max(warmest - min(p.temperature_degC for p in points), 1.0)
    bars: list[ZoomCurve] = []
    for number, run_id in enumerate(run_ids or [""]):
        mine = [p for p in points if p.run_id in (run_id, None)]
        if not mine or not mine[0].sigma_common_deg_h:
            continue
        at = np.array([warmest + (0.05 + 0.02 * len(bars)) * width])
        middle = np.array([np.median([p.bias_deg_h for p in mine])])
        shared = np.array([mine[0].sigma_common_deg_h])
        bars.append(marked_curve("", BAR_MARK, at, middle, shared, number))
    return bars


@dataclass(frozen=True)
class _Ratios:
    """A line of the drawing: NIS per degree of freedom with the bands it is tested against."""

    name: str
    values: Sequence[float | None]
    band_95: Sequence[float] | None = None
    band_999: Sequence[float] | None = None

    @property
    def numbers(self) -> list[float]:
        """All that the axis must show."""
        found = [*self.values, *(self.band_95 or ()), *(self.band_999 or ())]
        return [value for value in found if value is not None]


def _tested(document: UpdateDocument) -> list[_Ratios]:
    """What is tested against a band: all measurements, and each merge."""
    seen, run_ids = document.consistency, document.run_ids
    rows = [_Ratios("all measurements", [seen.nis_mean], seen.band_95, seen.band_999)]
    for merge in seen.merge:
        several = len(run_ids) > 1 and merge.run_id in run_ids
        run = f", run {run_ids.index(merge.run_id) + 1}" if several else ""
        band = [limit / merge.dof for limit in merge.band_999]
        rows.append(_Ratios(f"against the table{run}", [merge.nis / merge.dof], None, band))
    return rows


def _kinds(document: UpdateDocument) -> list[_Ratios]:
    """The kinds of measurement, a dot a run."""
    kinds: dict[str, list[float]] = {}
    for session in document.sessions:
        if isinstance(session, EstimatedDocument):
            for kind, found in session.measurements.items():
                kinds.setdefault(kind, []).append(found.nis_mean)
    return [_Ratios(_plain(kind), values) for kind, values in sorted(kinds.items())]


def agreement_drawing(document: UpdateDocument) -> Markup:
    """NIS per degree of freedom: the whole filter and each merge in their bands, each kind of
    measurement as dots.
    """
    rows = [*_tested(document), *_kinds(document)]
    items: list[Item] = []
    for y, row in enumerate(rows):
        for band, opacity in ((row.band_999, 0.22), (row.band_95, 0.45)):
            if band:
                items.append(Boxes([(band[0], band[1], y - 0.36, y + 0.36)], SKY, opacity))
    numbers = [value for row in rows for value in row.numbers]
    low = max(min(0.45, 0.85 * min(numbers)), LEAST_RATIO)
    high = max(2.2, 1.2 * max(numbers))
    foot, head = len(rows) - 0.4, -0.6
    items.append(Line(np.ones(2), np.array([foot, head]), GREY, width=0.9))
    for y, row in enumerate(rows):
        values = np.array([np.nan if value is None else value for value in row.values])
        mark, colour = ("D", BLACK) if row.band_999 else ("o", GREY)
        items.append(Marks(values, np.full(values.size, float(y)), mark, colour, size=5.0))
    panel = Panel(
        items=items,
        x_label="normalised innovation squared per degree of freedom (1: the noise model is right)",
        x_limits=(low, high),
        y_limits=(foot, head),
        x_log=True,
        y_ticks=[(y, row.name) for y, row in enumerate(rows)],
    )
    label = "Normalised innovation squared with its bands"
    return chart([panel], label, height=0.75 + 0.27 * len(rows))


def _plain(text: str, longest: int = 32) -> str:
    """Text from a document for a drawing: ASCII and short."""
    return str(text).encode("ascii", "replace").decode()[:longest]


def timeline_drawing(session: SessionDocument, spans: Sequence[SpanDocument]) -> Markup | None:
    """Phases and excluded spans, gyro temperatures, heading and velocity over the run; None where
    there is nothing.
    """
    temperature = session.temperature
    velocity = session.velocity if isinstance(session, EstimatedDocument) else None
    phases = session.phases if isinstance(session, EstimatedDocument) else ()
    panels: list[Panel] = []
    if temperature:
        panels.append(_temperature_panel(temperature))
    if velocity:
        panels += [_heading_panel(velocity), _velocity_panel(velocity)]
    if spans:
        shaded = Boxes([(*_minutes(span), None, None) for span in spans], PALE, 0.6)
        for panel in panels:
            panel.items.insert(0, shaded)
    if phases or spans:
        panels.insert(0, _strip_panel(phases, spans))
    if not panels:
        return None
    panels[-1].x_label = "time since the start of the run [min]"
    panels[-1].x_limits = (0.0, max((session.duration_s or 0.0) / MINUTE, 1e-3))
    return chart(
        panels,
        "Timeline: phases, excluded spans, temperature, heading and velocity",
        height=0.8 + 1.35 * sum(panel.share for panel in panels),
    )


def _minutes(span: PhaseDocument | SpanDocument) -> tuple[float, float]:
    """Start and end [min]."""
    return span.start_s / MINUTE, span.end_s / MINUTE


def _strip_panel(phases: Sequence[PhaseDocument], spans: Sequence[SpanDocument]) -> Panel:
    items: list[Item] = []
    for name in dict.fromkeys(p.phase for p in phases):
        rows = [(*_minutes(p), 0.6, 1.4) for p in phases if p.phase == name]
        colour, words = PHASE_COLOURS.get(name, GREY), _plain(name).replace("_", " ")
        items.append(Boxes(rows, colour, name=words))
    if spans:
        rows = [(*_minutes(span), -0.4, 0.4) for span in spans]
        items.append(Boxes(rows, BLACK, least=1.2))
    return Panel(
        items=items,
        share=0.55,
        y_limits=(-0.6, 1.6),
        y_ticks=[(0.0, "excluded"), (1.0, "phases")],
        grid_y=False,
        legend="beside" if phases else "",
    )


def _temperature_panel(temperature: TemperatureDocument) -> Panel:
    items: list[Item] = []
    for k, axis in enumerate(AXES):
        t, value = thinned(temperature.time_s, [row[k] for row in temperature.gyro_degC])
        colour, dash = AXIS_COLOURS[axis], AXIS_DASHES[axis]
        name = f"gyro {axis}"
        items.append(Line(t / MINUTE, value, colour, name=name, width=1.3, dash=dash))
    return Panel(items=items, share=1.3, y_label="temp. [°C]", legend="beside")


def _heading_panel(velocity: VelocityDocument) -> Panel:
    """Drawn without a jump at north; the labels are in [0, 360)."""
    t, heading = thinned(velocity.time_s, velocity.heading_deg)
    heading = _without_jumps(heading)
    low, high = robust_limits(heading)
    middle, half = 0.5 * (low + high), max(0.5 * (high - low), 0.05)
    step = None
    if half > 90.0:  # parts of a circle: labels that begin anew at 360 stay readable
        step = 90.0 if half <= 270.0 else 180.0 if half <= 540.0 else 360.0
    elif half > 30.0:
        step = 30.0 if half <= 60.0 else 45.0
    return Panel(
        items=[Line(t / MINUTE, heading, BLACK, width=1.3)],
        y_label=HEADING_UNIT,
        y_limits=(middle - half, middle + half),
        y_step=step,
        circle=True,
    )


def _without_jumps(heading_deg: NDArray) -> NDArray:
    """A heading that goes on beyond north, its mean within half a turn of it."""
    heading, good = heading_deg.copy(), np.isfinite(heading_deg)
    if good.any():
        heading[good] = np.unwrap(heading[good], period=360.0)
        heading -= 360.0 * np.round(np.mean(heading[good]) / 360.0)
    return heading


def _velocity_panel(velocity: VelocityDocument) -> Panel:
    curves = (("north", velocity.north_m_s, BLACK, ""), ("east", velocity.east_m_s, ORANGE, DASHED))
    items: list[Item] = []
    for name, v_m_s, colour, dash in curves:
        t, value = thinned(velocity.time_s, v_m_s)
        items.append(Line(t / MINUTE, value, colour, name=name, width=1.3, dash=dash))
    return Panel(items=items, y_label="velocity [m/s]", legend="beside")


def timeline_figures(session: SessionDocument, spans: Sequence[SpanDocument]) -> list[ZoomFigure]:
    """What `timeline_drawing` shows as figures that a reader can zoom: phases are strips, excluded
    spans are shaded.
    """
    shaded = [(span.start_s / MINUTE, span.end_s / MINUTE) for span in spans]
    phases = session.phases if isinstance(session, EstimatedDocument) else ()
    strips = [
        ZoomStrip(
            p.start_s / MINUTE,
            p.end_s / MINUTE,
            _plain(p.phase).replace("_", " "),
            PHASE_COLOURS.get(p.phase, GREY),
        )
        for p in phases
    ]
    figures = []
    for unit, time_s, columns in _time_series(session):
        t, *values = thinned(time_s, *(column for _, column, _ in columns))
        curves = [
            ZoomCurve(name=name, values=value, colour=colour)
            for (name, _, colour), value in zip(columns, values)
        ]
        circle = unit == HEADING_UNIT
        if circle:
            curves = [replace(curve, values=_without_jumps(curve.values)) for curve in curves]
        figures.append(
            ZoomFigure(
                title=unit,
                unit=unit,
                time_s=t / MINUTE,
                curves=curves,
                spans=shaded,
                strips=strips,
                x_name=TIME_AXIS,
                circle=circle,
                group=session.run_id,
            )
        )
    return figures


_Column = tuple[str, Sequence[float | None], str]  # name, values, colour


def _time_series(session: SessionDocument) -> list[tuple[str, Sequence[float], list[_Column]]]:
    """Unit, time [s] and columns of each quantity that the run holds over time."""
    found: list[tuple[str, Sequence[float], list[_Column]]] = []
    temperature = session.temperature
    if temperature:
        rows = temperature.gyro_degC
        gyros: list[_Column] = [
            (f"gyro {axis}", [row[k] for row in rows], AXIS_COLOURS[axis])
            for k, axis in enumerate(AXES)
        ]
        found.append(("temperature [°C]", temperature.time_s, gyros))
    velocity = session.velocity if isinstance(session, EstimatedDocument) else None
    if velocity:
        heading: _Column = ("heading", velocity.heading_deg, BLACK)
        ways: list[_Column] = [
            ("north", velocity.north_m_s, BLACK),
            ("east", velocity.east_m_s, ORANGE),
        ]
        found.append((HEADING_UNIT, velocity.time_s, [heading]))
        found.append(("velocity [m/s]", velocity.time_s, ways))
    return found


def residual_figure(session: SessionDocument, axis: str) -> ZoomFigure | None:
    """Points of one run less the table before and after, over time, with the points' own sigma;
    None without points.
    """
    if not isinstance(session, EstimatedDocument):
        return None
    rows = [r for r in session.residuals if r.axis == axis]
    seen = session.observability.get(axis)
    if not rows or (seen is not None and seen.verdict == Observability.NOT_OBSERVABLE):
        return None
    t, old, new, sigma = thinned(
        [r.time_s for r in rows],
        [r.before_deg_h for r in rows],
        [r.after_deg_h for r in rows],
        [r.sigma_deg_h for r in rows],
    )
    after = ZoomCurve(
        name="after", values=new, low=new - sigma, high=new + sigma, mark="o", colour=NEW
    )
    before = ZoomCurve(name="before", values=old, mark=HOLLOW_MARK, colour=OLD)
    sure = sigma <= VAGUE * np.median(sigma)
    shown = [(new - sigma)[sure], (new + sigma)[sure], old[sure], [0.0]]
    return ZoomFigure(
        title=f"Gyro {axis}: points less the table",
        unit="residual [deg/h]",
        time_s=t / MINUTE,
        curves=[_zero(t), after, before],
        x_name=TIME_AXIS,
        label=f"Residuals of gyro {axis} over time to the table before and after",
        limits=robust_limits(np.concatenate(shown)),
        group=session.run_id,
        panel=True,
    )


def _zero(time_s: NDArray) -> ZoomCurve:
    """The line of no difference."""
    return ZoomCurve(name="", values=np.zeros(time_s.size), colour=GREY)


def coverage_drawing(session: SessionDocument) -> Markup | None:
    """Minutes of the run in each 5 degC band, the three gyros side by side; None where not
    known.
    """
    if not isinstance(session, EstimatedDocument) or not session.coverage:
        return None
    items: list[Item] = []
    for k, axis in enumerate(AXES):
        mine = [r for r in session.coverage if r.axis == axis]
        centre, time_s = thinned(
            [0.5 * (r.low_degC + r.high_degC) for r in mine], [r.seconds for r in mine]
        )
        left = (centre + 1.4 * (k - 1) - 0.65).tolist()
        rows = [(x, x + 1.3, 0.0, seconds) for x, seconds in zip(left, time_s.tolist())]
        items.append(Boxes(rows, AXIS_COLOURS[axis], name=f"gyro {axis}"))
    highest = max(float(item.extent()[1].max(initial=0.0)) for item in items)
    panel = Panel(
        items=items,
        title="Time in each 5 °C band",
        x_label=TEMPERATURE_AXIS,
        y_label="time [s]",
        y_limits=(0.0, 1.05 * highest or 1.0),
        legend="below",
    )
    label = f"Seconds of run {session.run_id} in each 5 degC band of gyro temperature"
    return chart([panel], label, width=PANEL_WIDTH, height=2.6)


def chain_figure(session: SessionDocument, direction: str) -> ZoomFigure | None:
    """The patent's chain beside the filter along `north` or `east` of the parked heading; None
    without points.
    """
    chain = session.claim_chain if isinstance(session, EstimatedDocument) else None
    if not chain or not chain.points:
        return None
    known = direction == "north" or chain.heading_error_mrad is not None
    rows = _north if direction == "north" else partial(_east, known=known)
    t, value, sigma, by_filter, from_alignment, bracket = thinned(
        *zip(*(rows(row) for row in chain.points))
    )
    low, high = value - sigma, value + sigma
    windows = ZoomCurve(
        name="by windows", values=bracket + value - from_alignment, mark="x", colour=GREY
    )
    smoothed = ZoomCurve(name="chain", values=value, low=low, high=high, mark="s", colour=GREEN)
    filtered = ZoomCurve(name="filter", values=by_filter, colour=NEW)
    name = "East" if known else "East, relative"
    return ZoomFigure(
        title=f"{name if direction == 'east' else 'North'}: bias beyond the stored table",
        unit="bias [deg/h]",
        time_s=t / MINUTE,
        curves=[_zero(t), windows, smoothed, filtered],
        x_name=TIME_AXIS,
        label=f"Claim chain beside the filter, {direction}",
        limits=robust_limits(np.concatenate([low, high, by_filter, [0.0]])),
        group=session.run_id,
        panel=True,
    )


def _north(row: ChainRow) -> tuple[float | None, ...]:
    """Time; the chain, its sigma, the filter [deg/h]; the chain from the alignment and the bracket
    [deg/h].
    """
    return (
        row.time_s,
        row.north_deg_h,
        row.sigma_deg_h,
        row.filter_north_deg_h,
        row.north_deg_h,
        row.bracket_north_deg_h,
    )


def _east(row: ChainRow, *, known: bool) -> tuple[float | None, ...]:
    """The same along east; relative where the heading error is not known."""
    return (
        row.time_s,
        row.east_deg_h if known else row.east_relative_deg_h,
        row.sigma_deg_h,
        row.filter_east_deg_h,
        row.east_relative_deg_h,
        row.bracket_east_relative_deg_h,
    )
