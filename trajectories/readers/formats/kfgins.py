"""KF-GINS logs: increments with seconds of the GPS week in front, axes forward, right, down.

A row is time [s], dtheta x y z [rad], dvel x y z [m/s] over the interval that ends at its time, as
text or as doubles. Fixes come in a file of their own (`--gnss`): time, latitude and longitude
[deg], height above the ellipsoid [m], then sigmas north, east, down [m] (7 columns), or velocity
north, east, down [m/s] and the sigmas (10), or these and sigmas of velocity (13). The truth
(`truth` in the map): week, time, position as above, velocity north, east, down, roll, pitch,
heading [deg]. Source: i2Nav-WHU/KF-GINS, README section 2.2 and src/fileio/gnssfileloader.h;
awesome-gins-datasets, README section 3.
"""

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from ins.records import AXES, InputError
from ins.units import DEG
from trajectories.readers.columns.fixes import RawFixes, largest, may_be_radians
from trajectories.readers.columns.imu_columns import converted
from trajectories.readers.columns.layouts import read_columns, side_file
from trajectories.readers.columns.rtklib_solution import is_solution, on_gps_week, read_solution
from trajectories.readers.columns.side_streams import GnssFile, with_fixes, with_reference
from trajectories.readers.registry import ConvertedLog, Reader
from trajectories.readers.rows.clocks import dated, gps_seconds, unix_seconds, week_unwrapped
from trajectories.readers.rows.column_map import (
    LayoutKeys,
    LogOptions,
    StretchKeys,
    column_map,
    stretch_of,
)
from trajectories.readers.rows.increment_rows import (
    are_increments,
    head_doubles,
    head_rows,
    refuse_other_width,
)

DTHETA_COLUMNS = [f"dtheta_{a}" for a in AXES]
DVEL_COLUMNS = [f"dvel_{a}" for a in AXES]
ROW_COLUMNS = ["time", *DTHETA_COLUMNS, *DVEL_COLUMNS]
MAP = {
    "time": {"column": "time"},
    "gyro": {"columns": DTHETA_COLUMNS, "unit": "rad"},
    "accel": {"columns": DVEL_COLUMNS, "unit": "m/s"},
}
PLACE, SPEED, SIGMA, SPEED_SIGMA = (
    [f"{stem}{k}" for k in range(3)] for stem in ("place", "speed", "sigma", "speed_sigma")
)
GNSS_ROWS = {
    7: [*PLACE, *SIGMA],
    10: [*PLACE, *SPEED, *SIGMA],
    13: [*PLACE, *SPEED, *SIGMA, *SPEED_SIGMA],
}
TRUTH_ROW = ["week", "time", *PLACE, *SPEED, "roll", "pitch", "heading"]


class KfginsKeys(StretchKeys):
    """Map keys of a KF-GINS log. `gps_week`: of the first row, gives the date; `truth`: file of the
    ground truth.
    """

    format: str | None = None
    gnss: GnssFile | None = None
    truth: str | None = None
    gps_week: Annotated[int, Field(ge=0, le=10_000)] | None = None


def read(path: Path, options: LogOptions) -> ConvertedLog:
    """The log, with the fixes and the truth of other files."""
    keys = options.parsed(KfginsKeys)
    columns, notes = _table(path, {7: ROW_COLUMNS[1:]}, "time, dtheta x y z, dvel x y z")
    log = converted(
        columns, column_map(LogOptions(MAP | stretch_of(keys))), label=path.name, notes=notes
    )
    start, told = _date(keys.gps_week, log.time_shift_s, path.name)
    log = replace(log, header={**start, **keys.run}, notes=(*log.notes, *told))
    if keys.gnss is not None:
        other = side_file(path, keys.gnss.file, "gnss.file (--gnss)")
        raw, more = _fixes_of(other, keys.gps_week)
        log = with_fixes(
            replace(log, other_files=(other,), notes=(*log.notes, *more)), raw, label=other.name
        )
    return (
        log if keys.truth is None else _with_truth(log, side_file(path, keys.truth, "map: truth"))
    )


def _table(
    path: Path, rows: dict[int, list[str]], what: str, first: str = "time"
) -> tuple[dict[str, NDArray], list[str]]:
    """Columns by name of a table of numbers whose width says what they are."""
    text = head_rows(path)
    if text is None:
        doubles = head_doubles(path, 7) if 7 in rows and len(rows) == 1 else None
        if doubles is None:
            raise InputError(f"{path.name}: not rows of numbers, needed {what}")
        return read_columns(path, LayoutKeys(format="binary", columns=ROW_COLUMNS), ROW_COLUMNS)
    head, layout = text
    refuse_other_width(head, list(rows), path.name, what)
    names = [first, *rows[head.shape[1]]]
    return read_columns(path, layout.model_copy(update={"columns": names}), names)


