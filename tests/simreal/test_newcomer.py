"""The newcomer's test: an error of one file is simulated, found, planned for, taken out of a log
and stands in the reference, by its entry point alone.
"""

import importlib.util
from pathlib import Path

import numpy as np
import pytest

from ins.errors import catalogue as module
from ins.errors.catalogue import effects_named, rivals_of
from ins.errors.reference import words_page
from ins.units import DEG_PER_HOUR
from recal.service.inputs.twin_effects import without_found_effects
from simreal.declared.twin_effects import parse_effects
from simreal.evidence.run_view import view_run
from simreal.inference.diagnosis import DiagnosisSettings, diagnose
from simreal.plan.gram import RunGrams
from simreal.plan.pairs import judge, read_pair
from simreal.twin.inject import injected
from tests.simreal.diagnosed import NAMES
from tests.simreal.runs import PARKED, simulated, table, twin_of

EXAMPLE = Path(__file__).parents[2] / "examples/magnetic_axis.py"
NAME, TARGET, DEG_H_PER_GAUSS = "gyro_axial_field", "gyro_y", 0.3
HEADINGS = (0.0, 100.0, 190.0, 280.0)


class Point:
    name = "axial_field"

    def load(self):
        spec = importlib.util.spec_from_file_location("magnetic_axis", EXAMPLE)
        loaded = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(loaded)
        return loaded.AXIAL_FIELD


@pytest.fixture(scope="module", autouse=True)
def installed():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "entry_points", lambda group: [Point()])
        module.catalogue.cache_clear()
        yield
    module.catalogue.cache_clear()


@pytest.fixture(scope="module")
def twin(installed):
    parameters = {"coefficient": DEG_H_PER_GAUSS}
    return twin_of(effects=({"effect": NAME, "target": TARGET, "parameters": parameters},))


@pytest.fixture(scope="module")
def runs(twin):
    """Parked runs on four headings, with the error that the twin's file lists."""
    made = []
    for k, heading in enumerate(HEADINGS):
        run = simulated(seed=k, segments=PARKED, heading_deg=heading).run
        telemetry = view_run(run, k, table(), twin).telemetry
        rng = np.random.default_rng(k)
        made.append(injected(run, telemetry, parse_effects(twin), rng).run)
    return made


def test_it_is_one_file_of_at_most_80_lines():
    assert len(EXAMPLE.read_text("utf-8").splitlines()) <= 80


def test_it_is_found_with_its_size_in_runs_that_were_simulated_with_it(runs):
    names = (*NAMES, "gyro_misalignment", NAME)
    effects = tuple(effect for name in names for effect in effects_named(name))
    settings = DiagnosisSettings(effects=effects, replicates=100)
    (cause,) = diagnose(runs, twin_of(), table(), settings).causes
    assert (cause.effect, cause.target) == (NAME, TARGET)
    found = cause.parameters["coefficient"]
    assert found.value == pytest.approx(DEG_H_PER_GAUSS, abs=3.0 * found.sigma)
    assert found.sigma < 0.1 * DEG_H_PER_GAUSS


def test_a_plan_asks_for_headings_and_tells_it_from_a_warm_up(runs):
    pair = read_pair(f"{NAME},gyro_warmup_transient")
    views = [view_run(run, k, table(), twin_of()) for k, run in enumerate(runs)]
    grams = [RunGrams(view, twin_of(), [pair.a, pair.b]) for view in views]
    one, two, four = (judge(grams[:count], pair) for count in (1, 2, 4))
    assert one.lacks == "several headings"
    assert four.cos < 0.5
    assert 0.0 < two.margin_high < four.margin_high


def test_an_update_takes_it_out_of_its_log(runs, twin):
    (less,), _, said = without_found_effects(runs[1:2], twin, table())
    plain = simulated(seed=1, segments=PARKED, heading_deg=HEADINGS[1]).run.imu.whole()
    before, after = runs[1].imu.whole(), less.imu.whole()
    added, left = (
        np.sum(log.dtheta_rad - plain.dtheta_rad, axis=0) / np.sum(log.dt_s) / DEG_PER_HOUR
        for log in (before, after)
    )
    assert abs(added[1]) > 0.03
    assert abs(left[1]) < 0.02 * abs(added[1])
    assert NAME in said[0].text


def test_it_stands_in_the_reference(installed):
    page = words_page()
    assert f"| `{NAME}` |" in page and f"### {NAME}" in page
    (rival,) = effects_named("gyro_magnetic_sensitivity")
    assert NAME in rivals_of(rival)
