"""The fitted fibre-optic model in use: bias at a temperature and its rate, applied to a run in batch or in real-time order."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from infield.causal_rate import causal_rates
from infield.piecewise import Breakpoint, Piecewise
from infield.ramp_runs import RampRun, ramp_run
from infield.thermometer import GyroTemperature, gyro_temperature
from ins.records import AXES, ImuLog, InputError, Run, TemperatureLog, TwinModel
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
            key: {axis: curve_from(fitted["piecewise"][key]) for axis, fitted in document["axes"].items()}
            for key in ("K_T", "K_delta")
        }
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"{name}: axes: piecewise tables cannot be read ({type(error).__name__} {error})") from None
    return FogModel(curves["K_T"], curves["K_delta"])


def curve_from(data: dict[str, Any]) -> Piecewise:
    """One curve of a document's `piecewise`."""
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

    before, after (smoothed temperatures), causal (real-time order), noise (3,) RMS [deg/h]; NaN for an axis without model or
    blocks inside its range. left_deg_h (n, 3): block means after compensation.
    """

    run: RampRun
    before_deg_h: NDArray
    after_deg_h: NDArray
    causal_deg_h: NDArray
    rows: NDArray
    left_deg_h: NDArray

    @property
    def noise_deg_h(self) -> NDArray:
        """White noise of a block."""
        return self.run.sigma_deg_h


def held_out(run: Run, raw: RampRun, model: FogModel, twin: TwinModel) -> HeldOut:
    """What the model leaves of a run's ramps: its increments are compensated both ways and averaged as `raw` was."""
    assert run.temperature is not None  # ramp_run has refused a run without
    imu = run.imu.whole()
    batch, causal = (
        ramp_run(replace(run, imu=compensated), twin).bias_deg_h for compensated in (
            compensate_batch(imu, model, gyro_temperature(run.temperature)), compensate_causal(imu, model, run.temperature)
        )
    )  # fmt: skip
    rows = raw.steady[:, None] & model.inside(raw.temperature_degC)
    size = np.full((3, 3), np.nan)
    for k in range(3):
        if rows[:, k].any():
            size[:, k] = [np.std(bias[rows[:, k], k]) for bias in (raw.bias_deg_h, batch, causal)]
    return HeldOut(raw, size[0], size[1], size[2], rows, batch)
