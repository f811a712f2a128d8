"""The noise of a log as `look` shows it: no model that contradicts the data drawn beside it."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from simreal.report.twin_records import ChannelRecord, TwinFitRecord
from simreal.twin.fit.curves import contradicted

TRIADS = ("gyro", "accel")


def shown_noise(fitted: TwinFitRecord | None) -> tuple[TwinFitRecord | None, list[str]]:
    """The fit without the sensors whose data contradict it, and a note on each: of those no model
    is drawn and no number stated.
    """
    if fitted is None:
        return None, []
    notes = []
    for triad in TRIADS:
        channels = [c for c in fitted.channels if c.channel.startswith(triad)]
        against = [c for c in channels if contradicted(c)]
        if not against:
            continue
        fitted = _without(fitted, triad)
        worst = max(against, key=lambda c: abs(np.log(_furthest(c)[0])))
        ratio, at = _furthest(worst)
        notes.append(
            f"{triad} noise: the fitted model is {ratio:.3g} times the data over {at:g} s"
            f" ({worst.channel}), so it is neither drawn nor stated: filtered by the logger, or a"
            " rest too short or unsteady"
        )
    return fitted, notes


def _furthest(channel: ChannelRecord) -> tuple[float, float]:
    """Model over data where they are furthest apart, and the averaging time [s]."""
    ratio = np.asarray(channel.allan_model) / np.asarray(channel.allan)
    k = int(np.argmax(np.abs(np.log(ratio))))
    return float(ratio[k]), float(channel.tau_s[k])


def _without(fitted: TwinFitRecord, triad: str) -> TwinFitRecord:
    """The fit with nothing of one triad drawn, and none of its numbers told."""
    channels = [_undrawn(c) if c.channel.startswith(triad) else c for c in fitted.channels]
    parameters = [
        replace(p, identified=False) if p.name.startswith(triad) else p for p in fitted.parameters
    ]
    found = fitted.found
    if found is not None:
        told = tuple(
            replace(p, identified=False) if p.name.startswith(triad) else p
            for p in found.parameters
        )
        found = replace(found, parameters=told)
    return replace(fitted, channels=channels, parameters=parameters, found=found)


def _undrawn(channel: ChannelRecord) -> ChannelRecord:
    none: Sequence[float] = [np.nan] * len(channel.allan)
    return replace(channel, allan_model=none, allan_low=none, allan_high=none)
