"""Gyro errors of rotation, specific force and magnetic field (effects.md G12 to G20)."""

from collections.abc import Sequence

import numpy as np

from ins.units import DEG_PER_HOUR, MILLIRADIAN, PPM, STANDARD_GRAVITY
from simreal.effects.base import AXIS, Coefficient, Effect, Shape, ShapeParameter
from simreal.effects.gyro_events import constant
from simreal.effects.gyro_thermal import above_reference
from simreal.effects.parts.formula import FormulaEffect, with_parts
from simreal.effects.parts.gyro_effect import gyro_effect, on_gyro, one, several
from simreal.effects.parts.gyro_needs import (
    lacks_cross_turns,
    lacks_force_changes,
    lacks_headings,
    lacks_left_and_right_turns,
    lacks_turns_at_two_temperatures,
    lacks_turns_or_earth_rate,
)
from simreal.effects.telemetry import Telemetry, Trace

HORIZONTAL_FIELD_GAUSS = 0.2  # of the Earth in middle latitudes (0.1 to 0.4); towards true north
DITHER_LOG_S = 0.002  # dither lies at 300 to 600 Hz


def scale_factor(run: Telemetry, target: str, shape: Shape) -> tuple[Trace, ...]:
    """1 ppm of the gyro's own rate."""
    return on_gyro(target, PPM * run.rate_rad_s[:, AXIS[target]])


def scale_asymmetry(run: Telemetry, target: str, shape: Shape) -> tuple[Trace, ...]:
    """1 ppm of the size of the gyro's own rate."""
    return on_gyro(target, PPM * np.abs(run.rate_rad_s[:, AXIS[target]]))


def scale_thermal(run: Telemetry, target: str, shape: Shape) -> tuple[Trace, ...]:
    """1 ppm per degC above 25 degC of the gyro's own rate."""
    return on_gyro(target, PPM * above_reference(run, target) * run.rate_rad_s[:, AXIS[target]])


def misalignment(run: Telemetry, target: str, shape: Shape) -> tuple[Trace, ...]:
    """1 mrad of the rate about each of the other two axes, in their order; the twin's
    `misalignment_mrad`.
    """
    return on_gyro(
        target, *(MILLIRADIAN * run.rate_rad_s[:, k] for k in range(3) if k != AXIS[target])
    )


def g_sensitivity(run: Telemetry, target: str, shape: Shape) -> tuple[Trace, ...]:
    """1 deg/h per g of each component of the specific force, the constant 1 g of rest included."""
    return on_gyro(
        target, *(DEG_PER_HOUR / STANDARD_GRAVITY * run.force_m_s2[:, k] for k in range(3))
    )


def g2_sensitivity(run: Telemetry, target: str, shape: Shape) -> tuple[Trace, ...]:
    """1 deg/h per g^2 of |f|^2 - 1 g^2: of the means over `dt_s`, so vibration within one is not in
    it.
    """
    return on_gyro(
        target, DEG_PER_HOUR * (np.sum(run.force_m_s2**2, axis=1) / STANDARD_GRAVITY**2 - 1.0)
    )


def magnetic(run: Telemetry, target: str, shape: Shape) -> tuple[Trace, ...]:
    """1 deg/h per gauss of the Earth's horizontal field along body x and body y.

    Taken as 0.2 gauss due north: level, (cos H, -sin H) of it. The vertical part is constant while
    the unit is level.
    """
    return on_gyro(
        target, *(DEG_PER_HOUR * HORIZONTAL_FIELD_GAUSS * run.C_nb[:, 0, k] for k in range(2))
    )


def lock_in(run: Telemetry, target: str, shape: Shape) -> tuple[Trace, ...]:
    """A dead zone as a whole (coefficient 1); dither leaves a small part of it.

    Read less true: -w for |w| < L, else sign(w) sqrt(w^2 - L^2) - w, about -L^2 / (2 w) at high
    rates. Source: Aronowitz (1971), lock-in of a ring laser's counter-running waves.
    """
    w, L = run.rate_rad_s[:, AXIS[target]], shape["threshold_deg_h"] * DEG_PER_HOUR
    return on_gyro(target, np.sign(w) * np.sqrt(np.maximum(w**2 - L**2, 0.0)) - w)


def lacks_high_rate_log(runs: Sequence[Telemetry], target: str) -> str:
    """For effects of the dither itself."""
    return "" if runs and all(run.dt_s <= DITHER_LOG_S for run in runs) else "raw data at 500 Hz"


