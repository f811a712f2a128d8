"""KITTI: a folder `oxts` with `timestamps.txt` and one file of 30 numbers a moment in `data`.

Also the folder of a drive above it, and one text of such rows (tracking benchmark), 10 a second.
The columns: latitude, longitude [deg], altitude [m], roll, pitch, yaw [rad], velocity north, east,
forward, left, up [m/s], acceleration along x, y, z of the vehicle (forward, left, up) [m/s2], along
forward, left, up of the level, rates about x, y, z and about forward, left, up [rad/s], accuracies,
states. Roll is left side up, pitch front down, yaw from east, counterclockwise. What stands there
is the solution of an OXTS RT3003: it becomes the reference, and no fixes; the rates and forces
are less its bias estimates. Altitudes are above mean sea level: 116 m on drives in Karlsruhe,
where the ellipsoid lies 48 m below the geoid. Source: KITTI raw development kit, readme.txt and
dataformat.txt; Geiger and others (2013), Vision meets Robotics.
"""

import datetime
import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ins.records import AXES, InputError
from ins.units import DEG
from ins.user_input import open_regular, read_bounded
from trajectories.readers.columns.imu_columns import converted
from trajectories.readers.columns.layouts import read_columns
from trajectories.readers.columns.side_streams import with_reference
from trajectories.readers.containers.file_bytes import is_own_file
from trajectories.readers.registry import ConvertedLog, Reader
from trajectories.readers.rows.clocks import dated
from trajectories.readers.rows.column_map import (
    AxesKeys,
    LayoutKeys,
    LogOptions,
    StretchKeys,
    column_map,
    stretch_of,
)
from trajectories.readers.rows.increment_rows import head_rows
from trajectories.readers.rows.row_cleaning import row_ranges
from trajectories.runs.notes import About, Note

OXTS_NAMES = (
    "lat lon alt roll pitch yaw vn ve vf vl vu ax ay az af al au wx wy wz wf wl wu pos_accuracy"
    " vel_accuracy navstat numsats posmode velmode orimode"
).split()
STAMPS = "timestamps.txt"
OXTS_PLACES = ("oxts", ".")
OXTS_RATES, OXTS_FORCES = [f"w{a}" for a in AXES], [f"a{a}" for a in AXES]
TRACKING_HZ = 10.0
SECONDS_A_DAY = 86_400.0
STAMP = re.compile(r"(\d{4}-\d\d-\d\d)[ T](\d\d):(\d\d):(\d\d(?:\.\d{1,9})?)\s*$")
MAX_MOMENTS = 500_000  # files; 1.4 h at 100 Hz, the longest drive has 9 min
MAX_MOMENT_BYTES = 2_000  # of a file; they have some 500
MAX_STAMPS_BYTES = 20_000_000  # of timestamps.txt: MAX_MOMENTS lines of 30 characters
G_LEAST, G_MOST = 7.0, 13.0  # m/s2, of the median force: 0.7 to 1.3 g, what a car feels
MOMENTS_SEEN = 20  # 2 s at the slowest rate of a run, 10 Hz


class KittiKeys(StretchKeys):
    """Map keys of an oxts folder."""

    format: str | None = None
    axes: AxesKeys = AxesKeys(x="x", y="-y", z="-z")  # forward, left, up


def _folder(path: Path) -> Path | None:
    """The oxts folder that a path means; None where there is none."""
    if not path.is_dir():
        return None
    places = (path / place for place in OXTS_PLACES)
    is_oxts = (p for p in places if (p / "data").is_dir() and is_own_file(p / STAMPS, path))
    return next(is_oxts, None)


def read(path: Path, options: LogOptions) -> ConvertedLog:
    """The log of an oxts folder, or of a text of its rows."""
    keys = options.parsed(KittiKeys)
    folder = _folder(path)
    if folder is not None:
        table, time_s, day_s, notes = _moments(folder)
        others: tuple[Path, ...] = (folder / STAMPS,)
    else:
        table, notes = _tracking(path)
        time_s, day_s, others = np.arange(1, len(table) + 1) / TRACKING_HZ, None, ()
    columns = {name: table[:, k] for k, name in enumerate(OXTS_NAMES)} | {"time": time_s}
    shape = {
        "time": {"column": "time"},
        "gyro": {"columns": OXTS_RATES, "unit": "rad/s"},
        "accel": {"columns": OXTS_FORCES, "unit": "m/s2"},
        "axes": keys.axes.model_dump(),
        **stretch_of(keys),
    }
    label = path.name
    imu = {name: columns[name] for name in ("time", *OXTS_RATES, *OXTS_FORCES)}
    log = converted(imu, column_map(LogOptions(shape)), label=label, notes=notes)
    start, told = ({}, []) if day_s is None else dated(day_s + log.time_shift_s, label)
    if start:
        told = [f"{label}: {STAMPS} names no time zone: taken as UTC"]
    log = replace(
        log,
        header={**start, **_site(columns), **keys.run},
        notes=(*log.notes, *told),
        other_files=others,
    )
    return _with_reference(log, columns, label)


