"""Replay of MEMS logs whose gyros read any bias: no heading at rest, and the aided solution all the same."""

from dataclasses import replace

import numpy as np
import pytest

from infield.replay import TableChoice, replay
from ins.units import DEG_PER_HOUR
from tests.infield.aided_cases import flown, ideal, twin_of

RAW = [TableChoice(role="active", table=None, origin="none")]


@pytest.mark.parametrize("bias_deg_h", [(0.0, 0.0), (35.0, 0.0), (20.0, 20.0), (110.0, -110.0)])
def test_the_gyro_bias_of_a_mems_unit_does_not_end_a_replay(bias_deg_h):
    twin = twin_of("mems")
    run = flown(ideal(160.0), twin, 3).run
    bias = np.array([*bias_deg_h, 0.0]) * DEG_PER_HOUR
    imu = replace(run.imu, dtheta_rad=run.imu.dtheta_rad + bias * run.imu.dt_s[:, None])
    found = replay(replace(run, imu=imu), RAW, twin)
    assert found.verdict == "replayed" and found.tables[0].alignment.verdict == "level_only"
    assert any(note.startswith("no free-inertial flight: gyro uncertainty") for note in found.notes)
    assert found.aided is not None and found.aided.history is not None and found.aided.verdict == "aided"
