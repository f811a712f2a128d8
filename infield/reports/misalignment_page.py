"""misalignment.html: the document as one page that fetches nothing. Computes nothing but what a
curve needs.
"""

import numpy as np

from infield.misalignment.couplings import CouplingEstimate
from infield.misalignment.reasons import MisalignmentVerdict
from infield.reports.documents.misalignment import MisalignmentDocument
from infield.reports.drawing import (
    BLACK,
    BLUE,
    DOTTED,
    GREY,
    VERMILLION,
    Boxes,
    Item,
    Line,
    Marks,
    Panel,
    rows_height,
)
from infield.reports.page import number, render_page
from ins.documents import plain
from ins.records import AXES
from ins.units import ARCSEC, DEG
from ins.verdicts import Observability, measured_words

BANNERS = {
    MisalignmentVerdict.MEASURED: "good",
    MisalignmentVerdict.REFUSED: "none",
    MisalignmentVerdict.INCONSISTENT: "bad",
}
BADGES = {
    Observability.OBSERVED.value: "good",
    Observability.WEAK.value: "fair",
    Observability.NOT_OBSERVABLE.value: "none",
}


def render(document: MisalignmentDocument) -> str:
    """The page of misalignment.json."""
    return render_page(
        "misalignment.html.j2",
        d=plain(document),
        banner=BANNERS[document.verdict],
        badges=BADGES,
        words=_coupling_words,
        headline=headline(document),
        names=dict(zip(AXES, AXES)),
        harmonics=_harmonics(document) if document.gyros else [],
        couplings=_couplings(document),
    )


def _coupling_words(verdict: str, value: float | None, sigma: float | None) -> str:
    """What the page says of a coupling."""
    if value is None or sigma is None:
        return verdict.replace("_", " ")
    return measured_words(verdict, value, sigma)


def headline(document: MisalignmentDocument) -> str:
    """The result in one sentence."""
    if document.verdict is not MisalignmentVerdict.MEASURED:
        return "; ".join(document.reasons)
    told = ", ".join(
        f"{c.entry} {number(c.value_arcsec, 1, sign=True)} ± {number(c.sigma_arcsec, 1)}"
        for c in _seen(document)
    )
    return f"{told} arcsec"


def _seen(document: MisalignmentDocument) -> list[CouplingEstimate]:
    return [c for c in document.couplings if c.verdict is not Observability.NOT_OBSERVABLE]


def _harmonics(document: MisalignmentDocument) -> list[Panel]:
    """Bias against heading, gyro by gyro: as measured, the fitted curve, and after compensation."""
    H = np.linspace(0.0, 360.0, 181)
    rate = document.level_earth_rate_deg_h
    heading = np.array([s.heading_deg for s in document.stops])
    panels = []
    for k, axis in enumerate(AXES):
        gyro = document.gyros[axis]
        a, b = gyro.cos_arcsec * ARCSEC, gyro.sin_arcsec * ARCSEC
        curve = gyro.bias_deg_h + rate * (a * np.cos(H * DEG) + b * np.sin(H * DEG))
        items: list[Item] = [
            Line(H[[0, -1]], np.full(2, gyro.bias_deg_h), GREY, width=0.8, dash=DOTTED),
            Line(H, curve, BLACK, "fit"),
        ]
        sigma = np.array([s.sigma_apart_deg_h[k] for s in document.stops])
        for name, mark, colour, values in (
            ("as measured", "o", VERMILLION, [s.bias_deg_h[k] for s in document.stops]),
            ("compensated", "s", BLUE, [s.compensated_deg_h[k] for s in document.stops]),
        ):
            y = np.array(values)
            items.append(Marks(heading, y, mark, colour, name, low=y - sigma, high=y + sigma))
        panels.append(
            Panel(
                items=items,
                title=f"gyro {axis}",
                x_label="heading [deg]",
                y_label="bias [deg/h]",
                x_ticks=[(float(at), str(at)) for at in range(0, 361, 90)],
                label=f"gyro {axis}: bias against heading, before and after compensation",
            )
        )
    return panels


def _couplings(document: MisalignmentDocument) -> Panel | None:
    """Each observed coupling with one and two sigma; None without one."""
    seen = _seen(document)[::-1]
    if not seen:
        return None
    rows = np.arange(len(seen), dtype=float)
    value = np.array([c.value_arcsec for c in seen])
    sigma = np.array([c.sigma_arcsec for c in seen])

    def bars(times: float, half: float) -> list[tuple[float, float, float, float]]:
        ends = zip((value - times * sigma).tolist(), (value + times * sigma).tolist(), rows)
        return [(low, high, row - half, row + half) for low, high, row in ends]

    ends = -0.6, len(seen) - 0.4
    return Panel(
        items=[
            Line(np.zeros(2), np.array(ends), GREY, width=0.8),
            Boxes(bars(2.0, 0.03), BLUE),
            Boxes(bars(1.0, 0.1), BLUE, 0.5),
            Marks(value, rows, "o", BLUE, size=5.0),
        ],
        x_label="arcsec (thick: 1 sigma, thin: 2 sigma)",
        y_limits=ends,
        y_ticks=[(float(row), c.entry) for row, c in zip(rows, seen)],
        label="Couplings with their sigma",
        height=rows_height(len(seen)),
    )
