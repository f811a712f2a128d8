"""Which of several models the data want.

The size of a level (a noise, the RMS of what wanders, the weight of a penalty) is found by `climb`:
up the likelihood by one level after another, over grids that are fixed beforehand. Which constants
there are is known from one sweep in which all of them are free (`FreeConstants`): the evidence of
the model without some of them, c, over that with all is their posterior density at zero over the
prior one (Savage-Dickey; Dickey 1971, Ann. Math. Stat. 42)::

    ln p(z | without c) / p(z | all) = ln N(0; x_c, P_cc) - ln N(0; 0, S_cc)

`choose` takes the joint subset of the best evidence, each member at a cost. Under the model without
it a gain of g nats has a probability below exp(-g) (Markov's inequality on the likelihood ratio).

Decision: docs/decisions/0093-one-choice.md.
"""

from bisect import bisect_left, bisect_right
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain, combinations
from typing import Any, Generic, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

SURE_NATS = 3.0  # odds of 20 to 1; under the model without it below 1 in 20
Fitted = TypeVar("Fitted")  # a model with what came of it
Name = TypeVar("Name")
Sizes = Mapping[str, float]  # of levels by name


@dataclass(frozen=True)
class Level:
    """A number of a model whose size the data are to find.

    Parameters
    ----------
    name : str
    grid : sequence of float
        Rising sizes that are tried. A size that is not among them lies between two steps.
    start : float
        Where the climb begins.
    along : tuple of Level
        Levels that move with it, by as many steps each.
    """

    name: str
    grid: Sequence[float]
    start: float
    along: tuple["Level", ...] = ()


def with_sizes(record: Fitted, sizes: Sizes) -> Fitted:
    """A record with sizes of levels that are fields of it.

    Parameters
    ----------
    record : dataclass
    sizes : mapping of float

    Returns
    -------
    record : dataclass
    """
    fields: Any = sizes
    return replace(cast(Any, record), **fields)


def powers_of_two(least: float, largest: float, *, fineness: int = 1) -> tuple[float, ...]:
    """Sizes in equal ratios.

    Parameters
    ----------
    least, largest : float
        The first size, and what none is beyond.
    fineness : int
        Steps for each doubling.

    Returns
    -------
    grid : tuple of float
        Rising.
    """
    count = int(fineness * np.log2(largest / least) + 1e-9)
    return tuple(least * 2.0 ** (k / fineness) for k in range(count + 1))


def climb(
    start: Fitted,
    levels: Sequence[Level],
    fit: Callable[[Sizes, Fitted], Fitted | None],
    gain: Callable[[Fitted, Fitted], float],
    *,
    least_nats: float = 0.0,
    strides: Sequence[int] = (1,),
) -> tuple[Fitted, Sizes]:
    """Up the likelihood by one level after another, until no move gains.

    Parameters
    ----------
    start : Fitted
        The model under the levels as they begin.
    levels : sequence of Level
    fit : callable
        The model under other sizes, by name, from the present model; None where there is none.
    gain : callable
        Log likelihood of one model over another [nats].
    least_nats : float
        What a move has to gain more than.
    strides : sequence of int
        Steps of the grids that a move takes, one stride after the other.

    Returns
    -------
    best, sizes : Fitted, mapping of float
        The model that no move betters, and the sizes by name.
    """
    best = start
    sizes: Sizes = {x.name: x.start for level in levels for x in (level, *level.along)}
    for stride in strides:
        moves = [(level, steps) for level in levels for steps in (stride, -stride)]
        vain: set[int] = set()  # moves that gain nothing from here
        turn = 0
        while len(vain) < len(moves):
            tried = None if turn in vain else _moved(sizes, *moves[turn])
            other = None if tried is None else fit(tried, best)
            if tried is None or other is None or gain(other, best) <= least_nats:
                vain.add(turn)
                turn = (turn + 1) % len(moves)
            else:
                best, sizes = other, tried
                vain = set()  # with what was refitted, the way back is a new one
    return best, sizes


def _moved(sizes: Sizes, level: Level, steps: int) -> Sizes | None:
    """Sizes after a move; None where one that moves is at the end of its grid."""
    moved = {x.name: _size(x.grid, sizes[x.name], steps) for x in (level, *level.along)}
    stays = any(moved[name] == sizes[name] for name in moved)
    return None if stays else {**sizes, **moved}


def _size(grid: Sequence[float], size: float, steps: int) -> float:
    """The size so many steps up or down, to the end of the grid at most."""
    if steps > 0:
        return max(grid[min(bisect_right(grid, size) - 1 + steps, len(grid) - 1)], size)
    return min(grid[max(bisect_left(grid, size) + steps, 0)], size)


@dataclass(frozen=True)
class FreeConstants(Generic[Name]):
    """Constants that one sweep left free, each with a normal prior about zero.

    Parameters
    ----------
    x : ndarray, shape (n,)
        State of the sweep at its end.
    P : ndarray, shape (n, n)
        Its covariance.
    at : mapping of (ndarray, ndarray)
        Where each constant stands in the state (m,), and prior sigmas (m,).
    """

    x: NDArray
    P: NDArray
    at: Mapping[Name, tuple[NDArray, NDArray]]

    def gain(self, free: Collection[Name]) -> float:
        """Log evidence of a model with some of them over that with none.

        Parameters
        ----------
        free : collection of Name

        Returns
        -------
        gain : float
            In nats.
        """
        held = [name for name in self.at if name not in free]
        return self._log_density_ratio(held) - self._log_density_ratio(self.at)

    def _log_density_ratio(self, names: Collection[Name]) -> float:
        """Log of the posterior over the prior density of constants at zero."""
        if not names:
            return 0.0
        index = np.concatenate([self.at[name][0] for name in names])
        prior = np.concatenate([self.at[name][1] for name in names])
        x, P = self.x[index] / prior, self.P[np.ix_(index, index)] / np.outer(prior, prior)
        return float(-0.5 * (x @ np.linalg.solve(P, x) + np.linalg.slogdet(P)[1]))


def choose(
    candidates: Sequence[Name],
    gain: Callable[[tuple[Name, ...]], float],
    *,
    cost_nats: float = SURE_NATS,
) -> tuple[Name, ...]:
    """Those of a few candidates that the data want together, of all subsets.

    Parameters
    ----------
    candidates : sequence of Name
    gain : callable
        Log evidence of the model with some of them, up to a constant [nats].
    cost_nats : float
        What each that is taken has to gain.

    Returns
    -------
    taken : tuple of Name
        In the order of the candidates.
    """
    subsets = chain.from_iterable(combinations(candidates, n) for n in range(len(candidates) + 1))
    return max(subsets, key=lambda taken: gain(taken) - cost_nats * len(taken))
