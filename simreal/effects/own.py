"""All that a user's own effect is written with, in one place.

`Effect` is the protocol that the diagnosis asks; `ErrorSource` is a base with its fields filled in.
An effect says what the runs lack to show it (`needs`), and gives for a run (`Telemetry`) the
`Trace` of one unit of each `Coefficient`, or the `AddedNoise`; with a `Prior` of the recipe
"session" an update estimates its coefficients. examples/own_effect.py is one.
"""

from ins.errors.base import (
    ACCELS,
    AXIS,
    GYROS,
    AddedNoise,
    Coefficient,
    Effect,
    ErrorSource,
    Shape,
    ShapeParameter,
    Words,
)
from ins.errors.prior import Prior
from ins.errors.telemetry import Telemetry, Trace, on_axis

CatalogueEffect = ErrorSource  # its name before

__all__ = [
    "ACCELS",
    "AXIS",
    "GYROS",
    "AddedNoise",
    "CatalogueEffect",
    "Coefficient",
    "Effect",
    "ErrorSource",
    "Prior",
    "Shape",
    "ShapeParameter",
    "Telemetry",
    "Trace",
    "Words",
    "on_axis",
]
