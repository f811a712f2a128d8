"""The one weighted least squares, against formulas that share nothing with it; the models of
temperature it serves have one face.
"""

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from infield.table.autopilot_params import PX4, AutopilotCubic
from infield.table.least_squares import NormalEquations, fit_correlated, fit_rows
from infield.table.temperature_model import TemperatureModel
from infield.table.thermal_table import EvenNodes, default_table
from ins.records import AXES


def correlated(rng, rows=12, columns=3):
    """Rows, right-hand side and a full covariance of its errors."""
    root = rng.standard_normal((rows, rows))
    covariance = root @ root.T + np.eye(rows)
    return rng.standard_normal((rows, columns)), rng.standard_normal(rows), covariance


def test_correlated_rows_are_those_of_aitken():
    """x = (A' S^-1 A)^-1 A' S^-1 y, written out."""
    A, y, S = correlated(np.random.default_rng(1))
    information = A.T @ np.linalg.inv(S) @ A
    fit = fit_correlated(A, y, S)
    np.testing.assert_allclose(fit.x, np.linalg.inv(information) @ A.T @ np.linalg.inv(S) @ y)
    np.testing.assert_allclose(fit.covariance, np.linalg.inv(information))
    left = y - A @ fit.x
    assert fit.chi2 == pytest.approx(left @ np.linalg.inv(S) @ left)
    assert (fit.rank, fit.dof) == (3, 9)


@pytest.mark.parametrize("rows", [2, 6])
def test_what_the_rows_do_not_see_is_named(rows):
    """Columns 0 and 1 only ever come as their sum; also where rows are fewer than columns."""
    A = np.random.default_rng(3).standard_normal((rows, 3))
    A[:, 1] = A[:, 0]
    fit = fit_rows(A, A @ [1.0, 1.0, 0.5])
    assert fit.rank == 2
    np.testing.assert_allclose(np.abs(fit.null[:, 0]), [0.5**0.5, 0.5**0.5, 0.0], atol=1e-12)
    np.testing.assert_allclose(A @ fit.x, A @ [1.0, 1.0, 0.5])


def normal_of(A, y, S):
    M = np.linalg.inv(S)
    return NormalEquations(A.T @ M @ A, A.T @ M @ y, float(y @ M @ y), y.size)


def test_normal_equations_add_to_those_of_all_rows():
    rng = np.random.default_rng(4)
    parts = [correlated(rng) for _ in range(2)]
    S = np.block([[parts[0][2], np.zeros((12, 12))], [np.zeros((12, 12)), parts[1][2]]])
    A, y = np.vstack([p[0] for p in parts]), np.concatenate([p[1] for p in parts])
    whole, rows = normal_of(*parts[0]) + normal_of(*parts[1]), fit_correlated(A, y, S)
    found = whole.solve()
    np.testing.assert_allclose(found.x, rows.x)
    np.testing.assert_allclose(found.covariance, rows.covariance)
    assert whole.misfit(found.x) == pytest.approx(rows.chi2)
    assert whole.rows == 24


def test_evidence_is_the_density_of_the_rows():
    """log N(y; 0, A L^-1 A' + S) with the constants that the docstring leaves out put back."""
    A, y, S = correlated(np.random.default_rng(5))
    precision = np.diag([0.5, 2.0, 10.0])
    marginal = A @ np.linalg.inv(precision) @ A.T + S
    expected = multivariate_normal(np.zeros(y.size), marginal).logpdf(y)
    constant = 0.5 * np.linalg.slogdet(precision)[1] - 0.5 * np.linalg.slogdet(S)[1]
    constant -= 0.5 * y.size * np.log(2.0 * np.pi)
    found = normal_of(A, y, S).solve(precision).log_evidence
    assert found + constant == pytest.approx(expected)


def table():
    made = default_table(
        imu_serial="S",
        gyro_technology="mems",
        created_utc="2026-03-01T05:00:00Z",
        span=EvenNodes(low_degC=0, high_degC=40),
    )
    return made.replaced(parameters=np.random.default_rng(6).standard_normal(made.n_parameters))


def cubic():
    coefficients = np.random.default_rng(7).standard_normal((3, 4)) * [1.0, 0.1, 1e-3, 1e-5]
    return AutopilotCubic(
        autopilot=PX4,
        number=0,
        low_degC=0.0,
        high_degC=40.0,
        reference_degC=25.0,
        coefficients=coefficients,
    )


@pytest.mark.parametrize("model", [table(), cubic()], ids=["table", "cubic"])
def test_tables_and_cubics_are_temperature_models_that_rates_do_not_move(model):
    assert isinstance(model, TemperatureModel) and model.axes == AXES and model.lines == ()
    T = np.array([[-5.0, 0.0, 12.0], [20.0, 40.0, 47.0]])
    settled = model.settled_deg_h(T)
    for k, axis in enumerate(AXES):
        at_ends = np.clip(T[:, k], 0.0, 40.0)
        np.testing.assert_array_equal(settled[:, k], model.curves[axis].settled_deg_h(at_ends))
    assert np.array_equal(model.inside(T), [[False, True, True], [True, True, False]])
    rate = np.ones_like(T)
    assert not model.rates_deg_h(T, rate, T).any() and not model.rates_sigma_deg_h(T, rate, T).any()
