"""Errors of single accelerometers (effects.md 2b, A01 to A09): measured less true specific force,
along the sensor's axis.
"""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from ins.attitude import skew
from ins.errors.base import (
    ACCELS,
    AXIS,
    SLOW_NAME,
    AddedNoise,
    Coefficient,
    ErrorSource,
    Shape,
    ShapeParameter,
    Words,
    error,
    on_accel,
    one,
    several,
)
from ins.errors.gyro.noise import SLOW_WORDS
from ins.errors.parts.formula import with_parts
from ins.errors.parts.gyro_needs import TEMPERATURE_CHANGE_degC, swing
from ins.errors.parts.play import heating_sense
from ins.errors.parts.recordings import (
    brakes,
    flies,
    has_accel_temperatures,
    lacking,
    needs_turns,
    over,
    span,
    turns,
)
from ins.errors.prior import Prior
from ins.errors.telemetry import Telemetry, Trace
from ins.records import InputError
from ins.units import HOUR, MICRO_G, MILLIRADIAN, PPM, STANDARD_GRAVITY

REFERENCE_degC = 25.0
CHANGING_m_s2 = 0.5  # a specific force that changes less shows no scale factor or cross axis
CHANGING_g2 = 0.1  # of f^2; a taxi at 1 m/s^2 has 0.01
CENTIMETRE = 0.01


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
    return on_accel(target, MICRO_G * above, MICRO_G * above**2)


def warm_up(run: Telemetry, target: str, shape: Shape) -> tuple[Trace, ...]:
    """A exp(-t/tau), t since power-on."""
    return on_accel(target, MICRO_G * np.exp(-run.time_s / shape["tau_s"]))


def hysteresis(run: Telemetry, target: str, shape: Shape) -> tuple[Trace, ...]:
    """h times the heating sense: +h on the heating branch, -h on the cooling one; h is half of the
    split.
    """
    return on_accel(target, MICRO_G * heating_sense(accel_degC(run, target), shape["width_degC"]))


def scale_factor(run: Telemetry, target: str, shape: Shape) -> tuple[Trace, ...]:
    """k f, f along the sensor's own axis."""
    return on_accel(target, PPM * run.force_m_s2[:, AXIS[target]])


def second_order(run: Telemetry, target: str, shape: Shape) -> tuple[Trace, ...]:
    """K2 f^2, f in g."""
    return on_accel(target, MICRO_G * (run.force_m_s2[:, AXIS[target]] / STANDARD_GRAVITY) ** 2)


def cross_axes(target: str) -> tuple[int, int]:
    """The two other axes, in order."""
    first, second = (axis for axis in range(3) if axis != AXIS[target])
    return first, second


def misalignment(run: Telemetry, target: str, shape: Shape) -> tuple[Trace, ...]:
    """M_kj f_j of the two other axes."""
    return on_accel(target, *(MILLIRADIAN * run.force_m_s2[:, axis] for axis in cross_axes(target)))


def size_effect(run: Telemetry, target: str, shape: Shape) -> tuple[Trace, ...]:
    """Component of w' x r + w x (w x r) for r, the place of this accelerometer from the reference
    point of the unit.
    """
    rate, angular = run.rate_rad_s, run.rate_of(run.rate_rad_s)
    turning = skew(angular) + skew(rate) @ skew(rate)
    return on_accel(target, *(CENTIMETRE * turning[:, AXIS[target], axis] for axis in range(3)))


def white_noise(run: Telemetry, target: str, shape: Shape) -> tuple[AddedNoise, ...]:
    """1 ug/sqrt(Hz)."""
    return (AddedNoise(target, white=MICRO_G**2),)


def flicker_noise(run: Telemetry, target: str, shape: Shape) -> tuple[AddedNoise, ...]:
    """B = 1 ug: two-sided PSD B^2 / (2 pi f)."""
    return (AddedNoise(target, flicker=MICRO_G**2),)


def random_walk(run: Telemetry, target: str, shape: Shape) -> tuple[AddedNoise, ...]:
    """K = 1 ug/sqrt(h)."""
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


def _misalignment(axis: str) -> tuple[ErrorSource, ...]:
    others = [f"to_{name}" for name in "xyz" if name != axis]
    return with_parts(
        error(
            "A06",
            "accel_misalignment",
            (f"accel_{axis}",),
            several(others, "mrad", 0.05, 0.25),
            id=f"accel_misalignment_{axis}",
            formula=misalignment,
            need=needs_cross_force,
            rivals=("imu_size_effect", "accel_scale_factor", "axis_or_unit_error"),
            words=Words(
                what="The sensitive axis leans to another axis.",
                brought_on_by="Accelerations along the other axis.",
                size="Parked, 0.1 mrad of gravity are 100 ug, the same as a tilted installation.",
                remedy="Calibrate by tumbling, or align against the aircraft's own level.",
            ),
        )
    )


