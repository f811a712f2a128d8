"""Frame, sign and unit trouble seen at rest: mean |f| against gravity, mean |w| against Earth rate.

Sensors do not tell a steady drive from rest: where fixes or wheels say that the vehicle moves, its
accelerometers are tested all the same, and its gyros are not.

At rest and level, axes forward-right-down, an accelerometer triad reads (0, 0, -g) and the gyros
read Earth rate, whose part along the vertical is -Omega sinL (CONVENTIONS.md). Each message names
the likely cause and the fix.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from ins.attitude import level_angles
from ins.earth import EARTH_RATE_RAD_S, gravity_magnitude
from ins.records import AXES, GnssLog, ImuSource, OdometerLog, Site
from ins.units import DEG, DEG_PER_HOUR, STANDARD_GRAVITY
from trajectories.runs.checks import Findings
from trajectories.runs.schema import MOST_ACCEPTED_SCALE

GATE_QUIET_S = 30.0  # length of the quiet stretch; chosen: 30 means of a second
QUIET_SEARCH_S = 600.0  # looked for in this much of the log: 20 such stretches
# of |f|: scatter of one-second means, 0.2 m/s^2; a sway of 0.02 m/s at 0.28 Hz (R1) makes 0.035,
# braking from 10 m/s in 10 s makes 1
QUIET_F = 0.02
# of gravity: consumer accelerometers are off by up to 60 mg
G_TOLERANCE = {"rlg": 0.02, "fog": 0.02, "mems": 0.1}
EXPECTED_F = 9.8  # [m/s^2] anywhere on Earth to 0.5 %
# How far |w| at rest may be from Earth rate [deg/h]: the raw bias that a working unit's table takes
# out, noise of 30 s.
W_TOLERANCE_DEG_H = {"rlg": 2.0, "fog": 5.0, "mems": 150.0}
# of a suspected unit factor in the Earth rate; chosen: those of W_UNITS are 3.6 apart or more, so
# that no two fit one rate
FACTOR_TOLERANCE = 0.3

F_UNITS = (
    (1 / STANDARD_GRAVITY, "g", "multiply by 9.80665"),
    (1e3 / STANDARD_GRAVITY, "mg", "multiply by 9.80665e-3"),
    (1e6 / STANDARD_GRAVITY, "ug", "multiply by 9.80665e-6"),
    (1e3, "mm/s2", "divide by 1000"),
    (1e2, "cm/s2", "divide by 100"),
    (1 / 0.3048, "ft/s2", "multiply by 0.3048"),
)
W_UNITS = (
    (1 / DEG, "deg/s", "multiply by pi/180 = 0.0174533"),
    (1 / DEG_PER_HOUR, "deg/h", "multiply by 4.84814e-06"),
    (3600.0, "rad/h", "divide by 3600"),
    (1000.0, "mrad/s", "divide by 1000"),
    (DEG, "rad/s scaled by pi/180 once too often", "multiply by 57.2958"),
    (1 / 3600.0, "rad/s divided by 3600 once too often", "multiply by 3600"),
)
# The body axes (x, y, z) from raw ones, by where gravity shows: key = (axis, sign of the mean
# specific force on it).
AXIS_MAPS = {
    ("x", 1): ("z", "y", "-x"),
    ("x", -1): ("-z", "y", "x"),
    ("y", 1): ("x", "z", "-y"),
    ("y", -1): ("x", "-z", "y"),
    ("z", 1): ("x", "-y", "-z"),
}
LIES = "; where the unit does stand so: --any-attitude (any_attitude in run.json)"
# the other usual set with z up
RIGHT_FORWARD_UP = ("y", "x", "-z")
# of a vehicle that moves: 5 sigmas of a receiver of 0.1 m/s
MOVING_M_S = 0.5


@dataclass(frozen=True, kw_only=True)
class CoSensors:
    """What is known of a log beside its sensors.

    gnss, odometer: which tell whether the vehicle moves. axes: body axes x, y, z as the raw axes of
    the log (a map's), which a proposal of other ones starts from. accepted_scale: what the
    accelerometers' scales may be off by, because run.json says so. units: by "gyro" and "accel" the
    unit that a map has, and the factor to rates in SI of each that it could have.
    """

    gnss: GnssLog | None = None
    odometer: OdometerLog | None = None
    axes: tuple[str, ...] = AXES
    accepted_scale: float = 0.0
    units: Mapping[str, tuple[str, Mapping[str, float]]] = field(default_factory=dict)
    any_attitude: bool = False

    def in_map(self, sensor: str, ratio: float, tolerance: float) -> str:
        """The unit that a map should have where what it reads is `ratio` times too large, in the
        map's words; empty without a map, or where no unit fits.
        """
        unit, factors = self.units.get(sensor, ("", {}))
        fits = [
            other
            for other, factor in factors.items()
            if other != unit and abs(factor * ratio / factors[unit] - 1.0) <= tolerance
        ]
        return f'{sensor}.unit = "{fits[0]}" in the map, not "{unit}"?' if fits else ""

    def may_lie(self, axis: str, technology: str) -> bool:
        """Whether a unit with this axis vertical, and not z down, may be meant to stand so: a MEMS
        unit on its side, with no fix or wheel that is navigated by vehicle axes; another, or upside
        down, only where run.json says so, for a wrong sign of the accelerometers looks the same.
        """
        alone = self.gnss is None and self.odometer is None
        return self.any_attitude or (alone and axis != "z" and technology == "mems")

    def speed_m_s(self, start_s: float, end_s: float) -> float | None:
        """Median speed of a stretch beyond the scatter of a receiver; None where none tells any."""
        found = []
        if self.gnss is not None:
            speed = np.linalg.norm(self.gnss.v_n_m_s, axis=1)
            found.append(speed[(self.gnss.time_s >= start_s) & (self.gnss.time_s <= end_s)])
        if self.odometer is not None:
            t = self.odometer.time_s
            found.append(np.abs(self.odometer.speed_m_s[(t >= start_s) & (t <= end_s)]))
        told = [float(np.median(v[np.isfinite(v)])) for v in found if np.isfinite(v).any()]
        moving = [v for v in told if v > MOVING_M_S]
        return max(moving) if moving else None


NOTHING_BESIDE = CoSensors()


@dataclass(frozen=True, kw_only=True)
class QuietMeans:
    """Mean specific force [m/s^2] and angular rate [rad/s], shape (3,), over the quiet stretch
    start_s to end_s; speed_m_s: of a vehicle that moves steadily there, None at rest.
    """

    start_s: float
    end_s: float
    f_m_s2: NDArray
    w_rad_s: NDArray
    speed_m_s: float | None = None

    @property
    def where(self) -> str:
        if self.speed_m_s is None:
            return "at rest"
        return f"in steady motion at {self.speed_m_s:.1f} m/s"


def quiet_means(source: ImuSource, beside: CoSensors = NOTHING_BESIDE) -> QuietMeans | None:
    """Means over the first stretch near the start of the log in which one-second means of f hold
    still, else None; a stretch at rest before one in steady motion.
    """
    steady = None
    for means in _quiet_stretches(source):
        speed = beside.speed_m_s(means.start_s, means.end_s)
        if speed is None:
            return means
        steady = steady or replace(means, speed_m_s=speed)
    return steady


def _quiet_stretches(source: ImuSource) -> Iterator[QuietMeans]:
    """Means over each such stretch, in order of time."""
    start, last = source.start_s, source.end_s
    imu = source.between(-np.inf, start + QUIET_SEARCH_S + GATE_QUIET_S)
    while start < min(source.start_s + QUIET_SEARCH_S, last):
        part = slice(*np.searchsorted(imu.time_s, [start, start + GATE_QUIET_S]))
        start += GATE_QUIET_S
        time_s, dt_s = imu.time_s[part], imu.dt_s[part]
        if time_s.size < 2 or time_s[-1] - time_s[0] < min(
            GATE_QUIET_S / 2, (last - source.start_s) / 2
        ):
            continue
        second = np.searchsorted(time_s, np.arange(time_s[0], time_s[-1], 1.0))
        f = np.add.reduceat(imu.dv_m_s[part], second) / np.add.reduceat(dt_s, second)[:, None]
        f_mean = imu.dv_m_s[part].sum(axis=0) / dt_s.sum()
        if np.sqrt(np.mean(np.sum((f - f_mean) ** 2, axis=1))) <= QUIET_F * np.linalg.norm(f_mean):
            yield QuietMeans(
                start_s=float(time_s[0]),
                end_s=float(time_s[-1]),
                f_m_s2=f_mean,
                w_rad_s=imu.dtheta_rad[part].sum(axis=0) / dt_s.sum(),
            )


def check_physics(
    imu: ImuSource,
    *,
    site: Site,
    technology: str,
    label: str,
    findings: Findings,
    beside: CoSensors = NOTHING_BESIDE,
) -> QuietMeans | None:
    """Adds what the quiet start says about units, signs and axes; returns the means it used."""
    means = quiet_means(imu, beside)
    if means is None:
        findings.warn(
            f"{label}: no {GATE_QUIET_S:g} s at rest in the first {QUIET_SEARCH_S:g} s: units and"
            " axes not tested"
        )
        return None
    off = _force_size(means, imu, technology, beside)
    accepted = off and abs(_size_off(means)) <= beside.accepted_scale
    if accepted:
        findings.warn(f"{label}: {_accepted_size(means, beside.accepted_scale)}")
    f_wrong = "" if accepted else off
    # a force of a wrong size, such as none at all, says nothing of axes
    axis_off = "" if f_wrong else _force_axis(means, site, technology, beside.axes)
    lies = bool(axis_off) and beside.may_lie(_vertical(means)[0], technology)
    if lies:
        otherwise = "" if beside.any_attitude else f"; if it does not: {axis_off}"
        findings.warn(f"{label}: {_lying(means)}{otherwise}")
    elif axis_off:
        f_wrong = axis_off + LIES
    if f_wrong:
        findings.error(f"{label}: {f_wrong}")
    elif means.speed_m_s is None:
        level, text = "warning", ""
        if technology != "mems":
            level, text = _earth_rate(means, site, imu, beside)
        text = text or _rate_size(means, technology)
        findings.add(level, *([f"{label}: {text}"] if text else []))
    return means


def _size_off(means: QuietMeans) -> float:
    """By how much of gravity the mean specific force is off it."""
    return float(np.linalg.norm(means.f_m_s2)) / EXPECTED_F - 1.0


def _accepted_size(means: QuietMeans, scale: float) -> str:
    size = float(np.linalg.norm(means.f_m_s2))
    return (
        f"mean |f| {means.where} is {size:.4g} m/s2 ({100 * _size_off(means):+.0f} % of gravity):"
        f" accepted by accepted_accelerometer_scale {scale:g}, which is the sigma of the"
        " accelerometers' scales from here on"
    )


def _force_size(means: QuietMeans, imu: ImuSource, technology: str, beside: CoSensors) -> str:
    size, tolerance = float(np.linalg.norm(means.f_m_s2)), G_TOLERANCE[technology]
    if abs(_size_off(means)) <= tolerance:
        return ""
    seen = f"mean |f| {means.where} is {size:.4g} m/s2, needed 9.8"
    if by_map := beside.in_map("accel", size / EXPECTED_F, tolerance):
        return f"{seen}: {by_map}"
    causes = [(imu.rate_hz, "m/s2 in columns of increments", "name them accel_x_m_s2 ...")]
    if imu.source == "rates":
        causes = [
            (1 / imu.rate_hz, "velocity increments in columns of rates", "name them dv_x_m_s ...")
        ]
    fits = [
        f"{unit}? {fix}"
        for factor, unit, fix in (*causes, *F_UNITS)
        if abs(size / (EXPECTED_F * factor) - 1) <= tolerance
    ]
    if fits:
        return f"{seen}: {'; or '.join(fits)}"
    hint = "gravity removed from the log?" if size < 0.5 else "unit or scale of the accelerometers?"
    if technology == "mems" and abs(_size_off(means)) <= MOST_ACCEPTED_SCALE:
        share = np.ceil(100 * abs(_size_off(means))) / 100
        hint += (
            f" Where they do read so, accept it: --accepted-accelerometer-scale {share:g}"
            f" (accepted_accelerometer_scale {share:g} in run.json)"
        )
    return f"{seen} within {100 * tolerance:g} %: {hint}"


def _in_raw(axes: tuple[str, ...], raw: tuple[str, ...]) -> str:
    """Body axes, given by those that the log is read with, by its raw ones: 'x = "-y", ...'."""
    told = []
    for body, axis in zip(AXES, axes):
        of = raw[AXES.index(axis[-1])]
        turned = axis.startswith("-") != of.startswith("-")
        told.append(f'{body} = "{"-" if turned else ""}{of[-1]}"')
    return ", ".join(told)


def _vertical(means: QuietMeans) -> tuple[str, int]:
    """The axis nearest to the vertical, and the sign of the specific force on it."""
    k = int(np.argmax(np.abs(means.f_m_s2)))
    return AXES[k], int(np.sign(means.f_m_s2[k]))


def _lying(means: QuietMeans) -> str:
    axis, sign = _vertical(means)
    roll, pitch = np.degrees(level_angles(means.f_m_s2))
    return (
        f"the unit stands with {axis} {'up' if sign > 0 else 'down'}, roll {roll:.0f}, pitch"
        f" {pitch:.0f} deg by gravity: biases are those of its own axes, and the accelerometers'"
        " sign is taken as right"
    )


def _force_axis(means: QuietMeans, site: Site, technology: str, raw: tuple[str, ...]) -> str:
    axis, sign = _vertical(means)
    if (axis, sign) == ("z", -1):
        return ""
    k = AXES.index(axis)
    seen = (
        f"mean f {means.where} is {means.f_m_s2[k]:+.3f} m/s2 on {axis}, needed about -9.8 on z"
        " (z must point down)"
    )
    fix = f"axes {_in_raw(AXIS_MAPS[axis, sign], raw)} would put it there"
    if (axis, sign) != ("z", 1):
        return f"{seen}: {fix}, up to a turn about the vertical"
    other = _in_raw(RIGHT_FORWARD_UP, raw)
    fix += f" if x points forward and y left, {other} if x points right and y forward"
    upward = float(means.w_rad_s[2] / (EARTH_RATE_RAD_S * np.sin(site.lat_rad) or np.inf))
    stands = technology != "mems" and means.speed_m_s is None
    if stands and abs(abs(upward) - 1) < FACTOR_TOLERANCE:
        cause = (
            f"z points up: {fix}"
            if upward > 0
            else "Earth rate says z points down: accelerometer sign"
        )
        return f"{seen}: {cause}"
    return f"{seen}: accelerometer sign or axes? If z points up, {fix}"


def _earth_rate(
    means: QuietMeans, site: Site, imu: ImuSource, beside: CoSensors
) -> tuple[str, str]:
    """Level and text of what the mean rate says; the down component is w resolved along -f."""
    size = float(np.linalg.norm(means.w_rad_s))
    down = float(-means.w_rad_s @ means.f_m_s2 / np.linalg.norm(means.f_m_s2))
    needed_down = float(-EARTH_RATE_RAD_S * np.sin(site.lat_rad))
    seen = _rate_seen(size)
    causes = [(imu.rate_hz, "rates in columns of increments", "name them gyro_x_rad_s ...")]
    if imu.source == "rates":
        causes = [
            (1 / imu.rate_hz, "angle increments in columns of rates", "name them dtheta_x_rad ...")
        ]
    for factor, unit, fix in (*causes, *W_UNITS):
        scale = factor * EARTH_RATE_RAD_S
        if max(abs(size - scale), abs(down - factor * needed_down)) < FACTOR_TOLERANCE * scale:
            by_map = beside.in_map("gyro", factor, FACTOR_TOLERANCE)
            return "error", f"{seen}: {by_map or f'{unit}? {fix}'}"
    if max(abs(size - EARTH_RATE_RAD_S), abs(down + needed_down)) < 0.2 * min(
        EARTH_RATE_RAD_S, 5 * abs(needed_down)
    ):
        return (
            "suspect",
            (
                f"rate about the vertical is {down / DEG_PER_HOUR:+.3f} deg/h, needed"
                f" {needed_down / DEG_PER_HOUR:+.3f}: sign of the gyros or of the latitude?"
            ),
        )
    return "warning", ""


def _rate_size(means: QuietMeans, technology: str) -> str:
    """What is wrong with |w| at rest: too far from Earth rate for the unit's technology."""
    size, tolerance = float(np.linalg.norm(means.w_rad_s)), W_TOLERANCE_DEG_H[technology]
    if abs(size - EARTH_RATE_RAD_S) <= tolerance * DEG_PER_HOUR:
        return ""
    read, factor = (
        ("deg/s read as rad/s", DEG)
        if size > EARTH_RATE_RAD_S
        else ("rad/s read as deg/s", 1 / DEG)
    )
    unit = f"a unit ({read}: it would be {size * factor / DEG_PER_HOUR:.3g} deg/h)"
    return (
        f"{_rate_seen(size)}, needed within {tolerance:g} of it ({technology}): turning, a large"
        f" bias, or {unit}?"
    )


def _rate_seen(size_rad_s: float) -> str:
    return (
        f"mean |w| at rest is {size_rad_s / DEG_PER_HOUR:.4g} deg/h, Earth rate is"
        f" {EARTH_RATE_RAD_S / DEG_PER_HOUR:.4g}"
    )


@dataclass(frozen=True, kw_only=True)
class ExpectedRest:
    """What the means at rest should be at a site: gravity, and Earth rate along down and north."""

    f_m_s2: float
    w_deg_h: float
    w_down_deg_h: float
    w_horizontal_deg_h: float


def expected_rest(site: Site) -> ExpectedRest:
    """What the means at rest should be at this site."""
    return ExpectedRest(
        f_m_s2=float(gravity_magnitude(site.lat_rad, site.height_m)),
        w_deg_h=EARTH_RATE_RAD_S / DEG_PER_HOUR,
        w_down_deg_h=float(-EARTH_RATE_RAD_S * np.sin(site.lat_rad)) / DEG_PER_HOUR,
        w_horizontal_deg_h=float(EARTH_RATE_RAD_S * np.cos(site.lat_rad)) / DEG_PER_HOUR,
    )