def lacks_slow_rotation(runs: Sequence[Telemetry], target: str) -> str:
    """For the dead zone: turns both ways, which pass through zero."""
    return "slow rotation through zero" if lacks_left_and_right_turns(runs, target) else ""


def _misalignment(axis: str) -> tuple[FormulaEffect, ...]:
    others = [name for name in "xyz" if name != axis]
    return with_parts(
        gyro_effect(
            "gyro_misalignment",
            id=f"gyro_misalignment_{axis}",
            targets=(f"gyro_{axis}",),
            coefficients=several([f"to_{name}" for name in others], "mrad", 0.01, 0.1),
            formula=misalignment,
            need=lacks_cross_turns,
            rivals=(
                "gyro_magnetic_sensitivity",
                "gyro_turn_on_bias",
                "site_latitude_error",
                "airframe_flexure",
                "axis_or_unit_error",
            ),
            source="IEEE Std 647-2006: input-axis misalignment",
        )
    )


# dithered gyros leave the dead zone; parked, what is left looks like a constant
RARE_LOG_PRIOR = -2.0


GYRO_RATE: tuple[Effect, ...] = (
    gyro_effect(
        "gyro_scale_factor",
        coefficients=one("ppm", 1.0, 50.0),
        formula=scale_factor,
        need=lacks_turns_or_earth_rate,
        rivals=(
            "clock_rate",
            "gyro_scale_asymmetry",
            "gyro_scale_thermal",
            "gyro_lock_in",
            "axis_or_unit_error",
        ),
        source="IEEE Std 647-2006: scale factor error",
    ),
    gyro_effect(
        "gyro_scale_asymmetry",
        coefficients=one("ppm", 1.0, 10.0),
        formula=scale_asymmetry,
        need=lacks_left_and_right_turns,
        rivals=("gyro_scale_factor", "gyro_saturation"),
        source="IEEE Std 647-2006: scale factor asymmetry",
    ),
    gyro_effect(
        "gyro_scale_thermal",
        coefficients=one("ppm per degC", 0.5, 5.0),
        formula=scale_thermal,
        need=lacks_turns_at_two_temperatures,
        rivals=("gyro_scale_factor",),
        source="IEEE Std 647-2006: scale factor temperature sensitivity",
    ),
    *(effect for axis in "xyz" for effect in _misalignment(axis)),
    *with_parts(
        gyro_effect(
            "gyro_g_sensitivity",
            coefficients=several(("f_x", "f_y", "f_z"), "deg/h per g", 3e-4, 3e-3),
            formula=g_sensitivity,
            need=lacks_force_changes,
            rivals=("gyro_turn_on_bias", "gyro_g2_sensitivity"),
            source="IEEE Std 952-1997: acceleration sensitivity",
        )
    ),
    gyro_effect(
        "gyro_g2_sensitivity",
        coefficients=one("deg/h per g^2", 3e-4, 3e-3),
        formula=g2_sensitivity,
        need=lacks_force_changes,
        rivals=(
            "gyro_bias_step",
            "gyro_dither_coning",
            "engine_start",
            "gyro_g_sensitivity",
            "coning_residual",
            "gyro_vibration_rectification",
        ),
        source="effects.md G17: vibration rectification, of the load factor only",
    ),
    gyro_effect(
        "gyro_magnetic_sensitivity",
        coefficients=several(("b_x", "b_y"), "deg/h per gauss", 1e-3, 0.05),
        formula=magnetic,
        need=lacks_headings,
        rivals=("gyro_misalignment", "site_latitude_error", "gyro_turn_on_bias"),
        source="IEEE Std 952-1997: magnetic sensitivity",
    ),
    gyro_effect(
        "gyro_lock_in",
        coefficients=(Coefficient("coefficient", "fraction left", 1e-5, 1e-3, signed=False),),
        shape=(ShapeParameter("threshold_deg_h", "deg/h", 50.0, 2000.0, 6),),
        formula=lock_in,
        need=lacks_slow_rotation,
        log_prior=RARE_LOG_PRIOR,
        rivals=("gyro_dither_coning", "gyro_scale_factor"),
        source="Aronowitz (1971)",
    ),
    gyro_effect(
        "gyro_dither_coning",
        coefficients=one("deg/h", 1e-3, 0.01),
        formula=constant,
        need=lacks_high_rate_log,
        rivals=("gyro_turn_on_bias", "gyro_g2_sensitivity", "gyro_lock_in", "coning_residual"),
        source="effects.md G20: the constant that dither coning leaves, th_x th_y w sin(phase) / 2",
    ),
)
