"""A thermal model in use: temperatures and lines that read late, each by its own lag."""

import numpy as np
import pytest

from infield.thermal.compensation import batch_series, causal_series
from infield.thermometer.gyro_temperature import gyro_temperature
from ins.records import TemperatureLog

LAG_S, LINE_LAG_S = 300.0, 120.0
BY_degC, BY_LINE = 0.02, 0.05  # deg/h per degC
WARMS_degC_s, LINE_degC_s = 0.5 / 60.0, 0.2 / 60.0


class Linear:
    """Bias by temperature and by the gyro's own line; no term of the rate."""

    lines = ("x", "y", "z")
    lags_s = np.tile([LAG_S, LINE_LAG_S], (3, 1))

    def settled_deg_h(self, T):
        return BY_degC * T

    def rates_deg_h(self, T, rate, gradient):
        return BY_LINE * gradient


@pytest.mark.parametrize("order", ["batch", "causal"])
def test_what_reads_late_is_read_ahead_on_a_ramp(order):
    """Both lead by their lag times their own slope: 0.05 and 0.02 deg/h."""
    time_s = np.arange(0.0, 3600.0)
    T = np.repeat(20.0 + WARMS_degC_s * time_s[:, None], 3, axis=1)
    lines = np.repeat(1.0 + LINE_degC_s * time_s[:, None], 3, axis=1)
    noise = 1e-4 * np.random.default_rng(1).standard_normal((2, time_s.size, 3))
    log = TemperatureLog(time_s=time_s, gyro_degC=T + noise[0], gradient_degC=lines + noise[1])
    if order == "batch":
        series = batch_series(Linear(), log, gyro_temperature(log))
    else:
        series = causal_series(Linear(), log)
    found = series(time_s[1800:2400]) - BY_degC * T[1800:2400] - BY_LINE * lines[1800:2400]
    ahead = BY_degC * LAG_S * WARMS_degC_s + BY_LINE * LINE_LAG_S * LINE_degC_s
    assert found.mean(axis=0) == pytest.approx(ahead, rel=0.03)
