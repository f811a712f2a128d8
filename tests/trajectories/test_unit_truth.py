"""True units: ageing has its size and length, the factory table is the curve, extra terms do what
they say.
"""

import numpy as np
import pytest
from scipy import stats

from ins.records import InputError
from trajectories.simulator.unit_truth import (
    GRID_DEGC,
    HYSTERESIS_WIDTH_DEGC,
    NODES_DEGC,
    aged_unit,
)


def ageing(seed, temperatures, **sizes):
    unit = aged_unit(np.random.default_rng(seed), **sizes)
    return np.stack([unit.ageing_deg_h[k](temperatures) for k in range(3)])


def test_ageing_has_the_size_and_correlation_of_physics_6_8():
    at = np.array([0.0, 30.0])
    draws = np.concatenate([ageing(s, at) for s in range(1000)])
    low, high = stats.chi2.ppf([5e-5, 1 - 5e-5], 3000) / 3000
    assert low < np.mean(draws[:, 0] ** 2) / (0.006**2 + 0.004**2) < high
    expected = 0.006**2 + 0.004**2 * np.exp(-0.5)
    covariance = np.mean(draws[:, 0] * draws[:, 1])
    assert covariance == pytest.approx(expected, abs=4 * 0.0072**2 / np.sqrt(3000))


def test_factory_table_is_the_curve_without_its_ageing():
    unit = aged_unit(np.random.default_rng(3), imu_serial="SN-9")
    table = unit.factory_table()
    fresh = aged_unit(np.random.default_rng(3), ageing_offset_deg_h=0.0, ageing_shape_deg_h=0.0)
    for axis in "xyz":
        np.testing.assert_allclose(
            table["axes"][axis]["bias_deg_h"], fresh.bias_deg_h(axis, NODES_DEGC), atol=1e-12
        )
        assert table["axes"][axis]["sigma_deg_h"] == [pytest.approx(np.hypot(0.006, 0.004))] * 7
    assert table["imu_serial"] == "SN-9"


def test_factory_table_is_a_valid_table_and_errs_little_between_its_nodes():
    """The curve is not straight between nodes, but its bend there is small beside the ageing."""
    from infield.table.file import table_from_dict

    errors = []
    for seed in range(30):
        unit = aged_unit(
            np.random.default_rng(seed), ageing_offset_deg_h=0.0, ageing_shape_deg_h=0.0
        )
        table = unit.factory_table()
        table_from_dict(table, name="factory")
        middle = NODES_DEGC[:-1] + 5.0
        straight = np.interp(middle, NODES_DEGC, table["axes"]["x"]["bias_deg_h"])
        errors.append(unit.bias_deg_h("x", middle) - straight)
    assert 1e-5 < np.sqrt(np.mean(np.square(errors))) < 1e-3


def test_a_unit_made_from_a_table_has_it_exactly_and_ages_on_top():
    from scipy.interpolate import CubicHermiteSpline

    nodes = [-7.0, 11.0, 42.0]
    axis = {"temperature_degC": nodes, "bias_deg_h": [0.01, -0.02, 0.03], "sigma_deg_h": [0.01] * 3}
    other = {**axis, "bias_deg_h": [0.0, 0.1, 0.2]}
    table = {"axes": {"x": other, "y": axis, "z": other}}
    unit = aged_unit(
        np.random.default_rng(1), table=table, ageing_offset_deg_h=0.0, ageing_shape_deg_h=0.0
    )
    at = np.linspace(-20, 60, 81)
    np.testing.assert_allclose(
        unit.bias_deg_h("y", at), np.interp(at, nodes, axis["bias_deg_h"]), atol=1e-15
    )
    np.testing.assert_allclose(
        unit.bias_deg_h("z", at), np.interp(at, nodes, other["bias_deg_h"]), atol=1e-15
    )
    slopes = [0.001, 0.0, -0.002]
    smooth = {"axes": {key: {**axis, "slope_deg_h_degC": slopes} for key in "xyz"}}
    unit = aged_unit(
        np.random.default_rng(1), table=smooth, ageing_offset_deg_h=0.0, ageing_shape_deg_h=0.0
    )
    inside = at[(at >= -7) & (at <= 42)]
    expected = CubicHermiteSpline(nodes, axis["bias_deg_h"], slopes)(inside)
    np.testing.assert_allclose(unit.bias_deg_h("z", inside), expected, atol=1e-15)


