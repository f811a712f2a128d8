"""Errors of single accelerometers (effects.md 2b, A01 to A09): measured less true specific force,
along the sensor's axis.
"""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from ins.attitude import skew
from ins.records import InputError
from ins.units import HOUR, MICRO_G, MILLIRADIAN, PPM, STANDARD_GRAVITY
from simreal.effects.base import (
    ACCELS,
    AXIS,
    SLOW_NAME,
    AddedNoise,
    Coefficient,
    Shape,
    ShapeParameter,
)
from simreal.effects.parts.formula import FormulaEffect, OutOfReach, with_parts
from simreal.effects.parts.gyro_effect import one, several
from simreal.effects.parts.gyro_needs import TEMPERATURE_CHANGE_degC, swing
from simreal.effects.parts.play import heating_sense
from simreal.effects.parts.recordings import (
    brakes,
    flies,
    has_accel_temperatures,
    lacking,
    needs_turns,
    over,
    span,
    turns,
)
from simreal.effects.telemetry import Telemetry, Trace, on_axis

REFERENCE_degC = 25.0
CHANGING_m_s2 = 0.5  # a specific force that changes less shows no scale factor or cross axis
CHANGING_g2 = 0.1  # of f^2; a taxi at 1 m/s^2 has 0.01
CENTIMETRE = 0.01


def on_accel(run: Telemetry, target: str, *series: NDArray) -> tuple[Trace, ...]:
    """One trace for each series (n,) [m/s^2] on the target's accelerometer."""
    return tuple(Trace(accel_m_s2=on_axis(values, AXIS[target])) for values in series)


def accel_degC(run: Telemetry, target: str) -> NDArray:
    """Temperature of the target's accelerometer (n,); InputError where none is logged."""
    if run.accel_degC is None:
        raise InputError(
            f"run {run.run_index}: no accelerometer temperature, needed by this effect"
        )
    return run.accel_degC[:, AXIS[target]]


def thermal(run: Telemetry, target: str, shape: Shape) -> tuple[Trace, ...]:
    """k1 (T - 25 degC) and k2 (T - 25 degC)^2."""
    above = accel_degC(run, target) - REFERENCE_degC
    return on_accel(run, target, MICRO_G * above, MICRO_G * above**2)


def warm_up(run: Telemetry, target: str, shape: Shape) -> tuple[Trace, ...]:
    """A exp(-t/tau), t since power-on."""
    return on_accel(run, target, MICRO_G * np.exp(-run.time_s / shape["tau_s"]))


def hysteresis(run: Telemetry, target: str, shape: Shape) -> tuple[Trace, ...]:
    """h times the heating sense: +h on the heating branch, -h on the cooling one; h is half of the
    split.
    """
    return on_accel(
        run, target, MICRO_G * heating_sense(accel_degC(run, target), shape["width_degC"])
    )


def scale_factor(run: Telemetry, target: str, shape: Shape) -> tuple[Trace, ...]:
    """k f, f along the sensor's own axis."""
    return on_accel(run, target, PPM * run.force_m_s2[:, AXIS[target]])


def second_order(run: Telemetry, target: str, shape: Shape) -> tuple[Trace, ...]:
    """K2 f^2, f in g."""
    return on_accel(
        run, target, MICRO_G * (run.force_m_s2[:, AXIS[target]] / STANDARD_GRAVITY) ** 2
    )


def cross_axes(target: str) -> tuple[int, int]:
    """The two other axes, in order."""
    first, second = (axis for axis in range(3) if axis != AXIS[target])
    return first, second


def misalignment(run: Telemetry, target: str, shape: Shape) -> tuple[Trace, ...]:
    """M_kj f_j of the two other axes."""
    return on_accel(
        run, target, *(MILLIRADIAN * run.force_m_s2[:, axis] for axis in cross_axes(target))
    )


