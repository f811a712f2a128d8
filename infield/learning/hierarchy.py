"""Technology, type, unit: each spreads about the one above it, by normal distributions of the
logarithms.

What the sessions of a unit say of its parameters enters as a quadratic about a common point (log
likelihood, gradient, curvature). The tree is then a normal distribution and is solved exactly:
messages go up from units to the technology and come down again, so that no session counts twice.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

# share of the largest curvature below which a direction is taken for not seen: differences of
# float64 log likelihoods of 1e4 keep 1e-10
LEAST_CURVATURE = 1e-9


@dataclass(frozen=True)
class Normal:
    """Mean (p,) and covariance (p, p) of logarithms."""

    mean: NDArray
    covariance: NDArray

    @property
    def sigma(self) -> NDArray:
        """Of each logarithm, (p,)."""
        return np.sqrt(np.diag(self.covariance))


@dataclass(frozen=True)
class Information:
    """What data say: information (p, p) and its vector (p,), about the common point."""

    information: NDArray
    vector: NDArray

    def spread(self, sigma: float) -> "Information":
        """Of a parent whose child differs from it by `sigma` in each logarithm."""
        inner = np.linalg.inv(np.eye(len(self.vector)) + sigma**2 * self.information)
        return Information(self.information @ inner, inner.T @ self.vector)

    def __add__(self, other: "Information") -> "Information":
        return Information(self.information + other.information, self.vector + other.vector)

    def __sub__(self, other: "Information") -> "Information":
        return Information(self.information - other.information, self.vector - other.vector)


@dataclass(frozen=True)
class Tree:
    """What is known of a technology, of its types and of its units, by name."""

    technology: Normal
    types: Mapping[str, Normal]
    units: Sequence[Normal]


def said_by(gradient: NDArray, curvature: NDArray) -> Information:
    """Of a log likelihood with this gradient (p,) and curvature (p, p) at the common point; a
    direction in which it bends upwards says nothing.
    """
    values, vectors = np.linalg.eigh(-0.5 * (curvature + curvature.T))
    seen = values > LEAST_CURVATURE * max(float(np.max(np.abs(values))), 1e-300)
    V = vectors[:, seen]
    return Information((V * values[seen]) @ V.T, V @ (V.T @ gradient))


def solve(
    prior: Information,
    units: Sequence[Information],
    types: Sequence[str],
    *,
    type_spread: float,
    unit_spread: float,
    about: NDArray,
) -> Tree:
    """The tree given what each unit's sessions say; types: the type of each unit; about: the common
    point (p,), to which the means are added.
    """
    up = [said.spread(unit_spread) for said in units]
    zero = Information(np.zeros_like(prior.information), np.zeros_like(prior.vector))
    of_type = {
        name: sum((said for said, t in zip(up, types) if t == name), start=zero)
        for name in dict.fromkeys(types)
    }
    type_up = {name: said.spread(type_spread) for name, said in of_type.items()}
    everything = sum(type_up.values(), start=prior)
    known = {
        name: of_type[name] + (everything - type_up[name]).spread(type_spread) for name in of_type
    }
    found = [
        said + (known[t] - message).spread(unit_spread)
        for said, message, t in zip(units, up, types)
    ]
    return Tree(
        _normal(everything, about),
        {name: _normal(said, about) for name, said in known.items()},
        [_normal(said, about) for said in found],
    )


def _normal(said: Information, about: NDArray) -> Normal:
    covariance = np.linalg.inv(said.information)
    return Normal(about + covariance @ said.vector, 0.5 * (covariance + covariance.T))