def test_rate_term_lag_and_hysteresis():
    dt, rate = 1.0, 0.5 / 60  # 0.5 degC/min
    up = np.arange(0.0, 3600.0) * rate
    there_and_back = np.concatenate([up, up[::-1]])[:, None] + np.zeros(3)
    plain = aged_unit(np.random.default_rng(4))
    base = plain.bias_history_deg_h(there_and_back, dt)

    def extra(**terms):
        return (
            aged_unit(np.random.default_rng(4), **terms).bias_history_deg_h(there_and_back, dt)
            - base
        )

    rated = extra(thermal_rate_deg_h_per_degC_min=(0.03, 0.0, 0.0))
    np.testing.assert_allclose(rated[100:3500, 0], 0.015, rtol=1e-6)
    np.testing.assert_allclose(rated[3700:7100, 0], -0.015, rtol=1e-6)
    assert not rated[:, 1:].any()
    late = extra(lag_s=(0.0, 300.0, 0.0))
    felt = up[3000] - 300.0 * rate  # a ramp is followed tau late
    assert base[3000, 1] + late[3000, 1] == pytest.approx(
        float(plain.bias_deg_h("y", felt)), abs=1e-6
    )
    split = extra(hysteresis_deg_h=(0.0, 0.0, 0.005))
    assert split[3000, 2] == pytest.approx(0.005, rel=1e-3)
    assert split[7100, 2] == pytest.approx(-0.005, rel=1e-3)
    assert abs(split[0, 2]) < 1e-12
    after = 3600 + round(HYSTERESIS_WIDTH_DEGC / rate)  # 1 - 1/e of the way to the cooling branch
    assert split[after, 2] == pytest.approx(0.005 * (2 / np.e - 1), abs=2e-5)


def test_curves_hold_beyond_their_grid_and_technology_is_checked():
    unit = aged_unit(np.random.default_rng(5), gyro_technology="mems")
    assert unit.bias_deg_h("x", 500.0) == unit.bias_deg_h("x", GRID_DEGC[-1])
    with pytest.raises(InputError, match="gyro_technology 'dtg'"):
        aged_unit(np.random.default_rng(5), gyro_technology="dtg")


def test_gradients_and_the_slope_of_the_rate_term_by_hand():
    """Warming by 0.5 degC/min at 30 degC with differences (2, -1, 4): x has its own line and y's, z
    that of x as its next.
    """
    T = 30.0 + 0.5 * (np.arange(61.0) - 30.0)[:, None] / 60.0 * np.ones(3)
    lines = np.tile([2.0, -1.0, 4.0], (61, 1))
    terms = dict(
        gradient_deg_h_per_degC=(0.03, 0.0, -0.02),
        gradient_cross_deg_h_per_degC=(0.01, 0.0, 0.005),
        thermal_rate_slope_deg_h_per_degC2_min=(0.0, 0.001, 0.0),
    )
    unit, plain = (aged_unit(np.random.default_rng(4), **t) for t in (terms, {}))
    more = unit.bias_history_deg_h(T, 1.0, lines) - plain.bias_history_deg_h(T, 1.0, lines)
    np.testing.assert_allclose(
        more[30], [0.03 * 2 - 0.01, 0.001 * 10 * 0.5, -0.02 * 4 + 0.005 * 2], atol=1e-12
    )
    np.testing.assert_allclose(
        (unit.bias_history_deg_h(T, 1.0) - plain.bias_history_deg_h(T, 1.0))[:, [0, 2]],
        0.0,
        atol=1e-15,
    )


def test_the_coefficient_of_a_fibre_coil_rises_by_half_above_its_centre():
    unit = aged_unit(np.random.default_rng(4), shupe_deg_h_per_degC_min=(0.3, -0.2, 0.0))
    for axis, K in (("x", 0.3), ("y", -0.2)):
        low, centre, high = unit.shupe_coefficient(
            axis, unit.shupe_centre_degC["xyz".index(axis)] + np.array([-500.0, 0.0, 500.0])
        )
        assert (low, centre, high) == pytest.approx((0.5 * K, K, 1.5 * K))
