"""What a twin predicts of the update of a run that it was not fitted to."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import ncx2

from ins.records import InputError
from ins.twin_file import default_twin
from recal.service.diagnose import diagnose
from simreal.declared.twin_effects import parse_effects
from simreal.predict.carried import foretells, with_noise_of
from simreal.predict.document import simulator_lines, simulator_record
from simreal.predict.held_out import predict_runs
from simreal.predict.measures import Deviation, gap_of, gone_of, nis_gone_of, nis_of, noncentrality
from tests.simreal.diagnosed import diagnosed, table_from_dict, trial

HELD = "trial-00004-4"


def deviation(values, sigma=1.0):
    values = np.atleast_1d(np.asarray(values, dtype=float))
    return Deviation(values, sigma**2 * np.eye(values.size))


def test_the_gap_of_noise_alone_is_bounded_from_zero():
    gap = gap_of([deviation([1.0]), deviation([-1.0])])
    assert gap.value == 0.0 and gap.interval_95[0] == 0.0
    assert gap.measured == pytest.approx(1.0) and gap.noise == pytest.approx(1.0)


def test_the_gap_is_in_the_unit_of_the_quantity():
    small = gap_of([deviation([3.0, 4.0]), deviation([4.0, 3.0])])
    large = gap_of([deviation([30.0, 40.0], 10.0), deviation([40.0, 30.0], 10.0)])
    assert large.value == pytest.approx(10.0 * small.value)
    assert large.interval_95 == pytest.approx([10.0 * v for v in small.interval_95], rel=1e-6)
    assert small.value == pytest.approx(np.sqrt(25.0 - 2.0))


@pytest.mark.parametrize("centre", [0.5, 4.0, 40.0])
def test_its_interval_covers_95_of_100_draws(centre):
    for level in (0.03, 0.5, 0.97):
        low, high = noncentrality(float(ncx2.ppf(level, 6.0, centre)), 6.0)
        assert low < centre < high
    assert noncentrality(float(ncx2.ppf(0.98, 6.0, centre)), 6.0)[0] > centre
    assert noncentrality(float(ncx2.ppf(0.02, 6.0, centre)), 6.0)[1] < centre


def test_with_unequal_variances_the_interval_still_covers():
    rng = np.random.default_rng(6)
    sigma, truth = np.array([0.2, 0.5]), np.array([0.5, 0.3])
    inside = 0
    for _ in range(100):
        runs = [
            Deviation(truth + sigma * rng.standard_normal(2), np.diag(sigma**2)) for _ in range(4)
        ]
        low, high = gap_of(runs).interval_95
        inside += low <= float(np.linalg.norm(truth)) <= high
    # 95 +- 2.2 of 100; 3 sigma
    assert abs(inside - 95) <= 7


def test_all_of_a_gap_that_is_gone_is_gone():
    before = [deviation([9.0, 0.5]), deviation([-8.0, 0.3])]
    after = [deviation([0.4, 0.5]), deviation([0.2, 0.3])]
    gone = gone_of(before, after)
    assert gone.fraction > 0.98 and gone.interval_95[0] > 0.7
    assert gone_of(before, before).fraction == 0.0
    assert nis_of(after).measured < 1.0 < nis_of(before).value
    nis = nis_gone_of(before, after)
    assert nis.fraction == 1.0 and 0.5 < nis.interval_95[0] < nis.interval_95[1] <= 1.0
    assert nis_gone_of(after, after).interval_95 == (-1.0, 1.0)


def effects(*items):
    return parse_effects(replace(default_twin("rlg"), effects=items))


def test_noise_goes_into_the_twins_numbers_and_events_of_one_run_nowhere():
    twin = default_twin("rlg")
    noise = {"effect": "gyro_angle_random_walk", "target": "gyro_x"}
    (added,) = effects({**noise, "parameters": {"coefficient": 0.003}})
    (of_run,) = effects({**noise, "parameters": {"coefficient": 0.003, "run_id": "one"}})
    assert foretells(added) and not foretells(of_run)
    more = with_noise_of(twin, [added, of_run]).gyro.arw_deg_sqrt_h
    assert more == pytest.approx(np.sqrt(twin.gyro.arw_deg_sqrt_h**2 + 0.003**2 / 3.0))


@pytest.fixture(scope="module")
def simulator():
    made = trial()
    found = diagnosed(hold_out=(HELD,))
    table = table_from_dict(made.table, name="table")
    return predict_runs(made.runs, found, table, (HELD,))


def test_a_run_held_out_is_predicted_by_the_fit_to_the_others(simulator):
    (run,) = simulator.runs
    planted = trial().truth[0]
    assert run.run_id == HELD and HELD not in run.fitted_to and len(run.fitted_to) == 3
    assert (planted.effect, planted.target) in run.found and not simulator.unpredicted


def test_what_was_found_brings_the_prediction_to_the_measured(simulator):
    record = simulator_record(simulator)
    drift = next(q for q in record.quantities if q.quantity == "drift")
    nis = next(q for q in record.quantities if q.quantity == "nis")
    assert drift.before.interval_95[0] > 0.0 and drift.after.measured < 0.5 * drift.before.measured
    assert drift.gone.interval_95[0] > 0.5 and nis.after.measured < nis.before.measured
    said = "\n".join(simulator_lines(record))
    assert "beyond noise" in said and "gyro_thermal_rate" in said


def test_one_run_is_too_few():
    with pytest.raises(InputError, match=r"--simulator.*1.*needed 2"):
        diagnose("run-1", "twin.json", simulator=True)
