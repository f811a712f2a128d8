"""The drawing tools and the page environment that reports, fleet and web share."""

from infield.reports.charts import (
    DASHED,
    DOTTED,
    MOST_ALONG_AXIS,
    Band,
    Boxes,
    Item,
    Line,
    Marks,
    Panel,
    Uprights,
    chart,
    whole_step,
)
from infield.reports.documents.update import NM_H_PER_DEG_H, level_change
from infield.reports.documents.update_records import MethodDocument, UpdateDocument, update_of
from infield.reports.figures import (
    BLUE,
    GREEN,
    GREY,
    NEW,
    OLD,
    ORANGE,
    PALE,
    PANEL_WIDTH,
    VERMILLION,
    drawn_temperatures,
    robust_limits,
    thinned,
)
from infield.reports.page import decimals_for, page_environment
from infield.reports.update_page import estimated_of, update_html
from infield.session.disagreement import BiasStep
from ins.documents import from_json
from ins.json_file import JsonObject
from ins.verdicts import sentence
from simreal.report.diagnosis_document import GapReport, summary

__all__ = [
    "BLUE",
    "DASHED",
    "DOTTED",
    "GREEN",
    "GREY",
    "MOST_ALONG_AXIS",
    "NEW",
    "NM_H_PER_DEG_H",
    "OLD",
    "ORANGE",
    "PALE",
    "PANEL_WIDTH",
    "VERMILLION",
    "Band",
    "BiasStep",
    "Boxes",
    "Item",
    "JsonObject",
    "Line",
    "Marks",
    "MethodDocument",
    "Panel",
    "UpdateDocument",
    "Uprights",
    "chart",
    "decimals_for",
    "diagnosis_lines",
    "drawn_temperatures",
    "estimated_of",
    "level_change",
    "page_environment",
    "robust_limits",
    "sentence",
    "stored_update_html",
    "thinned",
    "update_html",
    "update_of",
    "whole_step",
]


def stored_update_html(document: JsonObject) -> str:
    """The page of a stored update.json."""
    return update_html(update_of(document))


def diagnosis_lines(document: JsonObject) -> list[str]:
    """A stored diagnosis.json in a few lines for people."""
    return summary(from_json(GapReport, document, name="diagnosis.json"))
