"""The bank of hypotheses: usual sizes of the free functions that compete with the named effects."""

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from benchmarks.gap_trials.trial import draw_trial
from infield.table.file import table_from_dict
from ins.errors.base import ACCELS, GYROS
from ins.units import DEG_PER_HOUR, MICRO_G
from simreal.declared.generic import MOTION_SIZE
from simreal.evidence.run_view import RunView, view_run
from simreal.evidence.whitened import Evidence
from simreal.inference.bank import Bank

GYRO_TURN_ON_DEG_H, ACCEL_TURN_ON_UG = 0.005, 45.0


@lru_cache(maxsize=1)
def free_scales() -> dict[str, np.ndarray]:
    """Usual coefficients of all free functions, by target, of a unit with these turn-on sigmas."""
    trial = draw_trial(73, effects=0, plan="four", parked_s=600.0)
    table = table_from_dict(trial.table, name="trial")
    twin = replace(
        trial.twin,
        gyro=replace(trial.twin.gyro, turn_on_deg_h=GYRO_TURN_ON_DEG_H),
        accel=replace(trial.twin.accel, turn_on_ug=ACCEL_TURN_ON_UG),
    )
    view = view_run(trial.runs[0], 0, table, twin)
    assert isinstance(view, RunView)
    bank = Bank(Evidence([view], twin), ())
    targets = {h.target for h in bank.hypotheses}
    return {
        target: np.concatenate(
            [g.scale for h in bank.hypotheses if h.target == target for g in h.groups]
        )
        for target in targets
    }


@pytest.mark.parametrize("target", MOTION_SIZE)
def test_a_free_function_of_the_motion_has_the_size_that_would_matter_there(target):
    np.testing.assert_allclose(free_scales()[target], MOTION_SIZE[target])


@pytest.mark.parametrize("target", GYROS)
def test_a_free_function_on_a_gyro_has_the_size_of_the_turn_on_bias(target):
    np.testing.assert_allclose(free_scales()[target], GYRO_TURN_ON_DEG_H * DEG_PER_HOUR)


@pytest.mark.parametrize("target", ACCELS)
def test_a_free_function_on_an_accelerometer_has_the_size_of_the_turn_on_bias(target):
    np.testing.assert_allclose(free_scales()[target], ACCEL_TURN_ON_UG * MICRO_G)
