"""Chamber runs of a unit at rest -> block means of gyro output, temperature and its rate, and the
ramps among them.

A block is a minute: ten-second sums first (their scatter is the white noise as it is, quantisation
included), bumps and tilts out, Earth rate as far as level, latitude and a surveyed heading tell it
subtracted. What remains of Earth rate is one constant an axis while the unit stays where it is: it
shifts K_T as a whole and nothing else.
"""

from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from alignment.motion.inertial import REST_FORCE_M_S2
from alignment.motion.seconds import seconds_of
from infield.thermometer.gyro_temperature import (
    FEWEST_READINGS,
    GyroTemperature,
    NoTemperature,
    gyro_temperature,
    no_thermometer,
    too_short,
)
from infield.thermometer.smoother import SmoothTemperature, nodes_of, smooth_readings
from ins.attitude import dcm_from_euler
from ins.documents import UNWRITTEN, written
from ins.earth import EARTH_RATE_RAD_S, omega_ie_n
from ins.records import AXES, InputError, Run, Span, TemperatureLog, TwinModel
from ins.robust import robust_scatter, runs_of_true
from ins.thermometer_faults import check_thermometers
from ins.units import DEG_PER_HOUR, MICRO_G, STANDARD_GRAVITY

# angle random walk of 0.002 deg/sqrt(h) is 0.0155 deg/h over it (physics.md 6.3), and a ramp of 1
# degC/min passes 1 degC
RAMP_BLOCK_S = 60.0
# of a block that must be left: its noise is then at most 1.29 of that of a whole one
FEWEST_SHARE = 0.6
SHORTEST_WINDOW_S, LONGEST_WINDOW_S, WINDOW_degC = 120.0, 1800.0, 0.3  # over which a rate is read
# a ramp's rate stays within this share of its median; the rest is soak or turning; chosen: above
# the 0.1 that a rate read from steps of 0.1 degC is off (R4), below 1 of a ramp that turns
STEADY_SHARE = 0.3
# a ten-second sum this far from the median of its ten minutes was bumped; 8 sigmas: 1e-15 of
# Gaussian errors lie beyond
BUMP_SIGMAS, BUMP_ROWS = 8.0, 61
# the sense of a ramp is that of the median over so many: a chamber's control may ripple
RIPPLE_BLOCKS = 11
# rates over a minute that differ from those over the window by more than this many of their own
# sigmas (RMS over a ramp: of 100 blocks by less than 1.2) are a ripple of the chamber; a window
# hides it from the rate and not from the gyro (at 499647c K_delta had 16 in squared
# error over variance; 5 with 3 sigmas)
RIPPLE_SIGMAS = 1.5
SHORTEST_LEG_degC, FEWEST_BLOCKS = 10.0, 10  # 10 blocks at 1 degC/min pass 10 degC


@dataclass(frozen=True, kw_only=True)
class Leg:
    """One steady ramp of a run: temperatures passed and signed rate, centres of its first and last
    block; rows of its blocks (start, end).
    """

    direction: str = field(init=False)
    low_degC: float
    high_degC: float
    rate_degC_min: float
    start_s: float
    end_s: float
    start: int = field(metadata=UNWRITTEN)
    end: int = field(metadata=UNWRITTEN)

    def __post_init__(self) -> None:
        object.__setattr__(self, "direction", "up" if self.rate_degC_min > 0 else "down")


