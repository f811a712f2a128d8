"""A temperature that lags behind another.

Made on a grid of seconds, straight in between, so that the rows of a log and the seconds of a
diagnosis give the same result; gaps in the instants are bridged by straight lines.
"""

import numpy as np
from numpy.typing import NDArray

MEMORY_STEP_S = 1.0


def lagged(time_s: NDArray, degC: NDArray, tau_s: float) -> NDArray:
    """The temperature (n,) behind a first-order lag, at rest at the first reading.

    Exact for a straight line between grid points: the deficit e = T - T_lag becomes a e + s tau (1
    - a) after a step of length h, with the slope s and a = exp(-h / tau).
    """
    from scipy.linalg import solve_banded

    span = float(time_s[-1] - time_s[0]) if time_s.size else 0.0
    if span <= 0.0:
        return degC.copy()
    grid, h = np.linspace(
        time_s[0], time_s[-1], int(np.ceil(span / MEMORY_STEP_S)) + 1, retstep=True
    )
    values = np.interp(grid, time_s, degC)
    gain = -tau_s * np.expm1(-h / tau_s) / h
    # e_k - a e_(k-1) = gain (T_k - T_(k-1)), all at once: two diagonals
    diagonals = np.ones((2, grid.size))
    diagonals[1] = -np.exp(-h / tau_s)
    deficit = solve_banded((1, 0), diagonals, gain * np.diff(values, prepend=values[0]))
    return degC - np.interp(time_s, grid, deficit)
