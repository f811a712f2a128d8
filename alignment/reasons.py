"""Why an alignment is what it is, as codes. Sentences: `infield.reports.words.alignment`."""

from enum import StrEnum


class AlignmentVerdict(StrEnum):
    """What came of an alignment (formats.md, section 5)."""

    ALIGNED = "aligned"
    LEVEL_ONLY = "level_only"
    REFUSED = "refused"
    INCONSISTENT = "inconsistent"


# verdicts with a heading
WITH_HEADING = (AlignmentVerdict.ALIGNED, AlignmentVerdict.INCONSISTENT)


class AlignmentReason(StrEnum):
    """What was measured and what was needed."""

    LATITUDE_TOO_HIGH = "latitude_too_high"
    NEVER_RESTS = "never_rests"
    BEGINS_IN_MOTION = "begins_in_motion"
    NO_HEADING = "no_heading"
    TURNS = "turns"
    TURNS_OR_BIAS = "turns_or_bias"
    LIKE_MEMS = "like_mems"
    LEVEL_ALONE = "level_alone"
    NOTHING_STANDS = "nothing_stands"
    NOTHING_MEASURED = "nothing_measured"
    MOVES = "moves"
    NOISIER = "noisier_than_model"
    WRONG_LATITUDE = "wrong_latitude"
    LATITUDE_IN_RADIANS = "latitude_in_radians"
    LATITUDE_IS_LONGITUDE = "latitude_is_longitude"
    EXCESS_RESIDUALS = "excess_residuals"
    NO_TABLE = "no_table"
    SPEED_AT_REST = "speed_at_rest"
    DEAD_ODOMETER = "dead_odometer"


LATITUDE_REASONS = (
    AlignmentReason.WRONG_LATITUDE,
    AlignmentReason.LATITUDE_IN_RADIANS,
    AlignmentReason.LATITUDE_IS_LONGITUDE,
)
