"""What an effect is: how its parameters are drawn, and how it changes the raw streams of a run."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.gap_trials.seen import Seen, Streams

GYROS = ("gyro_x", "gyro_y", "gyro_z")
ACCELS = ("accel_x", "accel_y", "accel_z")
Parameters = dict[str, Any]
Drawing = Callable[[np.random.Generator, tuple[Seen, ...]], Parameters]
Laying = Callable[[Streams, Seen, str, Parameters, float], Streams]


@dataclass(frozen=True, kw_only=True)
class Effect:
    """One effect under its name in effects.md, section 2.

    draw: the parameters of a trial, coefficients at the middle of the usual range with a random
    sign, others (time constants, onsets, periods, widths) anywhere in it. lay: the streams of one
    run with `size` times the effect. needs: of "taxi", "gnss", "odometer", "runs" (several).
    answers: right names for it (the first is the plain one); accepted: right targets besides its
    own. linear: the change of the rows is proportional to the size. confounded: names that these
    plans cannot, or hardly, tell from it (effects.md, section 2): a set that holds both is right.
    """

    name: str
    targets: tuple[str, ...]
    draw: Drawing
    lay: Laying
    needs: frozenset[str] = frozenset()
    answers: tuple[str, ...] = ()
    accepted: tuple[str, ...] = ()
    confounded: tuple[str, ...] = ()
    linear: bool = True

    @property
    def right_answers(self) -> tuple[str, ...]:
        return self.answers or (self.name,)


class Effects(list[Effect]):
    """The effects of a module, in the order of the functions that lay them."""

    def plants(
        self, name: str, targets: tuple[str, ...], draw: Drawing, **more: Any
    ) -> Callable[[Laying], Laying]:
        """Decorator of `lay` of an effect; more: its other fields."""

        def declare(lay: Laying) -> Laying:
            self.append(Effect(name=name, targets=targets, draw=draw, lay=lay, **more))
            return lay

        return declare


def signed(rng: np.random.Generator, size: float) -> float:
    """A coefficient of this size, either sign."""
    return size if rng.random() < 0.5 else -size


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def seed(rng: np.random.Generator) -> int:
    return int(rng.integers(2**31))


def event(rng: np.random.Generator, seen: tuple[Seen, ...]) -> Parameters:
    """One run and an onset within its parked time, not at its ends."""
    run = int(rng.integers(len(seen)))
    return {"run": run, "onset_s": float(rng.uniform(0.15, 0.85) * seen[run].taxi_s)}
