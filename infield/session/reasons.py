"""Why a session or an update is judged so: codes with the templates of their sentences."""

from enum import StrEnum

from ins.verdicts import ReasonCode

# the tail of what a session looks like
HOW_CLEAR = ": {sigmas:abs .1f} sigma, 99.9 % of sound sessions lie within {limit_sigmas:.1f}"


class ThermalKind(ReasonCode):
    """How heating may differ from cooling."""

    RATE = "rate", "{value:+.4f} +- {sigma:.4f} deg/h per degC/min"
    SENSE = "sense", "{value:+.4f} +- {sigma:.4f} deg/h between heating and cooling"


class ThermalAction(ReasonCode):
    """What was done about a difference between heating and cooling."""

    RATE_TERM_FITTED = (
        "rate term fitted",
        "gyro {axis}: rate term fitted: {kind} ({sigmas:.1f} sigma); the table holds the bias at a"
        " steady temperature",
    )
    SIGMA_WIDENED = (
        "sigma widened",
        "gyro {axis}: sigma widened: {kind} ({sigmas:.1f} sigma); its points count less",
    )
    NONE_FOUND = "none found", "gyro {axis}: no difference found, {kind} ({sigmas:.1f} sigma)"
    NOT_TESTED = "not tested", "gyro {axis}: not tested, its temperature hardly moved"
    # of sessions that contradict the table: the term does not bring them into agreement
    DOES_NOT_EXPLAIN = (
        "does not explain the data",
        "gyro {axis}: {kind} looks like it, but does not bring the sessions into agreement: not"
        " used",
    )
    # too few sessions tell the two apart: nothing is done about it
    SPLIT_OR_WRONG_SESSION = (
        "a split, or a wrong session",
        "gyro {axis}: heating and cooling differ, {kind}, or a session is wrong:",
        "more sessions are needed to decide",
    )
    # of an update that has no other session: nothing is done about it either
    SEEN_IN_ONE_SESSION = (
        "seen in one session",
        "gyro {axis}: {kind} ({sigmas:.1f} sigma) in one session: not used unless another one shows"
        " it",
    )


class HeadingSource(StrEnum):
    """What found the heading error (formats.md, section 5)."""

    TURNS = "turns"
    STOPS = "stops"
    GNSS = "gnss"
    ODOMETER = "odometer"
    SURVEY = "survey"
    COMBINED = "combined"


