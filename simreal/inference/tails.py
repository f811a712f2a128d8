"""How rare a value is among replicates of the noise, beyond what they resolve.

The upper TAIL of the n replicates, k of them, is taken for exponential. A new value passes the
replicate below them with probability (k + 1) / (n + 1), and beyond it, as the mean b of the tail is
known from k values only, not exponentially but with::

    P(start + t) = (k + 1) / (n + 1) (1 + t / (k b))^-k,

the predictive distribution (Lomax), in the mean right for an exponential tail whatever k and n. The
plain exponential raises false alarms (docs/gap.md).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

TAIL = 0.15  # share of the replicates through which the tail is drawn: 45 of 300


@dataclass(frozen=True)
class _Upper:
    """The tail: where it begins, with what probability a new value is in it, and of how many
    replicates it is, with their mean beyond its beginning.
    """

    start: float
    share: float
    count: int
    mean: float


def tail_quantile(values: NDArray, level: float) -> float:
    """The value that a new replicate exceeds with probability `level`."""
    tail = _upper(values)
    if level >= tail.share or not tail.mean > 0:
        return float(np.quantile(values, 1.0 - level))
    k = tail.count
    return tail.start + k * tail.mean * float((tail.share / level) ** (1.0 / k) - 1.0)


def tail_probability(values: NDArray, seen: float) -> float:
    """Probability that a new replicate reaches what was seen."""
    tail = _upper(values)
    if seen <= tail.start or not tail.mean > 0:
        return float((1 + np.sum(values >= seen)) / (1 + values.size))
    far = (seen - tail.start) / (tail.count * tail.mean)
    return tail.share * float(np.exp(-tail.count * np.log1p(far)))


def _upper(values: NDArray) -> _Upper:
    count = max(round(TAIL * values.size), 1)
    ordered = np.partition(values, values.size - count - 1) if values.size > count else values
    start = float(ordered[-count - 1]) if values.size > count else float(values.min())
    beyond = ordered[-count:] - start
    return _Upper(start, (count + 1) / (values.size + 1), count, float(beyond.mean()))
