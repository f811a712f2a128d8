"""The chamber profile against step-by-step integration, and the coil's rate term."""

from dataclasses import replace

import numpy as np
import pytest

from ins.records import InputError
from trajectories.simulator.chamber import ChamberProfile
from trajectories.simulator.unit_truth import aged_unit

PROFILE = ChamberProfile(start_degC=-10.0, end_degC=30.0, rate_degC_min=2.0, soak_s=900.0)


def test_lags_are_those_of_two_first_order_systems():
    dt = 0.5
    t = np.arange(0.0, PROFILE.duration_s, dt)
    found = PROFILE.at(t)
    unit = gyro = PROFILE.start_degC
    lagged = np.empty((t.size, 2))
    for k, chamber in enumerate(found.ambient_degC):
        lagged[k] = unit, gyro
        unit, gyro = unit + dt * (chamber - unit) / 600.0, gyro + dt * (unit - gyro) / 120.0
    np.testing.assert_allclose(found.block_degC, lagged[:, 0], atol=0.02)
    np.testing.assert_allclose(found.gyro_degC[:, 0] - 1.5, lagged[:, 1], atol=0.02)
    assert found.ambient_degC.max() == 30.0 and found.ambient_degC[-1] == -10.0


def test_a_long_ramp_has_its_rate_and_trails_by_its_lags():
    slow = ChamberProfile(rate_degC_min=0.1)
    t = 1800.0 + np.array([18000.0, 18060.0])
    found = slow.at(t)
    np.testing.assert_allclose(np.diff(found.gyro_degC, axis=0), 0.1, rtol=1e-6)
    np.testing.assert_allclose(found.ambient_degC - found.block_degC, 0.1 * 600.0 / 60.0, rtol=1e-6)


@pytest.mark.parametrize(
    "wrong", [{"rate_degC_min": 0.0}, {"unit_tau_s": 120.0}, {"end_degC": -20.0}, {"cycles": 0}]
)
def test_a_profile_that_is_none_is_refused(wrong):
    with pytest.raises(InputError, match=r"needed|must be"):
        ChamberProfile(**wrong)


def test_the_coils_bias_is_its_coefficient_times_the_rate_and_late():
    coil = dict(gyro_technology="fog", shupe_deg_h_per_degC_min=(0.2, 0.0, 0.0))
    unit = aged_unit(np.random.default_rng(1), **coil)
    late = aged_unit(np.random.default_rng(1), **coil, shupe_lag_s=60.0)
    # 0.5 degC/min from the centre of x on
    T = np.repeat((5.0 + 0.5 * np.arange(600) / 60.0)[:, None], 3, axis=1)
    bias, settled = unit.bias_history_deg_h(T, 1.0), unit.bias_deg_h("x", T[:, 0])
    np.testing.assert_allclose(
        bias[:, 0] - settled, 0.5 * unit.shupe_coefficient("x", T[:, 0]), rtol=1e-9
    )
    np.testing.assert_allclose(bias[:, 1], unit.bias_deg_h("y", T[:, 1]))
    assert unit.shupe_coefficient("x", 5.0) == pytest.approx(0.2)
    step = np.repeat(np.maximum(np.arange(600) - 300.0, 0.0)[:, None] * 0.5 / 60.0 + 5.0, 3, axis=1)
    seen = late.bias_history_deg_h(step, 1.0)[:, 0] - late.bias_deg_h("x", step[:, 0])
    assert seen[360] == pytest.approx(0.1 * (1 - np.exp(-1)), rel=0.06)


def test_a_heater_on_one_side_by_hand():
    """On for the first half of each period: after five time constants all of side_degC, then back;
    shares by gyro.
    """
    heated = replace(PROFILE, side_degC=4.0, side_period_s=9000.0, side_tau_s=900.0)
    t = np.array([0.0, 900.0, 4500.0, 9000.0])
    with_heater, without = heated.at(t), PROFILE.at(t)
    hot = np.array(
        [0.0, 4.0 * (1 - np.exp(-1)), 4.0 * (1 - np.exp(-5)), 4.0 * (1 - np.exp(-5)) * np.exp(-5)]
    )
    np.testing.assert_allclose(
        with_heater.gradient_degC - without.gradient_degC,
        hot[:, None] * np.array(heated.side_gradient),
        rtol=1e-3,
        atol=1e-12,
    )
    np.testing.assert_allclose(
        with_heater.gyro_degC - without.gyro_degC,
        hot[:, None] * np.array(heated.side_warming),
        rtol=1e-3,
        atol=1e-12,
    )
    np.testing.assert_array_equal(with_heater.block_degC, without.block_degC)
    with pytest.raises(InputError, match="time constants"):
        replace(PROFILE, side_tau_s=0.0)
