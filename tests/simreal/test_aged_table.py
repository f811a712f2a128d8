"""A table that has aged: named as that and as nothing else, weighed with its own covariance, never
taken out of a log.

The tables' errors are drawn here, from the formula of formats.md section 2 in numpy.
"""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from infield.table.file import table_from_dict
from infield.table.thermal_table import default_table
from ins.errors.catalogue import catalogue
from ins.errors.table import TABLE_AGED
from simreal.declared.generic import table_errors
from simreal.inference.bank import Group, Hypothesis
from simreal.inference.causes import Cause, Rival, judged, parameter_of
from simreal.inference.diagnosis import DiagnosisSettings, diagnose
from simreal.inference.scoring import Scorer, fit
from simreal.inference.verdict import GapVerdict, KeptOut
from simreal.report.diagnosis_document import DiagnosisRequest, diagnosis_document, summary
from simreal.twin.write_back import effect_items, fitted_items, twin_with_causes
from tests.simreal.diagnosed import NAMES, trial

SIGMA_DEG_H = 0.0072
RIVALS = (
    *NAMES,
    "gyro_thermal_linear",
    "gyro_g_sensitivity",
    "compensation_misapplied",
    "gyro_scale_thermal",
)


def aged(table: dict, **shift_deg_h) -> dict:
    """The table less a shift of each gyro that grows by half over 60 degC, of that sigma."""
    axes = {}
    for axis, of_axis in table["axes"].items():
        nodes = np.array(of_axis["temperature_degC"])
        change = shift_deg_h.get(axis, 0.0) * (1.0 + (nodes - 20.0) / 120.0)
        axes[axis] = {
            **of_axis,
            "bias_deg_h": (np.array(of_axis["bias_deg_h"]) - change).tolist(),
            "sigma_deg_h": [SIGMA_DEG_H] * nodes.size,
        }
    return {**table, "axes": axes}


def diagnosed_with(made, table):
    settings = DiagnosisSettings(
        effects=tuple(e for e in catalogue() if e.name in RIVALS), replicates=100
    )
    return diagnose(made.runs, made.twin, table_from_dict(table, name="table"), settings)


@pytest.fixture(scope="module")
def found():
    made = trial(None, 0.0, 4, "four_parked", 0)
    return diagnosed_with(made, aged(made.table, z=0.013))


def test_an_aged_table_is_named_and_nothing_else(found):
    (cause,) = found.causes
    assert found.verdict is GapVerdict.EXPLAINED
    assert (cause.effect, cause.target) == (TABLE_AGED, "gyro_z")
    shift = cause.parameters["shift"]
    mean = float(np.mean(0.013 * (1.0 + (np.array(cause.nodes) - 20.0) / 120.0)))
    assert abs(shift.value - mean) < 3.0 * shift.sigma < 0.01
    assert not found.unexplained.present


def test_an_aged_table_asks_for_an_update_and_is_never_taken_out_of_a_log(found):
    (cause,) = found.causes
    assert cause.kept_out is KeptOut.TABLE_AGED
    assert effect_items(cause, []) == fitted_items(cause, []) == []
    names = [v.name for v in found.views]
    assert not twin_with_causes(found.twin, found.causes, names, with_table=True)["effects"]
    asked = DiagnosisRequest(version="1", seed=0, runs=("run 1", "run-2"))
    document = diagnosis_document(found, trial(None, 0.0, 4, "four_parked", 0).runs, asked)
    assert document.causes[0].advice == "recal update 'run 1' run-2"
    assert document.causes[0].advice in "\n".join(summary(document))
    assert document.open == ()
    of_a_table = summary(replace(document, table_sha256="0" * 64))
    assert summary(document) != of_a_table  # a first table is made, an old one renewed


def test_a_wide_sigma_alone_is_no_gap():
    made = trial(None, 0.0, 4, "four_parked", 0)
    assert diagnosed_with(made, aged(made.table)).verdict is GapVerdict.NO_GAP


@pytest.mark.parametrize("axis", ["x", "y"])
def test_an_effect_is_found_beside_an_aged_table(axis):
    """On the gyro of the effect, and on another one."""
    made = trial("gyro_thermal_rate", 8.0, 4)
    found = diagnosed_with(made, aged(made.table, **{axis: 0.013}))
    named = {(c.effect, c.target) for c in found.causes}
    assert (made.truth[0].effect, made.truth[0].target) in named
    assert named <= {("gyro_thermal_rate", made.truth[0].target), (TABLE_AGED, f"gyro_{axis}")}


def test_a_line_of_temperature_and_an_aged_table_are_named_together():
    """What a table over temperature holds is what an aged one is: the runs cannot tell."""
    made = trial("gyro_thermal_linear", 2.0, 4)
    found = diagnosed_with(made, aged(made.table))
    sets = [{c.effect, *(r.effect for r in c.rivals)} for c in found.causes]
    assert any({"gyro_thermal_linear", TABLE_AGED} <= names for names in sets)


