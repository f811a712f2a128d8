"""A truth profile of somebody else's as the motion of a simulated run: position, velocity and
attitude by time.

The file has the columns of a run's `reference` stream, as CSV or Parquet; a CSV without a header
has them in that order. Attitude and velocity are what the run follows; its position is their
integral from the file's first place on, for a profile whose position and velocity disagree cannot
be followed in both (`departure` says by how much it departs).
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ins.columns import ATTITUDE, POSITION, VELOCITY
from ins.earth import dcm_en, geodetic_from_ecef, radii_of_curvature
from ins.records import InputError, Site
from ins.units import DEG
from trajectories.runs.schema import REQUIRED, check_columns
from trajectories.runs.stream_files import StreamFile
from trajectories.simulator.sampled_truth import (
    Sampled,
    SampledMove,
    SampledStand,
    truth_from_samples,
)
from trajectories.simulator.truth import Truth

COLUMNS = REQUIRED["reference"]
# rows slower than this for STILL_S are a stop: published profiles carry millimetres a second of
# noise, Groves's profile 1 stands at 3 mm/s
STILL_M_S = 0.005
STILL_S = 1.0  # chosen: 100 rows of Groves's profiles (100 Hz)
FEWEST_ROWS = 10  # of a profile: four more than the 6 coefficients of a quintic
Range = tuple[float, float]
# By the whole key, else by the longest ending; gravity holds for -500 to 20,000 m (ins.earth).
RANGE_OF_KEY: Mapping[str, Range] = {
    "lat_deg": (-90.0, 90.0),
    "lon_deg": (-360.0, 360.0),
    "pitch_deg": (-90.0, 90.0),
    "bank_deg": (0.1, 80.0),  # 5.8 g; the tangent goes to infinity at 90
    "height_m": (-500.0, 20_000.0),
    "radius_m": (0.1, 100_000.0),
    "rate_hz": (0.1, 10_000.0),  # five times the fastest unit of formats.md
    "time_s": (-100_000.0, 1_000_000.0),
    "settle_s": (0.01, 100_000.0),
    "duration_s": (0.001, 1_000_000.0),
    "rate_degC_min": (0.001, 1_000.0),
    "ramp_s": (0.01, 100_000.0),
    "soak_s": (0.0, 1_000_000.0),
    "cycles": (1.0, 1_000.0),
    "strength": (0.0, 1_000.0),
    "seed": (0.0, 2.0**63),
    "ageing_seed": (0.0, 2.0**63),
}
RANGE_OF_ENDING: Mapping[str, Range] = {
    "_degC_min": (-1_000.0, 1_000.0),
    "_m_s2": (0.001, 1_000.0),
    "_m_s": (-10_000.0, 10_000.0),
    "_tau_s": (0.001, 10_000_000.0),
    "_degC": (-273.15, 1_000.0),
    "_deg": (-36_000.0, 36_000.0),  # 100 turns
    "_s": (0.0, 1_000_000.0),  # 11.6 days
    "_m": (-100_000.0, 100_000.0),
}
RANGE_OF_OTHERS: Range = (-1e6, 1e6)
# 5.6 h at 200 Hz; the simulator takes 970 bytes a row (an hour parked at 100 Hz), so 3.9 GB
MAX_SIMULATED_ROWS = 4_000_000
LEAST_HZ = 10.0  # of what is made at a rate of its own: knots, slow errors, odometer, reference
# Of motion, disturbances and environments: each is laid over all rows; chosen: the packaged
# scenarios have at most some 30, and 1,000 over 4 million rows end in minutes.
MAX_PARTS = 1_000


@dataclass(frozen=True, kw_only=True)
class TruthSection:
    """`file`: relative to the scenario; the unit stands `park_s` before its first row and
    `park_after_s` after its last.

    run_up_s: time to reach the speed of a first row that moves. step_s: knots of the motion; rows
    between are averaged.
    """

    file: str
    park_s: float = 600.0
    park_after_s: float = 0.0
    run_up_s: float = 0.0
    step_s: float = 0.1

    def check(self) -> None:
        """InputError where a time is out of its range."""
        if min(self.park_s, self.park_after_s, self.run_up_s) < 0 or not self.step_s > 0:
            raise InputError("truth: needed times of 0 s or more and step_s above 0")


@dataclass(frozen=True, kw_only=True)
class TruthProfile:
    """The rows of a file, times from the start of the run (n,): lat, lon [rad], height [m], v_n (n,
    3), euler (n, 3).

    euler_rad: roll, pitch, heading, not wrapped; stretches: what the run does, from the start of
    the run to its end.
    """

    source: str
    site: Site
    time_s: NDArray
    place: NDArray
    v_n_m_s: NDArray
    euler_rad: NDArray
    stretches: tuple[Sampled, ...]

    def truth(self, wheel_reference_m: tuple[float, float, float]) -> Truth:
        """The motion as a truth of splines."""
        return truth_from_samples(self.site, self.stretches, wheel_reference_m=wheel_reference_m)


@dataclass(frozen=True, kw_only=True)
class Departure:
    """Largest distance between the run's truth and the rows of its file."""

    position_m: float
    velocity_m_s: float
    attitude_deg: float


