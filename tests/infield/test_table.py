"""The thermal table: interpolation, the prior's kernel, ageing, what it says beyond its nodes."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import CubicHermiteSpline

from infield.table.thermal_table import (
    AgeingModel,
    EvenNodes,
    ThermalTable,
    default_table,
    smooth_kernel,
)
from ins.records import InputError
from tests.infield.common_part import common_shift

UTC = "2026-03-01T05:00:00Z"
INTERPOLATIONS = ["linear", "hermite"]


def random_table(rng, interpolation="linear"):
    """A table with different nodes on each axis, random values and a random covariance."""
    x, y, z = (
        np.sort(rng.choice(np.arange(-40.0, 70.0), size=k, replace=False)) for k in (4, 6, 3)
    )
    n = 13 * (2 if interpolation == "hermite" else 1)
    root = rng.standard_normal((n, n)) * 0.003
    return ThermalTable(
        imu_serial="S",
        gyro_technology="rlg",
        created_utc=UTC,
        interpolation=interpolation,
        temperature_degC=(x, y, z),
        parameters=rng.standard_normal(n) * 0.01,
        covariance=root @ root.T,
    )


@pytest.mark.parametrize("axis", ["x", "y", "z"])
def test_linear_is_numpy_interp(axis):
    table = random_table(np.random.default_rng(1))
    T = np.linspace(-80, 120, 201)
    nodes = table.temperature_degC["xyz".index(axis)]
    expected = np.interp(T, nodes, table.parameters[table.values_of(axis)])
    assert table.bias_deg_h(axis, T) == pytest.approx(expected, abs=1e-16)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_hermite_is_the_cubic_through_values_and_slopes(axis):
    table = random_table(np.random.default_rng(2), "hermite")
    nodes = table.temperature_degC[axis]
    spline = CubicHermiteSpline(
        nodes, table.parameters[table.values_of(axis)], table.parameters[table.slopes_of(axis)]
    )
    T = np.linspace(nodes[0], nodes[-1], 301)
    assert table.bias_deg_h(axis, T) == pytest.approx(spline(T), abs=1e-14)
    assert table.bias_deg_h(axis, [-300.0, 300.0]) == pytest.approx(
        table.parameters[table.values_of(axis)][[0, -1]]
    )


@given(st.integers(0, 2**32 - 1), st.sampled_from(INTERPOLATIONS), st.floats(-100, 150))
@settings(max_examples=50, deadline=None)
def test_rows_carry_a_common_shift_whole_and_touch_one_axis(seed, interpolation, T):
    table = random_table(np.random.default_rng(seed), interpolation)
    for axis in range(3):
        row = table.basis(axis, T)[0]
        assert row[table.values_of(axis)].sum() == pytest.approx(1.0, abs=1e-13)
        others = [k for k in range(3) if k != axis]
        assert all(not row[table.values_of(k)].any() for k in others)
        assert table.sigma_deg_h(axis, T)[0] >= np.sqrt(row @ table.covariance @ row) * (1 - 1e-12)


def test_slope_covariances_are_derivatives_of_the_kernel():
    T, step, length = np.array([-10.0, 3.0, 25.0]), 1e-3, 30.0
    K = smooth_kernel(T, length, slopes=True)
    around = np.concatenate((T - step, T + step))
    rho = np.exp(-((np.r_[T, around][:, None] - np.r_[T, around][None, :]) ** 2) / (2 * length**2))
    D = np.hstack((np.zeros((3, 3)), -np.eye(3), np.eye(3))) / (2 * step)  # central difference
    assert K[3:, 3:] == pytest.approx(D @ rho @ D.T, abs=1e-8)
    assert K[:3, 3:] == pytest.approx((rho @ D.T)[:3], abs=1e-8)
    assert np.linalg.eigvalsh(K)[0] > 0


@pytest.mark.parametrize("technology, sigma", [("rlg", 0.01), ("fog", 0.05), ("mems", 30.0)])
def test_default_table_is_the_contract(technology, sigma):
    table = default_table(
        imu_serial="S",
        gyro_technology=technology,
        created_utc=UTC,
        span=EvenNodes(low_degC=-37, high_degC=52),
    )
    nodes = table.temperature_degC[2]
    assert nodes[0] == -40 and nodes[-1] == 60 and np.all(np.diff(nodes) == 10)
    assert not table.parameters.any()
    assert table.sigma_deg_h("z", nodes) == pytest.approx(sigma, rel=1e-15)


@pytest.mark.parametrize("interpolation", INTERPOLATIONS)
def test_extension_keeps_bits_and_says_what_sigma_says(interpolation):
    rng = np.random.default_rng(3)
    table = default_table(
        imu_serial="S",
        gyro_technology="rlg",
        created_utc=UTC,
        span=EvenNodes(low_degC=0, high_degC=40),
        interpolation=interpolation,
    )
    table = table.replaced(parameters=rng.standard_normal(table.n_parameters) * 1e-3)
    wide = table.extended_to(-25.0, 41.0)
    for axis in range(3):
        assert wide.temperature_degC[axis].tolist() == [-30, -20, -10, 0, 10, 20, 30, 40, 50]
        new, old = wide.values_of(axis), table.values_of(axis)
        kept = slice(new.start + 3, new.stop - 1)
        assert np.array_equal(wide.parameters[kept], table.parameters[old])
        assert np.array_equal(wide.covariance[kept, kept], table.covariance[old, old])
        outside = np.array([-30.0, -20.0, -10.0, 50.0])
        assert wide.bias_deg_h(axis, outside) == pytest.approx(
            table.bias_deg_h(axis, outside), abs=1e-18
        )
        assert wide.sigma_deg_h(axis, outside) == pytest.approx(
            table.sigma_deg_h(axis, outside), rel=1e-12
        )
        sigma = table.sigma_deg_h(axis, [0.0, -10.0, -30.0, -60.0])
        assert np.all(np.diff(sigma) > 0)
    assert wide.extended_to(-30.0, 50.0) is wide


@pytest.mark.parametrize("interpolation", INTERPOLATIONS)
def test_ageing_adds_a_common_and_a_smooth_random_walk(interpolation):
    table = default_table(
        imu_serial="S", gyro_technology="rlg", created_utc=UTC, interpolation=interpolation
    )
    assert np.array_equal(table.aged(100.0, AgeingModel()).covariance, table.covariance)
    model = AgeingModel(common_deg_h_sqrt_year=0.006, shape_deg_h_sqrt_year=0.004)
    aged = table.aged(2 * 365.25, model)
    growth = aged.covariance - table.covariance
    k = table.values_of("y").start
    rho = np.exp(-(30.0**2) / (2 * 30.0**2))
    assert growth[k, k] == pytest.approx(2 * (0.006**2 + 0.004**2))
    assert growth[k, k + 3] == pytest.approx(2 * (0.006**2 + 0.004**2 * rho))
    assert np.all(growth[table.values_of("x"), table.values_of("y")] == 0.0)
    assert np.array_equal(aged.parameters, table.parameters)
    assert np.array_equal(table.aged(-5.0, model).covariance, table.covariance)


def test_common_shift_sees_shifts_and_not_shapes():
    table = default_table(imu_serial="S", gyro_technology="rlg", created_utc=UTC)
    shifted = table.replaced(parameters=table.parameters + 0.002)
    assert common_shift(table, "y", shifted) == pytest.approx(0.002)
    # data on differences between temperatures only
    rows = np.diff(table.basis("y", [3.0, 14.0, 22.0]), axis=0)
    gain = (
        table.covariance
        @ rows.T
        @ np.linalg.inv(rows @ table.covariance @ rows.T + 1e-8 * np.eye(2))
    )
    bent = table.replaced(parameters=table.parameters + gain @ np.array([0.02, -0.01]))
    assert np.max(np.abs(bent.parameters)) > 1e-3
    assert abs(common_shift(table, "y", bent)) < 1e-7  # R6 asks for 1e-6


@pytest.mark.parametrize(
    "change, clue",
    [
        ({"parameters": np.zeros(5)}, "parameters"),
        ({"parameters": np.full(36, np.nan)}, "finite"),
        ({"covariance": np.eye(35)}, "covariance"),
        ({"covariance": -np.eye(36)}, "semidefinite"),
        ({"covariance": np.eye(36) + np.eye(36, k=1)}, "symmetric"),
        ({"gyro_technology": "hrg"}, "gyro_technology"),
        ({"interpolation": "spline"}, "interpolation"),
        ({"temperature_degC": (np.zeros(1), np.arange(3.0), np.arange(3.0))}, "axes.x"),
        ({"temperature_degC": (np.arange(12.0), np.arange(12.0), np.arange(12.0)[::-1])}, "axes.z"),
    ],
)
def test_refusals(change, clue):
    table = default_table(imu_serial="S", gyro_technology="rlg", created_utc=UTC)
    with pytest.raises(InputError, match=clue):
        table.replaced(**change)
