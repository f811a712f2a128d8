"""A noisy unit under the name of a quiet one, parked for a minute only: a refusal, and no crash."""

import numpy as np
import pytest

from alignment.gyrocompass import align
from tests.infield.aided_cases import SITE, flown, ideal, twin_of


@pytest.mark.parametrize("park_s", [40.0, 60.0, 75.0])
def test_a_rest_in_which_no_step_stands_is_refused(park_s):
    """The noise of a MEMS unit, taken for a ring laser: no heading, and the reason names the noise."""
    found = align(flown(ideal(park_s), twin_of("mems"), 1).run.imu, SITE, twin_of("rlg"))
    assert found.verdict == "refused" and np.isnan(found.heading_rad)
    assert "nothing stands still for a step of the filter" in found.reasons[0]
    assert "much noisier than its noise model" in found.reasons[0]
