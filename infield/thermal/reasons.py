"""Why chamber runs gave a model or none, and what a reader must know of it: codes with the
templates of their sentences.
"""

from enum import StrEnum

from ins.verdicts import ReasonCode


class ThermalVerdict(StrEnum):
    """INCONSISTENT: the runs carry a fit, and something else moves the bias."""

    FITTED = "fitted"
    REFUSED = "refused"
    INCONSISTENT = "inconsistent"


class ThermalReason(ReasonCode):
    """Why nothing was fitted, or what contradicts the model."""

    MOVING_BASE = (
        "moving_base",
        "moving base: {run} {run_id} turns by {turned_rad:deg .2g} deg, needed rest within"
        " {needed_rad:deg .2g} deg: Earth rate would pass for a thermal bias",
    )
    RESIDUAL_SCATTERS = (
        "residual_scatters",
        "gyro {axis}: the residual scatters {times:.1f} times as much as white noise and the"
        " twin's drift say, needed at most {needed:g}: something else than {moves} moves this bias",
    )
    NO_RAMP = (
        "no_steady_ramp",
        "cannot separate: {role} run {run_id} holds no steady ramp: its temperature spans"
        " {span_degC:.1f} degC, needed one way over 10 degC or more at a rate steady within 30 %,"
        " 10 min or longer",
    )
    EQUAL_RATES = (
        "equal_rates",
        "cannot separate: equal rates: fast {fast_degC_min:.4g}, slow {slow_degC_min:.4g}"
        " degC/min, needed a slow rate of at most {needed_share:g} of the fast one (ten times"
        " lower is usual)",
        "or give the fast run alone, without --slow",
    )
    SAME_SIGN = (
        "same_sign_ramps",
        "cannot separate: same-sign ramps: every ramp {heats:heats|cools}, needed one up and one"
        " down over the same temperatures{each_run: in one run, since each run has its own share"
        " of Earth rate|}",
        "{two_rates:with --one-sided two rates of one sign are taken, and the level of K_delta"
        " then rests on the turn-on bias of the runs|run the ramp back as well}",
    )
    LITTLE_OVERLAP = (
        "little_overlap",
        "cannot separate: {pair:the ramps up and down|fast and slow ramps} share"
        " {overlap_degC:.1f} degC, needed {needed_degC:g}:",
        "run both over one range",
    )
    RUN_TOO_SHORT = (
        "run_too_short",
        "too short: run {run_id} has {minutes} min of rest, needed {needed_min}",
    )
    RUNS_TOO_SHORT = (
        "runs_too_short",
        "too short: {minutes} min of rest in all runs, needed {needed_min}",
    )
    NARROW = (
        "temperature_span_too_small",
        "temperature spans {span_degC:.1f} degC in all runs, needed {needed_degC:g}",
    )
    ONE_SIDED = (
        "one_sided_heating",
        "one-sided heating: the unit only {warms:warms|cools}, and {share:% .0f} % of dT/dt is"
        " no function of temperature, needed {needed:% .0f} %: K4 cannot be separated"
        " from K2 and K3",
        "warm and cool it over the same {both_ways_degC:g} degC, or dwell on the way",
    )


class LatePart(ReasonCode):
    """Which thermometers read late; one or both."""

    GYRO = "gyro", "its thermometer reads {lag_s:.0f} +- {sigma_s:.0f} s late"
    LINES = "lines", "the gradient lines read {lag_s:.0f} +- {sigma_s:.0f} s late"


class ThermalNote(ReasonCode):
    """What holds beside any verdict."""

    REMOUNTED = (
        "mounted_anew",
        "the unit stands on another level in some runs: taken as mounted anew",
    )
    SURVEYED_IN_PART = (
        "surveyed_in_part",
        "some runs have a surveyed heading, some not: each has its own share of Earth rate",
    )
    NO_THERMOMETER = "no_thermometer", "gyro {axis}: no thermometer, left out"
    SIGMAS_WIDENED = (
        "sigmas_widened",
        "gyro {axis}: the residual scatters {times:.2f} times as much as white noise and the"
        " twin's drift say: the sigmas allow for it",
    )
    DROPPED = "term_dropped", "gyro {axis}: {why}"
    COLLINEAR = (
        "term_collinear",
        "{term} is collinear with {others: and |} (condition number {condition:.0f}, limit"
        " {limit:.0f}): dropped; the model holds only while heat flows as in these runs, and the"
        " sigmas of the others include the dropped term",
    )
    OF_NOISE = (
        "term_of_noise",
        "{term} is nearly collinear with {others: and |} ({noise_share:.0%} of its independent"
        " part is noise of the thermometers, limit {limit:.0%}): dropped; the model holds only"
        " while heat flows as in these runs, and the sigmas of the others include the dropped term",
    )
    NO_LINES = (
        "no_gradient_column",
        "no gradient column moves in any run: fitted without gradient terms, which then hide in"
        " the rate terms",
    )
    LINE_IDLE = (
        "gradient_column_idle",
        "line gradient_{axis}: does not move or is not logged in every run: left out",
    )
    HYSTERESIS = (
        "hysteresis",
        "gyro {axis}: warming and cooling differ by {split_deg_h:+.4f} +- {sigma_deg_h:.4f} deg/h"
        " at any rate (hysteresis): a term of the fit, not of the model in use, whose sigma has it",
    )
    HYSTERESIS_UNTOLD = (
        "hysteresis_untold",
        "ramps at one rate cannot separate hysteresis from K_delta: the sigma of K_delta includes"
        " {allowed_deg_h:.4f} deg/h for it",
        "a slow ramp up and down separates them",
    )
    LATE_THERMOMETER = (
        "late_thermometer",
        "gyro {axis}: {late: and |} (chi2 less by {gain_chi2:.0f}): taken into account in the"
        " terms and in use",
    )
    HELD_OUT_WORSE = (
        "held_out_residual_above_noise",
        "gyro {axis}: the held-out residual is {times:.2f} times its noise, needed {needed:g}:"
        " a term is missing, or the runs are too few to separate the terms",
    )
    TAKEN_OUT = (
        "model_taken_out",
        "{run_id}: rate and gradient terms of {model} {before:had left the log|left the log}"
        " before the table: {rms_deg_h:, |.4f} deg/h RMS, known to {worst_deg_h:.4f};"
        " {share_inside:.0%} inside the fitted temperatures",
    )
    EFFECT_TAKEN_OUT = (
        "effect_taken_out",
        "run {run_id}: {effect} on {target}, as the twin lists it, was taken out of the log:"
        " {rms_deg_h:.4f} deg/h RMS, known to {sigma_deg_h:.4f} deg/h",
    )


class BiasDriver(StrEnum):
    """What a model takes to move the bias."""

    RATE = "temperature and its rate"
    GRADIENTS = "temperature, its rate and gradients"
