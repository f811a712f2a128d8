"""The true unit: smooth thermal bias curves that have aged since the factory measured them.

Written apart from the estimator's table: the true curve is a smooth function, not a row of nodes,
and may also carry what a table does not model (lag, rate term, hysteresis).
"""

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import CubicHermiteSpline, CubicSpline, PPoly

from ins.records import AXES, GYRO_TECHNOLOGIES, AxisDocument, InputError, TableDocument

GRID_DEGC = np.arange(-60.0, 105.0, 5.0)  # random curves are cubic splines over this grid
NODES_DEGC = np.arange(-10.0, 51.0, 10.0)
# RMS of the factory curve's linear, square and wavy part
CURVE_SIZE_DEG_H = {"rlg": 0.03, "fog": 0.1, "mems": 30.0}
SHAPE_LENGTH_DEGC = 30.0  # correlation length of the ageing shape, physics.md 6.8
SHUPE_WIDTH_DEGC = 9.0  # over which the coil's rate coefficient bends
RATE_CENTRE_DEGC = 20.0  # where thermal_rate holds
HYSTERESIS_WIDTH_DEGC = 3.0  # a turned-round temperature forgets its past over this


Triple = tuple[float, float, float]
ZERO: Triple = (0.0, 0.0, 0.0)


@dataclass(frozen=True, kw_only=True)
class ThermalTerms:
    """What of a unit's bias a table does not model, of x, y and z; all off by default.

    thermal_rate: bias per degC/min; lag_s: the bias follows the temperature this late; hysteresis:
    half of the split between heating and cooling. shupe: bias per degC/min of a fibre coil at its
    centre temperature, where it bends from half of that (cold) to one and a half (hot); it follows
    dT/dt by shupe_lag_s. thermal_rate_slope: what thermal_rate grows by per degC above
    RATE_CENTRE_DEGC. gradient: bias per degC of the gyro's own temperature difference;
    gradient_cross: of the next gyro's (x of y's, y of z's, z of x's).
    """

    thermal_rate_deg_h_per_degC_min: Triple = ZERO
    lag_s: Triple = ZERO
    hysteresis_deg_h: Triple = ZERO
    shupe_deg_h_per_degC_min: Triple = ZERO
    shupe_centre_degC: Triple = (5.0, 12.0, 18.0)
    shupe_lag_s: float = 0.0
    thermal_rate_slope_deg_h_per_degC2_min: Triple = ZERO
    gradient_deg_h_per_degC: Triple = ZERO
    gradient_cross_deg_h_per_degC: Triple = ZERO


@dataclass(frozen=True, kw_only=True)
class UnitTruth(ThermalTerms):
    """One unit as it is today: bias curves over temperature [deg/h], one an axis, held constant
    beyond their ends, and its further terms.
    """

    imu_serial: str
    gyro_technology: str
    factory_deg_h: tuple[PPoly, PPoly, PPoly]
    ageing_deg_h: tuple[PPoly, PPoly, PPoly]
    sigma_deg_h: float

    def bias_deg_h(self, axis: str, temperature_degC: ArrayLike) -> NDArray:
        """The settled true bias of an axis, mean over power-ons, at temperatures of any shape."""
        row = AXES.index(axis)
        return _value(self.factory_deg_h[row], temperature_degC) + _value(
            self.ageing_deg_h[row], temperature_degC
        )

    def bias_history_deg_h(
        self, gyro_degC: NDArray, dt_s: float, gradient_degC: NDArray | None = None
    ) -> NDArray:
        """True thermal bias (n, 3) along gyro temperatures and differences (n, 3) at even steps,
        with all the unit's terms.
        """
        bias = np.empty_like(gyro_degC)
        for k, axis in enumerate(AXES):
            felt = _lagged(gyro_degC[:, k], dt_s, self.lag_s[k])
            bias[:, k] = self.bias_deg_h(axis, felt)
            if self.thermal_rate_deg_h_per_degC_min[k]:
                bias[:, k] += (
                    self.thermal_rate_deg_h_per_degC_min[k]
                    * np.gradient(gyro_degC[:, k], dt_s)
                    * 60.0
                )
            if self.shupe_deg_h_per_degC_min[k]:
                rate = _lagged(np.gradient(gyro_degC[:, k], dt_s) * 60.0, dt_s, self.shupe_lag_s)
                bias[:, k] += self.shupe_coefficient(axis, gyro_degC[:, k]) * rate
            if self.hysteresis_deg_h[k]:
                bias[:, k] += self.hysteresis_deg_h[k] * _hysteresis(gyro_degC[:, k])
            if slope := self.thermal_rate_slope_deg_h_per_degC2_min[k]:
                bias[:, k] += (
                    slope
                    * (gyro_degC[:, k] - RATE_CENTRE_DEGC)
                    * np.gradient(gyro_degC[:, k], dt_s)
                    * 60.0
                )
            if gradient_degC is not None:
                bias[:, k] += self.gradient_deg_h_per_degC[k] * gradient_degC[:, k]
                bias[:, k] += self.gradient_cross_deg_h_per_degC[k] * gradient_degC[:, (k + 1) % 3]
        return bias

    def shupe_coefficient(self, axis: str, temperature_degC: ArrayLike) -> NDArray:
        """Bias per rate [deg/h per degC/min] of the fibre coil at temperatures of any shape."""
        k = AXES.index(axis)
        bend = np.tanh(
            (np.asarray(temperature_degC, dtype=float) - self.shupe_centre_degC[k])
            / SHUPE_WIDTH_DEGC
        )
        return np.asarray(self.shupe_deg_h_per_degC_min[k] * (1.0 + 0.5 * bend))

    def factory_table(self, node_degC: ArrayLike = NODES_DEGC) -> TableDocument:
        """The table the factory delivered (recal.table/1), its sigma that of the ageing since."""
        nodes = np.asarray(node_degC, dtype=float)
        axes: dict[str, AxisDocument] = {
            axis: {
                "temperature_degC": nodes.tolist(),
                "bias_deg_h": _value(self.factory_deg_h[k], nodes).tolist(),
                "sigma_deg_h": [self.sigma_deg_h] * nodes.size,
            }
            for k, axis in enumerate(AXES)
        }
        return {
            "schema": "recal.table/1",
            "imu_serial": self.imu_serial,
            "gyro_technology": self.gyro_technology,
            "created_utc": "2025-01-01T00:00:00Z",
            "interpolation": "linear",
            "axes": axes,
            "covariance": None,
            "provenance": {"parent_sha256": None, "runs": []},
        }


