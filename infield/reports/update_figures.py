"""The drawings of an update report, each from the update document's own numbers (formats.md,
section 5).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from infield.reports.documents.session import HEATING_DEG_C_MIN
from infield.reports.documents.session_records import EstimatedDocument, SessionDocument
from infield.reports.documents.update_records import PointDocument, UpdateDocument
from infield.reports.drawing import (
    AXIS_COLOURS,
    BLACK,
    DASH_DOT,
    DASHED,
    GREEN,
    GREY,
    NEW,
    OLD,
    ORANGE,
    PALE,
    PURPLE,
    SKY,
    YELLOW,
    Boxes,
    Item,
    Line,
    Marks,
    Panel,
    ShadedSpan,
    Strip,
    Uprights,
    drawn_temperatures,
    robust_limits,
    rows_height,
    thinned,
)
from infield.table.thermal_table import ThermalTable
from ins.records import AXES, Span
from ins.verdicts import Observability

SESSION_COLOURS = (BLACK, GREEN, PURPLE, ORANGE, SKY)  # of the runs' points, in turn
# a point may run out of the frame at this many times the sigma that a quarter of all points stay
# below: 1/16 of their weight
VAGUE, BETTER = 4.0, 0.25
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
TIME_AXIS, TEMPERATURE_AXIS, BIAS_AXIS = "time [min]", "gyro temperature [°C]", "bias [deg/h]"
CHAIN_WORDS = "claim 1 of US 5,527,003, smoothed over the parked phase, ±1 sigma"
NODE_SIZE = 2.8  # of a mark at a node of a table
HEADING_AXIS = "heading [deg]"
TIMELINE_PX = 210  # height of one of three
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


def bias_panel(
    document: UpdateDocument, axis: str, before: ThermalTable, after: ThermalTable | None
) -> Panel:
    """Bias against temperature of one gyro: the stored table, the new one (None: unchanged), the
    points.
    """
    points = seen_points(document, axis)
    items: list[Item] = []
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
        items += [line, Marks(nodes, at_nodes, "s", colour, size=NODE_SIZE)]
        inner.append(line.y)
        outer += line.edges
    marks, seen = _point_marks(points, document.run_ids)
    inner.append(seen)
    if not points:
        inner += outer  # nothing but the bands to show: all of them
    return Panel(
        title=f"Gyro {axis}: bias against temperature",
        items=[*items, *marks],
        x_label=TEMPERATURE_AXIS,
        y_label=BIAS_AXIS,
        label=(
            f"Bias of gyro {axis} against temperature: tables before and after,"
            f" {len(points)} points"
        ),
        y_limits=robust_limits(np.concatenate(inner), np.concatenate(outer), spans=0.8),
        group="tables",
    )


def table_curve(
    name: str, T: NDArray, bias_deg_h: NDArray, sigma_deg_h: NDArray, *, colour: str
) -> Line:
    """A table over temperature with its band of 2 sigma to either side; the stored one is
    dashed.
    """
    return Line(
        T,
        bias_deg_h,
        colour,
        name,
        dash=DASHED if colour == OLD else "",
        low=bias_deg_h - 2 * sigma_deg_h,
        high=bias_deg_h + 2 * sigma_deg_h,
    )


def _point_marks(points: Sequence[PointDocument], run_ids: list[str]) -> tuple[list[Item], NDArray]:
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
    items: list[Item] = []
    for number in np.unique(run).astype(int):
        for sign, (mark, word) in WAYS.items():
            rows = (run == number) & (way == sign)
            if rows.any():
                name = f"run {number + 1}, {word}"
                items.append(run_marks(name, mark, T[rows], bias[rows], sigma[rows], number))
    shared = _common_bars(points, run_ids)
    sure = _in_frame(sigma)
    ends = [end for bar in shared for end in (bar.low, bar.high)]
    return [*items, *shared], np.concatenate([(bias - sigma)[sure], (bias + sigma)[sure], *ends])


def _in_frame(sigma: NDArray) -> NDArray:
    """Which points the frame has to hold."""
    return np.asarray(sigma <= VAGUE * np.quantile(sigma, BETTER))


def run_marks(
    name: str, mark: str, x: NDArray, values: NDArray, sigma: NDArray, number: int
) -> Marks:
    """Points of the run of this number (from 0), with 1 sigma to either side."""
    colour = SESSION_COLOURS[number % len(SESSION_COLOURS)]
    return Marks(x, values, mark, colour, name, low=values - sigma, high=values + sigma)


def _common_bars(points: Sequence[PointDocument], run_ids: list[str]) -> list[Uprights]:
    """A bar at the right of each run's points: what they share, 1 sigma to either side of their
    median.
    """
    warmest = max(p.temperature_degC for p in points)
    width = max(warmest - min(p.temperature_degC for p in points), 1.0)
    bars: list[Uprights] = []
    for number, run_id in enumerate(run_ids or [""]):
        mine = [p for p in points if p.run_id in (run_id, None)]
        if not mine or not mine[0].sigma_common_deg_h:
            continue
        at = np.array([warmest + (0.05 + 0.02 * len(bars)) * width])
        middle = np.array([np.median([p.bias_deg_h for p in mine])])
        shared = np.array([mine[0].sigma_common_deg_h])
        colour = SESSION_COLOURS[number % len(SESSION_COLOURS)]
        bars.append(Uprights(at, middle - shared, middle + shared, colour, 4.0, 0.55))
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


def agreement_panel(document: UpdateDocument) -> Panel:
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
    return Panel(
        items=items,
        label="Normalised innovation squared with its bands",
        x_label="normalised innovation squared per degree of freedom (1: the noise model is right)",
        x_limits=(low, high),
        y_limits=(foot, head),
        x_log=True,
        y_ticks=[(y, row.name) for y, row in enumerate(rows)],
        height=rows_height(len(rows)),
    )


def _plain(text: str, longest: int = 32) -> str:
    """Text from a document for a drawing: ASCII and short."""
    return str(text).encode("ascii", "replace").decode()[:longest]


def timeline_panels(session: SessionDocument, spans: Sequence[Span]) -> list[Panel]:
    """Gyro temperatures, heading and velocity over the run: phases as strips, excluded spans
    shaded; empty where there is nothing.
    """
    phases = session.phases if isinstance(session, EstimatedDocument) else ()
    strips = [
        Strip(
            phase.start_s / MINUTE,
            phase.end_s / MINUTE,
            _plain(phase.phase).replace("_", " "),
            PHASE_COLOURS.get(phase.phase, GREY),
        )
        for phase in phases
    ]
    found = []
    for unit, time_s, columns in _time_series(session):
        t, *values = thinned(time_s, *(column.values for column in columns))
        if unit == HEADING_AXIS:
            values = [_without_jumps(heading) for heading in values]
        items: list[Item] = [
            Line(t / MINUTE, value, column.colour, column.name, 1.3, column.dash)
            for column, value in zip(columns, values)
        ]
        found.append(
            Panel(
                items=items,
                label=f"{unit} over time, with phases and excluded spans",
                x_label=TIME_AXIS,
                y_label=unit,
                x_limits=(0.0, max((session.duration_s or 0.0) / MINUTE, 1e-3)),
                y_limits=_heading_limits(values[0]) if unit == HEADING_AXIS else None,
                spans=[ShadedSpan(span.start_s / MINUTE, span.end_s / MINUTE) for span in spans],
                strips=strips,
                group=session.run_id,
                circle=unit == HEADING_AXIS,
                height=TIMELINE_PX,
            )
        )
    return found


def _heading_limits(heading_deg: NDArray) -> tuple[float, float]:
    """Of a heading, and a tenth of a degree at least."""
    low, high = robust_limits(heading_deg)
    middle, half = 0.5 * (low + high), max(0.5 * (high - low), 0.05)
    return middle - half, middle + half


def _without_jumps(heading_deg: NDArray) -> NDArray:
    """A heading that goes on beyond north, its mean within half a turn of it."""
    heading, good = heading_deg.copy(), np.isfinite(heading_deg)
    if good.any():
        heading[good] = np.unwrap(heading[good], period=360.0)
        heading -= 360.0 * np.round(np.mean(heading[good]) / 360.0)
    return heading


@dataclass(frozen=True)
class _Column:
    """A curve over time."""

    name: str
    values: Sequence[float | None]
    colour: str
    dash: str = ""


def _time_series(session: SessionDocument) -> list[tuple[str, Sequence[float], list[_Column]]]:
    """Unit, time [s] and columns of each quantity that the run holds over time."""
    found: list[tuple[str, Sequence[float], list[_Column]]] = []
    temperature = session.temperature
    if temperature:
        rows = temperature.gyro_degC
        gyros = [
            _Column(f"gyro {axis}", [row[k] for row in rows], AXIS_COLOURS[axis], AXIS_DASHES[axis])
            for k, axis in enumerate(AXES)
        ]
        found.append(("temperature [°C]", temperature.time_s, gyros))
    velocity = session.velocity if isinstance(session, EstimatedDocument) else None
    if velocity:
        heading = _Column("heading", velocity.heading_deg, BLACK)
        north = _Column("north", velocity.north_m_s, BLACK)
        east = _Column("east", velocity.east_m_s, ORANGE, DASHED)
        found.append((HEADING_AXIS, velocity.time_s, [heading]))
        found.append(("velocity [m/s]", velocity.time_s, [north, east]))
    return found


def residual_panel(session: SessionDocument, axis: str) -> Panel | None:
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
    minutes = t / MINUTE
    after = Marks(minutes, new, "o", NEW, "after, ±1 sigma", low=new - sigma, high=new + sigma)
    before = Marks(minutes, old, "o", OLD, "before", hollow=True)
    sure = _in_frame(sigma)
    shown = [(new - sigma)[sure], (new + sigma)[sure], old[sure], [0.0]]
    return Panel(
        title=f"Gyro {axis}: points less the table",
        items=[_zero(minutes), after, before],
        x_label=TIME_AXIS,
        y_label="residual [deg/h]",
        label=f"Residuals of gyro {axis} over time to the table before and after",
        y_limits=robust_limits(np.concatenate(shown)),
        group=session.run_id,
    )


def _zero(minutes: NDArray) -> Line:
    """The line of no difference."""
    return Line(minutes[[0, -1]], np.zeros(2), GREY, width=1.0)


def coverage_panel(session: SessionDocument) -> Panel | None:
    """Minutes of the run in each 5 degC band, the three gyros side by side; None where not
    known.
    """
    if not isinstance(session, EstimatedDocument) or not session.coverage:
        return None
    items: list[Item] = []
    highest = 0.0
    for k, axis in enumerate(AXES):
        mine = [r for r in session.coverage if r.axis == axis]
        centre, time_s = thinned(
            [0.5 * (r.low_degC + r.high_degC) for r in mine], [r.seconds for r in mine]
        )
        left = (centre + 1.4 * (k - 1) - 0.65).tolist()
        rows = [(x, x + 1.3, 0.0, seconds) for x, seconds in zip(left, time_s.tolist())]
        items.append(Boxes(rows, AXIS_COLOURS[axis], name=f"gyro {axis}"))
        highest = max(highest, float(time_s.max(initial=0.0)))
    return Panel(
        items=items,
        title="Time in each 5 °C band",
        label=f"Seconds of run {session.run_id} in each 5 degC band of gyro temperature",
        x_label=TEMPERATURE_AXIS,
        y_label="time [s]",
        y_limits=(0.0, 1.05 * highest or 1.0),
    )


def chain_panel(session: SessionDocument, direction: str) -> Panel | None:
    """The patent's chain beside the filter along `north` or `east` of the parked heading; None
    without points.
    """
    chain = session.claim_chain if isinstance(session, EstimatedDocument) else None
    if not chain or not chain.points:
        return None
    known = direction == "north" or chain.heading_error_mrad is not None
    alone = "north" if direction == "north" else "east_relative"  # what the chain finds by itself
    columns = (
        "time_s",
        f"{direction if known else alone}_deg_h",
        "sigma_deg_h",
        f"filter_{direction}_deg_h",
        f"{alone}_deg_h",
        f"bracket_{alone}_deg_h",
    )
    t, value, sigma, by_filter, from_alignment, bracket = thinned(
        *([getattr(row, name) for row in chain.points] for name in columns)
    )
    low, high = value - sigma, value + sigma
    minutes = t / MINUTE
    windows = Marks(
        minutes,
        bracket + value - from_alignment,
        "x",
        GREY,
        "the same by the Schuler bracket on windows",
    )
    smoothed = Marks(minutes, value, "s", GREEN, CHAIN_WORDS, low=low, high=high)
    filtered = Line(minutes, by_filter, NEW, "filter")
    name = "East" if known else "East, relative"
    return Panel(
        title=f"{name if direction == 'east' else 'North'}: bias beyond the stored table",
        items=[_zero(minutes), windows, smoothed, filtered],
        x_label=TIME_AXIS,
        y_label=BIAS_AXIS,
        label=f"Claim chain beside the filter, {direction}",
        y_limits=robust_limits(np.concatenate([low, high, by_filter, [0.0]])),
        group=session.run_id,
    )


MARGIN_DEGC = 3.0  # beside the visited temperatures


def shape_panel(
    document: UpdateDocument, axis: str, before: ThermalTable, after: ThermalTable | None
) -> Panel | None:
    """Bias of one gyro less each run's own level, with the tables less theirs; None without
    points.
    """
    points = seen_points(document, axis)
    if not points:
        return None
    T_all = np.array([p.temperature_degC for p in points])
    reference = float(np.median(T_all))
    T = np.linspace(T_all.min() - MARGIN_DEGC, T_all.max() + MARGIN_DEGC, 121)
    curves = [
        table_curve(name, T, *_less_level(table, axis, T, reference), colour=colour)
        for table, name, colour in ((before, "stored table", OLD), (after, "new table", NEW))
        if table is not None
    ]
    outer = [edge for curve in curves for edge in curve.edges]
    runs = _run_marks(document, points, axis, after or before, reference)
    inner = np.concatenate([*(curve.y for curve in curves), *(marks.y for marks in runs)])
    items: list[Item] = [*curves, *runs]
    return Panel(
        title=f"Gyro {axis}: shape over temperature",
        items=items,
        x_label=TEMPERATURE_AXIS,
        y_label="bias less level [deg/h]",
        label=f"Shape of the bias of gyro {axis} over temperature, the level of each run taken out",
        y_limits=robust_limits(inner, np.concatenate(outer), spans=0.5),
        group="shapes",
    )


def _less_level(
    table: ThermalTable, axis: str, T: NDArray, reference_degC: float
) -> tuple[NDArray, NDArray]:
    """Bias less that at the reference temperature, and the sigma of the difference [deg/h]."""
    rows = table.basis(axis, T) - table.basis(axis, [reference_degC])
    variance = np.einsum("ki,ij,kj->k", rows, table.covariance, rows)
    return rows @ table.parameters, np.sqrt(np.maximum(variance, 0.0))


def _run_marks(
    document: UpdateDocument,
    points: Sequence[PointDocument],
    axis: str,
    table: ThermalTable,
    reference_degC: float,
) -> list[Marks]:
    """Points of each run less the run's mean departure from the table, white noise as their
    sigma.
    """
    found = []
    for number, session in enumerate(document.sessions):
        mine = [p for p in points if p.run_id == session.run_id]
        zero_rate = session.zero_rate if isinstance(session, EstimatedDocument) else None
        if not mine or zero_rate is None:
            continue
        T, bias, duration = thinned(
            [p.temperature_degC for p in mine],
            [p.bias_deg_h for p in mine],
            [p.duration_s for p in mine],
        )
        shape = _less_level(table, axis, T, reference_degC)[0]
        walk = zero_rate.angle_random_walk_deg_sqrt_h[AXES.index(axis)]
        y, sigma = bias - np.mean(bias - shape), walk / np.sqrt(duration / 3600.0)
        found.append(run_marks(f"run {number + 1}", "o", T, y, sigma, number))
    return found
