"""A noisy unit under the name of a quiet one, or one that sways, parked for a minute only: no
heading, and no crash.
"""

import numpy as np
import pytest

from alignment.gyrocompass import NothingStands, align, solve
from alignment.motion.inertial import first_rest
from alignment.motion.seconds import seconds_of
from alignment.result import BiasPrior
from infield.reports.words.sentences import sentence
from ins.units import DEG_PER_HOUR
from tests.infield.aided_cases import SITE, flown, ideal, twin_of


@pytest.mark.parametrize("park_s", [40.0, 60.0, 75.0])
@pytest.mark.parametrize("seed", [1, 2, 3, 4])
def test_the_level_of_a_mems_unit_under_the_name_of_a_ring_laser(park_s, seed):
    """The noise of a MEMS unit, taken for a ring laser: no heading, the reason names it, and an
    honest level.
    """
    made = flown(ideal(park_s), twin_of("mems"), seed)
    found = align(made.run.imu, SITE, twin_of("rlg"))
    assert found.verdict == "level_only" and np.isnan(found.heading_rad)
    assert "0.01 is usual for rlg: another technology or a fault" in sentence(found.reasons[-1])
    row = np.searchsorted(made.reference.time_s, found.time_s)
    error = [
        found.roll_rad - made.reference.roll_rad[row],
        found.pitch_rad - made.reference.pitch_rad[row],
    ]
    assert np.abs(error).max() < 3.5 * found.sigma_roll_rad


def test_a_rest_in_which_no_step_stands_is_refused():
    """The same unit where somebody has it navigated all the same: one line that names the noise."""
    imu = flown(ideal(60.0), twin_of("mems"), 1).run.imu
    prior = BiasPrior(np.array([0.0, 1e4]), np.eye(3) * (0.01 * DEG_PER_HOUR) ** 2)
    with pytest.raises(
        NothingStands, match=r"nothing stands still for a step.* much noisier than its noise model"
    ):
        solve(imu, SITE, twin_of("rlg"), prior, rest=first_rest(seconds_of(imu)), parked_only=True)
