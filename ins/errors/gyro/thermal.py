"""Gyro errors of temperature and of the time since power-on (effects.md, G02 to G08, G11).

Temperatures count from T0 = 25 degC, so that a coefficient means the same in all runs; what a term
adds at T0 belongs to the turn-on bias. Temperatures are those of the gyro concerned.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ins.errors.base import (
    GYROS,
    Coefficient,
    Shape,
    ShapeParameter,
    Words,
    error,
    on_gyro,
    one,
    several,
)
from ins.errors.parts.formula import sharing_prior
from ins.errors.parts.gyro_needs import (
    gradient_degC,
    gyro_degC,
    gyro_degC_min,
    lacks_gradient,
    lacks_heating_and_cooling,
    lacks_temperature,
    lacks_temperature_rate,
)
from ins.errors.parts.play import heating_sense
from ins.errors.parts.thermal_memory import lagged
from ins.errors.telemetry import Telemetry, Trace
from ins.units import DEG_PER_HOUR

REFERENCE_degC = 25.0


@dataclass(frozen=True)
class Period(ShapeParameter):
    """A period whose grid is even in frequency, as a periodogram's: the phase over a span grows
    evenly.
    """

    def grid(self, low: float | None = None, high: float | None = None) -> NDArray:
        a, b = self.low if low is None else low, self.high if high is None else high
        return 1.0 / np.linspace(1.0 / a, 1.0 / b, self.steps)


def above_reference(run: Telemetry, target: str) -> NDArray:
    """T - 25 degC of a gyro (n,)."""
    return gyro_degC(run, target) - REFERENCE_degC


def linear(run: Telemetry, target: str, shape: Shape) -> tuple[Trace, ...]:
    """1 deg/h per degC of T - T0."""
    return on_gyro(target, DEG_PER_HOUR * above_reference(run, target))


def quadratic(run: Telemetry, target: str, shape: Shape) -> tuple[Trace, ...]:
    """1 deg/h per degC^2 of (T - T0)^2."""
    return on_gyro(target, DEG_PER_HOUR * above_reference(run, target) ** 2)


def parabola(run: Telemetry, target: str, shape: Shape) -> tuple[Trace, ...]:
    """A parabola about a centre that is not known: 1 deg/h per degC^2 of (T - T0)^2, and 1 deg/h
    per degC of T - T0.

    A centre at Tc makes the second coefficient 2 (T0 - Tc) times the first.
    """
    above = above_reference(run, target)
    return on_gyro(target, DEG_PER_HOUR * above**2, DEG_PER_HOUR * above)


def rate(run: Telemetry, target: str, shape: Shape) -> tuple[Trace, ...]:
    """1 deg/h per degC/min of dT/dt (Shupe effect)."""
    return on_gyro(target, DEG_PER_HOUR * gyro_degC_min(run, target))


def gradient(run: Telemetry, target: str, shape: Shape) -> tuple[Trace, ...]:
    """1 deg/h per degC of the differential reading at the gyro."""
    return on_gyro(target, DEG_PER_HOUR * gradient_degC(run, target))


def lag(run: Telemetry, target: str, shape: Shape) -> tuple[Trace, ...]:
    """1 deg/h per degC of T_lag - T, T_lag behind a first-order lag `tau_s`; -tau dT/dt when tau is
    short.
    """
    T = gyro_degC(run, target)
    return on_gyro(target, DEG_PER_HOUR * (lagged(run.time_s, T, shape["tau_s"]) - T))


def hysteresis(run: Telemetry, target: str, shape: Shape) -> tuple[Trace, ...]:
    """Half of the split between the branches: +1 deg/h while heating, -1 while cooling, 0 at the
    start.
    """
    return on_gyro(
        target, DEG_PER_HOUR * heating_sense(gyro_degC(run, target), shape["width_degC"])
    )


def warmup(run: Telemetry, target: str, shape: Shape) -> tuple[Trace, ...]:
    """exp(-t / tau), t since power-on: 1 deg/h at power-on."""
    return on_gyro(target, DEG_PER_HOUR * np.exp(-run.time_s / shape["tau_s"]))


def mode_hop(run: Telemetry, target: str, shape: Shape) -> tuple[Trace, ...]:
    """Sine and cosine of 2 pi (T - T0) / P, 1 deg/h each."""
    angle = 2 * np.pi * above_reference(run, target) / shape["period_degC"]
    return on_gyro(target, DEG_PER_HOUR * np.sin(angle), DEG_PER_HOUR * np.cos(angle))


SQUARE = one("deg/h per degC^2", 1e-5, 1e-4)
QUADRATIC_WORDS = Words(
    what="The gyro's bias bends with temperature: its slope differs between cold and hot.",
    brought_on_by="A wide span of temperature; a narrow one shows its slope only.",
    size="Over 40 degC from the reference, 0.00005 deg/h per degC^2 makes 0.08 deg/h.",
    remedy="Recalibrate with runs that span the temperatures of use.",
)
QUADRATIC = (
    error(
        "G03",
        "gyro_thermal_quadratic",
        GYROS,
        SQUARE,
        formula=quadratic,
        need=lacks_temperature,
        rivals=(
            "gyro_thermal_linear",
            "gyro_warmup_transient",
            "compensation_misapplied",
            "temperature_sensor_error",
        ),
        source="IEEE Std 647-2006, drift rate terms of temperature",
        words=QUADRATIC_WORDS,
    ),
    error(
        "G03",
        "gyro_thermal_quadratic",
        GYROS,
        (*SQUARE, Coefficient("linear", "deg/h per degC", 5e-4, 3e-3)),
        id="gyro_thermal_parabola",
        formula=parabola,
        need=lacks_temperature,
        rivals=(
            "gyro_thermal_linear",
            "gyro_warmup_transient",
            "compensation_misapplied",
            "temperature_sensor_error",
        ),
        source="IEEE Std 647-2006, drift rate terms of temperature; k3 beside k2",
        words=QUADRATIC_WORDS,
    ),
)
GYRO_THERMAL = (
    error(
        "G02",
        "gyro_thermal_linear",
        GYROS,
        one("deg/h per degC", 5e-4, 3e-3),
        formula=linear,
        need=lacks_temperature,
        rivals=("gyro_warmup_transient", "gyro_thermal_rate", "compensation_misapplied"),
        source="IEEE Std 647-2006, drift rate terms of temperature",
        words=Words(
            what="The gyro's bias is proportional to its temperature, beyond what the table "
            "removes.",
            brought_on_by="Any change of temperature: a warm-up, a cold start, a hot apron.",
            size="Before the factory's compensation it is three to twenty times as large.",
            remedy="Recalibrate with `recal update`; record starts at two temperatures.",
        ),
    ),
    *sharing_prior(*QUADRATIC),
    error(
        "G04",
        "gyro_thermal_rate",
        GYROS,
        one("deg/h per degC/min", 0.01, 0.5),
        formula=rate,
        need=lacks_temperature_rate,
        rivals=(
            "gyro_thermal_gradient",
            "gyro_thermal_lag",
            "temperature_sensor_error",
            "platform_mount_sag",
        ),
        source="Shupe (1980), Applied Optics 19, 654",
        words=Words(
            what="The bias follows how fast the temperature changes; in a fibre coil, light that "
            "runs both ways meets a warming stretch at different times (Shupe).",
            brought_on_by="Ramps: the first half hour after power-on, or a climb into cold air.",
            size="A warm-up of 1 degC/min gives as many deg/h as the coefficient says.",
            remedy="Fit it from a ramp with `recal thermal fog`, and record a ramp up and one "
            "down.",
        ),
    ),
    error(
        "G05",
        "gyro_thermal_gradient",
        GYROS,
        one("deg/h per degC", 2e-3, 0.02),
        formula=gradient,
        need=lacks_gradient,
        source="US 8,781,778: bias on T_block and T_diff",
        words=Words(
            what="The bias follows a difference of temperature across the gyro, which bends the "
            "block or shifts the flow of gas in a ring laser.",
            brought_on_by="Uneven warming: power-on, a fan, sun on one side.",
            size="It needs the differential reading; without one it looks like a thermal rate.",
            remedy="Log the gradient sensor and fit it with `recal thermal rlg`.",
        ),
    ),
    error(
        "G06",
        "gyro_thermal_lag",
        GYROS,
        one("deg/h per degC", 5e-4, 0.01),
        shape=(ShapeParameter("tau_s", "s", 60.0, 1800.0, 8),),
        formula=lag,
        need=lacks_temperature_rate,
        rivals=("gyro_thermal_hysteresis", "temperature_sensor_error"),
        source="coil slower than its sensor",
        words=Words(
            what="The part that makes the bias is slower than the thermometer, so the table is "
            "entered with a temperature that the part does not have yet.",
            brought_on_by="Any ramp; on a plateau the lag is gone.",
            size="A short lag cannot be told from a thermal rate: both are slope times lag.",
            remedy="Record a fast and a slow ramp; then the two can be told apart.",
        ),
    ),
    error(
        "G07",
        "gyro_thermal_hysteresis",
        GYROS,
        one("deg/h", 2e-3, 0.01),
        shape=(ShapeParameter("width_degC", "degC", 0.5, 10.0, 6),),
        formula=hysteresis,
        need=lacks_heating_and_cooling,
        rivals=("gyro_turn_on_bias",),
        source="ins.errors.parts.play",
        words=Words(
            what="At one temperature the bias differs between warming and cooling, because parts "
            "that expanded do not return along the same way.",
            brought_on_by="A reversal: a cooling run, or a restart while still warm.",
            size="It is as large as the width of the loop between the two branches.",
            remedy="Record one cooling run; a table alone cannot hold it.",
        ),
    ),
    error(
        "G08",
        "gyro_warmup_transient",
        GYROS,
        one("deg/h", 5e-3, 0.05),
        shape=(ShapeParameter("tau_s", "s", 180.0, 1800.0, 8),),
        formula=warmup,
        rivals=("gyro_rate_ramp", "platform_settling", "platform_yaw_creep"),
        source="Wu and Gu (2002): turn-on section of a ring laser gyro's warm-up",
        words=Words(
            what="The bias settles after power-on while electronics and laser reach their state, "
            "whatever the temperature is.",
            brought_on_by="Each power-on, for a few times its time constant.",
            size="On a single cold start it is nearly the same curve as a linear slope.",
            remedy="Wait before aligning, or record a hot restart to tell it from temperature.",
        ),
    ),
    error(
        "G11",
        "gyro_mode_hop",
        GYROS,
        several(("sin", "cos"), "deg/h", 1e-3, 0.01),
        shape=(Period("period_degC", "degC", 3.0, 10.0, 16, "linear"),),
        formula=mode_hop,
        need=lacks_temperature,
        rivals=("gyro_rate_random_walk", "gyro_gauss_markov"),
        source="etalon of a path length that grows with temperature",
        words=Words(
            what="The bias waves with temperature, because reflections in the light path "
            "interfere.",
            brought_on_by="A wide span of temperature; it comes again at the same temperatures.",
            size="Its period is a few degC, shorter than the spacing of many tables.",
            remedy="Use a table with nodes closer than a quarter of the period.",
        ),
    ),
)