def aged_unit(
    rng: np.random.Generator,
    *,
    imu_serial: str = "SN-0042",
    gyro_technology: str = "rlg",
    ageing_offset_deg_h: float = 0.006,
    ageing_shape_deg_h: float = 0.004,
    table: TableDocument | None = None,
    shupe_lag_s: float = 0.0,
    **terms: Triple,
) -> UnitTruth:
    """A unit and its ageing: on each axis a common shift and a smooth shape (1 sigma each) above
    the factory curve.

    The factory curve is that of `table` (recal.table/1, taken as checked), else a random smooth
    one. The default ageing is 0.0072 deg/h RMS, physics.md 6.8. `terms`: of `ThermalTerms`.
    """
    if gyro_technology not in GYRO_TECHNOLOGIES:
        raise InputError(
            f"gyro_technology {gyro_technology!r}, needed one of {', '.join(GYRO_TECHNOLOGIES)}"
        )
    ageing = [
        ageing_offset_deg_h * rng.standard_normal() + ageing_shape_deg_h * _smooth_shape(rng)
        for _ in AXES
    ]
    if table is None:
        factory = [
            CubicSpline(GRID_DEGC, _factory_curve(rng, CURVE_SIZE_DEG_H[gyro_technology]))
            for _ in AXES
        ]
    else:
        factory = [_table_curve(table["axes"][axis]) for axis in AXES]
    x, y, z = factory
    ax, ay, az = (CubicSpline(GRID_DEGC, a) for a in ageing)
    return UnitTruth(
        imu_serial=imu_serial,
        gyro_technology=gyro_technology,
        factory_deg_h=(x, y, z),
        ageing_deg_h=(ax, ay, az),
        sigma_deg_h=float(np.hypot(ageing_offset_deg_h, ageing_shape_deg_h)),
        shupe_lag_s=shupe_lag_s,
        **terms,
    )


def _table_curve(axis: AxisDocument) -> PPoly:
    """The curve of one axis of a table: straight between nodes, or cubic Hermite where it has
    slopes.
    """
    nodes, bias = (np.asarray(axis[key], dtype=float) for key in ("temperature_degC", "bias_deg_h"))
    if "slope_deg_h_degC" in axis:
        return CubicHermiteSpline(nodes, bias, np.asarray(axis["slope_deg_h_degC"], dtype=float))
    return PPoly(np.stack([np.diff(bias) / np.diff(nodes), bias[:-1]]), nodes)


def _value(curve: PPoly, temperature_degC: ArrayLike) -> NDArray:
    return curve(np.clip(temperature_degC, curve.x[0], curve.x[-1]))


def _factory_curve(rng: np.random.Generator, size_deg_h: float) -> NDArray:
    """A level, a slope, a bend and a slow wave over temperature."""
    x = (GRID_DEGC - 20.0) / 40.0
    level, slope, bend, wave = size_deg_h * rng.standard_normal(4) * [1.0, 0.7, 0.3, 0.15]
    return (
        level
        + slope * x
        + bend * (x**2 - 0.5)
        + wave * np.sin(np.pi * x + rng.uniform(0, 2 * np.pi))
    )


def _smooth_shape(rng: np.random.Generator) -> NDArray:
    """A unit-variance random curve over GRID_DEGC with covariance exp(-dT^2 / (2 l^2))."""
    return _shape_root() @ rng.standard_normal(GRID_DEGC.size)


@cache
def _shape_root() -> NDArray:
    distance = (GRID_DEGC[:, None] - GRID_DEGC) / SHAPE_LENGTH_DEGC
    value, vector = np.linalg.eigh(np.exp(-0.5 * distance**2))
    return vector * np.sqrt(np.maximum(value, 0.0))


def _lagged(temperature: NDArray, dt_s: float, lag_s: float) -> NDArray:
    """First-order lag of a sampled temperature, settled before the first sample; exact for straight
    pieces.
    """
    if not lag_s:
        return temperature
    from scipy.signal import lfilter  # half a second of CPU, which most units never need

    decay = np.exp(-dt_s / lag_s)
    late = lag_s / dt_s * (1 - decay)  # share of a ramp's step that is still missing at its end
    return temperature[0] + lfilter(
        [1 - late, late - decay], [1, -decay], temperature - temperature[0]
    )


def _hysteresis(temperature: NDArray) -> NDArray:
    """From -1 (cooling) to +1 (heating): follows the sense of the change over
    HYSTERESIS_WIDTH_DEGC; starts at 0.
    """
    change = np.diff(temperature, prepend=temperature[0])
    state, out = 0.0, np.empty_like(temperature)
    for k, (sense, keep) in enumerate(
        zip(np.sign(change), np.exp(-np.abs(change) / HYSTERESIS_WIDTH_DEGC))
    ):
        state = sense + (state - sense) * keep
        out[k] = state
    return out
