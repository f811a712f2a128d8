"""Answers of a diagnosis without a name: free functions that compete with the named errors on every
channel.
"""

from collections.abc import Mapping

from ins.errors.base import Words

OF_TEMPERATURE = "unknown_function_of_temperature"
OF_RATE = "unknown_function_of_temperature_rate"
OF_TIME = "unknown_function_of_time"
OF_RUN = "unknown_function_of_run"
UNKNOWN_MOTION = "unknown"  # of the motion, on a channel that only moving vehicles have
# an error of a gyro or an accelerometer that is there only while the vehicle moves
WHILE_MOVING = "unknown_while_moving"
FREE_FUNCTIONS: Mapping[str, Words] = {
    OF_TEMPERATURE: Words(
        what="Something that goes with temperature, as no named effect does.",
        brought_on_by="Changes of temperature.",
        size="Its curve over temperature is in the report.",
        remedy="Recalibrate; the twin can carry the curve as it is.",
    ),
    OF_RATE: Words(
        what="Something that goes with the rate of temperature, as no named effect does.",
        brought_on_by="Ramps.",
        size="Its curve over the rate is in the report.",
        remedy="Record ramps of two steepnesses, up and down.",
    ),
    OF_TIME: Words(
        what="Something that goes with time since power-on, as no named effect does.",
        brought_on_by="Each power-on alike.",
        size="Its curve over time is in the report.",
        remedy="Record a hot restart, and log what else changes after power-on.",
    ),
    OF_RUN: Words(
        what="A constant of its own in each run.",
        brought_on_by="Whatever differs between the runs.",
        size="Its value in each run is in the report.",
        remedy="Record more headings and sites, so that headings, site and power-on part.",
    ),
    WHILE_MOVING: Words(
        what="An error of the sensor that is there only while the vehicle moves.",
        brought_on_by="Motion: vibration, engines, loads, or what runs only then.",
        size="The parked part of the run is free of it.",
        remedy="Log what differs on the move, and record drives at two speeds with stops.",
    ),
    UNKNOWN_MOTION: Words(
        what="Something that goes with the vehicle's motion, as no named effect does.",
        brought_on_by="Speed, acceleration or turns.",
        size="It shows on odometer, side slip or GNSS.",
        remedy="Record turns to both sides at two speeds.",
    ),
}
