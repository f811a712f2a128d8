"""Least squares for b = K_T(T) + K_delta(T) dT/dt over block means, the slow drift of each power-on
marginalised::

    y_k = B_T(T_k) theta_T + r_k B_d(T_k) theta_d + t_bin(k) + e_k
    r = dT/dt [degC/min],   e ~ N(0, sigma_k^2),   t ~ N(0, C)

C holds turn-on, flicker and rate random walk of each run over its bins
(`merge.session_covariance`). Smooth curves are cubic B-splines under a penalty on differences of
their coefficients, its weights averaged over their evidence (Eilers, Marx (1996); Wood (2017),
section 6.2); any other basis goes unpenalised. A level common to all rows belongs to K_T.

What no smooth curve follows (a ripple of the bias over temperature) is a variance component of
either curve, the same in all runs and both ways::

    K_T(T) = B_T(T) theta_T + u_T(T),   K_d(T) = B_d(T) theta_d + u_d(T)
    E u(T) u(T + d) = s^2 (1 + a) exp(-a),   a = sqrt(3) d / ROUGH_LENGTH_degC      (Matern, 3/2)

Its sizes s are those of best evidence, 0 where they gain less than ROUGH_NATS, against noise that
is larger than declared everywhere; s^2 is part of the variance of a curve at a temperature.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline
from scipy.linalg import block_diag, cho_factor, cho_solve
from scipy.sparse import csr_array, hstack

from infield.table.least_squares import LeastSquares, NormalEquations
from infield.thermal.study import AxisBlocks
from ins.estimation.choice import Level, Sizes, choose, climb

SPACING_degC, FEWEST_INTERVALS, MOST_INTERVALS = 3.0, 6, 28  # of the smooth basis
# differences penalised for values, and where the second derivative must be smooth
VALUE_ORDER, CURVATURE_ORDER = 2, 3
PENALTY_STEPS = np.arange(
    -3.0, 2.51, 0.5
)  # log10 of a difference over the smallest sigma: what is tried
FLAT = 1e-13  # relative, so that a null space of the penalty has a factor: 1e3 times rounding
# what no smooth curve follows: bins of its values, and over how much they go together; ripples of
# 3 to 12 degC are within it (power a frequency at 3 degC: 30 % of that at 12), and splines 3 degC
# apart follow longer ones
ROUGH_degC, ROUGH_LENGTH_degC = 0.5, 0.75
# its sizes that are tried, over the white noise of a block (K_delta: at the fastest rate)
ROUGH_STEPS = np.r_[0.0, 10.0 ** np.arange(-1.2, 1.31, 0.1)]
ROUGH_START = 8  # 0.3 of the white noise: the climb to what most ripples have is short
# log evidence that a size must gain: 8 % of gyros without a ripple do (half of chi2 with one
# degree of freedom beyond 2); with none asked for, half of them did, and sigmas were 20 % too large
ROUGH_NATS = 1.0
# log evidence below the best by more than this has no share; e^-3 is 5 % of the best
NEGLIGIBLE_NATS = 3.0
Basis = Callable[[NDArray], NDArray]


@dataclass(frozen=True)
class CurveFit:
    """Both curves: bases, coefficients (T first), covariance; chi2 of the residual over `rows`
    rows; rough: variance of each curve that its basis does not follow, chi2_bare: of the residual
    with that in it.
    """

    bases: tuple[Basis, ...]
    sizes: tuple[int, ...]
    theta: NDArray
    covariance: NDArray
    chi2: float
    rows: int
    effective: float
    rough: NDArray
    chi2_bare: float

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
        """Value and covariance of a curve (0: K_T, 1: K_delta) at temperatures (k,), what its basis
        does not follow included.
        """
        value, P = self.linear(which, self.bases[which](temperature_degC))
        return value, P + self.rough[which] * _together(temperature_degC)

    @property
    def dof(self) -> float:
        return self.rows - self.effective


class Reduced:
    """The blocks with what is random in them marginalised: M = W - W G (G'WG + Q)^-1 G'W.

    G: indicators of the drift bins, Q their precision C^-1; rough: s of what K_T and K_delta have
    in each bin of temperature, each with columns of its own (K_delta's times the rate).
    log_evidence: -log det(W M^-1) / 2, what the sizes of C and s cost.
    """

    def __init__(self, blocks: AxisBlocks, rough: tuple[float, float] = (0.0, 0.0)) -> None:
        self.blocks, self.weight, self.rough = blocks, blocks.sigma_deg_h**-2.0, rough
        G, Q = _random_effects(blocks, rough)
        self._weighted = G.multiply(self.weight[:, None]).T.tocsr()
        inner = Q + (self._weighted @ G).toarray()
        self._factor = cho_factor(0.5 * (inner + inner.T), lower=True)
        self.log_evidence = 0.5 * float(np.linalg.slogdet(Q)[1]) - float(
            np.log(np.diag(self._factor[0])).sum()
        )

    def product(self, A: NDArray, B: NDArray) -> NDArray:
        """A' M B for columns of rows."""
        left, right = self._weighted @ A, self._weighted @ B
        return np.asarray(
            A.T @ (self.weight[:, None] * B) - left.T @ cho_solve(self._factor, right)
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
        return _averaged(lambda at: self, (), bases, penalties)[1]


def fit_rough(
    blocks: AxisBlocks, bases: Sequence[Basis], penalties: Sequence[NDArray | None]
) -> tuple[Reduced, CurveFit]:
    """The fit of curves that may have more than their bases follow, and the blocks with as much of
    it as the data show best.
    """
    sigma = float(blocks.sigma_deg_h.min())
    of_rate = sigma / float(np.abs(blocks.rate_degC_min).max())

    @cache
    def at_sizes(at: tuple[int, ...]) -> Reduced:
        return Reduced(blocks, (sigma * ROUGH_STEPS[at[0]], of_rate * ROUGH_STEPS[at[1]]))

    return _averaged(at_sizes, (ROUGH_STEPS.size,) * 2, bases, penalties)


def _averaged(
    reduced_at: Callable[[tuple[int, ...]], Reduced],
    sizes_tried: tuple[int, ...],
    bases: Sequence[Basis],
    penalties: Sequence[NDArray | None],
) -> tuple[Reduced, CurveFit]:
    """Least squares averaged over the weights of the penalties at the best sizes of what is rough.

    reduced_at: the blocks at steps of these sizes, of which so many are tried.
    """
    first = reduced_at((0,) * len(sizes_tried))
    T = first.blocks.temperature_degC
    X = first.design(bases)
    sizes = tuple(basis(T[:1]).shape[1] for basis in bases)
    penalties = [*penalties, *[None] * (len(sizes) - len(penalties))]
    scale = float(first.blocks.sigma_deg_h.min())
    count = len(penalties)

    @cache
    def normal_at(steps: tuple[int, ...]) -> NormalEquations:
        return reduced_at(steps).normal(X)

    @cache
    def solve(at: tuple[int, ...]) -> LeastSquares:
        weights = [(scale * 10.0 ** PENALTY_STEPS[k]) ** -2.0 for k in at[:count]]
        normal = normal_at(at[count:])
        found = _solve(normal, sizes, penalties, weights)
        cost = reduced_at(at[count:]).log_evidence
        misfit = normal.c - normal.b @ found.x
        noisier = max(misfit / normal.rows, 1.0)  # all variances this many times as large
        cost += 0.5 * (misfit - misfit / noisier - normal.rows * np.log(noisier))
        return replace(found, log_evidence=found.log_evidence + cost)

    counts = [1 if penalty is None else PENALTY_STEPS.size for penalty in penalties]
    smooth = [Level(str(k), range(n), n // 2) for k, n in enumerate(counts)]

    def steps_of(sizes: Sizes, _: tuple[int, ...] = ()) -> tuple[int, ...]:
        return tuple(int(sizes.get(str(k), 0)) for k in range(count + len(sizes_tried)))

    def gain(one: tuple[int, ...], other: tuple[int, ...]) -> float:
        return solve(one).log_evidence - solve(other).log_evidence

    @cache
    def best_with(rough: tuple[int, ...]) -> tuple[int, ...]:
        levels = smooth + [
            Level(str(count + k), range(1, sizes_tried[k]), ROUGH_START) for k in rough
        ]
        start = steps_of({level.name: level.start for level in levels})
        return climb(start, levels, steps_of, gain)[0]

    curves = range(len(sizes_tried))
    rough = choose(curves, lambda rough: solve(best_with(rough)).log_evidence, cost_nats=ROUGH_NATS)
    at = best_with(rough)
    weight, found = _weighed(solve, at, counts)
    theta = np.einsum("k,ki->i", weight, np.array([one.x for one in found]))
    P = sum(
        w * (one.covariance + np.outer(one.x - theta, one.x - theta))
        for w, one in zip(weight, found)
    )
    normal, best = normal_at(at[count:]), reduced_at(at[count:])
    fit = CurveFit(
        bases=tuple(bases),
        sizes=sizes,
        theta=theta,
        covariance=P,
        chi2=normal.misfit(theta),
        rows=T.size,
        effective=float(np.trace(P @ normal.A)),
        rough=np.square(best.rough),
        chi2_bare=normal_at((0,) * len(sizes_tried)).misfit(theta),
    )
    return best, fit


def _together(temperature_degC: NDArray) -> NDArray:
    """Correlation (k, k) of what is rough at temperatures (k,): Matern's with exponent 3/2."""
    apart = np.abs(np.subtract.outer(temperature_degC, temperature_degC))
    a = np.sqrt(3.0) * apart / ROUGH_LENGTH_degC
    return np.asarray((1.0 + a) * np.exp(-a))


def _random_effects(blocks: AxisBlocks, rough: tuple[float, float]) -> tuple[csr_array, NDArray]:
    """Columns G (n, m) of what is random in the blocks, and its precision Q (m, m)."""
    rows = np.arange(blocks.bin.size)
    drift = blocks.drift
    root, lower = cho_factor(drift + np.diag(1e-9 * np.diag(drift) + 1e-30), lower=True)
    columns = [csr_array((np.ones(rows.size), (rows, blocks.bin)), (rows.size, len(drift)))]
    precisions = [cho_solve((root, lower), np.eye(len(drift)))]
    if any(rough):
        steps = np.floor(blocks.temperature_degC / ROUGH_degC)
        centres, bins = np.unique(steps, return_inverse=True)
        alike = np.linalg.inv(_together(ROUGH_degC * centres))
    for s, value in zip(rough, (np.ones(rows.size), blocks.rate_degC_min)):
        if s > 0.0:
            columns.append(csr_array((value, (rows, bins)), (rows.size, centres.size)))
            precisions.append(s**-2.0 * alike)
    return hstack(columns, format="csr"), np.asarray(block_diag(*precisions))


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
) -> LeastSquares:
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
    solve: Callable[[tuple[int, ...]], LeastSquares], best: tuple[int, ...], counts: Sequence[int]
) -> tuple[NDArray, list[LeastSquares]]:
    """Shares of the evidence around the best steps, in the weights of the penalties, of which so
    many each are tried, with their solutions.

    A single best step takes the smoothness for known: the intervals of 200 simulated units were
    then 15 % too short.
    """
    least = solve(best).log_evidence - NEGLIGIBLE_NATS
    todo, around = [best], {best}
    while todo:
        at = todo.pop()
        for k, count in enumerate(counts):
            for n in (at[k] - 1, at[k] + 1):
                near = (*at[:k], n, *at[k + 1 :])
                if 0 <= n < count and near not in around:
                    around.add(near)
                    todo += [near] if solve(near).log_evidence > least else []
    kept = [one for at in around if (one := solve(at)).log_evidence >= least]
    weight = np.exp([one.log_evidence - least for one in kept])
    return weight / weight.sum(), kept
