"""Effects that a twin lists leave the log before an update compares it with the table."""

from dataclasses import replace

import numpy as np
import pytest

from infield.reports.update_page import update_html
from infield.thermal.found_effects import FoundEffect, with_effect_sigma, without_effects
from ins.twin_file import default_twin, twin_from_dict, twin_to_dict
from ins.units import DEG_PER_HOUR, MICRO_G
from recal.service.inputs.twin_table import without_found_effects
from recal.service.update import update
from simreal.evidence.run_view import view_run
from tests.simreal.runs import PARKED, simulated, table, twin_of

COEFFICIENT, SIGMA = 0.05, 0.004


def listed(effect="gyro_thermal_rate", target="gyro_y", **more):
    parameters = {"coefficient": COEFFICIENT}
    return {"effect": effect, "target": target, "parameters": parameters, **more}


def rates(run):
    log = run.imu.whole()
    return log.dtheta_rad / log.dt_s[:, None]


def test_a_found_effect_leaves_the_log_as_far_as_it_goes_with_the_rate_of_temperature():
    run = simulated(segments=PARKED).run
    twin = twin_of(effects=(listed(sigma={"coefficient": SIGMA}),))
    (less,), widened, said = without_found_effects([run], twin, table())
    gone = (rates(run) - rates(less)) / DEG_PER_HOUR
    view = view_run(run, 0, table(), twin)
    expected = COEFFICIENT * view.telemetry.temperature_rate_degC_min[:, 1]
    assert np.abs(gone[:, [0, 2]]).max() < 1e-9
    assert np.corrcoef(gone[::10, 1][: expected.size], expected)[0, 1] > 0.999
    assert gone[:, 1].mean() == pytest.approx(expected.mean(), rel=1e-3)
    assert less.sha256 == run.sha256
    (one,) = said
    assert one.rms_deg_h["y"] == pytest.approx(np.sqrt(np.mean(expected**2)), rel=1e-3)
    assert one.sigma_deg_h["y"] == pytest.approx(one.rms_deg_h["y"] * SIGMA / COEFFICIENT, rel=1e-6)
    assert "gyro_thermal_rate" in one.text
    assert widened.gyro.turn_on_deg_h == pytest.approx(
        np.hypot(twin.gyro.turn_on_deg_h, one.sigma_deg_h["y"])
    )


@pytest.mark.parametrize(
    "item",
    [
        listed("gyro_thermal_linear"),  # what the table itself learns
        listed("gyro_angle_random_walk"),  # a noise
        {**listed(), "parameters": {"coefficient": COEFFICIENT, "run_id": "another"}},
    ],
)
def test_what_the_table_learns_and_what_has_no_columns_stays_in_the_log(item):
    run = simulated(segments=PARKED).run
    twin = twin_of(effects=(item,))
    runs, same, said = without_found_effects([run], twin, table())
    assert runs[0] is run and same is twin and said is None


def test_accelerometers_lose_their_effect_too():
    run = simulated(segments=PARKED).run
    time_s = np.array([0.0, run.imu.end_s])
    push = np.tile([0.0, 10.0 * MICRO_G, 0.0], (2, 1))
    zero = np.zeros((2, 3))
    found = FoundEffect("accel_thermal", "accel_y", time_s, zero, push, zero)
    before, after = run.imu.whole(), without_effects(run, [found]).imu.whole()
    gone = (before.dv_m_s - after.dv_m_s) / before.dt_s[:, None]
    np.testing.assert_allclose(gone.mean(axis=0), [0.0, 10.0 * MICRO_G, 0.0], atol=1e-10)
    assert with_effect_sigma(twin_of(), [[], []]) == twin_of()


def test_a_twin_file_keeps_the_sigma_of_what_was_found():
    twin = replace(default_twin("rlg"), effects=(listed(sigma={"coefficient": SIGMA}),))
    again = twin_from_dict(twin_to_dict(twin), source="twin.json", name="twin.json")
    assert again.effects[0]["sigma"] == {"coefficient": SIGMA}


def test_the_report_has_the_result_without_the_effects_beside_the_one_with():
    run = simulated(segments=PARKED).run
    item = {**listed(sigma={"coefficient": SIGMA}), "parameters": {"coefficient": 0.1}}
    result = update(run, table(), twin_of(effects=(item,)))
    both = result.record.effects_compared
    assert both is not None and both.taken_out.verdict == result.verdict
    # an effect that is not there, taken out, contradicts the table
    assert (both.left_in.verdict, both.taken_out.verdict) == ("proposed", "inconsistent")
    assert both.taken_out.nis_mean > both.left_in.nis_mean
    page = update_html(result.record)
    assert "effects left in" in page and f"{both.left_in.merge_nis:.2f}" in page
    assert "  with the effects left in: proposed" in result.lines()
    assert update(run, table(), twin_of()).record.effects_compared is None
