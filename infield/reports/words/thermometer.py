"""Sentences of `infield.thermometer`: what is wrong with a run's thermometers."""

from collections.abc import Mapping
from enum import StrEnum

from infield.reports.words.sentences import Template
from infield.thermometer.reasons import NoTemperature, ThermometerReason

SENTENCES: Mapping[StrEnum, Template] = {
    **NoTemperature.TEMPLATES,
    ThermometerReason.OF_ANOTHER: "{column}: {fault}",
    ThermometerReason.COARSE: "thermometer {column}: {fault}; its sigma is wider",
    ThermometerReason.CONSTANT: (
        "thermometer {column}: {fault}; a step of 1 degC could hide in it, and is in its sigma"
    ),
    ThermometerReason.HOLE: (
        "thermometer {column}: {fault}; nothing is learnt there beyond two minutes"
    ),
    ThermometerReason.AXIS_LEFT_OUT: "thermometer {column}: {fault}; the axis is left out",
    ThermometerReason.READINGS_LEFT_OUT: (
        "thermometer {column}: {fault}; these readings are left out"
    ),
}
