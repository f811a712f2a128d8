"""The figures and the page environment that reports, fleet and web share."""

from infield.reports.documents.update import NM_H_PER_DEG_H as NM_H_PER_DEG_H
from infield.reports.documents.update import level_change as level_change
from infield.reports.documents.update_records import MethodDocument as MethodDocument
from infield.reports.documents.update_records import UpdateDocument as UpdateDocument
from infield.reports.documents.update_records import update_of as update_of
from infield.reports.drawing import BLUE as BLUE
from infield.reports.drawing import DASHED as DASHED
from infield.reports.drawing import DOTTED as DOTTED
from infield.reports.drawing import GREEN as GREEN
from infield.reports.drawing import GREY as GREY
from infield.reports.drawing import NEW as NEW
from infield.reports.drawing import OLD as OLD
from infield.reports.drawing import ORANGE as ORANGE
from infield.reports.drawing import PALE as PALE
from infield.reports.drawing import VERMILLION as VERMILLION
from infield.reports.drawing import Boxes as Boxes
from infield.reports.drawing import Item as Item
from infield.reports.drawing import Line as Line
from infield.reports.drawing import Marks as Marks
from infield.reports.drawing import Panel as Panel
from infield.reports.drawing import Uprights as Uprights
from infield.reports.drawing import drawn_temperatures as drawn_temperatures
from infield.reports.drawing import panels as panels
from infield.reports.drawing import robust_limits as robust_limits
from infield.reports.drawing import script_texts as script_texts
from infield.reports.drawing import thinned as thinned
from infield.reports.page import decimals_for as decimals_for
from infield.reports.page import page_environment as page_environment
from infield.reports.page import render_page as render_page
from infield.reports.update_page import estimated_of as estimated_of
from infield.reports.update_page import update_html as update_html
from infield.session.disagreement import BiasStep as BiasStep
from ins.documents import from_json
from ins.json_file import JsonObject as JsonObject
from ins.verdicts import sentence as sentence
from simreal.report.diagnosis_document import GapReport, summary


def stored_update_html(document: JsonObject) -> str:
    """The page of a stored update.json."""
    return update_html(update_of(document))


def diagnosis_lines(document: JsonObject) -> list[str]:
    """A stored diagnosis.json in a few lines for people."""
    return summary(from_json(GapReport, document, name="diagnosis.json"))
