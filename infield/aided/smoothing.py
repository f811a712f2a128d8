"""The aided solution given the whole log (`ins.filters.aided_smoother`): the first minutes as good
as the last, stretches without fixes held from both ends.

The flight is that of the filter's solution, with the same start, noise and antenna. Where the start
was so far off that its linearisation shows (the square of its attitude error over two beyond
NONLINEAR of the smoothed sigma), the log is flown again from the smoothed attitude; its prior
stays as wide. An antenna that was taken from the fixes is estimated once more, as smoothing asks
for gains that are best, and its sigma is added in full: what a receiver's slow errors make of it
does not become less by asking the same fixes twice.
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
from ins.filters.aided_smoother import smoothed, started_again
from ins.filters.states import AIDED_POS, AIDED_THETA

NONLINEAR = 0.2  # of the smoothed sigma: adds 2 % to it (sqrt(1 + 0.2^2))
MOST_PASSES = 4  # each pass leaves the square of the last one's error: 25 deg, 5, 0.2, 0.001
# of the information of all fixes that the last pass begins with: in the first seconds a filter that
# knows nothing turns by more than its linearisation holds, which left tilts of 130 microradians
# beside sigmas of 19; its sigmas become 0.5 % too small
HELD_SHARE = 0.01
LEAST_WEIGHT = 1e-4  # of a heading that is smoothed; all that are left out weigh 0.0024 at most


def smooth_flight(flights: Flights, found: FoundStart, model: Model) -> AidedHistory:
    """A flight from one start, smoothed."""
    for _ in range(MOST_PASSES):
        history, tape = flights.taped(found, model)
        best, errors = smoothed(history, tape)
        off = float(np.linalg.norm(errors[AIDED_THETA]))
        sigma = np.sqrt(best.variance[0, AIDED_THETA].sum())
        if 0.5 * off**2 <= NONLINEAR * sigma:
            break
        state = started_again(found.start.state, errors)
        found = replace(found, start=replace(found.start, state=state))
    state = started_again(found.start.state, errors)
    held = replace(
        found.start, state=state, covariance=held_prior(found.start.covariance, best.covariance[0])
    )
    history, tape = flights.taped(replace(found, start=held), model)
    best, _ = smoothed(history, tape)
    return _with_antenna(flights.as_timed(best, model), model.antenna)


def smooth_all_headings(flights: Flights, heading: HeadingOpen, model: Model) -> AidedHistory:
    """The flights from all headings, each smoothed, by the weights that all fixes give them."""
    late = flights.fixes.earlier(model.antenna.velocity_delay_s)
    starts = heading.starts(flights.begin.sky.with_antenna(late, model.antenna.lever_arm_m))
    flown = [flights.from_start(found, model, whole=True) for found in starts]
    weights = causal_weights(flown)[-1]
    likely = np.flatnonzero(weights > LEAST_WEIGHT)
    best = [smooth_flight(flights, starts[k], model) for k in likely]
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


def held_prior(P: NDArray, P_smoothed: NDArray) -> NDArray:
    """A start's prior (15, 15) with HELD_SHARE of what all fixes say of it."""
    scale = np.sqrt(np.diag(P))
    between = np.outer(scale, scale)
    wide = P_smoothed / HELD_SHARE
    both = np.linalg.solve((P + wide) / between, P / between)
    held = between * ((wide / between) @ both)
    return np.asarray(0.5 * (held + held.T))


def _squares(rows: NDArray) -> NDArray:
    """Outer product (k, 3, 3) of each row with itself."""
    return np.asarray(rows[:, :, None] * rows[:, None, :])
