"""Effects of flight (effects.md 2c, F01 and F06 to F15): what vibration, height, load and way over
ground do to the sensors and to the receiver.

They need a flight with GNSS; on the ground they are a constant, or nothing.
"""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from ins.records import InputError
from ins.units import ARCSEC, DEG, DEG_PER_HOUR, MICRO_G, PPM, STANDARD_GRAVITY
from simreal.effects.accelerometer import on_accel
from simreal.effects.base import ACCELS, AXIS, GYROS, Coefficient, Shape, ShapeParameter
from simreal.effects.parts.formula import FormulaEffect, with_parts
from simreal.effects.parts.gyro_effect import gyro_effect, on_gyro, one, several
from simreal.effects.parts.recordings import flies, has_gnss, lacking, over, span
from simreal.effects.telemetry import Telemetry, Trace

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
    return on_accel(run, target, MICRO_G * vibration_g2(run)[:, AXIS[target]])


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
    return on_gyro(target, DEG_PER_HOUR * pressure_change_hpa(run))


def accel_pressure(run: Telemetry, target: str, shape: Shape) -> tuple[Trace, ...]:
    return on_accel(run, target, MICRO_G * pressure_change_hpa(run))


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
    beyond = on_accel(run, target, -STANDARD_GRAVITY * share)
    return (*beyond, *on_accel(run, target, -shakes * cut_off(share)))


def cut_off(share: NDArray) -> NDArray:
    """Mean that normal rows of unit spread lose where a share of them (n,) is cut off at one end;
    with the share's sign.

    phi(a) - a p for the share p beyond a: 0.40 of a half, 0.002 of a hundredth.
    """
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
    """k |f|: the scale of one sense is k larger, that of the other k smaller."""
    return on_accel(run, target, PPM * np.abs(run.force_m_s2[:, AXIS[target]]))


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

FLIGHT_EFFECTS = (
    FormulaEffect(
        "accel_vibration_rectification",
        "accel_vibration_rectification",
        ACCELS,
        one("ug per g^2", 10.0, 1000.0),
        rivals=("accel_g2_sensitivity", "accel_pressure_sensitivity"),
        source="effects.md F06",
        formula=accel_rectification,
        need=needs_shaking,
    ),
    gyro_effect(
        "gyro_vibration_rectification",
        coefficients=one("deg/h per g^2", 0.01, 1.0),
        rivals=("gyro_g2_sensitivity", "gyro_pressure_sensitivity", "coning_residual"),
        source="effects.md F07",
        formula=gyro_rectification,
        need=needs_shaking,
    ),
    gyro_effect(
        "coning_residual",
        coefficients=one("deg/h per (deg/s)^2", 1e-3, 0.1),
        rivals=("gyro_g2_sensitivity", "gyro_dither_coning", "gyro_vibration_rectification"),
        source="effects.md F01; Bortz (1971): the cone that rotation vectors leave",
        formula=coning,
        need=needs_swings,
    ),
    gyro_effect(
        "gyro_pressure_sensitivity",
        coefficients=one("deg/h per hPa", 1e-5, 1e-3),
        rivals=("gyro_vibration_rectification",),
        source="effects.md F08",
        formula=gyro_pressure,
        need=needs_climb,
    ),
    FormulaEffect(
        "accel_pressure_sensitivity",
        "accel_pressure_sensitivity",
        ACCELS,
        one("ug per hPa", 0.02, 1.0),
        rivals=("accel_vibration_rectification",),
        source="effects.md F09",
        formula=accel_pressure,
        need=needs_climb,
    ),
    FormulaEffect(
        "accel_scale_asymmetry",
        "accel_scale_asymmetry",
        ("accel_x", "accel_y"),  # what flies does not turn the force along z round
        one("ppm", 10.0, 200.0),
        rivals=("accel_scale_factor", "accel_g2_sensitivity", "accel_saturation"),
        source="effects.md F10",
        formula=accel_asymmetry,
        need=flight_with_gnss,
    ),
    FormulaEffect(
        "gnss_clock_drift",
        "gnss_clock_drift",
        ("gnss",),
        one("ppm", 1.0, 100.0),
        rivals=("gnss_lever_arm_or_latency", "gnss_slow_error"),
        source="effects.md F11",
        formula=clock_drift,
        need=flight_with_gnss,
    ),
    FormulaEffect(
        "gnss_slow_error",
        "gnss_slow_error",
        ("gnss",),
        several(("north_sin", "north_cos", "east_sin", "east_cos"), "m", 0.3, 5.0),
        (ShapeParameter("period_s", "s", 200.0, 3000.0, 5),),
        repeats="E",
        rivals=("gnss_lever_arm_or_latency", "gnss_clock_drift"),
        source="effects.md F12",
        formula=slow_error,
        need=flight_with_gnss,
    ),
    gyro_effect(
        "gyro_saturation",
        coefficients=(
            Coefficient("beyond", "deg/s", 1e-3, 10.0, signed=False),
            Coefficient("of_swings", "1", 0.3, 3.0, signed=False),
        ),
        rivals=("gyro_scale_asymmetry",),
        source="effects.md F14",
        formula=gyro_saturation,
        need=lacks_clipped_rows,
    ),
    FormulaEffect(
        "accel_saturation",
        "accel_saturation",
        ACCELS,
        (
            Coefficient("beyond", "g", 1e-4, 1.0, signed=False),
            Coefficient("of_vibration", "1", 0.3, 3.0, signed=False),
        ),
        rivals=("accel_scale_asymmetry",),
        source="effects.md F15",
        formula=accel_saturation,
        need=lacks_clipped_rows,
    ),
    *with_parts(
        FormulaEffect(
            "vertical_deflection_gradient",
            "vertical_deflection_gradient",
            ("site",),
            (
                Coefficient("north", "arcsec per 100 km", 2.0, 20.0),
                Coefficient("east", "arcsec per 100 km", 2.0, 20.0),
            ),
            rivals=("vertical_deflection",),
            source="effects.md F13",
            formula=deflection_gradient,
            need=needs_way,
        )
    ),
)
