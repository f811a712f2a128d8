"""look.html: what `look` found as one page that fetches nothing. Computes nothing."""

from dataclasses import replace

from infield.reports.drawing import Panel, ShadedSpan
from recal.service.look.records import Fit, LookReport, LookVerdict, Use
from recal.service.results.pages import page_environment
from simreal.report.twin_document import PARAMETER_NAMES, size_words
from simreal.report.twin_page import allan_panels

LOOK_VERDICTS = {  # word, look, symbol
    LookVerdict.USABLE: ("Usable", "good", "✔"),
    LookVerdict.REFUSED: ("Fit for nothing here", "none", "■"),
    LookVerdict.BAD_INPUT: ("Something is wrong with this log", "bad", "✖"),
}
FIT_BADGES = {Fit.YES: ("yes", "good"), Fit.PARTLY: ("partly", "fair"), Fit.NO: ("no", "none")}
USES = {
    Use.ALIGNMENT: "Alignment: attitude and heading",
    Use.NOISE: "Noise model of the unit",
    Use.TABLE: "Thermal table: recalibration",
    Use.REPLAY: "Replay: navigation",
    Use.DIAGNOSIS: "Diagnosis: simulator against log",
}
MEANS = (
    "A line joins means of many rows. The shading in its colour reaches from the least to the"
    " greatest of these rows."
)
CAPTIONS = {
    "temperature": "All thermometers that the log holds values of.",
    "rate": MEANS,
    "force": MEANS,
    "velocity": "North, east and down, as the receiver gives them.",
    "height": "Height above the ellipsoid. A log that gives heights above mean sea level is drawn"
    " with those: no geoid model is used.",
    "odometer": "Speed along the vehicle.",
}


def look_html(document: LookReport) -> str:
    """The page of a look."""
    fitted = document.fitted
    told = [] if fitted is None or fitted.found is None else fitted.found.parameters
    return (
        page_environment("recal.service.look")
        .get_template("look.html.j2")
        .render(
            d=document,
            verdict=LOOK_VERDICTS[document.verdict],
            fits=FIT_BADGES,
            uses=USES,
            series=[
                (panel.label, _shaded(panel, document), CAPTIONS[name])
                for name, panel in document.series.items()
            ],
            allan=None if fitted is None else allan_panels(fitted),
            noise=[(PARAMETER_NAMES[p.name][0], size_words(p)) for p in told if p.identified],
        )
    )


def _shaded(panel: Panel, document: LookReport) -> Panel:
    """With every second phase shaded."""
    spans = [ShadedSpan(phase.start_s, phase.end_s) for phase in document.phases[1::2]]
    return replace(panel, spans=spans)
