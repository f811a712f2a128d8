"""misalignment.html: the document as one page that fetches nothing. Computes nothing but what a
curve needs.
"""

from typing import TYPE_CHECKING

import numpy as np
from markupsafe import Markup

from infield.misalignment.reasons import MisalignmentVerdict
from infield.reports.documents.misalignment import CouplingDocument, MisalignmentDocument
from infield.reports.figures import (
    AXIS_COLOURS,
    BLUE,
    GREY,
    VERMILLION,
    LineStyle,
    axis_text,
    in_style,
    new_figure,
    svg_text,
)
from infield.reports.page import number, render_page
from infield.reports.words.significance import measured_words
from ins.records import AXES
from ins.units import ARCSEC, DEG
from ins.verdicts import Observability, plain

if TYPE_CHECKING:
    from matplotlib.axes import Axes

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
        harmonics=_harmonics(document) if document.gyros else None,
        couplings=_couplings(document) if document.couplings else None,
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


def _seen(document: MisalignmentDocument) -> list[CouplingDocument]:
    return [c for c in document.couplings if c.verdict is not Observability.NOT_OBSERVABLE]


@in_style
def _harmonics(document: MisalignmentDocument) -> Markup:
    """Bias against heading, gyro by gyro: as measured, the fitted curve, and after compensation."""
    figure, axes = new_figure(1, 3, height=3.0, sharex=True)
    H = np.linspace(0.0, 360.0, 181)
    rate = document.level_earth_rate_deg_h
    for k, axis in enumerate(AXES):
        ax, gyro = axes[0, k], document.gyros[axis]
        a, b = gyro.cos_arcsec * ARCSEC, gyro.sin_arcsec * ARCSEC
        curve = gyro.bias_deg_h + rate * (a * np.cos(H * DEG) + b * np.sin(H * DEG))
        ax.plot(H, curve, color=AXIS_COLOURS[axis], label="fit")
        measured = [s.bias_deg_h[k] for s in document.stops]
        compensated = [s.compensated_deg_h[k] for s in document.stops]
        _points(
            ax, document, k, measured, {"fmt": "o", "color": VERMILLION, "label": "as measured"}
        )
        _points(ax, document, k, compensated, {"fmt": "s", "color": BLUE, "label": "compensated"})
        ax.axhline(gyro.bias_deg_h, color=GREY, linewidth=0.8, linestyle=":")
        axis_text(ax, title=f"gyro {axis}", x="heading, deg", y="bias, deg/h" if k == 0 else "")
        ax.set_xticks([0, 90, 180, 270, 360])
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=3)
    return svg_text(figure, "Bias of each gyro against heading, before and after compensation")


def _points(
    ax: "Axes", document: MisalignmentDocument, k: int, value_deg_h: list[float], style: LineStyle
) -> None:
    """Values of gyro k over the headings of the stops, with their sigmas."""
    heading = [s.heading_deg for s in document.stops]
    sigma = [s.sigma_apart_deg_h[k] for s in document.stops]
    ax.errorbar(heading, value_deg_h, yerr=sigma, markersize=4, linewidth=0.9, capsize=2, **style)


@in_style
def _couplings(document: MisalignmentDocument) -> Markup | str:
    """Each observed coupling with one and two sigma."""
    seen = _seen(document)
    if not seen:
        return ""
    figure, axes = new_figure(1, 1, height=0.8 + 0.35 * len(seen), width=7.0)
    ax = axes[0, 0]
    for row, c in enumerate(reversed(seen)):
        value, sigma = c.value_arcsec, c.sigma_arcsec
        ax.plot([value - 2 * sigma, value + 2 * sigma], [row, row], color=BLUE, linewidth=1.2)
        ax.plot([value - sigma, value + sigma], [row, row], color=BLUE, linewidth=4.0, alpha=0.5)
        ax.plot([value], [row], "o", color=BLUE, markersize=5)
    ax.axvline(0.0, color=GREY, linewidth=0.8)
    ax.set_yticks(range(len(seen)), [c.entry for c in reversed(seen)])
    ax.set_ylim(-0.6, len(seen) - 0.4)
    axis_text(ax, x="arcsec (thick: 1 sigma, thin: 2 sigma)")
    return svg_text(figure, "Couplings with their sigma")
