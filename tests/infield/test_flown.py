"""Flights joined to their sessions: what drives the errors, the estimate, the gates, and that
nothing else changes.
"""

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from scipy.stats import chi2, norm

from infield.session import one_run
from infield.session.flown.fixes import usable
from infield.session.flown.priors import Further
from infield.session.joint_update import find_flight_terms
from infield.session.one_run import take_run
from infield.session.reasons import FlightReason
from ins.earth import displacement_ned
from ins.estimation.sensors import MISALIGNED
from ins.units import DEG_PER_HOUR, MICRO_G, PPM
from tests.cut import cut_run
from tests.infield.flight_errors import FlightErrors
from tests.infield.flown_cases import (
    bin_errors,
    flown,
    ideal_flight,
    layout_of,
    noiseless,
    nominal,
    predicted,
    solution,
)
from tests.infield.sessions import SETTINGS, TWIN, factory

# of an error's size: what steps of a second and the loop that holds the height leave of it
LINEAR_SHARE = 0.02
# The same of the vertical accelerometer: a step of it moves the height for minutes, and a climb
# rate that is wrong turns with the Earth into a level force that no state holds.
HEIGHT_SHARE = 0.15
VERTICAL = (Further.ACCEL_SCALE, Further.ACCEL_SHIFT)
SIZES = {
    Further.ACCEL_Z: 300 * MICRO_G,
    Further.ACCEL_SCALE: 300 * PPM,
    Further.ACCEL_SHIFT: 50 * MICRO_G,
    Further.GYRO_SCALE: 100 * PPM,
    Further.MISALIGNMENT: 1e-4,
    Further.SHIFT: 0.05 * DEG_PER_HOUR,
}


def changed(state, k, size):
    """The noise-free log with one further state in its rows, from where it moves on."""
    case, ideal = noiseless(), ideal_flight()
    log = case.log
    turned, pushed = log.dtheta_rad.copy(), log.dv_m_s.copy()
    moves, air = log.time_s > case.moves_s, 1.0 - ideal.on_wheels
    dt = log.dt_s
    if state is Further.ACCEL_Z:
        pushed[moves, 2] += size * dt[moves]
    elif state is Further.ACCEL_SCALE:
        pushed[moves, k] *= 1.0 + size
    elif state is Further.ACCEL_SHIFT:
        pushed[:, k] += size * dt * air
    elif state is Further.GYRO_SCALE:
        turned[moves, k] *= 1.0 + size
    elif state is Further.SHIFT:
        turned[:, k] += size * dt * air
    else:
        gyro, axis = MISALIGNED[k]
        turned[moves, gyro] += size * log.dtheta_rad[moves, axis]
    return replace(log, dtheta_rad=turned, dv_m_s=pushed)


def departure(log):
    """Velocity and position of a solution less the nominal's at the end, level."""
    before, other = nominal(), solution(log)
    way = displacement_ned(
        other.lat_rad[-1:],
        other.lon_rad[-1:],
        lat0_rad=before.lat_rad[-1:],
        lon0_rad=before.lon_rad[-1:],
        height0_m=before.height_m[-1:],
    )
    return np.append(other.v_n_m_s[-1, :2] - before.v_n_m_s[-1, :2], way)


@pytest.mark.parametrize("state", SIZES, ids=lambda state: state.value)
def test_further_states_drive_the_errors_as_the_sensors_do(state):
    """Linear errors at the end of the flight against the nonlinear solution of changed rows."""
    for k, index in enumerate(layout_of().indices(state)):
        linear = predicted(index, SIZES[state])[0]
        true = departure(changed(state, k, SIZES[state]))
        scale = np.array([np.hypot(*true[:2]), np.hypot(*true[:2]), *[np.hypot(*true[2:])] * 2])
        vertical = state is Further.ACCEL_Z or (k == 2 and state in VERTICAL)
        share = HEIGHT_SHARE if vertical else LINEAR_SHARE
        assert (np.abs(linear - true) < share * scale).all(), k


def taken(run, **changes):
    return take_run(replace(run, **changes), factory(), TWIN, SETTINGS, False)


