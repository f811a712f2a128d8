"""The noise that a digital twin declares, in SI units, and one set of rules for flicker.

A twin declares white noise, flicker ("bias instability" B), a rate random walk K and a turn-on
spread in the units of data sheets. Here they become SI once. Flicker has the two-sided spectrum
B^2 / (2 pi f). No finite state carries that: a covariance over bins takes it exactly
(`flicker_covariance`), a filter replaces it by a random walk (`flicker_walk`, `walk_with_flicker`).

Decision: docs/decisions/0034-flicker-walk.md.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ins.records import AccelNoise, GyroNoise
from ins.units import (
    DEG_PER_HOUR,
    DEG_PER_HOUR_SQRT_HOUR,
    DEG_PER_SQRT_HOUR,
    HOUR,
    MICRO_G,
    MICRO_G_PER_SQRT_HOUR,
)

# The floor of the Allan deviation of flicker over B: sqrt(2 ln 2 / pi) = 0.6643.
# IEEE Std 952, annex C; judged on simulated flicker in tests/trajectories/test_imperfections.py.
FLICKER_FLOOR = 0.664
# Over a shorter time than this [s] a filter takes flicker for constant. In the aided filter, with
# 60 the squared attitude error of a MEMS unit is 1.5 times its variance, with 20 it is 1.0 times.
SHORTEST_FLICKER_S = 20.0


@dataclass(frozen=True, kw_only=True)
class Densities:
    """Noise of a sensor triad in SI; the unit u is rad/s for gyros and m/s^2 for accelerometers.

    Parameters
    ----------
    white : float
        Density of the white noise [u sqrt(s)]: angle random walk [rad/sqrt(s)], velocity random
        walk [m/s/sqrt(s)].
    instability : float
        Flicker B [u].
    walk : float
        Rate random walk K [u/sqrt(s)].
    turn_on : float
        Spread of the bias from one power-on to the next [u].
    """

    white: float
    instability: float
    walk: float
    turn_on: float


def gyro_densities(gyro: GyroNoise) -> Densities:
    """Noise of a gyro triad in SI.

    Parameters
    ----------
    gyro : GyroNoise
        As the twin declares it: deg/sqrt(h), deg/h, deg/h/sqrt(h).

    Returns
    -------
    densities : Densities
        In rad and s.
    """
    return Densities(
        white=gyro.arw_deg_sqrt_h * DEG_PER_SQRT_HOUR,
        instability=gyro.bias_instability_deg_h * DEG_PER_HOUR,
        walk=gyro.rate_random_walk_deg_h_sqrt_h * DEG_PER_HOUR_SQRT_HOUR,
        turn_on=gyro.turn_on_deg_h * DEG_PER_HOUR,
    )


def accel_densities(accel: AccelNoise) -> Densities:
    """Noise of an accelerometer triad in SI.

    Parameters
    ----------
    accel : AccelNoise
        As the twin declares it: micro-g/sqrt(Hz), micro-g, micro-g/sqrt(h).

    Returns
    -------
    densities : Densities
        In m and s.
    """
    return Densities(
        white=accel.vrw_ug_sqrt_hz * MICRO_G,
        instability=accel.bias_instability_ug * MICRO_G,
        walk=accel.rate_random_walk_ug_sqrt_h * MICRO_G_PER_SQRT_HOUR,
        turn_on=accel.turn_on_ug * MICRO_G,
    )


def walk_with_flicker(walk: float, instability: float) -> float:
    """Random walk that carries a rate random walk and a flicker over about an hour.

    Parameters
    ----------
    walk : float
        Rate random walk K [unit/sqrt(h)].
    instability : float
        Flicker B [unit].

    Returns
    -------
    walk : float
        sqrt(K^2 + B^2) [unit/sqrt(h)]: the flicker's share reaches B after an hour.

    Notes
    -----
    Within minutes it says less than the flicker does (Allan deviation at 5 min 0.17 B against
    0.66 B), beyond four thirds of an hour more. It is for filters whose measurements average over
    long times; `flicker_walk` is for the others.
    """
    return float(np.hypot(walk, instability))


def flicker_walk(instability: float, white: float) -> float:
    """Random walk whose Allan variance meets that of a flicker where it rises from white noise.

    Parameters
    ----------
    instability : float
        Flicker B [unit].
    white : float
        White noise N [unit sqrt(s)].

    Returns
    -------
    walk : float
        K [unit/sqrt(h)] with K^2 t/3 = (0.664 B)^2 where N^2/t = (0.664 B)^2, but t not below
        SHORTEST_FLICKER_S and not above an hour.

    Notes
    -----
    Beyond that time the walk says more than the flicker does, which is safe.

    Source: IEEE Std 952, annex C. Pinned by: tests/infield/test_aided.py
    """
    floor = FLICKER_FLOOR * instability
    if floor <= 0:
        return 0.0
    meets_s = float(np.clip((white / floor) ** 2, SHORTEST_FLICKER_S, HOUR))
    return float(np.sqrt(3.0 * HOUR / meets_s) * floor)


def random_walk_covariance(start_s: NDArray, end_s: NDArray) -> NDArray:
    """Covariance of bin means of a unit random walk that starts at 0 with zero.

    Parameters
    ----------
    start_s, end_s : ndarray, shape (m,)
        Bins [s], start before end; what lies before 0 counts as 0.

    Returns
    -------
    covariance : ndarray, shape (m, m)
        Of the means, for a walk of 1 unit/sqrt(s): the mean of min(u, v) over each pair of bins.
    """

    def integral(x: NDArray, y: NDArray) -> NDArray:  # of min(u, v) over [0, x] x [0, y]
        low, high = np.minimum(x, y), np.maximum(x, y)
        return 0.5 * low**2 * high - low**3 / 6.0

    return _bin_mean(integral, np.maximum(start_s, 0.0), end_s)


def flicker_covariance(start_s: NDArray, end_s: NDArray, *, lowest_hz: float) -> NDArray:
    """Covariance of bin means of flicker with two-sided PSD 1 / (2 pi f), above lowest_hz.

    Parameters
    ----------
    start_s, end_s : ndarray, shape (m,)
        Bins [s], start before end.
    lowest_hz : float
        Lowest frequency [Hz]; slower flicker looks like turn-on.

    Returns
    -------
    covariance : ndarray, shape (m, m)
        For B = 1 unit.

    Notes
    -----
    The autocorrelation and its integral over u and v, finite at x = 0, are::

        R(tau) = -Ci(x) / pi,   x = w |u - v|,   w = 2 pi lowest_hz
        (x^2 Ci(x) - x sin x + cos x) / (2 pi w^2)
    """
    from scipy.special import sici

    w = 2.0 * np.pi * lowest_hz

    def integral(u: NDArray, v: NDArray) -> NDArray:
        x = w * np.abs(u - v)
        x2_ci = np.where(x > 0.0, x**2 * sici(np.where(x > 0.0, x, 1.0))[1], 0.0)
        return (x2_ci - x * np.sin(x) + np.cos(x)) / (2.0 * np.pi * w**2)

    return _bin_mean(integral, start_s, end_s)


def markov_covariance(start_s: NDArray, end_s: NDArray, *, tau_s: float) -> NDArray:
    """Covariance of bin means of a first-order Gauss-Markov process.

    Parameters
    ----------
    start_s, end_s : ndarray, shape (m,)
        Bins [s], start before end.
    tau_s : float
        Correlation time [s].

    Returns
    -------
    covariance : ndarray, shape (m, m)
        For a variance of 1 unit^2.

    Notes
    -----
    The autocorrelation and its integral over u and v are::

        R(tau) = exp(-|tau| / tau_s),   x = |u - v| / tau_s
        -(tau_s^2 exp(-x) + tau_s^2 x)
    """

    def integral(u: NDArray, v: NDArray) -> NDArray:
        x = np.abs(u - v) / tau_s
        return np.asarray(-(tau_s**2) * (np.exp(-x) + x))

    return _bin_mean(integral, start_s, end_s)


def _bin_mean(
    integral: Callable[[NDArray, NDArray], NDArray], start_s: NDArray, end_s: NDArray
) -> NDArray:
    """Mean of a kernel over each pair of bins, from its double integral I with d2I/(du dv) =
    kernel.
    """
    a, b = start_s[:, None], end_s[:, None]
    c, d = start_s[None, :], end_s[None, :]
    total = integral(b, d) - integral(a, d) - integral(b, c) + integral(a, c)
    mean = total / ((b - a) * (d - c))
    return 0.5 * (mean + mean.T)