class Nuisance(ReasonCode):
    """What wind, tyres and installation may do while the vehicle rolls."""

    # in every taxi
    CRAB = (
        "crab",
        "crab {value[0]:-mrad +.3g} +- {sigma[0]:mrad .2g} mrad (prior sigma {prior[0]:mrad g}"
        " mrad)",
    )
    WHEEL_ARM_X = (
        "wheel_arm_x",
        "the no-slip point lies {value[0]:- +.3g} +- {sigma[0]:.2g} m further along body x than"
        " declared (prior sigma {prior[0]:g} m)",
    )
    WHEEL_SCALE = (
        "wheel_scale",
        "the wheels read {value[0]:% +.3g} +- {sigma[0]:% .2g} % too much (prior sigma"
        " {prior[0]:% g} %)",
    )
    # where the data ask for it
    CROSS_WIND = (
        "cross_wind",
        "a steady cross wind pushed the rolling vehicle towards {towards_rad:deg .0f} deg: up to"
        " {size_rad:mrad +.3g} +- {sigma_rad:mrad .2g} mrad off its body x; estimated (prior sigma"
        " {prior[0]:mrad g} mrad, north and east)",
    )
    TURNING_CRAB = (
        "turning_crab",
        "the crab changed from leg to leg, by about {value[0]:mrad .2g} mrad RMS: estimated anew"
        " after each turn",
    )
    GUSTS = (
        "gusts",
        "the crab wandered along the legs by about {value[0]:mrad .2g} mrad RMS, as in gusts:"
        " modelled as noise of that size",
    )
    SIDE_SLIP = (
        "side_slip",
        "side slip in turns of {value[0]:mrad +.3g} +- {sigma[0]:mrad .2g} mrad per m/s^2 of"
        " lateral acceleration; estimated (prior sigma {prior[0]:mrad g})",
    )
    WHEEL_ARM_Y = (
        "wheel_arm_y",
        "the wheels of the odometer lie {value[0]:- +.3g} +- {sigma[0]:.2g} m further along body y"
        " than declared; estimated (prior sigma {prior[0]:g} m)",
    )
    ODOMETER_DELAY = (
        "odometer_delay",
        "the wheels' speeds are {value[0]:ms +.3g} +- {sigma[0]:ms .2g} ms older than their stamps;"
        " estimated (prior sigma {prior[0]:ms g} ms)",
    )
    ANTENNA = (
        "antenna",
        "the antenna lies {value[0]:+.3g} +- {sigma[0]:.2g} m along body x and {value[1]:+.3g} +-"
        " {sigma[1]:.2g} m along body y from where it is declared; estimated (prior sigma"
        " {prior[0]:g} m)",
    )
    GNSS_DELAY = (
        "gnss_delay",
        "the receiver's positions are {value[0]:ms +.3g} +- {sigma[0]:ms .2g} ms and its velocities"
        " {value[1]:ms +.3g} +- {sigma[1]:ms .2g} ms older than their stamps; estimated (prior"
        " sigma {prior[0]:ms g} ms)",
    )
    GNSS_SLOW_POSITION = (
        "gnss_slow_position",
        "the receiver's positions wandered by about {value[0]:.2g} m RMS over minutes: modelled as"
        " a correlated error of that size",
    )
    GNSS_SLOW_VELOCITY = (
        "gnss_slow_velocity",
        "the receiver's velocities wandered by about {value[0]:.2g} m/s RMS over a minute: modelled"
        " as a correlated error of that size",
    )


class VarianceSource(ReasonCode):
    """Where the variance of an updated table comes from."""

    # what was known before
    STORED_TABLE = "stored_table", "the table before, as far as the runs did not renew it"
    # since the table was made, and of temperatures that it does not hold
    AGEING = "ageing", "ageing since the table was made, and temperatures it did not hold"
    # why a session departs from the mean over power-ons
    TURN_ON = "turn_on", "turn-on: this power-on against the mean of all"
    BIAS_INSTABILITY = "bias_instability", "bias instability during the runs"
    RATE_RANDOM_WALK = "rate_random_walk", "rate random walk during the runs"
    MISALIGNMENT = "misalignment", "misalignment of the gyros, through Earth rate"
    THERMOMETER = "thermometer", "errors of the thermometers"
    DOUBTED_FACT = "doubted_fact", "facts in doubt, and a latitude that several runs share"
    HEATING_AND_COOLING = "heating_and_cooling", "heating against cooling"
    # what a bin without a temperature, or shorter than its model, adds
    BINS = "bins", "times without a temperature"
    # how well a session measures its own biases
    ANGLE_RANDOM_WALK = "angle_random_walk", "white noise of the gyros (angle random walk)"
    ACCELEROMETERS = "accelerometers", "noise and biases of the accelerometers"
    STANDING = "standing_vehicle", "sway and creep of the standing vehicle"
    ROLLING = "rolling_vehicle", "the taxi: side motion, crab, wheels, satellite fixes"
    EARTH_RATE = "earth_rate", "Earth rate on a heading that is not known"
    LATITUDE = "latitude", "the latitude, by which Earth rate is taken out"
    MEASURED = "other_measured", "other noise of the measurement"


class NewUnitReason(ReasonCode):
    """What an update of a unit without a table rests on."""

    FROM_NOTHING = (
        "from_nothing",
        "begun from nothing, as no table of the unit was given or stored: bias 0 +-"
        " {sigma_deg_h:.3g} deg/h, the raw bias of {technology} gyros",
    )
    VERTICAL_BY_LATITUDE = (
        "vertical_by_latitude",
        "without a table the vertical gyro rests on the latitude of {run_id}, {latitude_deg:.3f} +-"
        " {sigma_deg:.2g} deg ({source}): an error of 0.01 deg there is a bias error of"
        " {deg_h_a_hundredth:.4f} deg/h, and this log cannot separate the two",
    )