@pytest.mark.parametrize("interpolation", ["linear", "hermite"])
def test_the_errors_of_a_table_have_its_covariance(interpolation):
    """At any temperatures, as the update has it: h P h', with nodes beyond its own."""
    table = default_table(
        imu_serial="S",
        gyro_technology="rlg",
        created_utc="2026-01-01T00:00:00Z",
        interpolation=interpolation,
    )
    T = np.linspace(5.0, 85.0, 30)
    run = SimpleNamespace(n=30, temperature_degC=np.stack([T, T, T], axis=1))
    wide = table.extended_to(5.0, 85.0)
    for error in table_errors(table, [run]):
        series = error.hats(run) * 3600.0 * 180.0 / np.pi
        rows = wide.basis(error.target[-1], T)
        expected = rows @ wide.covariance @ rows.T
        assert np.abs(series @ series.T - expected).max() < 0.02 * expected.max()


def test_a_table_without_sigma_or_temperature_leaves_nothing_open():
    made = trial(None, 0.0, 4, "four_parked", 0)
    exact = {
        k: {**a, "sigma_deg_h": [0.0] * len(a["bias_deg_h"])} for k, a in made.table["axes"].items()
    }
    table = table_from_dict({**made.table, "axes": exact}, name="table")
    cold = SimpleNamespace(n=3, temperature_degC=None)
    warm = SimpleNamespace(n=3, temperature_degC=np.full((3, 3), 20.0))
    assert table_errors(table, [cold]) == () and table_errors(table, [warm]) == ()


def test_the_evidence_of_a_table_is_that_of_its_gaussian():
    """log N(z; 0, 1 + U U') - log N(z; 0, 1), and the coefficients' posterior."""
    rng = np.random.default_rng(8)
    U, z = rng.standard_normal((30, 3)), 2.0 * rng.standard_normal(30)
    group = Group({}, np.arange(3), np.ones(3), precision=1.0)
    table = Hypothesis(TABLE_AGED, "gyro_x", None, groups=[group])
    bank = SimpleNamespace(gram=U.T @ U + np.eye(3), score=U.T @ z, hypotheses=[table])
    found = Scorer(bank).groups_log_bf(np.zeros(0, int), bank.score[:, None])[0, 0]
    log_density = multivariate_normal(np.zeros(30), np.eye(30) + U @ U.T).logpdf(z)
    exact = multivariate_normal(np.zeros(30), np.eye(30)).logpdf(z)
    assert found == pytest.approx(log_density - exact, rel=1e-9)
    mean, covariance = fit(bank, np.arange(3))
    assert mean == pytest.approx(U.T @ np.linalg.solve(np.eye(30) + U @ U.T, z))
    assert covariance == pytest.approx(
        np.eye(3) - U.T @ np.linalg.solve(np.eye(30) + U @ U.T, U), abs=1e-9
    )


USUAL = (0.0003, 0.003)
SENSED = Cause(
    effect="gyro_g_sensitivity",
    target="gyro_z",
    id="gyro_g_sensitivity",
    probability=0.97,
    parameters={"coefficient": parameter_of(0.002, 0.0002, "deg/h/g", USUAL)},
    run_id=None,
    size=12.0,
)
ALIKE = Rival("gyro_thermal_lag", "gyro_z", 0.3, 0.99)
UNLIKE = Rival("gyro_thermal_lag", "gyro_z", 0.3, 0.5)
SUBJECT = Rival("gyro_thermal_linear", "gyro_z", 0.3, 0.99)
AGED = Rival(TABLE_AGED, "gyro_z", 0.0, 0.99)
LARGE = {"coefficient": parameter_of(0.0165, 0.002, "deg/h/g", USUAL)}


@pytest.mark.parametrize(
    "changes,expected",
    [
        ({}, None),
        ({"parameters": LARGE}, KeptOut.IMPLAUSIBLE),
        ({"rivals": (AGED,)}, KeptOut.NOT_UNIQUE),
        ({"probability": 0.6, "rivals": (ALIKE,)}, None),
        ({"probability": 0.6, "rivals": (UNLIKE,)}, KeptOut.NOT_UNIQUE),
        ({"probability": 0.6, "rivals": (SUBJECT,)}, KeptOut.NOT_UNIQUE),
        ({"effect": "gyro_thermal_linear", "probability": 0.6, "rivals": (AGED,)}, None),
        ({"repeats": "S", "parameters": LARGE}, None),
        ({"effect": "slow_variation", "repeats": "S", "parameters": LARGE}, KeptOut.IMPLAUSIBLE),
        ({"effect": "gyro_turn_on_bias", "repeats": "P", "parameters": LARGE}, KeptOut.IMPLAUSIBLE),
        ({"target": "odometer", "parameters": LARGE}, None),
    ],
)
def test_only_what_is_unique_and_plausible_is_taken_out_of_a_log(changes, expected):
    assert judged(replace(SENSED, **changes)).kept_out is expected


def test_what_is_open_is_said_with_what_settles_it(found):
    one = judged(replace(SENSED, parameters=LARGE))
    asked = DiagnosisRequest(version="1", seed=0)
    runs = trial(None, 0.0, 4, "four_parked", 0).runs
    open_ = replace(found, causes=(one,))
    document = diagnosis_document(open_, runs, asked, settled_by=[["Tumble the unit."]])
    (item,) = document.open
    assert item.why is KeptOut.IMPLAUSIBLE and "Tumble the unit." in item.settled_by
    assert item.twin_effects[0]["parameters"] == {"coefficient": 0.0165}
    assert document.causes[0].twin_effects == ()
