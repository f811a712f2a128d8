"""The fitted fibre-optic model in use: bias at a temperature and its rate, applied to a run in batch or in real-time order."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from infield.causal_rate import causal_rates
from infield.piecewise import Breakpoint, Piecewise
from infield.ramp_runs import RampRun
from infield.thermometer import GyroTemperature
from ins.records import AXES, ImuLog, InputError, TemperatureLog
from ins.units import DEG_PER_HOUR

SCHEMA = "recal.thermal_fog/1"


@dataclass(frozen=True)
class FogModel:
    """Piecewise K_T [deg/h] and K_delta [deg/h per degC/min] of each fitted gyro; an axis without one is left as it is."""

    K_T: Mapping[str, Piecewise]
    K_delta: Mapping[str, Piecewise]

    def bias_deg_h(self, temperature_degC: NDArray, rate_degC_min: NDArray) -> NDArray:
        """K_T(T) + K_delta(T) dT/dt, shapes (n, 3); beyond the fitted temperatures the end values are held."""
        bias = np.zeros(np.shape(temperature_degC))
        for k, axis in enumerate(AXES):
            if axis in self.K_T:
                T = temperature_degC[:, k]
                bias[:, k] = self.K_T[axis](T) + self.K_delta[axis](T) * rate_degC_min[:, k]
        return bias

    def inside(self, temperature_degC: NDArray) -> NDArray:
        """Where (n, 3) the temperatures are within the fitted range of an axis."""
        ok = np.zeros(np.shape(temperature_degC), dtype=bool)
        for k, axis in enumerate(AXES):
            if axis in self.K_T:
                edges, T = self.K_T[axis].edges_degC, temperature_degC[:, k]
                ok[:, k] = (edges[0] <= T) & (edges[-1] >= T)
        return ok


def model_from_document(document: dict[str, Any], *, name: str = "model") -> FogModel:
    """The model in a result `recal.thermal_fog/1`; InputError names what is missing."""
    if document.get("schema") != SCHEMA:
        raise InputError(f"{name}: schema: got {str(document.get('schema'))[:60]!r}, needed {SCHEMA!r}")
    if document.get("verdict") != "fitted":
        raise InputError(f"{name}: verdict: got {str(document.get('verdict'))[:60]!r}, needed 'fitted'")
    try:
        curves = {
            key: {axis: _curve(fitted["piecewise"][key]) for axis, fitted in document["axes"].items()}
            for key in ("K_T", "K_delta")
        }
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"{name}: axes: piecewise tables cannot be read ({type(error).__name__} {error})") from None
    return FogModel(curves["K_T"], curves["K_delta"])


def _curve(data: dict[str, Any]) -> Piecewise:
    marks = []
    for mark in data["breakpoints"]:
        low, high = mark["interval_95_degC"]
        marks.append(Breakpoint(mark["temperature_degC"], low, high, mark["kind"]))
    edges, rows = np.array(data["edges_degC"], dtype=float), np.array(data["coefficients"], dtype=float)
    if rows.ndim != 2 or edges.size != len(rows) + 1 or not np.all(np.diff(edges) > 0):
        raise ValueError("edges rise, one more than segments")
    return Piecewise(edges, rows, tuple(marks))


def shifted(curve: Piecewise, offset: float) -> Piecewise:
    """The curve less a constant."""
    rows = curve.coefficients.copy()
    rows[:, 0] -= offset
    return replace(curve, coefficients=rows)


def compensate_batch(imu: ImuLog, model: FogModel, temperature: GyroTemperature) -> ImuLog:
    """The increments less the model's bias, with the smoothed temperatures of the whole run."""
    middle = imu.time_s - 0.5 * imu.dt_s
    rate = np.stack([np.interp(middle, temperature.time_s, column) for column in temperature.rate_degC_min.T], axis=1)
    return _subtract(imu, model.bias_deg_h(temperature.at(middle), rate))


def compensate_causal(imu: ImuLog, model: FogModel, log: TemperatureLog) -> ImuLog:
    """The same in real-time order: each row sees only temperature readings up to its own time."""
    T, rate = causal_rates(log.time_s, log.gyro_degC)
    row = np.searchsorted(log.time_s, imu.time_s, side="right") - 1
    bias = model.bias_deg_h(T, rate)
    return _subtract(imu, np.where((row >= 0)[:, None], bias[np.maximum(row, 0)], 0.0))


def _subtract(imu: ImuLog, bias_deg_h: NDArray) -> ImuLog:
    bias = np.where(np.isfinite(bias_deg_h), bias_deg_h, 0.0)
    return replace(imu, dtheta_rad=imu.dtheta_rad - bias * DEG_PER_HOUR * imu.dt_s[:, None])


@dataclass(frozen=True)
class HeldOut:
    """Residual of a run that nothing was fitted to, its ramps' blocks, each gyro less its mean (a constant is Earth rate).

    before, after, noise (3,) RMS [deg/h]; NaN for an axis without model or blocks inside its range.
    """

    run: RampRun
    before_deg_h: NDArray
    after_deg_h: NDArray
    noise_deg_h: NDArray
    rows: NDArray
    model_deg_h: NDArray


def held_out(run: RampRun, model: FogModel) -> HeldOut:
    """What the model leaves of a ramp."""
    bias = model.bias_deg_h(run.temperature_degC, run.rate_degC_min)
    rows = run.steady[:, None] & model.inside(run.temperature_degC)
    before, after = np.full(3, np.nan), np.full(3, np.nan)
    for k in range(3):
        if rows[:, k].any():
            raw, left = run.bias_deg_h[rows[:, k], k], (run.bias_deg_h - bias)[rows[:, k], k]
            before[k], after[k] = np.std(raw), np.std(left)
    return HeldOut(run, before, after, run.sigma_deg_h, rows, bias)
