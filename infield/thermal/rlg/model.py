"""The fitted ring-laser gradient model: read from its document, evaluated at temperatures, rates
and gradient lines.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from infield.table.thermal_table import TemperatureModel
from infield.thermal.rlg.lag import LONGEST_LAG_s
from infield.thermal.rlg.terms import LINE_TERMS, TERMS, columns, rest_columns
from infield.thermal.study import check_fitted
from ins.records import AXES, InputError

SCHEMA = "recal.thermal_rlg/1"
SETTLED = np.array([name in ("K1", "K2", "K3") for name in TERMS])


@dataclass(frozen=True)
class AxisTerms:
    """One gyro: coefficients (8,) in the order of TERMS about a reference temperature, their
    covariance (8, 8), the rest at its nodes, temperatures fitted to; lag_s: of its thermometer and
    of the lines.
    """

    theta: NDArray
    covariance: NDArray
    nodes_degC: NDArray
    rest_deg_h: NDArray
    range_degC: tuple[float, float]
    reference_degC: float
    lag_s: tuple[float, float] = (0.0, 0.0)

    def settled_deg_h(self, T: NDArray) -> NDArray:
        """K1 + K2 T + K3 T^2 and the rest."""
        held = np.clip(T, *self.range_degC)
        X = self._columns(held, np.zeros_like(held), np.zeros((held.size, 3)))
        rest = rest_columns(held, self.nodes_degC) @ self.rest_deg_h
        return np.asarray(X[:, SETTLED] @ self.theta[SETTLED] + rest)

    def rates_deg_h(self, T: NDArray, rate_degC_min: NDArray, gradient_degC: NDArray) -> NDArray:
        """K4 dT/dt + K5 T dT/dt + sum K6i Tdiff_i."""
        X = self._columns(np.clip(T, *self.range_degC), rate_degC_min, gradient_degC)
        return np.asarray(X[:, ~SETTLED] @ self.theta[~SETTLED])

    def rates_sigma_deg_h(
        self, T: NDArray, rate_degC_min: NDArray, gradient_degC: NDArray
    ) -> NDArray:
        """By the coefficients' covariance."""
        X = self._columns(np.clip(T, *self.range_degC), rate_degC_min, gradient_degC)[:, ~SETTLED]
        P = self.covariance[np.ix_(~SETTLED, ~SETTLED)]
        return np.asarray(np.sqrt(np.einsum("ni,ij,nj->n", X, P, X)))

    def _columns(self, T: NDArray, rate: NDArray, gradient: NDArray) -> NDArray:
        return columns(T, rate, gradient, self.reference_degC)


@dataclass(frozen=True)
class RlgModel(TemperatureModel):
    """K1..K6 of each fitted gyro about one reference temperature.

    K1 is 0 where the level was not known apart from Earth rate: the thermal table and the alignment
    carry it.
    """

    reference_degC: float
    terms: Mapping[str, AxisTerms]

    @property
    def curves(self) -> Mapping[str, AxisTerms]:
        return self.terms

    @property
    def lags_s(self) -> NDArray:
        """Of each gyro, (0, 0) of one without a model."""
        return np.array([self.terms[a].lag_s if a in self.terms else (0.0, 0.0) for a in AXES])

    @property
    def lines(self) -> tuple[str, ...]:
        """Those with a K6 of any gyro."""
        first = TERMS.index(LINE_TERMS[0])
        used = [
            any(t.theta[first + k] for t in self.terms.values()) for k in range(len(LINE_TERMS))
        ]
        return tuple(line[-1] for line, yes in zip(LINE_TERMS, used) if yes)


def model_from_document(document: dict[str, Any], *, name: str = "model") -> RlgModel:
    """The model in a result `recal.thermal_rlg/1`; InputError names what is missing."""
    check_fitted(document, SCHEMA, name)
    try:
        reference = float(document["reference_temperature_degC"])
        found = {axis: _terms(fitted, reference) for axis, fitted in document["axes"].items()}
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise InputError(
            f"{name}: axes: terms cannot be read ({type(error).__name__} {error})"
        ) from None
    if not found or not set(found) <= set(AXES) or not np.isfinite(reference):
        raise InputError(
            f"{name}: axes: got {', '.join(found) or 'none'}, needed some of {', '.join(AXES)}"
        )
    return RlgModel(reference, found)


def _terms(fitted: Mapping[str, Any], reference_degC: float) -> AxisTerms:
    theta = np.array([fitted["terms"][name]["value"] for name in TERMS], dtype=float)
    theta[0] = theta[0] if fitted["level"]["known"] else 0.0
    covariance = np.array(fitted["covariance"], dtype=float)
    rest = fitted["rest"]
    nodes = np.array(rest["temperature_degC"], dtype=float)
    values = np.array(rest["bias_deg_h"], dtype=float)
    low, high = map(float, fitted["temperature_degC"])
    late = fitted.get("lag", {"gyro_s": 0.0, "lines_s": 0.0})  # none in models of older versions
    lag_s = float(late["gyro_s"]), float(late["lines_s"])
    if not all(0.0 <= lag <= LONGEST_LAG_s for lag in lag_s):
        raise ValueError(f"a lag from 0 to {LONGEST_LAG_s:g} s")
    if (
        covariance.shape != (len(TERMS),) * 2
        or nodes.shape != values.shape
        or nodes.size < 2
        or not low < high
    ):
        raise ValueError("covariance 8 x 8, nodes with as many values, a range that rises")
    if not all(np.isfinite(v).all() for v in (theta, covariance, nodes, values)) or not np.all(
        np.diff(nodes) > 0
    ):
        raise ValueError("finite numbers, nodes that rise")
    return AxisTerms(theta, covariance, nodes, values, (low, high), reference_degC, lag_s)
