"""Requirements R4, R15 to R18 as rates: a few runs in the normal suite, 200 marked slow
(benchmarks/thermal_rates.py).
"""

import numpy as np
import pytest

from benchmarks.study import interval_95
from tests.scenarios import thermal_faults as faults
from tests.scenarios import thermal_merge as merge

FEW = [pytest.param(12, id="12"), pytest.param(200, id="200", marks=pytest.mark.slow)]
# see docs/reliability.md
UNDETECTABLE = {"a tenth": 0.95, "Fahrenheit, all gyros": 0.9, "a tenth, all gyros": 0.5}


def least(count, share):
    """The share is not below what is asked, beyond what so few runs can say (95 %)."""
    assert interval_95(count.hits, count.total)[1] >= share, count


@pytest.mark.parametrize("runs", FEW)
@pytest.mark.parametrize("fault", faults.FAULTS)
def test_r4_every_fault_is_found_and_no_other_axis_blamed(fault, runs):
    total, found, blamed = faults.found_rates(fault, runs)
    assert total >= 0.6 * runs and blamed <= 0.005 * runs
    least(merge.Count(found, total), UNDETECTABLE.get(fault, 0.99))


@pytest.mark.parametrize(
    "runs", [pytest.param(40, id="40"), pytest.param(400, id="400", marks=pytest.mark.slow)]
)
def test_r4_healthy_thermometers_raise_no_alarm(runs):
    assert faults.false_alarms(runs) <= 0.01 * runs


@pytest.mark.parametrize("runs", FEW)
def test_r4_rate_of_a_tenth_of_a_degree_thermometer(runs):
    errors = [faults.rate_error(seed) for seed in range(runs)]
    assert max(e.ours for e in errors) < 0.1 < max(e.moving_average for e in errors)
    assert 0.5 < np.mean([e.normalised for e in errors]) < 1.3  # the temperature's own sigma


@pytest.mark.parametrize("runs", FEW)
def test_r15_more_data_of_the_same_mean_leave_far_nodes(runs):
    least(merge.far_nodes(runs, same_mean=True), 0.9)
    least(merge.far_nodes(runs, same_mean=True, lengths=2.0), 0.99)


@pytest.mark.parametrize("runs", FEW)
@pytest.mark.parametrize("part", ["whole", "second half", "warm half"])
def test_r16_a_wrong_session_moves_no_settled_node(part, runs):
    least(merge.wrong_session(runs, before=3, part=part), 0.97)


@pytest.mark.parametrize("runs", FEW)
def test_r16_a_step_is_named_and_not_followed(runs):
    named, kept = merge.step_of_the_unit(runs, before=3)
    least(named, 0.97)
    least(kept, 0.97)


@pytest.mark.parametrize("runs", FEW)
def test_r16_r17_a_healthy_unit_raises_no_alarm(runs):
    stepped, contradicting, terms = merge.healthy_units(runs)
    assert stepped.hits == 0
    assert interval_95(contradicting.hits, contradicting.total)[0] <= 0.003
    assert interval_95(terms.hits, terms.total)[0] <= 0.05


@pytest.mark.parametrize("runs", FEW)
@pytest.mark.parametrize(("kind", "share"), [("rate", 0.95), ("sense", 0.9)])
def test_r17_a_split_of_three_point_sigmas_is_named(kind, share, runs):
    found = merge.split(runs, kind=kind, split_deg_h=3 * merge.POINT_DEG_H)
    least(found.named, share)
    if runs >= 200 and kind == "rate":
        assert 0.7 < found.normalised < 1.4


@pytest.mark.parametrize("runs", FEW)
def test_r18_the_same_run_again_changes_no_bit(runs):
    count = merge.same_run_twice(runs)
    assert count.hits == count.total


def test_the_interval_is_clopper_pearsons():
    # 1 - 0.025^(1/200)
    assert interval_95(0, 200) == (0.0, pytest.approx(0.01828, abs=1e-5))
    assert interval_95(200, 200)[0] == pytest.approx(0.025 ** (1 / 200))
