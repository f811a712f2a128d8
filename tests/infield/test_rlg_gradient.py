"""Ring-laser gradient terms: by hand, over units whose truth the fit does not know, collinear and
refused cases (R19).
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from infield.reports.documents.rlg import about_zero, rlg_document
from infield.table.least_squares import NormalEquations, condition_number
from infield.thermal.reasons import ThermalNote
from infield.thermal.rlg.gradients import fit_gradients
from infield.thermal.rlg.model import model_from_document
from infield.thermal.rlg.terms import TERMS, columns, hold_apart, solve_terms
from ins.documents import plain
from ins.verdicts import codes, sentence, sentences
from tests.infield.gradient_cases import NAMES, TWIN, Unit, case, three_runs

FEW = 12  # units of three gyros in the normal suite


def test_the_terms_by_hand():
    """At 35 degC, reference 25, warming by 0.5 degC/min with lines 1, -2, 0.5: each column is a
    number one can write down.
    """
    row = columns(np.array([35.0]), np.array([0.5]), np.array([[1.0, -2.0, 0.5]]), 25.0)
    np.testing.assert_allclose(row[0], [1.0, 10.0, 100.0, 0.5, 5.0, 1.0, -2.0, 0.5])
    theta = np.array([0.01, 1e-3, 1e-5, 0.02, 1e-3, 0.03, 0.0, -0.02])
    assert row[0] @ theta == pytest.approx(0.01 + 0.01 + 0.001 + 0.01 + 0.005 + 0.03 - 0.01)


def test_least_squares_by_hand_and_the_condition_number_of_two_columns():
    """y = 2 on the first of two unit columns with cosine c: condition sqrt((1 + c) / (1 - c))."""
    c = 0.99
    A = np.eye(8)
    A[0, 3] = A[3, 0] = c
    normal = NormalEquations(A, A[:, 0] * 2.0, 4.0, 10)
    theta, P = solve_terms(normal, np.array([name in ("K1", "K4") for name in TERMS]))
    np.testing.assert_allclose(theta, [2.0, 0, 0, 0, 0, 0, 0, 0], atol=1e-12)
    np.testing.assert_allclose(P[0, 0], 1.0 / (1.0 - c**2))
    assert condition_number(A[np.ix_([0, 3], [0, 3])]) == pytest.approx(np.sqrt((1 + c) / (1 - c)))


def test_a_line_that_follows_the_rate_is_named_and_dropped_and_one_within_the_noise_too():
    rng = np.random.default_rng(1)
    T = 20.0 * rng.standard_normal(400)
    rate = rng.standard_normal(400)
    other = rng.standard_normal((400, 2))
    for off, noise, words in ((1e-3, 0.0, "condition number"), (0.2, 0.05, "noise of the")):
        X = columns(
            T, rate, np.column_stack([0.4 * rate + off * rng.standard_normal(400), other]), 0.0
        )
        kept, dropped = hold_apart(X.T @ X, 400 * np.r_[np.zeros(5), noise**2, 0, 0], TERMS, "K6x")
        if noise == 0.0 or off < 0.1:
            assert [f.term for f in dropped] == ["K6x"]
            assert dropped[0].others == ("K4",)
            assert words in sentence(dropped[0].why)
            assert "K6x" not in kept and "K6y" in kept
        else:
            assert [f.term for f in dropped] == ["K6x"]
            assert words in sentence(dropped[0].why)
            assert dropped[0].condition < 30.0


def test_without_noise_the_fit_is_the_truth():
    rng = np.random.default_rng(2)
    unit = Unit(rng)
    study = fit_gradients(three_runs(rng, unit, noise=1e-3), TWIN)
    assert study.axes and not study.notes and all(a.by_run for a in study.axes)
    for k, a in enumerate(study.axes):
        true = unit.terms(k, study.reference_degC)
        np.testing.assert_allclose(a.theta[3:8], true[3:], atol=2e-4)
        assert a.held_out.model_deg_h < 0.04 * a.held_out.before_deg_h
        assert a.condition.used < a.condition.all
        at_zero = about_zero(a, study.reference_degC)
        by_hand = unit.terms(k, 0.0)
        assert at_zero["K4"] == pytest.approx(by_hand[3], abs=3e-4) and at_zero["K6x"] == a.theta[5]


def over_units(count, wave=0.003):
    """Normalised errors of the rate and gradient terms, and the residuals of a further run, by seed
    and gyro.
    """
    nees, dof, residuals = [], [], []
    for seed in range(count):
        rng = np.random.default_rng(seed)
        unit = Unit(rng, wave=wave)
        study = fit_gradients(three_runs(rng, unit), TWIN)
        model = model_from_document(plain(rlg_document(study, version="")))
        for k, a in enumerate(study.axes):
            at = [j for j, name in enumerate(NAMES) if name in a.used and j >= 3]
            error = a.theta[at] - unit.terms(k, study.reference_degC)[at]
            nees.append(error @ np.linalg.solve(a.covariance[np.ix_(at, at)], error))
            dof.append(len(at))
        fresh = case(rng, unit, rate=0.9, side=(0.5, 0.4, -0.6), period=84, low=-12.0, high=37.0)
        b = fresh.blocks
        left = b.bias_deg_h - model.settled_deg_h(b.temperature_degC)
        left -= model.rates_deg_h(b.temperature_degC, b.rate_degC_min, fresh.gradient_degC)
        residuals.append([np.std(b.bias_deg_h, axis=0), np.std(left, axis=0)])
    return np.array(nees), np.array(dof), np.array(residuals)


@pytest.mark.slow
def test_errors_are_as_large_as_their_sigmas_over_units():
    """NEES of all kept rate and gradient terms within 99.9 % bounds, false alarm 1 in 1000."""
    nees, dof, residuals = over_units(FEW)
    low, high = chi2.ppf([0.0005, 0.9995], dof.sum())
    assert low < nees.sum() < high, (nees.sum() / dof.sum(), dof.sum())
    white = 0.0155  # of a minute
    assert np.all(residuals[:, 1] < 1.2 * white)
    assert np.median(residuals[:, 1] / residuals[:, 0]) < 0.5


def test_an_unforced_soak_names_the_line_that_goes_with_the_rate():
    """Tdiff = share tau dT/dt exactly where nothing heats one side: physics.md section 3."""
    rng = np.random.default_rng(3)
    unit = Unit(rng)
    study = fit_gradients(
        [case(rng, unit, heater=0.0, rate=r, run_id=str(r)) for r in (0.7, 1.1)], TWIN
    )
    for a in study.axes:
        assert f"K6{a.axis}" in [f.term for f in a.collinear] and f"K6{a.axis}" not in a.used
        assert next(f for f in a.collinear if f.term == f"K6{a.axis}").others == ("K4",)
        # their sum serves as well there
        assert a.held_out.model_deg_h < 1.4 * a.held_out.noise_deg_h
    dropped = [note for note in study.notes if note.code is ThermalNote.DROPPED]
    assert {note.values["axis"] for note in dropped} == {"x", "y", "z"}


def test_one_run_is_split_into_stretches_and_no_lines_are_said():
    rng = np.random.default_rng(4)
    unit = Unit(rng, gradients=0.0)
    study = fit_gradients([case(rng, unit, with_lines=False)], TWIN)
    assert "every fifth stretch" in study.validation and study.axes[0].by_run is None
    assert "no_gradient_column" in codes(study.notes)[0]
    for k, a in enumerate(study.axes):
        assert {"K1", "K4"} <= set(a.used)
        assert not [name for name in a.used if name.startswith("K6")]
        assert abs(a.theta[3] - unit.terms(k, study.reference_degC)[3]) < 4.0 * a.sigma[3]


def test_earth_rate_moves_k1_alone_and_a_new_mounting_is_seen():
    unit = Unit(np.random.default_rng(5))
    here = fit_gradients(three_runs(np.random.default_rng(6), unit), TWIN)
    there = fit_gradients(three_runs(np.random.default_rng(6), unit, earth=(9.0, -5.0, 0.0)), TWIN)
    for a, b in zip(here.axes, there.axes):
        np.testing.assert_allclose(a.theta[1:8], b.theta[1:8], atol=1e-7)
    assert [a.level_known for a in there.axes] == [False, False, True]
    runs = three_runs(np.random.default_rng(6), unit)
    runs[1] = replace(
        runs[1],
        blocks=replace(
            runs[1].blocks,
            roll_pitch_rad=(0.01, 0.0),
            bias_deg_h=runs[1].blocks.bias_deg_h + [3.0, -4.0, 0.0],
        ),
    )
    study = fit_gradients(runs, TWIN)
    assert study.remounted and "mounted_anew" in codes(study.notes)[0]
    for k, a in enumerate(study.axes):
        assert np.all(
            np.abs(a.theta[3:8] - unit.terms(k, study.reference_degC)[3:])[a.sigma[3:8] > 0] < 0.02
        )


@pytest.mark.parametrize(
    ("profile", "words"),
    [
        (dict(back=False, soak=0, heater=0.0, rate=0.8), "one-sided heating: the unit only warms"),
        (dict(turned=0.01), "moving base: run run turns by 0.57 deg"),
        (dict(low=20.0, high=24.0, heater=0.0), "temperature spans"),
        (dict(low=0.0, high=8.0, soak=0, back=False, rate=1.0), "too short: run run has 8 min"),
        (
            dict(low=0.0, high=40.0, soak=0, back=False, rate=1.0),
            "too short: 40 min of rest in all",
        ),
    ],
)
def test_what_cannot_be_carried_is_refused_with_what_was_seen(profile, words):
    rng = np.random.default_rng(7)
    study = fit_gradients([case(rng, Unit(rng), **profile)], TWIN)
    assert study.axes == () and len(study.refused) == 1 and words in sentences(study.refused)[0]
    assert rlg_document(study, version="").verdict == "refused"


def test_data_of_another_kind_are_inconsistent():
    rng = np.random.default_rng(9)
    runs = three_runs(rng, Unit(rng))
    wave = 0.5 * np.sign(np.sin(np.arange(len(runs[0].blocks.time_s)) / 4.0))[:, None]
    runs[0] = replace(
        runs[0], blocks=replace(runs[0].blocks, bias_deg_h=runs[0].blocks.bias_deg_h + wave)
    )
    study = fit_gradients(runs, TWIN)
    assert study.axes == ()
    assert len(study.inconsistent) == 3
    assert "residual_scatters" in codes(study.inconsistent)[0]
