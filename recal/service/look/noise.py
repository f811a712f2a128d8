"""The noise of a log as `look` draws it: no model that contradicts the data beside it."""

from dataclasses import replace

import numpy as np

from simreal.report.twin_document import FitReport
from simreal.twin.fit.curves import contradicted
from simreal.twin.fit.result import ChannelCurve

TRIADS = ("gyro", "accel")


def shown_noise(fitted: FitReport | None) -> tuple[FitReport | None, list[str]]:
    """The fit without the curves of sensors whose data contradict it, and a note on each. Which
    numbers are told is decided by the fit itself.
    """
    if fitted is None:
        return None, []
    channels, notes = list(fitted.channels), []
    for triad in TRIADS:
        mine = [c for c in channels if c.channel.startswith(triad)]
        against = [c for c in mine if contradicted(c)]
        if not against:
            continue
        channels = [_undrawn(c) if c in mine else c for c in channels]
        worst = max(against, key=lambda c: abs(np.log(_furthest(c)[0])))
        ratio, at = _furthest(worst)
        notes.append(
            f"{triad} noise: over {at:g} s the fitted model is {ratio:.3g} times the data"
            f" ({worst.channel}), so it is not drawn. The logger may filter the data, or the rest"
            " is too short or unsteady."
        )
    drawn = replace(fitted, channels=channels) if notes else fitted
    shown = {c.channel for c in channels if np.isfinite(c.allan_model).all()}
    moved = [c for c in fitted.read_above_hz if c in shown]
    if moved:
        above_hz = max(fitted.read_above_hz.values())
        notes.append(
            f"noise: people or wind move the vehicle. The model of {', '.join(moved)} rests on what"
            f" lies above {above_hz:g} Hz; the data drawn hold the motion as well."
        )
    return drawn, notes


def _furthest(channel: ChannelCurve) -> tuple[float, float]:
    """Model over data where they are furthest apart, and the averaging time [s]."""
    ratio = channel.allan_model / channel.allan
    k = int(np.argmax(np.abs(np.log(ratio))))
    return float(ratio[k]), float(channel.tau_s[k])


def _undrawn(channel: ChannelCurve) -> ChannelCurve:
    none = np.full(channel.allan.size, np.nan)
    return replace(channel, allan_model=none, allan_low=none, allan_high=none)