def read_profile(section: TruthSection, folder: Path) -> TruthProfile:
    """The profile in a file; InputError names file, row or key."""
    section.check()
    path = folder / section.file
    columns = _columns(path)
    time_s, place, v_n, euler = _checked(columns, path.name)
    moving_start = bool(np.linalg.norm(v_n[0]) >= STILL_M_S)
    if moving_start and not section.run_up_s > 0:
        speed = float(np.linalg.norm(v_n[0]))
        raise InputError(
            f"{path.name}: row 1 moves at {speed:.3g} m/s, needed 0 or truth.run_up_s: a run starts"
            " at rest"
        )
    span_s = section.park_s + section.run_up_s + section.park_after_s + time_s[-1] - time_s[0]
    refuse_many_rows(span_s, 1.0 / section.step_s, name=path.name)
    start_s = section.park_s + (section.run_up_s if moving_start else 0.0)
    time_s = time_s - time_s[0] + start_s
    site = _start(place[0], v_n[0], section.run_up_s if moving_start else 0.0)
    spans = _spans(time_s, v_n)
    stretches = [_stretch(span, moves, time_s, v_n, euler, section.step_s) for span, moves in spans]
    stretches = _with_parks(stretches, section, euler, v_n, moving_start)
    return TruthProfile(
        source=str(path),
        site=site,
        time_s=time_s,
        place=place,
        v_n_m_s=v_n,
        euler_rad=euler,
        stretches=tuple(stretches),
    )


def departure(truth: Truth, profile: TruthProfile) -> Departure:
    """How far the truth of a run is from the rows of its file, at most."""
    inside = profile.time_s <= truth.motion.end_s
    point = truth.kinematics(profile.time_s[inside])
    lat, lon, height = geodetic_from_ecef(point.r_e)
    meridian, transverse = radii_of_curvature(lat)
    off = profile.place[inside] - np.stack([lat, lon, height], axis=-1)
    metres = off * np.stack(
        [meridian + height, (transverse + height) * np.cos(lat), np.ones_like(lat)], axis=-1
    )
    v_n = np.einsum("nji,nj->ni", dcm_en(lat, lon), point.v_e)
    turn = np.abs(profile.euler_rad[inside] - point.euler_rad)
    return Departure(
        position_m=float(np.max(np.linalg.norm(metres, axis=1))),
        velocity_m_s=float(np.max(np.linalg.norm(profile.v_n_m_s[inside] - v_n, axis=1))),
        attitude_deg=float(np.max(turn)) / DEG,
    )


def _columns(path: Path) -> dict[str, NDArray]:
    """The reference columns of a file, a CSV of bare numbers being in their order."""
    if not path.is_file():
        raise InputError(f"{path}: cannot be read (no such file)")
    stream = StreamFile(path)
    if not (stream.is_text and all(re.fullmatch(r"[-+.\deE]+", name) for name in stream.names)):
        if wrong := check_columns("reference", stream.names, where=path.name):
            raise InputError(wrong[0])
        return {name: stream.column(name) for name in COLUMNS}
    if len(stream.names) != len(COLUMNS):
        raise InputError(
            f"{path.name}: {len(stream.names)} columns without names, needed {len(COLUMNS)}:"
            f" {' '.join(COLUMNS)}"
        )
    try:
        rows = np.loadtxt(path, delimiter=",", ndmin=2)
    except ValueError as error:
        raise InputError(f"{path.name}: {' '.join(str(error).split())[:200]}") from None
    return dict(zip(COLUMNS, rows.T))


