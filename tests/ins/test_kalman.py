"""Kalman steps: cases worked by hand, refusals, invariants, and the faults of filterpy that are
guarded here.
"""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import chi2

from ins import kalman

ROUNDING = 1e-12


def one(value):
    return np.array([[float(value)]])


def test_scalar_predict_by_hand():
    """x = 2 * 3, P = 2 * 4 * 2 + 1."""
    x, P = kalman.predict(np.array([3.0]), one(4), one(2), one(1))
    assert x == pytest.approx([6.0])
    assert P == pytest.approx(one(17))


def test_scalar_update_by_hand():
    """P = 3, R = 1, z - x = 2: K = 3/4, x = 1 + 1.5, P = 3/4, NIS = 4/4."""
    x, P, seen = kalman.update(np.array([1.0]), one(3), np.array([3.0]), one(1), one(1))
    assert x == pytest.approx([2.5])
    assert P == pytest.approx(one(0.75))
    assert (seen.residual[0], seen.S[0, 0], seen.nis) == pytest.approx((2.0, 4.0, 1.0))


def test_two_states_by_hand():
    """Dt = 1, P = I: P- = [[2, 1], [1, 1]]; z = position, R = 2: K = (1/2, 1/4)."""
    x, P = kalman.predict(
        np.array([0.0, 1.0]), np.eye(2), np.array([[1.0, 1.0], [0.0, 1.0]]), np.zeros((2, 2))
    )
    assert x == pytest.approx([1.0, 1.0])
    assert P == pytest.approx(np.array([[2.0, 1.0], [1.0, 1.0]]))
    x, P, seen = kalman.update(x, P, np.array([3.0]), np.array([[1.0, 0.0]]), one(2))
    assert x == pytest.approx([2.0, 1.5])
    assert P == pytest.approx(np.array([[1.0, 0.5], [0.5, 0.75]]))
    assert seen.nis == pytest.approx(1.0)


def test_two_rows_at_once_are_two_rows_in_turn():
    rng = np.random.default_rng(1)
    A = rng.standard_normal((4, 4))
    x = rng.standard_normal(4)
    P = A @ A.T
    H = rng.standard_normal((2, 4))
    z = rng.standard_normal(2)
    R = np.diag([0.5, 2.0])
    both = kalman.update(x, P, z, H, R)
    x1, P1, first = kalman.update(x, P, z[:1], H[:1], R[:1, :1])
    x2, P2, second = kalman.update(x1, P1, z[1:], H[1:], R[1:, 1:])
    assert both[0] == pytest.approx(x2, abs=ROUNDING)
    assert both[1] == pytest.approx(P2, abs=ROUNDING)
    assert both[2].nis == pytest.approx(first.nis + second.nis)


def test_joseph_form_keeps_a_tiny_variance_positive():
    """P = 1, R = 1e-20: (1 - K) P rounds to exactly 0 or below; the Joseph form keeps R."""
    _, P, _ = kalman.update(np.zeros(1), one(1), np.zeros(1), one(1), one(1e-20))
    K = 1.0 / (1.0 + 1e-20)
    assert (1.0 - K) * 1.0 == 0.0
    assert P[0, 0] == pytest.approx(1e-20, rel=1e-6)


@given(st.integers(0, 2**31), st.integers(2, 8), st.integers(1, 3))
def test_covariance_stays_symmetric_and_positive(seed, n, m):
    rng = np.random.default_rng(seed)
    A, F, B = rng.standard_normal((3, n, n))
    P, x, H = A @ A.T, rng.standard_normal(n), rng.standard_normal((m, n))
    x, P_minus = kalman.predict(x, P, F, B @ B.T)
    x, P_plus, seen = kalman.update(x, P_minus, rng.standard_normal(m), H, np.eye(m))
    for covariance in (P_minus, P_plus):
        assert np.array_equal(covariance, covariance.T)
        assert np.linalg.eigvalsh(covariance)[0] > -1e-9 * np.trace(covariance)
    assert seen.nis >= 0.0
    # a measurement never adds variance
    assert np.linalg.eigvalsh(P_minus - P_plus)[0] > -1e-9 * np.trace(P_minus)


@pytest.mark.parametrize("name", ["P", "F", "Q"])
@pytest.mark.parametrize("wrong", [1e-4, np.eye(3), np.zeros(2)])
def test_predict_refuses_a_wrong_shape_and_says_which(name, wrong):
    """A scalar Q most of all: filterpy adds it to every element of P."""
    matrices = {"P": np.eye(2), "F": np.eye(2), "Q": np.eye(2), name: wrong}
    with pytest.raises(ValueError, match=rf"{name} has shape .*needed \(2, 2\)"):
        kalman.predict(np.zeros(2), matrices["P"], matrices["F"], matrices["Q"])