def same_table(one, other):
    return np.array_equal(one.parameters, other.parameters) and np.array_equal(
        one.covariance, other.covariance
    )


@lru_cache(maxsize=1)
def joined():
    simulated = flown()
    return simulated, taken(simulated.run)


def test_a_flight_is_joined_and_its_biases_are_true_within_their_sigmas():
    """Chi-square of the three means over the session and over the flight, 99.9 %."""
    simulated, result = joined()
    assert result.verdict.accepted and result.flight.joined is result.estimate
    estimate = result.estimate
    bins, error = estimate.bins, bin_errors(simulated, result)
    aloft = (bins.start_s > result.flight.flight.start_s) & (
        bins.end_s < result.flight.flight.end_s
    )
    for weight in (bins.duration_s, bins.duration_s * aloft):
        rows = np.kron(weight / weight.sum(), np.eye(3))
        P = rows @ estimate.covariance @ rows.T
        z = rows @ error
        assert z @ np.linalg.solve(P, z) < chi2.isf(1e-3, 3)


def test_a_flight_shows_heading_and_the_table_of_its_temperatures():
    result = joined()[1]
    evidence = result.flight
    assert evidence.joined.sigma_heading_rad < 0.7 * evidence.heading_before_rad
    worth = evidence.worth
    assert all(gyro.after_deg_h < 0.9 * gyro.ground_alone_deg_h for gyro in worth[:2])
    assert all(gyro.after_deg_h <= gyro.before_deg_h for gyro in worth)


def test_a_flight_left_out_leaves_the_ground_session():
    """Gyros that read 0.05 deg/h more in flight than at rest: told with their size, and the table
    is that of the ground session, to the last bit.
    """
    simulated = flown(errors=FlightErrors(slow_position_m=1.5, gyro_shift_deg_h=(0.1, -0.1, 0.0)))
    result = taken(simulated.run)
    told = {reason.code: reason.values for reason in result.flight.reasons}
    assert FlightReason.UNLIKE_AT_REST in told
    assert abs(told[FlightReason.UNLIKE_AT_REST]["size_deg_h"]) == pytest.approx(0.1, abs=0.05)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(one_run, "fly", never)
        alone = taken(simulated.run)
    assert same_table(result.merged.table, alone.merged.table)


@lru_cache(maxsize=2)
def shaken(seed=1):
    """Gyro y reads 0.02 deg/h less in flight than at rest, what 1 in 7 sound flights resembles."""
    errors = FlightErrors(slow_position_m=1.5, gyro_shift_deg_h=(0.0, -0.02, 0.0))
    return taken(flown(seed, errors=errors).run)


def test_a_gyro_that_hardly_reads_as_at_rest_widens_the_prior_of_it():
    """The size is told, and the flight's own sigmas hold it."""
    evidence = shaken().flight
    (note,) = evidence.notes
    assert note.code is FlightReason.SHIFT_WIDENED and note.values["axis"] == "y"
    assert note.values["size_deg_h"] == pytest.approx(-0.02, abs=3 * note.values["sigma_deg_h"])
    found = {state.state: state for state in evidence.carried}[Further.SHIFT]
    assert (found.prior >= abs(note.values["size_deg_h"]) * DEG_PER_HOUR).all()
    assert not joined()[1].flight.notes
    aloft = shaken().estimate.bins.start_s > evidence.flight.start_s
    spread, usual = (
        np.diag(r.estimate.covariance).reshape(-1, 3)[aloft, 1] for r in (shaken(), joined()[1])
    )
    assert (spread > 1.2 * usual).all()


