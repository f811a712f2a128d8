"""Gyro errors of rotation, specific force and magnetic field (effects.md G12 to G20)."""

from collections.abc import Sequence

import numpy as np

from ins.errors.base import (
    AXIS,
    GYROS,
    Coefficient,
    ErrorSource,
    Shape,
    ShapeParameter,
    Words,
    error,
    on_gyro,
    one,
    several,
)
from ins.errors.gyro.events import constant
from ins.errors.gyro.thermal import above_reference
from ins.errors.parts.formula import with_parts
from ins.errors.parts.gyro_needs import (
    lacks_cross_turns,
    lacks_force_changes,
    lacks_headings,
    lacks_left_and_right_turns,
    lacks_turns_at_two_temperatures,
    lacks_turns_or_earth_rate,
)
from ins.errors.prior import Prior
from ins.errors.telemetry import Telemetry, Trace
from ins.units import DEG_PER_HOUR, MILLIRADIAN, PPM, STANDARD_GRAVITY

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
    """1 deg/h per g^2 of f^2 - 1 g^2: of the means over `dt_s`, so vibration within one is not in
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

    Read less true: -w where w is within +-L, else sign(w) sqrt(w^2 - L^2) - w, about -L^2 / (2 w)
    at high rates. Source: Aronowitz (1971), lock-in of a ring laser's counter-running waves.
    """
    w, L = run.rate_rad_s[:, AXIS[target]], shape["threshold_deg_h"] * DEG_PER_HOUR
    return on_gyro(target, np.sign(w) * np.sqrt(np.maximum(w**2 - L**2, 0.0)) - w)


def lacks_high_rate_log(runs: Sequence[Telemetry], target: str) -> str:
    """For effects of the dither itself."""
    return "" if runs and all(run.dt_s <= DITHER_LOG_S for run in runs) else "raw data at 500 Hz"


def lacks_slow_rotation(runs: Sequence[Telemetry], target: str) -> str:
    """For the dead zone: turns both ways, which pass through zero, or Earth rate on several starts,
    which is as slow.
    """
    turns = lacks_left_and_right_turns(runs, target)
    lacks = turns and lacks_turns_or_earth_rate(runs, target)
    return "slow rotation through zero" if lacks else ""


MISALIGNED = (
    Prior(
        "session flight replay",
        "mrad",
        {"rlg": 0.01, "fog": 0.02, "mems": 5.0},
        source="assumed beyond what the twin declares; formats.md section 3",
    ),
    Prior(
        "azimuths",
        "mrad",
        1.0,
        source="of a unit that nobody compensated, which is what the study is made for: 206 arcsec,"
        " a machined block",
    ),
)


def _misalignment(axis: str) -> tuple[ErrorSource, ...]:
    others = [name for name in "xyz" if name != axis]
    return with_parts(
        error(
            "G15",
            "gyro_misalignment",
            (f"gyro_{axis}",),
            several([f"to_{name}" for name in others], "mrad", 0.01, 0.1),
            id=f"gyro_misalignment_{axis}",
            formula=misalignment,
            priors=MISALIGNED,
            need=lacks_cross_turns,
            rivals=(
                "gyro_magnetic_sensitivity",
                "site_latitude_error",
                "airframe_flexure",
                "axis_or_unit_error",
            ),
            source="IEEE Std 647-2006: input-axis misalignment",
            words=Words(
                what="The sensitive axis leans to another axis, so the gyro reads a share of "
                "that rate.",
                brought_on_by="Turns; parked, each heading gives another share of Earth rate.",
                size="Parked, 0.1 mrad of the horizontal Earth rate is 0.001 deg/h.",
                remedy="Measure it from four headings with `recal misalignment`.",
            ),
        )
    )


# dithered gyros leave the dead zone; parked, what is left looks like a constant
RARE_LOG_PRIOR = -2.0