def _checked(columns: dict[str, NDArray], name: str) -> tuple[NDArray, NDArray, NDArray, NDArray]:
    """Times, place (lat, lon, height), velocity and attitude in SI and radians; headings run on."""
    time_s = columns["time_s"]
    for key, values in columns.items():
        if not np.all(np.isfinite(values)):
            row = int(np.argmin(np.isfinite(values))) + 1
            raise InputError(
                f"{name}: row {row}: column {key}: got {values[row - 1]}, needed a number"
            )
    if time_s.size < FEWEST_ROWS:
        raise InputError(f"{name}: {time_s.size} rows, needed {FEWEST_ROWS} or more")
    if not np.all(np.diff(time_s) > 0):
        row = int(np.argmax(np.diff(time_s) <= 0)) + 2
        raise InputError(
            f"{name}: row {row}: time_s {time_s[row - 1]:g} after {time_s[row - 2]:g}, needed a"
            " later one"
        )
    if np.max(np.abs(columns["lat_deg"])) > 90:
        row = int(np.argmax(np.abs(columns["lat_deg"]) > 90)) + 1
        raise InputError(
            f"{name}: row {row}: lat_deg {columns['lat_deg'][row - 1]:g}, needed -90 to 90:"
            " degrees, not radians?"
        )
    place = np.stack([columns[k] for k in POSITION], axis=-1) * [DEG, DEG, 1.0]
    v_n = np.stack([columns[k] for k in VELOCITY], axis=-1)
    euler = np.unwrap(np.stack([columns[k] for k in ATTITUDE], axis=-1) * DEG, axis=0)
    return time_s, place, v_n, euler


def _start(place: NDArray, v_n: NDArray, run_up_s: float) -> Site:
    """Where the run starts: a run-up of constant direction before the first row."""
    lat, lon, height = (float(p) for p in place)
    meridian, transverse = radii_of_curvature(lat)
    back = 0.5 * run_up_s * v_n  # a symmetric blend covers half of speed x time
    return Site(
        lat_rad=lat - float(back[0] / (meridian + height)),
        height_m=height + float(back[2]),
        lon_rad=lon - float(back[1] / ((transverse + height) * np.cos(lat))),
    )


def _spans(time_s: NDArray, v_n: NDArray) -> list[tuple[slice, bool]]:
    """Rows of stops and of motion in turn; a stop shorter than STILL_S is part of the motion.
    Neighbours share a row.
    """
    slow = np.linalg.norm(v_n, axis=1) < STILL_M_S
    edges = np.flatnonzero(np.diff(slow)) + 1
    moves = np.ones(slow.size, dtype=bool)
    for rows in np.split(np.arange(slow.size), edges):
        if slow[rows[0]] and time_s[rows[-1]] - time_s[rows[0]] >= STILL_S:
            moves[rows] = False
    cuts = [0, *(np.flatnonzero(np.diff(moves)) + 1), slow.size]
    found = []
    for a, b in pairwise(cuts):
        moving = bool(moves[a])
        found.append(
            (slice(max(a - 1, 0) if moving else a, min(b + 1, slow.size) if moving else b), moving)
        )
    return found


def _stretch(
    span: slice, moves: bool, time_s: NDArray, v_n: NDArray, euler: NDArray, step_s: float
) -> Sampled:
    t = time_s[span]
    if not moves:
        return SampledStand(
            start_s=float(t[0]), end_s=float(t[-1]), euler_rad=np.mean(euler[span], axis=0)
        )
    knots = np.linspace(t[0], t[-1], max(2, round((t[-1] - t[0]) / step_s) + 1))
    values = _averaged(t, np.hstack([euler[span], v_n[span]]), knots)
    return _move(knots, values[:, :3], values[:, 3:])


def _move(time_s: NDArray, euler_rad: NDArray, v_n_m_s: NDArray) -> SampledMove:
    """Velocity as the samples say: what rolls without slip is not known of a profile."""
    speed = np.linalg.norm(v_n_m_s[:, :2], axis=1)
    return SampledMove(
        time_s=time_s,
        euler_rad=euler_rad,
        speed_m_s=speed,
        v_n_m_s=v_n_m_s,
        airborne=np.ones(time_s.size),
    )


