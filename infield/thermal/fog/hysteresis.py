"""Hysteresis of a fibre-optic gyro: the bias warming is not the bias cooling, whatever the rate::

    b = K_T(T) + K_delta(T) dT/dt + h s_0 + sum_j d_j (s_j - s_0),   s from -1 (cooling) to 1

Each s_j is the play of a pointer that is dragged along the temperature over 2 w_j (Prandtl and
Ishlinskii; Visintin (1994), section III.2): it turns over as the temperature comes back by that,
and a ripple that is smaller leaves it alone. Several widths together turn over in any way. At two
rates h and K_delta are apart, and h is always a term: left out where it does not show, a hysteresis
of two sigmas put K_delta 1.6 times its variance off. At one rate they are one number, K_delta + h /
rate, and the sigma of K_delta has to hold what h may be.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from infield.thermal.blocks import AxisBlocks
from infield.thermal.coefficient_curves import CurveFit
from infield.thermal.ramp_runs import RampRun
from ins.documents import UNWRITTEN

H = 2  # the third curve of a fit with hysteresis
# of the pointers; the first is the usual one, the others turn over sooner or later; up to a
# tenth of a chamber's 60 degC
HALF_WIDTHS_degC = (1.5, 0.5, 3.0, 6.0)
# h itself is free, the differences of its widths are as large as the data say
FREE_SIZE = np.diag([0.0, 1.0, 1.0, 1.0])
# sigmas of h from which on a note says so: 0.1 % of gyros without it (3.3)
SHOWN_SIGMAS = 3.3


@dataclass(frozen=True, kw_only=True)
class Hysteresis:
    """h, half of the difference between warming and cooling at any rate, with its sigma, and the
    coefficients (4,) of all senses; held_apart: the runs tell it from K_delta (two rates, up and
    down), and it is a term of the fit; shown: it is there beyond chance.
    """

    value_deg_h: float
    sigma_deg_h: float
    parts_deg_h: NDArray = field(metadata=UNWRITTEN)
    held_apart: bool
    shown: bool


def no_more_than(sigma_deg_h: float) -> Hysteresis:
    """What runs at one rate leave open."""
    none = np.zeros(len(HALF_WIDTHS_degC))
    return Hysteresis(
        value_deg_h=0.0, sigma_deg_h=sigma_deg_h, parts_deg_h=none, held_apart=False, shown=False
    )


def play(T: NDArray, half_width_degC: float) -> NDArray:
    """s (n,) along temperatures (n,); 0 as they begin."""
    pointer, out = float(T[0]), np.empty(T.size)
    for i, value in enumerate(T.tolist()):
        pointer = min(max(pointer, value - half_width_degC), value + half_width_degC)
        out[i] = (value - pointer) / half_width_degC
    return out


def with_sense(blocks: AxisBlocks, runs: Sequence[RampRun], k: int) -> AxisBlocks:
    """The steady blocks of some runs with the senses of their temperatures, all but the first less
    it.
    """
    senses = [
        np.stack([play(run.temperature_degC[:, k], w) for w in HALF_WIDTHS_degC], axis=1)
        for run in runs
    ]
    for sense in senses:
        sense[:, 1:] -= sense[:, :1]
    steady = [sense[run.steady] for sense, run in zip(senses, runs)]
    return replace(blocks, sense=np.concatenate(steady))


def without(blocks: AxisBlocks, found: Hysteresis) -> AxisBlocks:
    """The blocks less the hysteresis, which is no part of either curve."""
    assert blocks.sense is not None
    return replace(blocks, bias_deg_h=blocks.bias_deg_h - blocks.sense @ found.parts_deg_h)


def each_width(temperature_degC: NDArray) -> NDArray:
    """The basis of the third curve: one coefficient a width, whatever the temperature."""
    return np.ones((np.size(temperature_degC), len(HALF_WIDTHS_degC)))


def hysteresis_of(fit: CurveFit) -> Hysteresis:
    """What a fit with hysteresis says of it."""
    parts, P = fit.linear(H, np.eye(len(HALF_WIDTHS_degC)))
    value, sigma = float(parts[0]), float(np.sqrt(P[0, 0]))
    return Hysteresis(
        value_deg_h=value,
        sigma_deg_h=sigma,
        parts_deg_h=parts,
        held_apart=True,
        shown=abs(value) > SHOWN_SIGMAS * sigma,
    )