class NoiseReason(ReasonCode):
    """What the noise model, and with it every sigma, rests on."""

    DEFAULTS = (
        "noise_defaults",
        "no noise model of {imu_serial} was given: every sigma rests on the defaults of"
        " {technology}",
        "{command} measures it, then --twin twin.json",
    )


class SessionReason(ReasonCode):
    """What was measured and what was needed."""

    OF_RUN = "of_run", "{run_id}: {reason}"
    ALREADY_MERGED = "already_merged", "the table already holds this run (same content hash)"
    STARTS_IN_FUTURE = (
        "starts_in_future",
        "start_utc {start_utc} is in the future, the clock says {now_utc}: in a table of that date"
        " every later session would count as older than the table",
    )
    OTHER_TEMPERATURES = (
        "other_temperatures",
        "the temperatures end at {until_s:.0f} s, the imu data at {end_s:.0f} s: are they of"
        " another session?",
    )
    NEVER_RESTS = (
        "never_rests",
        "the run never rests for a minute",
        "a parked alignment and 30 min in navigation are needed",
    )
    LEVEL_REMOVED = (
        "level_removed",
        "the rates come with a constant subtracted (the autopilot's gyro offsets of that start-up),"
        " so the level of the bias is lost",
        'convert the log again with --map FILE of the lines format = "dataflash" and gyro_offsets ='
        ' "add_back"',
    )
    TEMPERATURE_UNCOVERED = (
        "temperature_uncovered",
        "gyro temperature is known for {known_percent:.0f} % of the session, needed"
        " {needed_percent:.0f} %",
    )
    FILTER_LOST = "filter_lost", "the filter cannot follow this log: {fault}"
    REST_MOVES = (
        "rest_moves",
        "the sensors look at rest for {rest_s:.0f} s, but over no filter step there is the"
        " navigated velocity zero, needed {needed_s:g} s: a smooth cruise, or a unit much noisier"
        " than its noise model ({source}).",
        "A log that begins in flight needs satellite fixes; any other must begin parked, for 5 to"
        " 15 min",
    )
    SHORT_REST = (
        "short_rest",
        "{rest_s:.0f} s at rest, needed {needed_s:.0f} s; {dropped_s:.0f} s were dropped for motion"
        " (listed as excluded)",
    )
    EXCESS_RESIDUALS = (
        "excess_residuals",
        "{excess}; the twin's noise is too small or an effect is not modelled",
    )
    RATES_CHANGE = (
        "rates_change",
        "{excess}; the rates change along the session by more than table and twin allow: a table"
        " that does not fit, a wrong thermometer, or a noise model that is too small",
    )
    COMPENSATED_BEFORE = (
        "compensated_before",
        "the rates would agree with the table had it been subtracted already (NIS"
        " {nis_compensated:.0f} instead of {nis:.0f}): was this log compensated?",
        "Then run.json needs applied_table_sha256",
    )
    BEYOND_GATE = (
        "beyond_gate",
        "{share_percent:.0f} % of the measurements lie beyond the gate, needed below"
        " {needed_percent:.0f} %",
    )
    KIND_BEYOND_GATE = (
        "kind_beyond_gate",
        "{kind}: {share_percent:.0f} % of its measurements lie beyond the gate, needed below"
        " {needed_percent:.0f} %; no wind, lever arm, delay or scale factor explains them",
    )
    NO_GAIN = (
        "no_gain",
        "no gyro bias became better known: the best keeps {kept_percent:.0f} % of its prior sigma,"
        " needed below 90 %",
    )
    AGAINST_TABLE = "against_table", "the session contradicts the table before it: {found}"
    MERGE_RESIDUALS = (
        "merge_residuals",
        "NIS {nis:.1f} for {dof} degrees of freedom, 99.9 % lie below {limit:.1f}",
    )
    AXIS_SHIFTED = (
        "axis_shifted",
        "gyro {axis} shifted by {shift_sigmas:+.1f} sigma, 99.9 % of sessions lie within"
        " {limit_sigmas:.1f}",
    )
    LEVEL_OFF = (
        "level_off",
        "its shape over temperature agrees, its level does not: power-ons of this unit may differ"
        " by more than the turn-on of its noise model says (--twin)",
    )
    TABLE_DISAGREES = (
        "table_disagrees",
        "table disagrees with unit since about {since_utc:.10}: gyro {axis} by {shift_deg_h:+.4f}"
        " +- {sigma_deg_h:.4f} deg/h; {count} sessions agree ({run_ids:, |})",
        "if the site is entered right and the unit is this one, recal update with these runs and"
        " --accept-step follows it",
    )
    NO_STEP = (
        "no_step",
        "no step to accept: at least two sessions must agree with each other against the table",
    )
    NOT_COMMITTED = "not_committed", "not committed: {fault}"
    LIKE_A_WRONG_FACT = "like_a_wrong_fact", "{fact}"
    FORCE_OFF_GRAVITY = (
        "force_off_gravity",
        "the specific force at rest is {excess_ug:+.0f} micro-g ({share_percent:+.3f} %) off"
        " gravity at this site, needed within {limit_ug:.0f}: a wrong time base, scale, or height",
    )
    UNLIKE_THE_UNIT = (
        "unlike_the_unit",
        "accelerometers and thermometers do not match {sessions} earlier"
        " {sessions:session|sessions} of this unit: chi2 {chi2:.1f} for {dof} degrees of freedom,"
        " 99.5 % lie below {limit:.1f}; the largest difference is {mark}, {off:+.3g} +-"
        " {sigma:.2g} {unit}.",
        "Another unit under the same serial, or a repaired one (check_unit = false)?",
    )


