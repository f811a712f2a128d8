"""A quantity of the update, as measured less as predicted over held-out runs: how large the gap is
beyond noise, and how much of it goes with the effects.

Gap: G^2 = E|e|^2 - tr C. With e ~ N(b, C) and b unknown, |e|^2 / g is near a noncentral chi-square
with n degrees of freedom, g = tr C^2 / tr C and n = (tr C)^2 / tr C^2 (Satterthwaite; exact where
all variances are equal); its noncentrality |b|^2 / g is bounded by inverting the distribution.

The share that is gone is the shrink of held-out rows (`simreal.inference.addback.fieller`), of e
whitened with what the twin as it was expects of it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular
from scipy.special import chndtr

from ins.documents import UNWRITTEN
from simreal.inference.addback import Gone, fieller

LOW, HIGH = 0.025, 0.975  # of a 95 % interval


@dataclass(frozen=True)
class Deviation:
    """Of one run: measured less predicted (k,), and the covariance (k, k) that noise gives it."""

    value: NDArray
    covariance: NDArray


@dataclass(frozen=True)
class Gap:
    """RMS per run of a quantity beyond noise with its 95 % interval, and as measured, noise
    included; of the NIS the mean square per degree of freedom, 1 where there is no gap.

    noise : what it would be by noise alone.
    """

    value: float
    interval_95: tuple[float, float]
    measured: float
    noise: float = field(default=float("nan"), metadata=UNWRITTEN)


def gap_of(deviations: Sequence[Deviation]) -> Gap:
    """The gap of a quantity over runs (one or more)."""
    runs = len(deviations)
    square = float(sum(d.value @ d.value for d in deviations))
    trace = float(sum(np.trace(d.covariance) for d in deviations))
    squared = float(sum(np.sum(d.covariance**2) for d in deviations))
    unit, dof = squared / trace, trace**2 / squared
    low, high = noncentrality(square / unit, dof)
    return Gap(
        value=float(np.sqrt(max(square - trace, 0.0) / runs)),
        interval_95=(float(np.sqrt(unit * low / runs)), float(np.sqrt(unit * high / runs))),
        measured=float(np.sqrt(square / runs)),
        noise=float(np.sqrt(trace / runs)),
    )


def nis_of(deviations: Sequence[Deviation]) -> Gap:
    """The squared deviations over their covariance, per degree of freedom: what they are expected
    to be with the gap in (1 without one), its interval, and the mean as measured; noise is 1.
    """
    square = float(sum(float(np.sum(_whitened(d, d.value) ** 2)) for d in deviations))
    dof = float(sum(d.value.size for d in deviations))
    low, high = noncentrality(square, dof)
    return Gap(
        value=1.0 + max(square - dof, 0.0) / dof,
        interval_95=(1.0 + low / dof, 1.0 + high / dof),
        measured=square / dof,
        noise=1.0,
    )


def noncentrality(square: float, dof: float) -> tuple[float, float]:
    """The 95 % interval of a noncentral chi-square's noncentrality, by one draw of it."""

    from scipy.optimize import brentq  # 0.2 s of CPU, which most diagnoses never need

    def at_level(level: float) -> float:
        def beyond(centre: float) -> float:
            return float(chndtr(square, dof, centre)) - level

        if beyond(0.0) <= 0.0:
            return 0.0
        top = square + dof
        while beyond(top) > 0.0:
            top *= 2.0
        return float(brentq(beyond, 0.0, top))

    return at_level(HIGH), at_level(LOW)


def gone_of(before: Sequence[Deviation], after: Sequence[Deviation]) -> Gone:
    """How much of the gap before is gone after; of the same runs."""
    pairs = list(zip(before, after, strict=True))
    seen = np.concatenate([_whitened(one, one.value) for one, _ in pairs])
    said = np.concatenate([_whitened(one, one.value - other.value) for one, other in pairs])
    dd, dz = float(said @ said), float(said @ seen)
    excess = float(seen @ seen) - seen.size
    shrink = fieller(2.0 * dz - dd, excess, dd=dd, dz=dz, m=float(seen.size))
    return Gone(shrink.fraction, shrink.interval_95)


def nis_gone_of(before: Sequence[Deviation], after: Sequence[Deviation]) -> Gone:
    """How much of the NIS beyond 1 is gone, each against what its own twin expects; the interval
    holds both ends of both intervals.
    """
    one, other = nis_of(before), nis_of(after)
    if one.interval_95[0] <= 1.0:
        return Gone(0.0, (-1.0, 1.0))
    low = 1.0 - (other.interval_95[1] - 1.0) / (one.interval_95[0] - 1.0)
    high = 1.0 - (other.interval_95[0] - 1.0) / (one.interval_95[1] - 1.0)
    share = 1.0 - (other.value - 1.0) / (one.value - 1.0)
    return Gone(max(share, -1.0), (max(low, -1.0), max(high, -1.0)))


def _whitened(deviation: Deviation, values: NDArray) -> NDArray:
    factor = np.linalg.cholesky(deviation.covariance)
    return np.asarray(solve_triangular(factor, values, lower=True))
