"""Wheels on the ground: odometer, the no-slip point, stops that are none (effects.md 2c).

Odometer errors are read less true; lateral_m_s is the side velocity (body y) of the logged no-slip
point.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ins.units import MILLIRADIAN, PPM
from simreal.effects.base import AddedNoise, Shape
from simreal.effects.parts.formula import FormulaEffect, with_parts
from simreal.effects.parts.gyro_effect import one, several
from simreal.effects.parts.recordings import (
    MOVES_m_s,
    has_gnss,
    lacking,
    needs_turns,
    odometer_braking,
    odometer_taxi,
    taxi,
)
from simreal.effects.platform import integral
from simreal.effects.telemetry import AIRBORNE, Telemetry, Trace

MILLISECOND = 1e-3
CENTIMETRE_PER_S = 0.01
PERCENT = 0.01


def on_wheels(run: Telemetry) -> NDArray:
    """Where wheels can turn (n,)."""
    return run.kind != AIRBORNE


def odometer_scale(run: Telemetry, target: str, shape: Shape) -> tuple[Trace, ...]:
    """read = (1 + s) v: a wheel smaller than believed reads too much."""
    return (Trace(odometer_m_s=PPM * run.speed_m_s * on_wheels(run)),)


def boresight(run: Telemetry, target: str, shape: Shape) -> tuple[Trace, ...]:
    """v angle, with the direction of rolling less the heading of body x (the twin's crab with the
    other sign).
    """
    return (Trace(lateral_m_s=MILLIRADIAN * run.speed_m_s * run.rolling),)


def lever_arm(run: Telemetry, target: str, shape: Shape) -> tuple[Trace, ...]:
    """True place d of the point that does not slip, less the logged one: v_logged = v_true - w x d.

    The logged point then has the side velocity -w_z d_x, and the odometer, which reads at the true
    one, -w_z d_y more.
    """
    turn = run.turn_rad_s * run.rolling
    return Trace(lateral_m_s=-turn), Trace(odometer_m_s=-turn)


def side_slip(run: Telemetry, target: str, shape: Shape) -> tuple[Trace, ...]:
    """v c a_lat, with a_lat = v w_z: tyres that run at an angle in proportion to the side force.

    Turns at one speed show it just as a lever arm in x: only turns at two speeds tell the two
    apart.
    """
    return (Trace(lateral_m_s=MILLIRADIAN * run.speed_m_s**2 * run.turn_rad_s * run.rolling),)


def wheel_slip(run: Telemetry, target: str, shape: Shape) -> tuple[Trace, ...]:
    """v k a_x: a wheel under power turns faster, a braked one slower than it rolls."""
    return (Trace(odometer_m_s=PERCENT * run.speed_m_s * run.acceleration_m_s2 * on_wheels(run)),)


def time_offset(run: Telemetry, target: str, shape: Shape) -> tuple[Trace, ...]:
    """The odometer shows the speed of dt ago: -dt v'."""
    return (Trace(odometer_m_s=-MILLISECOND * run.acceleration_m_s2 * on_wheels(run)),)


def quantization(run: Telemetry, target: str, shape: Shape) -> tuple[AddedNoise, ...]:
    """Rounding of the speed to steps q while the wheels turn: variance q^2 / 12."""
    rolling = run.rolling.astype(float)
    return (AddedNoise("odometer", sample=CENTIMETRE_PER_S**2 / 12.0, profile=rolling),)


def stops(run: Telemetry) -> NDArray:
    """Parked after a drive (n,)."""
    return np.asarray(run.parked & np.maximum.accumulate(np.abs(run.speed_m_s) > MOVES_m_s))


def creep(run: Telemetry, target: str, shape: Shape) -> tuple[Trace, ...]:
    """The vehicle creeps along body x at the stops, which the twin takes for rest; GNSS sees it."""
    velocity = CENTIMETRE_PER_S * run.C_nb[:, :, 0] * stops(run)[:, None]
    return (Trace(gnss_velocity_m_s=velocity, gnss_position_m=integral(run, velocity)),)


def needs_stop_with_gnss(runs: Sequence[Telemetry], target: str) -> str:
    seen = [run for run in runs if run.has_gnss]
    return lacking(
        (has_gnss(runs), "GNSS"),
        (any(bool(np.any(stops(run))) for run in seen or runs), "a stop after taxi"),
    )


WHEELS = (
    FormulaEffect(
        "odometer_scale",
        "odometer_scale",
        ("odometer",),
        one("ppm", 1000.0, 10000.0),
        rivals=("wheel_slip", "clock_rate"),
        source="effects.md O01",
        formula=odometer_scale,
        need=odometer_taxi,
    ),
    FormulaEffect(
        "odometer_boresight",
        "odometer_boresight",
        ("vehicle",),
        one("mrad", 1.7, 17.0),
        rivals=("side_slip",),
        source="effects.md O02; direction of rolling less heading",
        formula=boresight,
        need=taxi,
    ),
    *with_parts(
        FormulaEffect(
            "lever_arm",
            "lever_arm",
            ("vehicle",),
            several("xy", "m", 0.1, 3.0),
            rivals=(
                "side_slip",
                "odometer_time_offset",
                "imu_size_effect",
                "gnss_lever_arm_or_latency",
            ),
            source="effects.md O03; true less logged",
            formula=lever_arm,
            need=needs_turns,
        ),
        "x",
    ),
    FormulaEffect(
        "side_slip",
        "side_slip",
        ("vehicle",),
        one("mrad per m/s2", 1.7, 17.0),
        rivals=("lever_arm", "odometer_boresight"),
        source="effects.md O04",
        formula=side_slip,
        need=needs_turns,
    ),
    FormulaEffect(
        "wheel_slip",
        "wheel_slip",
        ("odometer",),
        one("% per m/s2", 0.1, 3.0),
        rivals=("odometer_time_offset", "odometer_scale", "odometer_quantization"),
        source="effects.md O05",
        formula=wheel_slip,
        need=odometer_braking,
    ),
    FormulaEffect(
        "odometer_time_offset",
        "odometer_time_offset",
        ("odometer",),
        one("ms", 10.0, 200.0),
        rivals=("wheel_slip", "lever_arm"),
        source="effects.md O06; the odometer's delay",
        formula=time_offset,
        need=odometer_braking,
    ),
    FormulaEffect(
        "odometer_quantization",
        "odometer_quantization",
        ("odometer",),
        one("cm/s", 1.0, 5.0, signed=False),
        repeats="S",
        rivals=("wheel_slip",),
        source="effects.md O07; one pulse counted over a second",
        noise_formula=quantization,
        need=odometer_taxi,
    ),
    FormulaEffect(
        "false_standstill",
        "false_standstill",
        ("vehicle",),
        one("cm/s", 1.0, 5.0),
        repeats="E",
        rivals=("gnss_lever_arm_or_latency",),
        source="effects.md O08",
        formula=creep,
        need=needs_stop_with_gnss,
    ),
)
