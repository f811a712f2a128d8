"""Errors of the recording itself: time stamps, clocks, axes and units, rounding (effects.md 2c,
D01, D02, D03, D06, D07).
"""

from collections.abc import Sequence

from ins.units import PPM
from simreal.effects.base import ACCELS, AXIS, GYROS, AddedNoise, Shape
from simreal.effects.parts.formula import FormulaEffect, OutOfReach
from simreal.effects.parts.gyro_effect import one, several
from simreal.effects.parts.recordings import brakes, flies, lacking, needs_turns
from simreal.effects.telemetry import Telemetry, Trace, on_axis
from simreal.effects.wheels import MILLISECOND

# a swapped axis is thousands of nats, or is none: it must not rival a scale factor of 10 ppm
GROSS_LOG_PRIOR = -8.0


def jitter(run: Telemetry, target: str, shape: Shape) -> tuple[AddedNoise, ...]:
    """Stamps off by white delta: an interval gains delta_k - delta_(k-1), its mean rate changes by
    rate/dt times that.

    So each channel gets the difference of a bounded angle (velocity) of size rate (force) times
    delta.
    """
    out = []
    for channel in GYROS + ACCELS:
        square = (run.rate_rad_s if channel in GYROS else run.force_m_s2)[:, AXIS[channel]] ** 2
        largest = float(square.max(initial=0.0))
        if largest > 0.0:
            out.append(
                AddedNoise(channel, bounded=MILLISECOND**2 * largest, profile=square / largest)
            )
    return tuple(out)


def clock_rate(run: Telemetry, target: str, shape: Shape) -> tuple[Trace, ...]:
    """A clock that runs slow divides increments by too short a time: all rates and forces read high
    by the same part.
    """
    return (Trace(gyro_rad_s=PPM * run.rate_rad_s, accel_m_s2=PPM * run.force_m_s2),)


def skew_in_time(run: Telemetry, target: str, shape: Shape) -> tuple[Trace, ...]:
    """The accelerometers show the force of dt ago, the gyros are on time: -dt f' in body axes.

    For a force that is constant in space f' = -w x f, so that this is dt (w x f).
    """
    return (Trace(accel_m_s2=-MILLISECOND * run.rate_of(run.force_m_s2)),)


def other_axes(run: Telemetry, target: str, shape: Shape) -> tuple[Trace, ...]:
    """Parts of the body rate (or force) about x, y and z that the channel shows beside its own; -2
    of its own: a sign.
    """
    axis = AXIS[target]
    if target in GYROS:
        return tuple(Trace(gyro_rad_s=on_axis(run.rate_rad_s[:, j], axis)) for j in range(3))
    return tuple(Trace(accel_m_s2=on_axis(run.force_m_s2[:, j], axis)) for j in range(3))


def needs_manoeuvres(runs: Sequence[Telemetry], target: str) -> str:
    return lacking((brakes(runs) or flies(runs), "braking and acceleration, or flight"))


class Jitter(FormulaEffect):
    """Stamps that stand in the order of their rows: errors of a row's interval would swap them."""

    def most(self, row_dt_s: float) -> float:
        return row_dt_s / MILLISECOND


DATA_EFFECTS = (
    Jitter(
        "timestamp_jitter",
        "timestamp_jitter",
        ("vehicle",),
        one("ms", 0.1, 10.0, signed=False),
        repeats="S",
        rivals=("accel_noise", "gyro_quantization", "gyro_angle_random_walk"),
        source="effects.md D01",
        noise_formula=jitter,
    ),
    FormulaEffect(
        "clock_rate",
        "clock_rate",
        ("vehicle",),
        one("ppm", 1.0, 50.0),
        rivals=("gyro_scale_factor", "accel_scale_factor", "gyro_common_mode", "odometer_scale"),
        source="effects.md D02",
        formula=clock_rate,
        need=needs_turns,
    ),
    FormulaEffect(
        "gyro_accel_skew",
        "gyro_accel_skew",
        ("vehicle",),
        one("ms", 1.0, 10.0),
        rivals=("imu_size_effect", "sculling_residual"),
        source="effects.md D03; delay of the accelerometers",
        formula=skew_in_time,
        need=needs_manoeuvres,
    ),
    FormulaEffect(
        "axis_or_unit_error",
        "axis_or_unit_error",
        GYROS + ACCELS,
        several("xyz", "1", 0.1, 2.0),
        rivals=(
            "gyro_misalignment",
            "gyro_scale_factor",
            "accel_misalignment",
            "accel_scale_factor",
        ),
        source="effects.md D06",
        formula=other_axes,
        log_prior=GROSS_LOG_PRIOR,
    ),
    OutOfReach(
        "saturation_or_rounding",
        "saturation_or_rounding",
        GYROS + ACCELS,
        one("LSB", 1.0, 10.0, signed=False),
        repeats="S",
        rivals=("gyro_quantization", "gyro_angle_random_walk", "accel_noise"),
        source="effects.md D07",
        need="the raw rows: stairs of rounding do not show in means over a second (clipped rows:"
        " gyro_saturation, accel_saturation)",
    ),
)
