"""The noise of a log as `look` shows it: no model that contradicts the data drawn beside it."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from simreal.report.twin_records import ChannelRecord, TwinFitRecord

TRIADS = ("gyro", "accel")
# of the averaging times of a channel; chosen: of sound ones 5 % lie outside their band
CONTRADICTED_SHARE = 0.5
# between data and model: axes of one sensor that share a model differ by some 10 %; a low-pass
# filter taken for flicker made it 3.2 on a plane's log (tests/recal/test_look_noise.py)
CONTRADICTING_FACTOR = 1.5


def shown_noise(fitted: TwinFitRecord | None) -> tuple[TwinFitRecord | None, list[str]]:
    """The fit without the sensors whose data contradict it, and a note on each: of those no model
    is drawn and no number stated.
    """
    if fitted is None:
        return None, []
    notes = []
    for triad in TRIADS:
        channels = [c for c in fitted.channels if c.channel.startswith(triad)]
        worst = max(channels, key=_contradicted, default=None)
        if worst is None or _contradicted(worst) <= CONTRADICTED_SHARE:
            continue
        fitted = _without(fitted, triad)
        ratio, at = _furthest(worst)
        notes.append(
            f"{triad} noise: the fitted model is {ratio:.3g} times the data over {at:g} s"
            f" ({worst.channel}), so it is neither drawn nor stated: filtered by the logger, or a"
            " rest too short or unsteady"
        )
    return fitted, notes


def _contradicted(channel: ChannelRecord) -> float:
    """The share of averaging times at which the data lie outside the band, and far from it."""
    data, model = np.asarray(channel.allan), np.asarray(channel.allan_model)
    low, high = np.asarray(channel.allan_low), np.asarray(channel.allan_high)
    if not data.size or not np.all(data > 0) or not np.all(model > 0):
        return 0.0
    far = np.abs(np.log(data / model)) > np.log(CONTRADICTING_FACTOR)
    return float(np.mean(far & ((data < low) | (data > high))))


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
