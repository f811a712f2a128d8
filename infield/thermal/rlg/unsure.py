"""The covariance of the terms, with what the data leave open: lags of thermometers, and terms that
go with others and were dropped.

A model with fewer terms and fixed lags is stated, but its sigmas are those of the whole: every term
that may be there has its usual size for a prior, every lag of the thermometers a share,

    P = sum_i w_i [P_i + (m_i - theta) (m_i - theta)']

over the lags i, m_i and P_i being the posterior of all terms under them and w_i their share of the
evidence. A term that the data do not hold apart from a kept one then enters the kept one's sigma by
what it may be, while their sum stays as well known as it is. A lag is nonlinear: with lines that go
with the rate, no lag and no K4 may explain the runs as well as the truth does, so that the shares
are summed over the whole plane of lags, in cells that are split where the evidence is.

Sources: MacKay (1992), Bayesian interpolation, eq. (2.6); mixtures: Bishop (2006), eq. (2.63).
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from infield.thermal.rlg.lag import Beside, Lag, LONGEST_LAG_s, USUAL_LAG_s
from infield.thermal.rlg.terms import TERMS

# what a term may be, 1 sigma in its own unit: K4, K5 and lines as large as the units of
# docs/rlg_gradient.md have them; K1 and K2, which the level and the curve show, ten times that
USUAL_SIZE = {"K1": 1.0, "K2": 0.01, "K3": 4e-5, "K4": 0.05, "K5": 8e-4, "own": 0.04, "other": 0.02}
# of thermometers that are later than a bead in grease (USUAL_LAG_s): three in ten, up to 1800 s
RARELY_LATE = 0.3
# thermometers of one unit are of one kind: four units in five have lags within 20 % and 20 s of
# each other; without it one gyro of 120 was 7 sigma off, whose lines were found late and whose
# thermometer the runs do not tell (docs/rlg_gradient.md)
ALIKE_UNITS, ALIKE_SHARE, ALIKE_s = 0.8, 0.2, 20.0
# a cell of lags with a larger share of the evidence is split; 3 %: the moments then move by less
# than 1 % when it is 1 %
SPLIT_SHARE = 0.03
MOST_SPLITS = 14  # of splitting: from 130 s down to 0.01 s
CELLS_A_SIDE = 8
# the middle of a cell wider than this may lie so much below a maximum within it: lags are known to
# 10 to 80 s where they are late (benchmarks/rlg_confidence.py)
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


def covariance_of(beside: Beside, theta: NDArray, lag: Lag, taken: Open) -> tuple[NDArray, Lag]:
    """Covariance (p, p) of coefficients theta (p,), and the lag with its sigmas."""
    rest = np.full(theta.size - len(TERMS), taken.rest_deg_h > 0)
    at = np.flatnonzero(np.r_[taken.allowed, rest])
    precision = np.array([_usual_size(int(k), taken) for k in at]) ** -2.0
    lines = any(TERMS[k].startswith("K6") for k in at if k < len(TERMS))
    P, moments = np.zeros((theta.size,) * 2), np.zeros((2, 2))
    told = np.array([lag.gyro_s, lag.lines_s])
    for cell, share in _shares(beside, at, precision, taken, lines):
        normal = beside.at(Lag(*cell.lags_s)).of(at)
        found = normal.solve(np.diag(taken.scatter * precision))
        off = -theta
        off[at] += found.x
        P[np.ix_(at, at)] += share * taken.scatter * found.covariance
        P += share * np.outer(off, off)
        moments += share * np.outer(cell.lags_s - told, cell.lags_s - told)
        moments += share * np.diag(np.square(cell.width_s) / 12.0)
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


class Cell(NamedTuple):
    """Lags of the gyro's thermometer and of the lines: where the cell begins and ends [s]."""

    low_s: tuple[float, float]
    high_s: tuple[float, float]

    @property
    def lags_s(self) -> NDArray:
        return 0.5 * (np.array(self.low_s) + self.high_s)

    @property
    def width_s(self) -> NDArray:
        return np.array(self.high_s) - self.low_s

    def touches(self, other: "Cell") -> bool:
        return bool(
            np.all(np.array(self.low_s) <= other.high_s)
            and np.all(np.array(other.low_s) <= self.high_s)
        )

    def split(self) -> list["Cell"]:
        """In two along each side that has a width."""
        sides = []
        for low, high in zip(self.low_s, self.high_s):
            middle = 0.5 * (low + high)
            sides.append([(low, middle), (middle, high)] if high > low else [(low, high)])
        return [Cell((a[0], b[0]), (a[1], b[1])) for a in sides[0] for b in sides[1]]


