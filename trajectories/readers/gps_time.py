"""GPS week and time of week to UTC."""

import datetime

import numpy as np
from numpy.typing import ArrayLike, NDArray

GPS_EPOCH = datetime.datetime(1980, 1, 6, tzinfo=datetime.UTC)
WEEK_S = 604_800.0
# GPS time less UTC [s] from a UTC date on (IERS Bulletin C 37, 39, 43, 49, 52); none announced since.
LEAP_SECONDS = ((1999, 1, 13), (2006, 1, 14), (2009, 1, 15), (2012, 7, 16), (2015, 7, 17), (2017, 1, 18))


def gps_seconds(week: ArrayLike, time_of_week_s: ArrayLike) -> NDArray:
    """Seconds since 1980-01-06, shape (...); the week counted in full (not modulo 1024)."""
    return np.asarray(week, dtype=float) * WEEK_S + np.asarray(time_of_week_s, dtype=float)


def utc_text(gps_s: float) -> str:
    """UTC to the millisecond, such as 2013-12-02T22:00:16.000Z, of seconds since 1980-01-06 GPS time (1999 or later)."""
    leap_s = LEAP_SECONDS[0][2]
    for year, month, seconds in LEAP_SECONDS:
        since = datetime.datetime(year, month, 1, tzinfo=datetime.UTC)
        if gps_s - seconds >= (since - GPS_EPOCH).total_seconds():
            leap_s = seconds
    utc = GPS_EPOCH + datetime.timedelta(milliseconds=round((gps_s - leap_s) * 1e3))
    return utc.isoformat(timespec="milliseconds").replace("+00:00", "Z")
