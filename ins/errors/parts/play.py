"""The play operator: a quantity that follows another with slack, the elementary form of hysteresis.

Source: Visintin, Differential Models of Hysteresis (1994), ch. III: p_k = min(T_k + r, max(T_k - r,
p_{k-1})).
"""

import numpy as np
from numpy.typing import NDArray


def play(values: NDArray, half_width: float) -> NDArray:
    """What follows `values` (n,) with a slack of +-half_width; starts at the first value, so with
    no past.

    Each step clips to [T_k - r, T_k + r]; clips one after the other are again a clip, whose limits
    are the earlier limits clipped by the later step. So the limits of 1, 2, 4 ... steps up to each
    instant are made in log2(n) passes, exactly.
    """
    low, high = values - half_width, values + half_width
    steps = 1
    while steps < values.size:
        low[steps:], high[steps:] = (
            np.minimum(np.maximum(limit[:-steps], low[steps:]), high[steps:])
            for limit in (low, high)
        )
        steps *= 2
    return np.asarray(np.minimum(np.maximum(values[:1], low), high))


def heating_sense(temperature_degC: NDArray, width_degC: float) -> NDArray:
    """-1 (cooling) to +1 (heating) (n,): (T - play)/r, with r half of the width; 0 at the start,
    whose past is unknown.

    width_degC : the change of temperature that turns the sense from one end to the other. A bias of
    h times the sense reads 2 h apart between the heating and the cooling branch: h is half of the
    split.
    """
    half = 0.5 * width_degC
    return np.asarray((temperature_degC - play(temperature_degC, half)) / half)
