"""What wind, tyres, installation and stamps add to a taxi: rows against central differences of the
nonlinear navigation or of the data, the choice of what the data ask for, and whole sessions against
the truth.
"""

from functools import cache

import numpy as np
import pytest
from scipy.stats import chi2

from alignment.motion.kinds import ROLLING
from alignment.navigation_filter import StepPlan, views_of
from infield.session.navigated import nuisances
from infield.session.navigated.nuisances import AS_DECLARED, CONSTANTS, WANDERING, Assumed
from infield.session.navigated.receiver import ReceiverErrors, SlowError
from infield.session.navigated.taxi_heading import GnssAid, LateralAid
from ins.estimation import error_model as em
from ins.estimation.choice import FreeConstants
from tests.infield.nuisance_cases import (
    ARM_M,
    CASES,
    EXPLAINED,
    WRONG,
    Made,
    as_declared,
    ideal_taxi,
    scored_session,
)
from tests.infield.test_taxi_heading import (
    ANTENNA,
    TURNING_S,
    WHEEL,
    Listener,
    rows,
    solution,
    taxi,
    view,
)

ALL = Assumed(frozenset([*CONSTANTS, *WANDERING]))


class Measurements(Listener):
    """Listens to measurements only."""

    def assign(self, at, index, row, variance):
        pass


class Assigned:
    """Listens to states that wander only."""

    def __init__(self):
        self.seen = []

    def assign(self, at, index, row, variance):
        self.seen.append((index, row, variance))

    def measure(self, name, at, z, rows, variance, *, gate):
        pass


def read_by(aid, history, end_s):
    tape = Measurements()
    aid.measure(tape, view(history, end_s))
    return [(z, H) for _, z, H, _ in tape.seen]


def gnss(log, assumed=ALL, arm=ANTENNA):
    return GnssAid(log, rows(), arm, 0.5, 0.03, assumed)


def test_of_a_receiver_as_declared_no_nuisance_stands_in_the_rows():
    for _, H in read_by(gnss(taxi().run.gnss, AS_DECLARED), solution(), TURNING_S):
        assert not H[:, em.WIND.start : em.BASE].any()


def test_a_receivers_slow_errors_stand_in_its_rows_and_keep_their_level():
    """A fix that reads too much makes the solution's error seem as much smaller."""
    slow = ReceiverErrors(SlowError(1.5, 300.0, 5.0), SlowError(0.01, 60.0, 5.0))
    aid = GnssAid(taxi().run.gnss, rows(), ANTENNA, 0.5, 0.03, AS_DECLARED, slow)
    (_, of_position), (_, of_velocity) = read_by(aid, solution(), TURNING_S)
    assert np.array_equal(of_position[:, em.GNSS_SLOW_POS], -np.eye(2))
    assert np.array_equal(of_velocity[:, em.GNSS_SLOW_VEL], -np.eye(2))
    steps = np.arange(TURNING_S - 3, TURNING_S + 2)
    plan = StepPlan(steps, steps + 1, 0 * steps + ROLLING, 0 * steps, np.zeros(steps.size))
    tape = Assigned()
    aid.measure(tape, views_of(solution(), plan))
    position, velocity = em.GNSS_SLOW_POS, em.GNSS_SLOW_VEL
    levels = dict.fromkeys(range(position.start, position.stop), 1.5)
    levels |= dict.fromkeys(range(velocity.start, velocity.stop), 0.01)
    assert {index for index, _, _ in tape.seen} == set(levels)
    for index, row, variance in tape.seen:
        assert row[index] ** 2 * levels[index] ** 2 + variance == pytest.approx(levels[index] ** 2)
    times = {position.start: 300.0, velocity.start: 60.0}
    kept = {index: row[index] for index, row, _ in tape.seen}
    for index, time_s in times.items():
        assert kept[index] == pytest.approx(np.exp(-1.0 / time_s))


def test_wandering_crabs_keep_their_level():
    """A fresh start, then x -> a x + noise: the variance stays the level's square at any a."""
    steps = np.arange(TURNING_S - 3, TURNING_S + 2)
    plan = StepPlan(steps, steps + 1, 0 * steps + ROLLING, 0 * steps, np.zeros(steps.size))
    tape = Assigned()
    LateralAid(WHEEL, ALL).measure(tape, views_of(solution(), plan))
    levels = {em.CRAB_TURN: ALL.turning_crab_rad, em.CRAB_GUST: ALL.gust_crab_rad}
    assert {index for index, _, _ in tape.seen} == set(levels)
    for index, row, variance in tape.seen:
        assert row[index] ** 2 * levels[index] ** 2 + variance == pytest.approx(levels[index] ** 2)
        assert row[index][0] == 1.0
        assert (row[index][1:] < 1.0).all()


