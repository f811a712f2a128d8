"""Levels against likelihoods whose top is known, evidence against the densities that it stands for,
and the rate at which nothing is taken for something.
"""

from operator import sub

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from ins.estimation.choice import SURE_NATS, FreeConstants, Level, choose, climb, powers_of_two

PRIOR, NOISE = np.array([2.0, 0.5, 1.0, 3.0]), 0.7
PLACES = {"a": [0], "pair": [1, 3], "b": [2]}


def top_of(loglik, levels, **how):
    """The sizes that a climb ends at, and the sizes that it tried."""
    tried = []

    def fit(sizes, _):
        tried.append(tuple(sizes.values()))
        return dict(sizes)

    start = {x.name: x.start for level in levels for x in (level, *level.along)}
    best, sizes = climb(
        start, levels, fit, lambda one, other: loglik(**one) - loglik(**other), **how
    )
    assert best == sizes
    return sizes, tried


@pytest.mark.parametrize(("top", "found"), [(17.0, 16.0), (5.0, 4.0), (1.0, 2.0), (100.0, 32.0)])
@pytest.mark.parametrize("start", [4.0, 32.0, 3.0, 0.0])
def test_a_level_is_climbed_to_within_its_bounds(start, top, found):
    level = Level("x", powers_of_two(2.0, 32.0), start)
    sizes, tried = top_of(lambda x: -abs(np.log((x + 1e-9) / top)), [level])
    assert sizes == {"x": found}
    assert len(tried) <= 8  # each costs a sweep over a session


def test_sizes_hold_their_bounds():
    assert powers_of_two(0.75, 48.0) == (0.75, 1.5, 3.0, 6.0, 12.0, 24.0, 48.0)
    root = np.sqrt(2.0)
    assert powers_of_two(1.0, 3.9, fineness=2) == pytest.approx((1.0, root, 2.0, 2.0 * root))


def test_a_ridge_is_climbed_by_both_levels():
    """Two levels whose product and ratio are known, the product far better."""

    def loglik(x, y):
        return -10.0 * np.log2(x * y / 64.0) ** 2 - 11.0 * np.log2(x / y) ** 2

    grid = powers_of_two(0.5, 1024.0)
    assert top_of(loglik, [Level("x", grid, 1.0), Level("y", grid, 1.0)])[0] == {"x": 8.0, "y": 8.0}


def test_levels_that_move_together_keep_what_they_share():
    size = Level("size", powers_of_two(1.0, 16.0, fineness=2), 4.0)
    length = Level("length", powers_of_two(1.0, 1024.0), 16.0, along=(size,))

    def loglik(size, length):
        return -abs(np.log2(length / 1024.0)) - 1e3 * np.log2(size**2 / length) ** 2

    # the size is at the end of its grid before the length is
    assert top_of(loglik, [length])[0] == pytest.approx({"size": 16.0, "length": 256.0})


def test_wide_strides_leap_a_valley_and_fine_ones_find_the_top():
    logliks = [0.0, -1.0, 2.0, -1.0, 5.0, 6.0, 1.0]

    def loglik(x):
        return logliks[int(x)]

    level = Level("x", range(7), 0)
    assert top_of(loglik, [level])[0] == {"x": 0}
    assert top_of(loglik, [level], strides=(2, 1))[0] == {"x": 5}
    assert top_of(loglik, [level], strides=(2, 1), least_nats=1.0)[0] == {"x": 4}


def test_a_model_that_cannot_be_fitted_is_passed_by():
    def fit(sizes, at):
        return None if sizes["x"] > 4.0 else sizes["x"]

    level = Level("x", powers_of_two(1.0, 64.0), 1.0)
    assert climb(1.0, [level], fit, sub) == (4.0, {"x": 4.0})


def test_the_way_back_leads_elsewhere_with_what_was_refitted():
    logliks = {(1.0, False): 0.0, (2.0, True): 1.0, (4.0, True): 0.5, (1.0, True): 3.0}
    best, sizes = climb(
        (1.0, False),
        [Level("x", powers_of_two(1.0, 4.0), 1.0)],
        lambda sizes, _: (sizes["x"], True),
        lambda one, other: logliks[one] - logliks[other],
    )
    assert best == (1.0, True) and sizes == {"x": 1.0}


def swept(rng, coefficients, rows=12):
    """A linear model z = H x + noise with all of x free: its data, and what a sweep finds."""
    H = rng.standard_normal((rows, PRIOR.size))
    z = H @ coefficients + NOISE * rng.standard_normal(rows)
    P = np.linalg.inv(H.T @ H / NOISE**2 + np.diag(PRIOR**-2.0))
    x = P @ H.T @ z / NOISE**2
    at = {name: (np.array(index), PRIOR[index]) for name, index in PLACES.items()}
    return H, z, FreeConstants(x, P, at)


def log_evidence(H, z, free):
    """Of the data with these constants in the model, by their joint density."""
    index = [k for name in free for k in PLACES[name]]
    S = H[:, index] @ np.diag(PRIOR[index] ** 2) @ H[:, index].T + NOISE**2 * np.eye(z.size)
    return multivariate_normal.logpdf(z, cov=S)


@pytest.mark.parametrize("free", [(), ("a",), ("pair",), ("a", "b"), ("pair", "b"), tuple(PLACES)])
def test_the_evidence_of_every_subset_is_in_one_sweep(free):
    H, z, found = swept(np.random.default_rng(7), np.array([1.0, 0.0, -2.0, 0.5]))
    direct = log_evidence(H, z, free) - log_evidence(H, z, ())
    assert found.gain(free) == pytest.approx(direct, abs=1e-9)


def test_what_only_shows_together_is_taken_together():
    """Each of two constants alone explains nothing that the other hides."""
    gains = {("a", "b"): 20.0, ("c",): 5.0, ("a", "b", "c"): 21.0}
    assert choose("abc", lambda taken: gains.get(taken, 0.0)) == ("a", "b")
    assert choose("abc", lambda taken: gains.get(taken, 0.0), cost_nats=10.1) == ()


def test_nothing_is_seldom_taken_for_something():
    """Three constants at zero: of 2,000 draws at most three times 1 in 20 (Markov, each alone)."""
    rng, draws = np.random.default_rng(11), 2000
    taken = [choose(list(PLACES), swept(rng, np.zeros(4))[2].gain) for _ in range(draws)]
    assert sum(map(bool, taken)) < len(PLACES) * np.exp(-SURE_NATS) * draws
    planted = [choose(list(PLACES), swept(rng, PRIOR)[2].gain) for _ in range(50)]
    assert sum(len(names) == len(PLACES) for names in planted) > 25
