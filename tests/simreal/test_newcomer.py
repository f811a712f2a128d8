"""The newcomer's test: an error of one file is simulated, found, planned for, estimated in an
update, taken out of a log and stands in the reference, by its entry point alone.
"""

import importlib.util
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import chi2

import recal
from infield.session.one_run import take_run
from infield.session.pipeline import update_calibration
from infield.session.settings import SessionSettings
from ins.documents import to_json
from ins.errors import catalogue as module
from ins.errors.base import GYROS, ShapeParameter
from ins.errors.catalogue import effects_named, rivals_of
from ins.errors.prior import Prior
from ins.errors.reference import words_page
from ins.errors.telemetry import Trace
from ins.records import InputError
from ins.units import DEG_PER_HOUR
from ins.verdicts import sentence
from recal.service.inputs.twin_table import without_found_effects
from simreal.declared.twin_effects import parse_effects
from simreal.evidence.run_view import view_run
from simreal.inference.diagnosis import DiagnosisSettings, diagnose
from simreal.plan.gram import RunGrams
from simreal.plan.pairs import assess, read_pair
from simreal.twin.inject import injected
from tests.simreal.diagnosed import NAMES
from tests.simreal.runs import FLIGHT, PARKED, simulated, table, twin_of

EXAMPLE = Path(__file__).parents[2] / "examples/magnetic_axis.py"
NAME, TARGET, DEG_H_PER_GAUSS = "gyro_axial_field", "gyro_y", 0.3
UNIT = "deg/h per gauss"
HEADINGS = (0.0, 100.0, 190.0, 280.0)
SEEDS = 20
TABLE_DEG_H = 0.02
LOW, HIGH = chi2.ppf([0.005, 0.995], 3 * SEEDS)  # of the means of three gyros in each session


class Point:
    name, group, value = "axial_field", module.GROUPS[0], "magnetic_axis:AXIAL_FIELD"

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


@pytest.fixture(scope="module")
def drawn(installed):
    """Taxis with coefficients drawn from the prior, their truth (3,), and the runs without them."""
    sigma = effects_named(NAME)[0].prior("session").size
    made = []
    for seed in range(SEEDS):
        plain = simulated(seed=seed)
        rng = np.random.default_rng([seed, 5])
        truth = sigma * rng.standard_normal(3)
        telemetry = view_run(plain.run, 0, table(), twin_of()).telemetry
        listed = [
            {"effect": NAME, "target": gyro, "parameters": {"coefficient": float(size)}}
            for gyro, size in zip(GYROS, truth)
        ]
        effects = parse_effects(twin_of(effects=tuple(listed)))
        made.append((injected(plain.run, telemetry, effects, rng).run, truth, plain))
    return made


def mean_errors(run, plain):
    """The session's estimate, and its mean biases (3,) less the true ones over their sigmas."""
    estimate = take_run(run, table(), twin_of(), SessionSettings(), repeated=False).estimate
    bins = estimate.bins
    spans = zip(bins.start_s, bins.end_s)
    of_bins = [(plain.bias_time_s > a) & (plain.bias_time_s <= b) for a, b in spans]
    true = np.array([plain.gyro_bias_true_deg_h[rows].mean(axis=0) for rows in of_bins])
    error = (bins.table_deg_h + estimate.mean_deg_h).reshape(-1, 3) - true
    mean = np.kron(np.full(len(true), 1.0 / len(true)), np.eye(3))
    return estimate, error.mean(axis=0) / np.sqrt(np.diag(mean @ estimate.covariance @ mean.T))


@pytest.mark.slow
def test_an_update_that_estimates_it_is_honest_about_biases_and_coefficients(drawn, monkeypatch):
    biases, coefficients, blind = 0.0, 0.0, 0.0
    for run, truth, plain in drawn:
        estimate, off = mean_errors(run, plain)
        own = estimate.own.errors
        assert [error.target for error in own] == list(GYROS)
        found = np.array([(error.value, error.sigma) for error in own])
        biases += np.sum(off**2)
        coefficients += np.sum(((found[:, 0] - truth) / found[:, 1]) ** 2)
    with monkeypatch.context() as patch:
        patch.setattr(module, "entry_points", lambda group: [])
        module.catalogue.cache_clear()
        for run, _, plain in drawn:
            blind += np.sum(mean_errors(run, plain)[1] ** 2)
    module.catalogue.cache_clear()
    assert LOW < biases < HIGH
    assert LOW < coefficients < HIGH
    assert blind > 2.0 * HIGH


def test_an_update_reports_it_with_its_sigma(drawn, tmp_path):
    run, truth, _ = drawn[0]
    result = recal.update(run, table(), twin_of())
    (session,) = json.loads(to_json(result.record))["sessions"]
    for error, size in zip(session["own_errors"], truth, strict=True):
        assert (error["error"], error["state"], error["unit"]) == (NAME, "estimated", UNIT)
        assert abs(error["value"] - size) < 3.0 * error["sigma"] < 3.0 * error["prior_sigma"]
        assert any(error["text"] in line for line in result.lines())
    page = result.to_html(tmp_path / "update.html").read_text("utf-8")
    assert all(e["text"].replace(" +- ", " \u00b1 ") in page for e in session["own_errors"])


