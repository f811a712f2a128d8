"""Temperature histories: closed-form lags solve their differential equations, start level and
settle.
"""

import numpy as np
import pytest

from ins.records import InputError
from trajectories.simulator.thermal import STARTS, ThermalHistory, thermal_history

T = np.arange(0.0, 20_000.0, 1.0)


@pytest.mark.parametrize("start", STARTS)
def test_gyros_lag_the_block_by_their_time_constant(start):
    """tau dT/dt = T_block - T of the gyro less its own heat, by central differences; sun too. The
    difference at a gyro is a fraction of that.
    """
    history = thermal_history(start)
    at = history.at(T)
    for k in range(3):
        tau = history.gyro_tau_s[k]
        own = history.gyro_rise_degC[k] * (1 - np.exp(-T / tau))
        lagged = at.gyro_degC[:, k] - own
        rate = np.gradient(lagged, T)
        behind = at.block_degC - lagged
        np.testing.assert_allclose(at.gradient_degC[:, k], history.gradient_fraction[k] * behind)
        residual = (tau * rate - behind)[2:-2]
        # 0.1 % of the sun's time constant is bent to keep it off tau
        assert np.max(np.abs(residual)) < 0.02


@pytest.mark.parametrize("start", STARTS)
def test_it_starts_at_the_start_and_settles(start):
    history = thermal_history(start)
    at = history.at(np.array([0.0, 1.0, 40_000.0]))
    np.testing.assert_allclose(at.gyro_degC[0], history.start_degC)
    # level: below 1.2 degC/min in the first second
    assert np.max(np.abs(np.diff(at.gyro_degC[:2], axis=0))) < 0.02
    settled = history.settled_degC + history.sun_degC
    np.testing.assert_allclose(
        at.gyro_degC[2], settled + np.array(history.gyro_rise_degC), atol=1e-3
    )
    np.testing.assert_allclose(at.gradient_degC[2], 0.0, atol=1e-3)


def test_bad_starts_and_times_are_refused():
    with pytest.raises(InputError, match="'tepid'"):
        thermal_history("tepid")
    with pytest.raises(InputError, match="above 0"):
        ThermalHistory(ambient_degC=0.0, start_degC=0.0, settled_degC=1.0, block_tau_s=0.0)