class FlightReason(ReasonCode):
    """Why a flight is left out of the session that it began with."""

    UNCOVERED = (
        "flight_uncovered",
        "fixes cover {covered_percent:.0f} % of the flight, needed {needed_percent:.0f} %",
    )
    FILTER_LOST = "flight_filter_lost", "the filter cannot follow this flight: {fault}"
    EXCESS_RESIDUALS = (
        "flight_excess_residuals",
        "{kind}: {excess}; the receiver is worse than declared, or its fixes are wrong",
    )
    BEYOND_GATE = (
        "flight_beyond_gate",
        "{kind}: {share_percent:.0f} % of the fixes lie beyond the gate, needed below"
        " {needed_percent:.0f} %",
    )
    BEYOND_PRIOR = (
        "flight_beyond_prior",
        "{state}: {value:+.3g} {unit}, prior sigma {prior:.3g}: {sigmas:abs .1f} sigma, 99.9 % of"
        " sound flights lie within {limit_sigmas:.1f}",
    )
    UNLIKE_AT_REST = (
        "flight_unlike_at_rest",
        "gyro {axis} reads {size_deg_h:+.4f} +- {sigma_deg_h:.4f} deg/h more in flight than at"
        " rest: {sigmas:.1f} sigma of the prior, 99.9 % of sound flights lie within"
        " {limit_sigmas:.1f}; vibration, pressure, or wrong fixes",
    )
    NOT_NAVIGATED = "flight_not_navigated", "no solution with the receiver: {why}"
    NEVER_LINEAR = (
        "flight_never_linear",
        "the heading was never known within {limit_deg:.0f} deg for a minute under way, which the"
        " linearised filter needs",
        "turns and changes of speed make it observable",
    )
    HEADING_UNSEEN = (
        "flight_heading_unseen",
        "the log begins in motion, and its first {sought_s:min .0f} min give the heading with a"
        " sigma of {sigma_rad:mrad .1f} mrad, needed {limit_rad:mrad .0f}:",
        "turns and changes of speed make it observable, or a longer log",
    )
    # not against it: the prior of the gyros in flight against at rest was given up for their size
    SHIFT_WIDENED = (
        "flight_shift_widened",
        "gyro {axis} reads {size_deg_h:+.4f} +- {sigma_deg_h:.4f} deg/h more in flight than at"
        " rest, {sigmas:.1f} sigma of the prior ({prior_deg_h:.4f} deg/h): the flight was"
        " estimated again with a prior of that size; the result is the mean of both estimates, the"
        " second with its probability of {belief_percent:.0f} %",
    )
    # likewise: the deflection of the vertical that the flight was estimated under
    DEFLECTED = (
        "flight_deflected",
        "a deflection of the vertical of {arcsec:.0f} arcsec over {km:.0f} km is estimated (usual:"
        " {assumed_arcsec:.0f} over {assumed_km:.0f}): terrain, or slow velocity errors of the"
        " receiver",
    )


