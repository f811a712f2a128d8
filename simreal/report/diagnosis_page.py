"""diagnosis.html: the diagnosis document and its overlays as one page that fetches nothing.
Computes nothing.
"""

import shlex
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from infield.reports.drawing import Panel
from infield.reports.page import decimals_for, number, render_page
from ins.errors.base import Words
from ins.errors.catalogue import effects_named, rivals_of, words_of
from ins.errors.platform import ARCMIN
from ins.units import MILLIRADIAN
from simreal.inference.causes import Cause
from simreal.inference.verdict import GapVerdict, KeptOut
from simreal.inference.wrong_site import WRONG_LATITUDE
from simreal.predict.document import NIS, PredictedRun, interval_text, share_text
from simreal.report.diagnosis_curves import Overlay
from simreal.report.diagnosis_document import GapReport, p_text
from simreal.report.diagnosis_figures import (
    MOST_PANELS,
    band_panels,
    gap_maps,
    overlay_panels,
    posterior_bars,
    shade,
    shrink_bars,
)
from simreal.report.diagnosis_words import (
    LOOK_WORDS,
    Found,
    drift_words,
    expected,
    gathered,
    listed,
    percent,
    place_words,
    plain,
    rivals_words,
    shrink_words,
)

SHADES_SHOWN = (-8, -6, -4, -2, 0, 2, 4, 6, 8)  # sigmas, in the map's key


VEHICLE_NAME = "vehicle"  # as a target the vehicle itself, as a channel its side slip

ARCMIN_MRAD = ARCMIN / MILLIRADIAN

BANNERS = {
    GapVerdict.NO_GAP: "good",
    GapVerdict.EXPLAINED: "fair",
    GapVerdict.PARTLY_EXPLAINED: "none",
    GapVerdict.UNEXPLAINED: "bad",
    GapVerdict.REFUSED: "none",
}
GAP_WORDS = {
    GapVerdict.NO_GAP: "No gap",
    GapVerdict.EXPLAINED: "Explained",
    GapVerdict.PARTLY_EXPLAINED: "Partly explained",
    GapVerdict.UNEXPLAINED: "Unexplained",
    GapVerdict.REFUSED: "Not looked at",
}


@dataclass(frozen=True, kw_only=True)
class CauseShown:
    """Causes of one name and target with their figures. drift_nm_h: of them alone. usual_rivals:
    what the catalogue says they are often confused with, beyond the set found here.
    """

    found: Found
    panels: list[Panel]
    overlay: Overlay | None
    drift_nm_h: float | None
    usual_rivals: tuple[str, ...]
    words: Words | None


def diagnosis_html(document: GapReport, overlays: Sequence[Overlay | None] = ()) -> str:
    """The page of a document made by `diagnosis_document`; overlays: one for each cause."""
    longest_s = max((r.parked_s[1] - r.parked_s[0] for r in document.runs if r.parked_s), default=0)
    found = gathered(document.causes)
    overlay_of = dict(zip((id(c) for c in document.causes), overlays, strict=True))
    causes = [_shown(document, f, [overlay_of[id(c)] for c in f.causes], longest_s) for f in found]
    judged = [c for c in document.causes if c.shrink is not None]
    return render_page(
        "diagnosis.html.j2",
        "simreal.report",
        d=document,
        refused=document.verdict is GapVerdict.REFUSED,
        word=GAP_WORDS[document.verdict],
        banner=BANNERS[document.verdict],
        causes=causes,
        found=found,
        maps=gap_maps(document.cells, longest_s) if document.cells else (),
        shades=[(s, shade(s)) for s in SHADES_SHOWN],
        bars=posterior_bars(found) if found else None,
        shrinks=shrink_bars(judged) if judged else None,
        value=value_text,
        p=p_text,
        title=_title(document),
        percent=percent,
        plain=plain,
        listed=listed,
        rivals_words=rivals_words,
        shrink_words=shrink_words,
        drift_words=drift_words,
        expected=expected,
        place_words=lambda place: place_words(place, longest_s),
        looks=LOOK_WORDS,
        mrad=lambda arcmin: arcmin * ARCMIN_MRAD,
        actions=_actions(document),
        glossary=_glossary(document),
        quantity_word=QUANTITY_WORDS.__getitem__,
        interval=interval_text,
        share=share_text,
        run_values=_run_values,
    )


QUANTITY_WORDS = {"drift": "drift, NM/h", "heading": "heading, mrad", NIS: "NIS"}


