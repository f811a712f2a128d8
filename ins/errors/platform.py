"""Motions of the vehicle that the twin does not make, and errors of its site (effects.md 2b, P01 to
P08).

A small rotation q(t) of the body (body axes) is real: the gyros feel q' - q x omega, the
accelerometers -q x f. A vehicle that has yawed rolls along its own x axis afterwards: its way turns
with it, what the sensors feel of the way does not.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from math import log

import numpy as np
from numpy.typing import NDArray

from ins.earth import EARTH_RATE_RAD_S, gravity_magnitude, gravity_n, radii_of_curvature
from ins.errors.base import (
    ACCELS,
    GYROS,
    AddedNoise,
    Coefficient,
    Shape,
    ShapeParameter,
    Words,
    error,
    one,
    several,
)
from ins.errors.parts.formula import EachAlone, sharing_prior, with_parts
from ins.errors.parts.gyro_needs import TEMPERATURE_CHANGE_degC
from ins.errors.parts.recordings import lacking, over, span
from ins.errors.prior import Prior
from ins.errors.telemetry import Telemetry, Trace, on_axis
from ins.records import InputError, VehicleNoise
from ins.units import ARCSEC, DEG_PER_SQRT_HOUR, HOUR, MICRO_G

ARCMIN = 60.0 * ARCSEC
MILLIGAL = 1e-5  # [m/s^2]
REFERENCE_degC = 25.0
STEP_TAKES_s = 1.0  # a boarding or fuel step is no jump
ROTATIONAL_SWAY_s = 1.0  # correlation time of the angle in gusts
VEHICLE_TARGETS, SITE = ("vehicle",), ("site",)
LATITUDE_STEP_rad = 1e-4  # of the derivative of gravity
# cut to the run
ONSET = ShapeParameter("onset_s", "s", 0.0, 86400.0, 24, spread="linear", of_time=True)


def turned(run: Telemetry, angle_rad: NDArray, angle_rate_rad_s: NDArray, axis: int) -> Trace:
    """The trace of a rotation about one body axis, (n,) angle over the intervals and (n,) rate."""
    gyro, accel = (
        _less_turn(angle_rad, vector, axis) for vector in (run.rate_rad_s, run.force_m_s2)
    )
    gyro[:, axis] += angle_rate_rad_s
    return Trace(gyro_rad_s=gyro, accel_m_s2=accel)


def _less_turn(angle_rad: NDArray, vector: NDArray, axis: int) -> NDArray:
    """-q x v for q about one axis (n, 3)."""
    out = np.zeros_like(vector)
    j, k = (axis + 1) % 3, (axis + 2) % 3
    out[:, j], out[:, k] = angle_rad * vector[:, k], -angle_rad * vector[:, j]
    return out


def yawed(run: Telemetry, angle_rad: NDArray, angle_rate_rad_s: NDArray) -> Trace:
    """The trace of a heading that changes: of all that the gyros feel, of gravity, and of the way
    that GNSS sees.
    """
    gravity_b = in_body(run, -gravity_n(run.lat_rad, run.height_m))
    gyro = _less_turn(angle_rad, run.rate_rad_s, 2) + on_axis(angle_rate_rad_s, 2)
    v_n = angle_rad[:, None] * np.stack(
        [-run.v_n_m_s[:, 1], run.v_n_m_s[:, 0], np.zeros(run.n)], axis=1
    )
    return Trace(
        gyro_rad_s=gyro,
        accel_m_s2=_less_turn(angle_rad, gravity_b, 2),
        gnss_velocity_m_s=v_n,
        gnss_position_m=integral(run, v_n),
    )


def integral(run: Telemetry, rate: NDArray) -> NDArray:
    """Integral of a rate (n, ...) up to the middle of each interval."""
    return np.asarray((np.cumsum(rate, axis=0) - 0.5 * rate) * run.dt_s)


def turned_in_time(run: Telemetry, angle: Callable[[NDArray], NDArray], axis: int) -> Trace:
    """The same for an angle [rad] given as a function of time [s]: the gyro's increments add up to
    it exactly.
    """
    begin, end = angle(run.time_s - 0.5 * run.dt_s), angle(run.time_s + 0.5 * run.dt_s)
    mean, rate = 0.5 * (begin + end), (end - begin) / run.dt_s
    return yawed(run, mean, rate) if axis == 2 else turned(run, mean, rate, axis)


def after(run: Telemetry, onset_s: float) -> NDArray:
    """Fraction of each interval that lies after an instant (n,)."""
    return np.clip((run.time_s - onset_s) / run.dt_s + 0.5, 0.0, 1.0)


def in_body(run: Telemetry, vector_n: NDArray) -> NDArray:
    """A constant NED vector in body axes (n, 3)."""
    return np.asarray(np.einsum("nij,i->nj", run.C_nb, vector_n))


def sway(run: Telemetry, target: str, shape: Shape) -> tuple[AddedNoise, ...]:
    """The twin's own oscillator, stronger: each accelerometer's share of the level velocity, for 1
    m/s north and east.
    """
    C_nb = run.C_nb[int(np.argmax(run.parked))]
    share = C_nb[0] ** 2 + C_nb[1] ** 2
    return tuple(AddedNoise(channel, sway=float(part)) for channel, part in zip(ACCELS, share))


def sway_rotation(run: Telemetry, target: str, shape: Shape) -> tuple[AddedNoise, ...]:
    """Gusts that rock the vehicle: the gyros read the change of a bounded angle, the accelerometers
    g times the angle.

    Neglected: that the two agree (their coherence), and the shape of the spectrum within a second.
    """
    g = float(gravity_magnitude(run.lat_rad, run.height_m))
    gyros = tuple(AddedNoise(channel, bounded=ARCSEC**2) for channel in ("gyro_x", "gyro_y"))
    accels = tuple(
        AddedNoise(channel, white=(g * ARCSEC) ** 2 * ROTATIONAL_SWAY_s)
        for channel in ("accel_x", "accel_y")
    )
    return gyros + accels


def settling(run: Telemetry, target: str, shape: Shape, axis: int) -> Trace:
    """Roll or pitch A (1 - exp(-t/tau)), t since power-on."""
    tau_s = shape["tau_s"]
    return turned_in_time(run, lambda t: -ARCSEC * np.expm1(-t / tau_s), axis)


def settling_about(axis: int, run: Telemetry, target: str, shape: Shape, number: int) -> Trace:
    """The same about one axis alone."""
    return settling(run, target, shape, axis)


def step(run: Telemetry, target: str, shape: Shape, axis: int) -> Trace:
    """Roll, pitch or heading that changes once, within a second about the onset."""

    def angle(t: NDArray) -> NDArray:
        return ARCSEC * np.clip((t - shape["onset_s"]) / STEP_TAKES_s + 0.5, 0.0, 1.0)

    return turned_in_time(run, angle, axis)


def yaw_creep(run: Telemetry, target: str, shape: Shape) -> tuple[Trace, ...]:
    """Heading A (1 - exp(-t/tau)) of tyres or a tow bar that unwind, t since the first parked
    second.

    It creeps while the vehicle is parked only, and stays where it got to in between.
    """
    begin_s = run.time_s - 0.5 * run.dt_s
    t, tau_s = begin_s - begin_s[int(np.argmax(run.parked))], shape["tau_s"]
    moved = -np.exp(-t / tau_s) * np.expm1(-run.dt_s / tau_s)
    return (_creeping(run, moved / run.dt_s),)


def yaw_drift(run: Telemetry, target: str, shape: Shape) -> tuple[Trace, ...]:
    """Heading that creeps at a steady rate while the vehicle is parked."""
    return (_creeping(run, np.full(run.n, 1.0 / HOUR)),)


def _creeping(run: Telemetry, rate_arcsec_s: NDArray) -> Trace:
    """The trace of a heading that moves at this rate (n,) where the vehicle is parked."""
    rate = np.where(run.parked, ARCSEC * rate_arcsec_s, 0.0)
    return yawed(run, integral(run, rate), rate)


def mount_temperature(run: Telemetry) -> NDArray | None:
    """Temperature of the block, or the mean of the gyros' (n,) [degC]."""
    if run.block_degC is not None:
        return run.block_degC
    return None if run.temperature_degC is None else run.temperature_degC.mean(axis=1)


