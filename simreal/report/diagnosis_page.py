"""diagnosis.html: the diagnosis document and its overlays as one page that fetches nothing.
Computes nothing.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from markupsafe import Markup

from infield.reports.page import decimals_for, number
from simreal.effects.base import SLOW_NAME
from simreal.effects.catalogue import effects_named
from simreal.inference.verdict import GapVerdict, Looks
from simreal.report.diagnosis_curves import Overlay
from simreal.report.diagnosis_document import p_text
from simreal.report.diagnosis_figures import band_drawing, gap_map, overlay_drawing, posterior_bars
from simreal.report.diagnosis_records import CauseRecord, DiagnosisRecord
from simreal.report.page import render_page

VEHICLE_NAME = "vehicle"  # as a target the vehicle itself, as a channel its side slip

BANNERS = {
    GapVerdict.NO_GAP: "good",
    GapVerdict.EXPLAINED: "fair",
    GapVerdict.PARTLY_EXPLAINED: "none",
    GapVerdict.UNEXPLAINED: "bad",
    GapVerdict.REFUSED: "none",
}
WORDS = {
    GapVerdict.NO_GAP: "No gap",
    GapVerdict.EXPLAINED: "Explained",
    GapVerdict.PARTLY_EXPLAINED: "Partly explained",
    GapVerdict.UNEXPLAINED: "Unexplained",
    GapVerdict.REFUSED: "Not looked at",
}
LOOK_WORDS = {
    Looks.CELLS: "the mean square of a channel's band",
    Looks.TEMPERATURE_BANDS: "means over bands of temperature",
    Looks.TIME_WINDOWS: "means over ten-minute windows",
    Looks.BURST: "single large residuals",
    Looks.KURTOSIS: "tails that are not normal",
    Looks.CROSS_CHANNEL: "cross-channel correlation",
}


@dataclass(frozen=True, kw_only=True)
class CauseShown:
    """A cause with its drawings. slow: tied to no logged quantity. usual_rivals: what the catalogue
    says it is often confused with, beyond the set found here.
    """

    cause: CauseRecord
    bars: Markup
    drawing: Markup | None
    overlay: Overlay | None
    usual_rivals: tuple[str, ...]

    @property
    def slow(self) -> bool:
        return self.cause.effect == SLOW_NAME


def diagnosis_html(document: DiagnosisRecord, overlays: Sequence[Overlay | None] = ()) -> str:
    """The page of a document made by `diagnosis_document`; overlays: one for each cause."""
    causes = [
        _shown(document, cause, overlay)
        for cause, overlay in zip(document.causes, overlays, strict=True)
    ]
    return render_page(
        "diagnosis.html.j2",
        d=document,
        refused=document.verdict is GapVerdict.REFUSED,
        word=WORDS[document.verdict],
        banner=BANNERS[document.verdict],
        causes=causes,
        map=gap_map(document.cells) if document.cells else None,
        value=value_text,
        p=p_text,
        title=_title(document),
        percent=percent,
        looks=LOOK_WORDS,
    )


def value_text(value: float | None, sigma: float | None = None) -> str:
    """A number with the digits that its sigma leaves, or three."""
    if value is None:
        return "n/a"
    if sigma is None or not sigma > 0:
        plain = 1e-4 <= abs(value) < 1e6 or value == 0
        text = (
            np.format_float_positional(float(f"{value:.3g}"), trim="-") if plain else f"{value:.3g}"
        )
        return text.replace("-", "−")
    return f"{number(value, decimals_for([sigma]))} ± {number(sigma, decimals_for([sigma]))}"


def percent(fraction: float) -> str:
    return f"{100 * fraction:.0f} %".replace("-", "−")


def _title(document: DiagnosisRecord) -> str:
    unit = document.imu_serial or f"a {document.gyro_technology} unit"
    return f"Simulator against logs of {unit}"


def _shown(document: DiagnosisRecord, cause: CauseRecord, overlay: Overlay | None) -> CauseShown:
    if overlay is not None:
        drawing = overlay_drawing(overlay)
    else:
        drawing = band_drawing(document.cells, _channels_of(document, cause))
    return CauseShown(
        cause=cause,
        bars=posterior_bars(cause),
        drawing=drawing,
        overlay=overlay,
        usual_rivals=_usual_rivals(cause),
    )


def _channels_of(document: DiagnosisRecord, cause: CauseRecord) -> list[str]:
    """The target where it is a channel; else (vehicle) the channels that shrink most in nats."""
    gone: dict[str, float] = {}
    for cell in document.cells:
        gone[cell.channel] = gone.get(cell.channel, 0.0) + cell.nats - cell.nats_after
    if cause.target in gone and cause.target != VEHICLE_NAME:
        return [cause.target]
    return sorted(gone, key=lambda channel: -gone[channel])


def _usual_rivals(cause: CauseRecord) -> tuple[str, ...]:
    names = {r for e in effects_named(cause.effect) for r in e.rivals}
    return tuple(sorted(names - set(cause.confounded_with) - {cause.effect}))
