"""Why a session or an update is judged so, as codes; sentences: `infield.reports.words.session`."""

from enum import StrEnum


class ThermalKind(StrEnum):
    """How heating may differ from cooling."""

    RATE = "rate"
    SENSE = "sense"


class ThermalAction(StrEnum):
    """What was done about a difference between heating and cooling."""

    RATE_TERM_FITTED = "rate term fitted"
    SIGMA_WIDENED = "sigma widened"
    NONE_FOUND = "none found"
    NOT_TESTED = "not tested"
    # of sessions that contradict the table: the term does not bring them into agreement
    DOES_NOT_EXPLAIN = "does not explain the data"
    # too few sessions tell the two apart: nothing is done about it
    SPLIT_OR_WRONG_SESSION = "a split, or a wrong session"
    # of an update that has no other session: nothing is done about it either
    SEEN_IN_ONE_SESSION = "seen in one session"


class HeadingSource(StrEnum):
    """What found the heading error (formats.md, section 5)."""

    TURNS = "turns"
    STOPS = "stops"
    GNSS = "gnss"
    ODOMETER = "odometer"
    SURVEY = "survey"
    COMBINED = "combined"


class Nuisance(StrEnum):
    """What wind, tyres and installation may do while the vehicle rolls."""

    # in every taxi
    CRAB = "crab"
    WHEEL_ARM_X = "wheel_arm_x"
    WHEEL_SCALE = "wheel_scale"
    # where the data ask for it
    CROSS_WIND = "cross_wind"
    TURNING_CRAB = "turning_crab"
    GUSTS = "gusts"
    SIDE_SLIP = "side_slip"
    WHEEL_ARM_Y = "wheel_arm_y"
    ODOMETER_DELAY = "odometer_delay"
    ANTENNA = "antenna"
    GNSS_DELAY = "gnss_delay"
    GNSS_SLOW_POSITION = "gnss_slow_position"
    GNSS_SLOW_VELOCITY = "gnss_slow_velocity"


class VarianceSource(StrEnum):
    """Where the variance of an updated table comes from."""

    # what was known before
    STORED_TABLE = "stored_table"
    AGEING = "ageing"  # since the table was made, and of temperatures that it does not hold
    # why a session departs from the mean over power-ons
    TURN_ON = "turn_on"
    BIAS_INSTABILITY = "bias_instability"
    RATE_RANDOM_WALK = "rate_random_walk"
    MISALIGNMENT = "misalignment"
    THERMOMETER = "thermometer"
    DOUBTED_FACT = "doubted_fact"
    HEATING_AND_COOLING = "heating_and_cooling"
    BINS = "bins"  # what a bin without a temperature, or shorter than its model, adds
    # how well a session measures its own biases
    ANGLE_RANDOM_WALK = "angle_random_walk"
    ACCELEROMETERS = "accelerometers"
    STANDING = "standing_vehicle"
    ROLLING = "rolling_vehicle"
    EARTH_RATE = "earth_rate"
    LATITUDE = "latitude"
    MEASURED = "other_measured"


class NewUnitReason(StrEnum):
    """What an update of a unit without a table rests on."""

    FROM_NOTHING = "from_nothing"
    VERTICAL_BY_LATITUDE = "vertical_by_latitude"


class NoiseReason(StrEnum):
    """What the noise model, and with it every sigma, rests on."""

    DEFAULTS = "noise_defaults"


class SessionReason(StrEnum):
    """What was measured and what was needed."""

    OF_RUN = "of_run"
    ALREADY_MERGED = "already_merged"
    STARTS_IN_FUTURE = "starts_in_future"
    OTHER_TEMPERATURES = "other_temperatures"
    NEVER_RESTS = "never_rests"
    LEVEL_REMOVED = "level_removed"
    TEMPERATURE_UNCOVERED = "temperature_uncovered"
    FILTER_LOST = "filter_lost"
    REST_MOVES = "rest_moves"
    SHORT_REST = "short_rest"
    EXCESS_RESIDUALS = "excess_residuals"
    RATES_CHANGE = "rates_change"
    COMPENSATED_BEFORE = "compensated_before"
    BEYOND_GATE = "beyond_gate"
    KIND_BEYOND_GATE = "kind_beyond_gate"
    NO_GAIN = "no_gain"
    AGAINST_TABLE = "against_table"
    MERGE_RESIDUALS = "merge_residuals"
    AXIS_SHIFTED = "axis_shifted"
    LEVEL_OFF = "level_off"
    TABLE_DISAGREES = "table_disagrees"
    NO_STEP = "no_step"
    NOT_COMMITTED = "not_committed"
    LIKE_A_WRONG_FACT = "like_a_wrong_fact"
    FORCE_OFF_GRAVITY = "force_off_gravity"
    UNLIKE_THE_UNIT = "unlike_the_unit"


class FlightReason(StrEnum):
    """Why a flight is left out of the session that it began with."""

    UNCOVERED = "flight_uncovered"
    FILTER_LOST = "flight_filter_lost"
    EXCESS_RESIDUALS = "flight_excess_residuals"
    BEYOND_GATE = "flight_beyond_gate"
    BEYOND_PRIOR = "flight_beyond_prior"
    UNLIKE_AT_REST = "flight_unlike_at_rest"
    NOT_NAVIGATED = "flight_not_navigated"
    NEVER_LINEAR = "flight_never_linear"
    HEADING_UNSEEN = "flight_heading_unseen"
    # not against it: the prior of the gyros in flight against at rest was given up for their size
    SHIFT_WIDENED = "flight_shift_widened"
    # likewise: the deflection of the vertical that the flight was estimated under
    DEFLECTED = "flight_deflected"


class WrongFact(StrEnum):
    """What a session takes for granted and may be wrong."""

    LATITUDE = "latitude"
    TIME_BASE = "time_base"
    GYRO_SCALE = "gyro_scale"
    GYRO_AXES = "gyro_axes"
    GYRO_STEP = "gyro_step"
    # a trait of the unit: what it does to a table that holds none
    THERMAL_LAG = "thermal_lag"
    # of a log that says which table it had subtracted
    COMPENSATION = "compensation"
    # of one that says it is raw
    COMPENSATED_BEFORE = "compensated_before"


class ParkedReason(StrEnum):
    """Why a parked unit is not navigated, or a rest is left out."""

    NO_HEADING = "no_heading"
    NO_REST = "no_rest"
    REST_TOO_SHORT = "rest_too_short"
    LONGEST_REST = "longest_rest"
    NAMED_TOO_SHORT = "named_too_short"
    NAMED_NOT_AT_REST = "named_not_at_rest"
    GNSS_MOVES = "gnss_moves"
    GNSS_DRIFTS = "gnss_drifts"
    NOT_STILL = "not_still"
    TOO_NOISY = "too_noisy"


class Advice(StrEnum):
    """What would make a gyro better known."""

    TURN_AND_STOP = "turn_and_stop"
    PARK_LONGER = "park_longer"
    HOLD_HEADING = "hold_heading"
    FLY_TURNS = "fly_turns"
    PARK_FROM_COLD = "park_from_cold"
    MEND_THERMOMETER = "mend_thermometer"


class ChainNote(StrEnum):
    """Where the claim chain's heading error comes from, or why there is none."""

    FOUND = "found"
    NO_TAXI = "no_taxi"
    BLIND = "blind"
