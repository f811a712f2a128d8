"""Why an aided solution is what it is, and what it took from the log: codes with the
templates of their sentences.
"""

from enum import StrEnum

from ins.verdicts import ReasonCode


class AidedVerdict(StrEnum):
    """REFUSED: nothing was flown. INCONSISTENT: flown, and not to be believed."""

    AIDED = "aided"
    INCONSISTENT = "inconsistent"
    REFUSED = "refused"


class AidedGrade(StrEnum):
    """How good a solution is; DEGRADED: in stretches that are named."""

    GOOD = "good"
    DEGRADED = "degraded"
    INCONSISTENT = "inconsistent"


class AidedWeakness(ReasonCode):
    """Why a stretch of a solution is degraded."""

    START = "wide_start", "the position is not yet known"
    HEADING = "heading_wide", "the heading is known to no better than 5 deg"
    OUTAGE = "outage", "no fixes: dead reckoning"
    REJECTED = "fixes_rejected", "fixes rejected one after the other"
    LEAP = "positions_leap", "the positions jumped while the velocities agreed"
    BEGUN_ANEW = "begun_anew", "fixes were rejected so long that a new solution began"
    RECEIVER = "receiver_unsure", "the receiver itself gives wide sigmas to its positions"


class StartMethod(StrEnum):
    """How an aided solution was begun: parked, in motion, or from headings all round; ALL_HEADINGS:
    none of them is known to be the vehicle's.
    """

    GYROCOMPASS = "gyrocompass"
    MATCHING = "velocity matching"
    HEADINGS = "several headings"
    SURVEYED = "surveyed heading"
    ALL_HEADINGS = "all headings"


class WheelsFound(ReasonCode):
    """What a log says of its vehicle; all but ROLLS: why wheels are not taken."""

    ROLLS = "rolls", "it rolls"
    BANKS = "banks", "the vehicle banks as it turns"
    SLIPS = "slips", "its velocity is not along one axis of the unit"
    TOO_SHORT = "too_short", "it rolls for less than a minute with a heading that is known"
    TOO_STRAIGHT = "too_straight", "it turns by less than 90 deg"
    CONTRADICTED = "contradicted", "its wheel constraints contradict the fixes"


class Widened(ReasonCode):
    """Whose sigmas are widened where positions and velocities contradict each other."""

    POSITION = "position", "positions"
    VELOCITY = "velocity", "velocities"
    BOTH = "both", "positions and velocities"


class NoiseFactor(ReasonCode):
    """What a factor on the declared noise is of."""

    WHITE = "white", "white noise of the gyros"
    WALK = "walk", "walks of the gyros' biases"
    ACCEL_WHITE = "accel_white", "white noise of the accelerometers"
    ACCEL_WALK = "accel_walk", "walks of the accelerometers' biases"
    POSITION = "position", "satellite position"
    VELOCITY = "velocity", "satellite velocity"


class AidedPart(ReasonCode):
    """Parts of a note, of which there may be several or none."""

    OLDER = "older", "{what} are {lag_s:ms .0f} +- {sigma_s:ms .0f} ms {late:older|younger}"
    TIMES = "times", "{factor} {times:factor} times"
    NOISE_AS_DECLARED = "noise_as_declared", "noise as declared"
    NOISE_LARGER = "noise_larger", "adopted {sizes:, |} as large"
    STIRRED = (
        "stirred",
        "vibration rectification of the accelerometers, {stirred:factor} m/s^2 for each m/s^2 of"
        " vibration",
    )
    SLOW = (
        "slow",
        "a slow error of the positions of {level_m:.2g} m level, {down_m:.2g} m down over"
        " {time_s:.0f} s",
    )
    SLOW_OTHER = (
        "slow_other",
        "a slow error of {level_m:.2g} m level, {down_m:.2g} m down of the {fixes} of {of} fixes"
        " of another type",
    )
    SLOW_VELOCITY = (
        "slow_velocity",
        "a slow error of the velocities of {sigma_m_s:.2g} m/s over {time_s:.2g} s",
    )


