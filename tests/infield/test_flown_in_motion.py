"""Flights that are logged from the air on: errors over sigma, the rest after landing as evidence of
the same session, and what is refused.
"""

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from scipy.stats import chi2

from infield.aided.smoothing import smooth_flight
from infield.reports.documents.session import session_document
from infield.session.flown import start
from infield.session.one_run import take_run
from infield.session.reasons import FlightReason, SessionReason
from ins.filters.states import AIDED_THETA
from ins.records import FixType
from ins.verdicts import Outcome, sentences
from tests.cut import cut_run
from tests.infield.aided_cases import motion_errors
from tests.infield.flight_errors import FlightErrors
from tests.infield.flown_cases import bin_errors, flown
from tests.infield.sessions import SETTINGS, TWIN, factory

SEEDS = range(1, 4)
FLIES_S, LANDS_S = 1100.0, 2200.0


def in_the_air(run, start_s=FLIES_S, end_s=LANDS_S):
    """A stretch of a run; without the air's thermometer, which a simulated flight leaves warm."""
    cut = cut_run(run, start_s, min(end_s, run.imu.end_s))
    return replace(cut, temperature=replace(cut.temperature, ambient_degC=None))


def taken(run):
    return take_run(run, factory(), TWIN, SETTINGS, False)


@lru_cache(maxsize=len(SEEDS))
def logged(seed):
    """A flight logged in the air alone: what was simulated, and what the update makes of it."""
    simulated = flown(seed)
    return simulated, taken(in_the_air(simulated.run))


@lru_cache(maxsize=1)
def landed():
    """The same flight logged from the air to where it is parked."""
    simulated = flown(1)
    return simulated, taken(in_the_air(simulated.run, end_s=np.inf))


def mean_error(simulated, result):
    """Of the means over the session, gyros x, y, z, and their covariance [deg/h]."""
    bins, P = result.estimate.bins, result.estimate.covariance
    rows = np.kron(bins.duration_s / bins.duration_s.sum(), np.eye(3))
    return rows @ bin_errors(simulated, result), rows @ P @ rows.T


def test_a_log_of_the_air_alone_is_merged_and_says_that_nothing_was_parked():
    _, result = logged(1)
    assert result.verdict.accepted and result.flight.joined is not None
    begun = result.estimate.begun
    assert begun.parked_s == 0.0 and begun.time_s > FLIES_S
    assert begun.sigma_heading_mrad < 1.0
    told = session_document(result)
    assert told.begun_in_motion.parked_s == 0.0 and told.alignment.verdict == "refused"
    assert told.motion_level is None and told.flight.joined
    assert not {"alignment", "extended_alignment"} & set(told.phases_used)
    assert result.merged.table.sigma_deg_h("x", 0.0) < factory().sigma_deg_h("x", 0.0)


def test_errors_of_flights_begun_in_motion_are_as_large_as_their_sigmas():
    """Chi-square of the means of three gyros over three flights, two-sided 99.8 %; receivers and
    sensors are drawn anew, their table's error is one unit's.
    """
    total = 0.0
    for seed in SEEDS:
        error, P = mean_error(*logged(seed))
        total += error @ np.linalg.solve(P, error)
    dof = 3 * len(SEEDS)
    assert chi2.ppf(1e-3, dof) < total < chi2.isf(1e-3, dof)


class Begun(Exception):
    """The start is found; the rest of the update is not asked for."""


def start_found(run, monkeypatch, smoothed=smooth_flight):
    """The smoothed solution that a session in motion begins on."""
    found = []

    def smooth(*arguments):
        found.append(smoothed(*arguments))
        raise Begun

    monkeypatch.setattr(start, "smooth_flight", smooth)
    with pytest.raises(Begun):
        taken(run)
    return found[0]


