"""Effects of flight (effects.md 2c, F01 and F06 to F15): what vibration, height, load and way over
ground do to the sensors and to the receiver.

They need a flight with GNSS; on the ground they are a constant, or nothing.
"""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from ins.errors.base import (
    ACCELS,
    AXIS,
    GYROS,
    Coefficient,
    Shape,
    ShapeParameter,
    Words,
    error,
    on_accel,
    on_gyro,
    one,
    several,
)
from ins.errors.parts.formula import with_parts
from ins.errors.parts.recordings import flies, has_gnss, lacking, over, span
from ins.errors.prior import Prior
from ins.errors.telemetry import Telemetry, Trace
from ins.records import InputError
from ins.units import ARCSEC, DEG, DEG_PER_HOUR, MICRO_G, PPM, STANDARD_GRAVITY

# standard atmosphere (ISO 2533): pressure at sea level, lapse rate over temperature there, exponent
SEA_LEVEL_HPA, LAPSE_PER_M, EXPONENT = 1013.25, 0.0065 / 288.15, 5.2559
HUNDRED_KM = 1e5
# of vibration, beyond what the parked rows scatter; chosen: 0.01 g, a hundredth of what rectifies
# 10 ug at 0.1 ug/mg^2
SHAKES_M_S2 = 0.1
# of angular vibration, likewise; chosen: a tenth of what a hard mount swings by in flight
SWINGS_RAD_S = 0.05 * DEG
CLIMBS_M = 300.0  # 35 hPa: a hundredth of what 0.3 deg/h needs at the usual 0.0001 deg/h per hPa
# shares of a second's rows between which a normal law tells how far beyond the rest they go: a row
# in a thousand, and all but one in fifty
LEAST_CUT_OFF, MOST_CUT_OFF = 1e-3, 0.98
FAR_M = 2e4  # of way: a fifth of HUNDRED_KM


def vibration_g2(run: Telemetry) -> NDArray:
    """Variance of the rows within a second beyond that of the parked rows (n, 3) [g^2]."""
    if run.vibration_m2_s4 is None:
        raise InputError(f"run {run.run_index}: no rows within seconds, needed by this effect")
    return run.vibration_m2_s4 / STANDARD_GRAVITY**2


def pressure_change_hpa(run: Telemetry) -> NDArray:
    """Static pressure less that of the site (n,), by the standard atmosphere."""
    if run.above_m is None:
        raise InputError(f"run {run.run_index}: no heights, needed by this effect")

    def pressure(height_m: NDArray) -> NDArray:
        return np.asarray(SEA_LEVEL_HPA * (1.0 - LAPSE_PER_M * height_m) ** EXPONENT)

    return pressure(run.height_m + run.above_m) - pressure(np.asarray(run.height_m))


def accel_rectification(run: Telemetry, target: str, shape: Shape) -> tuple[Trace, ...]:
    """K2 <a^2>: the mean of the square that a second-order term makes of vibration."""
    return on_accel(target, MICRO_G * vibration_g2(run)[:, AXIS[target]])


def gyro_rectification(run: Telemetry, target: str, shape: Shape) -> tuple[Trace, ...]:
    """A rate that goes with the vibration of all axes together."""
    return on_gyro(target, DEG_PER_HOUR * vibration_g2(run).sum(axis=1))


def swing_deg2_s2(run: Telemetry) -> NDArray:
    """Variance of the rates within a second beyond that of the parked rows (n, 3) [(deg/s)^2]."""
    if run.swing_rad2_s2 is None:
        raise InputError(f"run {run.run_index}: no rows within seconds, needed by this effect")
    return run.swing_rad2_s2 / DEG**2


def coning(run: Telemetry, target: str, shape: Shape) -> tuple[Trace, ...]:
    """A share of the coning rate s_j s_k sin(phase) / (2 pi f) of the two other axes' swings s.

    1 (deg/s)^2 at 50 Hz is a cone of 0.2 deg/h, of which an algorithm leaves a part. Swings faster
    than half the rate of the log are seen weakened, which the coefficient then holds.
    """
    first, second = (axis for axis in range(3) if axis != AXIS[target])
    swing = swing_deg2_s2(run)
    return on_gyro(target, DEG_PER_HOUR * np.sqrt(swing[:, first] * swing[:, second]))