def _moments(folder: Path) -> tuple[NDArray, NDArray, float | None, list[str]]:
    """Rows (n, 30) and their times on the first day [s], when that began [UTC since 1970], notes.

    A file's number is the line of its time. InputError where too many are damaged.
    """
    label = folder.name
    try:
        text = read_bounded(folder / STAMPS, MAX_STAMPS_BYTES).decode("utf-8", "replace")
    except OSError as error:
        raise InputError(f"{STAMPS}: cannot be read ({error.strerror or error})") from None
    lines = text.splitlines()[:MAX_MOMENTS]
    stamps = [_stamp(line) for line in lines]
    days = [day for day, _ in stamps if day is not None]
    first = days[0] if days else None
    time_s = np.full(len(lines), np.nan)
    for k, (day, second) in enumerate(stamps):
        if day is not None and first is not None:
            time_s[k] = (day - first).days * SECONDS_A_DAY + second
    table = np.full((len(lines), len(OXTS_NAMES)), np.nan)
    files = [folder / "data" / f"{k:010d}.txt" for k in range(len(lines))]
    bad = [k for k, file in enumerate(files) if not _moment(file, folder, table[k])]
    notes: list[str] = []
    if bad:
        told = f"{label}: data {row_ranges(np.array(bad))} missing or damaged"
        notes.append(Note(told, About.DAMAGE))
    if len(bad) > len(lines) / 2 or not days:
        raise InputError(
            f"{label}: {len(lines) - len(bad)} of {len(lines)} moments of {STAMPS} with 30 numbers"
            f" in data/, {len(days)} with a date"
        )
    start = None if first is None else first.replace(tzinfo=datetime.UTC).timestamp()
    return table, time_s, start, notes


def _stamp(line: str) -> tuple[datetime.datetime | None, float]:
    found = STAMP.match(line)
    if found is None:
        return None, np.nan
    try:
        day = datetime.datetime.fromisoformat(found[1])
    except ValueError:
        return None, np.nan
    return day, 3600.0 * int(found[2]) + 60.0 * int(found[3]) + float(found[4])


def _moment(path: Path, folder: Path, row: NDArray) -> bool:
    """Whether a file has 30 numbers, which are put into the row."""
    if not is_own_file(path, folder):
        return False
    try:
        with open_regular(path) as file:
            words = file.read(MAX_MOMENT_BYTES).split()
        if len(words) != len(OXTS_NAMES):
            return False
        row[:] = [float(word) for word in words]
    except (OSError, ValueError):
        return False
    return True


def _tracking(path: Path) -> tuple[NDArray, list[str]]:
    """The rows of a text of 30 columns."""
    if not path.is_file() or head_rows(path) is None:
        raise InputError(f"{path.name}: no oxts folder (data/ and {STAMPS}), no rows of 30 numbers")
    layout = LayoutKeys(format="text", columns=list(OXTS_NAMES), header_lines=0)
    columns, notes = read_columns(path, layout, list(OXTS_NAMES))
    told = f"{path.name}: no times: rows {TRACKING_HZ:g} a second (tracking benchmark)"
    return np.column_stack([columns[name] for name in OXTS_NAMES]), [*notes, told]


def _site(columns: Mapping[str, NDArray]) -> dict[str, dict[str, float]]:
    place = [columns[name] for name in ("lat", "lon", "alt")]
    with np.errstate(invalid="ignore"):
        sane = (np.abs(place[0]) <= 90) & (np.abs(place[1]) <= 180) & (np.abs(place[2]) < 30_000)
    rows = np.flatnonzero(sane & ((place[0] != 0) | (place[1] != 0)))
    if not rows.size:
        return {}
    lat, lon, height = (float(values[rows[0]]) for values in place)
    return {"site": {"lat_deg": lat, "lon_deg": lon, "height_m": height}}


def _with_reference(log: ConvertedLog, columns: Mapping[str, NDArray], label: str) -> ConvertedLog:
    """The solution of the RT3003 as reference; heights as they are, above mean sea level."""
    log = with_reference(
        log,
        {
            "time_s": columns["time"],
            "lat_rad": columns["lat"] * DEG,
            "lon_rad": columns["lon"] * DEG,
            "height_m": columns["alt"],
            "v_n_m_s": np.column_stack([columns["vn"], columns["ve"], -columns["vu"]]),
            "roll_rad": columns["roll"],
            "pitch_rad": -columns["pitch"],
            "heading_rad": np.mod(np.pi / 2 - columns["yaw"], 2 * np.pi),
        },
        label=label,
        rows_of="rows of the solution of an OXTS RT3003",
    )
    notes = [
        f"{label}: rates and forces are less the bias estimates of that solution",
        f"{label}: heights are above mean sea level, taken as they are",
    ]
    return replace(log, notes=(*log.notes, *notes))


def detect(path: Path) -> bool:
    """An oxts folder, or rows of 30 numbers with a latitude in front and gravity upward."""
    if path.is_dir():
        return _folder(path) is not None
    found = head_rows(path)
    if found is None or found[0].shape[1] != len(OXTS_NAMES) or len(found[0]) < MOMENTS_SEEN:
        return False
    rows = dict(zip(OXTS_NAMES, found[0].T))
    upward = float(np.median(rows["az"]))
    place = np.all(np.abs(rows["lat"]) <= 90) and np.all(np.abs(rows["lon"]) <= 180)
    return bool(place and G_LEAST < upward < G_MOST)


READERS = (
    Reader(
        name="kitti",
        about="KITTI folder oxts (or of its drive), or a text of its rows",
        detect=detect,
        read=read,
        folder=True,
    ),
)
