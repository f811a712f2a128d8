"""Fixes that RTKLIB computed: a solution file (.pos) of rtkpost, rnx2rtkp, rtknavi and what writes
like them.

Lines that begin with "%" are its head; the last of them names the columns. Times are dates or GPS
weeks and seconds, of GPS time or UTC; fields stand between white space, commas or semicolons.
Source: RTKLIB ver. 2.4.2 manual, appendix B.1 (solution file), and the files of
github.com/rtklibexplorer/GNSS_IMU.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ins.records import InputError
from trajectories.readers.columns.fix_types import RTKLIB, fix_types
from trajectories.readers.columns.fixes import RawFixes
from trajectories.readers.columns.text_columns import HEADER_BYTES, text_columns
from trajectories.readers.rows.clocks import (
    GPS_EPOCH_UNIX_S,
    WEEK_S,
    gps_of_unix,
    gps_seconds,
    unix_seconds,
)
from trajectories.readers.rows.column_map import LayoutKeys
from trajectories.runs.notes import About, Note
from trajectories.runs.text_rows import text_parts

SOLUTION_PLACE = ("latitude(deg)", "longitude(deg)", "height(m)")
SOLUTION_CLOCKS = ("GPST", "UTC")
SOLUTION_DATE = ("year", "month", "day", "hour", "minute", "second")
SOLUTION_WEEK = ("week", "tow")
FIRST_DATE = (1980, 1, 1)  # GPS time begins on 1980-01-06
LAST_DATE = (2096, 12, 31)  # 4e9 s since 1970, the last of rows.clocks.UNIX_S
SOLUTION_QUALITY = "Q"
SOLUTION_SIGMAS = ("sdn", "sde", "sdu")
SOLUTION_SPEED = ("vn", "ve", "vu")
SOLUTION_SPEED_SIGMAS = ("sdvn", "sdve", "sdvu")
SOLUTION_OTHERS = {  # how else positions are written, and what writes them as needed here
    "latitude(d'\")": "degrees, minutes and seconds, needed degrees (out-outpos deg)",
    "x-ecef(m)": "x, y, z of the Earth, needed latitude and longitude (out-solformat llh)",
    "e-baseline(m)": "a baseline, needed latitude and longitude (out-solformat llh)",
}
SOLUTION_BETWEEN = bytes.maketrans(b"/:,;", b"    ")


@dataclass(frozen=True)
class _Head:
    """What the head says: the clock, the names of the columns behind the time, whether heights are
    above the geoid.
    """

    clock: str
    names: tuple[str, ...]
    geoid: bool


def is_solution(path: Path) -> bool:
    """Whether the head of a file names the columns of a solution.

    Parameters
    ----------
    path : Path
        A file, plain or in gzip.
    """
    return _names_line(_head_lines(path)) is not None


def read_solution(path: Path) -> tuple[RawFixes, list[str]]:
    """The fixes of a solution file, and notes on what was dropped.

    Parameters
    ----------
    path : Path
        Known by `is_solution`.

    Returns
    -------
    fixes : RawFixes
        `log_s` is UTC [s] since 1970, as `unix_s`; rows of quality 0 are no fix.
    notes : list of str

    Raises
    ------
    InputError
        Positions, or a clock, that are written in another way; a row that is none.
    """
    lines = _head_lines(path)
    head = _head(lines, path.name)
    dated = _is_dated(lines)
    names = (*(SOLUTION_DATE if dated else SOLUTION_WEEK), *head.names)
    layout = LayoutKeys(format="text", comment="%", header_lines=0, columns=list(names))
    wanted = {
        *SOLUTION_DATE,
        *SOLUTION_WEEK,
        SOLUTION_QUALITY,
        *SOLUTION_SIGMAS,
        *SOLUTION_SPEED,
        *SOLUTION_SPEED_SIGMAS,
    }
    used = [*SOLUTION_PLACE, *(name for name in names if name in wanted)]
    columns, notes = text_columns(path, layout, used, rewrite=_parted)
    if head.geoid:
        told = f"{path.name}: heights are above the geoid, not above the ellipsoid"
        notes = [*notes, Note(told, About.FIXES)]
    unix_s = _unix(columns, head.clock)
    return _fixes(columns, unix_s), notes


def on_gps_week(raw: RawFixes) -> RawFixes:
    """The fixes on a clock of seconds of the GPS week in which they begin."""
    gps_s = gps_of_unix(raw.unix_s)
    first = float(np.min(gps_s, initial=np.inf, where=np.isfinite(gps_s)))
    if not np.isfinite(first):
        return raw
    return replace(raw, log_s=gps_s - WEEK_S * np.floor(first / WEEK_S))


def on_clock(raw: RawFixes, epoch: str | None, label: str) -> RawFixes:
    """The fixes on a log's clock that counts from a known date. InputError where it does not."""
    if epoch is None:
        raise InputError(
            f'{label}: its fixes have dates, needed epoch = "unix" or "gps" in [time] of the map'
        )
    return raw if epoch == "unix" else replace(raw, log_s=gps_of_unix(raw.unix_s))


