"""Quantiles and tails against scipy.stats, bit for bit, and who imports that."""

import subprocess
import sys

import numpy as np
import pytest
from scipy import stats

from ins import robust as laws

P = np.array([1e-9, 1e-3, 0.025, 0.5, 0.9, 0.999, 1.0 - 1e-9])
X = np.array([0.0, 0.01, 1.0, 7.5, 40.0])


@pytest.mark.parametrize("dof", [1, 2, 3, 7.5, 400])
def test_chi_square_is_that_of_scipy(dof):
    assert np.array_equal(laws.chi2.ppf(P, dof), stats.chi2.ppf(P, dof))
    assert np.array_equal(laws.chi2.isf(P, dof), stats.chi2.isf(P, dof))
    assert np.array_equal(laws.chi2.sf(X, dof), stats.chi2.sf(X, dof))


def test_normal_is_that_of_scipy():
    assert np.array_equal(laws.norm.isf(P), stats.norm.isf(P))


@pytest.mark.parametrize("shape", [0.5, 1.0, 30.0])
def test_gamma_is_that_of_scipy(shape):
    assert np.array_equal(laws.gamma.ppf(P, shape), stats.gamma.ppf(P, shape))
    assert np.array_equal(laws.gamma.isf(P, shape), stats.gamma.isf(P, shape))
    assert np.array_equal(laws.gamma.cdf(X, shape), stats.gamma.cdf(X, shape))
    assert np.array_equal(laws.gamma.sf(X, shape), stats.gamma.sf(X, shape))


@pytest.mark.parametrize("module", ["recal.service.update", "recal.service.align"])
def test_commands_start_without_the_slow_import(module):
    code = f"import sys, {module}; raise SystemExit('scipy.stats' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code]).returncode == 0
