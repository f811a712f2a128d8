"""Turn rate at an instant, from the turns over steps of time: the antenna on its arm moves with it.

A mean over a second is not the rate at its end: entering a turn within 2 s the rate changes by half
of its size in a second, and an arm of 6 m in a turn of 10 deg/s is then off by 0.5 m/s.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

# of a not-a-knot cubic spline: 4 knots (scipy CubicSpline)
FEWEST_SPLINE_STEPS = 3


def rate_at(
    start_s: NDArray, end_s: NDArray, turned_rad: NDArray, time_s: NDArray
) -> tuple[NDArray, NDArray]:
    """Angular rate (m, 3) [rad/s] at some times (m,), and how far off it may be (m, 3), one sigma.

    start_s, end_s (K,): steps in order without holes between them; turned_rad (K, 3): the turn
    within each. The rate is the slope of a cubic spline through the angles at the steps' ends; its
    sigma is the distance to the slope of a parabola through the two steps that meet there (two
    orders of one interpolation, as the embedded pairs of Fehlberg 1969): none in a steady turn.
    """
    if end_s.size < FEWEST_SPLINE_STEPS:
        step = np.clip(np.searchsorted(end_s, time_s), 0, end_s.size - 1)
        rate = (turned_rad / (end_s - start_s)[:, None])[step]
        return rate, np.abs(rate)
    knots = np.concatenate([start_s[:1], end_s])
    angle = np.concatenate([np.zeros((1, 3)), np.cumsum(turned_rad, axis=0)])
    rate = CubicSpline(knots, angle)(time_s, 1)
    return rate, np.abs(rate - _of_parabola(knots, angle, time_s))


def _of_parabola(knots: NDArray, angle: NDArray, time_s: NDArray) -> NDArray:
    """Slope (m, 3) of the parabola through the knot nearest to each time and its neighbours."""
    nearest = np.clip(np.searchsorted(knots, time_s), 1, knots.size - 1)
    nearest -= time_s - knots[nearest - 1] < knots[nearest] - time_s
    k = np.clip(nearest, 1, knots.size - 2)
    before, after = knots[k] - knots[k - 1], knots[k + 1] - knots[k]
    slope = np.diff(angle, axis=0) / np.diff(knots)[:, None]
    bend = (slope[k] - slope[k - 1]) / (0.5 * (before + after))[:, None]
    middle = knots[k] - 0.5 * before
    return slope[k - 1] + bend * (time_s - middle)[:, None]
