"""Rotations against scipy, and over random inputs."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from ins import attitude

ROUNDING = 1e-14
angle = st.floats(-np.pi, np.pi)
rotation = st.tuples(*[st.floats(-1.8, 1.8)] * 3).map(np.array)
vector = st.tuples(*[st.floats(-10, 10)] * 3).map(np.array)


@given(a=vector, b=vector)
def test_skew_is_the_cross_product(a, b):
    assert attitude.skew(a) @ b == pytest.approx(np.cross(a, b), abs=1e-12)


@given(roll=angle, pitch=angle, heading=angle)
def test_euler_sequence_is_heading_pitch_roll(roll, pitch, heading):
    expected = Rotation.from_euler("ZYX", [heading, pitch, roll]).as_matrix()
    assert attitude.dcm_from_euler(roll, pitch, heading) == pytest.approx(expected, abs=ROUNDING)


@given(roll=angle, pitch=st.floats(-np.pi / 2, np.pi / 2), heading=angle)
def test_euler_round_trip_rebuilds_the_matrix(roll, pitch, heading):
    C_nb = attitude.dcm_from_euler(roll, pitch, heading)
    back = attitude.euler_from_dcm(C_nb)
    assert 0 <= back[2] <= 2 * np.pi
    assert attitude.dcm_from_euler(*back) == pytest.approx(
        C_nb, abs=4e-8 if abs(pitch) > 1.57 else 1e-12
    )


@given(v=rotation)
def test_rotation_vector_matches_scipy_and_returns(v):
    C = attitude.dcm_from_rotation_vector(v)
    assert C == pytest.approx(Rotation.from_rotvec(v).as_matrix(), abs=ROUNDING)
    assert C.T @ C == pytest.approx(np.eye(3), abs=ROUNDING)
    if np.linalg.norm(v) < 3.1:
        assert attitude.rotation_vector_from_dcm(C) == pytest.approx(v, abs=1e-12)


@given(roll=angle, pitch=st.floats(-1.5, 1.5), heading=angle)
def test_level_angles_of_a_unit_at_rest_are_those_of_its_attitude(roll, pitch, heading):
    """At rest the accelerometers read -C_bn g, whatever the heading."""
    f_b = attitude.dcm_from_euler(roll, pitch, heading).T @ np.array([0.0, 0.0, -9.8])
    found_roll, found_pitch = attitude.level_angles(f_b)
    assert np.sin(found_roll - roll) == pytest.approx(0.0, abs=1e-12)
    assert found_pitch == pytest.approx(pitch, abs=1e-12)


@pytest.mark.parametrize("size", [0.0, 1e-300, 1e-9, 1e-4, 1e-2, 1.0, 3.0])
def test_small_rotations_keep_their_digits(size):
    v = size * np.array([0.6, -0.8, 0.0])
    assert attitude.rotation_vector_from_dcm(attitude.dcm_from_rotation_vector(v)) == pytest.approx(
        v, rel=1e-14
    )


@given(v=st.tuples(*[st.floats(-4, 4)] * 3).map(np.array))
def test_quaternion_of_a_matrix_matches_scipy(v):
    C = Rotation.from_rotvec(v).as_matrix()
    q = attitude.quaternion_from_dcm(C)
    assert np.linalg.norm(q) == pytest.approx(1.0)
    assert q[0] >= 0
    assert Rotation.from_quat(q, scalar_first=True).as_matrix() == pytest.approx(C, abs=1e-13)


@pytest.mark.parametrize("axis", np.eye(3))
def test_quaternion_of_half_a_turn(axis):
    C = 2 * np.outer(axis, axis) - np.eye(3)
    assert np.abs(attitude.quaternion_from_dcm(C)) == pytest.approx([0, *axis], abs=1e-15)


def test_functions_broadcast():
    v = np.linspace(-1, 1, 24).reshape(2, 4, 3)
    C = attitude.dcm_from_rotation_vector(v)
    assert C.shape == (2, 4, 3, 3)
    assert attitude.rotation_vector_from_dcm(C) == pytest.approx(v)
    euler = attitude.euler_from_dcm(C)
    assert attitude.dcm_from_euler(*euler) == pytest.approx(C)


@given(a=st.floats(-1e3, 1e3))
def test_wrapped_angle_is_the_same_direction(a):
    w = attitude.wrap_pi(a)
    assert -np.pi <= w <= np.pi
    assert np.sin(w) == pytest.approx(np.sin(a), abs=1e-12)
    assert np.cos(w) == pytest.approx(np.cos(a), abs=1e-12)
