"""Ways of units without a heading, joined to their rests: the filter about an aided solution, the
session's estimate, the gates, and that nothing changes without a receiver.
"""

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from scipy.stats import chi2

from infield.aided.flight import warmed_accel_walk
from infield.session.flown import without_heading
from infield.session.flown.gates import DOUBTED_SIGMAS
from infield.session.flown.priors import Further
from infield.session.flown.ways import estimated_ways
from infield.session.reasons import FlightReason
from ins.filters.aided_records import AidedNoise
from ins.records import FixType, GnssLog
from tests.infield import mems_away
from tests.infield.aided_cases import gauss_markov
from tests.infield.mems_away import MISALIGNMENT_MRAD, SCALE_PPM, SETTINGS, bin_errors, simulated
from tests.infield.test_aided_grade import moved

# two-sided: 1 in 1000 of right sigmas, over as many degrees of freedom as there are
CHANCE = 5e-4


def never(*anything, **more):
    raise AssertionError("navigated all the same")


@lru_cache(maxsize=4)
def taken(seed):
    return mems_away.taken(simulated(seed).run)


def test_a_way_is_joined_and_what_it_showed_is_within_its_sigmas():
    result = taken(0)
    flight, estimate = result.flight, result.estimate
    assert result.verdict.accepted and flight.joined is not None and not flight.reasons
    away = estimate.parked.stretch < 0
    assert away.sum() >= 5 and np.isnan(estimate.parked.rate_deg_h[away]).all()
    error = bin_errors(simulated(0), estimate).ravel()
    nees = error @ np.linalg.solve(estimate.covariance, error)
    low, high = chi2.ppf([CHANCE, 1.0 - CHANCE], error.size)
    assert low < nees < high
    assert (np.diff(estimate.bins.start_s) > 0).all()


def test_scale_and_misalignment_are_found_within_their_sigmas():
    carried = {c.state: c for c in taken(0).flight.carried}
    scale, turned = carried[Further.GYRO_SCALE], carried[Further.MISALIGNMENT]
    off = (scale.value - 1e-6 * np.array(SCALE_PPM)) / scale.sigma
    assert np.abs(off).max() < 4.0 and scale.sigma.min() < 0.5 * scale.prior.min()
    off = (turned.value - 1e-3 * np.array(MISALIGNMENT_MRAD)) / turned.sigma
    assert np.abs(off).max() < 4.0 and turned.sigma.min() < 0.5 * turned.prior.min()


def unasked(seed):
    """The same session with the receiver left aside."""
    settings = replace(SETTINGS, use_gnss=False)
    run = simulated(seed).run
    return mems_away.take_run(run, mems_away.blank(), mems_away.TWIN, settings, False)


def sigmas(estimate):
    """Of the first bin, parked, gyros x, y, z [deg/h]."""
    return np.sqrt(np.diag(estimate.covariance)[:3])


def test_a_way_shows_gyros_that_an_unknown_heading_hides():
    """At rest Earth rate on an unknown heading hides the level gyros by 7.5 deg/h; under way the
    heading is known.
    """
    alone, joined = sigmas(unasked(0).estimate), sigmas(taken(0).estimate)
    assert (alone[:2] > 7.0).all() and (joined[:2] < 0.8 * alone[:2]).all()
    worth = taken(0).flight.worth
    assert all(gyro.after_deg_h <= gyro.ground_alone_deg_h for gyro in worth)
    assert all(gyro.ground_alone_deg_h < gyro.before_deg_h for gyro in worth)


def test_without_a_receiver_there_is_no_way():
    assert unasked(0).flight is None
    silent = mems_away.taken(replace(simulated(0).run, gnss=None))
    assert silent.flight is None
    assert (unasked(0).estimate.parked.stretch >= 0).all()


# white and slow errors of level positions, fixed and float solutions, as a receiver tells them [m]
FIXED_M, FLOAT_M = (0.014, 0.056), (0.1, 0.4)


def rtk(seed):
    """A session whose receiver changes between fixed and float solutions every 10 to 30 s, and says
    of each fix what its white noise is.
    """
    quiet = replace(
        mems_away.TWIN.gnss, sigma_horizontal_m=FIXED_M[0], sigma_vertical_m=1.5 * FIXED_M[0]
    )
    errors = replace(mems_away.SLOW, slow_position_m=0.0)
    made = simulated(seed, errors=errors, gnss=quiet)
    gnss, rng = made.run.gnss, np.random.default_rng([seed, 83])
    floats = np.searchsorted(np.cumsum(rng.uniform(10.0, 30.0, 200)), gnss.time_s) % 2 == 1
    slow = [gauss_markov(gnss.time_s, rng, sigma, 200.0) for sigma in (FIXED_M[1], FLOAT_M[1])]
    off = np.where(floats[:, None], slow[1], slow[0])
    off += np.where(floats[:, None], FLOAT_M[0], 0.0) * rng.standard_normal(off.shape)
    level = np.where(floats, FLOAT_M[0], FIXED_M[0])
    told = replace(
        moved(gnss, off * [1.0, 1.0, 1.5]),
        sigma_horizontal_m=level,
        sigma_vertical_m=1.5 * level,
        fix_type=np.where(floats, FixType.FLOAT, FixType.FIXED).astype(float),
    )
    return replace(made, run=replace(made.run, gnss=told))