def gyro_pressure(run: Telemetry, target: str, shape: Shape) -> tuple[Trace, ...]:
    """1 deg/h per hPa of static pressure less that of the site."""
    return on_gyro(target, DEG_PER_HOUR * pressure_change_hpa(run))


def accel_pressure(run: Telemetry, target: str, shape: Shape) -> tuple[Trace, ...]:
    """1 ug per hPa of static pressure less that of the site."""
    return on_accel(target, MICRO_G * pressure_change_hpa(run))


def gyro_saturation(run: Telemetry, target: str, shape: Shape) -> tuple[Trace, ...]:
    """What rows at the end of the range lack: 1 deg/s of a manoeuvre that goes beyond it while all
    rows of a second stand there, and what swings about it lose."""
    share = _at_range(run)[:, AXIS[target]]
    swings = DEG * np.sqrt(swing_deg2_s2(run)[:, AXIS[target]])
    return on_gyro(target, -DEG * share, -swings * cut_off(share))


def accel_saturation(run: Telemetry, target: str, shape: Shape) -> tuple[Trace, ...]:
    """The same for an accelerometer: 1 g, and what vibration loses."""
    share = _at_range(run)[:, 3 + AXIS[target]]
    shakes = STANDARD_GRAVITY * np.sqrt(vibration_g2(run)[:, AXIS[target]])
    beyond = on_accel(target, -STANDARD_GRAVITY * share)
    return (*beyond, *on_accel(target, -shakes * cut_off(share)))


def cut_off(share: NDArray) -> NDArray:
    """Mean that normal rows of unit spread lose where a share of them (n,) is cut off at one end;
    with the share's sign.

    phi(a) - a p for the share p beyond a: 0.40 of a half, 0.002 of a hundredth.
    """
    from scipy.special import ndtri

    p = np.minimum(np.abs(share), MOST_CUT_OFF)
    a = -ndtri(np.maximum(p, LEAST_CUT_OFF))
    lost = np.exp(-0.5 * a**2) / np.sqrt(2.0 * np.pi) - a * p
    return np.asarray(np.where(p > 0.0, np.sign(share) * lost, 0.0))


def _at_range(run: Telemetry) -> NDArray:
    if run.at_range is None:
        raise InputError(f"run {run.run_index}: no rows of the sensors, needed by this effect")
    return run.at_range


def lacks_clipped_rows(runs: Sequence[Telemetry], target: str) -> str:
    """For saturation: rows at the end of the sensor's own range."""
    column = (*GYROS, *ACCELS).index(target)
    clipped = (run.at_range is not None and run.at_range[:, column].any() for run in runs)
    return lacking((any(clipped), "rows at the end of the sensor's range, in motion"))


def accel_asymmetry(run: Telemetry, target: str, shape: Shape) -> tuple[Trace, ...]:
    """k times the magnitude of f: the scale of one sense is k larger, of the other k smaller."""
    return on_accel(target, PPM * np.abs(run.force_m_s2[:, AXIS[target]]))


def clock_drift(run: Telemetry, target: str, shape: Shape) -> tuple[Trace, ...]:
    """The receiver's stamps run away from the unit's clock: -v d t, t since power-on."""
    late_s = PPM * run.time_s[:, None]
    return (
        Trace(
            gnss_position_m=-late_s * run.v_n_m_s,
            gnss_velocity_m_s=-late_s * run.rate_of(run.v_n_m_s),
        ),
    )


