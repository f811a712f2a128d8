"""Temperatures that remember: a first-order lag, and the play operator of hysteresis.

Both are made on a grid of seconds, the temperature straight in between, so that the rows of a log and the seconds of a
diagnosis give the same result; gaps in the instants are bridged by straight lines.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

GRID_S = 1.0


def lagged(time_s: NDArray, degC: NDArray, tau_s: float) -> NDArray:
    """The temperature (n,) behind a first-order lag, at rest at the first reading.

    Exact for a straight line between grid points: the lag's deficit e = T - T_lag follows
    e' = a e + s tau (1 - a) over a step of length h, slope s and a = exp(-h / tau).
    """

    def deficit(values: NDArray, h: float) -> NDArray:
        gain = -tau_s * np.expm1(-h / tau_s) / h
        return lfilter([gain], [1.0, -np.exp(-h / tau_s)], np.diff(values, prepend=values[0]))

    return degC - _on_seconds(time_s, degC, deficit)


def play(time_s: NDArray, degC: NDArray, half_width_degC: float) -> NDArray:
    """The play operator P (n,): follows the temperature half a width behind, at rest in the middle at the start.

    P rises as T - w while heating, falls as T + w while cooling, and stands still for 2 w after a reversal.
    Source: Krasnosel'skii and Pokrovskii (1989), Systems with Hysteresis.
    """

    def stop(values: NDArray, h: float) -> NDArray:
        out, held, w = np.empty(values.size), float(values[0]), half_width_degC
        for k, value in enumerate(values.tolist()):
            held = min(max(held, value - w), value + w)
            out[k] = held
        return values - out

    return degC - _on_seconds(time_s, degC, stop)


def _on_seconds(time_s: NDArray, values: NDArray, operator: Callable[[NDArray, float], NDArray]) -> NDArray:
    """An operator of a series with a uniform step, applied on a grid of about GRID_S and read at the instants."""
    span = float(time_s[-1] - time_s[0]) if time_s.size else 0.0
    if span <= 0.0:
        return np.zeros(values.shape)
    grid, h = np.linspace(time_s[0], time_s[-1], int(np.ceil(span / GRID_S)) + 1, retstep=True)
    return np.interp(time_s, grid, operator(np.interp(grid, time_s, values), float(h)))
