"""Robust spreads against the normal distribution, and runs of True against a plain loop."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import norm

from ins.robust import (
    SIGMA_OF_MAD,
    robust_scatter,
    robust_sigma,
    robust_sigmas,
    runs_of_true,
    white_sigma,
)


def test_the_factor_is_that_of_the_normal_distribution():
    assert pytest.approx(1.0 / norm.ppf(0.75), abs=5e-6) == SIGMA_OF_MAD


def test_normal_values_give_their_sigma_and_a_few_wild_ones_change_little():
    rng = np.random.default_rng(4)
    n = 20_000
    values = rng.normal(5.0, 2.0, (n, 3))
    two_sigmas = 2.0 * 1.17 / np.sqrt(n)  # of the estimate, relative (docstring of robust_sigma)
    assert robust_scatter(values) == pytest.approx([2.0] * 3, rel=2 * two_sigmas)
    assert robust_sigmas(values - 5.0) == pytest.approx([2.0] * 3, rel=2 * two_sigmas)
    assert robust_sigma(values - 5.0) == pytest.approx(2.0, rel=two_sigmas)
    values[: n // 100] = 1e6
    assert robust_scatter(values) == pytest.approx([2.0] * 3, rel=0.02 + 2 * two_sigmas)


def test_the_stated_sigma_of_the_estimate():
    rng = np.random.default_rng(5)
    n = 400
    found = robust_sigmas(rng.standard_normal((n, 4000)))
    assert np.std(found) * np.sqrt(n) == pytest.approx(1.17, rel=0.05)


def test_second_differences_leave_a_straight_course_out():
    rng = np.random.default_rng(6)
    t = np.arange(10_000.0)
    noise = rng.normal(0.0, 0.3, (t.size, 2))
    course = np.column_stack([3.0 * t, -7.0 * t])
    assert white_sigma(noise + course) == pytest.approx(white_sigma(noise), rel=1e-9)
    assert white_sigma(noise[:, 0] + course[:, 0]) == pytest.approx(0.3, rel=0.05)


@given(st.lists(st.booleans(), max_size=30))
def test_runs_are_those_of_a_plain_loop(flags):
    runs, start = [], None
    for k, flag in enumerate([*flags, False]):
        if flag and start is None:
            start = k
        if not flag and start is not None:
            runs.append((start, k))
            start = None
    assert runs_of_true(np.array(flags, dtype=bool)) == runs
