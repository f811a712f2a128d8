"""Gyro errors of rotation, specific force and magnetic field (gap.md G12 to G20)."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ins.units import DEG_PER_HOUR, MILLIRADIAN, PPM, STANDARD_GRAVITY
from simreal.effects.base import Coefficient, Effect, Shape, ShapeParameter
from simreal.effects.conditions import (
    lacks_cross_turns,
    lacks_force_changes,
    lacks_headings,
    lacks_left_and_right_turns,
    lacks_turns,
    lacks_turns_at_two_temperatures,
)
from simreal.effects.gyro_effect import GyroEffect, one, several
from simreal.effects.gyro_events import constant
from simreal.effects.gyro_thermal import above_reference
from simreal.telemetry import Telemetry

HORIZONTAL_FIELD_GAUSS = 0.2  # of the Earth in middle latitudes (0.1 to 0.4); towards true north
DITHER_LOG_S = 0.002  # dither lies at 300 to 600 Hz


def scale_factor(run: Telemetry, axis: int, shape: Shape) -> tuple[NDArray, ...]:
    """1 ppm of the gyro's own rate."""
    return (PPM * run.rate_rad_s[:, axis],)


def scale_asymmetry(run: Telemetry, axis: int, shape: Shape) -> tuple[NDArray, ...]:
    """1 ppm of the size of the gyro's own rate."""
    return (PPM * np.abs(run.rate_rad_s[:, axis]),)


def scale_thermal(run: Telemetry, axis: int, shape: Shape) -> tuple[NDArray, ...]:
    """1 ppm per degC above 25 degC of the gyro's own rate."""
    return (PPM * above_reference(run, axis) * run.rate_rad_s[:, axis],)


def misalignment(run: Telemetry, axis: int, shape: Shape) -> tuple[NDArray, ...]:
    """1 mrad of the rate about each of the other two axes, in their order; the twin's `misalignment_mrad`."""
    return tuple(MILLIRADIAN * run.rate_rad_s[:, k] for k in range(3) if k != axis)


def g_sensitivity(run: Telemetry, axis: int, shape: Shape) -> tuple[NDArray, ...]:
    """1 deg/h per g of each component of the specific force, the constant 1 g of rest included."""
    return tuple(DEG_PER_HOUR / STANDARD_GRAVITY * run.force_m_s2[:, k] for k in range(3))


def g2_sensitivity(run: Telemetry, axis: int, shape: Shape) -> tuple[NDArray, ...]:
    """1 deg/h per g^2 of |f|^2 - 1 g^2: of the means over `dt_s`, so vibration within one is not in it."""
    return (DEG_PER_HOUR * (np.sum(run.force_m_s2**2, axis=1) / STANDARD_GRAVITY**2 - 1.0),)


def magnetic(run: Telemetry, axis: int, shape: Shape) -> tuple[NDArray, ...]:
    """1 deg/h per gauss of the Earth's horizontal field along body x and body y.

    Taken as 0.2 gauss due north: level, (cos H, -sin H) of it. The vertical part is constant while the unit is level.
    """
    return tuple(DEG_PER_HOUR * HORIZONTAL_FIELD_GAUSS * run.C_nb[:, 0, k] for k in range(2))


def lock_in(run: Telemetry, axis: int, shape: Shape) -> tuple[NDArray, ...]:
    """A dead zone as a whole (coefficient 1); dither leaves a small part of it.

    Read less true: -w for |w| < L, else sign(w) sqrt(w^2 - L^2) - w, about -L^2 / (2 w) at high rates.
    Source: Aronowitz (1971), lock-in of a ring laser's counter-running waves.
    """
    w, L = run.rate_rad_s[:, axis], shape["threshold_deg_h"] * DEG_PER_HOUR
    return (np.sign(w) * np.sqrt(np.maximum(w**2 - L**2, 0.0)) - w,)


def lacks_high_rate_log(runs: Sequence[Telemetry], axis: int) -> str:
    """For effects of the dither itself."""
    return "" if runs and all(run.dt_s <= DITHER_LOG_S for run in runs) else "raw data at 500 Hz"