def slow_error(run: Telemetry, target: str, shape: Shape) -> tuple[Trace, ...]:
    """A fix that wanders with one period, north and east, sine and cosine; its velocity with it."""
    turn = 2.0 * np.pi / shape["period_s"]
    phase = turn * run.time_s
    out = []
    for axis in range(2):
        for way, rate in (
            (np.sin(phase), turn * np.cos(phase)),
            (np.cos(phase), -turn * np.sin(phase)),
        ):
            position, velocity = np.zeros((run.n, 3)), np.zeros((run.n, 3))
            position[:, axis], velocity[:, axis] = way, rate
            out.append(Trace(gnss_position_m=position, gnss_velocity_m_s=velocity))
    return tuple(out)


def deflection_gradient(run: Telemetry, target: str, shape: Shape) -> tuple[Trace, ...]:
    """The plumb line leans more the farther the vehicle is from its site: g tilt, north and
    east.
    """
    far = distance_m(run) / HUNDRED_KM
    out = []
    for axis in range(2):
        lean_n = np.zeros((run.n, 3))
        lean_n[:, axis] = STANDARD_GRAVITY * ARCSEC * far
        out.append(Trace(accel_m_s2=np.einsum("nij,ni->nj", run.C_nb, lean_n)))
    return tuple(out)


def distance_m(run: Telemetry) -> NDArray:
    """From where the run began, level (n,)."""
    step = np.diff(run.time_s, prepend=run.time_s[0])[:, None]
    return np.asarray(np.linalg.norm(np.cumsum(step * run.v_n_m_s[:, :2], axis=0), axis=1))


def flight_with_gnss(runs: Sequence[Telemetry], target: str) -> str:
    return lacking((flies(runs), "flight"), (has_gnss(runs), "GNSS"))


def _with(
    shows: Callable[[Telemetry], NDArray], least: float, words: str
) -> Callable[[Sequence[Telemetry], str], str]:
    """Needs a flight with GNSS, and that a quantity changes by so much in it."""

    def needs(runs: Sequence[Telemetry], target: str) -> str:
        if lacks := flight_with_gnss(runs, target):
            return lacks
        if any(not _has_all(run) for run in runs):
            return words
        return lacking((span(over(runs, shows)) > least, words))

    return needs


def _has_all(run: Telemetry) -> bool:
    """Rows within seconds, and heights."""
    logged = (run.vibration_m2_s4, run.swing_rad2_s2, run.above_m)
    return all(values is not None for values in logged)


def _shaking(run: Telemetry) -> NDArray:
    return np.sqrt(vibration_g2(run).sum(axis=1)) * STANDARD_GRAVITY


def _swinging(run: Telemetry) -> NDArray:
    return DEG * np.sqrt(swing_deg2_s2(run).sum(axis=1))


def _above(run: Telemetry) -> NDArray:
    return np.zeros(0) if run.above_m is None else run.above_m


needs_shaking = _with(_shaking, SHAKES_M_S2, "vibration that changes")
needs_swings = _with(_swinging, SWINGS_RAD_S, "angular vibration that changes")
needs_climb = _with(_above, CLIMBS_M, "a climb")
needs_way = _with(distance_m, FAR_M, "20 km of way")


