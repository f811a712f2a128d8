"""forecast.html, and the same list for the fleet's page and `recal serve`. Computes nothing."""

from collections.abc import Sequence
from datetime import date

from markupsafe import Markup

from infield.reports.figures import BLUE, GREY, PALE, axis_text, in_style, new_figure, svg_text
from infield.reports.page import render_page
from recal.service.priors.forecast_records import ForecastDocument, UnitForecast

UNITS_DRAWN = 6  # units with their trend in the drawing
ROWS_SHOWN = 100  # rows of the list


def forecast_html(document: ForecastDocument) -> str:
    """The page of a document."""
    return render_page(
        "forecast.html.j2", d=document, drawing=trend_drawing(document), shown=ROWS_SHOWN
    )


def trend_drawing(document: ForecastDocument) -> Markup | None:
    """The drift of the most urgent units and the limit; None without a unit."""
    return _drawing(document.units[:UNITS_DRAWN], document.limit_nm_h) if document.units else None


@in_style
def _drawing(units: Sequence[UnitForecast], limit_nm_h: float) -> Markup:
    columns = min(len(units), 3)
    rows = -(-len(units) // columns)
    figure, grid = new_figure(rows, columns, height=1.0 + 1.9 * rows, sharey=True)
    for ax in grid.ravel()[len(units) :]:
        ax.set_visible(False)
    for unit, ax in zip(units, grid.ravel(), strict=False):
        years = [_year(day) for day in unit.trend.date_utc]
        ax.fill_between(years, unit.trend.median_nm_h, unit.trend.high_nm_h, color=PALE)
        ax.plot(years, unit.trend.median_nm_h, color=BLUE)
        ax.axhline(limit_nm_h, color=GREY, linestyle="--", linewidth=1.0)
        ax.set_xlim(years[0], years[0] + 5.0)
        ax.set_ylim(0.0, 2.0 * limit_nm_h)
        axis_text(ax, title=unit.imu_serial, x="year", y="NM/h" if ax in grid[:, 0] else "")
        ax.xaxis.set_major_formatter("{x:.0f}")
    return svg_text(figure, "Predicted drift of the most urgent units against the limit")


def _year(day: str) -> float:
    found = date.fromisoformat(day)
    return found.year + (found.timetuple().tm_yday - 1) / 365.25
