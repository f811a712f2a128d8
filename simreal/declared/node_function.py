"""A generic answer of the diagnosis with its values: straight lines between nodes of temperature,
its rate, time or run.

Written in a twin as {"effect": "unknown_function_of_temperature", "target": "gyro_y", "parameters":
{"nodes": [...], "values": [...], "unit": "deg/h"}}; the nodes of a function of run are run ids.
Before the first and beyond the last node the value stays.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ins.errors.accelerometer import accel_degC
from ins.errors.base import AXIS, GYROS, ErrorSource, Shape
from ins.errors.parts.gyro_needs import gyro_degC, gyro_degC_min
from ins.errors.telemetry import Telemetry, Trace, on_axis
from ins.errors.unnamed import OF_RATE, OF_RUN, OF_TEMPERATURE, OF_TIME
from ins.records import InputError
from ins.units import DEG_PER_HOUR, MICRO_G

FUNCTIONS = (OF_TEMPERATURE, OF_RATE, OF_TIME, OF_RUN)
VALUE_UNITS = {"deg/h": DEG_PER_HOUR, "ug": MICRO_G}


def unit_of(target: str) -> str:
    """The unit of the values on a channel."""
    return "deg/h" if target in GYROS else "ug"


@dataclass(frozen=True)
class NodeFunction(ErrorSource):
    """Values (in the unit of the target) at increasing nodes: degC, degC/min or s; of a run: one
    value (no nodes).
    """

    nodes: tuple[float, ...] = ()
    values: tuple[float, ...] = ()

    def traces(self, run: Telemetry, target: str, shape: Shape) -> tuple[Trace, ...]:
        size = VALUE_UNITS[unit_of(target)]
        series = np.full(run.n, self.values[0])
        if self.name != OF_RUN:
            series = np.interp(self._at(run, target), self.nodes, self.values)
        column = on_axis(size * series, AXIS[target])
        return (Trace(gyro_rad_s=column) if target in GYROS else Trace(accel_m_s2=column),)

    def _at(self, run: Telemetry, target: str) -> NDArray:
        if self.name == OF_TIME:
            return run.time_s
        if self.name == OF_RATE:
            return gyro_degC_min(run, target)
        if self.name == OF_TEMPERATURE:
            return gyro_degC(run, target) if target in GYROS else accel_degC(run, target)
        raise InputError(f"{self.name}: not a function of temperature, its rate, time or run")