def mount_sag(run: Telemetry, target: str, shape: Shape) -> tuple[Trace, ...]:
    """Roll and pitch of the unit on its mount, in proportion to (T - 25 degC)."""
    temperature = mount_temperature(run)
    if temperature is None:
        raise InputError(
            f"run {run.run_index}: no gyro or block temperature, needed by platform_mount_sag"
        )
    angle = ARCSEC * (temperature - REFERENCE_degC)
    return tuple(turned(run, angle, run.rate_of(angle), axis) for axis in (0, 1))


def engine_step(run: Telemetry, target: str, shape: Shape) -> tuple[Trace, ...]:
    """Vibration rectification: a step of each accelerometer's bias from the onset on."""
    on = MICRO_G * after(run, shape["onset_s"])
    return tuple(Trace(accel_m_s2=on_axis(on, axis)) for axis in range(3))


def engine_noise(run: Telemetry, target: str, shape: Shape) -> tuple[AddedNoise, ...]:
    """White noise of all accelerometers from the onset on."""
    on = after(run, shape["onset_s"])
    return tuple(AddedNoise(channel, white=MICRO_G**2, profile=on) for channel in ACCELS)


def engine_gyro_noise(run: Telemetry, target: str, shape: Shape) -> tuple[AddedNoise, ...]:
    """White noise of all gyros from the onset on."""
    on = after(run, shape["onset_s"])
    return tuple(AddedNoise(channel, white=DEG_PER_SQRT_HOUR**2, profile=on) for channel in GYROS)


