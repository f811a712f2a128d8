"""The shrink on held-out rows: its interval covers, and its edges are sane."""

import numpy as np
import pytest

from simreal.inference.addback import fieller


def held_out(rng, s, d):
    z = s + rng.standard_normal(s.size)
    dd, dz = float(d @ d), float(d @ z)
    return fieller(2 * dz - dd, float(z @ z) - s.size, dd=dd, dz=dz, m=float(s.size))


@pytest.mark.parametrize("size", [6.0, 12.0, 25.0])
@pytest.mark.parametrize("error", [0.0, 0.3, 0.7])
def test_interval_covers_the_true_shrink(size, error):
    """At least 90 of 100 asked (issue 4); 400 draws, so 0.90 less two binomial sigmas."""
    rng = np.random.default_rng(int(10 * size + 100 * error))
    covered = 0
    for _ in range(400):
        s = rng.standard_normal(96)
        s *= size / np.linalg.norm(s)
        off = rng.standard_normal(96)
        d = s + error * size * off / np.linalg.norm(off)
        true = 1.0 - float((s - d) @ (s - d)) / float(s @ s)
        found = held_out(rng, s, d)
        covered += found.interval_95[0] - 1e-9 <= true <= found.interval_95[1] + 1e-9
    assert covered / 400 >= 0.87


def test_a_perfect_fit_of_a_large_effect_is_all_of_the_gap():
    rng = np.random.default_rng(1)
    s = 40.0 * np.ones(50) / np.sqrt(50)
    found = held_out(rng, s, s)
    assert found.fraction > 0.95
    assert found.interval_95[0] > 0.85
    assert found.interval_95[1] <= 1.0


def test_nothing_there_says_nothing():
    rng = np.random.default_rng(2)
    found = held_out(rng, np.zeros(60), np.zeros(60))
    assert found.interval_95[1] - found.interval_95[0] > 0.5
    assert found.too_small


def test_a_wrong_effect_does_not_shrink_the_gap():
    rng = np.random.default_rng(3)
    s = np.zeros(60)
    s[0] = 30.0
    d = np.zeros(60)
    d[1] = 30.0
    assert held_out(rng, s, d).fraction < -0.5
