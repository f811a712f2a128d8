"""A noisy unit under the name of a quiet one, or one that sways, parked for a minute only: no
heading, and no crash.
"""

import numpy as np
import pytest

from alignment.gyrocompass import align
from alignment.linearised import Course, NothingStands, RestedLog, solve
from alignment.motion.inertial import first_rest
from alignment.motion.seconds import seconds_of
from alignment.reasons import AlignmentReason
from alignment.result import BiasPrior
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
    assert found.reasons[-1].code is AlignmentReason.LIKE_MEMS
    row = np.searchsorted(made.reference.time_s, found.time_s)
    error = [
        found.roll_rad - made.reference.roll_rad[row],
        found.pitch_rad - made.reference.pitch_rad[row],
    ]
    assert np.abs(error).max() < 3.5 * found.sigma_roll_rad


@pytest.mark.parametrize("park_s", [60.0, 75.0, 120.0])
@pytest.mark.parametrize("seed", [1, 2])
def test_a_mems_unit_that_somebody_has_navigated_is_refused(park_s, seed):
    """The same unit said to be as good as a ring laser: next to nothing measures its heading."""
    imu = flown(ideal(park_s), twin_of("mems"), seed).run.imu
    found = align(imu, SITE, twin_of("rlg"), bias_sigma_deg_h=np.full(3, 0.01))
    assert found.verdict == "refused"
    codes = (AlignmentReason.NOTHING_MEASURED, AlignmentReason.NOTHING_STANDS)
    assert found.reasons[0].code in codes


def test_a_rest_in_which_no_step_stands_has_no_solution():
    """One line that names the noise."""
    imu = flown(ideal(75.0), twin_of("mems"), 1).run.imu
    prior = BiasPrior(np.array([0.0, 1e4]), np.eye(3) * (0.01 * DEG_PER_HOUR) ** 2)
    log = RestedLog(imu, SITE, first_rest(seconds_of(imu)))
    with pytest.raises(NothingStands):
        solve(log, twin_of("rlg"), prior, course=Course(parked_only=True))