# after which 1/e is left of what ionosphere, orbits and reflections add to positions
SKY_S = 200.0
FLIGHT_EFFECTS = (
    error(
        "F06",
        "accel_vibration_rectification",
        ACCELS,
        one("ug per g^2", 10.0, 1000.0),
        formula=accel_rectification,
        need=needs_shaking,
        rivals=("accel_pressure_sensitivity",),
        words=Words(
            what="A second-order term of the accelerometer turns vibration into a bias.",
            brought_on_by="Engines and turbulence: it changes with thrust and speed.",
            size="A vibration of 0.1 g makes 1 ug of 100 ug per g^2.",
            remedy="Mount the unit softer, or fit the coefficient from flights at two powers.",
        ),
    ),
    error(
        "F07",
        "gyro_vibration_rectification",
        GYROS,
        one("deg/h per g^2", 0.01, 1.0),
        formula=gyro_rectification,
        need=needs_shaking,
        rivals=("gyro_pressure_sensitivity", "coning_residual"),
        words=Words(
            what="Vibration of the mount makes a steady rate of the gyro.",
            brought_on_by="Engines and turbulence, beyond what the parked rows show.",
            size="A vibration of 0.1 g makes 0.001 deg/h of 0.1 deg/h per g^2.",
            remedy="Mount the unit softer, and log rows at 200 Hz or more.",
        ),
    ),
    error(
        "F01",
        "coning_residual",
        GYROS,
        one("deg/h per (deg/s)^2", 1e-3, 0.1),
        formula=coning,
        need=needs_swings,
        source="Bortz (1971): the cone that rotation vectors leave",
        words=Words(
            what="Rotation about an axis that itself moves is summed with an error by the "
            "algorithm.",
            brought_on_by="Angular vibration about two axes in flight, near the sampling rate.",
            size="1 deg/s about two axes at 50 Hz is a cone of 0.2 deg/h, of which a part is left.",
            remedy="Sample faster, or use increments with a coning correction.",
        ),
    ),
    error(
        "F08",
        "gyro_pressure_sensitivity",
        GYROS,
        one("deg/h per hPa", 1e-5, 1e-3),
        formula=gyro_pressure,
        need=needs_climb,
        words=Words(
            what="The gyro's bias follows the static pressure: its housing bends or its gas thins.",
            brought_on_by="Climbs and descents.",
            size="A climb to 3000 m is 310 hPa, 0.03 deg/h of 0.0001 deg/h per hPa.",
            remedy="Seal the housing, or fit the coefficient from a climb and a descent.",
        ),
    ),
    error(
        "F09",
        "accel_pressure_sensitivity",
        ACCELS,
        one("ug per hPa", 0.02, 1.0),
        formula=accel_pressure,
        need=needs_climb,
        words=Words(
            what="The accelerometer's bias follows the static pressure.",
            brought_on_by="Climbs and descents.",
            size="A climb to 3000 m makes 31 ug of 0.1 ug per hPa.",
            remedy="Seal the housing, or fit the coefficient from a climb and a descent.",
        ),
    ),
    error(
        "F10",
        "accel_scale_asymmetry",
        ("accel_x", "accel_y"),
        one("ppm", 10.0, 200.0),
        formula=accel_asymmetry,
        need=flight_with_gnss,
        rivals=("accel_saturation",),
        words=Words(
            what="The accelerometer's scale differs between the two senses of its axis.",
            brought_on_by="Thrust and braking, or turns to both sides.",
            size="At 0.2 g, 50 ppm make 10 ug.",
            remedy="Measure it in a chamber with the axis up and down.",
        ),
    ),
    error(
        "F11",
        "gnss_clock_drift",
        ("gnss",),
        one("ppm", 1.0, 100.0),
        formula=clock_drift,
        need=flight_with_gnss,
        rivals=("gnss_slow_error",),
        words=Words(
            what="The stamps of the fixes run away from the clock of the unit.",
            brought_on_by="Logging with two clocks that nothing disciplines; it shows at speed.",
            size="At 100 m/s, 10 ppm make 3.6 m after an hour.",
            remedy="Stamp both streams with one clock, or feed the receiver's pulse to the logger.",
        ),
    ),
    error(
        "F12",
        "gnss_slow_error",
        ("gnss",),
        several(("north_sin", "north_cos", "east_sin", "east_cos"), "m", 0.3, 5.0),
        shape=(ShapeParameter("period_s", "s", 200.0, 3000.0, 5),),
        repeats="E",
        formula=slow_error,
        priors=(
            Prior("flight", "m", 1.5, "position", SKY_S, "s", "one frequency: ionosphere, orbits"),
            Prior(
                "flight",
                "m/s",
                0.01,
                "velocity",
                60.0,
                "s",
                "reflections that drift with the sky; what a receiver smooths is in the sigma of"
                " a fix",
            ),
            Prior(
                "replay",
                "sigma of a fix",
                0.0,
                "position",
                SKY_S,
                "s",
                "level and time fitted from there",
            ),
            Prior(
                "replay",
                "sigma of a fix",
                0.0,
                "velocity",
                3.0,
                "s",
                "a receiver's own smoothing; level and time fitted from there, to 48 s",
            ),
        ),
        need=flight_with_gnss,
        words=Words(
            what="The fixes wander by metres over minutes: the ionosphere, reflections, orbits.",
            brought_on_by="Any receiver with one frequency; more near buildings and low "
            "satellites.",
            size="Some 0.3 to 5 m with periods of 3 to 50 min.",
            remedy="Use a receiver with two frequencies, or declare a larger sigma of its fixes.",
        ),
    ),
    error(
        "F14",
        "gyro_saturation",
        GYROS,
        (
            Coefficient("beyond", "deg/s", 1e-3, 10.0, signed=False),
            Coefficient("of_swings", "1", 0.3, 3.0, signed=False),
        ),
        formula=gyro_saturation,
        need=lacks_clipped_rows,
        words=Words(
            what="The gyro is turned faster than it can read: its rows stand at the end of its "
            "range.",
            brought_on_by="Quick turns, hard landings, strong angular vibration.",
            size="The angle that is lost is gone for good: 0.01 deg/s over 10 s is 1.7 mrad.",
            remedy="Use a range that holds the manoeuvre, or a mount that swings less.",
        ),
    ),
    error(
        "F15",
        "accel_saturation",
        ACCELS,
        (
            Coefficient("beyond", "g", 1e-4, 1.0, signed=False),
            Coefficient("of_vibration", "1", 0.3, 3.0, signed=False),
        ),
        formula=accel_saturation,
        need=lacks_clipped_rows,
        words=Words(
            what="The accelerometer is driven past its range: its rows stand at the end of it.",
            brought_on_by="Hard landings, gusts, strong vibration.",
            size="The speed that is lost is gone for good: 0.01 g over 1 s is 0.1 m/s.",
            remedy="Use a range that holds the manoeuvre, or a softer mount.",
        ),
    ),
    *with_parts(
        error(
            "F13",
            "vertical_deflection_gradient",
            ("site",),
            (
                Coefficient("north", "arcsec per 100 km", 2.0, 20.0),
                Coefficient("east", "arcsec per 100 km", 2.0, 20.0),
            ),
            formula=deflection_gradient,
            need=needs_way,
            words=Words(
                what="The plumb line leans more the farther the vehicle is from where it was "
                "aligned.",
                brought_on_by="Long legs over mountains or along a coast.",
                size="An arcsec of lean is 4.85 ug on a level accelerometer.",
                remedy="Take the deflection from a geoid model along the way.",
            ),
        )
    ),
    error(
        "F16",
        "gyro_in_flight",
        GYROS,
        source="A constant in flight, none at rest.",
        diagnosed=False,
        priors=(
            Prior(
                "flight",
                "deg/h",
                {"rlg": 0.0003, "fog": 0.0003, "mems": 3.0},
                source="a tenth of a gyro's default turn-on, for vibration and pressure",
            ),
        ),
        words=Words(
            what="The gyro reads otherwise in flight than at rest, by vibration and pressure.",
            brought_on_by="Engines and height, from the take-off on.",
            size="0.0003 deg/h is a tenth of a default turn-on.",
            remedy="Mount the unit softer; compare flights at two powers.",
        ),
    ),
    error(
        "F17",
        "accel_in_flight",
        ACCELS,
        source="A constant in flight, none at rest.",
        diagnosed=False,
        priors=(
            Prior(
                "flight",
                "ug",
                {"rlg": 5.0, "fog": 5.0, "mems": 500.0},
                source="quartz: some 30 ug per g^2 of vibration, 0.4 g in a cabin",
            ),
        ),
        words=Words(
            what="The accelerometer reads otherwise in flight than at rest, by vibration.",
            brought_on_by="Engines and rough air.",
            size="5 ug are a tilt of one arcsecond.",
            remedy="Mount the unit softer.",
        ),
    ),
)