def test_a_start_assumes_as_much_of_fixes_of_either_type(monkeypatch):
    """Of single and fixed solutions that change every half minute."""
    run = in_the_air(flown(1).run)
    fixed = (run.gnss.time_s // 30.0) % 2 == 1
    types = np.where(fixed, FixType.FIXED, FixType.SINGLE).astype(float)
    run = replace(run, gnss=replace(run.gnss, fix_type=types))

    def given(flights, found, model):
        return flights.given(model).noise

    noise, priors = start_found(run, monkeypatch, given), SETTINGS.flight
    assert noise.slow_level_m == noise.slow_other_level_m == priors.slow_position_m
    assert noise.slow_down_m == noise.slow_other_down_m > priors.slow_position_m


@pytest.mark.slow
def test_starts_over_a_deflected_vertical_are_off_by_what_they_say(monkeypatch):
    """Chi-square of tilt and heading of eight starts over 5 arcsec of deflection, 30 km of
    correlation, two-sided 99.8 %. A filter without it was off by 4 of its sigmas in tilt, and one
    whose last pass begins with a wide prior by 7.
    """
    errors = FlightErrors(slow_position_m=1.5, deflection_arcsec=5.0)
    total, seeds = 0.0, range(21, 29)
    for seed in seeds:
        simulated = flown(seed, errors)
        best = start_found(in_the_air(simulated.run), monkeypatch)
        theta = motion_errors(simulated.reference, best)[0, AIDED_THETA]
        total += theta @ np.linalg.solve(best.covariance[0][AIDED_THETA, AIDED_THETA], theta)
    dof = 3 * len(seeds)
    assert chi2.ppf(1e-3, dof) < total < chi2.isf(1e-3, dof)


def test_a_rest_after_landing_is_evidence_of_the_same_session():
    simulated, result = landed()
    begun = result.estimate.begun
    assert begun.parked_s == pytest.approx(300.0, abs=5.0)
    error, P = mean_error(simulated, result)
    assert error @ np.linalg.solve(P, error) < chi2.isf(1e-3, 3)
    assert "parked" in session_document(result).phases_used
    assert {"still", "stop"} & set(result.estimate.navigated.filter.tally.dof)
    alone = mean_error(*logged(1))[1]
    assert (np.diag(P)[:2] < np.diag(alone)[:2]).all()


def test_a_flight_left_out_leaves_the_rest_after_it():
    """A receiver that is led away by 1 m/s: the session of the rest stands as without a receiver's
    flight.
    """
    run = in_the_air(flown(1).run, end_s=np.inf)
    away = np.maximum(run.gnss.time_s - 1800.0, 0.0)
    v_n = run.gnss.v_n_m_s.copy()
    v_n[:, 0] += away > 0.0
    led = replace(run.gnss, lat_rad=run.gnss.lat_rad + away / 6.4e6, v_n_m_s=v_n)
    result = taken(replace(run, gnss=led))
    assert result.flight.joined is None and result.flight.reasons
    assert result.estimate is None or result.estimate.begun is None


def test_motion_that_shows_no_heading_is_refused_with_what_was_needed():
    """Six minutes of straight, steady cruise; the velocity has to change for a start."""
    result = taken(in_the_air(flown(1).run, 1500.0, 1860.0))
    assert result.verdict.outcome is Outcome.REFUSED and result.merged is None
    assert result.verdict.reasons[-1].code is FlightReason.NOT_NAVIGATED
    assert "velocity never changes by 0.5 m/s" in sentences(result.verdict.reasons)[-1]


def test_a_heading_that_stays_wide_is_refused_with_what_was_needed(monkeypatch):
    monkeypatch.setattr(start, "START_HEADING_RAD", 1e-5)
    result = taken(in_the_air(flown(1).run, end_s=FLIES_S + 600.0))
    assert result.verdict.outcome is Outcome.REFUSED and result.flight.joined is None
    why = result.verdict.reasons[-1]
    assert why.code is FlightReason.HEADING_UNSEEN
    assert why.values["sigma_rad"] > why.values["limit_rad"] == 1e-5


def test_a_smooth_cruise_without_receiver_is_refused():
    """Ten minutes of it, which read like a rest: an error of the filter ended the update once."""
    cruise = cut_run(flown(1).run, 1200.0, 1800.0)
    result = taken(replace(cruise, gnss=None))
    assert result.verdict.outcome is Outcome.REFUSED
    assert [why.code for why in result.verdict.reasons] == [SessionReason.REST_MOVES]
    assert result.verdict.reasons[0].values["needed_s"] == 300.0
