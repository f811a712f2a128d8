"""Why chamber runs gave a model or none, and what a reader must know of it, as codes.

Sentences: `infield.reports.words.thermal`.
"""

from enum import StrEnum


class ThermalVerdict(StrEnum):
    """INCONSISTENT: the runs carry a fit, and something else moves the bias."""

    FITTED = "fitted"
    REFUSED = "refused"
    INCONSISTENT = "inconsistent"


class ThermalReason(StrEnum):
    """Why nothing was fitted, or what contradicts the model."""

    MOVING_BASE = "moving_base"
    RESIDUAL_SCATTERS = "residual_scatters"
    NO_RAMP = "no_steady_ramp"
    EQUAL_RATES = "equal_rates"
    SAME_SIGN = "same_sign_ramps"
    LITTLE_OVERLAP = "little_overlap"
    RUN_TOO_SHORT = "run_too_short"
    RUNS_TOO_SHORT = "runs_too_short"
    NARROW = "temperature_span_too_small"
    ONE_SIDED = "one_sided_heating"


class ThermalNote(StrEnum):
    """What holds beside any verdict."""

    REMOUNTED = "mounted_anew"
    SURVEYED_IN_PART = "surveyed_in_part"
    NO_THERMOMETER = "no_thermometer"
    SIGMAS_WIDENED = "sigmas_widened"
    DROPPED = "term_dropped"
    COLLINEAR = "term_collinear"
    OF_NOISE = "term_of_noise"
    NO_LINES = "no_gradient_column"
    LINE_IDLE = "gradient_column_idle"
    HYSTERESIS = "hysteresis"
    HYSTERESIS_UNTOLD = "hysteresis_untold"
    LATE_THERMOMETER = "late_thermometer"
    HELD_OUT_WORSE = "held_out_residual_above_noise"
    TAKEN_OUT = "model_taken_out"
    EFFECT_TAKEN_OUT = "effect_taken_out"


class Moves(StrEnum):
    """What a model takes to move the bias."""

    RATE = "temperature and its rate"
    GRADIENTS = "temperature, its rate and gradients"
