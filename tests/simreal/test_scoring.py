"""Closed-form evidence: against numerical integrals and cases by hand."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import logsumexp

from ins.errors.base import Coefficient, ErrorSource
from simreal.inference.bank import SIZES, Group, Hypothesis, size_weights
from simreal.inference.noise_hypotheses import _between, _fits
from simreal.inference.scoring import Conditioned, Scorer, fit


def bank_of(U, z, *, low=1e-3, high=1e3):
    effect = ErrorSource(
        "e", "e", ("gyro_x",), tuple(Coefficient(f"c{k}", "", low, high) for k in range(U.shape[1]))
    )
    group = Group({}, np.arange(U.shape[1]), np.full(U.shape[1], np.sqrt(low * high)))
    hypothesis = Hypothesis("e", "gyro_x", effect, groups=[group])
    return SimpleNamespace(gram=U.T @ U, score=U.T @ z, hypotheses=[hypothesis])


def test_single_effect_is_the_integral_over_its_size():
    rng = np.random.default_rng(3)
    u, z = rng.standard_normal((50, 1)), 3.0 * rng.standard_normal(50)
    bank = bank_of(u, z)
    found = Scorer(bank).groups_log_bf(np.zeros(0, int), bank.score[:, None])[0, 0]
    norm = float(np.sqrt(u[:, 0] @ u[:, 0]))
    y = float(u[:, 0] @ z) / norm
    weights = np.exp(size_weights(norm, 1e-3, 1e3))
    by_hand = 0.0
    for v, weight in zip(SIZES, weights):

        def integrand(a, v=v):
            return np.exp(a * y - 0.5 * a * a - 0.5 * a * a / v) / np.sqrt(2 * np.pi * v)

        by_hand += weight * quad(integrand, -80, 80, limit=400, points=[y])[0]
    assert found == pytest.approx(np.log(by_hand), rel=1e-5)


def test_selected_effects_are_projected_out():
    rng = np.random.default_rng(4)
    U, z = rng.standard_normal((40, 3)), rng.standard_normal(40)
    left = Conditioned(U.T @ U, (U.T @ z)[:, None], np.array([0]))
    u0 = U[:, 0] / np.linalg.norm(U[:, 0])
    P = np.eye(40) - np.outer(u0, u0)
    np.testing.assert_allclose(left.gram_of(np.array([1, 2])), U[:, 1:].T @ P @ U[:, 1:], atol=1e-9)
    np.testing.assert_allclose(left.score[1:, 0], U[:, 1:].T @ P @ z, atol=1e-9)


def test_an_effect_already_selected_gains_nothing():
    u = np.ones((30, 1))
    bank = bank_of(u, 5.0 * np.ones(30))
    assert Scorer(bank).groups_log_bf(np.array([0]), bank.score[:, None])[0, 0] == 0.0


def test_a_fit_of_no_columns_is_empty():
    """A twin without a table and a log without any effect: the largest of nothing was asked for."""
    beta, P = fit(bank_of(np.ones((30, 1)), np.ones(30)), np.zeros(0, int))
    assert beta.shape == (0,) and P.shape == (0, 0)


def test_fit_is_least_squares_with_its_covariance():
    rng = np.random.default_rng(5)
    U, z = rng.standard_normal((60, 2)), rng.standard_normal(60)
    beta, covariance = fit(SimpleNamespace(gram=U.T @ U, score=U.T @ z), np.array([0, 1]))
    np.testing.assert_allclose(beta, np.linalg.lstsq(U, z, rcond=None)[0], rtol=1e-9)
    np.testing.assert_allclose(covariance, np.linalg.inv(U.T @ U), rtol=1e-9)


def test_null_evidence_is_rarely_large():
    """Under the null E[BF] <= 1, so P(log BF > 4.6) is at most 1 % (Markov)."""
    rng = np.random.default_rng(6)
    u = rng.standard_normal((50, 1))
    bank = bank_of(u, np.zeros(50))
    scores = u.T @ rng.standard_normal((50, 4000))
    found = Scorer(bank).groups_log_bf(np.zeros(0, int), scores)[0]
    assert np.mean(found > np.log(100)) < 0.01
    assert np.mean(np.exp(found)) < 1.2


def test_a_size_beyond_the_usual_costs_but_is_not_excluded():
    usual, beyond, absurd = (
        np.logaddexp.reduce(size_weights(n, 0.5, 2.0)) for n in (10.0, 0.1, 1e-5)
    )
    assert usual > beyond > absurd > -np.inf


@pytest.mark.parametrize("dof", [400.0, 40_000.0])
def test_a_loud_noise_is_weighed_as_finely_as_its_level_is_known(dof):
    """Against a sum over so fine a grid that it is the integral."""
    levels, n, a = np.geomspace(1e-2, 1e3, 28), np.full(50, dof), np.ones(50)
    y = np.full((50, 1), 1.0 + 3.3)

    def fits(tried):
        return _fits(n, y, 1.0 + np.outer(tried, a))[:, 0]

    weights = np.full(28, -np.log(28.0))
    score, level = _between(n, y, a, fits(levels), levels, weights)
    fine = np.geomspace(1e-2, 1e3, 27 * 4000 + 1)
    exact = logsumexp(fits(fine)) - np.log(28.0 * 4000.0)
    assert level == pytest.approx(3.3, rel=0.03)
    assert score == pytest.approx(exact, abs=0.1)
    assert logsumexp(fits(levels)) - np.log(28.0) < exact - 10.0
