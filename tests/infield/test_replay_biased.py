"""Replay of MEMS logs whose gyros read any bias: no heading at rest, and the aided solution all the
same.
"""

from dataclasses import replace

import numpy as np
import pytest

from infield.replay.free_inertial import TableChoice, replay
from infield.reports.documents.replay import replay_document
from infield.reports.page import significant
from infield.reports.replay_page import render
from ins.units import DEG_PER_HOUR
from ins.verdicts import sentences
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
    assert any(
        note.startswith("no free-inertial flight: gyro uncertainty")
        for note in sentences(found.notes)
    )
    assert found.aided is not None
    assert found.aided.history is not None
    assert found.aided.verdict == "aided"
    page = render(replay_document(found, twin, store=None, version="1"))
    assert "No heading from rest (level only)" in page and "Aligned heading" not in page


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (4.15e-4, "0.000415"),
        (0.162, "0.162"),
        (12.34, "12.3"),
        (1234.5, "1234"),
        (0.0, "0.00"),
        (float("nan"), "n/a"),
        (-2.5e-6, "\u22120.00000250"),
    ],
)
def test_three_digits_of_any_size(value, text):
    assert significant(value) == text