@pytest.mark.parametrize("name", ["P", "F", "Q"])
def test_predict_refuses_nan(name):
    matrices = {"P": np.eye(2), "F": np.eye(2), "Q": np.eye(2)}
    matrices[name] = np.array([[np.nan, 0.0], [0.0, 1.0]])
    with pytest.raises(ValueError, match="not finite"):
        kalman.predict(np.zeros(2), matrices["P"], matrices["F"], matrices["Q"])


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_update_refuses_a_measurement_that_is_not_finite(value):
    with pytest.raises(ValueError, match="not finite; leave it out"):
        kalman.update(np.zeros(1), one(1), np.array([value]), one(1), one(1))


@pytest.mark.parametrize("name", ["x", "P", "H", "R"])
def test_update_refuses_nan_elsewhere(name):
    given_ = {"x": np.zeros(1), "P": one(1), "z": np.zeros(1), "H": one(1), "R": one(1)}
    given_[name] = given_[name] + np.nan
    with pytest.raises(ValueError, match="not finite"):
        kalman.update(*given_.values())


@pytest.mark.parametrize(
    ("x", "P", "z", "R"),
    [
        (np.zeros(3), np.eye(2), np.zeros(1), np.eye(1)),
        (np.zeros(2), np.eye(3), np.zeros(1), np.eye(1)),
        (np.zeros(2), np.eye(2), np.zeros(2), np.eye(1)),
        (np.zeros(2), np.eye(2), np.zeros(1), np.eye(2)),
        (np.zeros(2), np.eye(2), np.array(1.0), np.eye(1)),
        (np.zeros((2, 1)), np.eye(2), np.zeros(1), np.eye(1)),
    ],
)
def test_update_refuses_shapes_that_do_not_fit(x, P, z, R):
    with pytest.raises(ValueError, match="do not fit"):
        kalman.update(x, P, z, np.ones((1, 2)), R)


def test_smoother_is_the_batch_solution():
    """Random steps: smoothed means and covariances are those of all states solved at once."""
    rng, n, steps = np.random.default_rng(4), 3, 6
    F, H = rng.standard_normal((steps, n, n)), rng.standard_normal((steps, 1, n))
    Q = np.stack([a @ a.T for a in rng.standard_normal((steps, n, n))])
    z, R = rng.standard_normal((steps, 1)), one(0.5)
    information, vector = np.zeros((n * steps, n * steps)), np.zeros(n * steps)
    information[:n, :n] = np.eye(n)  # prior N(0, I) of the first state
    x, P, kept = np.zeros(n), np.eye(n), []
    for k in range(steps):
        here, before = slice(n * k, n * k + n), slice(n * k - n, n * k)
        if k:
            x, P = kalman.predict(x, P, F[k], Q[k])
            step = np.hstack([-F[k], np.eye(n)])
            information[n * k - n : n * k + n, n * k - n : n * k + n] += (
                step.T @ np.linalg.inv(Q[k]) @ step
            )
            assert before.stop == here.start
        x, P, _ = kalman.update(x, P, z[k], H[k], R)
        information[here, here] += H[k].T @ H[k] / 0.5
        vector[here] += H[k, 0] * z[k, 0] / 0.5
        kept.append((x, P))
    x_s, P_s = kalman.rts_smooth(*(np.stack(part) for part in zip(*kept)), F, Q)
    covariance = np.linalg.inv(information)
    assert x_s.ravel() == pytest.approx(covariance @ vector, abs=1e-9)
    for k in range(steps):
        assert P_s[k] == pytest.approx(covariance[n * k : n * k + n, n * k : n * k + n], abs=1e-9)


def test_smoother_refuses_what_does_not_fit():
    with pytest.raises(ValueError, match="do not fit"):
        kalman.rts_smooth(
            np.zeros((2, 1)), np.zeros((2, 1, 1)), np.zeros((1, 1, 1)), np.zeros((2, 1, 1))
        )
    with pytest.raises(ValueError, match="not finite"):
        kalman.rts_smooth(
            np.full((2, 1), np.nan), np.ones((2, 1, 1)), np.ones((2, 1, 1)), np.ones((2, 1, 1))
        )


@pytest.mark.parametrize("dof", [1, 10, 812])
@pytest.mark.parametrize("probability", [0.95, 0.999])
def test_nis_band_holds_that_share_of_chi_square(dof, probability):
    low, high = kalman.nis_band(dof, probability)
    assert chi2.cdf(high * dof, dof) - chi2.cdf(low * dof, dof) == pytest.approx(
        probability, abs=1e-9
    )
    assert chi2.cdf(low * dof, dof) == pytest.approx(chi2.sf(high * dof, dof), abs=1e-9)
    assert low < 1.0 < high