def vibration_noise(run: Telemetry, target: str, shape: Shape) -> tuple[AddedNoise, ...]:
    """White noise of all accelerometers from the first second to the last."""
    return tuple(AddedNoise(channel, white=MICRO_G**2) for channel in ACCELS)


def vibration_gyro_noise(run: Telemetry, target: str, shape: Shape) -> tuple[AddedNoise, ...]:
    """White noise of all gyros from the first second to the last."""
    return tuple(AddedNoise(channel, white=DEG_PER_SQRT_HOUR**2) for channel in GYROS)


def latitude_error(run: Telemetry, target: str, shape: Shape) -> tuple[Trace, ...]:
    """Entered less true latitude: Earth rate and gravity of the true place less those of the
    entered one, and GNSS.

    With the entered latitude north of the true one GNSS reads south of where the twin puts the
    vehicle.
    """
    L = run.lat_rad
    rate_n = ARCMIN * EARTH_RATE_RAD_S * np.array([np.sin(L), 0.0, np.cos(L)])  # -d omega_ie / dL
    slope = gravity_magnitude(L + LATITUDE_STEP_rad, run.height_m) - gravity_magnitude(
        L - LATITUDE_STEP_rad, run.height_m
    )
    # f = -g, less: +dg/dL
    force_n = ARCMIN * np.array([0.0, 0.0, float(slope) / (2 * LATITUDE_STEP_rad)])
    north_m = -ARCMIN * (float(radii_of_curvature(L)[0]) + run.height_m)
    position = on_axis(np.full(run.n, north_m), 0)
    return (
        Trace(
            gyro_rad_s=in_body(run, rate_n),
            accel_m_s2=in_body(run, force_n),
            gnss_position_m=position,
        ),
    )


def deflection(run: Telemetry, target: str, shape: Shape) -> tuple[Trace, ...]:
    """Gravity that pulls to the north and to the east of plumb, and stronger gravity: the specific
    force is the opposite.
    """
    g = float(gravity_magnitude(run.lat_rad, run.height_m))
    sizes = (g * ARCSEC, g * ARCSEC, MILLIGAL)
    return tuple(
        Trace(accel_m_s2=in_body(run, -size * np.eye(3)[axis])) for axis, size in enumerate(sizes)
    )


def needs_mount_temperature(runs: Sequence[Telemetry], target: str) -> str:
    known = [t for t in map(mount_temperature, runs) if t is not None]
    if not known or len(known) < len(runs):
        return "a gyro or block temperature"
    return lacking(
        (span(np.concatenate(known)) > TEMPERATURE_CHANGE_degC, "a temperature that changes")
    )


def needs_standstill(runs: Sequence[Telemetry], target: str) -> str:
    return lacking((bool(np.any(over(runs, lambda run: run.parked))), "parked time"))