class WrongFact(ReasonCode):
    """What a session takes for granted and may be wrong."""

    LATITUDE = (
        "latitude",
        "it looks as if the entered latitude were off by {size:+.3f} +- {sigma:.3f} deg"
        + HOW_CLEAR,
    )
    # on one heading the two leave the same
    LATITUDE_OR_AXES = (
        "latitude_or_axes",
        "it looks as if the entered latitude were off by {size:+.3f} +- {sigma:.3f} deg, or the"
        " gyros were turned by as much about {axis} against the accelerometers" + HOW_CLEAR,
    )
    TIME_BASE = (
        "time_base",
        "it looks as if the clock of the log ran fast by {size:+.2%} +- {sigma:.2%}" + HOW_CLEAR,
    )
    GYRO_SCALE = (
        "gyro_scale",
        "it looks as if the scale of gyro {axis} were off by {size:+.2%} +- {sigma:.2%}"
        + HOW_CLEAR,
    )
    GYRO_AXES = (
        "gyro_axes",
        "it looks as if the gyros were turned by {size:+.2f} +- {sigma:.2f} mrad about {axis}"
        " against the accelerometers" + HOW_CLEAR,
    )
    GYRO_STEP = (
        "gyro_step",
        "it looks as if gyro {axis} had stepped by {size:+.4f} +- {sigma:.4f} deg/h at about"
        " {at_s:.0f} s" + HOW_CLEAR,
    )
    # a trait of the unit: what it does to a table that holds none
    THERMAL_LAG = (
        "thermal_lag",
        "it looks as if the bias of gyro {axis} followed its temperature late: {size:+.4f} +-"
        " {sigma:.4f} deg/h per degC with 10 min of lag" + HOW_CLEAR,
    )
    # of a log that says which table it had subtracted
    COMPENSATION = (
        "compensation",
        "applied_table_sha256: the rates still contain {size:.2f} +- {sigma:.2f} times that table"
        " (0: it was subtracted, as run.json says; 1: the log is raw, and run.json needs null)",
    )
    # of one that says it is raw
    COMPENSATED_BEFORE = (
        "compensated_before",
        "applied_table_sha256: the rates lack {size:.2f} +- {sigma:.2f} times the stored table (0:"
        " the log is raw, as run.json says; 1: it was subtracted before, and run.json needs its"
        " hash)",
    )


