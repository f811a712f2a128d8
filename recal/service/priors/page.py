"""priors.html: the priors document as one page that fetches nothing. Computes nothing."""

import numpy as np

from infield.learning.parameters import PriorName
from infield.reports.drawing import BLUE, GREY, Boxes, Line, Marks, Panel, Uprights, rows_height
from infield.reports.page import render_page, significant
from recal.service.priors.document import PriorsReport, TechnologyPriors

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


def priors_html(document: PriorsReport) -> str:
    """The page of a document."""
    return render_page(
        "priors.html.j2",
        d=document,
        verdict=PRIORS_VERDICTS[str(document.verdict)],
        words=PARAMETER_WORDS,
        panels_of={t.gyro_technology: _panel(t) for t in document.technologies},
        significant=significant,
        most=MOST_UNITS,
    )


def _panel(priors: TechnologyPriors) -> Panel:
    """Each parameter over its default: the technology as a bar, units as ticks."""
    parameters = priors.technology.parameters
    rows = {name: float(row) for row, name in enumerate(reversed(list(parameters)))}
    bars, means, units = [], [], []
    for name, row in rows.items():
        value = parameters[name]
        low, high = (end / value.default for end in value.interval_95)
        bars.append((low, high, row - 0.07, row + 0.07))
        means.append((value.value / value.default, row))
        units += [
            (u.parameters[name].value / value.default, row - 0.25)
            for u in priors.units
            if name in u.parameters
        ]
    at, level = np.array(means).T
    seen, below = np.array(units).reshape(-1, 2).T
    return Panel(
        label="Learnt parameters over their defaults",
        items=[
            Line(np.ones(2), np.array([-0.6, len(rows) - 0.4]), GREY, width=1.0),
            Boxes(bars, BLUE, name="technology, 95 %"),
            Marks(at, level, "o", BLUE, size=6.0),
            Uprights(seen, below - 0.09, below + 0.09, GREY, width=1.0, name="units"),
        ],
        x_label="times the default of the technology",
        y_limits=(-0.6, len(rows) - 0.4),
        x_log=True,
        y_ticks=[(row, SHORT_WORDS[PriorName(name)]) for name, row in rows.items()],
        height=rows_height(len(rows)),
    )
