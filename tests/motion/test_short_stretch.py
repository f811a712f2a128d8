"""Stretches too short to rest in."""

import numpy as np
import pytest

from alignment.motion.inertial import first_rest
from alignment.motion.seconds import seconds_of
from ins.records import ImuLog


@pytest.mark.parametrize("seconds", [1, 9, 15, 49])
def test_less_than_a_minute_is_no_rest(seconds):
    """However little there is to take a median of."""
    rows = 10 * seconds
    rest = np.tile([0.0, 0.0, -0.981], (rows, 1))
    log = ImuLog(
        time_s=0.1 * np.arange(1, rows + 1),
        dt_s=np.full(rows, 0.1),
        dtheta_rad=np.zeros((rows, 3)),
        dv_m_s=rest,
    )
    assert first_rest(seconds_of(log)) is None