def _run_values(run: PredictedRun, quantity: str, when: str) -> str:
    """Measured less predicted in one run, each with its sigma; of the NIS the ratio."""
    found = next((q for q in run.quantities if q.quantity == quantity), None)
    if found is None:
        return "not seen"
    values = found.before if when == "before" else found.after
    sigmas = found.sigma_before if when == "before" else found.sigma_after
    said = [f"{value:.2f} ± {sigma:.2f}" for value, sigma in zip(values, sigmas)]
    return ", ".join(said).replace("-", "−")


@dataclass(frozen=True)
class Action:
    """What a reader can do now; command "": nothing to type."""

    text: str
    command: str = ""


def _actions(document: GapReport) -> list[Action]:
    """What to do now, the most useful first."""
    runs = " ".join(shlex.quote(run.run_id) for run in document.runs if run.used)
    out = []
    if document.verdict is GapVerdict.NO_GAP:
        out.append(Action("Nothing: the twin describes these runs."))
    if any(c.effect == WRONG_LATITUDE for c in document.causes):
        out.append(Action("Correct site.lat_deg in run.json of these runs, and run it again."))
    if renewed_by := [c.advice for c in document.causes if c.advice is not None]:
        first = "Make a first table: an update learns what the gyros read."
        again = "Renew the table: an update learns what has changed."
        out.append(Action(again if document.table_sha256 else first, renewed_by[0]))
    usable = [c for c in document.causes if c.kept_out is None]
    if any(c.named and c.rms and c.run_id is None for c in usable):
        out.append(
            Action(
                "Use what was found: twin.json beside this page lists it, and an update takes it"
                " out of the log.",
                "recal update RUN --twin twin.json",
            )
        )
    doubted = (KeptOut.NOT_SHOWN, KeptOut.MADE_WORSE)
    if doubtful := [c for c in document.causes if c.kept_out in doubted]:
        names = " and ".join(f"{c.effect} on {c.target}" for c in doubtful)
        out.append(
            Action(
                f"Let another run decide about {names}: twin.json leaves it out, because other data"
                " do not bear it. Diagnose with a run more, at other temperatures.",
                f"recal diagnose {runs} RUN --twin {shlex.quote(document.twin)} -o diagnosis",
            )
        )
    if document.open:
        out.append(Action("Settle what is open, further down: twin.json leaves it out."))
    if any(not c.rms and c.named for c in document.causes):
        out.append(
            Action(
                "Measure the noise of the unit from its own rests, where a noise was named.",
                f"recal twin fit {runs} -o twin",
            )
        )
    if any(not c.resolved for c in document.causes) or document.unexplained.present:
        out.append(Action("Record what tells the rest apart: the list further down."))
    return out


def _glossary(document: GapReport) -> list[tuple[str, Words]]:
    """Every effect that the page names as a cause or its rival, once."""
    names = [n for c in document.causes for n in (c.effect, *(r.effect for r in c.rivals))]
    found = {name: words_of(name) for name in names}
    return [(name, words) for name, words in found.items() if words is not None]


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


def _title(document: GapReport) -> str:
    unit = document.imu_serial or f"a {document.gyro_technology} unit"
    return f"Simulator against logs of {unit}"


def _shown(
    document: GapReport, found: Found, overlays: Sequence[Overlay | None], longest_s: float
) -> CauseShown:
    cause, drawn = found.first, [o for o in overlays if o is not None]
    if drawn:
        panels = [panel for overlay in drawn for panel in overlay_panels(overlay)][:MOST_PANELS]
    else:
        panels = band_panels(document.cells, _channels_of(document, cause), longest_s)
    drift = document.expected_drift
    own = () if drift is None else zip(document.causes, drift.by_cause_nm_h)
    squares = [nm_h**2 for c, nm_h in own if c in found.causes]
    return CauseShown(
        found=found,
        panels=panels,
        overlay=drawn[0] if drawn else None,
        drift_nm_h=float(np.sqrt(sum(squares))) if squares else None,
        usual_rivals=_usual_rivals(cause),
        words=words_of(cause.effect),
    )


def _channels_of(document: GapReport, cause: Cause) -> list[str]:
    """The target where it is a channel; else (vehicle) the channels that shrink most in nats."""
    gone: dict[str, float] = {}
    for cell in document.cells:
        gone[cell.channel] = gone.get(cell.channel, 0.0) + cell.nats - cell.nats_after
    if cause.target in gone and cause.target != VEHICLE_NAME:
        return [cause.target]
    return sorted(gone, key=lambda channel: -gone[channel])


def _usual_rivals(cause: Cause) -> tuple[str, ...]:
    names = {r for effect in effects_named(cause.effect) for r in rivals_of(effect)}
    return tuple(sorted(names - set(cause.confounded_with) - {cause.effect}))