def _averaged(t: NDArray, values: NDArray, knots: NDArray) -> NDArray:
    """Mean of the piecewise linear curve through the rows over the step about each knot, half a
    step at the ends.
    """
    half = 0.5 * (knots[1] - knots[0])
    integral = np.vstack(
        [
            np.zeros(values.shape[1]),
            np.cumsum(0.5 * (values[1:] + values[:-1]) * np.diff(t)[:, None], axis=0),
        ]
    )
    low, high = np.maximum(knots - half, t[0]), np.minimum(knots + half, t[-1])

    def at(x: NDArray) -> NDArray:
        k = np.clip(np.searchsorted(t, x, side="right") - 1, 0, t.size - 2)
        dx = (x - t[k])[:, None]
        slope = (values[k + 1] - values[k]) / (t[k + 1] - t[k])[:, None]
        return integral[k] + values[k] * dx + 0.5 * slope * dx**2

    mean = (at(high) - at(low)) / (high - low)[:, None]
    mean[0], mean[-1] = values[0], values[-1]
    return mean


def _with_parks(
    found: list[Sampled], section: TruthSection, euler: NDArray, v_n: NDArray, moving_start: bool
) -> list[Sampled]:
    """The stretches with the run-up and the time at rest before the first row, and the rest after
    the last.
    """
    first, last = found[0], found[-1]
    if moving_start and isinstance(first, SampledMove):
        n = max(2, round(section.run_up_s / section.step_s))
        u = np.arange(n) / n
        t = first.start_s - section.run_up_s + section.run_up_s * u
        speed = (10 * u**3 - 15 * u**4 + 6 * u**5)[:, None] * v_n[0]
        found[0] = _move(
            np.concatenate([t, first.time_s]),
            np.vstack([np.tile(euler[0], (n, 1)), first.euler_rad]),
            np.vstack([speed, first.v_n_m_s]),
        )
    if isinstance(first, SampledStand):
        found[0] = SampledStand(start_s=0.0, end_s=first.end_s, euler_rad=first.euler_rad)
    elif not section.park_s > 0:
        raise InputError("truth.park_s: got 0, but the file starts moving; needed time at rest")
    else:
        found.insert(0, SampledStand(start_s=0.0, end_s=section.park_s, euler_rad=euler[0]))
    if not section.park_after_s > 0:
        return found
    if isinstance(last, SampledMove) and np.linalg.norm(v_n[-1]) >= STILL_M_S:
        raise InputError(
            f"truth.park_after_s: got {section.park_after_s:g}, but the last row moves; needed 0"
        )
    end_s = last.end_s + section.park_after_s
    if isinstance(last, SampledStand):
        begin = found[-1].start_s
        found[-1] = SampledStand(start_s=begin, end_s=end_s, euler_rad=last.euler_rad)
    else:
        found.append(SampledStand(start_s=last.end_s, end_s=end_s, euler_rad=euler[-1]))
    return found


def refuse_out_of_range(key: str, value: object, *, name: str) -> None:
    """InputError for the first number, alone or in a list, that is not in the range of its key."""
    low, high = range_of(key)
    for number in _numbers(value):
        if not low <= number <= high:
            got = f"{number:g}" if abs(number) < 1e300 else str(number)[:20]
            raise InputError(f"{name}: {key}: got {got}, needed {low:g} to {high:g}")


def _numbers(value: object) -> list[int | float]:
    """The numbers of a value: itself, or those of a list."""
    parts = value if isinstance(value, list | tuple) else [value]
    return [n for n in parts if isinstance(n, int | float) and not isinstance(n, bool)]


def range_of(key: str) -> Range:
    """The range of a key."""
    if key in RANGE_OF_KEY:
        return RANGE_OF_KEY[key]
    return next(
        (limits for end, limits in RANGE_OF_ENDING.items() if key.endswith(end)), RANGE_OF_OTHERS
    )


def refuse_many_parts(key: str, count: int, *, name: str) -> None:
    """InputError where a list has more parts than MAX_PARTS."""
    if count > MAX_PARTS:
        raise InputError(f"{name}: {key}: got {count} parts, needed at most {MAX_PARTS}")


def refuse_many_rows(end_s: float, rate_hz: float, *, name: str) -> None:
    """InputError where a run would have more rows than MAX_SIMULATED_ROWS, be it of the knots of
    its truth.
    """
    rows = end_s * max(rate_hz, LEAST_HZ)
    if not rows <= MAX_SIMULATED_ROWS:
        raise InputError(
            f"{name}: {end_s:g} s at {rate_hz:g} Hz are {rows:.3g} rows, needed at most"
            f" {MAX_SIMULATED_ROWS}"
        )
