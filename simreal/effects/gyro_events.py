"""Gyro errors tied to a power-on, to the time or to nothing that is logged (effects.md G01, G09,
G10, G27, G28).
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ins.units import DEG_PER_HOUR, HOUR
from simreal.effects.base import GYROS, Effect, Shape
from simreal.effects.parts.formula import OutOfReach
from simreal.effects.parts.gyro_effect import gyro_effect, on_gyro, one
from simreal.effects.platform import ONSET
from simreal.effects.telemetry import Telemetry, Trace


def constant(run: Telemetry, target: str, shape: Shape) -> tuple[Trace, ...]:
    """1 deg/h throughout the run."""
    return on_gyro(target, np.full(run.n, DEG_PER_HOUR))


def ramp(run: Telemetry, target: str, shape: Shape) -> tuple[Trace, ...]:
    """1 deg/h an hour, from 0 at power-on."""
    return on_gyro(target, DEG_PER_HOUR / HOUR * run.time_s)


def step(run: Telemetry, target: str, shape: Shape) -> tuple[Trace, ...]:
    """1 deg/h from `onset_s` on; the interval that holds the onset takes its part, so that the
    onset can be refined.
    """
    return on_gyro(target, DEG_PER_HOUR * after_onset(run, shape))


def common_step(run: Telemetry, target: str, shape: Shape) -> tuple[Trace, ...]:
    """The same step of 1 deg/h on all three gyros."""
    return (
        Trace(gyro_rad_s=DEG_PER_HOUR * np.repeat(after_onset(run, shape)[:, None], 3, axis=1)),
    )


def after_onset(run: Telemetry, shape: Shape) -> NDArray:
    """Part of each interval that lies after the onset (n,)."""
    return np.clip((run.time_s + 0.5 * run.dt_s - shape["onset_s"]) / run.dt_s, 0.0, 1.0)


def lacks_second_power_on(runs: Sequence[Telemetry], target: str) -> str:
    """A constant of one run is its own turn-on bias; only several tell what is usual."""
    return "" if len(runs) > 1 else "a second power-on"


GYRO_EVENTS: tuple[Effect, ...] = (
    gyro_effect(
        "gyro_turn_on_bias",
        repeats="P",
        coefficients=one("deg/h", 3e-3, 0.01),
        formula=constant,
        need=lacks_second_power_on,
        rivals=(
            "site_latitude_error",
            "gyro_g_sensitivity",
            "gyro_thermal_hysteresis",
            "gyro_misalignment",
            "gyro_magnetic_sensitivity",
            "gyro_dither_coning",
            "platform_yaw_creep",
        ),
        source="effects.md G01; repeats P: a coefficient of its own at each power-on",
    ),
    gyro_effect(
        "gyro_rate_ramp",
        coefficients=one("deg/h/h", 1e-3, 5e-3),
        formula=ramp,
        rivals=("gyro_warmup_transient", "gyro_rate_random_walk", "platform_yaw_creep"),
        source="IEEE Std 952-1997, annex C: rate ramp",
    ),
    gyro_effect(
        "gyro_bias_step",
        repeats="E",
        coefficients=one("deg/h", 2e-3, 0.02),
        shape=(ONSET,),
        formula=step,
        rivals=("platform_step", "engine_start", "gyro_common_mode", "gyro_g2_sensitivity"),
        source="effects.md G10: mode reset",
    ),
    OutOfReach(
        "gyro_supply_voltage",
        "gyro_supply_voltage",
        GYROS,
        one("deg/h per V", 1e-3, 0.01),
        need="housekeeping voltages",
        rivals=("gyro_common_mode",),
        source="effects.md G27",
    ),
    # its target stands for the triad: three equal hypotheses would share one probability
    gyro_effect(
        "gyro_common_mode",
        targets=("gyro_x",),
        repeats="E",
        coefficients=one("deg/h", 2e-3, 0.02),
        shape=(ONSET,),
        formula=common_step,
        rivals=("gyro_bias_step", "gyro_supply_voltage", "clock_rate"),
        source="effects.md G28: one reference voltage or clock of three gyros",
    ),
)