GYRO_RATE = (
    error(
        "G12",
        "gyro_scale_factor",
        GYROS,
        one("ppm", 1.0, 50.0),
        formula=scale_factor,
        priors=(
            Prior(
                "session flight replay",
                "ppm",
                {"rlg": 5.0, "fog": 50.0, "mems": 5000.0},
                source="assumed beyond what the twin declares; formats.md section 3",
            ),
        ),
        need=lacks_turns_or_earth_rate,
        rivals=(
            "clock_rate",
            "gyro_scale_asymmetry",
            "gyro_scale_thermal",
            "gyro_lock_in",
            "axis_or_unit_error",
        ),
        source="IEEE Std 647-2006: scale factor error",
        words=Words(
            what="The gyro reads a fixed share too much or too little of each rotation.",
            brought_on_by="Turns; parked, Earth rate makes almost nothing of it.",
            size="A turn of 90 degrees with 10 ppm is off by 3 arcsec.",
            remedy="Calibrate on a turntable, or from taxi turns against GNSS heading.",
        ),
    ),
    error(
        "G13",
        "gyro_scale_asymmetry",
        GYROS,
        one("ppm", 1.0, 10.0),
        formula=scale_asymmetry,
        need=lacks_left_and_right_turns,
        rivals=("gyro_saturation",),
        source="IEEE Std 647-2006: scale factor asymmetry",
        words=Words(
            what="The gyro reads a left turn otherwise than an equal right turn.",
            brought_on_by="Turns to both sides; to one side it looks like a scale factor.",
            size="It adds up over a flight with more turns to one side than to the other.",
            remedy="Record turns to both sides; calibrate each direction.",
        ),
    ),
    error(
        "G14",
        "gyro_scale_thermal",
        GYROS,
        one("ppm per degC", 0.5, 5.0),
        formula=scale_thermal,
        need=lacks_turns_at_two_temperatures,
        source="IEEE Std 647-2006: scale factor temperature sensitivity",
        words=Words(
            what="The scale factor changes with temperature.",
            brought_on_by="Turns at two temperatures at least.",
            size="Over 40 degC it is as large as a scale factor of 20 to 200 ppm.",
            remedy="Calibrate the scale factor hot and cold.",
        ),
    ),
    *(effect for axis in "xyz" for effect in _misalignment(axis)),
    *with_parts(
        error(
            "G16",
            "gyro_g_sensitivity",
            GYROS,
            several(("f_x", "f_y", "f_z"), "deg/h per g", 3e-4, 3e-3),
            formula=g_sensitivity,
            priors=(
                Prior(
                    "flight",
                    "deg/h per g",
                    {"rlg": 0.0, "fog": 0.001, "mems": 10.0},
                    source="its usual size; a ring laser has none",
                ),
                Prior(
                    "attitude",
                    "deg/h per g",
                    {"rlg": 0.0, "fog": 0.001, "mems": 100.0},
                    source="data sheets: ADIS16460 36, MPU-6050 360 deg/h per g",
                ),
            ),
            need=lacks_force_changes,
            rivals=("gyro_g2_sensitivity",),
            source="IEEE Std 952-1997: acceleration sensitivity",
            words=Words(
                what="Acceleration shifts the gyro's bias, by mass imbalance or bending of the "
                "suspension.",
                brought_on_by="Load factor in flight, tilting; parked and level it is a constant.",
                size="Parked it hides in the turn-on bias; in a 2 g turn it doubles.",
                remedy="Calibrate by tumbling; keep load factors low where it matters.",
            ),
        )
    ),
    error(
        "G17",
        "gyro_g2_sensitivity",
        GYROS,
        one("deg/h per g^2", 3e-4, 3e-3),
        formula=g2_sensitivity,
        need=lacks_force_changes,
        rivals=(
            "gyro_dither_coning",
            "engine_start",
            "coning_residual",
            "gyro_vibration_rectification",
        ),
        source="vibration rectification, of the load factor only",
        words=Words(
            what="Bias that grows with the square of acceleration; vibration is rectified by it.",
            brought_on_by="Engines, propellers, rough air.",
            size="Vibration of 1 g RMS gives what the coefficient says, with a mean of zero force.",
            remedy="Compare engine on and off; mount the unit on isolators.",
        ),
    ),
    error(
        "G18",
        "gyro_magnetic_sensitivity",
        GYROS,
        several(("b_x", "b_y"), "deg/h per gauss", 1e-3, 0.05),
        formula=magnetic,
        need=lacks_headings,
        rivals=("site_latitude_error",),
        source="IEEE Std 952-1997: magnetic sensitivity",
        words=Words(
            what="A magnetic field shifts the bias: light of a fibre coil turns its "
            "polarisation, the gas of a ring laser drifts.",
            brought_on_by="Change of heading in Earth's field, tow trucks, power carts.",
            size="Earth's horizontal field is about 0.2 gauss at middle latitudes.",
            remedy="Record four headings or more; keep vehicles and cables away while aligning.",
        ),
    ),
    error(
        "G19",
        "gyro_lock_in",
        GYROS,
        (Coefficient("coefficient", "fraction left", 1e-5, 1e-3, signed=False),),
        shape=(ShapeParameter("threshold_deg_h", "deg/h", 50.0, 2000.0, 6),),
        formula=lock_in,
        need=lacks_slow_rotation,
        log_prior=RARE_LOG_PRIOR,
        rivals=("gyro_dither_coning",),
        source="Aronowitz (1971)",
        words=Words(
            what="The two beams of a ring laser couple at low rates, so that small rates are "
            "lost; dither removes most of it.",
            brought_on_by="Slow rotation through zero rate, a dither that is too small.",
            size="The share that is left of a slow rate is what the coefficient says.",
            remedy="Check the dither's amplitude and its random part; a shop matter.",
        ),
    ),
    error(
        "G20",
        "gyro_dither_coning",
        GYROS,
        one("deg/h", 1e-3, 0.01),
        formula=constant,
        need=lacks_high_rate_log,
        rivals=("coning_residual",),
        source="the constant that dither coning leaves, th_x th_y w sin(phase) / 2",
        words=Words(
            what="Dithers of two axes couple through the block and make a coning motion, whose "
            "mean is a drift.",
            brought_on_by="Dither frequencies that lie close to one another.",
            size="Lines at the beats of the dithers go with it.",
            remedy="Log at 500 Hz or more to see the lines; move the dither frequencies apart.",
        ),
    ),
)
