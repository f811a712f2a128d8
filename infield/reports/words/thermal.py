"""Sentences of `infield.thermal`: why runs were not fitted, what a fitted model leaves open."""

from collections.abc import Mapping, Sequence
from enum import StrEnum

import numpy as np

from infield.reports.words.sentences import Template
from infield.thermal.reasons import ThermalNote, ThermalReason

DROPPED = (
    "dropped, and right only while heat flows as in these runs; what it may be is in the sigmas of"
    " the others"
)


def _moving_base(*, run_id: str, turned_rad: float, needed_rad: float, role: str = "") -> str:
    return (
        f"moving base: {role + ' ' if role else ''}run {run_id} turns by"
        f" {np.degrees(turned_rad):.2g} deg, needed rest within {np.degrees(needed_rad):.2g} deg:"
        " Earth rate would pass for a thermal bias"
    )


def _same_sign(*, heats: bool, each_run: bool, two_rates: bool) -> str:
    way = "heats" if heats else "cools"
    where = " in one run, since each run has its own share of Earth rate" if each_run else ""
    if two_rates:
        help_ = (
            "; with --one-sided two rates of one sign are taken, and the level of K_delta then"
            " rests on the turn-on bias of the runs"
        )
    else:
        help_ = "; run the ramp back as well"
    return (
        f"cannot separate: same-sign ramps: every ramp {way}, needed one up and one down over the"
        f" same temperatures{where}{help_}"
    )


def _little_overlap(*, pair: bool, overlap_degC: float, needed_degC: float) -> str:
    which = "the ramps up and down" if pair else "fast and slow ramps"
    return (
        f"cannot separate: {which} share {overlap_degC:.1f} degC, needed {needed_degC:g}: run both"
        " over one range"
    )


def _one_sided(*, warms: bool, share: float, needed: float, both_ways_degC: float) -> str:
    way = "warms" if warms else "cools"
    return (
        f"one-sided heating: the unit only {way}, and {100 * share:.0f} % of dT/dt is left beyond a"
        f" curve of temperature, needed {100 * needed:.0f} %: K4 cannot be told from K2 and K3;"
        f" warm and cool it over the same {both_ways_degC:g} degC, or dwell on the way"
    )


def _along(others: Sequence[str]) -> str:
    return " and ".join(others) or "the rest"


def _collinear(*, term: str, others: Sequence[str], condition: float, limit: float) -> str:
    return (
        f"{term} goes with {_along(others)} (condition number {condition:.0f}, limit {limit:.0f}):"
        f" {DROPPED}"
    )


def _of_noise(*, term: str, others: Sequence[str], noise_share: float, limit: float) -> str:
    return (
        f"{term} goes with {_along(others)} ({noise_share:.0%} of what it has of its own is noise"
        f" of the thermometers, limit {limit:.0%}): {DROPPED}"
    )


def _late(
    *,
    axis: str,
    gyro_s: float,
    lines_s: float,
    sigma_gyro_s: float,
    sigma_lines_s: float,
    gain_chi2: float,
) -> str:
    """By how much thermometers read late."""
    late = [
        f"{what} {lag_s:.0f} +- {sigma_s:.0f} s late"
        for what, lag_s, sigma_s in (
            ("its thermometer reads", gyro_s, sigma_gyro_s),
            ("the gradient lines read", lines_s, sigma_lines_s),
        )
        if lag_s > 0.0
    ]
    return (
        f"gyro {axis}: {' and '.join(late)} (chi2 less by {gain_chi2:.0f}): taken into account in"
        " the terms and in use"
    )


def _taken_out(
    *,
    run_id: str,
    model: str,
    before: bool,
    rms_deg_h: Mapping[str, float],
    worst_deg_h: float,
    share_inside: float,
) -> str:
    size = ", ".join(f"{axis} {value:.4f}" for axis, value in rms_deg_h.items())
    when = "had left the log" if before else "left the log"
    return (
        f"{run_id}: rate and gradient terms of {model} {when} before the table: {size} deg/h RMS,"
        f" known to {worst_deg_h:.4f}; {share_inside:.0%} inside the fitted temperatures"
    )


