"""A gyro effect of the catalogue: a signature (what it adds, per coefficient), a condition, and perhaps added noise.

Each effect is a record of functions on a run, so that the modules `gyro_*` hold one formula an effect and no classes.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ins.records import InputError
from simreal.effects.base import AXIS, GYROS, AddedNoise, CatalogueEffect, Coefficient, Shape
from simreal.telemetry import Telemetry, Trace, on_axis

Signature = Callable[[Telemetry, int, Shape], tuple[NDArray, ...]]  # (run, axis, shape) -> a rate (n,) [rad/s] each
Condition = Callable[[Sequence[Telemetry], int], str]  # (runs, axis) -> what they lack
NoiseLaw = Callable[[Telemetry, int, Shape], AddedNoise]

NAME = "coefficient"  # of an effect that has one


def one(unit: str, low: float, high: float, *, signed: bool = True) -> tuple[Coefficient, ...]:
    """The single coefficient of an effect, with its usual size."""
    return (Coefficient(name=NAME, unit=unit, low=low, high=high, signed=signed),)


def several(names: Sequence[str], unit: str, low: float, high: float) -> tuple[Coefficient, ...]:
    """Coefficients of one unit and size."""
    return tuple(Coefficient(name=name, unit=unit, low=low, high=high) for name in names)


def nothing_lacks(runs: Sequence[Telemetry], axis: int) -> str:
    """The condition of an effect that any run shows."""
    return ""


@dataclass(frozen=True, kw_only=True)
class GyroEffect(CatalogueEffect):
    """An effect on the gyro of its target.

    signature : one series a coefficient, on the target's own axis. all_axes: the same on all three gyros.
    lacks : what the runs lack for it. noise_law : of a stochastic effect, per unit of the coefficient squared.
    """

    targets: tuple[str, ...] = GYROS
    signature: Signature | None = None
    lacks: Condition = nothing_lacks
    noise_law: NoiseLaw | None = None
    all_axes: bool = False

    def needs(self, runs: Sequence[Telemetry], target: str) -> str:
        return self.lacks(runs, self._axis(target))

    def traces(self, run: Telemetry, target: str, shape: Shape) -> tuple[Trace, ...]:
        axis = self._axis(target)
        columns = () if self.signature is None else self.signature(run, axis, shape)
        if self.all_axes:
            return tuple(Trace(gyro_rad_s=np.repeat(c[:, None], 3, axis=1)) for c in columns)
        return tuple(Trace(gyro_rad_s=on_axis(c, axis)) for c in columns)

    def noise(self, run: Telemetry, target: str, shape: Shape) -> tuple[AddedNoise, ...]:
        if self.noise_law is None:
            return ()
        return (self.noise_law(run, self._axis(target), shape),)

    def _axis(self, target: str) -> int:
        if target not in self.targets:
            raise InputError(f"{self.name}: target {target!r}, needed one of {', '.join(self.targets)}")
        return AXIS[target]
