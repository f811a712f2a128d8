"""The figures and the page environment that reports, fleet and web share."""

from infield.reports.documents.update import NM_H_PER_DEG_H, level_change
from infield.reports.documents.update_records import MethodDocument, UpdateDocument, update_of
from infield.reports.drawing import (
    BLUE,
    DASHED,
    DOTTED,
    GREEN,
    GREY,
    NEW,
    OLD,
    ORANGE,
    PALE,
    VERMILLION,
    Boxes,
    Item,
    Line,
    Marks,
    Panel,
    Uprights,
    drawn_temperatures,
    panels,
    robust_limits,
    script_texts,
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
    "NEW",
    "NM_H_PER_DEG_H",
    "OLD",
    "ORANGE",
    "PALE",
    "VERMILLION",
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
    "decimals_for",
    "diagnosis_lines",
    "drawn_temperatures",
    "estimated_of",
    "level_change",
    "page_environment",
    "panels",
    "robust_limits",
    "script_texts",
    "sentence",
    "stored_update_html",
    "thinned",
    "update_html",
    "update_of",
]


def stored_update_html(document: JsonObject) -> str:
    """The page of a stored update.json."""
    return update_html(update_of(document))


def diagnosis_lines(document: JsonObject) -> list[str]:
    """A stored diagnosis.json in a few lines for people."""
    return summary(from_json(GapReport, document, name="diagnosis.json"))
