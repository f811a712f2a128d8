"""A place that swings: exact as states of a filter, found on a moored ship, not found in a roll."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

from alignment import gyrocompass, mooring_motion
from ins.estimation import error_model as em
from ins.estimation.error_filter import ErrorFilter
from ins.estimation.tape import Tape
from tests.alignment.parked import attitude_error, ideal_of, simulate
from tests.ins.filter_steps import steps_of
from tests.ins.test_error_filter import NOISE, parked_step
from tests.scenarios.study import DEFAULT_TWIN
from trajectories.simulator.environments.kinds import Environment
from trajectories.simulator.segments import Straight

SWING = mooring_motion.MooringMotion(period_s=80.0, damping=0.2)
FIRST = em.BASE + 3


def swung(dt_s, still):
    """A filter of nothing but a swing of 1 m, over steps of given lengths, and the swing laid."""
    steps = replace(steps_of(parked_step(), count=len(dt_s)), dt_s=np.array(dt_s))
    tape = Tape(steps)
    laid = mooring_motion.lay(tape, SWING, np.array(still), (em.S.start, em.S.start + 1), FIRST)
    flt = ErrorFilter(
        sigma0={},
        noise=NOISE,
        bias_mean=np.zeros(3),
        bias_covariance=np.zeros((3, 3)),
        further_sigma=(0.0,) * mooring_motion.STATES,
    )
    flt.run(tape)
    return flt, laid


def test_a_swing_keeps_its_size_over_steps_of_any_length():
    """Variance of the place 1 m^2, of its velocity w^2, nothing between them."""
    for count in (1, 2, 5):
        dt_s = [10.0, 3.0, 7.5, 10.0, 1.0][:count]
        flt, laid = swung(dt_s, [True] * count)
        for axis in (0, 1):
            row = laid.place(axis, np.array([count - 1]))
            (place,) = [state for state, value in row.items() if value[0] == 1.0]
            velocity = FIRST + 3 * axis + 2
            w = SWING.natural_rad_s
            assert flt.P[place, place] == pytest.approx(1.0, rel=1e-9)
            assert flt.P[velocity, velocity] == pytest.approx(w**2, rel=1e-9)
            assert abs(flt.P[place, velocity]) < 1e-9 * w
            assert flt.bias[0].shape == (3,)


def test_a_swing_remembers_as_an_oscillator_does():
    """Correlation of the places before and after a step of 10 s: that of exp(A t)."""
    flt, _ = swung([10.0], [True])
    w = SWING.natural_rad_s
    a = expm(10.0 * np.array([[0.0, 1.0], [-(w**2), -2.0 * SWING.damping * w]]))
    assert flt.P[FIRST, FIRST + 1] == pytest.approx(a[0, 0], rel=1e-9)


def test_what_is_counted_begins_where_the_swing_is():
    """Displacement since the stop holds minus the place at the stop: their sum begins at zero."""
    flt, _ = swung([10.0], [True])
    assert flt.P[em.S.start, FIRST] == pytest.approx(-1.0, rel=1e-6)


def aligned(run):
    return gyrocompass.align(
        run.imu, run.header.site, DEFAULT_TWIN, bias_sigma_deg_h=np.full(3, 0.01)
    )


@pytest.mark.parametrize("seeds", [2, pytest.param(20, marks=pytest.mark.slow)])
def test_a_moored_ship_swings_and_shows_north(seeds):
    """Ten minutes: aligned by the swing, not by a noisier unit; heading within 4 sigma."""
    for seed in range(seeds):
        made = simulate(ideal_of(), 900 + seed, environments=(Environment(kind="ship"),))
        found = aligned(made.run)
        assert found.verdict == "aligned"
        assert found.level.swing_s is not None
        assert found.level.unit_noise == 1.0
        assert found.level.sigma_cost < 1.2
        assert abs(attitude_error(found, made)[2]) < 4.0 * found.sigma_heading_rad


@pytest.mark.slow
def test_a_straight_roll_swings_nowhere():
    """32 rolls at 9.5 m/s of 100 to 900 s: none is taken for a swing, all of 400 s or more are
    refused.
    """
    for seconds in (100.0, 200.0, 400.0, 900.0):
        for seed in range(1, 9):
            made = simulate(ideal_of((Straight(duration_s=seconds),)), seed)
            found = aligned(made.run)
            assert found.level is None or found.level.swing_s is None
            assert found.verdict == "refused" or seconds < 400.0
