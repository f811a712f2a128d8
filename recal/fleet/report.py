"""fleet.html: the fleet document as one page that fetches nothing. Computes nothing."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from markupsafe import Markup

from recal.fleet.records import (
    OUTCOMES,
    CallTiming,
    FleetOutcome,
    FleetReport,
    FleetVerdict,
    StaleRow,
    TemperatureBand,
    UnitRow,
)
from recal.service.priors.forecast_page import date_words, trend_panels, trend_strips
from recal.service.results.pages import (
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    PALE,
    VERMILLION,
    Boxes,
    Item,
    Line,
    Marks,
    Panel,
    Uprights,
    decimals_for,
    render_page,
    thinned,
)

OUTCOME_COLOURS = {
    FleetOutcome.COMMITTED: BLUE,
    FleetOutcome.PROPOSED: BLUE,
    FleetOutcome.ALREADY: PALE,
    FleetOutcome.INCONSISTENT: VERMILLION,
    FleetOutcome.REFUSED: ORANGE,
    FleetOutcome.BAD_INPUT: GREY,
    FleetOutcome.TAKEN_OUT: PALE,
    FleetOutcome.CRASHED: "#000000",
}
FEW_LABELS = 6.0  # along the axis of a count; chosen: 6 have room beside each other
# units whose serials find room below the axis: turned, and level on a phone (390 px)
MOST_SERIALS, MOST_LEVEL = 25, 3
HIGHEST = 2.2  # times the 90th percentile: above it the ranking's axis is cut
STRIP_DEGC = (-40.0, 80.0)  # of a unit's coverage strip


def whole_step(most: float) -> float | None:
    """Of an axis of a count up to so many: 1 where a round step might be a part of one."""
    return 1.0 if most <= FEW_LABELS else None


def ranking_panel(document: FleetReport) -> Panel | None:
    """Predicted drift of every unit, the largest first, with what the new table leaves (1
    sigma).
    """
    drifts = [
        (u.rank, u.drift.nm_h, u.drift.sigma_nm_h, u.drift.surprise_sigmas)
        for u in document.units
        if u.drift
    ]
    if not drifts:
        return None
    rank, nm_h, sigma, surprise = thinned(*zip(*drifts))
    top = max(HIGHEST * float(np.quantile(nm_h, 0.9)), 1.05 * float(np.median(nm_h + sigma)), 1e-6)
    far = surprise > document.criteria.surprise_sigmas
    items: list[Item] = [Uprights(rank, nm_h - sigma, nm_h + sigma, GREY, width=2.0)]
    for mask, colour, mark, name in (
        (~far, BLUE, "o", "within what its table said"),
        (far, VERMILLION, "D", "beyond it"),
    ):
        if mask.any():
            items.append(Marks(rank[mask], np.minimum(nm_h[mask], top), mark, colour, name))
    steps = [(u.rank, u.step_drift.nm_h) for u in document.units if u.drift and u.step_drift]
    if steps:
        rank_of_step, size = thinned(*zip(*steps))
        cut = np.minimum(size, top)
        items.append(Marks(rank_of_step, cut, "s", ORANGE, "a step against its table", size=4.5))
    highest = max([float((nm_h + sigma).max()), *(size for _, size in steps)])
    last = float(rank.max()) + 1.0
    named = [(float(u.rank or 0), u.imu_serial) for u in document.units if u.drift]
    few = len(named) <= MOST_SERIALS
    return Panel(
        items=items,
        label=f"Predicted drift of {len(drifts)} units in NM/h, largest first, with sigma",
        x_label="unit" if few else "rank",
        x_ticks=named if few else None,
        upright=few and len(named) > MOST_LEVEL,
        y_label="drift [NM/h]",
        x_limits=(0.0, last),
        x_step=whole_step(last),
        y_limits=(0.0, 1.06 * min(top, highest)),
    )


def coverage_panel(document: FleetReport) -> Panel | None:
    """How many units were seen in each band of temperature."""
    bands = document.coverage
    if not bands:
        return None
    most = float(max(b.units for b in bands))
    return Panel(
        items=[Boxes([(b.low_degC + 0.2, b.low_degC + 4.8, 0.0, b.units) for b in bands], GREEN)],
        title="Units seen at a temperature",
        x_label="gyro temperature [°C]",
        y_label="units",
        y_limits=(0.0, 1.08 * most),
        y_step=whole_step(most),
        label="Number of units with merged data in each 5 degC band of gyro temperature",
    )


def tables_panel(document: FleetReport) -> Panel | None:
    """Age and sigma of the tables in the store."""
    tables = [u.table for u in document.units if u.table]
    if not tables:
        return None
    against = np.array([t.contradictions > 0 for t in tables])
    age = np.array([t.age_days for t in tables])
    sigma = np.array([t.sigma_deg_h for t in tables])
    items: list[Item] = [
        Marks(age[mask], sigma[mask], mark, colour, name)
        for mask, colour, mark, name in (
            (~against, BLUE, "o", "not contradicted"),
            (against, VERMILLION, "D", "contradicted"),
        )
        if mask.any()
    ]
    return Panel(
        items=items,
        title="Stored tables: age and sigma",
        x_label="days since its newest data",
        y_label="sigma [deg/h]",
        y_limits=(0.0, 1.1 * float(sigma.max())),
        label=f"Age and sigma of {len(tables)} stored tables",
    )


def progress_panel(timing: CallTiming) -> Panel | None:
    """Runs completed against time, of this call."""
    curve = timing.curve
    if len(curve) < 2:
        return None
    seconds, runs = thinned(*zip(*curve))
    return Panel(
        items=[Line(seconds / 60.0, runs, BLUE)],
        title="Runs completed in this call",
        x_label="minutes",
        y_label="runs",
        x_limits=(0.0, float(max(seconds.max() / 60.0, 1e-3))),
        y_limits=(0.0, 1.05 * float(runs.max())),
        y_step=whole_step(float(runs.max())),
        label="Number of runs that are through against time",
    )


def outcome_bar(counts: Mapping[str, int]) -> list[tuple[str, int, float, str]]:
    """Name, number, share [%] and colour of each outcome that there is."""
    total = sum(counts.values()) or 1
    return [
        (n, counts[n], 100.0 * counts[n] / total, OUTCOME_COLOURS[n])
        for n in OUTCOMES
        if counts.get(n)
    ]


def coverage_strip(bands: Sequence[TemperatureBand]) -> Markup | None:
    """A unit's temperatures as a small strip: the darker, the longer it was there."""
    if not bands:
        return None
    low, high = STRIP_DEGC
    most = max(b.seconds for b in bands) or 1.0
    cells = [
        f'<rect x="{b.low_degC - low:g}" width="5" height="10" fill="{GREEN}" '
        f'fill-opacity="{0.25 + 0.75 * b.seconds / most:.2f}"/>'
        for b in bands
        if low <= b.low_degC < high
    ]
    words = f"{bands[0].low_degC:.0f} to {bands[-1].high_degC:.0f} degC"
    return Markup(
        f'<svg class="strip" viewBox="0 0 {high - low:g} 10" preserveAspectRatio="none" role="img"'
        f' aria-label="{words}"><rect width="{high - low:g}" height="10"'
        f' fill="var(--shade)"/>{"".join(cells)}</svg>'
    )