def test_what_is_in_doubt_is_averaged_by_how_probable_it_is():
    """The belief is by the densities of what three gyros show, worked with scipy.stats from the
    second estimate, which is about another path (within 6 %); the mean moves by that share.
    """
    evidence, estimate = shaken().flight, shaken().estimate
    (note,) = evidence.notes
    (shift,) = (c for c in evidence.carried if c.state is Further.SHIFT)
    value, sigma = (v / DEG_PER_HOUR for v in shift.by_itself())
    size, usual = note.values["size_deg_h"], note.values["prior_deg_h"]
    with_one, without = (norm.pdf(value, 0.0, np.hypot(s, sigma)).prod() for s in (size, usual))
    belief = with_one / (with_one + without)
    assert note.values["belief_percent"] == pytest.approx(100 * belief, abs=6.0)
    assert 0.5 < belief < 1.0
    aloft = estimate.bins.start_s > evidence.flight.start_s
    spread, before = (
        np.diag(e.covariance).reshape(-1, 3)[aloft, 1] for e in (estimate, evidence.as_usual)
    )
    assert (spread > 1.2 * before).all()


def test_the_mean_of_two_estimates_has_the_moments_of_draws_from_either():
    """One of them wider and off by three sigmas, believed to 30 %, under a prior that says nothing:
    mean and covariance of 100,000 draws.
    """
    one = shaken().flight.as_usual
    one = replace(one, bins=replace(one.bins, prior=1e6 * one.bins.prior))
    n, rng = one.mean_deg_h.size, np.random.default_rng(8)
    off = 3.0 * np.sqrt(np.diag(one.covariance)) * rng.choice([-1.0, 1.0], n)
    other = replace(one, mean_deg_h=one.mean_deg_h + off, covariance=2.0 * one.covariance)
    mean = one.averaged(other, 0.3)
    L, which = np.linalg.cholesky(one.covariance), rng.random(100_000) < 0.3
    of_other = which[:, None] * off + np.where(which, np.sqrt(2.0), 1.0)[:, None] * (
        rng.standard_normal((which.size, n)) @ L.T
    )
    np.testing.assert_allclose(
        mean.mean_deg_h - one.mean_deg_h, of_other.mean(axis=0), atol=0.02 * np.abs(off).max()
    )
    drawn, told = np.cov(of_other.T), mean.covariance
    sigma = np.sqrt(np.diag(told))
    np.testing.assert_allclose(
        drawn / np.outer(sigma, sigma), told / np.outer(sigma, sigma), atol=0.03
    )


def test_several_flights_show_what_one_may_hide():
    """Two flights of one unit: of a sound one no term is found, of a shaken one its gyro; the sigma
    is less than that of either flight.
    """
    told = find_flight_terms([shaken(), shaken(2)], factory(), TWIN, SETTINGS)
    assert [term.axis for term in told if term.found] == ["y"]
    assert told[1].value_deg_h == pytest.approx(-0.02, abs=3 * told[1].sigma_deg_h)
    found = {state.state: state for state in shaken(2).flight.carried}[Further.SHIFT]
    assert told[1].sigma_deg_h < found.by_itself()[1][1] / DEG_PER_HOUR
    sound = find_flight_terms([joined()[1], taken(flown(2).run)], factory(), TWIN, SETTINGS)
    assert not any(term.found for term in sound)
    assert find_flight_terms([shaken()], factory(), TWIN, SETTINGS) == ()


@pytest.mark.parametrize("with_gnss", [False, True])
def test_sessions_that_do_not_fly_with_a_receiver_are_untouched(with_gnss, monkeypatch):
    """With the path of flights or not: the same bits. A run with GNSS is cut before it flies."""
    run = flown(with_gnss=with_gnss).run
    if with_gnss:
        run = cut_run(run, 0.0, 980.0)
    result = taken(run)
    assert result.flight is None
    monkeypatch.setattr(one_run, "fly", never)
    alone = taken(run)
    assert same_table(result.merged.table, alone.merged.table)
    assert np.array_equal(result.estimate.covariance, alone.estimate.covariance)


def never(known, ground):
    return None


def test_repeated_fixes_are_left_out():
    """A stuck receiver's fixes, bit for bit the same at speed."""
    gnss = flown().run.gnss
    there = slice(1600, 1700)
    lat, lon = gnss.lat_rad.copy(), gnss.lon_rad.copy()
    lat[there], lon[there] = lat[1600], lon[1600]
    kept, repeated = usable(replace(gnss, lat_rad=lat, lon_rad=lon))
    assert repeated == 99 and kept.time_s.size == gnss.time_s.size - 99