def _head_lines(path: Path) -> list[str]:
    """The lines of the head and the first behind it; empty where the file does not begin with
    one.
    """
    text = b""
    try:
        for part in islice(text_parts(path, [], block_bytes=HEADER_BYTES), 2):
            text += part
    except InputError:
        return []
    lines = text[:HEADER_BYTES].decode("utf-8", errors="replace").splitlines()
    count = next((k for k, line in enumerate(lines) if not line.startswith("%")), len(lines))
    return lines[: count + 1] if count else []


def _names_line(lines: list[str]) -> list[str] | None:
    """Clock and names of the columns; None where no line of the head names them."""
    for line in reversed(lines):
        words = re.split(r"[\s,;]+", line.lstrip("%").strip()) if line.startswith("%") else []
        if len(words) > len(SOLUTION_PLACE) and words[1] in (SOLUTION_PLACE[0], *SOLUTION_OTHERS):
            return words
    return None


def _head(lines: list[str], label: str) -> _Head:
    words = _names_line(lines)
    assert words is not None  # is_solution was asked
    clock, *names = words
    if names[0] in SOLUTION_OTHERS:
        raise InputError(f"{label}: positions are {SOLUTION_OTHERS[names[0]]}")
    if clock not in SOLUTION_CLOCKS:
        raise InputError(f"{label}: times are {clock[:20]}, needed {' or '.join(SOLUTION_CLOCKS)}")
    return _Head(
        clock=clock,
        names=tuple(
            name if name in SOLUTION_PLACE else re.sub(r"\(.*\)$", "", name) for name in names
        ),
        geoid=any("WGS84/geodetic" in line for line in lines),
    )


def _is_dated(lines: list[str]) -> bool:
    """Whether the first row begins with a date; else with a GPS week."""
    return "/" in lines[-1].split()[0] if lines[-1].split() else True


def _parted(text: bytes) -> bytes:
    """Rows with white space alone between their numbers, dates in parts."""
    return text.translate(SOLUTION_BETWEEN)


def _unix(columns: Mapping[str, NDArray], clock: str) -> NDArray:
    """UTC [s] since 1970; NaN for a row that was damaged."""
    if SOLUTION_WEEK[0] in columns:
        gps_s = gps_seconds(columns[SOLUTION_WEEK[0]], columns[SOLUTION_WEEK[1]])
    else:
        hour, minute, second = (columns[name] for name in SOLUTION_DATE[3:])
        counted = 86_400.0 * _days(columns) + 3600.0 * hour + 60.0 * minute + second
        gps_s = counted - GPS_EPOCH_UNIX_S
    return unix_seconds(gps_s) if clock == "GPST" else np.asarray(gps_s + GPS_EPOCH_UNIX_S)


def _days(columns: Mapping[str, NDArray]) -> NDArray:
    """Days since 1970 of dates; NaN for what is none."""
    date = np.column_stack([columns[name] for name in SOLUTION_DATE[:3]])
    with np.errstate(invalid="ignore"):
        sane = np.all((date >= FIRST_DATE) & (date <= LAST_DATE), axis=1)
    year, month, day = np.where(sane[:, None], date, FIRST_DATE).astype(np.int64).T
    months = (year - 1970).astype("datetime64[Y]") + (month - 1).astype("timedelta64[M]")
    days = months.astype("datetime64[D]").astype(np.int64) + day - 1
    return np.where(sane, days, np.nan)


def _fixes(columns: Mapping[str, NDArray], unix_s: NDArray) -> RawFixes:
    lat, lon, height = (columns[name] for name in SOLUTION_PLACE)
    v_n = np.full((unix_s.size, 3), np.nan)
    if set(SOLUTION_SPEED) <= set(columns):
        v_n = np.column_stack([columns[name] for name in SOLUTION_SPEED]) * [1.0, 1.0, -1.0]
    none = np.full(unix_s.size, np.nan)
    north, east, up = (columns.get(name, none) for name in SOLUTION_SIGMAS)
    speed = np.stack([columns.get(name, none) for name in SOLUTION_SPEED_SIGMAS])
    return RawFixes(
        log_s=unix_s,
        is_3d=columns[SOLUTION_QUALITY] > 0
        if SOLUTION_QUALITY in columns
        else np.ones(unix_s.size, dtype=bool),
        lat_deg=lat,
        lon_deg=lon,
        height_m=height,
        v_n_m_s=v_n,
        unix_s=unix_s,
        sigmas=np.stack(
            [np.sqrt(0.5 * (north**2 + east**2)), up, np.sqrt(np.mean(speed**2, axis=0))]
        ),
        fix_type=fix_types(columns[SOLUTION_QUALITY], RTKLIB)
        if SOLUTION_QUALITY in columns
        else None,
    )
