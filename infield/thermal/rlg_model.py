"""The fitted ring-laser gradient model: read from its document, evaluated at temperatures, rates
and gradient lines.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from infield.thermal.gradient_terms import LINES, TERMS, columns, rest_columns
from ins.records import AXES, InputError

SCHEMA = "recal.thermal_rlg/1"
SETTLED = np.array([name in ("K1", "K2", "K3") for name in TERMS])


@dataclass(frozen=True)
class AxisTerms:
    """Coefficients (8,) in the order of TERMS, their covariance (8, 8), the rest at its nodes,
    temperatures fitted to.
    """

    theta: NDArray
    covariance: NDArray
    nodes_degC: NDArray
    rest_deg_h: NDArray
    range_degC: tuple[float, float]

    def within(self, T: NDArray) -> NDArray:
        return np.clip(T, *self.range_degC)


@dataclass(frozen=True)
class RlgModel:
    """K1..K6 of each fitted gyro about one reference temperature; beyond the fitted temperatures
    the end values are held.

    K1 is 0 where the level was not known apart from Earth rate: the thermal table and the alignment
    carry it.
    """

    reference_degC: float
    terms: Mapping[str, AxisTerms]

    @property
    def axes(self) -> tuple[str, ...]:
        return tuple(self.terms)

    @property
    def lines(self) -> tuple[str, ...]:
        return tuple(
            line[-1]
            for k, line in enumerate(LINES)
            if any(t.theta[5 + k] for t in self.terms.values())
        )

    def settled_deg_h(self, temperature_degC: NDArray) -> NDArray:
        """K1 + K2 T + K3 T^2 and the rest, shape (n, 3)."""
        bias = np.zeros(np.shape(temperature_degC))
        for k, axis in enumerate(AXES):
            if axis in self.terms:
                t = self.terms[axis]
                T = t.within(temperature_degC[:, k])
                X = self._columns(T, np.zeros_like(T), np.zeros((T.size, 3)))
                bias[:, k] = (
                    X[:, SETTLED] @ t.theta[SETTLED] + rest_columns(T, t.nodes_degC) @ t.rest_deg_h
                )
        return bias

    def rates_deg_h(
        self, temperature_degC: NDArray, rate_degC_min: NDArray, gradient_degC: NDArray
    ) -> NDArray:
        """K4 dT/dt + K5 T dT/dt + sum K6i Tdiff_i, shape (n, 3)."""
        bias = np.zeros(np.shape(temperature_degC))
        for k, axis in enumerate(AXES):
            if axis in self.terms:
                t = self.terms[axis]
                X = self._columns(
                    t.within(temperature_degC[:, k]), rate_degC_min[:, k], gradient_degC
                )
                bias[:, k] = X[:, ~SETTLED] @ t.theta[~SETTLED]
        return bias

    def rates_sigma_deg_h(
        self, temperature_degC: NDArray, rate_degC_min: NDArray, gradient_degC: NDArray
    ) -> NDArray:
        """By the coefficients' covariance."""
        sigma = np.zeros(np.shape(temperature_degC))
        for k, axis in enumerate(AXES):
            if axis in self.terms:
                t = self.terms[axis]
                X = self._columns(
                    t.within(temperature_degC[:, k]), rate_degC_min[:, k], gradient_degC
                )[:, ~SETTLED]
                sigma[:, k] = np.sqrt(
                    np.einsum("ni,ij,nj->n", X, t.covariance[np.ix_(~SETTLED, ~SETTLED)], X)
                )
        return sigma

    def inside(self, temperature_degC: NDArray) -> NDArray:
        ok = np.zeros(np.shape(temperature_degC), dtype=bool)
        for k, axis in enumerate(AXES):
            if axis in self.terms:
                low, high = self.terms[axis].range_degC
                ok[:, k] = (low <= temperature_degC[:, k]) & (temperature_degC[:, k] <= high)
        return ok

    def _columns(self, T: NDArray, rate: NDArray, gradient: NDArray) -> NDArray:
        return columns(T, rate, gradient, self.reference_degC)


def model_from_document(document: dict[str, Any], *, name: str = "model") -> RlgModel:
    """The model in a result `recal.thermal_rlg/1`; InputError names what is missing."""
    if document.get("schema") != SCHEMA:
        raise InputError(
            f"{name}: schema: got {str(document.get('schema'))[:60]!r}, needed {SCHEMA!r}"
        )
    if document.get("verdict") != "fitted":
        raise InputError(
            f"{name}: verdict: got {str(document.get('verdict'))[:60]!r}, needed 'fitted'"
        )
    try:
        found = {axis: _terms(fitted) for axis, fitted in document["axes"].items()}
        reference = float(document["reference_temperature_degC"])
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise InputError(
            f"{name}: axes: terms cannot be read ({type(error).__name__} {error})"
        ) from None
    if not found or not set(found) <= set(AXES) or not np.isfinite(reference):
        raise InputError(
            f"{name}: axes: got {', '.join(found) or 'none'}, needed some of {', '.join(AXES)}"
        )
    return RlgModel(reference, found)


def _terms(fitted: dict[str, Any]) -> AxisTerms:
    theta = np.array([fitted["terms"][name]["value"] for name in TERMS], dtype=float)
    theta[0] = theta[0] if fitted["level"]["known"] else 0.0
    covariance = np.array(fitted["covariance"], dtype=float)
    rest = fitted["rest"]
    nodes, values = (
        np.array(rest["temperature_degC"], dtype=float),
        np.array(rest["bias_deg_h"], dtype=float),
    )
    low, high = map(float, fitted["temperature_degC"])
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
    return AxisTerms(theta, covariance, nodes, values, (low, high))
