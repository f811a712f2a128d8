"""Why a study of azimuths is what it is, and what it cannot show, as codes.

Sentences: `infield.reports.words.misalignment`.
"""

from enum import StrEnum


class MisalignmentVerdict(StrEnum):
    """INCONSISTENT: fitted, and the azimuths contradict each other."""

    MEASURED = "measured"
    REFUSED = "refused"
    INCONSISTENT = "inconsistent"


class MisalignmentReason(StrEnum):
    """Why nothing was fitted, or what contradicts the model."""

    AZIMUTHS_MISSING = "azimuths_missing"
    STOP_OFF_ITS_PLACE = "stop_off_its_place"
    NOTHING_GAINED = "nothing_gained"
    AZIMUTHS_CONTRADICT = "azimuths_contradict"
    NO_STOP = "no_stop"
    AZIMUTHS_NOT_FOUND = "azimuths_cannot_be_found"
    HEADINGS_MISCOUNTED = "headings_miscounted"
    HEADING_CONTRADICTED = "heading_contradicted"


class StopReason(StrEnum):
    """Why a stretch of a run is no stop."""

    LEFT_OUT = "stretch_left_out"
    NO_STRETCH = "no_stretch_between_turns"
    NEVER_RESTS = "never_rests"
    MOVES = "moves"
    CREEPS = "creeps"
    TOO_SHORT = "rest_too_short"


class MisalignmentNote(StrEnum):
    """What holds beside any verdict."""

    NO_TEMPERATURE = "run_without_temperature"
    TEMPERATURES_APART = "temperatures_apart"
    HEADINGS_TURNED = "given_headings_share_an_error"
    HEADINGS_SCATTER = "given_headings_scatter"


class Azimuths(StrEnum):
    """Where the azimuths come from."""

    FOUND = "found_with_the_gyros"
    GIVEN = "given"
    OF_TABLE = "of_the_table"


class Unseen(StrEnum):
    """Why something is not observable."""

    VERTICAL = "vertical_coupling_is_a_bias"
    NORTH = "north_is_free"
    DIAGONAL = "needs_diagonal_headings"
    WEAK = "sigma_near_the_prior"
    MOUNTING = "mounting_unknown"
    NO_ACCELEROMETERS = "table_without_accelerometers"
    NOT_FITTED = "nothing_fitted"
    OFFSET_OR_TILT = "offset_not_told_from_tilt"
    GROUND_DIFFERS = "ground_differs"
