"""The covariance of the terms, with what the data leave open: lags of thermometers, and terms that
go with others and were dropped.

A model with fewer terms and fixed lags is stated, but its sigmas are those of the whole: every term
that may be there has its usual size for a prior, every lag of the thermometers a share::

    P = sum_i w_i [P_i + (m_i - theta) (m_i - theta)']

over the lags i, m_i and P_i being the posterior of all terms under them and w_i their share of the
evidence.

Sources: MacKay (1992), Bayesian interpolation, eq. (2.6); mixtures: Bishop (2006), eq. (2.63).
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from infield.table.least_squares import solve_each
from infield.thermal.rlg.lag import Lag, LaggedNormal, LONGEST_LAG_s, USUAL_LAG_s
from infield.thermal.rlg.terms import TERMS

# what a term may be, 1 sigma in its own unit: K4, K5 and lines as large as the units of
# R19 have them; K1 and K2, which the level and the curve show, ten times that
USUAL_SIZE = {"K1": 1.0, "K2": 0.01, "K3": 4e-5, "K4": 0.05, "K5": 8e-4, "own": 0.04, "other": 0.02}
# of thermometers that are later than a bead in grease (USUAL_LAG_s): three in ten, up to 1800 s
RARELY_LATE = 0.3
# thermometers of one unit are of one kind: four units in five have lags within 20 % and 20 s of
# each other; without it one gyro of 120 was 7 sigma off, whose lines were found late and whose
# thermometer the runs do not tell
ALIKE_UNITS, ALIKE_SHARE, ALIKE_s = 0.8, 0.2, 20.0
# a cell of lags with a larger share of the evidence is split; 3 %: the moments then move by less
# than 1 % when it is 1 %
SPLIT_SHARE = 0.03
MOST_SPLITS = 14  # of splitting: from 130 s down to 0.01 s
CELLS_A_SIDE = 8
# the middle of a cell wider than this may lie so much below a maximum within it: lags are known to
# 10 to 80 s where they are late
BLIND_s, BLIND_NATS = 40.0, 15.0


@dataclass(frozen=True)
class Open:
    """What was taken: masks (8,) of the terms that may be there, the gyro's own line, the size of
    the rest, scatter of the residual (at least 1).
    """

    allowed: NDArray
    own: str
    rest_deg_h: float
    scatter: float


def covariance_of(
    beside: LaggedNormal, theta: NDArray, lag: Lag, taken: Open
) -> tuple[NDArray, Lag]:
    """Covariance (p, p) of coefficients theta (p,), and the lag with its sigmas."""
    rest = np.full(theta.size - len(TERMS), taken.rest_deg_h > 0)
    at = np.flatnonzero(np.r_[taken.allowed, rest])
    precision = np.array([_usual_size(int(k), taken) for k in at]) ** -2.0
    lines = any(TERMS[k].startswith("K6") for k in at if k < len(TERMS))
    told = np.array([lag.gyro_s, lag.lines_s])
    cells, share = _shares(beside, at, precision, taken, lines)
    x, each, _ = solve_each(
        *beside.under_each(cells.lags_s, at), np.diag(taken.scatter * precision)
    )
    off = np.broadcast_to(-theta, (share.size, theta.size)).copy()
    off[:, at] += x
    P = off.T @ (share[:, None] * off)
    P[np.ix_(at, at)] += taken.scatter * np.tensordot(share, each, axes=1)
    late = cells.lags_s - told
    moments = late.T @ (share[:, None] * late) + np.diag(share @ np.square(cells.width_s) / 12.0)
    sigma = np.sqrt(np.diag(moments))
    return 0.5 * (P + P.T), replace(
        lag, sigma_gyro_s=float(sigma[0]), sigma_lines_s=float(sigma[1]) if lines else USUAL_LAG_s
    )


def _usual_size(k: int, taken: Open) -> float:
    """The sigma of a coefficient of which nothing is known."""
    if k >= len(TERMS):
        return taken.rest_deg_h
    name = TERMS[k]
    if name in USUAL_SIZE:
        return USUAL_SIZE[name]
    return USUAL_SIZE["own" if name == taken.own else "other"]


@dataclass(frozen=True)
class LagCells:
    """Lags of the gyro's thermometer and of the lines: where each of m cells begins and ends
    (m, 2) [s].
    """

    low_s: NDArray
    high_s: NDArray

    @property
    def lags_s(self) -> NDArray:
        return np.asarray(0.5 * (self.low_s + self.high_s))

    @property
    def width_s(self) -> NDArray:
        return np.asarray(self.high_s - self.low_s)

    def __getitem__(self, rows: NDArray) -> "LagCells":
        return LagCells(self.low_s[rows], self.high_s[rows])

    def __add__(self, other: "LagCells") -> "LagCells":
        return LagCells(
            np.concatenate([self.low_s, other.low_s]), np.concatenate([self.high_s, other.high_s])
        )

    def beside(self, k: int) -> NDArray:
        """Which (m,) touch cell k and are as wide: a maximum in k may lie in them."""
        near = (self.low_s <= self.high_s[k]) & (self.high_s >= self.low_s[k])
        return np.asarray(np.all(near & (self.width_s >= self.width_s[k]), axis=1))

    def split(self) -> "LagCells":
        """In two along each side that has a width."""
        found = self
        for side in np.flatnonzero(self.width_s.any(axis=0)):
            low_s, high_s = found.high_s.copy(), found.low_s.copy()
            low_s[:, side] = high_s[:, side] = found.lags_s[:, side]
            low_s[:, 1 - side], high_s[:, 1 - side] = (
                found.low_s[:, 1 - side],
                found.high_s[:, 1 - side],
            )
            found = LagCells(found.low_s, high_s) + LagCells(low_s, found.high_s)
        return found


def _shares(
    beside: LaggedNormal, at: NDArray, precision: NDArray, taken: Open, lines: bool
) -> tuple[LagCells, NDArray]:
    """Cells of the plane of lags, and each one's share of the evidence (m,)."""
    edges = np.geomspace(USUAL_LAG_s, USUAL_LAG_s + LONGEST_LAG_s, CELLS_A_SIDE + 1) - USUAL_LAG_s
    across = edges if lines else np.zeros(2)
    low_s, high_s = (
        np.stack(np.meshgrid(edges[part], across[part], indexing="ij"), axis=-1).reshape(-1, 2)
        for part in (slice(None, -1), slice(1, None))
    )
    cells = LagCells(low_s, high_s)
    nats = _nats(cells, beside, at, precision, taken)
    for _ in range(MOST_SPLITS):
        large = _share_of(nats) > SPLIT_SHARE
        large |= (cells.width_s.max(axis=1) > BLIND_s) & (nats > nats.max() - BLIND_NATS)
        if not large.any():
            break
        large |= cells.beside(int(np.argmax(nats)))
        parts = cells[large].split()
        cells = cells[~large] + parts
        nats = np.concatenate([nats[~large], _nats(parts, beside, at, precision, taken)])
    share = _share_of(nats)
    return cells[share > 0.0], share[share > 0.0]


