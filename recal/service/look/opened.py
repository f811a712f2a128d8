"""Any log as a run: a run directory as it is, a log of a known format converted to a temporary one.

What the log does not say is taken for granted and named, so that a first look needs no option.
"""

import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import partial
from pathlib import Path

import numpy as np

from ins.earth import EARTH_RATE_RAD_S
from ins.errors.table import RAW_BIAS_DEG_H
from ins.json_file import Json
from ins.records import ImuLog, LatitudeSource, Run
from ins.units import DEG, DEG_PER_HOUR
from recal.service.convert import map_errors, map_keys
from recal.service.look.records import Assumption
from recal.service.results.files import AnyPath
from trajectories.readers.conversion import RUN_OPTIONS, conversion_of, missing_keys
from trajectories.readers.registry import ConvertedLog, read_log
from trajectories.readers.rows.column_map import LogOptions
from trajectories.readers.rows.row_cleaning import LogGapError
from trajectories.runs.directory import read_run, write_run
from trajectories.runs.physics_gates import W_TOLERANCE_DEG_H, CoSensors, QuietMeans, quiet_means

RUN_DIRECTORY = "run directory"
MIDDLE_LATITUDE_DEG = 45.0  # taken where nothing tells the site: gravity is 0.27 % off at most
MIDDLE_LATITUDE_SIGMA_DEG = 26.0  # of anything between equator and pole
RATE_SIGMAS = 3.0  # of a mean rate, within the Earth's: 0.3 % of means that show none lie beyond


@dataclass(frozen=True, kw_only=True)
class LongestPart:
    """The longest stretch between gaps, by the log's own clock [s], and of how many."""

    from_s: float
    to_s: float
    of: int


@dataclass(frozen=True, kw_only=True)
class Opened:
    """A log as a run on the disk.

    folder: the run directory; format: of the log; notes: what its reader dropped and repaired;
    assumed: what the log does not say; stretch: None where all of the log was taken.
    """

    run: Run
    folder: Path
    format: str
    notes: tuple[str, ...] = ()
    assumed: tuple[Assumption, ...] = ()
    stretch: LongestPart | None = None


@contextmanager
def opened_log(
    log: Path,
    *,
    map_file: AnyPath | None,
    gnss: AnyPath | None,
    header: Mapping[str, str | float | None],
    options: Mapping[str, str | float | None],
) -> Iterator[Opened]:
    """The log as a run, which is gone afterwards where it had to be made."""
    if (log / "run.json").exists():
        yield Opened(run=read_run(log), folder=log, format=RUN_DIRECTORY)
        return
    given = map_keys(map_file, gnss, header, options)
    with tempfile.TemporaryDirectory(prefix="recal-look-") as made:
        folder = Path(made) / "run"
        with map_errors(map_file):
            taken = _taken(log, given, header, folder)
        yield taken(run=read_run(folder))


def _taken(
    log: Path, given: dict[str, Json], header: Mapping[str, str | float | None], folder: Path
) -> Callable[..., Opened]:
    """Writes the log as a run, and lets go of it: what is said of it waits for the run as read."""
    name, read, cut = _read(log, given)
    assumed = assumptions(log, read, header)
    values: dict[str, str | float | None] = {one.key: one.value for one in assumed}
    for one in assumed:
        if one.sigma is not None:
            values |= {f"sigma_{one.key}": one.sigma, "lat_source": LatitudeSource.GUESS.value}
    conversion = conversion_of(log, name, read, {**header, **values}, options=LogOptions(given))
    write_run(folder, conversion.run, reference=conversion.reference, conversion=conversion.record)
    return partial(
        Opened,
        folder=folder,
        format=name,
        notes=tuple(str(note) for note in conversion.record.notes),
        assumed=assumed,
        stretch=cut,
    )


