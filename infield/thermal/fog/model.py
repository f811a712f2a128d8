"""The fitted fibre-optic model: read from its document, evaluated at a temperature and its rate,
tried on a held-out run.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from infield.table.thermal_table import TemperatureModel
from infield.thermal.compensation import means_both_ways
from infield.thermal.fog.piecewise import Breakpoint, Piecewise
from infield.thermal.ramp_runs import RampRun
from infield.thermal.study import check_fitted
from ins.documents import written
from ins.records import AXES, InputError, Run

SCHEMA = "recal.thermal_fog/1"


@dataclass(frozen=True)
class FogCurves:
    """K_T [deg/h] and K_delta [deg/h per degC/min] of one gyro; sigma_K_delta: temperatures and the
    sigma there, None where nothing is stated. hysteresis_deg_h: half of what warming and cooling
    differ by at any rate, which no compensation takes out.
    """

    K_T: Piecewise
    K_delta: Piecewise
    sigma_K_delta: tuple[NDArray, NDArray] | None = None
    hysteresis_deg_h: float = 0.0

    @property
    def range_degC(self) -> tuple[float, float]:
        return float(self.K_T.edges_degC[0]), float(self.K_T.edges_degC[-1])

    def settled_deg_h(self, T: NDArray) -> NDArray:
        """K_T(T)."""
        return self.K_T(T)

    def rates_deg_h(self, T: NDArray, rate_degC_min: NDArray, gradient_degC: NDArray) -> NDArray:
        """K_delta(T) dT/dt; a fibre-optic model has no gradient lines."""
        return np.asarray(self.K_delta(T) * rate_degC_min)

    def rates_sigma_deg_h(
        self, T: NDArray, rate_degC_min: NDArray, gradient_degC: NDArray
    ) -> NDArray:
        """Sigma of K_delta times the rate, and the hysteresis."""
        if self.sigma_K_delta is None:
            return np.full(np.shape(T), self.hysteresis_deg_h)
        of_rate = np.interp(T, *self.sigma_K_delta) * np.abs(rate_degC_min)
        return np.asarray(np.hypot(of_rate, self.hysteresis_deg_h))


@dataclass(frozen=True)
class FogModel(TemperatureModel):
    """The curves of each fitted gyro."""

    gyros: Mapping[str, FogCurves]

    @property
    def curves(self) -> Mapping[str, FogCurves]:
        return self.gyros


def model_from_document(document: dict[str, Any], *, name: str = "model") -> FogModel:
    """The model in a result `recal.thermal_fog/1`; InputError names what is missing."""
    check_fitted(document, SCHEMA, name)
    try:
        return FogModel({axis: _curves(fitted) for axis, fitted in document["axes"].items()})
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(
            f"{name}: axes: piecewise tables cannot be read ({type(error).__name__} {error})"
        ) from None


def _curves(fitted: dict[str, Any]) -> FogCurves:
    """One gyro of a document; models of older versions hold no hysteresis."""
    felt = fitted.get("hysteresis", {})
    return FogCurves(
        K_T=curve_from(fitted["piecewise"]["K_T"]),
        K_delta=curve_from(fitted["piecewise"]["K_delta"]),
        sigma_K_delta=(
            np.array(fitted["temperature_degC"], dtype=float),
            np.array(fitted["sigma_K_delta_deg_h_per_degC_min"], dtype=float),
        ),
        hysteresis_deg_h=abs(float(felt["value_deg_h"])) if felt.get("shown") else 0.0,
    )


def curve_from(data: dict[str, Any]) -> Piecewise:
    """One curve of a document's `thermal.fog.piecewise`."""
    marks = []
    for mark in data["breakpoints"]:
        low, high = mark["interval_95_degC"]
        told = bool(mark.get("called_for", True))
        at = mark["temperature_degC"]
        marks.append(Breakpoint(at, low, high, kind=mark["kind"], called_for=told))
    edges = np.array(data["edges_degC"], dtype=float)
    rows = np.array(data["coefficients"], dtype=float)
    if rows.ndim != 2 or edges.size != len(rows) + 1 or not np.all(np.diff(edges) > 0):
        raise ValueError("edges rise, one more than segments")
    return Piecewise(edges, rows, tuple(marks))


def shifted(curve: Piecewise, offset: float) -> Piecewise:
    """The curve less a constant."""
    rows = curve.coefficients.copy()
    rows[:, 0] -= offset
    return replace(curve, coefficients=rows)


@dataclass(frozen=True, kw_only=True)
class CheckedRamps:
    """RMS of one gyro's blocks, less their mean: before, after (smoothed temperatures), after in
    real-time order; white noise of a block.
    """

    before_deg_h: float
    after_deg_h: float
    ratio: float
    causal_after_deg_h: float
    causal_ratio: float
    noise_deg_h: float
    blocks: int


@written("run_id=run.run_id sha256=run.sha256 axes")
@dataclass(frozen=True, kw_only=True)
class HeldOutResidual:
    """Residual of a run that nothing was fitted to, its ramps' blocks, each gyro less its mean (a
    constant is Earth rate).

    axes: those with a model and blocks inside its range; rows (n, 3): these blocks; left_deg_h (n,
    3): block means after compensation.
    """

    run: RampRun
    axes: Mapping[str, CheckedRamps]
    rows: NDArray
    left_deg_h: NDArray


def held_out(run: Run, raw: RampRun, model: FogModel) -> HeldOutResidual:
    """What the model leaves of a run's ramps, `raw`, taken out of their blocks both ways."""
    taken = means_both_ways(run, model, raw.time_s)
    batch, causal = (raw.bias_deg_h - bias for bias in taken)
    rows = raw.steady[:, None] & model.inside(raw.temperature_degC)
    axes = {}
    for k, axis in enumerate(AXES):
        if not rows[:, k].any():
            continue
        before, after, late = (
            np.std(bias[rows[:, k], k]) for bias in (raw.bias_deg_h, batch, causal)
        )
        if not before > 0.0:  # one block, which is its own mean
            continue
        axes[axis] = CheckedRamps(
            before_deg_h=before,
            after_deg_h=after,
            ratio=after / before,
            causal_after_deg_h=late,
            causal_ratio=late / before,
            noise_deg_h=raw.sigma_deg_h[k],
            blocks=int(rows[:, k].sum()),
        )
    return HeldOutResidual(run=raw, axes=axes, rows=rows, left_deg_h=batch)
