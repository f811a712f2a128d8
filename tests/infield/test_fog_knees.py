"""Breakpoints of fibre-optic curves: knees found where they are, their intervals, and places that
the data do not call for.
"""

import numpy as np
import pytest
from scipy.stats import binom

from infield.thermal.coefficient_curves import Reduced, smooth_basis
from infield.thermal.fog.knees import find_knees, intervals, places_of
from infield.thermal.fog.piecewise import NEAREST_degC, piecewise_pair
from infield.thermal.fog.ramps import HALF_WIDTHS_degC, play
from tests.infield.test_piecewise import blocks

KNEES = (-4.0, 14.0, 30.0)


def bent(T, slopes=(0.004, -0.004, 0.005, -0.003)):
    edges = np.array([-20.0, *KNEES, 40.0])
    return np.interp(T, edges, np.r_[0.0, np.cumsum(np.diff(edges) * slopes)])


def level(T):
    return 0.2 + 0.0 * T


def places(K_T, *, sigma, seed=1, degree=1):
    reduced = Reduced(blocks(K_T, level, sigma=sigma, seed=seed))
    return places_of(reduced, smooth_basis(-20.0, 40.0)[0], 0, degree, NEAREST_degC)


def test_three_knees_are_found_where_they_are():
    pair = piecewise_pair(Reduced(blocks(bent, level, sigma=0.01)))
    assert [b.kind for b in pair.K_T.breakpoints] == ["knee"] * 3 and pair.K_T.degree == 1
    for mark, knee in zip(pair.K_T.breakpoints, KNEES):
        assert mark.low_degC <= knee <= mark.high_degC and mark.called_for
        assert mark.high_degC - mark.low_degC < 6.0
    T = np.linspace(-20, 40, 601)
    off = pair.K_T(T) - bent(T)
    assert np.abs(off - off.mean()).max() < 0.004


def test_what_columns_of_places_leave_is_what_least_squares_leaves():
    found = places(bent, sigma=0.01)
    made = blocks(bent, level, sigma=0.01)
    at = [found.nearest(knee) for knee in KNEES]
    T, rate = made.temperature_degC, made.rate_degC_min
    X = [smooth_basis(-20.0, 40.0)[0](T) * rate[:, None], np.ones((T.size, 1)), T[:, None]]
    X += [np.maximum(T - found.grid_degC[k], 0.0)[:, None] for k in at]
    normal = Reduced(made).normal(np.column_stack(X))
    left = normal.c - normal.b @ np.linalg.lstsq(normal.A, normal.b)[0]
    assert found.chi2(at) == pytest.approx(left, rel=1e-5)
    assert found.chi2([]) > found.chi2(at[:1]) > found.chi2(at)


def test_a_straight_line_has_no_breakpoint():
    assert find_knees(places(lambda T: 0.001 * T, sigma=0.005)) == ()


def test_intervals_hold_what_they_say():
    """95 % of the knees of 8 draws within: fewer than `binom` says in 0.1 % of such."""
    draws = 8
    hits = 0
    for seed in range(draws):
        of = places(bent, sigma=0.02, seed=seed)
        for known, knee in zip(intervals(of, KNEES), KNEES):
            hits += known.low_degC <= knee <= known.high_degC
    assert hits >= binom.ppf(0.001, draws * len(KNEES), 0.95)


def test_a_bend_that_the_data_do_not_place_is_not_called_for():
    """A parabola cut into straight pieces bends everywhere alike."""
    of = places(lambda T: 1e-6 * (T - 10.0) ** 2, sigma=0.05)
    (known,) = intervals(of, [10.0])
    assert not known.called_for and known.high_degC - known.low_degC > 30.0


def test_a_pointer_that_is_dragged_turns_over_within_twice_its_width():
    T = np.r_[np.linspace(-20, 40, 241), np.linspace(40, -20, 241)]
    for half in HALF_WIDTHS_degC:
        s = play(T, half)
        assert np.abs(s).max() <= 1.0 + 1e-12 and s[200] == pytest.approx(1.0)
        back = 241 + int(np.ceil(2 * half / 0.25)) + 1
        assert s[back] == pytest.approx(-1.0) and s[back - 3] > -1.0 + 1e-9
        assert np.all(np.diff(s[: int(half / 0.25)]) > 0)
