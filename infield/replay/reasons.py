"""Why a replay is what it is, and what a reader must know of it, as codes.

Sentences: `infield.reports.words.replay`.
"""

from enum import StrEnum


class ReplayVerdict(StrEnum):
    """REFUSED: nothing could be flown. INCONSISTENT: the active table's alignment is, or the aided
    flight where that is all there is.
    """

    REPLAYED = "replayed"
    REFUSED = "refused"
    INCONSISTENT = "inconsistent"


class ReplayReason(StrEnum):
    """Why nothing was flown, or what contradicts the log."""

    NEVER_RESTS = "never_rests"
    LOG_ENDS = "log_ends_after_alignment"
    BY_AIDED = "aided_by_gnss"


class ReplayNote(StrEnum):
    """What holds beside any verdict."""

    LOG_FAULT = "log_fault"
    NO_TEMPERATURE = "no_gyro_temperature"
    TEMPERATURE_TOO_SHORT = "gyro_temperature_too_short"
    THERMOMETER_FAULT = "thermometer_fault"
    MEAN_STANDS_IN = "mean_stands_in_for_thermometer"
    NO_FREE_INERTIAL = "no_free_inertial_flight"
    EXTRAPOLATED = "drift_extrapolated"
    BEYOND_NODES = "beyond_the_tables_nodes"


class SchulerReason(StrEnum):
    """Why no Schuler period was fitted."""

    PARKED_TOO_SHORT = "parked_too_short"
    NO_SWING = "no_swing"
    SMALL_SWING = "swing_too_small"
    UNSURE = "period_too_unsure"


class Damping(StrEnum):
    """What the height is damped to."""

    SITE = "site_height"
    GNSS = "gnss_height"
