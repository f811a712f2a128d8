"""Where a curve bends: breakpoints of straight, square or cubic pieces found freely, and how well
each place is known.

A place counts as two parameters: it is searched among many, and as one it let a fourth knee in
where there are three (Muggeo (2003) for the search; Kim and Kim (2016), BIC3).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from infield.table.least_squares import LEAST_SQUARE, NormalEquations
from infield.thermal.coefficient_curves import Basis, Reduced
from ins.estimation.choice import Level, Sizes, climb

PLACE_STEP_degC = 0.5
SEARCH_EVERY = 4  # of those places, while they are looked for: every 2 degC
MOVED_BY = (12, 6, 3, 2, 1)  # places that one is moved by as others join: 6 degC and less
MOST_KNEES = 5  # six pieces of 60 degC are 10 degC each, as the nodes of a table
WALK_STEPS, FORGOTTEN = 4000, 500  # of the walk; the first of them are not counted
LEAP_degC = (0.5, 2.0, 8.0)  # of a step: within a knee, along a slow bend, from one to another
SEED = 20261122  # the same data have the same intervals
OF_A_PLACE = 2  # parameters, beside the coefficients that a breakpoint brings
LIFT = 1e-10  # relative, for places whose columns hardly differ
# of what lies between its neighbours, beyond which a place is not told from any other: 1/2
ANYWHERE = 0.5


@dataclass(frozen=True)
class Places:
    """One curve on pieces of a degree: what each set of breakpoints leaves.

    grid_degC (g,): places; A (g d, g d), b (g d,): of their columns, all else taken out; c: what
    pieces without a breakpoint leave (chi2); base: how many coefficients those have; rows.
    """

    low_degC: float
    high_degC: float
    degree: int
    grid_degC: NDArray
    A: NDArray
    b: NDArray
    c: float
    base: int
    rows: int
    nearest_degC: float

    def chi2(self, at: Sequence[int]) -> float:
        """What breakpoints at places of the grid leave."""
        if not at:
            return self.c
        rows = (np.array(at)[:, None] * self.degree + np.arange(self.degree)).ravel()
        A, b = self.A[np.ix_(rows, rows)], self.b[rows]
        return self.c - float(b @ np.linalg.solve(A + LIFT * np.diag(np.diag(A)), b))

    def bic(self, at: Sequence[int]) -> float:
        count = self.base + len(at) * (self.degree + OF_A_PLACE)
        return self.chi2(at) + count * float(np.log(self.rows))

    def apart(self, at: Sequence[int]) -> bool:
        """No two breakpoints closer than the least, nor to an end."""
        least = round(self.nearest_degC / PLACE_STEP_degC)  # the ends are that far off the grid
        places = sorted(at)
        return all(later - one >= least for one, later in pairwise(places))

    def nearest(self, temperature_degC: float) -> int:
        return int(np.argmin(np.abs(self.grid_degC - temperature_degC)))


def places_of(
    reduced: Reduced, other: Basis, which: int, degree: int, nearest_degC: float
) -> Places:
    """The places of one curve (0: K_T, 1: K_delta), the other on its own basis."""
    blocks = reduced.blocks
    T, rate = blocks.temperature_degC, blocks.rate_degC_min[:, None]
    low, high = float(T.min()), float(T.max())
    grid = np.arange(low + nearest_degC, high - nearest_degC, PLACE_STEP_degC)
    half = 0.5 * (high - low)
    u, beyond = (T - low) / half - 1.0, np.maximum(T[:, None] - grid, 0.0) / half
    pieces = np.stack([u**k for k in range(degree + 1)], axis=1)
    bends = np.stack([beyond**k for k in range(1, degree + 1)], axis=2).reshape(T.size, -1)
    own = np.column_stack([pieces, bends])
    X = np.column_stack([other(T) * rate, own] if which == 0 else [other(T), own * rate])
    normal = reduced.normal(X)
    base = X.shape[1] - bends.shape[1]
    A, b, c = _taken_out(normal, base)
    return Places(low, high, degree, grid, A, b, c, base, T.size, nearest_degC)


def _taken_out(normal: NormalEquations, count: int) -> tuple[NDArray, NDArray, float]:
    """Normal equations less their first columns, which are free."""
    first = normal.A[:count, :count]
    first = first + LIFT * np.diag(np.maximum(np.diag(first), LEAST_SQUARE))
    both = np.column_stack([normal.A[:count, count:], normal.b[:count]])
    solved = np.linalg.solve(first, both)
    A = normal.A[count:, count:] - normal.A[count:, :count] @ solved[:, :-1]
    b = normal.b[count:] - normal.A[count:, :count] @ solved[:, -1]
    return 0.5 * (A + A.T), b, float(normal.c - normal.b[:count] @ solved[:, -1])


def find_knees(places: Places) -> tuple[int, ...]:
    """The breakpoints of least BIC, found one after the other."""
    size = places.grid_degC.size
    coarse = range(0, size, SEARCH_EVERY)
    best: tuple[int, ...] = ()
    at: tuple[int, ...] = ()
    for _ in range(MOST_KNEES):
        more = [(*at, k) for k in coarse if places.apart((*at, k))]
        if not more:
            break
        at = _settled(places, min(more, key=places.chi2))
        if places.bic(at) < places.bic(best):
            best = at
    return tuple(sorted(best))


def _settled(places: Places, at: tuple[int, ...]) -> tuple[int, ...]:
    """The breakpoints moved in turn, until none moves any more."""

    def moved(sizes: Sizes, _: tuple[int, ...]) -> tuple[int, ...] | None:
        tried = tuple(int(place) for place in sizes.values())
        return tried if places.apart(tried) else None

    levels = [Level(str(k), range(places.grid_degC.size), place) for k, place in enumerate(at)]
    return climb(
        at,
        levels,
        moved,
        lambda one, other: places.chi2(other) - places.chi2(one),
        strides=MOVED_BY,
    )[0]


def walk(places: Places, at: Sequence[int]) -> NDArray:
    """Breakpoints (n, m) [degC], in order, drawn from their posterior."""
    rng = np.random.default_rng(SEED)
    now = list(at)
    left = places.chi2(now)
    visited = []
    leaps = np.array(LEAP_degC) / PLACE_STEP_degC
    moved = rng.integers(len(now), size=WALK_STEPS)
    by = np.rint(rng.choice(leaps, WALK_STEPS) * rng.standard_normal(WALK_STEPS)).astype(int)
    chance = np.log(rng.uniform(size=WALK_STEPS))
    for k, step, nats in zip(moved.tolist(), by.tolist(), chance.tolist()):
        tried = list(now)
        tried[k] += step
        if step and 0 <= tried[k] < places.grid_degC.size and places.apart(tried):
            after = places.chi2(tried)
            if nats < 0.5 * (left - after):
                now, left = tried, after
        visited.append(sorted(now))
    return np.asarray(places.grid_degC[np.array(visited[FORGOTTEN:])])


@dataclass(frozen=True)
class Known:
    """Where a breakpoint is: the 95 % interval of its posterior, half a step of the grid more on
    either side; called_for: the data tell it from other places.
    """

    low_degC: float
    high_degC: float
    called_for: bool


def intervals(places: Places, at_degC: Sequence[float]) -> tuple[Known, ...]:
    """What is known of breakpoints, in order of temperature."""
    at = sorted(places.nearest(value) for value in at_degC)
    if not at or not places.apart(at):
        return tuple(Known(places.low_degC, places.high_degC, called_for=False) for _ in at)
    drawn = walk(places, at)
    low, high = np.quantile(drawn, [0.025, 0.975], axis=0)
    low, high = low - 0.5 * PLACE_STEP_degC, high + 0.5 * PLACE_STEP_degC
    edges = np.r_[places.low_degC, np.median(drawn, axis=0), places.high_degC]
    room = edges[2:] - edges[:-2]
    return tuple(
        Known(float(a), float(b), bool(b - a < ANYWHERE * r)) for a, b, r in zip(low, high, room)
    )
