"""forecast.html, and its drawings for the fleet's page and `recal serve`. Computes nothing."""

import math
from collections.abc import Sequence
from datetime import date

import numpy as np
from markupsafe import Markup, escape

from infield.reports.drawing import BLUE, DASHED, GREY, INKS, PALE, Band, Line, Panel
from infield.reports.page import render_page
from recal.service.priors.records import ForecastReport, UnitForecast

NOT_LEARNT = "no priors are approved: recal fleet learn"  # of what a forecast rests on
UNITS_DRAWN = 6  # units with their trend in the drawing
ABOVE_MEDIAN = 1.15  # of the greatest median of a drawing: a little room above the line
ROWS_SHOWN = 100  # rows of the list
STRIP_YEARS = 5.0  # of the 12 forecast: that a row's trend shows, as the drawing does


def date_words(day: str | None, issued_utc: str) -> str:
    """A date of a forecast for people: one that has come has passed already."""
    if day is None:
        return "beyond 12 years"
    return "passed already" if passed(day, issued_utc) else day


def passed(day: str | None, issued_utc: str) -> bool:
    """Whether a date of a forecast had come when the forecast was issued."""
    return day is not None and day <= issued_utc[: len(day)]


def outlook_words(unit: UnitForecast, document: ForecastReport) -> str:
    """What a unit's drift does about the limit, as the end of a sentence that begins with it."""
    if unit.drift_now_nm_h > document.limit_nm_h:
        return "above the limit already"
    issued = document.issued_utc
    if passed(unit.date_95_utc, issued):
        return "above the limit already with a chance of more than 5 %"
    until, half = (date_words(day, issued) for day in (unit.date_95_utc, unit.date_50_utc))
    return f"below the limit until {until} (95 %), {half} (50 %)"


def forecast_html(document: ForecastReport) -> str:
    """The page of a document."""
    return render_page(
        "forecast.html.j2",
        d=document,
        trend=trend_panels(document),
        trends=trend_strips(document),
        shown=ROWS_SHOWN,
        date_words=date_words,
        outlook_words=outlook_words,
        to_learn=any(NOT_LEARNT in unit.rests_on and unit.sessions for unit in document.units),
    )


def trend_panels(document: ForecastReport) -> list[Panel]:
    """The drift of the most urgent units and the limit, a panel each."""
    return [_panel(unit, document.limit_nm_h) for unit in document.units[:UNITS_DRAWN]]


def trend_strips(document: ForecastReport) -> list[Markup]:
    """Each unit's drift over the next STRIP_YEARS as a small strip with the limit."""
    return [_strip(unit, document.limit_nm_h) for unit in document.units[:ROWS_SHOWN]]


def _strip(unit: UnitForecast, limit_nm_h: float) -> Markup:
    """Line, median; area, to what 5 % exceed; dashes, the limit. Twice the limit is the top."""
    years = [_year(day) for day in unit.trend.date_utc]
    inside = [k for k, year in enumerate(years) if year - years[0] <= STRIP_YEARS]

    def line(values: Sequence[float]) -> list[str]:
        high = [min(values[k] / (2.0 * limit_nm_h), 1.0) for k in inside]
        along = [(years[k] - years[0]) / STRIP_YEARS for k in inside]
        return [f"{100.0 * x:.1f},{30.0 * (1.0 - y):.1f}" for x, y in zip(along, high)]

    median, high = line(unit.trend.median_nm_h), line(unit.trend.high_nm_h)
    words = f"drift of {unit.imu_serial} over {STRIP_YEARS:.0f} years against the limit"
    return Markup(
        '<svg class="trend" viewBox="0 0 100 30" width="112" height="34"'
        ' preserveAspectRatio="none" role="img"'
        f' aria-label="{escape(words)}"><rect width="100" height="30" fill="var(--back)"/>'
        f'<polygon points="{" ".join([*median, *reversed(high)])}" fill="{INKS[PALE]}"/>'
        f'<polyline points="{" ".join(median)}" fill="none" stroke="{INKS[BLUE]}"'
        ' stroke-width="1.5"/><line x1="0" x2="100" y1="15" y2="15"'
        f' stroke="{INKS[GREY]}" stroke-dasharray="4 3"/></svg>'
    )


def _panel(unit: UnitForecast, limit_nm_h: float) -> Panel:
    years = np.array([_year(day) for day in unit.trend.date_utc])
    medians = np.array(unit.trend.median_nm_h)
    ends = years[0] + np.array([0.0, STRIP_YEARS])
    # a unit far above the limit gets room for its median, so that it is no line along the edge
    top = max(2.0 * limit_nm_h, ABOVE_MEDIAN * float(medians[years <= ends[1]].max()))
    return Panel(
        items=[
            Band(years, medians, np.array(unit.trend.high_nm_h), PALE, 1.0, "to what 5 % exceed"),
            Line(years, medians, BLUE, "median"),
            Line(ends, np.full(2, limit_nm_h), GREY, "limit", width=1.0, dash=DASHED),
        ],
        title=unit.imu_serial,
        label=f"Predicted drift of {unit.imu_serial} against the limit",
        x_label="year",
        y_label="drift [NM/h]",
        x_limits=(float(ends[0]), float(ends[1])),
        y_limits=(0.0, top),
        x_ticks=[(float(year), str(year)) for year in range(math.ceil(ends[0]), int(ends[1]) + 1)],
    )


def _year(day: str) -> float:
    found = date.fromisoformat(day)
    return found.year + (found.timetuple().tm_yday - 1) / 365.25
