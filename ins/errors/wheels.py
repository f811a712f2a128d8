"""Wheels on the ground: odometer, the no-slip point, stops that are none (effects.md 2c).

Odometer errors are read less true; lateral_m_s is the side velocity (body y) of the logged no-slip
point.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ins.errors.base import AddedNoise, Shape, Words, error, one, several
from ins.errors.parts.formula import with_parts
from ins.errors.parts.recordings import (
    MOVES_m_s,
    has_gnss,
    lacking,
    needs_turns,
    odometer_braking,
    odometer_taxi,
    taxi,
)
from ins.errors.platform import integral
from ins.errors.prior import Prior
from ins.errors.telemetry import AIRBORNE, Telemetry, Trace
from ins.records import VehicleNoise
from ins.units import MILLIRADIAN, PPM

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
    error(
        "O01",
        "odometer_scale",
        ("odometer",),
        one("ppm", 1000.0, 10000.0),
        formula=odometer_scale,
        priors=(Prior("session", "1", 0.05, source="worn or wrongly entered wheels"),),
        need=odometer_taxi,
        rivals=("wheel_slip", "clock_rate"),
        words=Words(
            what="The wheel's radius is not as entered, so speed is off by a fixed share.",
            brought_on_by="Tyre pressure, load, wear.",
            size="0.5 % of a kilometre are 5 m.",
            remedy="Correct `scale_ppm` in the twin.",
        ),
    ),
    error(
        "O02",
        "odometer_boresight",
        ("vehicle",),
        one("mrad", 1.7, 17.0),
        formula=boresight,
        priors=(Prior("session learning", "mrad", 10.0, source="assumed"),),
        need=taxi,
        rivals=("side_slip",),
        source="direction of rolling less heading",
        words=Words(
            what="The vehicle's direction of rolling is not body x of the unit.",
            brought_on_by="A unit mounted with a yaw angle; a vehicle that crabs.",
            size="1 mrad is 1 mm/s aside at 1 m/s, and looks like a heading error.",
            remedy="Correct `crab_mrad` in the twin from straight legs both ways.",
        ),
    ),
    *with_parts(
        error(
            "O03",
            "lever_arm",
            ("vehicle",),
            several("xy", "m", 0.1, 3.0),
            formula=lever_arm,
            priors=(
                Prior(
                    "session",
                    "m",
                    5.0,
                    part="x",
                    source="units sit anywhere along a fuselage, and logs leave the wheels' place"
                    " out",
                ),
                Prior(
                    "taxi",
                    "m",
                    1.0,
                    part="y",
                    source="units sit near the centre line; half a track of a wheel that is read",
                ),
            ),
            need=needs_turns,
            rivals=("side_slip", "odometer_time_offset", "gnss_lever_arm_or_latency"),
            source="true less logged",
            words=Words(
                what="The unit is not where the run says, so turns carry it aside or along.",
                brought_on_by="Turns, to the left and to the right.",
                size="1 m at 0.1 rad/s is 0.1 m/s.",
                remedy="Measure the lever arms anew and correct `run.json`.",
            ),
        ),
        "x",
    ),
    error(
        "O04",
        "side_slip",
        ("vehicle",),
        one("mrad per m/s2", 1.7, 17.0),
        formula=side_slip,
        priors=(Prior("taxi", "mrad per m/s2", 10.0, source="0.1 to 1 deg"),),
        need=needs_turns,
        words=Words(
            what="In a turn the tyres slip aside, in proportion to the lateral force.",
            brought_on_by="Turns at several speeds; at one speed it looks like a lever arm.",
            size="At 1 m/s^2 and 10 m/s, 10 mrad are 0.1 m/s aside.",
            remedy="Widen `lateral_noise_m_s` in the twin, or turn slower.",
        ),
    ),
    error(
        "O05",
        "wheel_slip",
        ("odometer",),
        one("% per m/s2", 0.1, 3.0),
        formula=wheel_slip,
        need=odometer_braking,
        rivals=("odometer_time_offset", "odometer_quantization"),
        words=Words(
            what="The wheel turns slower than the vehicle moves while braking, faster under drive.",
            brought_on_by="Braking, thrust through the wheels, wet ground.",
            size="It is proportional to the acceleration.",
            remedy="Use a wheel that is neither driven nor braked.",
        ),
    ),
    error(
        "O06",
        "odometer_time_offset",
        ("odometer",),
        one("ms", 10.0, 200.0),
        formula=time_offset,
        priors=(Prior("taxi", "s", 0.1, source="its usual size"),),
        need=odometer_braking,
        source="the odometer's delay",
        words=Words(
            what="The wheel's time stamps are early or late.",
            brought_on_by="Accelerating and braking.",
            size="100 ms at 1 m/s^2 are 0.1 m/s.",
            remedy="Shift the odometer's times, or take its stamps at the source.",
        ),
    ),
    error(
        "O07",
        "odometer_quantization",
        ("odometer",),
        one("cm/s", 1.0, 5.0, signed=False),
        repeats="S",
        noise_formula=quantization,
        need=odometer_taxi,
        source="one pulse counted over a second",
        words=Words(
            what="Speed is counted in pulses and read in steps.",
            brought_on_by="Slow rolling; below one pulse a sample the wheel seems to stand.",
            size="One step is a pulse's way over the sampling interval.",
            remedy="Log pulses with their times, or average over a second.",
        ),
    ),
    error(
        "O08",
        "false_standstill",
        ("vehicle",),
        one("cm/s", 1.0, 5.0),
        repeats="E",
        formula=creep,
        need=needs_stop_with_gnss,
        rivals=("gnss_lever_arm_or_latency",),
        words=Words(
            what="The vehicle creeps where it is taken to stand.",
            brought_on_by="Stops with a foot off the brake, tugs, slopes.",
            size="1 cm/s through a stop of a minute are 0.6 m.",
            remedy="Brake at stops; do not mark creeping as parked.",
        ),
    ),
    error(
        "O09",
        "cross_wind_crab",
        ("vehicle",),
        source="Crab by a wind that is steady over the ground.",
        diagnosed=False,
        priors=(Prior("taxi", "mrad", 20.0, source="0.1 to 1 deg of crab (O04)"),),
        words=Words(
            what="A steady wind from one side makes the vehicle roll at an angle to its axis.",
            brought_on_by="Taxi on several headings; on one it looks like a crab of the unit.",
            size="20 mrad of either component are 0.2 m/s aside at 10 m/s.",
            remedy="None: the taxi estimates it; turn, so that it parts from the heading.",
        ),
    ),
    error(
        "O10",
        "turning_crab",
        ("vehicle",),
        source="Crab that changes with the turns.",
        diagnosed=False,
        priors=(
            Prior(
                "taxi",
                "mrad",
                20.0,
                scale=0.5,
                scale_unit="rad",
                source="as a steady wind; its level is fitted from there",
            ),
        ),
        words=Words(
            what="The crab is another one after each turn.",
            brought_on_by="Turns of half a radian and more.",
            size="Its level is the data's own.",
            remedy="None: the taxi estimates it; straight legs between turns help.",
        ),
    ),
    error(
        "O11",
        "gust_crab",
        ("vehicle",),
        source="Crab that changes with time.",
        diagnosed=False,
        priors=(
            Prior(
                "taxi",
                "mrad",
                2.0,
                scale=10.0,
                scale_unit="s",
                source="turbulence of 10 to 20 % over 50 to 100 m at 5 to 10 m/s",
            ),
        ),
        words=Words(
            what="Gusts push the vehicle aside, a little to either side.",
            brought_on_by="Wind; each gust passes within seconds.",
            size="A tenth of what a steady wind does.",
            remedy="None: the taxi estimates it; taxi longer, so that gusts average.",
        ),
    ),
    error(
        "O12",
        "lateral_motion",
        ("vehicle",),
        source="Side velocity of the rolling wheels beyond crab and arm.",
        diagnosed=False,
        priors=(
            Prior(
                "session",
                "m/s",
                VehicleNoise().lateral_noise_m_s,
                scale=2.0,
                scale_unit="s",
                source="the twin's `vehicle.lateral_noise_m_s`; formats.md section 3",
            ),
        ),
        words=Words(
            what="The rolling vehicle weaves, and its tyres yield a little to either side.",
            brought_on_by="Rolling; it averages out within seconds.",
            size="20 mm/s are 2 mrad of crab at 10 m/s.",
            remedy="Declare `lateral_noise_m_s` in the twin.",
        ),
    ),
    error(
        "O13",
        "centre_line_wander",
        ("vehicle",),
        source="Way across a painted line beyond lateral motion.",
        diagnosed=False,
        priors=(
            Prior("taxi", "m/sqrt(s)", 0.01, walks=True, source="0.2 m in 5 min, as drivers steer"),
        ),
        words=Words(
            what="The driver does not stay on the surveyed centre line.",
            brought_on_by="Any taxi along a line.",
            size="0.2 m in 5 min are 0.07 mrad of heading at 10 m/s.",
            remedy="Survey the heading at rest as well.",
        ),
    ),
)