def test_the_filter_of_the_bins_has_the_noise_that_a_log_was_flown_with():
    """Both slow errors as they are; as large as assumed where there are none. Of the walk of the
    accelerometers' biases, 100 micro-g a degC and the warming: the slopes are states.
    """
    known = mems_away.known(simulated(0).run)
    warmed = warmed_accel_walk(known.run)
    flown = AidedNoise(
        arw=1e-4,
        vrw=2e-3,
        gyro_walk=3e-6,
        accel_walk=float(np.hypot(5e-5, warmed)),
        slow_level_m=FIXED_M[1],
        slow_other_level_m=FLOAT_M[1],
        slow_velocity_m_s=0.003,
    )
    noise = without_heading._noise(known, flown)
    assert noise.accel_walk == pytest.approx(5e-5) and warmed > 0.0
    assert replace(noise, accel_walk=flown.accel_walk) == flown
    none = replace(flown, slow_level_m=0.0, slow_velocity_m_s=0.0)
    noise, priors = without_heading._noise(known, none), SETTINGS.flight
    assert noise.slow_level_m == priors.slow_position_m
    assert noise.slow_velocity_m_s == priors.slow_velocity_m_s


@pytest.mark.slow
def test_ways_with_fixes_of_two_types_are_within_their_sigmas(monkeypatch):
    """Three sessions: joined, the bins within their sigmas, the slow error of the float solutions
    found to a factor of 2, that of the fixed ones not beyond twice its size. Factors on each type's
    own sigma, applied to the twin's 0.5 m, made 1.5 m of the one and nothing of the other.
    """
    seen = []

    def see(way, believed):
        seen.append(believed.noise)
        return estimated_ways(way, believed)

    monkeypatch.setattr(without_heading, "estimated_ways", see)
    nees, count = 0.0, 0
    for seed in range(3):
        made = rtk(seed)
        result = mems_away.taken(made.run)
        assert result.flight.joined is not None, result.flight.reasons
        error = bin_errors(made, result.estimate).ravel()
        nees += error @ np.linalg.solve(result.estimate.covariance, error)
        count += error.size
        fixed, floats = sorted([seen[-1].slow_level_m, seen[-1].slow_other_level_m])
        assert 0.0 < fixed < 2.0 * FIXED_M[1]
        assert 0.5 * FLOAT_M[1] < floats < 2.0 * FLOAT_M[1]
    low, high = chi2.ppf([CHANCE, 1.0 - CHANCE], count)
    assert low < nees < high


def led_astray(log: GnssLog) -> GnssLog:
    """Velocities that turn away from the course, a degree in ten seconds, from 200 s on."""
    angle = np.radians(0.1 * np.maximum(log.time_s - 200.0, 0.0))
    c, s = np.cos(angle), np.sin(angle)
    north, east, down = log.v_n_m_s.T
    turned = np.stack([c * north - s * east, s * north + c * east, down], axis=1)
    return replace(log, v_n_m_s=turned)


def test_a_gyro_that_reads_more_in_flight_is_told():
    """200 deg/h beyond what it reads at rest: no shift of 3 deg/h explains it."""
    errors = replace(mems_away.SLOW, gyro_shift_deg_h=(0.0, 200.0, 0.0))
    result = mems_away.taken(simulated(0, errors=errors).run)
    assert result.flight.joined is None
    codes = {reason.code for reason in result.flight.reasons}
    assert codes & {
        FlightReason.UNLIKE_AT_REST,
        FlightReason.EXCESS_RESIDUALS,
        FlightReason.BEYOND_PRIOR,
    }


@pytest.mark.slow
def test_a_gyro_that_hardly_reads_as_at_rest_widens_the_prior_of_it():
    """75 deg/h in the air: joined, with the size that shows for its prior, a third of it, as the
    way holds a roll of 100 s without it; sound flights are taken as before.
    """
    errors = replace(mems_away.SLOW, gyro_shift_deg_h=(0.0, 75.0, 0.0))
    evidence = mems_away.taken(simulated(0, errors=errors).run).flight
    (note,) = evidence.notes
    assert note.code is FlightReason.SHIFT_WIDENED and note.values["axis"] == "y"
    assert note.values["size_deg_h"] > DOUBTED_SIGMAS * note.values["sigma_deg_h"]
    assert evidence.joined is not None and evidence.as_usual is not None
    wider, usual = (np.diag(e.covariance)[1::3].sum() for e in (evidence.joined, evidence.as_usual))
    assert wider > usual
    assert not taken(0).flight.notes


@pytest.mark.slow
def test_noise_of_a_straight_flight_shows_no_scale_factor():
    """40 min straight ahead: the scale of the roll gyro was 1 % off at 20 sigmas, the flight left
    out; nothing but noise was rolled.
    """
    evidence = mems_away.taken(simulated(800, way=mems_away.STRAIGHT).run).flight
    assert evidence is not None and evidence.joined is not None, evidence.reasons
    (scale,) = (c for c in evidence.carried if c.state is Further.GYRO_SCALE)
    assert abs(scale.value[0]) < 0.1 * scale.prior[0] and scale.sigma[0] > 0.98 * scale.prior[0]


def test_few_fixes_leave_the_way_out_before_it_is_navigated(monkeypatch):
    made = simulated(0)
    log = made.run.gnss
    kept = (log.time_s < 200.0) | (log.time_s % 10.0 < 1.0)
    columns = {name: value[kept] for name, value in vars(log).items() if value is not None}
    monkeypatch.setattr(without_heading, "navigate_aided", never)
    result = mems_away.taken(replace(made.run, gnss=replace(log, **columns)))
    assert result.flight.joined is None
    assert [reason.code for reason in result.flight.reasons] == [FlightReason.UNCOVERED]
