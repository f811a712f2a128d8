"""R21 from whole runs, stops found, levelled and weighted: normalised errors. The figures over 200
seeds are `slow`.
"""

import numpy as np
import pytest

from tests.scenarios.azimuth_study import study

CASES = [(1, False), (1, True), (4, True)]


def figures(seeds, power_ons, given):
    found = [study(seed, power_ons=power_ons, given=given) for seed in seeds]
    names = sorted(
        {name for f in found for name in f.z} - {"xy+yx"} if given else {"zx", "zy", "xy+yx"}
    )
    return {name: np.array([f.z[name] for f in found]) for name in names}, np.array(
        [f.chi2 / f.dof for f in found]
    )


@pytest.mark.parametrize(("power_ons", "given"), CASES)
def test_errors_agree_with_their_sigma(power_ons, given):
    z, chi2 = figures(range(4), power_ons, given)
    assert len(z) == (4 if given else 3)
    pooled = np.concatenate(list(z.values()))
    assert np.abs(pooled).max() < 4.0 and np.mean(pooled**2) < 2.0 and chi2.mean() < 2.5


@pytest.mark.slow
@pytest.mark.parametrize(("power_ons", "given"), CASES)
def test_mean_squared_normalised_error_over_200_seeds(power_ons, given):
    z, chi2 = figures(range(200), power_ons, given)
    pooled = np.concatenate(list(z.values()))
    assert 0.8 <= np.mean(pooled**2) <= 1.25
    assert 0.7 <= chi2.mean() <= 1.3
