"""fleet.html: the fleet document as one page that fetches nothing. Computes nothing."""

from functools import lru_cache
from typing import Any

from jinja2 import ChoiceLoader, Environment, PackageLoader

from recal.fleet import figures
from recal.fleet.records import OUTCOMES
from recal.service.results.pages import decimals_for, page_environment

SHOWN_UNITS = 25  # rows of the ranking before the rest is folded
VERDICTS = {  # verdict: word, look, symbol, what it means
    "committed": ("Committed", "good", "✔", "Tables in the store were updated."),
    "proposed": (
        "Proposed",
        "fair",
        "◆",
        "The tables in the store are as they were; proposals wait for a decision.",
    ),
    "up_to_date": ("Up to date", "good", "✔", "Every run was in its unit's table before."),
    "inconsistent": (
        "Inconsistent",
        "bad",
        "✖",
        "Nothing was merged: data contradict the model or the stored tables.",
    ),
    "refused": ("Refused", "none", "■", "Nothing was merged: no run had anything to gain from."),
    "bad_input": ("Bad input", "none", "■", "Nothing was merged: no run could be read."),
    "failed": (
        "Failed",
        "bad",
        "✖",
        "Nothing was merged: the program, its workers or the store broke down.",
    ),
}
LOOKS = {
    "committed": "good",
    "proposed": "fair",
    "already": "good",
    "inconsistent": "bad",
    "refused": "none",
    "bad_input": "none",
    "taken_out": "none",
    "crashed": "bad",
}


def fleet_html(document: dict[str, Any]) -> str:
    """The page of a document made by `fleet_document`."""
    units = [
        {**u, "name": _name(u), "strip": figures.coverage_strip(u["coverage"])}
        for u in document["units"]
    ]
    ranked = [u for u in units if u["drift"]]
    return (
        _environment()
        .get_template("fleet.html.j2")
        .render(
            d=document,
            verdict=VERDICTS[document["verdict"]],
            looks=LOOKS,
            meanings=OUTCOMES,
            bar=figures.outcome_bar(document["counts"]),
            total=sum(document["counts"].values()),
            first=ranked[:SHOWN_UNITS],
            rest=ranked[SHOWN_UNITS:],
            unranked=[u for u in units if not u["drift"]],
            surprising=[
                u
                for u in ranked
                if u["drift"]["surprise_sigmas"] > document["criteria"]["surprise_sigmas"]
            ],
            stepped=[u for u in units if u["step_words"]],
            decimals=decimals_for([u["drift"]["sigma_after_deg_h"] for u in ranked]),
            ranking=figures.ranking_drawing(document),
            coverage=figures.coverage_drawing(document),
            tables=figures.tables_drawing(document),
            progress=figures.progress_drawing(document),
            name=_name,
        )
    )


def _name(unit: dict[str, Any]) -> str:
    """A unit for people: the technology and the mode only where there is more to say than the
    serial.
    """
    return " ".join(filter(None, (unit["imu_serial"], unit["gyro_mode"])))


@lru_cache(maxsize=1)
def _environment() -> Environment:
    shared = page_environment()
    assert shared.loader is not None
    return shared.overlay(
        loader=ChoiceLoader([PackageLoader("recal.fleet", "templates"), shared.loader])
    )
