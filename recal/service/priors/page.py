"""priors.html: the priors document as one page that fetches nothing. Computes nothing."""

from typing import TYPE_CHECKING

from markupsafe import Markup

from infield.learning.parameters import PriorName
from infield.reports.figures import BLUE, GREY, axis_text, in_style, new_figure, svg_text
from infield.reports.page import render_page, significant
from recal.service.priors.document import PriorsDocument, TechnologyPriors

if TYPE_CHECKING:
    from matplotlib.axes import Axes

PRIORS_VERDICTS = {"proposed": ("Learnt", "fair", "◆"), "refused": ("Refused", "none", "■")}
PARAMETER_WORDS = {
    PriorName.TURN_ON: "turn-on, from one power-on to the next",
    PriorName.FLICKER: "flicker (bias instability)",
    PriorName.RANDOM_WALK: "rate random walk",
    PriorName.AGEING_COMMON: "ageing, common to all temperatures",
    PriorName.AGEING_SHAPE: "ageing of the shape over temperature",
    PriorName.LENGTH: "correlation of the shape over temperature",
    PriorName.YAW_CREEP: "yaw creep of the parked airframe",
    PriorName.OUTLIER_SHARE: "share of outlier sessions",
    PriorName.CRAB: "crab, from one taxi to the next",
}
SHORT_WORDS = {
    PriorName.TURN_ON: "turn-on",
    PriorName.FLICKER: "flicker",
    PriorName.RANDOM_WALK: "random walk",
    PriorName.AGEING_COMMON: "common ageing",
    PriorName.AGEING_SHAPE: "shape ageing",
    PriorName.LENGTH: "length",
    PriorName.YAW_CREEP: "yaw creep",
    PriorName.OUTLIER_SHARE: "outlier share",
    PriorName.CRAB: "crab",
}
MOST_UNITS = 60  # rows of a table of units


def priors_html(document: PriorsDocument) -> str:
    """The page of a document."""
    return render_page(
        "priors.html.j2",
        d=document,
        verdict=PRIORS_VERDICTS[str(document.verdict)],
        words=PARAMETER_WORDS,
        drawings={t.gyro_technology: _drawing(t) for t in document.technologies},
        significant=significant,
        most=MOST_UNITS,
    )


@in_style
def _drawing(priors: TechnologyPriors) -> Markup:
    """Each parameter over its default: the technology as a bar, units as ticks."""
    figure, grid = new_figure(height=3.6)
    axes = grid[0, 0]
    names = list(priors.technology.parameters)
    for row, name in enumerate(reversed(names)):
        _row(axes, priors, name, row)
    axes.axvline(1.0, color=GREY, linewidth=1.0)
    axes.set_xscale("log")
    words = [SHORT_WORDS[PriorName(name)] for name in reversed(names)]
    axes.set_yticks(range(len(names)), words)
    axis_text(axes, x="times the default of the technology", y="")
    return svg_text(figure, "Learnt parameters over their defaults")


def _row(axes: "Axes", priors: TechnologyPriors, name: str, row: int) -> None:
    value = priors.technology.parameters[name]
    low, high = (end / value.default for end in value.interval_95)
    axes.plot([low, high], [row, row], color=BLUE, linewidth=3.0, solid_capstyle="butt")
    axes.plot([value.value / value.default], [row], "o", color=BLUE)
    units = [u.parameters[name].value / value.default for u in priors.units if name in u.parameters]
    axes.plot(units, [row - 0.25] * len(units), "|", color=GREY, markersize=5.0)
