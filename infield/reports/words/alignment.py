"""Sentences of `alignment`: why an alignment is what it is."""

from collections.abc import Mapping
from enum import StrEnum

from alignment.linearised import NothingStands
from alignment.reasons import AlignmentReason
from infield.reports.words.sentences import Template

SENTENCES: Mapping[StrEnum, Template] = {
    AlignmentReason.LATITUDE_TOO_HIGH: (
        "latitude {latitude_deg:.2f} deg: no gyrocompass alignment above {limit_deg:g} deg"
    ),
    AlignmentReason.NEVER_RESTS: (
        "the log never rests for a minute; a parked stretch of 5 to 15 min is needed"
    ),
    AlignmentReason.BEGINS_IN_MOTION: (
        "the log begins in motion: no rest to align on before the flight"
    ),
    AlignmentReason.NO_HEADING: (
        "gyro uncertainty {sigma_deg_h:.3g} deg/h against {level_deg_h:.3g} deg/h of level Earth"
        " rate: heading cannot be found at rest; give a heading or turn the unit"
    ),
    AlignmentReason.TURNS: (
        "the gyros read {rate_deg_h:.4g} deg/h at rest, Earth rate is {earth_deg_h:.4g}: the"
        " vehicle turns, or the unit of the gyros is wrong (deg/s read as rad/s:"
        " {as_degrees_deg_h:.3g} deg/h in truth)"
    ),
    AlignmentReason.TURNS_OR_BIAS: "{turns}, or it is all bias",
    AlignmentReason.LIKE_MEMS: (
        "the gyros are {sigma_deg_h:.3g} deg/h off, {usual_deg_h:g} is usual for {technology}:"
        " another technology or a fault; the level is taken to be as good as that of a mems unit"
    ),
    AlignmentReason.LEVEL_ALONE: (
        "level from the accelerometers alone: the gyros may be off by {turn_deg:.2g} deg over the"
        " {rest_s:.0f} s"
    ),
    AlignmentReason.NOTHING_STANDS: NothingStands.TEMPLATE,
    AlignmentReason.NOTHING_MEASURED: (
        "{dof} measurements leave the heading at {sigma_deg:.2g} deg, {prior_deg:.2g} deg were"
        " taken to begin with: nothing was found; {used_percent:.0f} % of the parked seconds were"
        " used"
    ),
    AlignmentReason.MOVES: (
        "it moves: the rest does not fit even {scale:g} times the noise model ({source})"
    ),
    AlignmentReason.NOISIER: (
        "the unit is noisier than its noise model ({source}): taken {scale:g} times as large"
    ),
    AlignmentReason.WRONG_LATITUDE: (
        "latitude entered {entered_deg:.3f} deg, the gyros say {found_deg:.3f} +-"
        " {sigma_deg:.3f} deg: wrong position, or a gyro bias beyond its sigma"
    ),
    AlignmentReason.LATITUDE_IN_RADIANS: (
        "latitude entered {entered_deg:.4f} deg, the gyros say {found_deg:.3f} +- {sigma_deg:.3f}"
        " deg: that number in radians; enter it in degrees"
    ),
    AlignmentReason.LATITUDE_IS_LONGITUDE: (
        "latitude entered {entered_deg:.3f} deg, the gyros say {found_deg:.3f} +- {sigma_deg:.3f}"
        " deg, which is the longitude entered: the two are swapped"
    ),
    AlignmentReason.EXCESS_RESIDUALS: (
        "the residuals are larger than the noise model allows: NIS {nis_mean:.2f} per degree of"
        " freedom, band to {limit:.2f}"
    ),
    AlignmentReason.NO_TABLE: (
        "no table of {imu_serial} in the store: gyro bias taken as 0 +- {sigma_deg_h:.3g} deg/h,"
        " the raw bias of {technology} gyros, and the heading's sigma rests on it; recal table"
        " import TABLE gives the unit's own"
    ),
    AlignmentReason.SPEED_AT_REST: (
        "{witness} says up to {fastest_m_s:.1f} m/s for {moving_s:.0f} s while the inertial"
        " solution rests: a steady roll taken for rest, or a wrong stream"
    ),
    AlignmentReason.DEAD_ODOMETER: (
        "the odometer reads zero while the inertial solution rolls for {rolling_s:.0f} s: a dead"
        " encoder reads as parked"
    ),
}
