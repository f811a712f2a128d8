"""twin.html: the document of a fit as one page that fetches nothing. Computes nothing."""

import numpy as np

from infield.reports.drawing import (
    BLACK,
    BLUE,
    DOT,
    PALE,
    VERMILLION,
    Band,
    Item,
    Line,
    Marks,
    Panel,
)
from infield.reports.page import render_page
from simreal.twin.fit.result import ChannelCurve, Needs, Parameter, TwinFit

GYRO_UNIT_DEG_H = 180.0 / np.pi * 3600.0
ACCEL_UNIT_UG = 1e6 / 9.80665
TOLD_BADGES = {True: ("estimated", "good"), False: ("not observable", "none")}


def twin_html(document: TwinFit) -> str:
    """The page of a fit."""
    return render_page(
        "twin.html.j2",
        "simreal.report",
        d=document,
        badges=TOLD_BADGES,
        rests=_rests,
        headline=headline(document),
        banner=_banner(document),
        allan=allan_panels(document),
        spectra=spectra_panels(document),
    )


def headline(document: TwinFit) -> str:
    """The fit in one sentence."""
    told = sum(p.identified for p in document.parameters)
    return (
        f"{told} of {len(document.parameters)} parameters are estimated from"
        f" {document.parked_s / 3600.0:.2g} h at rest."
    )


def _banner(document: TwinFit) -> str:
    """Good where every channel is explained by the model."""
    bad = [c for c in document.channels if c.p_value < 1e-3 / len(document.channels)]
    return "fair" if bad else "good"


def _rests(p: Parameter) -> str:
    """What a parameter rests on."""
    if p.needs is Needs.RUNS or p.name.endswith(("turn_on_deg_h", "turn_on_ug")):
        return f"{p.seconds:.0f} power-ons"
    if p.name.startswith(("temperature", "gnss", "odometer")):
        return f"{p.seconds:.0f} readings"
    return f"{p.seconds / 3600.0:.2g} h at rest"


def allan_panels(document: TwinFit) -> list[Panel]:
    """Allan deviations: data, model, and the band in which 95 % of such data lie."""
    panels = []
    for channel in sorted(document.channels, key=_place):
        scale, unit = _unit(channel)
        tau = np.asarray(channel.tau_s)
        low, high = scale * np.asarray(channel.allan_low), scale * np.asarray(channel.allan_high)
        items: list[Item] = []
        if np.isfinite(low).any():  # a model that the data contradict is not drawn
            model = scale * np.asarray(channel.allan_model)
            items = [
                Band(tau, low, high, PALE, 1.0, "95 % of such runs"),
                Line(tau, model, BLUE, "model"),
            ]
        items.append(Line(tau, scale * np.asarray(channel.allan), BLACK, "data", width=0.9))
        panels.append(_panel("Allan deviation", channel, items, "averaging time [s]", unit))
    return panels


def spectra_panels(document: TwinFit) -> list[Panel]:
    """Spectra: data in bands, model; a cross is a band that is left out, for the
    vehicle's own motion fills it or a filter empties it.
    """
    panels = []
    for channel in sorted(document.channels, key=_place):
        scale, unit = _unit(channel)
        f, dof = np.asarray(channel.frequency_hz), np.asarray(channel.dof)
        power = scale * np.sqrt(np.asarray(channel.power))
        used = dof > 0
        items: list[Item] = [Marks(f[used], power[used], DOT, BLACK, "data", size=2.2)]
        if not used.all():
            left_out = "left out: the vehicle's, or above a filter's band"
            items.append(Marks(f[~used], power[~used], "x", VERMILLION, left_out, size=3.0))
        model = scale * np.sqrt(np.asarray(channel.power_model))
        items.append(Line(f, model, BLUE, "model"))
        panels.append(_panel("Spectrum", channel, items, "frequency [Hz]", f"{unit}/sqrt(Hz)"))
    return panels


def _panel(what: str, channel: ChannelCurve, items: list[Item], x_label: str, unit: str) -> Panel:
    return Panel(
        items=items,
        title=channel.channel,
        label=f"{channel.channel}: {what} of data and fitted model",
        x_label=x_label,
        y_label=f"[{unit}]",
        x_log=True,
        y_log=True,
    )


def _place(channel: ChannelCurve) -> int:
    """Gyros before accelerometers, x, y, z."""
    return "xyz".index(channel.channel[-1]) + 3 * channel.channel.startswith("accel")


def _unit(channel: ChannelCurve) -> tuple[float, str]:
    if channel.channel.startswith("gyro"):
        return GYRO_UNIT_DEG_H, "deg/h"
    return ACCEL_UNIT_UG, "ug"
