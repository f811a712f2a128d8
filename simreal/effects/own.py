"""All that a user's own effect is written with, in one place.

`Effect` is the protocol that the diagnosis asks; `CatalogueEffect` is a base with its fields filled
in. An effect says what the runs lack to show it (`needs`), and gives for a run (`Telemetry`) the
`Trace` of one unit of each `Coefficient`, or the `AddedNoise`. examples/own_effect.py is one.
"""

from simreal.effects.base import (
    ACCELS,
    AXIS,
    GYROS,
    AddedNoise,
    CatalogueEffect,
    Coefficient,
    Effect,
    Shape,
    ShapeParameter,
)
from simreal.effects.telemetry import Telemetry, Trace, on_axis

__all__ = [
    "ACCELS",
    "AXIS",
    "GYROS",
    "AddedNoise",
    "CatalogueEffect",
    "Coefficient",
    "Effect",
    "Shape",
    "ShapeParameter",
    "Telemetry",
    "Trace",
    "on_axis",
]
