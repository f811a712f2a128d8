"""A place that swings about where it is moored, as states of the filter.

A vehicle on a moored ship, on jacks or on a soft quay strays further in a minute than one on its
gear, and comes back: its place is a damped oscillator that something drives::

    x'' + 2 zeta w x' + w^2 x = white noise,    RMS of x: swing_m

while the place of a vehicle that rolls unseen walks off and never returns. Each level axis has its
own oscillator, with three states behind the filter's bins: two hold its place in turn (the new one
beside the old one), one its velocity. They are moved on by assignments, which need no kernel of
their own and are exact for steps of any length: with e1, e2 the oscillator's noise over a step,
cov(e1, e2) = [[q11, q12], [q12, q22]] and c = q12 / q11::

    new = a11 old + a12 velocity + e1
    velocity = (a21 - c a11) old + (a22 - c a12) velocity + c new + e2',   var(e2') = q22 - q12 c

Source: oscillator under white noise, Crandall and Mark, "Random Vibration in Mechanical Systems"
(1963), section 2.2. Pinned by: tests/alignment/test_mooring_motion.py

Decision: docs/decisions/0007-parked-position.md.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from ins.estimation.tape import Row, Tape

STATES = 6  # three for each level axis


@dataclass(frozen=True)
class MooringMotion:
    """Natural period [s] and damping ratio of a place that comes back."""

    period_s: float
    damping: float

    @property
    def natural_rad_s(self) -> float:
        return 2.0 * np.pi / self.period_s

    def over(self, dt_s: float) -> tuple[NDArray, NDArray]:
        """Transition and noise (2, 2) of place and velocity over a step, for an RMS of 1 m."""
        return _over(self, round(dt_s, 6))


@lru_cache(maxsize=4096)
def _over(mooring: MooringMotion, dt_s: float) -> tuple[NDArray, NDArray]:
    w = mooring.natural_rad_s
    a = expm(np.array([[0.0, 1.0], [-(w**2), -2.0 * mooring.damping * w]]) * dt_s)
    settled = np.diag([1.0, w**2])
    return a, settled - a @ settled @ a.T


@dataclass(frozen=True)
class Noise:
    """Rows that a mooring laid down: of which steps (m,), and their variance for an RMS of 1 m."""

    first_row: int
    steps: NDArray
    share: NDArray


@dataclass(frozen=True)
class Laid:
    """A mooring in a tape: its noise, and its place in the rows of a measurement at chosen
    steps.
    """

    noise: tuple[Noise, ...]
    _odd: NDArray  # (K,): whether the second of the two states holds the place after a step
    _first_state: int

    def place(self, axis: int, at: NDArray) -> Row:
        """The place of a level axis (0, 1) after the steps `at`, as coefficients of states."""
        first = self._first_state + 3 * axis
        odd = self._odd[at].astype(float)
        return {first: 1.0 - odd, first + 1: odd}


def lay(
    tape: Tape,
    mooring: MooringMotion,
    still: NDArray,
    displacement: tuple[int, int],
    first_state: int,
) -> Laid:
    """Add the mooring of a vehicle that stands in the steps `still` (K,).

    Where a stretch of rest begins the mooring is anywhere, and what the displacement states count
    begins from there. first_state: of the mooring's own.
    """
    at = np.flatnonzero(still)
    begins = np.flatnonzero(still & ~np.append(False, still[:-1]))
    own = np.searchsorted(begins, at, side="right") - 1  # stretch of each step
    number = np.arange(len(at)) - np.searchsorted(at, begins)[own]
    after = np.zeros(still.size, dtype=bool)
    after[at] = number % 2 == 0  # each stretch begins in the first state
    noise: list[Noise] = []
    for axis, counted in enumerate(displacement):
        states = tuple(first_state + 3 * axis + k for k in range(3))
        noise += _begin(tape, mooring, begins, states, counted)
        for odd in (True, False):
            noise += _move_on(tape, mooring, at[after[at] == odd], states, odd)
    return Laid(tuple(noise), after, first_state)


def _begin(
    tape: Tape, mooring: MooringMotion, at: NDArray, states: tuple[int, ...], counted: int
) -> Iterator[Noise]:
    """The mooring anywhere at the start of a stretch, from where its displacement is counted."""
    place, _, velocity = states
    for state, variance in ((place, 1.0), (velocity, mooring.natural_rad_s**2)):
        yield Noise(tape.rows, at, np.full(at.size, variance))
        tape.assign(at, state, {}, variance)
    tape.assign(at, counted, {counted: 1.0, place: -1.0}, 0.0)


def _move_on(
    tape: Tape, mooring: MooringMotion, at: NDArray, states: tuple[int, ...], odd: bool
) -> Iterator[Noise]:
    """The mooring over the steps `at`, into the second place state where `odd`."""
    if not at.size:
        return
    old, new = states[:2] if odd else states[1::-1]
    velocity = states[2]
    over = [mooring.over(float(dt)) for dt in tape.steps.dt_s[at]]
    a, q = (np.stack(part) for part in zip(*over))
    c = q[:, 0, 1] / q[:, 0, 0]
    yield Noise(tape.rows, at, q[:, 0, 0])
    tape.assign(at, new, {old: a[:, 0, 0], velocity: a[:, 0, 1]}, q[:, 0, 0])
    left = np.maximum(q[:, 1, 1] - c * q[:, 0, 1], 0.0)
    yield Noise(tape.rows, at, left)
    row = {old: a[:, 1, 0] - c * a[:, 0, 0], velocity: a[:, 1, 1] - c * a[:, 0, 1], new: c}
    tape.assign(at, velocity, row, left)