def _read(log: Path, given: dict[str, Json]) -> tuple[str, ConvertedLog, LongestPart | None]:
    """Format and log; where it has gaps and no stretch was asked for, its longest one."""
    try:
        return *read_log(log, LogOptions(given)), None
    except LogGapError as gaps:
        if {"from_s", "to_s"} & set(given):
            raise
        from_s, to_s = max(gaps.stretches, key=lambda ends: ends[1] - ends[0])
        cut = LongestPart(from_s=from_s, to_s=to_s, of=len(gaps.stretches))
        # as LogGapError prints them, so that the command takes the same rows
        ends = {"from_s": round(from_s, 3), "to_s": round(to_s, 3)}
        return *read_log(log, LogOptions({**given, **ends})), cut


def assumptions(
    path: Path, log: ConvertedLog, header: Mapping[str, str | float | None]
) -> tuple[Assumption, ...]:
    """What is taken for each key that neither the log nor the options say."""
    missing = missing_keys(log, header)
    if not missing:
        return ()
    means = quiet_means(log.imu, CoSensors(gnss=log.gnss, odometer=log.odometer))
    stands = means is not None and means.speed_m_s is None
    finds_north = means is not None and stands and reads_earth_rate(log.imu, means)
    latitude_deg, sigma_deg = MIDDLE_LATITUDE_DEG, MIDDLE_LATITUDE_SIGMA_DEG
    if means is not None and finds_north:
        latitude_deg = latitude_by_gyros_deg(means)
        level_deg_h = EARTH_RATE_RAD_S * np.cos(latitude_deg * DEG) / DEG_PER_HOUR
        sigma_deg = float(min(RAW_BIAS_DEG_H["fog"] / level_deg_h / DEG, sigma_deg))
    start = datetime.fromtimestamp(path.stat().st_mtime, UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
    values: dict[str, tuple[str | float, str]] = {
        "imu_serial": (path.name.split(".")[0], "the name of the log"),
        "gyro_technology": (
            ("fog", "the gyros show the Earth's rate at rest, as rlg and fog units do")
            if finds_north
            else ("mems", "the gyros do not show the Earth's rate at rest")
        ),
        "start_utc": (start, "when the file was last written"),
        "lat_deg": (
            round(latitude_deg, 2),
            "the latitude that the gyros show at rest"
            if finds_north
            else "the log does not say it",
        ),
        "lon_deg": (0.0, "the log does not say it, and gravity does not depend on it"),
        "height_m": (0.0, "the log does not say it; 1000 m change gravity by 0.03 %"),
    }
    return tuple(
        Assumption(
            key=key,
            value=values[key][0],
            option=RUN_OPTIONS[key],
            text=values[key][1],
            sigma=sigma_deg if key == "lat_deg" else None,
        )
        for key in missing
    )


def reads_earth_rate(imu: ImuLog, means: QuietMeans) -> bool:
    """Whether the gyros read the Earth's rate at rest, to the tolerance of a fibre-optic unit."""
    rows = imu.between(means.start_s, means.end_s)
    # of seconds: dither and counts of angle, hundreds of deg/h a row, average out within one
    second = np.searchsorted(rows.time_s, np.arange(rows.time_s[0], rows.time_s[-1], 1.0))
    dtheta, dt_s = (np.add.reduceat(v, second, axis=0) for v in (rows.dtheta_rad, rows.dt_s))
    sigma = np.std(dtheta / dt_s[:, None], axis=0) / np.sqrt(second.size)
    if RATE_SIGMAS * float(np.max(sigma)) > EARTH_RATE_RAD_S:
        return False
    apart = abs(float(np.linalg.norm(means.w_rad_s)) - EARTH_RATE_RAD_S)
    return apart < W_TOLERANCE_DEG_H["fog"] * DEG_PER_HOUR


def latitude_by_gyros_deg(means: QuietMeans) -> float:
    """Where the Earth's rate about the vertical is as measured (CONVENTIONS.md)."""
    up = means.f_m_s2 / np.linalg.norm(means.f_m_s2)
    sine = float(np.dot(means.w_rad_s, up)) / EARTH_RATE_RAD_S
    return float(np.arcsin(np.clip(sine, -1.0, 1.0))) / DEG
