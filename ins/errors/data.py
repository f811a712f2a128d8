"""Errors of the recording itself: time stamps, clocks, axes and units, rounding (effects.md 2c,
D01, D02, D03, D06, D07).
"""

from collections.abc import Sequence

from ins.errors.base import (
    ACCELS,
    AXIS,
    GYROS,
    AddedNoise,
    ErrorSource,
    Shape,
    Words,
    error,
    one,
    several,
)
from ins.errors.parts.recordings import brakes, flies, lacking, needs_turns
from ins.errors.telemetry import Telemetry, Trace, on_axis
from ins.errors.wheels import MILLISECOND
from ins.units import PPM

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


class Jitter(ErrorSource):
    """Stamps that stand in the order of their rows: errors of a row's interval would swap them."""

    def most(self, row_dt_s: float) -> float:
        return row_dt_s / MILLISECOND


DATA_EFFECTS = (
    error(
        "D01",
        "timestamp_jitter",
        ("vehicle",),
        one("ms", 0.1, 10.0, signed=False),
        kind=Jitter,
        repeats="S",
        noise_formula=jitter,
        words=Words(
            what="Samples are stamped unevenly, doubled or lost.",
            brought_on_by="A busy logger; it shows while rates change.",
            size="1 ms at 1 rad/s are 1 mrad in one sample, given back in the next.",
            remedy="Stamp at the sensor; convert with the unit's own counter.",
        ),
    ),
    error(
        "D02",
        "clock_rate",
        ("vehicle",),
        one("ppm", 1.0, 50.0),
        formula=clock_rate,
        need=needs_turns,
        words=Words(
            what="The unit's clock runs fast or slow, so that all rates are off by one share.",
            brought_on_by="Turns and long navigation; an oscillator without temperature control.",
            size="50 ppm of Earth rate are 0.00075 deg/h.",
            remedy="Discipline the clock by GNSS time.",
        ),
    ),
    error(
        "D03",
        "gyro_accel_skew",
        ("vehicle",),
        one("ms", 1.0, 10.0),
        formula=skew_in_time,
        need=needs_manoeuvres,
        source="delay of the accelerometers",
        words=Words(
            what="Gyros and accelerometers are sampled at different instants.",
            brought_on_by="Manoeuvres in which attitude and force change together.",
            size="5 ms at 0.1 rad/s put 0.5 mrad of the force on the wrong axis.",
            remedy="Shift one stream by the difference when converting.",
        ),
    ),
    error(
        "D06",
        "axis_or_unit_error",
        GYROS + ACCELS,
        several("xyz", "1", 0.1, 2.0),
        formula=other_axes,
        log_prior=GROSS_LOG_PRIOR,
        words=Words(
            what="Axes are swapped, a sign is wrong, or a unit is not the one said.",
            brought_on_by="Conversion of a log, or a unit that was mounted otherwise.",
            size="Gross: Earth rate or gravity shows on the wrong axis.",
            remedy="Correct the column map, or run `recal check`.",
        ),
    ),
    error(
        "D07",
        "saturation_or_rounding",
        GYROS + ACCELS,
        one("LSB", 1.0, 10.0, signed=False),
        repeats="S",
        out_of_reach="the raw rows: stairs of rounding do not show in means over a second (clipped"
        " rows: gyro_saturation, accel_saturation)",
        source="float32, another least bit (rows at the end of the range: F14, F15)",
        words=Words(
            what="Values are clipped at the end of the range, or rounded to coarse steps.",
            brought_on_by="Shocks, high rates; a logger that stores few digits.",
            size="A clipped angle is lost for good; rounding makes stairs.",
            remedy="Choose the wider range; store 64-bit numbers.",
        ),
    ),
)
