"""Sentences of `infield.misalignment`: why azimuths carry no answer, what they cannot show."""

from collections.abc import Mapping, Sequence
from enum import StrEnum

from infield.misalignment.reasons import (
    Azimuths,
    MisalignmentNote,
    MisalignmentReason,
    StopReason,
    Unseen,
)
from infield.reports.words.sentences import Template
from ins.units import ARCSEC, DEG


def _missing(*, missing_deg: Sequence[float], rank: int) -> str:
    at = ", ".join(f"{place:.0f}" for place in missing_deg)
    return (
        f"stops on {4 - len(missing_deg)} of the four azimuths, needed all, 90 deg apart: none near"
        f" {at} deg; rank {rank} of 3"
    )


def _contradicted(*, stop: int, run_id: str, given_rad: float, seen_rad: float) -> str:
    return (
        f"stop {stop} ({run_id}): heading given {given_rad / DEG:.2f} deg, the gyros say"
        f" {seen_rad / DEG % 360:.2f} deg: order of the runs, or azimuths counted from north to"
        " west?"
    )


def _given(*, sigma_stop_rad: float, sigma_north_rad: float) -> str:
    stop, north = sigma_stop_rad / ARCSEC, sigma_north_rad / DEG
    return (
        f"given: each stop within {stop:g} arcsec, their common north within {north:.3g} deg (1"
        " sigma)"
    )


def _of_table(*, sigma_heading_rad: float) -> str:
    if sigma_heading_rad == 0.0:
        return "as in the table, without error"
    return f"as in the table, their common north within {sigma_heading_rad / DEG:.3g} deg (1 sigma)"


def _turned(*, turned_rad: float, allowed_rad: float, prior_mrad: float) -> str:
    return (
        f"headings given and gyros are turned against each other by {turned_rad / DEG:+.2f} deg,"
        f" {abs(turned_rad / allowed_rad):.1f} times what the declared sigma and couplings of"
        f" {prior_mrad:g} mrad allow: taken as an error that all headings share, so that xy and yx"
        " are not known each for itself (--prior-mrad, where the triad may be turned in its case)"
    )


def _scatter(*, sigma_rad: float) -> str:
    return (
        f"the gyros show errors of {sigma_rad / ARCSEC:.0f} arcsec (1 sigma) in the heading of each"
        " stop beyond the declared ones: the sigmas allow for it"
    )


def _creeps(*, turned_rad: float) -> str:
    return f"turns by {turned_rad / DEG:.2f} deg while it stands"


SENTENCES: Mapping[StrEnum, Template] = {
    MisalignmentReason.AZIMUTHS_MISSING: _missing,
    MisalignmentReason.STOP_OFF_ITS_PLACE: (
        "a stop is {off_deg:.2f} deg off its place on 0, 90, 180, 270 deg, needed within"
        " {needed_deg:g} deg; rank {rank} of 3"
    ),
    MisalignmentReason.NOTHING_GAINED: (
        "the best coupling has a sigma of {best_mrad:.3g} mrad, the prior is {prior_mrad:g} mrad:"
        " nothing is gained"
    ),
    MisalignmentReason.AZIMUTHS_CONTRADICT: (
        "the azimuths contradict each other: chi-square {chi2:.1f} of {dof} degrees of freedom, at"
        " most {limit:.1f} at 99.9 %; largest residual {residual_deg_h:+.4f} deg/h of gyro {axis}"
        " at stop {stop}"
    ),
    MisalignmentReason.NO_STOP: "no stop in the runs",
    MisalignmentReason.AZIMUTHS_NOT_FOUND: (
        "gyro bias within {reach_deg_h:.3g} deg/h against {level_rate_deg_h:.3g} deg/h of level"
        " Earth rate: the azimuths cannot be found with these gyros; give the headings of the"
        " stops"
    ),
    MisalignmentReason.HEADINGS_MISCOUNTED: "{headings} headings for {stops} stops",
    MisalignmentReason.HEADING_CONTRADICTED: _contradicted,
    StopReason.LEFT_OUT: "{run_id}, {start_s:.0f} to {end_s:.0f} s: {why}",
    StopReason.NO_STRETCH: "{run_id}: no stretch of {needed_s:.0f} s between turns",
    StopReason.NEVER_RESTS: "never rests for a minute (a moving base?)",
    StopReason.MOVES: "{witness}",
    StopReason.CREEPS: _creeps,
    StopReason.TOO_SHORT: "at rest for {used_s:.0f} s, needed {needed_s:.0f} s",
    MisalignmentNote.NO_TEMPERATURE: (
        "{run_id}: {shortage}; its stops may be at any temperature of the table"
    ),
    MisalignmentNote.TEMPERATURES_APART: (
        "the gyros are up to {spread_degC:.1f} degC apart between stops: compared through the"
        " unit's table"
    ),
    MisalignmentNote.HEADINGS_TURNED: _turned,
    MisalignmentNote.HEADINGS_SCATTER: _scatter,
    Azimuths.FOUND: (
        "found with the gyros: north unknown, one heading a run, turns within a run by the vertical"
        " gyro"
    ),
    Azimuths.GIVEN: _given,
    Azimuths.OF_TABLE: _of_table,
    Unseen.VERTICAL: (
        "what the vertical couples in is a bias at one attitude and latitude: it stays in the"
        " table; tilt the unit to see it"
    ),
    Unseen.NORTH: (
        "turning both level gyros about down looks like another north: give headings"
        " (--heading-deg) from a line outside"
    ),
    Unseen.DIAGONAL: (
        "xy + yx shows off the cardinal headings only where nobody gives the azimuths: stand on 45,"
        " 135, 225, 315 deg"
    ),
    Unseen.WEAK: (
        "noise: its sigma is too near to the prior; stay longer at each stop, or make the stops in"
        " one power-on"
    ),
    Unseen.MOUNTING: (
        "the unit's base against the turning axis looks the same; give --sigma-mounting-arcsec to"
        " state a bias"
    ),
    Unseen.NO_ACCELEROMETERS: "a table of biases has no accelerometers",
    Unseen.NOT_FITTED: "nothing was fitted",
    Unseen.OFFSET_OR_TILT: "the headings do not tell offset from tilt",
    Unseen.GROUND_DIFFERS: (
        "the ground was not the same under all stops: chi-square {chi2:.0f} of {dof} degrees of"
        " freedom; turn the unit in one place"
    ),
}
