"""Weighted least squares: of rows, which say what they do not see, and of normal equations, which
add and take a prior.

Rows are whitened by the root of their covariance, columns scaled to length 1 before anything is
compared with anything, so that a unit never decides what is collinear.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

SEEN = 1e-7  # of the largest singular value of columns of length 1: what is less is not seen
LEAST_SQUARE = 1e-300  # of a squared length: a column of zeros is divided by something


@dataclass(frozen=True)
class RowFit:
    """Parameters x (p,) with covariance (p, p), the smallest where the rows do not see them all.

    null (p, r): directions that the rows do not see, as unit columns; left (n,): whitened
    residuals. Several right-hand sides at once have x (p, k) and left (n, k).
    """

    x: NDArray
    covariance: NDArray
    null: NDArray
    left: NDArray

    @property
    def rank(self) -> int:
        return len(self.x) - self.null.shape[1]

    @property
    def chi2(self) -> float:
        return float(np.sum(self.left**2))

    @property
    def dof(self) -> int:
        return self.left.size - self.rank * (self.left.size // len(self.left))


def fit_correlated(A: NDArray, y: NDArray, covariance: NDArray) -> RowFit:
    """Least squares of rows A (n, p), y (n,) whose errors have a covariance (n, n); LinAlgError
    where that is not positive definite.
    """
    root = np.linalg.cholesky(covariance)
    return fit_rows(np.linalg.solve(root, A), np.linalg.solve(root, y))


def fit_rows(A: NDArray, y: NDArray) -> RowFit:
    """Least squares of whitened rows A (n, p), y (n,) or (n, k)."""
    size = np.linalg.norm(A, axis=0)
    # all of Vt is needed, for what is not seen; of U only what is
    U, s, Vt = np.linalg.svd(A / size, full_matrices=len(A) < A.shape[1])
    kept = int(np.sum(s > SEEN * s[0]))
    back = Vt[:kept].T / size[:, None]
    x = (back / s[:kept]) @ (U[:, :kept].T @ y)
    null = Vt[kept:].T / size[:, None]
    return RowFit(
        x=x,
        covariance=(back / s[:kept] ** 2) @ back.T,
        null=null / np.linalg.norm(null, axis=0),
        left=y - A @ x,
    )


def scaled(A: NDArray) -> tuple[NDArray, NDArray]:
    """A normal matrix (p, p) with the columns behind it at length 1, and their lengths (p,)."""
    length = np.sqrt(np.maximum(np.diag(A), LEAST_SQUARE))
    return A / np.outer(length, length), length


@dataclass(frozen=True)
class LeastSquares:
    """Parameters x (p,) with covariance (p, p). log_evidence: of the rows, less the constant that
    the prior's own normalisation and the number of rows give.
    """

    x: NDArray
    covariance: NDArray
    log_evidence: float


@dataclass(frozen=True)
class NormalEquations:
    """Rows X (n, p), y (n,) of precision M, summed: A = X'MX, b = X'My, c = y'My, and how many."""

    A: NDArray
    b: NDArray
    c: float
    rows: int

    def __add__(self, other: "NormalEquations") -> "NormalEquations":
        return NormalEquations(
            self.A + other.A, self.b + other.b, self.c + other.c, self.rows + other.rows
        )

    def of(self, columns: NDArray) -> "NormalEquations":
        """Those of some columns (k,) alone."""
        return NormalEquations(self.A[np.ix_(columns, columns)], self.b[columns], self.c, self.rows)

    def solve(self, precision: NDArray | None = None) -> LeastSquares:
        """With a prior N(0, precision^-1), precision (p, p), improper where it is singular; None:
        with none.

        log_evidence = (b'x - c - log det(A + precision)) / 2.
        """
        known = np.zeros_like(self.A) if precision is None else precision
        each = solve_each(self.A[None], self.b[None], known)
        x, P, log_det = (values[0] for values in each)
        return LeastSquares(x, P, 0.5 * (float(self.b @ x) - self.c - float(log_det)))

    def misfit(self, x: NDArray) -> float:
        """(y - X x)' M (y - X x)."""
        return float(self.c - 2.0 * self.b @ x + x @ self.A @ x)


def solve_each(A: NDArray, b: NDArray, precision: NDArray) -> tuple[NDArray, NDArray, NDArray]:
    """`NormalEquations.solve` of m matrices A (m, k, k) and right sides b (m, k) at once.

    Returns x (m, k), their covariances (m, k, k), log det(A + precision) (m,).
    """
    A = A + precision
    length = np.sqrt(np.maximum(np.diagonal(A, axis1=1, axis2=2), LEAST_SQUARE))
    root = np.linalg.cholesky(A / (length[:, :, None] * length[:, None, :]))
    back = np.linalg.inv(root) / length[:, None, :]
    P = np.swapaxes(back, 1, 2) @ back
    log_det = 2.0 * np.log(np.diagonal(root, axis1=1, axis2=2) * length).sum(axis=1)
    return (P @ b[:, :, None])[:, :, 0], P, log_det


def condition_number(A: NDArray) -> float:
    """Of the columns behind a normal matrix, each at length 1; infinite where one is zero."""
    values = np.linalg.eigvalsh(scaled(A)[0])
    return float(np.sqrt(values[-1] / values[0])) if values[0] > 0 else float("inf")