class ParkedReason(ReasonCode):
    """Why a parked unit is not navigated, or a rest is left out."""

    NO_HEADING = (
        "no_heading",
        "gyro uncertainty {sigma_deg_h:.3g} deg/h against {level_deg_h:.3g} deg/h of level Earth"
        " rate: no heading at rest, and no gyro bias by gyrocompass; zero-rate biases against"
        " temperature are taken instead",
    )
    NO_REST = "no_rest", "no rest: {start_s:.0f} to {end_s:.0f} s: {why}"
    REST_TOO_SHORT = "rest_too_short", "a rest of {rest_s:.0f} s, needed {needed_s:.0f} s"
    LONGEST_REST = (
        "longest_rest",
        "longest rest found: {found:span}; needed {needed_s:.0f} s, and 10 min or more of warm-up"
        " to show a slope",
    )
    NAMED_TOO_SHORT = (
        "named_too_short",
        "named as parked, too short: {named_s:.0f} s, needed {needed_s:.0f} s of rest",
    )
    NAMED_NOT_AT_REST = (
        "named_not_at_rest",
        "named as parked, but the sensors do not rest: {named_s:.0f} s, needed {needed_s:.0f} s of"
        " rest",
    )
    GNSS_MOVES = (
        "gnss_moves",
        "GNSS says up to {fastest_m_s:.1f} m/s for {moving_s:.0f} s while the sensors rest: a"
        " steady roll, a circle or a hover taken for rest",
    )
    GNSS_DRIFTS = (
        "gnss_drifts",
        "GNSS says {mean_m_s:.2f} m/s on the mean while the sensors rest, needed {allowed_m_s:.2f}"
        " at most",
    )
    NOT_STILL = (
        "not_still",
        "less than {needed_s:.0f} s still between {start_s:.0f} and {end_s:.0f} s, the rest is"
        " motion",
    )
    TOO_NOISY = (
        "too_noisy",
        "the gyros scatter {scale:.0f} times as much as their noise model ({source}) from second to"
        " second, needed {limit:.0f} at most: vibration, or the noise model of another unit",
    )


class OwnErrorState(ReasonCode):
    """What became of an error that an installed package declares with a prior of a session."""

    ESTIMATED = (
        "estimated",
        "{error} on {target}: {value:+.3g} +- {sigma:.2g} {unit} ({coefficient}; prior sigma"
        " {prior_sigma:g})",
    )
    IN_TWIN = (
        "in_twin",
        "{error} on {target} was not estimated ({coefficient}): the twin lists it",
    )
    NOT_CONSTANT = (
        "not_constant",
        "{error} on {target} was not estimated ({coefficient}): it is not one constant times a"
        " known signal (it has shape parameters, adds noise, or its prior is a process)",
    )
    NO_TRACE = (
        "no_trace",
        "{error} on {target} was not estimated ({coefficient}): from the streams of this run its"
        " signal on gyros and accelerometers cannot be computed",
    )
    NO_HEADING = (
        "no_heading",
        "{error} on {target} was not estimated ({coefficient}): the session finds no heading, and"
        " its filter carries no such state",
    )


class Advice(ReasonCode):
    """What would make a gyro better known."""

    TURN_AND_STOP = (
        "turn_and_stop",
        "turn by 90 to 180 deg and stop for 60 s or more on the new heading before the run ends, or"
        " log GNSS or an odometer in the taxi, or give a surveyed heading",
    )
    PARK_LONGER = (
        "park_longer",
        "park longer: the vertical gyro is observable only while the airframe does not turn",
    )
    HOLD_HEADING = (
        "hold_heading",
        "allow the parked-attitude constraint, or park on a second heading for 20 min",
    )
    FLY_TURNS = (
        "fly_turns",
        "turn by 90 deg or more early in the flight and again an hour later: each turn makes the"
        " heading observable, and its drift in between is the vertical gyro",
    )
    PARK_FROM_COLD = (
        "park_from_cold",
        "park longer, from a cold start: the noise still exceeds what this session could add to"
        " the table",
    )
    MEND_THERMOMETER = (
        "mend_thermometer",
        "the thermometer of gyro {axis} {fault}: its bias has no temperature",
    )


class ChainNote(ReasonCode):
    """Where the claim chain's heading error comes from, or why there is none."""

    FOUND = "found", "cross-track velocity after a turn, both velocities at stops"
    NO_TAXI = "no_taxi", "no taxi: the east axis stays relative"
    BLIND = (
        "blind",
        "the taxi never left the alignment heading: its cross-track velocity does not show the"
        " heading error",
    )
