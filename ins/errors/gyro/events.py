"""Gyro errors tied to a power-on, to the time or to nothing that is logged (effects.md G01, G09,
G10, G27, G28).
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ins.errors.base import GYROS, Shape, Words, error, on_gyro, one
from ins.errors.platform import ONSET
from ins.errors.telemetry import Telemetry, Trace
from ins.units import DEG_PER_HOUR, HOUR


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


GYRO_EVENTS = (
    error(
        "G01",
        "gyro_turn_on_bias",
        GYROS,
        one("deg/h", 3e-3, 0.01),
        repeats="P",
        formula=constant,
        twin=("gyro", "turn_on_deg_h", 1.0),
        need=lacks_second_power_on,
        rivals=(
            "site_latitude_error",
            "gyro_g_sensitivity",
            "gyro_misalignment",
            "gyro_magnetic_sensitivity",
            "gyro_dither_coning",
            "platform_yaw_creep",
        ),
        source="repeats P: a coefficient of its own at each power-on",
        words=Words(
            what="Each power-on gives the gyro another constant bias.",
            brought_on_by="Every power-on; within one session it does not change.",
            size="On the east gyro 0.01 deg/h turns the aligned heading by 0.94 mrad at 45 "
            "degrees.",
            remedy="Raise the twin's `turn_on_deg_h` if it is usual; no table can remove it.",
        ),
    ),
    error(
        "G09",
        "gyro_rate_ramp",
        GYROS,
        one("deg/h/h", 1e-3, 5e-3),
        formula=ramp,
        rivals=("gyro_rate_random_walk", "platform_yaw_creep"),
        source="IEEE Std 952-1997, annex C: rate ramp",
        words=Words(
            what="The bias grows steadily with time, as a laser or a seal ages within a session.",
            brought_on_by="Time alone; two hours or several runs are needed to see it.",
            size="Over one hour it is as large as a turn-on bias.",
            remedy="Record a hot restart or a longer run to tell it from the end of a warm-up.",
        ),
    ),
    error(
        "G10",
        "gyro_bias_step",
        GYROS,
        one("deg/h", 2e-3, 0.02),
        shape=(ONSET,),
        repeats="E",
        formula=step,
        rivals=("platform_step", "engine_start", "gyro_common_mode", "gyro_g2_sensitivity"),
        source="mode reset",
        words=Words(
            what="The bias jumps once, as when a controller resets or a mode changes.",
            brought_on_by="A single event at a time of its own.",
            size="A step of 0.01 deg/h shows within minutes in a parked log.",
            remedy="Split the session there; if it comes again at a temperature, inspect the unit.",
        ),
    ),
    error(
        "G27",
        "gyro_supply_voltage",
        GYROS,
        one("deg/h per V", 1e-3, 0.01),
        out_of_reach="housekeeping voltages",
        rivals=("gyro_common_mode",),
        source="$k_V(V - V_0)$, laser intensity, path-length control",
        words=Words(
            what="The bias depends on the supply voltage or on a controller's set point.",
            brought_on_by="Change from ground power to the aircraft's own, or a weak battery.",
            size="All three axes move together, at the instant of the change.",
            remedy="Log the voltage; keep one power source through alignment.",
        ),
    ),
    # its target stands for the triad: three equal hypotheses would share one probability
    error(
        "G28",
        "gyro_common_mode",
        ("gyro_x",),
        one("deg/h", 2e-3, 0.02),
        shape=(ONSET,),
        repeats="E",
        formula=common_step,
        rivals=("clock_rate",),
        source="one reference voltage or clock of three gyros",
        words=Words(
            what="All three gyros err together, from a shared clock, reference or supply.",
            brought_on_by="An event in what the gyros share; a true rotation looks the same.",
            size="Only its equality on three axes tells it from three drifts.",
            remedy="Look for the shared part: clock, reference voltage, heater.",
        ),
    ),
)
