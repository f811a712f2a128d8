"""The aided solution given the whole log: the first minutes as good as the last, stretches without
fixes held from both ends.

The flight is that of the filter's solution, with the same start, noise and antenna. An antenna that
was taken from the fixes is estimated once more, as smoothing asks for gains that are best, and its
sigma is added in full: what a receiver's slow errors make of it does not become less by asking the
same fixes twice.

Decision: docs/decisions/0061-adjoint-smoother.md.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from infield.aided.flights import Flights
from infield.aided.headings import HeadingOpen
from infield.aided.noise import Model
from infield.aided.open_heading import causal_weights, mixed
from infield.aided.start import FoundStart
from ins.filters.aided_records import AidedHistory, Antenna
from ins.filters.states import AIDED_POS

LEAST_WEIGHT = 1e-4  # of a heading that is smoothed; all that are left out weigh 0.0024 at most


def smooth_flight(flights: Flights, found: FoundStart, model: Model) -> AidedHistory:
    """A flight from one start, smoothed."""
    best = flights.from_start(found, model, whole=True, smooth=True)
    return _with_antenna(best, model.antenna)


def smooth_all_headings(flights: Flights, heading: HeadingOpen, model: Model) -> AidedHistory:
    """The flights from all headings, each smoothed, by the weights that all fixes give them."""
    late = flights.fixes.earlier(model.antenna.velocity_delay_s)
    starts = heading.starts(flights.begin.sky.with_antenna(late, model.antenna.lever_arm_m))
    weights = causal_weights(flights.from_headings(starts, model))[-1]
    likely = np.flatnonzero(weights > LEAST_WEIGHT)
    smoothed = flights.from_headings([starts[k] for k in likely], model, smooth=True)
    best = [_with_antenna(history, model.antenna) for history in smoothed]
    share = weights[likely] / weights[likely].sum()
    return mixed(best, np.tile(share, (best[0].time_s.size, 1)))


def _with_antenna(history: AidedHistory, antenna: Antenna) -> AidedHistory:
    """The position's covariance with what the antenna's own adds: its arm, and its delay's way."""
    arm = history.C_nb @ antenna.covariance[:3, :3] @ np.swapaxes(history.C_nb, 1, 2)
    way = antenna.covariance[3, 3] * _squares(history.v_n_m_s)
    P = np.array(history.covariance)
    P[:, AIDED_POS, AIDED_POS] += arm + way
    variance = np.diagonal(P, axis1=1, axis2=2).copy()
    return replace(history, covariance=P, variance=variance)


def _squares(rows: NDArray) -> NDArray:
    """Outer product (k, 3, 3) of each row with itself."""
    return np.asarray(rows[:, :, None] * rows[:, None, :])