def _fixes_of(path: Path, gps_week: int | None) -> tuple[RawFixes, list[str]]:
    """The fixes of KF-GINS' own file, or of one that RTKLIB wrote."""
    if not is_solution(path):
        return _fixes(path, gps_week)
    raw, notes = read_solution(path)
    return on_gps_week(raw), notes


def _fixes(path: Path, gps_week: int | None) -> tuple[RawFixes, list[str]]:
    columns, notes = _table(path, GNSS_ROWS, "time, lat, lon, height, [velocity,] sigmas")
    time_s = week_unwrapped(columns["time"])
    none = np.full(time_s.size, np.nan)
    v_n = np.column_stack([columns.get(name, none) for name in SPEED])
    if SPEED[0] in columns:
        notes = [
            *notes,
            f"{path.name}: {len(columns)} columns: velocity north, east, down, then sigmas",
        ]
    north, east, down = (columns[name] for name in SIGMA)
    least = float(np.fmin.reduce([north, east, down], axis=None, initial=np.inf))
    if least < 0:
        raise InputError(
            f"{path.name}: a sigma of {least:g} m, needed more than 0: a file of fixes?"
        )
    if may_be_radians(columns[PLACE[0]], columns[PLACE[1]]):
        told = f"{largest(columns[PLACE[0]]):g} and {largest(columns[PLACE[1]]):g}"
        raise InputError(
            f"{path.name}: latitudes and longitudes up to {told}, needed degrees: radians?"
        )
    speed = np.sqrt(np.mean([columns.get(name, none) ** 2 for name in SPEED_SIGMA], axis=0))
    unix_s = none if gps_week is None else unix_seconds(gps_seconds(gps_week, time_s))
    return (
        RawFixes(
            log_s=time_s,
            is_3d=np.ones(time_s.size, dtype=bool),
            lat_deg=columns[PLACE[0]],
            lon_deg=columns[PLACE[1]],
            height_m=columns[PLACE[2]],
            v_n_m_s=v_n,
            unix_s=unix_s,
            sigmas=np.stack([np.sqrt((north**2 + east**2) / 2), down, speed]),
        ),
        notes,
    )


def _with_truth(log: ConvertedLog, path: Path) -> ConvertedLog:
    """The log with the ground truth as reference; its week gives the date, its first row the
    place.
    """
    columns, notes = _table(
        path, {11: TRUTH_ROW[1:]}, "week, time, position, velocity, attitude", first="week"
    )
    time_s = week_unwrapped(columns["time"])
    log = with_reference(
        log,
        {
            "time_s": time_s,
            "lat_rad": columns[PLACE[0]] * DEG,
            "lon_rad": columns[PLACE[1]] * DEG,
            "height_m": columns[PLACE[2]],
            "v_n_m_s": np.column_stack([columns[name] for name in SPEED]),
            **{f"{name}_rad": columns[name] * DEG for name in ("roll", "pitch", "heading")},
        },
        label=path.name,
    )
    place = {
        name: float(columns[k][0]) for name, k in zip(("lat_deg", "lon_deg", "height_m"), PLACE)
    }
    start, told = _date(int(columns["week"][0]), log.time_shift_s, path.name)
    header = {"site": place, **start, **log.header}
    notes += told if "start_utc" not in header else []
    return replace(
        log, notes=(*log.notes, *notes), other_files=(*log.other_files, path), header=header
    )


def _date(gps_week: int | None, shift_s: float, label: str) -> tuple[dict[str, str], list[str]]:
    return (
        ({}, [])
        if gps_week is None
        else dated(float(unix_seconds(gps_seconds(gps_week, shift_s))), label)
    )


def detect(path: Path) -> bool:
    """Seven numbers a row, text or doubles, with the time in front and gravity in the velocity
    increments.
    """
    text = head_rows(path)
    return are_increments(text[0] if text else head_doubles(path, 7), time=0, accel=4)


READERS = (
    Reader(
        name="kfgins",
        about="KF-GINS text or doubles: time, dtheta, dvel",
        detect=detect,
        read=read,
        gnss_file=True,
    ),
)
