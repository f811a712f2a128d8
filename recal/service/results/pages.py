"""The drawing tools and the page environment that reports, fleet and web share."""

from infield.reports.documents.update import NM_H_PER_DEG_H, level_change
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
    axis_text,
    in_style,
    new_figure,
    robust_limits,
    svg_text,
    thinned,
)
from infield.reports.page import _environment as page_environment
from infield.reports.page import decimals_for
from infield.reports.update_page import update_html
from infield.reports.words.sentences import sentence
from infield.session.reasons import SessionReason
from ins.verdicts import because, record_of
from recal.service.results.text import Document
from simreal.report.diagnosis_document import summary
from simreal.report.diagnosis_records import DiagnosisRecord

__all__ = [
    "BLUE",
    "GREEN",
    "GREY",
    "NEW",
    "NM_H_PER_DEG_H",
    "OLD",
    "ORANGE",
    "PALE",
    "PANEL_WIDTH",
    "VERMILLION",
    "axis_text",
    "decimals_for",
    "diagnosis_lines",
    "in_style",
    "level_change",
    "new_figure",
    "page_environment",
    "robust_limits",
    "step_words",
    "svg_text",
    "thinned",
    "update_html",
]


def step_words(step: Document) -> str:
    """The sentence of a step of update.json that the table does not follow."""
    return sentence(because(SessionReason.TABLE_DISAGREES, **step))


def diagnosis_lines(document: Document) -> list[str]:
    """A stored diagnosis.json in a few lines for people."""
    return summary(record_of(DiagnosisRecord, document))