SENTENCES: Mapping[StrEnum, Template] = {
    ThermalReason.MOVING_BASE: _moving_base,
    ThermalReason.RESIDUAL_SCATTERS: (
        "gyro {axis}: the residual scatters {times:.1f} times as much as white noise and the twin's"
        " drift say, needed at most {needed:g}: something else than {moves} moves this bias"
    ),
    ThermalReason.NO_RAMP: (
        "cannot separate: {role} run {run_id} holds no steady ramp: its temperature spans"
        " {span_degC:.1f} degC, needed one way over 10 degC or more at a rate steady within 30 %,"
        " 10 min or longer"
    ),
    ThermalReason.EQUAL_RATES: (
        "cannot separate: equal rates: fast {fast_degC_min:.4g}, slow {slow_degC_min:.4g} degC/min,"
        " needed a slow rate of at most {needed_share:g} of the fast one (ten times lower is"
        " usual); or give the fast run alone, without --slow"
    ),
    ThermalReason.SAME_SIGN: _same_sign,
    ThermalReason.LITTLE_OVERLAP: _little_overlap,
    ThermalReason.RUN_TOO_SHORT: (
        "too short: run {run_id} has {minutes} min of rest, needed {needed_min}"
    ),
    ThermalReason.RUNS_TOO_SHORT: (
        "too short: {minutes} min of rest in all runs, needed {needed_min}"
    ),
    ThermalReason.NARROW: (
        "temperature spans {span_degC:.1f} degC in all runs, needed {needed_degC:g}"
    ),
    ThermalReason.ONE_SIDED: _one_sided,
    ThermalNote.REMOUNTED: "the unit stands on another level in some runs: taken as mounted anew",
    ThermalNote.SURVEYED_IN_PART: (
        "some runs have a surveyed heading, some not: each has its own share of Earth rate"
    ),
    ThermalNote.NO_THERMOMETER: "gyro {axis}: no thermometer, left out",
    ThermalNote.SIGMAS_WIDENED: (
        "gyro {axis}: the residual scatters {times:.2f} times as much as white noise and the twin's"
        " drift say: the sigmas allow for it"
    ),
    ThermalNote.DROPPED: "gyro {axis}: {why}",
    ThermalNote.COLLINEAR: _collinear,
    ThermalNote.OF_NOISE: _of_noise,
    ThermalNote.NO_LINES: (
        "no gradient column moves in any run: fitted without gradient terms, which then hide in the"
        " rate terms"
    ),
    ThermalNote.LINE_IDLE: (
        "line gradient_{axis}: does not move or is not logged in every run: left out"
    ),
    ThermalNote.HELD_OUT_WORSE: (
        "gyro {axis}: the held-out residual is {times:.2f} times its noise, needed {needed:g}:"
        " something is missing, or too few runs hold the terms apart"
    ),
    ThermalNote.HYSTERESIS: (
        "gyro {axis}: warming and cooling differ by {split_deg_h:+.4f} +- {sigma_deg_h:.4f} deg/h"
        " at any rate (hysteresis): a term of the fit, not of the model in use, whose sigma has it"
    ),
    ThermalNote.HYSTERESIS_UNTOLD: (
        "ramps at one rate do not tell hysteresis from K_delta: the sigma of K_delta allows for"
        " {allowed_deg_h:.4f} deg/h; a slow ramp up and down would tell"
    ),
    ThermalNote.LATE_THERMOMETER: _late,
    ThermalNote.TAKEN_OUT: _taken_out,
    ThermalNote.EFFECT_TAKEN_OUT: (
        "run {run_id}: {effect} on {target}, as the twin lists it, was taken out of the log:"
        " {rms_deg_h:.4f} deg/h RMS, known to {sigma_deg_h:.4f} deg/h"
    ),
}
