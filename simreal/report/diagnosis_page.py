"""diagnosis.html: the diagnosis document and its overlays as one page that fetches nothing.
Computes nothing.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from markupsafe import Markup

from infield.reports.page import decimals_for, number
from simreal.effects.catalogue import effects_named
from simreal.report.diagnosis_curves import Overlay
from simreal.report.diagnosis_document import REFUSED, p_text
from simreal.report.diagnosis_figures import band_drawing, gap_map, overlay_drawing, posterior_bars
from simreal.report.page import render_page

BANNERS = {
    "no_gap": "good",
    "explained": "fair",
    "partly_explained": "none",
    "unexplained": "bad",
    REFUSED: "none",
}
WORDS = {
    "no_gap": "No gap",
    "explained": "Explained",
    "partly_explained": "Partly explained",
    "unexplained": "Unexplained",
    REFUSED: "Not looked at",
}


LOOKS = {
    "cells": "the mean square of a channel's band",
    "temperature bands": "means over bands of temperature",
    "time windows": "means over ten-minute windows",
    "burst": "single large residuals",
    "kurtosis": "tails that are not normal",
}


def diagnosis_html(document: dict[str, Any], overlays: Sequence[Overlay | None] = ()) -> str:
    """The page of a document made by `diagnosis_document`; overlays: one for each cause."""
    causes = [
        _cause(document, cause, overlay)
        for cause, overlay in zip(document["causes"], overlays, strict=True)
    ]
    return render_page(
        "diagnosis.html.j2",
        d=document,
        word=WORDS[document["verdict"]],
        banner=BANNERS[document["verdict"]],
        causes=causes,
        map=gap_map(document["cells"]) if document["cells"] else None,
        value=value_text,
        p_text=p_text,
        title=_title(document),
        percent=percent,
        looks=LOOKS,
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


def _title(document: dict[str, Any]) -> str:
    unit = document["imu_serial"] or f"a {document['gyro_technology']} unit"
    return f"Simulator against logs of {unit}"


def _cause(
    document: dict[str, Any], cause: dict[str, Any], overlay: Overlay | None
) -> dict[str, Any]:
    """A cause with its drawings."""
    drawing: Markup | None = None
    if overlay is not None:
        drawing = overlay_drawing(overlay)
    else:
        drawing = band_drawing(document["cells"], _channels_of(document, cause))
    return {
        **cause,
        "bars": posterior_bars(cause),
        "drawing": drawing,
        "overlay": overlay,
        "shown": [] if overlay is None else overlay.curves,
        "usual_rivals": _usual_rivals(cause),
    }


def _channels_of(document: dict[str, Any], cause: dict[str, Any]) -> list[str]:
    """The target where it is a channel; else (vehicle) the channels that shrink most in nats."""
    gone: dict[str, float] = {}
    for cell in document["cells"]:
        gone[cell["channel"]] = gone.get(cell["channel"], 0.0) + cell["nats"] - cell["nats_after"]
    if cause["target"] in gone and cause["target"] != "vehicle":
        return [cause["target"]]
    return sorted(gone, key=lambda channel: -gone[channel])


def _usual_rivals(cause: dict[str, Any]) -> list[str]:
    """What the catalogue says it is often confused with, beyond the set found here."""
    names = [r for e in effects_named(cause["effect"]) for r in e.rivals]
    return sorted(set(names) - set(cause["confounded_with"]) - {cause["effect"]})
