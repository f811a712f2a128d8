"""GPS week and time of week to UTC."""

import datetime

import numpy as np
from numpy.typing import ArrayLike, NDArray

from trajectories.runs.notes import About, Note

GPS_EPOCH_UNIX_S = 315_964_800.0  # 1980-01-06
WEEK_S = 604_800.0  # 7 x 86 400
# 1999-08-22 to 2096: a receiver that knows the date. Weeks before (below 1024) are unknown, or
# counted modulo 1024.
UNIX_S = (935_280_000.0, 4_000_000_000.0)
# GPS time less UTC [s] from a UTC date on (IERS Bulletin C 37, 39, 43, 49, 52); none announced
# since.
LEAP_SECONDS = (
    (1999, 1, 13),
    (2006, 1, 14),
    (2009, 1, 15),
    (2012, 7, 16),
    (2015, 7, 17),
    (2017, 1, 18),
)


def gps_seconds(week: ArrayLike, time_of_week_s: ArrayLike) -> NDArray:
    """Seconds since 1980-01-06, shape (...); the week counted in full (not modulo 1024)."""
    return np.asarray(week, dtype=float) * WEEK_S + np.asarray(time_of_week_s, dtype=float)


def unix_seconds(gps_s: ArrayLike) -> NDArray:
    """UTC as seconds since 1970, shape (...), of seconds since 1980-01-06 GPS time (1999 or
    later).
    """
    gps_s = np.asarray(gps_s, dtype=float)
    leap_s = np.full(gps_s.shape, float(LEAP_SECONDS[0][2]))
    for year, month, seconds in LEAP_SECONDS:
        since = (
            datetime.datetime(year, month, 1, tzinfo=datetime.UTC).timestamp() - GPS_EPOCH_UNIX_S
        )
        leap_s[gps_s - seconds >= since] = seconds
    return gps_s + GPS_EPOCH_UNIX_S - leap_s


def gps_of_unix(unix_s: ArrayLike) -> NDArray:
    """Seconds since 1980-01-06 GPS time, shape (...), of UTC as seconds since 1970 (1999 or
    later).
    """
    unix_s = np.asarray(unix_s, dtype=float)
    leap_s = np.full(unix_s.shape, float(LEAP_SECONDS[0][2]))
    for year, month, seconds in LEAP_SECONDS:
        leap_s[unix_s >= datetime.datetime(year, month, 1, tzinfo=datetime.UTC).timestamp()] = (
            seconds
        )
    return unix_s - GPS_EPOCH_UNIX_S + leap_s


def utc_text(unix_s: float) -> str:
    """UTC to the millisecond, such as 2013-11-29T22:00:00.678Z, of seconds since 1970."""
    utc = datetime.datetime(1970, 1, 1, tzinfo=datetime.UTC) + datetime.timedelta(
        milliseconds=round(unix_s * 1e3)
    )
    return utc.isoformat(timespec="milliseconds").replace("+00:00", "Z")


def dated(unix_s: float, label: str) -> tuple[dict[str, str], list[str]]:
    """start_utc of run.json; none, and a note, where a clock does not show the date: before the
    week was known, a week counted modulo 1024, seconds since boot, another unit.
    """
    if UNIX_S[0] < unix_s < UNIX_S[1]:
        return {"start_utc": utc_text(unix_s)}, []
    told = (
        f"{label}: its clock shows {_year(unix_s)}: no date (week unknown or modulo 1024? unit?),"
        " --start-utc gives it"
    )
    return {}, [Note(told, About.DATE)]


def _year(unix_s: float) -> str:
    try:
        return f"the year {datetime.datetime.fromtimestamp(unix_s, datetime.UTC).year}"
    except (ValueError, OverflowError, OSError):
        return f"{unix_s:.4g} s since 1970"


def unwrapped(time_of_week_s: NDArray) -> NDArray:
    """Seconds from the first row's week on, shape (n,): a fall by more than half a week is the next
    week.
    """
    falls = np.diff(time_of_week_s, prepend=time_of_week_s[:1]) < -WEEK_S / 2
    return time_of_week_s + WEEK_S * np.cumsum(falls)