class AidedReason(ReasonCode):
    """Why nothing was flown, or what speaks against the solution."""

    NO_FIXES = "no_fixes", "no satellite fixes in the run"
    FEW_FIXES = "few_fixes", "{count} satellite fixes within the imu log, needed {needed}"
    NO_VELOCITY_CHANGE = (
        "no_velocity_change",
        "the satellite velocity never changes by {needed_m_s:g} m/s within {longest_s:g} s:"
        " heading cannot be found (a constant velocity does not show it)",
    )
    HEADING_UNSURE = (
        "heading_unsure",
        "heading from the satellite velocities is at best good to {best_rad:deg .2g} deg, needed"
        " {limit_rad:deg g} deg within {longest_s:g} s of log: too little manoeuvring",
    )
    HEADINGS_DIFFER = (
        "headings_differ",
        "two headings explain the first {longest_s:g} s of fixes, or longer and shorter stretches"
        " give different headings: the vehicle manoeuvres too little, or its fixes are not of this"
        " log",
    )
    NIS_HIGH = "nis_high", "satellite {kind}: {excess}"
    MANY_REJECTED = (
        "many_rejected",
        "{rejected} of {seen} satellite {kind:plural} rejected, needed at most {most:.0%}",
    )
    NOISE_UNBELIEVED = (
        "noise_unbelieved",
        "{factor} would have to be {value:factor} times as large, needed less than {most:g}"
        " ({technology}): axes, signs, scale factor or units of the sensors?",
    )
    CLOCKS_APART = (
        "clocks_apart",
        "the clocks of sensors and fixes differ: the course turns as the gyros do (correlation"
        " {agree:.2f}) if the times of the fixes are {later_s:+.1f} s later, not at their own"
        " ({own:.2f}); shift one stream",
    )
    RECEIVER_CONTRADICTS = (
        "receiver_contradicts",
        "velocities of {count} of {seen} fixes differ from the rate of their positions"
        " ({components}, up to {sigmas:.1f} sigmas), and the log does not show which is right",
    )


class AidedNote(ReasonCode):
    """What was taken from the log beyond what was declared, and what it contradicts."""

    HEADING_OPEN = (
        "heading_open",
        "{reason}. The solution is the mean of solutions from initial headings all round, weighted"
        " by likelihood: its heading is as good as its sigma says",
    )
    WHEELS_TAKEN = (
        "wheels_taken",
        "constrained by its wheels: lateral velocity {side_m_s:.2g} m/s, vertical {up_m_s:.2g} m/s"
        " (RMS); it rolls {mounted.yaw_rad:deg +.1f} +- {mounted.sigma_rad[0]:deg .1g}"
        " deg to the right of body x and {mounted.pitch_rad:deg +.1f} +- {mounted.sigma_rad[1]:deg"
        " .1g} deg above it{odometer:; its odometer's scale is {scale:.4f}|}; {used} seconds used,"
        " {rejected} rejected",
    )
    NO_WHEELS = "no_wheels", "not constrained by wheels: {why}"
    USUAL_MOTION = (
        "usual_motion",
        "without fixes for {without_s:g} s and longer the speed is assumed to be as with them:"
        " sigma {level_m_s:.2g} m/s level and {down_m_s:.2g} m/s vertical, correlated over"
        " {lasts_s:.0f} s",
    )
    REPEATED_FIXES = (
        "repeated_fixes",
        "{count} fixes from {first_s:.1f} to {last_s:.1f} s are left out: their position is that"
        " of the fix before, to the last digit, at {speed_m_s:.1f} m/s (a receiver that is stuck,"
        " or a log that repeats it)",
    )
    FIXES_WIDENED = (
        "fixes_widened",
        "{count} fixes from {first_s:.1f} to {last_s:.1f} s have velocities that differ from the"
        " rate of their positions ({components}, up to {sigmas:.1f} sigmas): the difference"
        " becomes the sigma of their {whose}",
    )
    FIXES_SAY = (
        "fixes_say",
        "sigmas of the fixes (median): positions declared {declared_m:.2g} m,"
        " {position_stands:kept|the innovations say {said_m:.2g} m}; velocities declared"
        " {declared_m_s:.2g} m/s, {velocity_stands:kept|the innovations say {said_m_s:.2g} m/s}",
    )
    SITE_ELSEWHERE = (
        "site_elsewhere",
        "the parked fixes lie {off_m:.0f} m from the site of run.json: the aided solution follows"
        " the fixes",
    )
    OFF_THE_TRACK = (
        "off_the_track",
        "body x points {mean_rad:deg +.0f} deg off the track (median; half of the rows within"
        " {spread_rad:deg .1f} deg): unless that is crab, the unit is mounted at this angle, and"
        " roll, pitch and heading are the unit's, not the vehicle's",
    )
    LEVER_ARM_TAKEN = (
        "lever_arm_taken",
        "the fixes contradict the lever arm ({declared_m[0]:g}, {declared_m[1]:g},"
        " {declared_m[2]:g}) m of run.json: estimated ({lever_arm_m[0]:.2f} +- {sigma_m[0]:.2f},"
        " {lever_arm_m[1]:.2f} +- {sigma_m[1]:.2f}, {lever_arm_m[2]:.2f} +- {sigma_m[2]:.2f}) m,"
        " likelier by {gain_nats:.0f} nats; its sigma is in that of the solution",
    )
    DELAY_TAKEN = (
        "delay_taken",
        "{late:, |} than their time stamps: estimated, likelier by {gain_nats:.0f} nats",
    )
    NOISE_TAKEN = (
        "noise_taken",
        "the innovations {larger:exceed|fall short of} the noise model ({source}): {parts:,"
        " |}{scatters_less: (positions scatter by {scatter:.2g} of what is declared; the rest is"
        " modelled as a slow error)|}{capped: (the largest that is tried)|}; NIS, fitted so, is"
        " no test",
    )
