"""How large the gap is, in one measure: the excess of squared whitened rows over their floor.

    score = |z|^2 / m,   E = |z|^2 - m,   excess in sigmas of the null = E / sqrt(2 m)

z: whitened rows, unit noise where the twin is right, so that the floor is 1; m of them. With what
was found E becomes E'; the shrink is 1 - E' / E, with Fieller's interval (`inference.addback`).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from simreal.evidence.whitened import CHANNELS
from simreal.inference.addback import fieller

FLOOR = 1.0  # of the mean square of whitened rows


@dataclass(frozen=True)
class Excess:
    """Squared rows before and after over their number, the distance of both from the floor in
    sigmas of the null, and the shrink with its 95 % interval.

    channel: "" for all rows together.
    """

    channel: str
    rows: int
    score: float
    score_after: float
    excess_sigma: float
    excess_sigma_after: float
    fraction: float
    interval_95: tuple[float, float]


def excesses(before: NDArray, after: NDArray, channel: NDArray, fitted: int) -> tuple[Excess, ...]:
    """Of all rows, then of each channel that has some.

    before, after : whitened rows (m,) under the twin, and with what was found.
    channel : number of each row's channel (m,).
    fitted : coefficients that were fitted to these rows; what they owe to the rows' own noise, a
        square each, is no shrink.
    """
    found = [_excess("", before, after, fitted)]
    for number, name in enumerate(CHANNELS):
        mine = channel == number
        if mine.any():
            share = fitted * float(mine.mean())
            found.append(_excess(name, before[mine], after[mine], share))
    return tuple(found)


def _excess(channel: str, before: NDArray, after: NDArray, fitted: float) -> Excess:
    m = before.size
    squares, left = float(before @ before), float(after @ after)
    gap, gone = squares - m, squares - left - fitted
    explained = max(gone, 0.0)
    shrink = fieller(gone, gap, dd=explained, dz=explained, m=m)
    return Excess(
        channel=channel,
        rows=m,
        score=squares / m,
        score_after=left / m,
        excess_sigma=gap / float(np.sqrt(2.0 * m)),
        excess_sigma_after=(left - m) / float(np.sqrt(2.0 * m)),
        fraction=shrink.fraction,
        interval_95=shrink.interval_95,
    )
