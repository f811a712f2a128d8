"""Why an alignment is what it is: codes with the templates of their sentences."""

from enum import StrEnum

from ins.verdicts import ReasonCode


class AlignmentVerdict(StrEnum):
    """What came of an alignment (formats.md, section 5)."""

    ALIGNED = "aligned"
    LEVEL_ONLY = "level_only"
    REFUSED = "refused"
    INCONSISTENT = "inconsistent"


# verdicts with a heading
WITH_HEADING = (AlignmentVerdict.ALIGNED, AlignmentVerdict.INCONSISTENT)


class AlignmentReason(ReasonCode):
    """What was measured and what was needed."""

    LATITUDE_TOO_HIGH = (
        "latitude_too_high",
        "latitude {latitude_deg:.2f} deg: no gyrocompass alignment above {limit_deg:g} deg",
    )
    NEVER_RESTS = (
        "never_rests",
        "the log never rests for a minute",
        "a parked stretch of 5 to 15 min is needed",
    )
    BEGINS_IN_MOTION = (
        "begins_in_motion",
        "the log begins in motion: no rest to align on before the flight",
    )
    NO_HEADING = (
        "no_heading",
        "gyro uncertainty {sigma_deg_h:.3g} deg/h against {level_deg_h:.3g} deg/h of level Earth"
        " rate: heading cannot be found at rest",
        "give a heading or turn the unit",
    )
    ON_ITS_SIDE = (
        "on_its_side",
        "the unit stands with its z axis {tilt_deg:.0f} deg off the vertical: a heading is found"
        " within {limit_deg:.0f} deg of it",
        "set it upright or upside down",
    )
    TURNS = (
        "turns",
        "the gyros read {rate_deg_h:.4g} deg/h at rest, Earth rate is {earth_deg_h:.4g}: the"
        " vehicle turns, or the unit of the gyros is wrong (deg/s read as rad/s:"
        " {as_degrees_deg_h:.3g} deg/h in truth)",
    )
    TURNS_OR_BIAS = "turns_or_bias", "{turns}, or it is all bias"
    LIKE_MEMS = (
        "like_mems",
        "the gyros are {sigma_deg_h:.3g} deg/h off, {usual_deg_h:g} is usual for {technology}:"
        " another technology or a fault; the sigma of the level is that of a mems unit",
    )
    LEVEL_ALONE = (
        "level_alone",
        "level from the accelerometers alone: the gyros may be off by {turn_deg:.2g} deg over the"
        " {rest_s:.0f} s",
    )
    NOTHING_STANDS = (
        "nothing_stands",
        "the sensors indicate {rest_s:.0f} s at rest, but the navigated velocity is zero in no"
        " filter step: the vehicle moves, or the unit is much noisier than its noise model"
        " ({source})",
    )
    NOTHING_MEASURED = (
        "nothing_measured",
        "after {dof} measurements the heading sigma is {sigma_deg:.2g} deg, at the start it was"
        " {prior_deg:.2g} deg: no heading was found; {used_percent:.0f} % of the parked seconds"
        " were used",
    )
    MOVES = (
        "moves",
        "the vehicle moves: the residuals at rest exceed even {scale:g} times the noise model"
        " ({source})",
    )
    NOISIER = (
        "noisier_than_model",
        "the unit is noisier than its noise model ({source}): the model is used {scale:g} times as"
        " large",
    )
    WRONG_LATITUDE = (
        "wrong_latitude",
        "latitude entered {entered_deg:.3f} deg, the gyros say {found_deg:.3f} +- {sigma_deg:.3f}"
        " deg: wrong position, or gyros that are biased beyond their sigma or turned against the"
        " accelerometers",
    )
    LATITUDE_IN_RADIANS = (
        "latitude_in_radians",
        "latitude entered {entered_deg:.4f} deg, the gyros say {found_deg:.3f} +- {sigma_deg:.3f}"
        " deg: the value entered looks like radians",
        "enter it in degrees",
    )
    LATITUDE_IS_LONGITUDE = (
        "latitude_is_longitude",
        "latitude entered {entered_deg:.3f} deg, the gyros say {found_deg:.3f} +- {sigma_deg:.3f}"
        " deg, which is the longitude entered: the two are swapped",
    )
    LATITUDE_DOUBTFUL = (
        "latitude_doubtful",
        "latitude entered {entered_deg:.3f} deg, the gyros say {found_deg:.3f} +- {sigma_deg:.3f}"
        " deg, {apart:.1f} sigma apart (one of 20 sound runs is 2 or more): a wrong position, a"
        " gyro bias, or chance",
    )
    EXCESS_RESIDUALS = (
        "excess_residuals",
        "the residuals are larger than the noise model allows: NIS {nis_mean:.2f} per degree of"
        " freedom, band to {limit:.2f}",
    )
    NO_TABLE = (
        "no_table",
        "no table of {imu_serial} in the store: gyro bias taken as 0 +- {sigma_deg_h:.3g} deg/h,"
        " the raw bias of {technology} gyros, and the heading's sigma rests on it",
        "recal table import TABLE gives the unit's own",
    )
    SPEED_AT_REST = (
        "speed_at_rest",
        "{witness} says up to {fastest_m_s:.1f} m/s for {moving_s:.0f} s while the inertial"
        " solution rests: a steady roll taken for rest, or a wrong stream",
    )
    DEAD_ODOMETER = (
        "dead_odometer",
        "the odometer reads zero for {rolling_s:.0f} s while the inertial solution moves: a failed"
        " wheel encoder looks like a parked vehicle",
    )


LATITUDE_REASONS = (
    AlignmentReason.WRONG_LATITUDE,
    AlignmentReason.LATITUDE_IN_RADIANS,
    AlignmentReason.LATITUDE_IS_LONGITUDE,
)
