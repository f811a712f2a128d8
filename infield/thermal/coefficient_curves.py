"""Least squares for b = K_T(T) + K_delta(T) dT/dt over block means, the slow drift of each power-on
marginalised::

    y_k = B_T(T_k) theta_T + r_k B_d(T_k) theta_d + t_bin(k) + e_k
    r = dT/dt [degC/min],   e ~ N(0, sigma_k^2),   t ~ N(0, C)

C holds turn-on, flicker and rate random walk of each run over its bins
(`merge.session_covariance`). Smooth curves are cubic B-splines under a penalty on differences of
their coefficients, its weights averaged over their evidence (Eilers, Marx (1996); Wood (2017),
section 6.2); any other basis goes unpenalised. A level common to all rows belongs to K_T.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline
from scipy.linalg import cho_factor, cho_solve

from infield.table.least_squares import NormalEquations, Solution
from infield.thermal.blocks import AxisBlocks

SPACING_degC, FEWEST_INTERVALS, MOST_INTERVALS = 3.0, 6, 28  # of the smooth basis
# differences penalised for values, and where the second derivative must be smooth
VALUE_ORDER, CURVATURE_ORDER = 2, 3
PENALTY_STEPS = np.arange(
    -3.0, 2.51, 0.5
)  # log10 of a difference over the smallest sigma: what is tried
FLAT = 1e-13  # relative precision added so that a null space of the penalty has a factor
# log evidence below the best by more than this has no share; e^-3 is 5 % of the best
NEGLIGIBLE_NATS = 3.0
Basis = Callable[[NDArray], NDArray]


@dataclass(frozen=True)
class CurveFit:
    """Both curves: bases, coefficients (T first), covariance; chi2 of the residual over `rows`
    rows.
    """

    bases: tuple[Basis, ...]
    sizes: tuple[int, ...]
    theta: NDArray
    covariance: NDArray
    chi2: float
    rows: int
    effective: float

    def part(self, which: int) -> slice:
        start = sum(self.sizes[:which])
        return slice(start, start + self.sizes[which])

    def linear(self, which: int, rows: NDArray) -> tuple[NDArray, NDArray]:
        """Value (k,) and covariance (k, k) of linear functions rows (k, p) of one curve's
        coefficients.
        """
        part = self.part(which)
        return rows @ self.theta[part], rows @ self.covariance[part, part] @ rows.T

    def at(self, which: int, temperature_degC: NDArray) -> tuple[NDArray, NDArray]:
        """Value and covariance of a curve (0: K_T, 1: K_delta) at temperatures (k,)."""
        return self.linear(which, self.bases[which](temperature_degC))

    @property
    def dof(self) -> float:
        return self.rows - self.effective


class Reduced:
    """The blocks with their drift marginalised: M = W - W D (D'WD + C^-1)^-1 D'W, D the indicator
    of the bins.
    """

    def __init__(self, blocks: AxisBlocks) -> None:
        self.blocks, self.weight = blocks, blocks.sigma_deg_h**-2.0
        self._bins = blocks.drift.shape[0]
        root, lower = cho_factor(
            blocks.drift + np.diag(1e-9 * np.diag(blocks.drift) + 1e-30), lower=True
        )
        precision = cho_solve((root, lower), np.eye(self._bins))
        precision[np.diag_indices(self._bins)] += np.bincount(blocks.bin, self.weight, self._bins)
        self._factor = cho_factor(0.5 * (precision + precision.T), lower=True)

    def product(self, A: NDArray, B: NDArray) -> NDArray:
        """A' M B for columns of rows."""
        return A.T @ (self.weight[:, None] * B) - self._binned(A).T @ cho_solve(
            self._factor, self._binned(B)
        )

    def normal(self, X: NDArray) -> NormalEquations:
        """Normal equations of the blocks' bias on columns X (n, p)."""
        both = np.column_stack([X, self.blocks.bias_deg_h])  # one solution of the drift for both
        S = self.product(both, both)
        return NormalEquations(S[:-1, :-1], S[:-1, -1], float(S[-1, -1]), self.weight.size)

    def design(self, bases: Sequence[Basis]) -> NDArray:
        """Rows of the model: the first basis for K_T, the second, where there is one, times the
        rate for K_delta, the third times the senses for hysteresis.
        """
        columns = [basis(self.blocks.temperature_degC) for basis in bases]
        if len(columns) > 1:
            columns[1] = columns[1] * self.blocks.rate_degC_min[:, None]
        if len(columns) > 2:
            assert self.blocks.sense is not None
            columns[2] = columns[2] * self.blocks.sense
        return np.concatenate(columns, axis=1)

    def fit(self, bases: Sequence[Basis], penalties: Sequence[NDArray | None] = ()) -> CurveFit:
        """Least squares with given penalties, their weights from the evidence; None: that curve is
        free.
        """
        X = self.design(bases)
        normal = self.normal(X)
        sizes = tuple(basis(self.blocks.temperature_degC[:1]).shape[1] for basis in bases)
        penalties = [*penalties, *[None] * (len(sizes) - len(penalties))]
        solve = partial(_solve, normal, sizes, penalties)
        scale = float(self.blocks.sigma_deg_h.min())
        weight, found = _weighed(
            lambda at: solve([(scale * 10.0 ** PENALTY_STEPS[k]) ** -2.0 for k in at]), penalties
        )
        theta = np.einsum("k,ki->i", weight, np.array([one.x for one in found]))
        P = sum(
            w * (one.covariance + np.outer(one.x - theta, one.x - theta))
            for w, one in zip(weight, found)
        )
        return CurveFit(
            bases=tuple(bases),
            sizes=sizes,
            theta=theta,
            covariance=P,
            chi2=normal.misfit(theta),
            rows=self.weight.size,
            effective=float(np.trace(P @ normal.A)),
        )

    def _binned(self, A: NDArray) -> NDArray:
        out = np.zeros((self._bins, A.shape[1]))
        np.add.at(out, self.blocks.bin, self.weight[:, None] * A)
        return out


def smooth_basis(
    low_degC: float, high_degC: float, order: int = VALUE_ORDER
) -> tuple[Basis, NDArray]:
    """Cubic B-splines over a range, held beyond it, and the penalty D'D of their differences of an
    order.
    """
    count = int(
        np.clip(round((high_degC - low_degC) / SPACING_degC), FEWEST_INTERVALS, MOST_INTERVALS)
    )
    basis = spline_basis(
        np.linspace(low_degC, high_degC, count + 1), degree=3, multiplicity=1, open_ends=False
    )
    D = np.diff(np.eye(count + 3), order, axis=0)
    return basis, D.T @ D


def spline_basis(
    breaks_degC: NDArray,
    *,
    degree: int,
    multiplicity: int,
    open_ends: bool = True,
    derivative: int = 0,
) -> Basis:
    """B-splines on breakpoints; inner ones repeated `multiplicity` times (degree: only the value is
    continuous).

    Temperatures beyond the ends take the value at the end. open_ends False: uniform knots beyond
    the ends.
    """
    breaks = np.asarray(breaks_degC, dtype=float)
    if open_ends:
        knots = np.r_[
            [breaks[0]] * (degree + 1),
            np.repeat(breaks[1:-1], multiplicity),
            [breaks[-1]] * (degree + 1),
        ]
    else:
        h = breaks[1] - breaks[0]
        knots = np.r_[
            breaks[0] - h * np.arange(degree, 0, -1),
            breaks,
            breaks[-1] + h * np.arange(1, degree + 1),
        ]
    splines = BSpline(knots, np.eye(knots.size - degree - 1), degree)
    return _Evaluated(
        splines.derivative(derivative) if derivative else splines,
        float(breaks[0]),
        float(breaks[-1]),
    )


@dataclass(frozen=True)
class _Evaluated:
    splines: BSpline
    low: float
    high: float

    def __call__(self, temperature_degC: NDArray) -> NDArray:
        return np.asarray(self.splines(np.clip(temperature_degC, self.low, self.high)))

    def derivative(self, order: int) -> Basis:
        return _Evaluated(self.splines.derivative(order), self.low, self.high)


def derivative_rows(basis: Basis, temperature_degC: NDArray, order: int) -> NDArray:
    """Rows (k, p) of the derivative of a basis made here."""
    assert isinstance(basis, _Evaluated)
    return basis.derivative(order)(temperature_degC)


def _solve(
    normal: NormalEquations,
    sizes: tuple[int, ...],
    penalties: Sequence[NDArray | None],
    weights: list[float],
) -> Solution:
    """Bayesian regression with precision weight x penalty (improper in its null space)."""
    precision, start, rank_terms = np.zeros_like(normal.A), 0, 0.0
    for size, penalty, weight in zip(sizes, penalties, weights):
        if penalty is not None:
            precision[start : start + size, start : start + size] += weight * penalty
            rank_terms += 0.5 * np.linalg.matrix_rank(penalty) * np.log(weight)
        start += size
    flat = FLAT * (np.diag(normal.A) + np.diag(precision))
    found = normal.solve(precision + np.diag(flat))
    return replace(found, log_evidence=found.log_evidence + rank_terms)


def _weighed(
    solve: Callable[[Sequence[int]], Solution], penalties: Sequence[NDArray | None]
) -> tuple[NDArray, list[Solution]]:
    """Solutions around the best steps of the penalties, each with its share of the evidence.

    A single best step takes the smoothness for known: the intervals of 200 simulated units were
    then 15 % too short.
    """
    free = [which for which, penalty in enumerate(penalties) if penalty is not None]
    at = (len(PENALTY_STEPS) // 2,) * len(penalties)
    tried: dict[tuple[int, ...], Solution] = {at: solve(at)}

    def neighbours(at: tuple[int, ...]) -> list[tuple[int, ...]]:
        near = [
            (*at[:which], at[which] + sense, *at[which + 1 :])
            for which in free
            for sense in (-1, 1)
        ]
        return [key for key in near if 0 <= min(key) and max(key) < len(PENALTY_STEPS)]

    while True:  # climb
        tried.update({key: solve(key) for key in neighbours(at) if key not in tried})
        top = max(tried, key=lambda key: tried[key].log_evidence)
        if top == at:
            break
        at = top
    best, todo, seen = tried[at].log_evidence, [at], {at}
    while todo:  # and look around
        for key in neighbours(todo.pop()):
            if key not in seen:
                seen.add(key)
                tried.setdefault(key, solve(key))
                todo += [key] if tried[key].log_evidence > best - NEGLIGIBLE_NATS else []
    kept = [found for found in tried.values() if found.log_evidence >= best - NEGLIGIBLE_NATS]
    weight = np.exp([found.log_evidence - best for found in kept])
    return weight / weight.sum(), kept