# Whole sessions: two of a case here, many in the slow test.
NAMED = {
    "quiet": None,
    "cross wind 20 mrad": "cross_wind",
    "cross wind, body turned": "cross_wind",
    "GNSS late by 0.3 s": "gnss_delay",
    "GNSS arm wrong by 1 m": "antenna",
    "fixes wander": "gnss_slow_position",
    "wheel scale wrong by 2 %": None,
    "wheels late by 0.1 s": "odometer_delay",
}


@cache
def sessions(name, count=1):
    return [scored_session(CASES[name], seed) for seed in range(count)]


@pytest.mark.parametrize("name", NAMED)
def test_what_the_data_show_is_named_and_the_session_merged(name):
    """Mean square errors over sigma, 4 degrees of freedom: below the 99.9 % point of chi-square."""
    found = sessions(name)
    assert [str(s.result.verdict.outcome) for s in found] == ["accepted"] * len(found)
    for s in found:
        assert NAMED[name] in (*s.needed, None)
    total = sum(s.nees + s.heading**2 for s in found)
    assert total < chi2.isf(1e-3, 4 * len(found))


def test_quiet_sessions_need_nothing_and_keep_their_bits():
    """The very filter as declared: nothing is taken, nothing moves."""
    for seed, s in enumerate(sessions("quiet")):
        assert s.needed == ()
        with as_declared():
            before = scored_session(CASES["quiet"], seed)
        assert np.array_equal(before.estimate.mean_deg_h, s.estimate.mean_deg_h)
        assert np.array_equal(before.estimate.covariance, s.estimate.covariance)


def test_sizes_are_found_within_their_sigmas():
    for s in sessions("GNSS late by 0.3 s"):
        (late,) = s.estimate.rolling.found
        assert np.abs((late.value - 0.3) / late.sigma).max() < 3.5
        assert late.sigma.max() < 0.02
    for seed, s in enumerate(sessions("GNSS arm wrong by 1 m")):
        (arm,) = s.estimate.rolling.found
        made = Made(s.result.run, ideal_taxi(25.0 + 40.0 * (seed % 9)))
        off = np.asarray(ARM_M) - made.run.header.gnss_lever_arm_m  # true less declared
        assert np.abs((arm.value - off[:2]) / arm.sigma).max() < 3.5
        assert arm.sigma.max() < 0.1


QUICK = {"reversed wheel", "random speeds", "fixes six times as noisy"}


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=() if name in QUICK else pytest.mark.slow) for name in WRONG]
)
def test_what_no_model_explains_is_not_merged(name):
    (s,) = sessions(name, 1)
    expected = "refused" if name == "dead wheel" else "inconsistent"
    assert str(s.result.verdict.outcome) == expected


def test_savage_dickey_is_the_ratio_of_the_likelihoods(monkeypatch):
    """The closed form against two sweeps, one with and one without the nuisance: to a
    hundredth of a nat where no gate acts and nothing is linearised anew.
    """
    benches = []
    real = nuisances.rolling_model

    def kept(bench, declared):
        benches.append((bench, declared))
        return real(bench, declared)

    monkeypatch.setattr("infield.session.navigated.estimator.rolling_model", kept)
    scored_session(CASES["quiet"], 3)
    ((bench, declared),) = benches
    every = frozenset(CONSTANTS)
    wide = bench.run(Assumed(every))
    found = FreeConstants(wide.x, wide.P, {n: nuisances._states_of(n) for n in CONSTANTS})
    assert wide.tally.loglik - declared.tally.loglik == pytest.approx(found.gain(every), abs=0.01)
    for nuisance in CONSTANTS:
        one = bench.run(Assumed(frozenset([nuisance])))
        predicted = found.gain({nuisance})
        gain = one.tally.loglik - declared.tally.loglik
        assert gain == pytest.approx(predicted, abs=0.01), nuisance


MANY = 24


@pytest.mark.slow
@pytest.mark.parametrize("name", EXPLAINED)
def test_errors_are_as_large_as_their_sigmas(name):
    """At least 11 of 12 accepted; mean square error over sigma of heading, and of the three biases
    together, within the two-sided 99.9 % bounds of chi-square.
    """
    found = sessions(name, MANY)
    accepted = sum(str(s.result.verdict.outcome) == "accepted" for s in found)
    assert accepted >= 11 * MANY // 12
    heading = sum(s.heading**2 for s in found)
    assert chi2.ppf(5e-4, MANY) < heading < chi2.isf(5e-4, MANY)
    biases = sum(s.nees for s in found)
    assert chi2.ppf(5e-4, 3 * MANY) < biases < chi2.isf(5e-4, 3 * MANY)
