"""Gyro errors of temperature and of the time since power-on (effects.md, G02 to G08, G11).

Temperatures count from T0 = 25 degC, so that a coefficient means the same in all runs; what a term
adds at T0 belongs to the turn-on bias. Temperatures are those of the gyro concerned.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ins.units import DEG_PER_HOUR
from simreal.effects.base import Coefficient, Effect, Shape, ShapeParameter
from simreal.effects.parts.formula import sharing_prior
from simreal.effects.parts.gyro_effect import gyro_effect, on_gyro, one, several
from simreal.effects.parts.gyro_needs import (
    gradient_degC,
    gyro_degC,
    gyro_degC_min,
    lacks_gradient,
    lacks_heating_and_cooling,
    lacks_temperature,
    lacks_temperature_rate,
)
from simreal.effects.parts.play import heating_sense
from simreal.effects.parts.thermal_memory import lagged
from simreal.effects.telemetry import Telemetry, Trace

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
QUADRATIC_RIVALS = (
    "gyro_thermal_linear",
    "gyro_warmup_transient",
    "compensation_misapplied",
    "temperature_sensor_error",
)
QUADRATIC = (
    gyro_effect(
        "gyro_thermal_quadratic",
        coefficients=SQUARE,
        formula=quadratic,
        need=lacks_temperature,
        rivals=QUADRATIC_RIVALS,
        source="IEEE Std 647-2006, drift rate terms of temperature",
    ),
    gyro_effect(
        "gyro_thermal_quadratic",
        id="gyro_thermal_parabola",
        coefficients=(*SQUARE, Coefficient("linear", "deg/h per degC", 5e-4, 3e-3)),
        formula=parabola,
        need=lacks_temperature,
        rivals=QUADRATIC_RIVALS,
        source="IEEE Std 647-2006, drift rate terms of temperature; effects.md G03: k3 beside k2",
    ),
)
GYRO_THERMAL: tuple[Effect, ...] = (
    gyro_effect(
        "gyro_thermal_linear",
        coefficients=one("deg/h per degC", 5e-4, 3e-3),
        formula=linear,
        need=lacks_temperature,
        rivals=(
            "gyro_warmup_transient",
            "gyro_thermal_rate",
            "gyro_thermal_quadratic",
            "compensation_misapplied",
        ),
        source="IEEE Std 647-2006, drift rate terms of temperature",
    ),
    *sharing_prior(*QUADRATIC),
    gyro_effect(
        "gyro_thermal_rate",
        coefficients=one("deg/h per degC/min", 0.01, 0.5),
        formula=rate,
        need=lacks_temperature_rate,
        rivals=(
            "gyro_thermal_gradient",
            "gyro_thermal_lag",
            "gyro_thermal_linear",
            "temperature_sensor_error",
            "platform_mount_sag",
        ),
        source="Shupe (1980), Applied Optics 19, 654",
    ),
    gyro_effect(
        "gyro_thermal_gradient",
        coefficients=one("deg/h per degC", 2e-3, 0.02),
        formula=gradient,
        need=lacks_gradient,
        rivals=("gyro_thermal_rate",),
        source="US 8,781,778: bias on T_block and T_diff",
    ),
    gyro_effect(
        "gyro_thermal_lag",
        coefficients=one("deg/h per degC", 5e-4, 0.01),
        shape=(ShapeParameter("tau_s", "s", 60.0, 1800.0, 8),),
        formula=lag,
        need=lacks_temperature_rate,
        rivals=("gyro_thermal_rate", "gyro_thermal_hysteresis", "temperature_sensor_error"),
        source="effects.md G06: coil slower than its sensor",
    ),
    gyro_effect(
        "gyro_thermal_hysteresis",
        coefficients=one("deg/h", 2e-3, 0.01),
        shape=(ShapeParameter("width_degC", "degC", 0.5, 10.0, 6),),
        formula=hysteresis,
        need=lacks_heating_and_cooling,
        rivals=("gyro_turn_on_bias", "gyro_thermal_lag"),
        source="simreal.effects.parts.play",
    ),
    gyro_effect(
        "gyro_warmup_transient",
        coefficients=one("deg/h", 5e-3, 0.05),
        shape=(ShapeParameter("tau_s", "s", 180.0, 1800.0, 8),),
        formula=warmup,
        rivals=(
            "gyro_thermal_linear",
            "gyro_thermal_quadratic",
            "gyro_rate_ramp",
            "platform_settling",
            "platform_yaw_creep",
        ),
        source="Wu and Gu (2002): turn-on section of a ring laser gyro's warm-up",
    ),
    gyro_effect(
        "gyro_mode_hop",
        coefficients=several(("sin", "cos"), "deg/h", 1e-3, 0.01),
        shape=(Period("period_degC", "degC", 3.0, 10.0, 16, "linear"),),
        formula=mode_hop,
        need=lacks_temperature,
        rivals=("gyro_rate_random_walk", "gyro_gauss_markov"),
        source="effects.md G11: etalon of a path length that grows with temperature",
    ),
)
