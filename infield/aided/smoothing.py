"""The aided solution given the whole log (`ins.filters.aided_smoother`): the first minutes as good
as the last, stretches without fixes held from both ends.

The flight is that of the filter's solution, with the same start, noise and antenna. Where the start
was so far off that its linearisation shows (the square of its attitude error over two beyond
NONLINEAR of the smoothed sigma), the log is flown again from the smoothed attitude; its prior
stays as wide. A flight under which the fixes are less likely is not taken: there the linearisation
led away from what they say, and from there it leads on (a copter's heading by 15, 18, 24, 30 and 60
deg, each less likely than the last, to 2.2 sigmas in an outage; now 0.2). An antenna that was taken
from the fixes is estimated once more, as smoothing asks for gains that are best, and its sigma is
added in full: what a receiver's slow errors make of it does not become less by asking the same
fixes twice.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from infield.aided.flights import Flights
from infield.aided.headings import HeadingOpen
from infield.aided.noise import CHANGE_GAIN_NATS, Flown, Model
from infield.aided.open_heading import causal_weights, mixed
from infield.aided.start import FoundStart
from ins.filters.aided_records import AidedHistory, AidedStart, Antenna
from ins.filters.aided_smoother import smoothed, started_again, without_errors
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
    at, doubted = _Pass.of(flights, found, model), False
    for _ in range(MOST_PASSES - 1):
        if at.linear:
            break
        other = _Pass.of(flights, replace(at.found, start=at.start_again), model)
        gain = other.flown.over(at.flown)
        if gain < 0.0:
            doubted = gain < -CHANGE_GAIN_NATS
            break
        at = other
    best = at.doubted if doubted else at.smoothed
    if not doubted:
        covariance = held_prior(at.found.start.covariance, best.covariance[0])
        held = replace(at.start_again, covariance=covariance)
        last = _Pass.of(flights, replace(at.found, start=held), model)
        best = last.smoothed if last.flown.over(at.flown) >= 0.0 else best
    return _with_antenna(flights.as_timed(best, model), model.antenna)


@dataclass(frozen=True)
class _Pass:
    """A flight from a start, and what its smoother makes of it: errors (k, 15) of the flight, and
    those of its start (43,).
    """

    found: FoundStart
    flown: Flown
    smoothed: AidedHistory
    errors: NDArray
    start_errors: NDArray

    @classmethod
    def of(cls, flights: Flights, found: FoundStart, model: Model) -> "_Pass":
        history, tape = flights.taped(found, model)
        return cls(found, Flown(model, history), *smoothed(history, tape))

    @property
    def linear(self) -> bool:
        """Whether the attitude at the start is off by so little that it does not show."""
        off = float(np.linalg.norm(self.start_errors[AIDED_THETA]))
        sigma = np.sqrt(self.smoothed.variance[0, AIDED_THETA].sum())
        return bool(0.5 * off**2 <= NONLINEAR * sigma)

    @property
    def start_again(self) -> AidedStart:
        """The start at the attitude that all fixes show."""
        start = self.found.start
        return replace(start, state=started_again(start.state, self.start_errors))

    @property
    def doubted(self) -> AidedHistory:
        """The smoothed solution where the fixes are far less likely from the start that it shows:
        what it took off the flight counts as unknown.
        """
        unknown = self.errors[:, :, None] * self.errors[:, None, :]
        return without_errors(self.flown.history, self.errors, self.smoothed.covariance + unknown)


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