# effects that turn the vehicle itself, by name
ROTATIONS = frozenset(
    {"platform_settling", "platform_step", "platform_yaw_creep", "platform_mount_sag"}
)
# noise of gyros that comes with vibration, by id: accelerometers feel it first, and what gyros
# alone read is their own
SHAKEN_GYROS = frozenset({"engine_start_gyro_noise", "platform_vibration_gyro_noise"})
YAW_WORDS = Words(
    what="The parked heading creeps as tyres and a tow bar unwind.",
    brought_on_by="A tight turn just before parking, a tow bar under load.",
    size="No accelerometer feels it: it cannot be told from the vertical gyro's drift.",
    remedy="Roll straight for some metres before parking; survey the heading.",
)
YAW_CREEP_EFFECTS = (
    error(
        "P04",
        "platform_yaw_creep",
        VEHICLE_TARGETS,
        one("arcsec", 5.0, 100.0),
        shape=(ShapeParameter("tau_s", "s", 300.0, 7200.0, 5),),
        repeats="E",
        formula=yaw_creep,
        need=needs_standstill,
        source="relaxing",
        words=YAW_WORDS,
    ),
    error(
        "P04",
        "platform_yaw_creep",
        VEHICLE_TARGETS,
        (Coefficient("drift", "arcsec/h", 5.0, 100.0),),
        id="platform_yaw_drift",
        repeats="E",
        formula=yaw_drift,
        priors=(
            Prior(
                "session learning",
                "arcsec/sqrt(h)",
                VehicleNoise().yaw_creep_arcsec_sqrt_h,
                walks=True,
                source="the twin's `vehicle.yaw_creep_arcsec_sqrt_h`",
            ),
        ),
        need=needs_standstill,
        source="steady",
        words=YAW_WORDS,
    ),
)
SETTLES_IN_ONE_RUN = error(
    "P02",
    "platform_settling",
    VEHICLE_TARGETS,
    several(("roll", "pitch"), "arcsec", 20.0, 200.0),
    shape=(ShapeParameter("tau_s", "s", 180.0, 3600.0, 10),),
    repeats="E",
    formula=EachAlone(settling, 2),
    need=needs_standstill,
    rivals=("platform_mount_sag",),
    words=Words(
        what="Struts, tyres or soft ground yield slowly, so that the vehicle turns a little.",
        brought_on_by="After taxi, after loading, on warm tarmac.",
        size="100 arcsec in 20 minutes are 0.08 deg/h, ten times a good gyro's drift.",
        remedy="Wait some minutes after stopping or loading.",
    ),
)
# struts that give way by as much after each arrival: accelerometers and gyros read one rotation in
# all runs, which no single run's settling reaches and two warm-ups describe apart
SETTLES_IN_EVERY_RUN = replace(
    SETTLES_IN_ONE_RUN,
    id="platform_settling_each_run",
    repeats="R",
    shape=(ShapeParameter("tau_s", "s", 180.0, 3600.0, 6),),
)
# or by as much as its load that day makes it
SETTLES_AS_LOADED = tuple(
    replace(
        SETTLES_IN_EVERY_RUN,
        id=f"platform_settling_by_run_{angle.name}",
        repeats="P",
        coefficients=(angle,),
        formula=EachAlone(partial(settling_about, axis), 1),
    )
    for axis, angle in enumerate(SETTLES_IN_ONE_RUN.coefficients)
)
SETTLING = (
    *with_parts(replace(SETTLES_IN_ONE_RUN, log_prior=-log(3.0))),
    *with_parts(replace(SETTLES_IN_EVERY_RUN, log_prior=-log(3.0))),
    *(replace(effect, log_prior=-log(6.0)) for effect in SETTLES_AS_LOADED),
)
SWAY_WORDS = Words(
    what="Wind moves and rocks the parked vehicle on its tyres and struts.",
    brought_on_by="Gusts, people on board, jets that pass.",
    size="10 mm/s or 100 arcsec are a windy apron.",
    remedy="Raise the twin's `sway_m_s`, or align longer or in the lee.",
)
ENGINE_WORDS = Words(
    what="Vibration of an engine raises the noise and shifts the accelerometers.",
    brought_on_by="Start of an engine or of the auxiliary power unit.",
    size="Noise and bias step at the same instant.",
    remedy="Align before the start, or cut the session there.",
)
VIBRATION_WORDS = Words(
    what="The vehicle shakes through the whole of one run.",
    brought_on_by="A machine that runs from before the run to its end.",
    size="As of an engine; there is no onset.",
    remedy="Stop the machine, or align elsewhere.",
)
PLATFORM = (
    error(
        "P01",
        "platform_sway",
        VEHICLE_TARGETS,
        one("m/s", 0.001, 0.02, signed=False),
        repeats="S",
        noise_formula=sway,
        twin=("vehicle", "sway_m_s", 1.0),
        source=" (a)",
        words=SWAY_WORDS,
    ),
    error(
        "P01",
        "platform_sway",
        VEHICLE_TARGETS,
        (Coefficient("rotation", "arcsec", 10.0, 200.0, signed=False),),
        id="platform_sway_rotation",
        repeats="S",
        noise_formula=sway_rotation,
        source=" (b)",
        words=SWAY_WORDS,
    ),
    *SETTLING,
    *with_parts(
        error(
            "P03",
            "platform_step",
            VEHICLE_TARGETS,
            several(("roll", "pitch", "heading"), "arcsec", 10.0, 300.0),
            shape=(ONSET,),
            repeats="E",
            formula=EachAlone(step, 3),
            rivals=("engine_start",),
            words=Words(
                what="The vehicle turns once within a second.",
                brought_on_by="Boarding, fuel, cargo, a door.",
                size="A person stepping in makes tens of arcseconds.",
                remedy="Keep off the vehicle while it aligns; such seconds are left out by `recal "
                "update`.",
            ),
        )
    ),
    *sharing_prior(*YAW_CREEP_EFFECTS),
    error(
        "P05",
        "platform_mount_sag",
        VEHICLE_TARGETS,
        several(("roll", "pitch"), "arcsec per degC", 0.2, 3.0),
        formula=mount_sag,
        need=needs_mount_temperature,
        words=Words(
            what="The mount of the unit bends with temperature.",
            brought_on_by="Warm-up of the tray and its shock mounts.",
            size="1 arcsec per degC over 30 degC is half a minute of arc.",
            remedy="Log the block's temperature; use a stiffer mount.",
        ),
    ),
    error(
        "P06",
        "engine_start",
        VEHICLE_TARGETS,
        several("xyz", "ug", 10.0, 200.0),
        shape=(ONSET,),
        repeats="E",
        formula=engine_step,
        source="bias",
        words=ENGINE_WORDS,
    ),
    error(
        "P06",
        "engine_start",
        VEHICLE_TARGETS,
        (Coefficient("noise", "ug/sqrt(Hz)", 10.0, 200.0, signed=False),),
        id="engine_start_noise",
        shape=(ONSET,),
        repeats="E",
        noise_formula=engine_noise,
        source="noise",
        words=ENGINE_WORDS,
    ),
    error(
        "P06",
        "engine_start",
        VEHICLE_TARGETS,
        (Coefficient("gyro_noise", "deg/sqrt(h)", 5e-4, 3e-3, signed=False),),
        id="engine_start_gyro_noise",
        shape=(ONSET,),
        repeats="E",
        noise_formula=engine_gyro_noise,
        source="noise",
        words=ENGINE_WORDS,
    ),
    error(
        "P09",
        "platform_vibration",
        VEHICLE_TARGETS,
        one("ug/sqrt(Hz)", 10.0, 200.0, signed=False),
        repeats="E",
        noise_formula=vibration_noise,
        rivals=("engine_start", "accel_noise", "platform_sway"),
        words=VIBRATION_WORDS,
    ),
    error(
        "P09",
        "platform_vibration",
        VEHICLE_TARGETS,
        (Coefficient("gyro_noise", "deg/sqrt(h)", 5e-4, 3e-3, signed=False),),
        id="platform_vibration_gyro_noise",
        repeats="E",
        noise_formula=vibration_gyro_noise,
        rivals=("gyro_angle_random_walk",),
        words=VIBRATION_WORDS,
    ),
    error(
        "P07",
        "site_latitude_error",
        SITE,
        one("arcmin", 0.2, 5.0),
        formula=latitude_error,
        source="entered less true",
        words=Words(
            what="The latitude that was entered is not the true one.",
            brought_on_by="Wrong entry, or the position of another stand.",
            size="One minute of arc is 0.003 deg/h of north rate, and 1.85 km.",
            remedy="Correct the site in `run.json`; compare with the first GNSS fix.",
        ),
    ),
    error(
        "P08",
        "vertical_deflection",
        SITE,
        (
            *several(("north", "east"), "arcsec", 5.0, 20.0),
            Coefficient("anomaly", "mGal", 10.0, 50.0),
        ),
        formula=deflection,
        priors=(
            Prior(
                "flight replay",
                "arcsec",
                5.0,
                scale=30_000.0,
                scale_unit="m",
                source="5 arcsec RMS over 20 to 50 km (physics.md 8.4), in mountains 30",
            ),
        ),
        rivals=("schuler_start_error", "vertical_deflection_gradient"),
        words=Words(
            what="Gravity is not along the normal of the ellipsoid, or not as strong as its "
            "formula.",
            brought_on_by="Mountains, dense rock; it belongs to the site.",
            size="10 arcsec tilt the level by 48 ug.",
            remedy="Take the deflection of a geoid model, or record at another site.",
        ),
    ),
)