def size_effect(run: Telemetry, target: str, shape: Shape) -> tuple[Trace, ...]:
    """Component of w' x r + w x (w x r) for r, the place of this accelerometer from the reference
    point of the unit.
    """
    rate, angular = run.rate_rad_s, run.rate_of(run.rate_rad_s)
    turning = skew(angular) + skew(rate) @ skew(rate)
    return on_accel(
        run, target, *(CENTIMETRE * turning[:, AXIS[target], axis] for axis in range(3))
    )


def white_noise(run: Telemetry, target: str, shape: Shape) -> tuple[AddedNoise, ...]:
    return (AddedNoise(target, white=MICRO_G**2),)


def flicker_noise(run: Telemetry, target: str, shape: Shape) -> tuple[AddedNoise, ...]:
    return (AddedNoise(target, flicker=MICRO_G**2),)


def random_walk(run: Telemetry, target: str, shape: Shape) -> tuple[AddedNoise, ...]:
    return (AddedNoise(target, walk=MICRO_G**2 / HOUR),)


def needs_warming(runs: Sequence[Telemetry], target: str) -> str:
    if not has_accel_temperatures(runs):
        return "an accelerometer temperature"
    changes = span(over(runs, lambda run: accel_degC(run, target)))
    return lacking((changes > TEMPERATURE_CHANGE_degC, "an accelerometer temperature that changes"))


def needs_turn_round(runs: Sequence[Telemetry], target: str) -> str:
    if not has_accel_temperatures(runs):
        return "an accelerometer temperature"
    swings = np.array([swing(accel_degC(run, target)) for run in runs]).max(axis=0)
    return lacking(
        (
            bool(swings.min() > TEMPERATURE_CHANGE_degC),
            "temperature rising and falling (a run that cools)",
        )
    )


def needs_own_force(runs: Sequence[Telemetry], target: str) -> str:
    largest = np.max(np.abs(over(runs, lambda run: run.force_m_s2[:, AXIS[target]])), initial=0.0)
    return lacking((bool(largest > CHANGING_m_s2), "braking and acceleration, or flight"))


def needs_squares(runs: Sequence[Telemetry], target: str) -> str:
    squares = over(runs, lambda run: (run.force_m_s2[:, AXIS[target]] / STANDARD_GRAVITY) ** 2)
    return lacking((span(squares) > CHANGING_g2, "flight"))


def needs_cross_force(runs: Sequence[Telemetry], target: str) -> str:
    """A vertical accelerometer is seen while parked only, where cross forces are a constant."""
    if target == "accel_z":
        return lacking((flies(runs), "flight"))

    def force_along(axis: int) -> Callable[[Telemetry], NDArray]:
        return lambda run: run.force_m_s2[:, axis]

    changes = max(span(over(runs, force_along(axis))) for axis in cross_axes(target))
    return lacking(
        (
            changes > CHANGING_m_s2 and (brakes(runs) or flies(runs) or turns(runs)),
            "accelerations of the vehicle",
        )
    )


def needs_rotation(runs: Sequence[Telemetry], target: str) -> str:
    """Turns act on the level accelerometers; the vertical one needs roll or pitch rates."""
    return lacking((flies(runs), "flight")) if target == "accel_z" else needs_turns(runs, target)


def _misalignment(axis: str) -> tuple[FormulaEffect, ...]:
    others = [f"to_{name}" for name in "xyz" if name != axis]
    return with_parts(
        FormulaEffect(
            f"accel_misalignment_{axis}",
            "accel_misalignment",
            (f"accel_{axis}",),
            several(others, "mrad", 0.05, 0.25),
            rivals=("imu_size_effect", "accel_scale_factor", "axis_or_unit_error"),
            source="effects.md A06",
            formula=misalignment,
            need=needs_cross_force,
        )
    )


