"""Sentences of a session's flight: why it was left out, and what it carried beside the gyros'
biases (`infield.session.flown`).
"""

from collections.abc import Mapping
from enum import StrEnum

from infield.reports.words.sentences import Template
from infield.session.flown.priors import Further
from infield.session.reasons import FlightReason
from ins.units import ARCSEC, DEG_PER_HOUR, MICRO_G, MILLIRADIAN, PPM

# of each state: name of its unit and the unit's size in SI
TOLD_IN: Mapping[Further, tuple[str, float]] = {
    Further.SLOW_POSITION: ("m", 1.0),
    Further.SLOW_VELOCITY: ("m/s", 1.0),
    Further.ANTENNA: ("m", 1.0),
    Further.DELAY: ("s", 1.0),
    Further.ACCEL_Z: ("micro-g", MICRO_G),
    Further.ACCEL_SCALE: ("ppm", PPM),
    Further.ACCEL_SHIFT: ("micro-g", MICRO_G),
    Further.ACCEL_SLOPE: ("micro-g/degC", MICRO_G),
    Further.GYRO_SCALE: ("ppm", PPM),
    Further.MISALIGNMENT: ("mrad", MILLIRADIAN),
    Further.SHIFT: ("deg/h", DEG_PER_HOUR),
    Further.FORCE: ("deg/h per g", DEG_PER_HOUR / (1e6 * MICRO_G)),
    Further.DEFLECTION: ("arcsec", ARCSEC),
}

_NAMES: Mapping[StrEnum, str] = {
    Further.SLOW_POSITION: "slow error of the receiver's positions, level",
    Further.SLOW_VELOCITY: "slow error of the receiver's velocities, level",
    Further.ANTENNA: "antenna off its declared place, body x, y, z",
    Further.DELAY: "positions and velocities older than their stamps",
    Further.ACCEL_Z: "bias of the vertical accelerometer",
    Further.ACCEL_SCALE: "scale of the accelerometers",
    Further.ACCEL_SHIFT: "accelerometers in flight against at rest",
    Further.ACCEL_SLOPE: "temperature slope of the accelerometers",
    Further.GYRO_SCALE: "scale of the gyros",
    Further.MISALIGNMENT: "misalignment of the gyros, xy, xz, yx, yz, zx, zy",
    Further.SHIFT: "gyros in flight against at rest",
    Further.FORCE: "gyros by the specific force along them",
    Further.DEFLECTION: "deflection of the vertical along the track, north, east",
}


def _beyond_prior(
    *, state: str, value: float, prior: float, sigmas: float, limit_sigmas: float
) -> str:
    unit, size = TOLD_IN[Further(state)]
    return (
        f"{_NAMES[Further(state)]}: {value / size:+.3g} {unit}, taken for within"
        f" {prior / size:.3g}: {abs(sigmas):.1f} sigma, 99.9 % of sound flights lie within"
        f" {limit_sigmas:.1f}"
    )


def _heading_unseen(*, sigma_rad: float, limit_rad: float, sought_s: float) -> str:
    return (
        f"the log begins in motion, and its first {sought_s / 60.0:.0f} min show the heading"
        f" within {sigma_rad / MILLIRADIAN:.1f} mrad, needed {limit_rad / MILLIRADIAN:.0f}: turns"
        " and changes of speed, or a longer log, would show it"
    )


SENTENCES: Mapping[StrEnum, Template] = {
    FlightReason.UNCOVERED: (
        "fixes cover {covered_percent:.0f} % of the flight, needed {needed_percent:.0f} %"
    ),
    FlightReason.FILTER_LOST: "the filter cannot follow this flight: {fault}",
    FlightReason.EXCESS_RESIDUALS: (
        "{kind}: {excess}; the receiver is worse than declared, or it was led astray"
    ),
    FlightReason.BEYOND_GATE: (
        "{kind}: {share_percent:.0f} % of the fixes lie beyond the gate, needed below"
        " {needed_percent:.0f} %"
    ),
    FlightReason.BEYOND_PRIOR: _beyond_prior,
    FlightReason.UNLIKE_AT_REST: (
        "gyro {axis} reads {size_deg_h:+.4f} +- {sigma_deg_h:.4f} deg/h more in flight than at"
        " rest: {sigmas:.1f} sigma of what is taken for possible, 99.9 % of sound flights lie"
        " within {limit_sigmas:.1f}; vibration, pressure, or a receiver led astray"
    ),
    FlightReason.SHIFT_WIDENED: (
        "gyro {axis} reads {size_deg_h:+.4f} +- {sigma_deg_h:.4f} deg/h more in flight than at"
        " rest, {sigmas:.1f} sigma beyond what is taken for usual ({prior_deg_h:.4f} deg/h): the"
        " flight was estimated again with a difference of that size for its prior; the result is"
        " the mean of both, the second by {belief_percent:.0f} %, which is how probable it is"
    ),
    FlightReason.DEFLECTED: (
        "the vertical is taken to be deflected by {arcsec:.0f} arcsec over {km:.0f} km of the way"
        " (usual: {assumed_arcsec:.0f} over {assumed_km:.0f}): the hills below, or a receiver"
        " whose velocities stray as slowly"
    ),
    FlightReason.NOT_NAVIGATED: "no solution with the receiver: {why}",
    FlightReason.NEVER_LINEAR: (
        "the heading was never known within {limit_deg:.0f} deg for a minute on the way, needed for"
        " a filter about that solution; turns and changes of speed would show it"
    ),
    FlightReason.HEADING_UNSEEN: _heading_unseen,
    **_NAMES,
}
