"""Coning, sculling and scrolling against closed forms; rate logs."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from ins.attitude import dcm_from_rotation_vector
from ins.records import ImuLog
from ins.strapdown import increments

HALF_ANGLE_RAD = 0.01


def log(dtheta, dv, dt=0.01):
    dt = np.broadcast_to(dt, len(dtheta))
    return ImuLog(time_s=np.cumsum(dt), dt_s=dt, dtheta_rad=dtheta, dv_m_s=dv)


def classical_coning(frequency_hz, n, dt=0.01):
    """Exact increments of a body whose rotation vector circles in x, y with a fixed length; the row
    before included.
    """
    w, b = 2 * np.pi * frequency_hz, HALF_ANGLE_RAD
    edges = w * dt * np.arange(-1, n + 1)
    dtheta = np.stack(
        [
            np.sin(b) * np.diff(np.cos(edges)),
            np.sin(b) * np.diff(np.sin(edges)),
            np.full(n + 1, -2 * w * np.sin(b / 2) ** 2 * dt),
        ],
        axis=-1,
    )
    return log(dtheta, np.zeros_like(dtheta), dt)


def residual_factor(x):
    """What is left of a drift 1/2 per radian of phase: x^4/60 to first order."""
    return ((x - np.sin(x)) / 2 - np.sin(x / 2) ** 2 * np.sin(x) / 3) / x


@pytest.mark.parametrize("frequency_hz", [1.0, 2.5, 5.0, 10.0])
def test_classical_coning_leaves_the_closed_form_drift(frequency_hz):
    """Cone half-angle 10 mrad; whole periods: only drift is left."""
    n, dt = 400, 0.01
    imu = classical_coning(frequency_hz, n, dt)
    w = 2 * np.pi * frequency_hz
    drift = {}
    for name, rows in (("raw", imu.dtheta_rad), ("compensated", increments.rotation_vectors(imu))):
        total = Rotation.identity()
        for rotation in Rotation.from_rotvec(rows[1:].copy()):
            total = total * rotation
        drift[name] = total.as_rotvec()[2] / (n * dt)
    assert drift["raw"] == pytest.approx(
        -w * HALF_ANGLE_RAD**2 * (0.5 - np.sin(w * dt) / (2 * w * dt)), rel=1e-3
    )
    expected = -w * HALF_ANGLE_RAD**2 * residual_factor(w * dt)
    assert drift["compensated"] == pytest.approx(expected, rel=1e-2, abs=1e-10)
    assert abs(drift["compensated"]) < 0.2 * abs(drift["raw"])


def test_coning_residual_falls_with_the_fourth_power():
    x = 2 * np.pi * 0.01 * np.array([1.0, 2.0])
    assert residual_factor(x) == pytest.approx(x**4 / 60, rel=2e-2)


@pytest.mark.parametrize("frequency_hz", [1.0, 2.5, 5.0])
def test_classical_sculling_leaves_the_closed_form_drift(frequency_hz):
    """Roll angle and side force in phase: true mean acceleration 1/2 theta0 f0 down."""
    n, dt, theta0, f0 = 400, 0.01, 1e-4, 10.0
    w = 2 * np.pi * frequency_hz
    edges = w * dt * np.arange(-1, n + 1)
    zero = np.zeros(n + 1)
    imu = log(
        np.stack([theta0 * np.diff(np.sin(edges)), zero, zero], -1),
        np.stack([zero, -f0 / w * np.diff(np.cos(edges)), zero], -1),
        dt,
    )
    C = dcm_from_rotation_vector(np.stack([theta0 * np.sin(edges[1:-1]), zero[1:], zero[1:]], -1))
    for dv, lost in (
        (increments.velocity_increments(imu), residual_factor(w * dt)),
        (
            increments.velocity_increments(imu) - increments.sculling(imu),
            0.5 - np.sin(w * dt) / (2 * w * dt),
        ),
    ):
        mean = np.einsum("nij,nj->ni", C, dv[1:]).sum(axis=0)[2] / (n * dt)
        assert mean - 0.5 * theta0 * f0 == pytest.approx(
            -theta0 * f0 * lost, rel=1e-2, abs=f0 * theta0**3
        )


def linear_rows(a, b, c, d, dt, dt_before):
    """Two rows of rate a + b t and force c + d t, the second starting at t = 0."""
    edges = np.array([-dt_before, 0.0, dt])
    once, twice = np.diff(edges)[:, None], np.diff(edges**2 / 2)[:, None]
    return log(once * a + twice * b, once * c + twice * d, [dt_before, dt])


triple = st.tuples(*[st.floats(-20, 20)] * 3).map(np.array)


@given(
    a=triple,
    b=triple,
    c=triple,
    d=triple,
    dt=st.floats(0.002, 0.02),
    dt_before=st.floats(0.01, 0.02),
)
def test_linear_motion_over_unequal_intervals_is_exact(a, b, c, d, dt, dt_before):
    """For rate a + b t and force c + d t the double integrals are T^3/12 a x b and T^3/12 (a x d +
    c x b).
    """
    imu = linear_rows(a, b, c, d, dt, dt_before)
    assert increments.coning(imu)[1] == pytest.approx(dt**3 / 12 * np.cross(a, b), abs=1e-12)
    expected = dt**3 / 12 * (np.cross(a, d) + np.cross(c, b))
    assert increments.sculling(imu)[1] == pytest.approx(expected, abs=1e-12)


def integrate_finely(a, b, c, d, dt, n=400):
    """Attitude and velocity after dt from rest, in the frame of t = 0, by n midpoint steps."""
    C, v, h = np.eye(3), np.zeros(3), dt / n
    for t in h * np.arange(n):
        omega = a + b * (t + h / 2)
        dv = C @ dcm_from_rotation_vector(omega * h / 2) @ (c + d * (t + h / 2)) * h
        v = v + dv
        C = C @ dcm_from_rotation_vector(omega * h)
    return C, v


def test_one_step_of_a_linear_motion_is_of_fourth_order():
    """Against fine integration: halving the interval divides the rest by at least 2^4."""
    a, b = np.array([1.0, -0.5, 0.8]), np.array([5.0, 30.0, -20.0])
    c, d = np.array([3.0, 2.0, -9.8]), np.array([-60.0, 90.0, 40.0])
    left = []
    for dt in (0.08, 0.04):
        imu = linear_rows(a, b, c, d, dt, dt)
        C, v = integrate_finely(a, b, c, d, dt)
        dv = increments.velocity_increments(imu)[1]
        rotation = dcm_from_rotation_vector(increments.rotation_vectors(imu)[1])
        left.append([np.abs(rotation - C).max(), np.abs(dv - v).max()])
    assert np.all(np.array(left[0]) / left[1] > 14)


def test_steady_rotation_is_integrated_exactly():
    """Constant rate and force, 0.5 rad in one interval: Rodrigues."""
    dtheta, dv = np.array([0.3, -0.4, 0.0]), np.array([1.0, 2.0, -9.0])
    imu = log(np.tile(dtheta, (2, 1)), np.tile(dv, (2, 1)))
    s = np.linspace(0, 1, 2001)
    C = dcm_from_rotation_vector(s[:, None] * dtheta)
    expected = np.trapezoid(C @ dv, s, axis=0)
    assert increments.velocity_increments(imu)[1] == pytest.approx(expected, abs=1e-6)
    assert increments.coning(imu)[1] == pytest.approx(np.zeros(3))


def test_a_gap_gives_no_slope():
    rng = np.random.default_rng(4)
    imu = log(
        rng.standard_normal((4, 3)), rng.standard_normal((4, 3)), np.array([0.01, 0.01, 0.5, 0.01])
    )
    assert not increments.coning(imu)[[0, 2]].any() and not increments.sculling(imu)[[0, 2]].any()
    assert increments.coning(imu)[[1, 3]].all() and increments.sculling(imu)[[1, 3]].all()


def test_joined_intervals_turn_and_push_as_their_rows_do():
    """Uneven intervals of large turns: against the rows in order, with scipy's rotations; and one
    interval over all of a steady turn against its closed form.
    """
    rng = np.random.default_rng(4)
    rows = log(0.3 * rng.standard_normal((40, 3)), rng.standard_normal((40, 3)))
    ends = np.array([1, 2, 9, 30, 40])
    C, dv, _ = increments.joined(rows, ends)
    turns, pushes = increments.rotation_vectors(rows), increments.velocity_increments(rows)
    for k, (a, b) in enumerate(zip([0, *ends[:-1]], ends)):
        at, gained = Rotation.identity(), np.zeros(3)
        for row in range(a, b):
            gained = gained + at.apply(pushes[row])
            at = at * Rotation.from_rotvec(turns[row])
        np.testing.assert_allclose(C[k], at.as_matrix(), atol=1e-14)
        np.testing.assert_allclose(dv[k], gained, atol=1e-13)
    rate, force, dt, n = 0.7, 3.0, 0.01, 100
    steady = log(
        np.tile([0.0, 0.0, rate * dt], (n, 1)), np.tile([force * dt, 0.0, 0.0], (n, 1)), dt
    )
    C, dv, way = increments.joined(steady, [n])
    np.testing.assert_allclose(
        C[0], dcm_from_rotation_vector([0.0, 0.0, rate * n * dt]), atol=1e-12
    )
    angle = rate * n * dt
    expected = force / rate * np.array([np.sin(angle), 1.0 - np.cos(angle), 0.0])
    np.testing.assert_allclose(dv[0], expected, atol=1e-9)
    expected = force / rate**2 * np.array([1.0 - np.cos(angle), angle - np.sin(angle), 0.0])
    np.testing.assert_allclose(way[0], expected, atol=force * rate * n * dt**3 / 6.0)