SHOWN_UNITS = 25  # rows of the ranking before the rest is folded
VERDICTS = {  # verdict: word, look, symbol, what it means
    FleetVerdict.COMMITTED: ("Committed", "good", "✔", "Tables in the store were updated."),
    FleetVerdict.PROPOSED: (
        "Proposed",
        "fair",
        "◆",
        "The tables in the store are as they were; proposals wait for a decision.",
    ),
    FleetVerdict.UP_TO_DATE: (
        "Up to date",
        "good",
        "✔",
        "Every run was in its unit's table before.",
    ),
    FleetVerdict.INCONSISTENT: (
        "Inconsistent",
        "bad",
        "✖",
        "Nothing was merged: data contradict the model or the stored tables.",
    ),
    FleetVerdict.REFUSED: (
        "Refused",
        "none",
        "■",
        "Nothing was merged: no run could be used for the table of its unit.",
    ),
    FleetVerdict.BAD_INPUT: ("Bad input", "none", "■", "Nothing was merged: no run could be read."),
    FleetVerdict.FAILED: (
        "Failed",
        "bad",
        "✖",
        "Nothing was merged: the program, its workers or the store broke down.",
    ),
}
LOOKS = {
    FleetOutcome.COMMITTED: "good",
    FleetOutcome.PROPOSED: "fair",
    FleetOutcome.ALREADY: "good",
    FleetOutcome.INCONSISTENT: "bad",
    FleetOutcome.REFUSED: "none",
    FleetOutcome.BAD_INPUT: "none",
    FleetOutcome.TAKEN_OUT: "none",
    FleetOutcome.CRASHED: "bad",
}


@dataclass(frozen=True)
class UnitView:
    """A unit's row with its name for people and the strip of its temperatures."""

    row: UnitRow
    name: str
    strip: Markup | None


def fleet_html(document: FleetReport) -> str:
    """The page of a document made by `fleet_document`."""
    units = [UnitView(u, _name(u), coverage_strip(u.coverage)) for u in document.units]
    ranked = [view for view in units if view.row.drift]
    drifts = [u.drift for u in document.units if u.drift]
    most = document.criteria.surprise_sigmas
    counts = [coverage_panel(document), tables_panel(document), progress_panel(document.timing)]
    return render_page(
        "fleet.html.j2",
        "recal.fleet",
        d=document,
        verdict=VERDICTS[document.verdict],
        looks=LOOKS,
        meanings=OUTCOMES,
        bar=outcome_bar(document.counts),
        total=sum(document.counts.values()),
        first=ranked[:SHOWN_UNITS],
        rest=ranked[SHOWN_UNITS:],
        unranked=[view for view in units if not view.row.drift],
        surprising=[drift for drift in drifts if drift.surprise_sigmas > most],
        stepped=[view for view in units if view.row.step_words],
        decimals=decimals_for([drift.sigma_after_deg_h for drift in drifts]),
        ranking=ranking_panel(document),
        counts=[panel for panel in counts if panel],
        trend=trend_panels(document.forecast) if document.forecast else [],
        trends=trend_strips(document.forecast) if document.forecast else [],
        date_words=date_words,
        name=_name,
    )


def _name(unit: UnitRow | StaleRow) -> str:
    """A unit for people: the technology and the mode only where there is more to say than the
    serial.
    """
    return " ".join(filter(None, (unit.imu_serial, unit.gyro_mode)))