@written(
    "run_id sha256 role blocks steady_blocks heading_known sigma_block_deg_h=sigma_deg_h"
    " sigma_rate_degC_min=rate_sigma_degC_min ramps=legs excluded"
)
@dataclass(frozen=True)
class RampRun:
    """Block means of one run: time_s (n,) of the centres; temperature_degC, rate_degC_min,
    bias_deg_h (n, 3).

    bias_deg_h: gyro output less what is known of Earth rate. sigma_deg_h (3,): white noise of one
    block. level_sigma_deg_h (3,): of the constant that Earth rate may have left. legs: the ramps;
    steady (n,): blocks within one. turned_rad: largest net turn over a span that was left out; a
    unit that turned has another share of Earth rate since. role: "fast" or "slow" in a study.
    """

    run_id: str
    sha256: str
    imu_serial: str
    gyro_technology: str
    time_s: NDArray
    temperature_degC: NDArray
    rate_degC_min: NDArray
    bias_deg_h: NDArray
    sigma_deg_h: NDArray
    rate_sigma_degC_min: NDArray
    level_sigma_deg_h: NDArray
    legs: tuple[Leg, ...]
    excluded: tuple[Span, ...]
    unusable: tuple[str, ...]
    roll_pitch_rad: tuple[float, float]
    heading_known: bool
    turned_rad: float = 0.0
    role: str = ""

    @property
    def blocks(self) -> int:
        return int(self.time_s.size)

    @property
    def steady_blocks(self) -> int:
        return int(self.steady.sum())

    @property
    def steady(self) -> NDArray:
        inside = np.zeros(self.time_s.size, dtype=bool)
        for leg in self.legs:
            inside[leg.start : leg.end] = True
        return inside

    @property
    def rate(self) -> float:
        """Fastest ramp, unsigned [degC/min]; 0 without one."""
        return max((abs(leg.rate_degC_min) for leg in self.legs), default=0.0)


def ramp_run(
    run: Run,
    twin: TwinModel,
    *,
    temperature: GyroTemperature | None = None,
    window_s: float | None = None,
) -> RampRun:
    """Block means and ramps of a run. InputError where the log cannot be used as it is (an applied
    table, no thermometer).

    temperature: the run's, where it is made already; window_s: over which a rate is read, None: by
    the ramps themselves.
    """
    header = run.header
    if header.applied_table_sha256 is not None:
        raise InputError(
            f"{header.run_id}: run.json: applied_table_sha256 is"
            f" {header.applied_table_sha256[:12]}, needed null: the ramps are fitted to raw gyro"
            " output"
        )
    why = too_short(run.temperature)
    if why is not None:
        raise NoTemperature(header.run_id, why)
    assert run.temperature is not None
    temperature = temperature or gyro_temperature(run.temperature)
    if len(temperature.unusable) == 3:
        raise NoTemperature(header.run_id, no_thermometer(temperature)[0])
    blocks = _Blocks(run)
    known, level_sigma, level = _earth_rate(run, blocks.f_b, twin)
    t, bias = blocks.time_s, blocks.omega / DEG_PER_HOUR - known
    read = read_ramps(temperature, t, window_s)
    return RampRun(
        run_id=header.run_id,
        sha256=run.sha256,
        imu_serial=header.imu_serial,
        gyro_technology=header.gyro_technology,
        time_s=t,
        temperature_degC=read.temperature_degC,
        rate_degC_min=read.rate_degC_min,
        bias_deg_h=bias,
        sigma_deg_h=blocks.sigma / DEG_PER_HOUR,
        rate_sigma_degC_min=read.rate_sigma_degC_min,
        level_sigma_deg_h=level_sigma,
        legs=read.legs,
        excluded=tuple(span.in_words() for span in (*blocks.excluded, *temperature.left_out())),
        unusable=temperature.unusable,
        roll_pitch_rad=level,
        heading_known=run.header.survey.heading_rad is not None,
        turned_rad=blocks.turned_rad,
    )


@dataclass(frozen=True)
class RampReadings:
    """What thermometers say of blocks: temperature_degC, rate_degC_min (n, 3), the sigma (3,) of a
    rate in the middle of the run, and the ramps.
    """

    temperature_degC: NDArray
    rate_degC_min: NDArray
    rate_sigma_degC_min: NDArray
    legs: tuple[Leg, ...]


def read_ramps(
    temperature: GyroTemperature, time_s: NDArray, window_s: float | None = None
) -> RampReadings:
    """Temperatures and rates of blocks about times (n,); window_s: over which a rate is read, None:
    by the ramps themselves.
    """
    T = temperature.at(time_s)
    window = window_s or _rate_window(temperature, time_s)
    rate = _rates(temperature, time_s, window)
    seen = [k for k, axis in enumerate(AXES) if axis not in temperature.unusable]
    covered = covered_blocks(temperature, time_s, seen)
    legs = _legs(time_s, T[:, seen].mean(axis=1), rate[:, seen].mean(axis=1), covered)
    sigma = _rate_sigma(temperature, time_s, window)
    inside = np.zeros(time_s.size, dtype=bool)
    for leg in legs:
        inside[leg.start : leg.end] = True
    quick = _rates(temperature, time_s, RAMP_BLOCK_S)
    off = np.sqrt(np.mean((quick - rate)[inside] ** 2, axis=0)) if inside.any() else np.zeros(3)
    noise = _rate_sigma(temperature, time_s, RAMP_BLOCK_S)
    if np.any(off[seen] > RIPPLE_SIGMAS * noise[seen]):
        rate = quick
    return RampReadings(T, rate, sigma, legs)


