"""What the declarations of gyro effects share: the single coefficient, several of one kind, a
series on one gyro.
"""

from collections.abc import Sequence
from typing import Any

from numpy.typing import NDArray

from simreal.effects.base import AXIS, GYROS, Coefficient
from simreal.effects.parts.formula import FormulaEffect
from simreal.effects.telemetry import Trace, on_axis

COEFFICIENT = "coefficient"  # of an effect that has one


def one(unit: str, low: float, high: float, *, signed: bool = True) -> tuple[Coefficient, ...]:
    """The single coefficient of an effect, with its usual size."""
    return (Coefficient(name=COEFFICIENT, unit=unit, low=low, high=high, signed=signed),)


def several(names: Sequence[str], unit: str, low: float, high: float) -> tuple[Coefficient, ...]:
    """Coefficients of one unit and size."""
    return tuple(Coefficient(name=name, unit=unit, low=low, high=high) for name in names)


def gyro_effect(
    name: str, *, id: str = "", targets: tuple[str, ...] = GYROS, **fields: Any
) -> FormulaEffect:
    """A declaration: `fields` as in FormulaEffect; the id is the name unless given."""
    return FormulaEffect(id=id or name, name=name, targets=targets, **fields)


def on_gyro(target: str, *series_rad_s: NDArray) -> tuple[Trace, ...]:
    """One trace for each series (n,) [rad/s] on the target's gyro."""
    return tuple(Trace(gyro_rad_s=on_axis(series, AXIS[target])) for series in series_rad_s)
