"""The fitted fibre-optic model: read from its document, evaluated at a temperature and its rate,
tried on a held-out run.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from infield.thermal.compensation import compensate_batch, compensate_causal
from infield.thermal.piecewise import Breakpoint, Piecewise
from infield.thermal.ramp_runs import RampRun, ramp_run
from infield.thermometer.gyro_temperature import gyro_temperature
from ins.records import AXES, InputError, Run, TwinModel

SCHEMA = "recal.thermal_fog/1"


@dataclass(frozen=True)
class FogModel:
    """Piecewise K_T [deg/h] and K_delta [deg/h per degC/min] of each fitted gyro; an axis without
    one is left as it is.

    sigma_K_delta: temperatures and the sigma there, where the document has it.
    """

    K_T: Mapping[str, Piecewise]
    K_delta: Mapping[str, Piecewise]
    sigma_K_delta: Mapping[str, tuple[NDArray, NDArray]] = field(default_factory=dict)

    @property
    def axes(self) -> tuple[str, ...]:
        return tuple(self.K_T)

    @property
    def lines(self) -> tuple[str, ...]:
        return ()

    def bias_deg_h(self, temperature_degC: NDArray, rate_degC_min: NDArray) -> NDArray:
        """K_T(T) + K_delta(T) dT/dt, shapes (n, 3); beyond the fitted temperatures the end values
        are held.
        """
        return self.settled_deg_h(temperature_degC) + self.rates_deg_h(
            temperature_degC, rate_degC_min
        )

    def settled_deg_h(self, temperature_degC: NDArray) -> NDArray:
        """K_T(T)."""
        return _by_axis(temperature_degC, self.axes, lambda axis, T, k: self.K_T[axis](T))

    def rates_deg_h(
        self,
        temperature_degC: NDArray,
        rate_degC_min: NDArray,
        gradient_degC: NDArray | None = None,
    ) -> NDArray:
        """K_delta(T) dT/dt; a fibre-optic model has no gradient lines."""
        return _by_axis(
            temperature_degC,
            self.axes,
            lambda axis, T, k: self.K_delta[axis](T) * rate_degC_min[:, k],
        )

    def rates_sigma_deg_h(
        self,
        temperature_degC: NDArray,
        rate_degC_min: NDArray,
        gradient_degC: NDArray | None = None,
    ) -> NDArray:
        """Sigma of K_delta times the rate."""

        def sigma(axis: str, T: NDArray, k: int) -> NDArray:
            return np.asarray(np.interp(T, *self.sigma_K_delta[axis]) * np.abs(rate_degC_min[:, k]))

        return _by_axis(temperature_degC, tuple(self.sigma_K_delta), sigma)

    def inside(self, temperature_degC: NDArray) -> NDArray:
        """Where (n, 3) the temperatures are within the fitted range of an axis."""
        ok = np.zeros(np.shape(temperature_degC), dtype=bool)
        for k, axis in enumerate(AXES):
            if axis in self.K_T:
                edges, T = self.K_T[axis].edges_degC, temperature_degC[:, k]
                ok[:, k] = (edges[0] <= T) & (edges[-1] >= T)
        return ok


def _by_axis(
    temperature_degC: NDArray, axes: Sequence[str], value: Callable[[str, NDArray, int], NDArray]
) -> NDArray:
    """value(axis, temperatures, column) in the columns of some axes, 0 in the others."""
    out = np.zeros(np.shape(temperature_degC))
    for k, axis in enumerate(AXES):
        if axis in axes:
            out[:, k] = value(axis, temperature_degC[:, k], k)
    return out


def model_from_document(document: dict[str, Any], *, name: str = "model") -> FogModel:
    """The model in a result `recal.thermal_fog/1`; InputError names what is missing."""
    if document.get("schema") != SCHEMA:
        raise InputError(
            f"{name}: schema: got {str(document.get('schema'))[:60]!r}, needed {SCHEMA!r}"
        )
    if document.get("verdict") != "fitted":
        raise InputError(
            f"{name}: verdict: got {str(document.get('verdict'))[:60]!r}, needed 'fitted'"
        )
    try:
        curves = {
            key: {
                axis: curve_from(fitted["piecewise"][key])
                for axis, fitted in document["axes"].items()
            }
            for key in ("K_T", "K_delta")
        }
        sigma = {
            axis: (
                np.array(fitted["temperature_degC"], dtype=float),
                np.array(fitted["sigma_K_delta_deg_h_per_degC_min"], dtype=float),
            )
            for axis, fitted in document["axes"].items()
        }
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(
            f"{name}: axes: piecewise tables cannot be read ({type(error).__name__} {error})"
        ) from None
    return FogModel(curves["K_T"], curves["K_delta"], sigma)


def curve_from(data: dict[str, Any]) -> Piecewise:
    """One curve of a document's `piecewise`."""
    marks = []
    for mark in data["breakpoints"]:
        low, high = mark["interval_95_degC"]
        marks.append(Breakpoint(mark["temperature_degC"], low, high, mark["kind"]))
    edges, rows = (
        np.array(data["edges_degC"], dtype=float),
        np.array(data["coefficients"], dtype=float),
    )
    if rows.ndim != 2 or edges.size != len(rows) + 1 or not np.all(np.diff(edges) > 0):
        raise ValueError("edges rise, one more than segments")
    return Piecewise(edges, rows, tuple(marks))


def shifted(curve: Piecewise, offset: float) -> Piecewise:
    """The curve less a constant."""
    rows = curve.coefficients.copy()
    rows[:, 0] -= offset
    return replace(curve, coefficients=rows)


@dataclass(frozen=True)
class HeldOut:
    """Residual of a run that nothing was fitted to, its ramps' blocks, each gyro less its mean (a
    constant is Earth rate).

    before, after (smoothed temperatures), causal (real-time order), noise (3,) RMS [deg/h]; NaN for
    an axis without model or blocks inside its range. left_deg_h (n, 3): block means after
    compensation.
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
    """What the model leaves of a run's ramps: its increments are compensated both ways and averaged
    as `raw` was.
    """
    assert run.temperature is not None  # ramp_run has refused a run without
    imu, log = run.imu.whole(), run.temperature
    batch, causal = (
        ramp_run(replace(run, imu=compensated), twin).bias_deg_h
        for compensated in (
            compensate_batch(imu, model, log, gyro_temperature(log)),
            compensate_causal(imu, model, log),
        )
    )
    rows = raw.steady[:, None] & model.inside(raw.temperature_degC)
    size = np.full((3, 3), np.nan)
    for k in range(3):
        if rows[:, k].any():
            size[:, k] = [np.std(bias[rows[:, k], k]) for bias in (raw.bias_deg_h, batch, causal)]
    return HeldOut(raw, size[0], size[1], size[2], rows, batch)