def _share_of(nats: NDArray) -> NDArray:
    weight = np.exp(nats - nats.max())
    return np.asarray(weight / weight.sum())


def _nats(
    cells: LagCells, beside: LaggedNormal, at: NDArray, precision: NDArray, taken: Open
) -> NDArray:
    """Log of each cell's share (m,), a constant left out: evidence, prior of the lags, size."""
    A, b = beside.under_each(cells.lags_s, at)
    x, _, log_det = solve_each(A, b, np.diag(taken.scatter * precision))
    left = beside.normal.c - np.sum(b * x, axis=1)
    wide = cells.width_s > 0
    size = np.where(wide, cells.width_s, 1.0)
    prior = _density(cells.lags_s) if wide.all() else _alone(cells.lags_s[:, 0])
    nats = -0.5 * left / taken.scatter - 0.5 * log_det
    return np.asarray(nats + np.log(size).sum(axis=1) + np.log(prior))


def _density(lags_s: NDArray) -> NDArray:
    """Of both lags (m, 2) [1/s^2]: each by itself, or alike, since thermometers of one unit are
    mounted alike.
    """
    gyro_s, lines_s = lags_s.T
    spread = ALIKE_SHARE * gyro_s + ALIKE_s
    off = (lines_s - gyro_s) / spread
    alike = np.exp(-0.5 * off**2) / (spread * np.sqrt(2.0 * np.pi))
    apart = (1.0 - ALIKE_UNITS) * _alone(lines_s)
    return np.asarray(_alone(gyro_s) * (apart + ALIKE_UNITS * alike))


def _alone(lag_s: NDArray) -> NDArray:
    """Of one thermometer's lag [1/s]: within a minute as a rule, else anything."""
    soon = 2.0 / (USUAL_LAG_s * np.sqrt(2.0 * np.pi)) * np.exp(-0.5 * (lag_s / USUAL_LAG_s) ** 2)
    return np.asarray((1.0 - RARELY_LATE) * soon + RARELY_LATE / LONGEST_LAG_s)
