"""Sentences of `infield.replay`: why a replay is what it is, what a reader must know of it."""

from collections.abc import Mapping
from enum import StrEnum

from infield.replay.reasons import Damping, ReplayNote, ReplayReason, SchulerReason
from infield.reports.words.sentences import Template


def _parked_too_short(*, parked_s: float, needed_s: float) -> str:
    return (
        f"parked for {parked_s / 60:.0f} min of navigation, needed {needed_s / 60:.0f} min (three"
        " quarters of a period)"
    )


def _unsure(*, sigma_s: float, needed_s: float) -> str:
    return (
        f"period good to {sigma_s / 60:.0f} min only, needed {needed_s / 60:.0f} min: a longer"
        " record is needed"
    )


def _extrapolated(*, parked_s: float) -> str:
    return f"parked for {parked_s / 60:.0f} min of navigation: NM/h is extrapolated"


SENTENCES: Mapping[StrEnum, Template] = {
    ReplayReason.NEVER_RESTS: (
        "the log never rests for a minute; a parked alignment of 5 to 15 min is needed"
    ),
    ReplayReason.LOG_ENDS: (
        "the log ends {left_s:.0f} s after its alignment, {needed_s:.0f} s of navigation are needed"
    ),
    ReplayReason.BY_AIDED: "aided by GNSS: {reason}",
    ReplayNote.LOG_FAULT: "{start_s:g} to {end_s:g} s: {fault}",
    ReplayNote.NO_TEMPERATURE: (
        "no gyro temperature in the run: no table can be applied, flown with the raw gyro output"
    ),
    ReplayNote.TEMPERATURE_TOO_SHORT: (
        "{shortage}: no table can be applied, flown with the raw gyro output"
    ),
    ReplayNote.THERMOMETER_FAULT: "{fault}",
    ReplayNote.MEAN_STANDS_IN: (
        "gyro {axis}: no thermometer of its own, the others' mean stands in"
    ),
    ReplayNote.NO_FREE_INERTIAL: "no free-inertial flight: {reason}",
    ReplayNote.EXTRAPOLATED: _extrapolated,
    ReplayNote.BEYOND_NODES: (
        "gyro {axis}: {low_degC:.1f} to {high_degC:.1f} degC, beyond the table's nodes: end value"
        " held"
    ),
    SchulerReason.PARKED_TOO_SHORT: _parked_too_short,
    SchulerReason.NO_SWING: "no swing: the fit runs to the end of 30 to 240 min",
    SchulerReason.SMALL_SWING: (
        "swing of {amplitude_m_s:.2g} m/s, {left_m_s:.2g} m/s are left of the fit: too small to"
        " time"
    ),
    SchulerReason.UNSURE: _unsure,
    Damping.SITE: "damped to the height of the site (no GNSS height in the run)",
    Damping.GNSS: "damped to the GNSS height",
}