class _Blocks:
    """Minute means of rate and specific force, and what was left out."""

    def __init__(self, run: Run) -> None:
        blocks = seconds_of(run.imu).blocks()
        begins = blocks.begin_s
        ends = blocks.end_s
        seconds = blocks.seconds
        dtheta = blocks.dtheta_rad
        f, omega = blocks.dv_m_s / seconds[:, None], dtheta / seconds[:, None]
        self.f_b = np.median(f, axis=0)
        moved = np.linalg.norm(f - self.f_b, axis=1) > REST_FORCE_M_S2
        step = np.diff(omega, axis=0)
        noise = robust_scatter(step) / np.sqrt(2.0) if len(step) else np.ones(3)
        calm = np.stack([_running_median(column, BUMP_ROWS) for column in omega.T], axis=1)
        bumped = (np.abs(omega - calm) > BUMP_SIGMAS * np.maximum(noise, 1e-12)).any(
            axis=1
        ) & ~moved
        good = ~(moved | bumped)
        self.excluded = (
            *_spans(begins, ends, moved, "moved or tilted"),
            *_spans(begins, ends, bumped, "bumped"),
        )
        turn = (dtheta - np.median(omega, axis=0) * seconds[:, None]) * ~good[:, None]
        part = np.cumsum(np.diff(good.astype(int), prepend=1) == -1)
        self.turned_rad = float(
            max(np.linalg.norm([np.bincount(part, column) for column in turn.T], axis=0))
        )
        minute = np.floor((begins - begins[0]) / RAMP_BLOCK_S).astype(int)
        weight = np.where(good, seconds, 0.0)
        held = np.bincount(minute, weight)
        keep = held >= FEWEST_SHARE * RAMP_BLOCK_S
        kept_s = np.where(keep, held, 1.0)

        def mean(v: NDArray) -> NDArray:
            return (np.bincount(minute, weight * v) / kept_s)[keep]

        self.time_s = mean(0.5 * (begins + ends))
        self.omega = np.stack([mean(column) for column in omega.T], axis=1).reshape(-1, 3)
        self.sigma = noise * np.sqrt(np.median(seconds) / RAMP_BLOCK_S)


def _running_median(values: NDArray, size: int) -> NDArray:
    from scipy.ndimage import median_filter

    return np.asarray(median_filter(values, size=size, mode="nearest"))


def _spans(begins: NDArray, ends: NDArray, bad: NDArray, reason: str) -> list[Span]:
    return [
        Span(start_s=float(begins[a]), end_s=float(ends[b - 1]), reason=reason)
        for a, b in runs_of_true(bad)
    ]


def _earth_rate(
    run: Run, f_b: NDArray, twin: TwinModel
) -> tuple[NDArray, NDArray, tuple[float, float]]:
    """Known part of Earth rate in body axes, sigma of the rest (3,) [deg/h], and (roll, pitch) from
    the specific force.

    With a surveyed heading all of it is known; without one only the vertical part, and the
    horizontal one, of size Omega cosL times what an axis has of the horizontal plane, may point
    anywhere (its RMS is 1/sqrt(2) of that).
    """
    survey, site = run.header.survey, run.header.site
    down = -f_b / np.linalg.norm(f_b)
    roll = float(np.arctan2(down[1], down[2]))
    pitch = float(-np.arcsin(np.clip(down[0], -1.0, 1.0)))
    north, _, vertical = omega_ie_n(site.lat_rad) / DEG_PER_HOUR
    tilt = (
        EARTH_RATE_RAD_S
        / DEG_PER_HOUR
        * max(twin.accel.turn_on_ug, 10.0)
        * MICRO_G
        / STANDARD_GRAVITY
    )
    if survey.heading_rad is None:
        known, sigma = vertical * down, north * np.sqrt(np.maximum(1.0 - down**2, 0.0) / 2.0)
    else:
        C_nb = dcm_from_euler(roll, pitch, survey.heading_rad)
        known = north * C_nb[0] + vertical * C_nb[2]
        sigma = north * np.abs(C_nb[1]) * (survey.sigma_heading_rad or 0.0)
    return known, np.hypot(sigma, tilt), (roll, pitch)