def test_runs_of_one_update_have_it_in_common(drawn):
    """The field down is the same on all headings: of gyro z no number of sessions tells error and
    bias apart, so that three know the bias no better than the prior of the error lets one.
    """
    wide = table()
    n = wide.n_parameters // 3
    of_axis = TABLE_DEG_H**2 * (0.98 + 0.02 * np.eye(n))
    wide = wide.replaced(covariance=np.kron(np.eye(3), of_axis))
    runs = []
    for k, (run, _, _) in enumerate(drawn[:3]):
        header = replace(run.header, run_id=f"taxi-{k}", start_utc=f"2026-03-0{k + 1}T05:00:00Z")
        runs.append(replace(run, header=header, sha256=str(k) * 64))
    result = update_calibration(runs, wide, twin_of())
    assert len(result.merged_runs) == 3
    estimate = result.sessions[0].estimate
    row = estimate.bins.H[2::3].mean(axis=0)
    sigma = np.sqrt(row @ result.after.covariance @ row)
    of_error = estimate.own.in_common[2][2::3].mean()
    assert sigma > 1.0 / np.hypot(1.0 / of_error, 1.0 / TABLE_DEG_H)


@pytest.mark.parametrize(
    ("changes", "state"),
    [
        ({"shape": (ShapeParameter("lag", "s", 1.0, 10.0, 3),)}, "not_constant"),
        ({"priors": (Prior("session", UNIT, 0.03, scale=60.0, scale_unit="s"),)}, "not_constant"),
        ({"formula": lambda run, target, shape: (Trace(lateral_m_s=run.speed_m_s),)}, "no_trace"),
        ({"formula": lambda run, target, shape: (Trace(-run.vibration_m2_s4),)}, "no_trace"),
    ],
)
def test_what_is_not_estimated_is_reported(drawn, monkeypatch, changes, state):
    (error,) = effects_named(NAME)
    found = estimate_with(replace(error, **changes), drawn, monkeypatch)
    assert {one.state.value for one in found} == {state}
    assert all(one.value is None and NAME in sentence(one.reason) for one in found)


@pytest.mark.parametrize(
    ("trace_of", "said"),
    [
        (lambda run: Trace(np.full((run.n, 3), np.nan)), "is not finite"),
        (lambda run: Trace(np.ones((run.n - 5, 3))), "trace of shape"),
        (lambda run: Trace(np.ones(run.n)), "trace of shape"),
        (lambda run: Trace(np.ones(3)[run.n]), "its traces raise IndexError"),
    ],
)
def test_a_trace_that_is_none_is_refused_by_name(drawn, monkeypatch, trace_of, said):
    (error,) = effects_named(NAME)
    broken = replace(error, formula=lambda run, target, shape: (trace_of(run),))
    with pytest.raises(InputError, match=f"error {NAME} on gyro_x: .*{said}"):
        estimate_with(broken, drawn, monkeypatch)


@pytest.mark.parametrize("sigma", [0.0, -1.0, np.nan, np.inf])
def test_a_prior_without_a_size_is_refused(drawn, monkeypatch, sigma):
    (error,) = effects_named(NAME)
    other = replace(error, priors=(Prior("session", "deg/h per gauss", sigma),))
    with pytest.raises(InputError, match=r"prior sigma .* needed above 0"):
        estimate_with(other, drawn, monkeypatch)


def test_a_prior_in_another_unit_is_refused(drawn, monkeypatch):
    (error,) = effects_named(NAME)
    other = replace(error, priors=(Prior("session", "deg/h", 0.03),))
    with pytest.raises(InputError, match="prior in 'deg/h', needed 'deg/h per gauss'"):
        estimate_with(other, drawn, monkeypatch)


def test_one_that_the_twin_lists_is_not_estimated(runs, twin, monkeypatch):
    run = runs[0]
    result = take_run(run, table(), twin, SessionSettings(), repeated=False)
    of_target = {error.target: error.state.value for error in result.estimate.own.errors}
    assert of_target == {"gyro_x": "estimated", TARGET: "in_twin", "gyro_z": "estimated"}


def test_a_flight_estimates_it_too(installed):
    run = simulated(segments=FLIGHT, aids=True).run
    result = take_run(run, table(), twin_of(), SessionSettings(), repeated=False)
    assert result.flight.joined is not None
    errors = result.estimate.own.errors
    assert [error.target for error in errors] == list(GYROS)
    for error in errors:
        assert abs(error.value) < 3.0 * error.sigma
        assert error.sigma < error.prior_sigma


def test_a_session_without_a_heading_says_that_it_does_not_estimate_it(installed):
    run = simulated(segments=PARKED, technology="mems").run
    result = take_run(run, table("mems"), twin_of("mems"), SessionSettings(), repeated=False)
    assert {error.state.value for error in result.estimate.own.errors} == {"no_heading"}


def estimate_with(error, drawn, monkeypatch):
    """Own errors of the first taxi, with another declaration in place of the file's."""
    monkeypatch.setattr(module, "catalogue", lambda: (*module.OWN, error))
    return mean_errors(drawn[0][0], drawn[0][2])[0].own.errors


def test_a_plan_asks_for_headings_and_tells_it_from_a_warm_up(runs):
    pair = read_pair(f"{NAME},gyro_warmup_transient")
    views = [view_run(run, k, table(), twin_of()) for k, run in enumerate(runs)]
    grams = [RunGrams(view, twin_of(), [pair.a, pair.b]) for view in views]
    one, two, four = (assess(grams[:count], pair) for count in (1, 2, 4))
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