ACCELEROMETER = (
    *with_parts(
        error(
            "A01",
            "accel_thermal",
            ACCELS,
            (
                Coefficient("linear", "ug per degC", 0.5, 5.0),
                Coefficient("quadratic", "ug per degC^2", 0.005, 0.1),
            ),
            formula=thermal,
            priors=(
                Prior(
                    "flight replay",
                    "ug per degC",
                    {"rlg": 0.2, "fog": 0.2, "mems": 100.0},
                    part="linear",
                    source="what its compensation leaves, assumed",
                ),
            ),
            need=needs_warming,
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
            words=Words(
                what="The accelerometer's bias follows its temperature.",
                brought_on_by="Warm-up; a real tilt differs in that the gyros feel it.",
                size="4.85 ug tilt the level by one arcsecond; raw it is five to ten times as "
                "large.",
                remedy="Recalibrate the accelerometer over temperature.",
            ),
        ),
        "linear",
    ),
    error(
        "A02",
        "accel_warmup_transient",
        ACCELS,
        one("ug", 10.0, 100.0),
        shape=(ShapeParameter("tau_s", "s", 120.0, 3600.0, 8),),
        formula=warm_up,
        rivals=("platform_settling",),
        words=Words(
            what="The bias settles after power-on, as shell and inside of the sensor reach one "
            "temperature.",
            brought_on_by="Each power-on.",
            size="50 ug tilt the level by ten arcseconds.",
            remedy="Wait before aligning; a hot restart tells it from temperature.",
        ),
    ),
    error(
        "A03",
        "accel_thermal_hysteresis",
        ACCELS,
        one("ug", 10.0, 30.0),
        shape=(ShapeParameter("width_degC", "degC", 0.5, 10.0, 6),),
        formula=hysteresis,
        need=needs_turn_round,
        words=Words(
            what="At one temperature the bias differs between warming and cooling.",
            brought_on_by="A cooling run.",
            size="It is as large as the width of the loop.",
            remedy="Record a cooling run; use the mean of both branches in the table.",
        ),
    ),
    error(
        "A04",
        "accel_scale_factor",
        ACCELS,
        one("ppm", 50.0, 200.0),
        formula=scale_factor,
        priors=(
            Prior(
                "session flight replay",
                "ppm",
                {"rlg": 100.0, "fog": 100.0, "mems": 5000.0},
                source="repeats within 100 ppm, of MEMS within 0.5 %",
            ),
        ),
        need=needs_own_force,
        rivals=(
            "vertical_deflection",
            "clock_rate",
            "accel_g2_sensitivity",
            "axis_or_unit_error",
            "baro_lag",
            "accel_scale_asymmetry",
        ),
        words=Words(
            what="The accelerometer reads a fixed share too much or too little.",
            brought_on_by="Force: parked on the vertical axis, else when the vehicle accelerates.",
            size="100 ppm on the vertical axis are 100 ug.",
            remedy="Calibrate by tumbling; parked it cannot be told from the bias.",
        ),
    ),
    error(
        "A05",
        "accel_g2_sensitivity",
        ACCELS,
        one("ug per g^2", 5.0, 20.0),
        formula=second_order,
        need=needs_squares,
        rivals=(
            "engine_start",
            "sculling_residual",
            "accel_vibration_rectification",
            "accel_scale_asymmetry",
        ),
        words=Words(
            what="Bias that grows with the square of force; vibration is rectified by it.",
            brought_on_by="Engines and rough air.",
            size="Vibration of 1 g RMS gives what the coefficient says.",
            remedy="Compare engine on and off; use isolators.",
        ),
    ),
    *(effect for axis in "xyz" for effect in _misalignment(axis)),
    error(
        "A07",
        "imu_size_effect",
        ACCELS,
        several("xyz", "cm", 2.0, 6.0),
        formula=size_effect,
        need=needs_rotation,
        rivals=("lever_arm", "gnss_lever_arm_or_latency", "gyro_accel_skew"),
        words=Words(
            what="The three accelerometers sit some centimetres apart and feel different forces.",
            brought_on_by="Turns and angular acceleration.",
            size="5 cm at 0.1 rad/s are 50 ug.",
            remedy="Take the positions from the maker's drawing; correct forces when converting.",
        ),
    ),
    error(
        "A08",
        "accel_noise",
        ACCELS,
        one("ug/sqrt(Hz)", 5.0, 30.0, signed=False),
        repeats="S",
        noise_formula=white_noise,
        twin=("accel", "vrw_ug_sqrt_hz", 1.0),
        rivals=("platform_sway", "timestamp_jitter", "engine_start", "saturation_or_rounding"),
        source="white",
        words=Words(
            what="White noise of the accelerometer, more or less than the twin declares.",
            brought_on_by="Nothing; sway of the vehicle looks alike.",
            size="It limits the level reached in the first seconds.",
            remedy="Correct `vrw_ug_sqrt_hz` in the twin.",
        ),
    ),
    error(
        "A08",
        SLOW_NAME,
        ACCELS,
        (Coefficient("bias_instability", "ug", 1.0, 5.0, signed=False),),
        id="accel_bias_instability",
        repeats="S",
        noise_formula=flicker_noise,
        twin=("accel", "bias_instability_ug", 1.0),
        rivals=("accel_rate_random_walk",),
        source="flicker",
        words=SLOW_WORDS,
    ),
    error(
        "A08",
        SLOW_NAME,
        ACCELS,
        (Coefficient("rate_random_walk", "ug/sqrt(h)", 1.0, 10.0, signed=False),),
        id="accel_rate_random_walk",
        repeats="S",
        noise_formula=random_walk,
        twin=("accel", "rate_random_walk_ug_sqrt_h", 1.0),
        source="random walk",
        words=SLOW_WORDS,
    ),
    error(
        "A09",
        "sculling_residual",
        ACCELS,
        one("ug", 1.0, 50.0),
        out_of_reach="raw data at 500 Hz under vibration",
        rivals=("gyro_accel_skew",),
        source=r"$a\,\theta\cos(\gamma)/2$",
        words=Words(
            what="Rotation and acceleration that vibrate in step leave a mean force.",
            brought_on_by="Vibration with a line that gyros and accelerometers share.",
            size="It grows with the product of the two amplitudes.",
            remedy="Sample faster, or use increments with a sculling correction.",
        ),
    ),
)
