"""Clocks of a log that start again: counters of so many bits, the GPS week, the day, the hour, the
minute; and stamps that a host gave to rows as they arrived, many at a time.
"""

import datetime

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import uniform_filter1d

from trajectories.runs.checks import MAX_GAP_S
from trajectories.runs.notes import About, Note
from trajectories.runs.text_rows import MAX_BAD

WRAPS = {  # [s] after which a clock starts again
    2**32 * 1e-6: "32 bits of microseconds",
    2**32 * 1e-4: "32 bits of 0.1 milliseconds",
    2**32 * 1e-3: "32 bits of milliseconds",
    604_800.0: "GPS week",
    86_400.0: "day",
}
SHORT_WRAPS = {3600.0: "hour", 2**16 * 1e-3: "16 bits of milliseconds", 60.0: "minute"}
# rows lost while a clock wraps; of a short one no more than a run's longest gap
MAX_WRAP_GAP_S = 60.0
# 58 s: the shortest period, less the longest gap at either side of the wrap
FALL_S = min(SHORT_WRAPS) - 2 * MAX_GAP_S

# of the mean interval: rows of a burst follow each other by less, at the speed of the host's loop;
# a unit that loses every other row is at 0.5
BURST_INTERVAL = 0.4
# over which the number of rows counts time: 500 rows of 100 Hz. Serial and USB buffers hold 0.05 s
EVEN_OVER_S = 5.0
# of the variance that lost rows give to a sum of intervals: bursts make up for their pauses, and a
# sum of 500 varies by one pause
MADE_UP = 0.2
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


def evened(time_s: NDArray) -> NDArray | None:
    """Times (n,) of rows that were stamped in bursts, with the rows spread evenly over
    EVEN_OVER_S; None where stamps show no bursts.

    A pause that fast rows make up for is a buffer's; one that they do not is a loss of rows.
    """
    steps = np.diff(time_s)
    mean = float(time_s[-1] - time_s[0]) / max(steps.size, 1)
    half = round(0.5 * EVEN_OVER_S / mean) if mean > 0 else 0
    if half < 2 or steps.size < 8 * half or np.median(steps) > BURST_INTERVAL * mean:
        return None
    sums = time_s[2 * half :] - time_s[: -2 * half]
    if np.var(sums) > MADE_UP * 2 * half * np.var(steps):
        return None
    wide = np.pad(time_s, half, mode="reflect", reflect_type="odd")
    return np.asarray(uniform_filter1d(wide, 2 * half + 1)[half:-half])


def going_on(time_s: NDArray) -> tuple[NDArray, list[tuple[int, float, str]]]:
    """Times (n,) that go on where the clock started again, and where: index of the row, period
    added from there, its name.

    It went back by a known period and stayed there. A clock that wraps after an hour or less never
    shows more than that: else a clock set back by just as much, or a block of rows written twice,
    would be taken for one.
    """
    finite = np.flatnonzero(np.isfinite(time_s))
    t = time_s[finite]
    with np.errstate(over="ignore"):
        falls = np.flatnonzero(np.diff(t) < -FALL_S)
    periods = {**WRAPS, **{p: name for p, name in SHORT_WRAPS.items() if _within(t, p)}}
    found, shift = [], np.zeros(t.size)
    for k in falls.tolist():
        period_s = _period(t, k, periods)
        if period_s:
            shift[k + 1] = period_s
            found.append((int(finite[k + 1]), period_s, periods[period_s]))
    out = time_s.copy()
    out[finite] = t + np.cumsum(shift)
    return out, found


def _within(t: NDArray, period_s: float) -> bool:
    return bool(np.count_nonzero((t < 0) | (t > period_s)) <= MAX_BAD * t.size)


def _period(t: NDArray, k: int, periods: dict[float, str]) -> float:
    """The period by which the clock fell after row k; 0 where it is none. Medians: a single time
    may be garbled.
    """
    before, after = np.median(t[max(k - 2, 0) : k + 1]), np.median(t[k + 1 : k + 4])
    for period_s in periods:
        gap_s = MAX_GAP_S if period_s in SHORT_WRAPS else MAX_WRAP_GAP_S
        if 0 < after + period_s - before <= gap_s:
            return period_s
    return 0.0


def unwrapped(
    time_s: NDArray, start_s: float, end_s: float, periods_s: tuple[float, ...]
) -> NDArray:
    """Times of another stream on a clock that wrapped: as they are where any lies in start_s to
    end_s, else a period later.

    `periods_s`: what was added to the clock at each of its wraps.
    """
    time_s, _ = going_on(time_s)
    for shift_s in (0.0, *np.cumsum(periods_s).tolist()):
        if np.any((time_s + shift_s >= start_s) & (time_s + shift_s <= end_s)):
            return np.asarray(time_s + shift_s)
    return time_s


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


def week_unwrapped(time_of_week_s: NDArray) -> NDArray:
    """Seconds from the first row's week on, shape (n,): a fall by more than half a week is the next
    week.
    """
    falls = np.diff(time_of_week_s, prepend=time_of_week_s[:1]) < -WEEK_S / 2
    return time_of_week_s + WEEK_S * np.cumsum(falls)
