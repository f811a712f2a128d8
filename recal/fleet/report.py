"""fleet.html: the fleet document as one page that fetches nothing. Computes nothing."""

from dataclasses import dataclass

from markupsafe import Markup

from recal.fleet import figures
from recal.fleet.document_records import FleetReport, StaleRow, UnitRow
from recal.fleet.records import OUTCOMES, FleetOutcome, FleetVerdict
from recal.service.priors.forecast_page import date_words, trend_panels, trend_strips
from recal.service.results.pages import decimals_for, page_environment

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
    units = [UnitView(u, _name(u), figures.coverage_strip(u.coverage)) for u in document.units]
    ranked = [view for view in units if view.row.drift]
    drifts = [u.drift for u in document.units if u.drift]
    most = document.criteria.surprise_sigmas
    counts = [
        figures.coverage_panel(document),
        figures.tables_panel(document),
        figures.progress_panel(document.timing),
    ]
    return (
        page_environment("recal.fleet")
        .get_template("fleet.html.j2")
        .render(
            d=document,
            verdict=VERDICTS[document.verdict],
            looks=LOOKS,
            meanings=OUTCOMES,
            bar=figures.outcome_bar(document.counts),
            total=sum(document.counts.values()),
            first=ranked[:SHOWN_UNITS],
            rest=ranked[SHOWN_UNITS:],
            unranked=[view for view in units if not view.row.drift],
            surprising=[drift for drift in drifts if drift.surprise_sigmas > most],
            stepped=[view for view in units if view.row.step_words],
            decimals=decimals_for([drift.sigma_after_deg_h for drift in drifts]),
            ranking=figures.ranking_panel(document),
            counts=[panel for panel in counts if panel],
            trend=trend_panels(document.forecast) if document.forecast else [],
            trends=trend_strips(document.forecast) if document.forecast else [],
            date_words=date_words,
            name=_name,
        )
    )


def _name(unit: UnitRow | StaleRow) -> str:
    """A unit for people: the technology and the mode only where there is more to say than the
    serial.
    """
    return " ".join(filter(None, (unit.imu_serial, unit.gyro_mode)))
