"""Requirements R2 and R5 as rates over latitudes, headings, sensors and times; the figures over 200
runs are `slow`.
"""

import numpy as np
import pytest

from tests.scenarios.fault_study import TWINS, burst, latitude_found


@pytest.mark.parametrize("runs", [6, pytest.param(200, marks=pytest.mark.slow)])
@pytest.mark.parametrize("twin", list(TWINS))
def test_wrong_latitude_is_named_at_any_latitude_and_heading(twin, runs):
    """R2: 0.25 deg in at least 95 %, 0.6 deg in all, at most 1 % false alarms."""
    named = {
        offset: sum(latitude_found(seed, offset, TWINS[twin])[0] for seed in range(runs))
        for offset in (0.0, 0.25, 0.6)
    }
    assert named[0.0] <= 0.01 * runs
    assert named[0.25] >= 0.95 * runs - (runs < 20)
    assert named[0.6] == runs


@pytest.mark.parametrize("runs", [2, pytest.param(200, marks=pytest.mark.slow)])
def test_a_burst_is_listed_and_leaves_less_than_a_tenth_of_a_sigma(runs):
    """R5, reference session: the RMS shift of the session's mean gyro biases."""
    bursts = [burst(seed) for seed in range(runs)]
    assert sum(b.listed for b in bursts) >= 0.99 * runs
    assert np.all(np.sqrt(np.mean([b.moved**2 for b in bursts], axis=0)) < 0.1)
    assert np.all(np.max([b.widened for b in bursts], axis=0) < 1.02)