def lacks_slow_rotation(runs: Sequence[Telemetry], axis: int) -> str:
    """For the dead zone: turns both ways, which pass through zero."""
    return "slow rotation through zero" if lacks_left_and_right_turns(runs, axis) else ""


def _misalignment(axis: str) -> GyroEffect:
    others = [name for name in "xyz" if name != axis]
    return GyroEffect(
        id=f"G15{axis}", name="gyro_misalignment", targets=(f"gyro_{axis}",),
        coefficients=several([f"to_{name}" for name in others], "mrad", 0.01, 0.1),
        signature=misalignment, lacks=lacks_cross_turns,
        rivals=("gyro_magnetic_sensitivity", "gyro_turn_on_bias", "site_latitude_error"),
        source="IEEE Std 647-2006: input-axis misalignment",
    )  # fmt: skip


GYRO_RATE: tuple[Effect, ...] = (
    GyroEffect(
        id="G12", name="gyro_scale_factor", coefficients=one("ppm", 1.0, 50.0), signature=scale_factor, lacks=lacks_turns,
        rivals=("clock_rate", "gyro_scale_asymmetry", "gyro_scale_thermal"), source="IEEE Std 647-2006: scale factor error",
    ),
    GyroEffect(
        id="G13", name="gyro_scale_asymmetry", coefficients=one("ppm", 1.0, 10.0), signature=scale_asymmetry,
        lacks=lacks_left_and_right_turns, rivals=("gyro_scale_factor",), source="IEEE Std 647-2006: scale factor asymmetry",
    ),
    GyroEffect(
        id="G14", name="gyro_scale_thermal", coefficients=one("ppm per degC", 0.5, 5.0), signature=scale_thermal,
        lacks=lacks_turns_at_two_temperatures, rivals=("gyro_scale_factor",),
        source="IEEE Std 647-2006: scale factor temperature sensitivity",
    ),
    *(_misalignment(axis) for axis in "xyz"),
    GyroEffect(
        id="G16", name="gyro_g_sensitivity", coefficients=several(("f_x", "f_y", "f_z"), "deg/h per g", 3e-4, 3e-3),
        signature=g_sensitivity, lacks=lacks_force_changes, rivals=("gyro_turn_on_bias", "gyro_g2_sensitivity"),
        source="IEEE Std 952-1997: acceleration sensitivity",
    ),
    GyroEffect(
        id="G17", name="gyro_g2_sensitivity", coefficients=one("deg/h per g^2", 3e-4, 3e-3),
        signature=g2_sensitivity, lacks=lacks_force_changes,
        rivals=("gyro_bias_step", "gyro_dither_coning", "engine_start", "gyro_g_sensitivity"),
        source="gap.md G17: vibration rectification, of the load factor only",
    ),
    GyroEffect(
        id="G18", name="gyro_magnetic_sensitivity", coefficients=several(("b_x", "b_y"), "deg/h per gauss", 1e-3, 0.05),
        signature=magnetic, lacks=lacks_headings,
        rivals=("gyro_misalignment", "site_latitude_error", "gyro_turn_on_bias"),
        source="IEEE Std 952-1997: magnetic sensitivity",
    ),
    GyroEffect(
        id="G19", name="gyro_lock_in", coefficients=(Coefficient("coefficient", "fraction left", 1e-5, 1e-3, signed=False),),
        shape=(ShapeParameter("threshold_deg_h", "deg/h", 50.0, 2000.0, 6),),
        signature=lock_in, lacks=lacks_slow_rotation, rivals=("gyro_dither_coning", "gyro_scale_factor"),
        source="Aronowitz (1971)",
    ),
    GyroEffect(
        id="G20", name="gyro_dither_coning", coefficients=one("deg/h", 1e-3, 0.01), signature=constant,
        lacks=lacks_high_rate_log, rivals=("gyro_turn_on_bias", "gyro_g2_sensitivity"),
        source="gap.md G20: the constant that dither coning leaves, th_x th_y w sin(phase) / 2",
    ),
)  # fmt: skip
