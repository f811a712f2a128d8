"""twin.html: the document of a fit as one page that fetches nothing. Computes nothing."""

from typing import TYPE_CHECKING

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from infield.reports.figures import (
    BLACK,
    BLUE,
    PALE,
    VERMILLION,
    axis_text,
    in_style,
    new_figure,
    svg_text,
)
from simreal.report.page import render_page
from simreal.report.twin_records import ChannelRecord, TwinFitRecord
from simreal.report.twin_words import PARAMETER_NAMES, needs_words, size_words
from simreal.twin.fit.result import Needs, Parameter

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.figure import Figure

GYRO_UNIT_DEG_H = 180.0 / np.pi * 3600.0
ACCEL_UNIT_UG = 1e6 / 9.80665
TOLD_BADGES = {True: ("told", "good"), False: ("not told", "none")}


def twin_html(document: TwinFitRecord) -> str:
    """The page of a fit."""
    found = document.found
    assert found is not None
    return render_page(
        "twin.html.j2",
        d=document,
        rows=[(p, size_words(p), needs_words(p)) for p in found.parameters],
        names=PARAMETER_NAMES,
        badges=TOLD_BADGES,
        rests=_rests,
        headline=headline(document),
        banner=_banner(document),
        allan=_svg(
            allan_figure(document), "Allan deviation of each channel and of the fitted model"
        ),
        spectra=_svg(spectra_figure(document), "Spectrum of each channel and of the fitted model"),
    )


def headline(document: TwinFitRecord) -> str:
    """The fit in one sentence."""
    told = sum(p.identified for p in document.parameters)
    return (
        f"{told} of {len(document.parameters)} parameters are told by"
        f" {document.parked_s / 3600.0:.2g} h at rest."
    )


def _banner(document: TwinFitRecord) -> str:
    """Good where what any run shows, the white noise, is told and every channel is explained."""
    bad = [c for c in document.channels if c.p_value < 1e-3 / len(document.channels)]
    return "fair" if bad else "good"


def _rests(p: Parameter) -> str:
    """What a parameter rests on."""
    if p.needs is Needs.RUNS or p.name.endswith(("turn_on_deg_h", "turn_on_ug")):
        return f"{p.seconds:.0f} power-ons"
    if p.name.startswith(("temperature", "gnss", "odometer")):
        return f"{p.seconds:.0f} readings"
    return f"{p.seconds / 3600.0:.2g} h at rest"


def _svg(figure: "Figure", label: str) -> Markup:
    return svg_text(figure, label)


@in_style
def allan_figure(document: TwinFitRecord) -> "Figure":
    """Allan deviations: data, model, and the band in which 95 % of such data lie."""
    figure, axes = new_figure(2, 3, height=5.4)
    for k, channel in enumerate(document.channels):
        ax = axes.flat[_place(channel, k)]
        scale, unit = _unit(channel)
        tau = np.asarray(channel.tau_s)
        low, high = scale * np.asarray(channel.allan_low), scale * np.asarray(channel.allan_high)
        if np.isfinite(low).any():  # a model that the data contradict is not drawn
            ax.fill_between(tau, low, high, color=PALE, label="95 % of such runs")
            ax.plot(tau, scale * np.asarray(channel.allan_model), color=BLUE, label="model")
        ax.plot(tau, scale * np.asarray(channel.allan), color=BLACK, linewidth=0.9, label="data")
        ax.set_xscale("log")
        ax.set_yscale("log")
        axis_text(ax, title=channel.channel, x="averaging time [s]", y=f"[{unit}]")
    _legend(figure, axes)
    return figure


@in_style
def spectra_figure(document: TwinFitRecord) -> "Figure":
    """Spectra: data in bands, model; a cross is a band that is left out, for the
    vehicle's own motion fills it or a filter empties it.
    """
    figure, axes = new_figure(2, 3, height=5.4)
    for k, channel in enumerate(document.channels):
        ax = axes.flat[_place(channel, k)]
        scale, unit = _unit(channel)
        f, dof = np.asarray(channel.frequency_hz), np.asarray(channel.dof)
        power = scale * np.sqrt(np.asarray(channel.power))
        used = dof > 0
        ax.plot(
            f[used],
            power[used],
            color=BLACK,
            linestyle="none",
            marker=".",
            markersize=3,
            label="data",
        )
        if not used.all():
            ax.plot(
                f[~used],
                power[~used],
                color=VERMILLION,
                linestyle="none",
                marker="x",
                markersize=3,
                label="left out: the vehicle's, or above a filter's band",
            )
        ax.plot(f, scale * np.sqrt(np.asarray(channel.power_model)), color=BLUE, label="model")
        ax.set_xscale("log")
        ax.set_yscale("log")
        axis_text(ax, title=channel.channel, x="frequency [Hz]", y=f"[{unit}/sqrt(Hz)]")
    _legend(figure, axes)
    return figure


def _place(channel: ChannelRecord, k: int) -> int:
    return "xyz".index(channel.channel[-1]) + 3 * channel.channel.startswith("accel")


def _unit(channel: ChannelRecord) -> tuple[float, str]:
    if channel.channel.startswith("gyro"):
        return GYRO_UNIT_DEG_H, "deg/h"
    return ACCEL_UNIT_UG, "ug"


def _legend(figure: "Figure", axes: NDArray) -> None:
    named: dict[str, Artist] = {}
    for ax in axes.flat:
        handles, labels = ax.get_legend_handles_labels()
        named |= dict(zip(labels, handles))
        ax.set_visible(bool(labels))
    figure.legend(list(named.values()), list(named), loc="outside upper center", ncols=4)