def _rates(temperature: GyroTemperature, time_s: NDArray, window: float) -> NDArray:
    """Rate (n, 3) [degC/min] as the change over a window [s]."""
    first, last = temperature.time_s[0], temperature.time_s[-1]
    a, b = np.clip(time_s - 0.5 * window, first, last), np.clip(time_s + 0.5 * window, first, last)
    return 60.0 * (temperature.at(b) - temperature.at(a)) / np.maximum(b - a, 1.0)[:, None]


def _rate_window(temperature: GyroTemperature, time_s: NDArray) -> float:
    """Window [s] long enough to see a ramp over the thermometer's noise."""
    quick = _rates(temperature, time_s, 600.0)
    typical = float(np.percentile(np.abs(quick), 75)) / 60.0 if quick.size else 0.0
    return float(np.clip(WINDOW_degC / max(typical, 1e-9), SHORTEST_WINDOW_S, LONGEST_WINDOW_S))


def _rate_sigma(temperature: GyroTemperature, time_s: NDArray, window: float) -> NDArray:
    """Sigma (3,) of a rate in the middle of the run [degC/min]."""
    out = np.zeros(3)
    middle = float(time_s[time_s.size // 2]) if time_s.size else 0.0
    half = 0.5 * float(temperature.time_s[1] - temperature.time_s[0])
    ends = [
        temperature.mean_rows(t - half, t + half)
        for t in (middle - 0.5 * window, middle + 0.5 * window)
    ]
    for k, smooth in enumerate(temperature.smooth):
        if smooth is not None:
            out[k] = (
                60.0 / window * float(np.sqrt(smooth.covariance((ends[1] - ends[0])[None])[0, 0]))
            )
    return out


def covered_blocks(temperature: GyroTemperature, time_s: NDArray, seen: list[int]) -> NDArray:
    """Blocks (n,) in which the axes with a thermometer have readings."""
    place = np.clip(np.searchsorted(temperature.time_s, time_s), 0, temperature.time_s.size - 1)
    return np.asarray(temperature.usable[place][:, seen].all(axis=1))


def _legs(time_s: NDArray, T: NDArray, rate: NDArray, covered: NDArray) -> tuple[Leg, ...]:
    """Stretches of one sense of change; of each, the blocks near its median rate (weighted with the
    change itself).
    """
    found = []
    sense = np.where(covered, np.sign(_running_median(rate, RIPPLE_BLOCKS)), 0.0)
    edges = np.flatnonzero(np.diff(np.r_[np.nan, sense, np.nan]) != 0)
    for a, b in pairwise(edges):
        if sense[a] == 0.0 or b - a < FEWEST_BLOCKS:
            continue
        rows = np.arange(a, b)
        middle = _weighted_median(rate[rows], np.abs(rate[rows]))
        near = rows[np.abs(rate[rows] - middle) <= STEADY_SHARE * abs(middle)]
        start, end = (int(near[0]), int(near[-1]) + 1) if near.size else (a, a)
        low, high = (
            (float(T[start:end].min()), float(T[start:end].max())) if end > start else (0.0, 0.0)
        )
        if end - start >= FEWEST_BLOCKS and high - low >= SHORTEST_LEG_degC:
            minutes = (time_s[end - 1] - time_s[start]) / 60.0
            found.append(
                Leg(
                    low_degC=low,
                    high_degC=high,
                    rate_degC_min=float((T[end - 1] - T[start]) / minutes),
                    start_s=float(time_s[start]),
                    end_s=float(time_s[end - 1]),
                    start=int(start),
                    end=int(end),
                )
            )
    return tuple(found)


def _weighted_median(values: NDArray, weights: NDArray) -> float:
    order = np.argsort(values)
    total = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(total, 0.5 * total[-1])]) if total[-1] > 0 else 0.0