ACCELEROMETER = (
    *with_parts(
        FormulaEffect(
            "accel_thermal",
            "accel_thermal",
            ACCELS,
            (
                Coefficient("linear", "ug per degC", 0.5, 5.0),
                Coefficient("quadratic", "ug per degC^2", 0.005, 0.1),
            ),
            rivals=(
                "platform_settling",
                "platform_mount_sag",
                "accel_warmup_transient",
                "accel_thermal_hysteresis",
                "accel_bias_instability",
                "accel_rate_random_walk",
                "vertical_deflection",
                "schuler_start_error",
            ),
            source="effects.md A01",
            formula=thermal,
            need=needs_warming,
        ),
        "linear",
    ),
    FormulaEffect(
        "accel_warmup_transient",
        "accel_warmup_transient",
        ACCELS,
        one("ug", 10.0, 100.0),
        shape=(ShapeParameter("tau_s", "s", 120.0, 3600.0, 8),),
        rivals=("accel_thermal", "platform_settling"),
        source="effects.md A02",
        formula=warm_up,
    ),
    FormulaEffect(
        "accel_thermal_hysteresis",
        "accel_thermal_hysteresis",
        ACCELS,
        one("ug", 10.0, 30.0),
        shape=(ShapeParameter("width_degC", "degC", 0.5, 10.0, 6),),
        rivals=("accel_thermal",),
        source="effects.md A03",
        formula=hysteresis,
        need=needs_turn_round,
    ),
    FormulaEffect(
        "accel_scale_factor",
        "accel_scale_factor",
        ACCELS,
        one("ppm", 50.0, 200.0),
        rivals=(
            "vertical_deflection",
            "clock_rate",
            "accel_g2_sensitivity",
            "accel_misalignment",
            "axis_or_unit_error",
            "baro_lag",
            "accel_scale_asymmetry",
        ),
        source="effects.md A04",
        formula=scale_factor,
        need=needs_own_force,
    ),
    FormulaEffect(
        "accel_g2_sensitivity",
        "accel_g2_sensitivity",
        ACCELS,
        one("ug per g^2", 5.0, 20.0),
        rivals=(
            "accel_scale_factor",
            "engine_start",
            "sculling_residual",
            "accel_vibration_rectification",
            "accel_scale_asymmetry",
        ),
        source="effects.md A05",
        formula=second_order,
        need=needs_squares,
    ),
    *(effect for axis in "xyz" for effect in _misalignment(axis)),
    FormulaEffect(
        "imu_size_effect",
        "imu_size_effect",
        ACCELS,
        several("xyz", "cm", 2.0, 6.0),
        rivals=("lever_arm", "gnss_lever_arm_or_latency", "gyro_accel_skew", "accel_misalignment"),
        source="effects.md A07",
        formula=size_effect,
        need=needs_rotation,
    ),
    FormulaEffect(
        "accel_noise",
        "accel_noise",
        ACCELS,
        one("ug/sqrt(Hz)", 5.0, 30.0, signed=False),
        repeats="S",
        rivals=("platform_sway", "timestamp_jitter", "engine_start", "saturation_or_rounding"),
        source="effects.md A08, white",
        noise_formula=white_noise,
    ),
    FormulaEffect(
        "accel_bias_instability",
        SLOW_NAME,
        ACCELS,
        (Coefficient("bias_instability", "ug", 1.0, 5.0, signed=False),),
        repeats="S",
        rivals=("accel_rate_random_walk", "accel_thermal"),
        source="effects.md A08, flicker",
        noise_formula=flicker_noise,
    ),
    FormulaEffect(
        "accel_rate_random_walk",
        SLOW_NAME,
        ACCELS,
        (Coefficient("rate_random_walk", "ug/sqrt(h)", 1.0, 10.0, signed=False),),
        repeats="S",
        rivals=("accel_bias_instability", "accel_thermal"),
        source="effects.md A08, random walk",
        noise_formula=random_walk,
    ),
    OutOfReach(
        "sculling_residual",
        "sculling_residual",
        ACCELS,
        one("ug", 1.0, 50.0),
        rivals=("accel_g2_sensitivity", "gyro_accel_skew"),
        source="effects.md A09",
        need="raw data at 500 Hz under vibration",
    ),
)
