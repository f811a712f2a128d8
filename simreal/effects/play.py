"""The play operator: a quantity that follows another with slack, the elementary form of hysteresis.

Source: Visintin, Differential Models of Hysteresis (1994), ch. III: p_k = min(T_k + r, max(T_k - r, p_{k-1})).
"""

import numpy as np
from numpy.typing import NDArray

MOST_STEPS = 20_000  # a longer series is followed at every m-th value: temperatures are slow


def play(values: NDArray, half_width: float) -> NDArray:
    """What follows `values` (n,) with a slack of +-half_width; starts at the first value, so with no past."""
    stride = max(1, values.size // MOST_STEPS)
    rows = np.arange(0, values.size, stride)
    out, held = np.empty(rows.size), float(values[0])
    for k, value in enumerate(values[rows].tolist()):
        held = min(max(held, value - half_width), value + half_width)
        out[k] = held
    return out if stride == 1 else np.interp(np.arange(values.size), rows, out)


def heating_sense(temperature_degC: NDArray, width_degC: float) -> NDArray:
    """-1 (cooling) to +1 (heating) (n,): (T - play)/r, with r half of the width; 0 at the start, whose past is unknown.

    width_degC : the change of temperature that turns the sense from one end to the other. A bias of h times the sense
    reads 2 h apart between the heating and the cooling branch: h is half of the split.
    """
    half = 0.5 * width_degC
    return np.asarray((temperature_degC - play(temperature_degC, half)) / half)