# a line that moves less says nothing: 5 steps of the default thermometer (0.01 degC)
FLAT_degC = 0.05


@dataclass(frozen=True)
class GradientLines:
    """Smoothed lines at nodes time_s (n,): value_degC (n, 3), NaN for a line that is not logged;
    smooth: None there.
    """

    time_s: NDArray
    value_degC: NDArray
    smooth: tuple[SmoothTemperature | None, ...]

    @property
    def logged(self) -> tuple[str, ...]:
        return tuple(axis for axis, smooth in zip(AXES, self.smooth) if smooth is not None)

    def at(self, time_s: NDArray) -> NDArray:
        """Lines (k, 3) at given times; the end values are held outside the log, 0 for a line that
        is not logged.
        """
        values = np.where(np.isfinite(self.value_degC), self.value_degC, 0.0)
        return np.stack([np.interp(time_s, self.time_s, column) for column in values.T], axis=1)


@dataclass(frozen=True)
class GradientRun:
    """Minute means of one run: `blocks` (rates over a minute), gradient_degC (n, 3), usable rows
    (n,), lines logged.

    sigma_rate_degC_min, sigma_gradient_degC (3,): of one block in the middle of the run.
    """

    blocks: RampRun
    gradient_degC: NDArray
    usable: NDArray
    lines: tuple[str, ...]
    sigma_rate_degC_min: NDArray
    sigma_gradient_degC: NDArray

    @property
    def minutes(self) -> int:
        return int(self.usable.sum())


def gradient_lines(log: TemperatureLog) -> GradientLines:
    """The differential readings, bursts and jumps out, smoothed as temperatures are."""
    nodes = nodes_of(log.time_s)
    value = np.full((nodes.size, 3), np.nan)
    smooth: list[SmoothTemperature | None] = [None, None, None]
    if log.gradient_degC is not None:
        names = [f"gradient_{axis}_degC" for axis in AXES]
        checked = check_thermometers(log.time_s, dict(zip(names, log.gradient_degC.T)))
        for k, name in enumerate(names):
            rows = np.flatnonzero(checked.valid[name])
            if rows.size >= max(min(FEWEST_READINGS, log.time_s.size), 3):
                found = smooth_readings(
                    nodes,
                    log.time_s[rows],
                    log.gradient_degC[rows, k],
                    checked.resolution_degC[name],
                )
                smooth[k], value[:, k] = found, found.value_degC
    return GradientLines(nodes, value, tuple(smooth))


def gradient_run(run: Run, twin: TwinModel) -> GradientRun:
    """Minute means of a run. InputError where the log cannot be used as it is."""
    why = too_short(run.temperature)
    if why is not None:
        raise NoTemperature(run.header.run_id, why)
    assert run.temperature is not None
    temperature, lines = gyro_temperature(run.temperature), gradient_lines(run.temperature)
    blocks = ramp_run(run, twin, temperature=temperature, window_s=RAMP_BLOCK_S)
    seen = [k for k, axis in enumerate(AXES) if axis not in temperature.unusable]
    gradient = lines.at(blocks.time_s)
    moving = tuple(
        axis for axis in lines.logged if np.ptp(gradient[:, AXES.index(axis)], axis=0) > FLAT_degC
    )
    middle = float(blocks.time_s[blocks.time_s.size // 2]) if blocks.time_s.size else 0.0
    return GradientRun(
        blocks=blocks,
        gradient_degC=gradient,
        usable=covered_blocks(temperature, blocks.time_s, seen),
        lines=moving,
        sigma_rate_degC_min=blocks.rate_sigma_degC_min,
        sigma_gradient_degC=_line_sigma(lines, temperature, middle),
    )


def _line_sigma(lines: GradientLines, temperature: GyroTemperature, middle_s: float) -> NDArray:
    """Sigma (3,) of each line's mean over a minute."""
    row = temperature.mean_rows(middle_s - 0.5 * RAMP_BLOCK_S, middle_s + 0.5 * RAMP_BLOCK_S)[None]
    return np.array([0.0 if s is None else np.sqrt(s.covariance(row)[0, 0]) for s in lines.smooth])
