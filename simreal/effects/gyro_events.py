"""Gyro errors tied to a power-on, to the time or to nothing that is logged (gap.md G01, G09, G10, G27, G28)."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ins.records import InputError
from ins.units import DEG_PER_HOUR, HOUR
from simreal.effects.base import Effect, Shape, ShapeParameter
from simreal.effects.gyro_effect import GyroEffect, one
from simreal.telemetry import Telemetry

LONGEST_RUN_S = 86400.0  # bound of an onset; cut to the run
ONSET = ShapeParameter("onset_s", "s", 0.0, LONGEST_RUN_S, 24, "linear", of_time=True)


def constant(run: Telemetry, axis: int, shape: Shape) -> tuple[NDArray, ...]:
    """1 deg/h throughout the run."""
    return (np.full(run.n, DEG_PER_HOUR),)


def ramp(run: Telemetry, axis: int, shape: Shape) -> tuple[NDArray, ...]:
    """1 deg/h an hour, from 0 at power-on."""
    return (DEG_PER_HOUR / HOUR * run.time_s,)


def step(run: Telemetry, axis: int, shape: Shape) -> tuple[NDArray, ...]:
    """1 deg/h from `onset_s` on; the interval that holds the onset takes its part, so that the onset can be refined."""
    after = (run.time_s + 0.5 * run.dt_s - shape["onset_s"]) / run.dt_s
    return (DEG_PER_HOUR * np.clip(after, 0.0, 1.0),)


def voltage(run: Telemetry, axis: int, shape: Shape) -> tuple[NDArray, ...]:
    """Runs of formats.md hold no voltages."""
    raise InputError(f"gyro_supply_voltage: run {run.run_index} has no housekeeping voltages")


def lacks_second_power_on(runs: Sequence[Telemetry], axis: int) -> str:
    """A constant of one run is its own turn-on bias; only several tell what is usual."""
    return "" if len(runs) > 1 else "a second power-on"


def lacks_housekeeping(runs: Sequence[Telemetry], axis: int) -> str:
    """No run holds this stream."""
    return "housekeeping voltages"


GYRO_EVENTS: tuple[Effect, ...] = (
    GyroEffect(
        id="G01", name="gyro_turn_on_bias", repeats="P", coefficients=one("deg/h", 3e-3, 0.01),
        signature=constant, lacks=lacks_second_power_on,
        rivals=("site_latitude_error", "gyro_g_sensitivity", "gyro_thermal_hysteresis", "gyro_misalignment"),
        source="gap.md G01; repeats P: a coefficient of its own at each power-on",
    ),
    GyroEffect(
        id="G09", name="gyro_rate_ramp", coefficients=one("deg/h/h", 1e-3, 5e-3), signature=ramp,
        rivals=("gyro_warmup_transient", "gyro_rate_random_walk"),
        source="IEEE Std 952-1997, annex C: rate ramp",
    ),
    GyroEffect(
        id="G10", name="gyro_bias_step", repeats="E", coefficients=one("deg/h", 2e-3, 0.02), shape=(ONSET,),
        signature=step, rivals=("platform_step", "engine_start", "gyro_common_mode"),
        source="gap.md G10: mode reset",
    ),
    GyroEffect(
        id="G27", name="gyro_supply_voltage", coefficients=one("deg/h per V", 1e-3, 0.01), signature=voltage,
        lacks=lacks_housekeeping, rivals=("gyro_common_mode", "unknown_function_of_run"), source="gap.md G27",
    ),
    GyroEffect(  # its target stands for the triad: three equal hypotheses would share one probability
        id="G28", name="gyro_common_mode", targets=("gyro_x",), repeats="E", coefficients=one("deg/h", 2e-3, 0.02),
        shape=(ONSET,), signature=step, all_axes=True, rivals=("gyro_bias_step", "gyro_supply_voltage", "clock_rate"),
        source="gap.md G28: one reference voltage or clock of three gyros",
    ),
)  # fmt: skip
