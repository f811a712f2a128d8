"""Why a replay is what it is, and what a reader must know of it: codes with the templates of
their sentences.
"""

from enum import StrEnum

from ins.verdicts import ReasonCode


class ReplayVerdict(StrEnum):
    """REFUSED: nothing could be flown. INCONSISTENT: the active table's alignment is, or the aided
    flight where that is all there is.
    """

    REPLAYED = "replayed"
    REFUSED = "refused"
    INCONSISTENT = "inconsistent"


class ReplayReason(ReasonCode):
    """Why nothing was flown, or what contradicts the log."""

    NEVER_RESTS = (
        "never_rests",
        "the log never rests for a minute",
        "a parked alignment of 5 to 15 min is needed",
    )
    LOG_ENDS = (
        "log_ends_after_alignment",
        "the log ends {left_s:.0f} s after its alignment, {needed_s:.0f} s of navigation are"
        " needed",
    )
    BY_AIDED = "aided_by_gnss", "aided by GNSS: {reason}"


class ReplayNote(ReasonCode):
    """What holds beside any verdict."""

    LOG_FAULT = "log_fault", "{start_s:g} to {end_s:g} s: {fault}"
    NO_TEMPERATURE = (
        "no_gyro_temperature",
        "no gyro temperature in the run: no table can be applied, flown with the raw gyro output",
    )
    TEMPERATURE_TOO_SHORT = (
        "gyro_temperature_too_short",
        "{shortage}: no table can be applied, flown with the raw gyro output",
    )
    THERMOMETER_FAULT = "thermometer_fault", "{fault}"
    MEAN_STANDS_IN = (
        "mean_stands_in_for_thermometer",
        "gyro {axis}: no thermometer of its own, the others' mean stands in",
    )
    NO_FREE_INERTIAL = "no_free_inertial_flight", "no free-inertial flight: {reason}"
    EXTRAPOLATED = (
        "drift_extrapolated",
        "parked for {parked_s:min .0f} min of navigation: NM/h is extrapolated",
    )
    BEYOND_NODES = (
        "beyond_the_tables_nodes",
        "gyro {axis}: {low_degC:.1f} to {high_degC:.1f} degC, beyond the table's nodes: end value"
        " held",
    )


class SchulerReason(ReasonCode):
    """Why no Schuler period was fitted."""

    PARKED_TOO_SHORT = (
        "parked_too_short",
        "parked for {parked_s:min .0f} min of navigation, needed {needed_s:min .0f} min (three"
        " quarters of a period)",
    )
    NO_SWING = (
        "no_swing",
        "no Schuler oscillation: the fitted period runs to a limit, 30 or 240 min",
    )
    SMALL_SWING = (
        "swing_too_small",
        "the Schuler oscillation of {amplitude_m_s:.2g} m/s is too small to time: residuals of"
        " {left_m_s:.2g} m/s",
    )
    UNSURE = (
        "period_too_unsure",
        "period uncertain by {sigma_s:min .0f} min, needed {needed_s:min .0f} min:",
        "a longer record is needed",
    )


class Damping(ReasonCode):
    """What the height is damped to."""

    SITE = "site_height", "damped to the height of the site (no GNSS height in the run)"
    GNSS = "gnss_height", "damped to the GNSS height"
