"""Least squares that say what they do not see.

Rows are whitened by the root of their covariance, columns scaled to length 1 before anything is
compared with anything, so that a unit never decides what is collinear.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

SEEN = 1e-7  # of the largest singular value of columns of length 1: what is less is not seen
LEAST = 1e-300  # of a squared length: a column of zeros is divided by something


@dataclass(frozen=True)
class RowFit:
    """Parameters x (p,) with covariance (p, p), the smallest where the rows do not see them all.

    null (p, r): directions that the rows do not see, as unit columns; left (n,): whitened
    residuals.
    """

    x: NDArray
    covariance: NDArray
    null: NDArray
    left: NDArray

    @property
    def rank(self) -> int:
        return self.x.size - self.null.shape[1]

    @property
    def chi2(self) -> float:
        return float(self.left @ self.left)

    @property
    def dof(self) -> int:
        return self.left.size - self.rank


def fit_rows(A: NDArray, y: NDArray) -> RowFit:
    """Least squares of whitened rows A (n, p), y (n,)."""
    size = np.linalg.norm(A, axis=0)
    U, s, Vt = np.linalg.svd(A / size, full_matrices=True)
    kept = int(np.sum(s > SEEN * s[0]))
    back = Vt[:kept].T / size[:, None]
    x = back @ ((U[:, :kept].T @ y) / s[:kept])
    null = Vt[kept:].T / size[:, None]
    return RowFit(
        x=x,
        covariance=(back / s[:kept] ** 2) @ back.T,
        null=null / np.linalg.norm(null, axis=0),
        left=y - A @ x,
    )


def scaled(A: NDArray) -> tuple[NDArray, NDArray]:
    """A normal matrix (p, p) with the columns behind it at length 1, and their lengths (p,)."""
    length = np.sqrt(np.maximum(np.diag(A), LEAST))
    return A / np.outer(length, length), length


def scaled_inverse(A: NDArray) -> NDArray:
    """Of a positive matrix, scaled first."""
    unit, length = scaled(A)
    P = np.linalg.inv(unit) / np.outer(length, length)
    return np.asarray(0.5 * (P + P.T))


def condition_number(A: NDArray) -> float:
    """Of the columns behind a normal matrix, each at length 1; infinite where one is zero."""
    values = np.linalg.eigvalsh(scaled(A)[0])
    return float(np.sqrt(values[-1] / values[0])) if values[0] > 0 else float("inf")
