"""Thermometers that read late: by how much, found with the terms, and what that leaves open."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from infield.table.least_squares import NormalEquations, solve_each
from infield.thermal.rlg.terms import LINE_TERMS, TERMS
from ins.documents import UNWRITTEN

LONGEST_LAG_s = 1800.0  # a thermometer on the far side of a block that settles in 25 min
# tried first; chosen: from a bead's 60 s on, each about 1.5 times the one before
FIRST_LAGS_s = (0.0, 60.0, 120.0, 200.0, 300.0, 450.0, 700.0, 1000.0)
# what a lag must take off chi2 to be believed: 0.1 % of sound thermometers reach it by chance
# (one degree of freedom; chi2 10.8)
BELIEVED_CHI2 = 10.8
# of a lag that was not believed: a bead in grease follows within a minute (60 s)
USUAL_LAG_s = 60.0
OF_LINES = np.array([name in LINE_TERMS for name in TERMS])


@dataclass(frozen=True, kw_only=True)
class Lag:
    """By how much [s] a gyro's thermometer and the lines read late, 0 where that was not believed;
    sigmas of both, whether believed or not. gain_chi2: what the lags take off chi2.
    """

    gyro_s: float = 0.0
    sigma_gyro_s: float = USUAL_LAG_s
    lines_s: float = 0.0
    sigma_lines_s: float = USUAL_LAG_s
    gain_chi2: float = field(default=0.0, metadata=UNWRITTEN)

    @property
    def found(self) -> bool:
        return self.gyro_s > 0.0 or self.lines_s > 0.0

    def of_columns(self, count: int) -> NDArray:
        """Of each column of the terms and of the rest's nodes (count,)."""
        lines = np.r_[OF_LINES, np.zeros(count - len(TERMS), dtype=bool)]
        return np.where(lines, self.lines_s, self.gyro_s)


def corrected_columns(X: NDArray, time_s: NDArray, lag: Lag) -> NDArray:
    """Columns (n, p) of one run, in order of time, as thermometers without a lag would give
    them.
    """
    if not lag.found:
        return X
    return np.asarray(X + lag.of_columns(X.shape[1]) * derivatives(X, time_s))


def derivatives(X: NDArray, time_s: NDArray) -> NDArray:
    """Of columns (n, p) with time, per second."""
    return np.asarray(np.gradient(X, time_s, axis=0)) if len(X) > 1 else np.zeros_like(X)


@dataclass(frozen=True)
class LaggedNormal:
    """Normal equations of p columns and, after them, their derivatives with time."""

    normal: NormalEquations

    @property
    def count(self) -> int:
        return self.normal.b.size // 2

    def at(self, lag: Lag) -> NormalEquations:
        """Those of the columns put right for a lag."""
        lags_s = np.array([[lag.gyro_s, lag.lines_s]])
        A, b = self.under_each(lags_s, np.arange(self.count))
        return NormalEquations(A[0], b[0], self.normal.c, self.normal.rows)

    def under_each(self, lags_s: NDArray, columns: NDArray) -> tuple[NDArray, NDArray]:
        """Normal matrices (m, k, k) and right sides (m, k) of some columns (k,), put right for lags
        (m, 2) of gyro and lines [s].
        """
        k, (A, b) = columns, (self.normal.A, self.normal.b)
        d = k + self.count
        which = np.r_[OF_LINES, np.zeros(self.count - len(TERMS), dtype=bool)][k].astype(int)
        lag = lags_s[:, which]
        mixed = A[np.ix_(k, d)] * lag[:, None, :]
        both = A[np.ix_(d, d)] * (lag[:, :, None] * lag[:, None, :])
        return A[np.ix_(k, k)] + mixed + np.swapaxes(mixed, 1, 2) + both, b[k] + lag * b[d]


def find_lag(beside: LaggedNormal, columns: NDArray, precision: NDArray) -> Lag:
    """The lags that explain the runs best, if either is believed; columns (k,): those in use,
    precision (k, k): what is known of them.
    """

    def each(lags_s: NDArray) -> NDArray:
        A, b = beside.under_each(lags_s, columns)
        x, _, _ = solve_each(A, b, precision)
        return np.asarray(beside.normal.c - np.sum(b * x, axis=1))

    def left(gyro_s: float, lines_s: float) -> float:
        return float(each(np.array([[gyro_s, lines_s]]))[0])

    plain = left(0.0, 0.0)
    ways = {
        "gyro": lambda v: (v[0], 0.0),
        "lines": lambda v: (0.0, v[0]),
        "common": lambda v: (v[0], v[0]),
        "both": lambda v: (v[0], v[1]),
    }
    if not OF_LINES[columns[columns < len(TERMS)]].any():
        ways = {"gyro": ways["gyro"]}
    best, least = Lag(), plain
    for name, way in ways.items():
        start = sorted({way((first, second)) for first in FIRST_LAGS_s for second in FIRST_LAGS_s})
        begun = start[int(np.argmin(each(np.array(start))))]
        several = name == "both"
        x0 = np.array(begun if several else [max(begun)]) / USUAL_LAG_s
        found = minimize(
            lambda v, way=way: left(*way(v * USUAL_LAG_s)),
            x0,
            method="L-BFGS-B",
            bounds=[(0.0, LONGEST_LAG_s / USUAL_LAG_s)] * x0.size,
        )
        price = BELIEVED_CHI2 * x0.size
        if found.fun + price < least:
            gyro_s, lines_s = way(found.x * USUAL_LAG_s)
            gain = plain - float(found.fun)
            best = Lag(gyro_s=float(gyro_s), lines_s=float(lines_s), gain_chi2=gain)
            least = float(found.fun) + price
    return best