def _shares(
    beside: Beside, at: NDArray, precision: NDArray, taken: Open, lines: bool
) -> list[tuple[Cell, float]]:
    """Cells of the plane of lags, each with its share of the evidence."""
    edges = np.geomspace(USUAL_LAG_s, USUAL_LAG_s + LONGEST_LAG_s, CELLS_A_SIDE + 1) - USUAL_LAG_s
    sides = list(zip(edges[:-1].tolist(), edges[1:].tolist()))
    across = sides if lines else [(0.0, 0.0)]
    cells = [Cell((a[0], b[0]), (a[1], b[1])) for a in sides for b in across]
    nats = {cell: _nats(cell, beside, at, precision, taken) for cell in cells}
    for _ in range(MOST_SPLITS):
        most = max(nats.values())
        total = sum(np.exp(value - most) for value in nats.values())
        top = max(nats, key=lambda cell: nats[cell])
        large = [cell for cell in nats if np.exp(nats[cell] - most) / total > SPLIT_SHARE]
        large += [
            cell
            for cell in nats
            if cell not in large and max(cell.width_s) > BLIND_s and nats[cell] > most - BLIND_NATS
        ]
        if not large:
            break
        near = [cell for cell in nats if cell not in large and _wide(cell, top)]
        for cell in [*large, *near]:
            del nats[cell]
            nats |= {one: _nats(one, beside, at, precision, taken) for one in cell.split()}
    most = max(nats.values())
    total = sum(np.exp(value - most) for value in nats.values())
    shares = [(cell, float(np.exp(value - most) / total)) for cell, value in nats.items()]
    return [(cell, share) for cell, share in shares if share > 0.0]


def _wide(cell: Cell, top: Cell) -> bool:
    """A neighbour of the likeliest cell that is as wide: the maximum may lie in it."""
    return cell.touches(top) and bool(np.all(cell.width_s >= top.width_s))


def _nats(cell: Cell, beside: Beside, at: NDArray, precision: NDArray, taken: Open) -> float:
    """Log of a cell's share, a constant left out: evidence, prior of the lags, size."""
    normal = beside.at(Lag(*cell.lags_s)).of(at)
    found = normal.solve(np.diag(taken.scatter * precision))
    left = float(normal.c - normal.b @ found.x)
    log_det = float(np.linalg.slogdet(found.covariance)[1])
    size = np.where(cell.width_s > 0, cell.width_s, 1.0)
    prior = _density(cell.lags_s) if cell.width_s.all() else _alone(cell.lags_s[0])
    nats = -0.5 * left / taken.scatter + 0.5 * log_det
    return nats + float(np.log(size).sum() + np.log(prior))


def _density(lags_s: NDArray) -> float:
    """Of both lags [1/s^2]: each by itself, or alike, since thermometers of one unit are mounted
    alike.
    """
    gyro_s, lines_s = float(lags_s[0]), float(lags_s[1])
    spread = ALIKE_SHARE * gyro_s + ALIKE_s
    off = (lines_s - gyro_s) / spread
    alike = float(np.exp(-0.5 * off**2) / (spread * np.sqrt(2.0 * np.pi)))
    apart = (1.0 - ALIKE_UNITS) * _alone(lines_s)
    return float(_alone(gyro_s) * (apart + ALIKE_UNITS * alike))


def _alone(lag_s: float) -> float:
    """Of one thermometer's lag [1/s]: within a minute as a rule, else anything."""
    soon = 2.0 / (USUAL_LAG_s * np.sqrt(2.0 * np.pi)) * np.exp(-0.5 * (lag_s / USUAL_LAG_s) ** 2)
    return float((1.0 - RARELY_LATE) * soon + RARELY_LATE / LONGEST_LAG_s)
