"""The drawings of the fleet report, each from the document's own numbers; no curve has more than
MAX_POINTS points.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from markupsafe import Markup

from recal.fleet.document_records import Band, FleetDocument, TimingDocument
from recal.fleet.records import OUTCOMES, FleetOutcome
from recal.service.results.pages import (
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    PALE,
    PANEL_WIDTH,
    VERMILLION,
    axis_text,
    in_style,
    new_figure,
    svg_text,
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
HIGHEST = 2.2  # times the 90th percentile: above it the ranking's axis is cut
STRIP_DEGC = (-40.0, 80.0)  # of a unit's coverage strip


@in_style
def ranking_drawing(document: FleetDocument) -> Markup | None:
    """Predicted drift of every unit, the largest first, with what the new table leaves (1
    sigma).
    """
    from matplotlib.ticker import MaxNLocator

    drifts = [
        (u.rank, u.drift.nm_h, u.drift.sigma_nm_h, u.drift.surprise_sigmas)
        for u in document.units
        if u.drift
    ]
    if not drifts:
        return None
    rank, nm_h, sigma, surprise = thinned(*zip(*drifts))
    figure, axes = new_figure(height=3.0)
    ax = axes[0, 0]
    top = max(HIGHEST * float(np.quantile(nm_h, 0.9)), 1.05 * float(np.median(nm_h + sigma)), 1e-6)
    far = surprise > document.criteria.surprise_sigmas
    for mask, colour, mark, name in (
        (~far, BLUE, "o", "within what its table said"),
        (far, VERMILLION, "D", "beyond it"),
    ):
        if mask.any():
            ax.errorbar(
                rank[mask],
                np.minimum(nm_h[mask], top),
                sigma[mask],
                fmt=mark,
                color=colour,
                ecolor=PALE,
                markersize=3.5,
                elinewidth=1.0,
                label=name,
            )
    steps = [(u.rank, u.step_drift.nm_h) for u in document.units if u.drift and u.step_drift]
    if steps:
        rank_of_step, size = thinned(*zip(*steps))
        ax.plot(
            rank_of_step,
            np.minimum(size, top),
            "s",
            color=ORANGE,
            markersize=4.5,
            label="a step against its table",
        )
    highest = max([float((nm_h + sigma).max()), *(size for _, size in steps)])
    ax.set_ylim(0.0, 1.06 * min(top, highest))
    ax.set_xlim(0.0, float(rank.max()) + 1.0)
    ax.xaxis.set_major_locator(MaxNLocator(integer=True))
    ax.legend(loc="upper right")
    axis_text(ax, title="Predicted drift by the change of the table, all units", x="rank", y="NM/h")
    return svg_text(
        figure, f"Predicted drift of {len(drifts)} units in NM/h, largest first, with sigma"
    )


@in_style
def coverage_drawing(document: FleetDocument) -> Markup | None:
    """How many units were seen in each band of temperature."""
    bands = document.coverage
    if not bands:
        return None
    figure, axes = new_figure(width=PANEL_WIDTH, height=2.7)
    ax = axes[0, 0]
    ax.bar([b.low_degC + 2.5 for b in bands], [b.units for b in bands], width=4.6, color=GREEN)
    ax.yaxis.get_major_locator().set_params(integer=True)
    axis_text(ax, title="Units seen at a temperature", x="gyro temperature [°C]", y="units")
    return svg_text(
        figure, "Number of units with merged data in each 5 degC band of gyro temperature"
    )


@in_style
def tables_drawing(document: FleetDocument) -> Markup | None:
    """Age and sigma of the tables in the store."""
    tables = [u.table for u in document.units if u.table]
    if not tables:
        return None
    against = np.array([t.contradictions > 0 for t in tables])
    age = np.array([t.age_days for t in tables])
    sigma = np.array([t.sigma_deg_h for t in tables])
    figure, axes = new_figure(width=PANEL_WIDTH, height=2.7)
    ax = axes[0, 0]
    for mask, colour, mark, name in (
        (~against, BLUE, "o", "not contradicted"),
        (against, VERMILLION, "D", "contradicted"),
    ):
        if mask.any():
            ax.plot(
                age[mask], sigma[mask], mark, color=colour, markersize=4.0, alpha=0.8, label=name
            )
    ax.set_ylim(0.0, 1.3 * float(sigma.max()))  # room for the legend above the highest
    ax.legend(loc="best")
    axis_text(
        ax, title="Stored tables: age and sigma", x="days since its newest data", y="sigma [deg/h]"
    )
    return svg_text(figure, f"Age and sigma of {len(tables)} stored tables")


@in_style
def progress_drawing(timing: TimingDocument) -> Markup | None:
    """Runs through against time, of this call."""
    curve = timing.curve
    if len(curve) < 2:
        return None
    figure, axes = new_figure(width=PANEL_WIDTH, height=2.7)
    ax = axes[0, 0]
    seconds, runs = thinned(*zip(*curve))
    ax.plot(seconds / 60.0, runs, color=BLUE)
    ax.set_xlim(left=0.0)
    ax.set_ylim(bottom=0.0)
    ax.yaxis.get_major_locator().set_params(integer=True)
    axis_text(ax, title="Runs through in this call", x="minutes", y="runs")
    return svg_text(figure, "Number of runs that are through against time")


def outcome_bar(counts: Mapping[str, int]) -> list[tuple[str, int, float, str]]:
    """Name, number, share [%] and colour of each outcome that there is."""
    total = sum(counts.values()) or 1
    return [
        (n, counts[n], 100.0 * counts[n] / total, OUTCOME_COLOURS[n])
        for n in OUTCOMES
        if counts.get(n)
    ]


def coverage_strip(bands: Sequence[Band]) -> Markup | None:
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
        f' fill="#eef1f4"/>{"".join(cells)}</svg>'
    )
