"""GPS messages of an ArduPilot log: fixes, the site, and what UTC the log's clock shows."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from ins.records import GnssLog
from ins.units import DEG
from trajectories.readers.columns import row_ranges
from trajectories.readers.gps_time import gps_seconds

Table = Mapping[str, NDArray]
FIX_3D = 3  # Status; 4 and more are differential and carrier-phase fixes
MAX_JUMP_DEG = 0.01  # between a fix and the median of five: 1.1 km, no aircraft at 5 Hz
MAX_SPEED_M_S = 1000.0
EARLIEST_WEEK, LATEST_WEEK = 1000, 4000  # 1999 to 2056
MATCH_S = 0.15  # between a fix and the message of its accuracy, logged beside it
GEOID_NOTE = "GPS heights are above mean sea level, as logged (the ellipsoid is up to 110 m off)"
# Message with the receiver's own accuracy, and its horizontal [m], vertical [m] and speed [m/s] columns.
ACCURACY = (("GPA", ("HAcc", "VAcc", "SAcc")), ("UBX3", ("hAcc", "vAcc", "sAcc")))


@dataclass(frozen=True, kw_only=True)
class Fixes:
    """The good fixes on the log's own clock [s], and GPS seconds less log seconds (None where no fix has both)."""

    gnss: GnssLog
    gps_less_log_s: float | None

    def site_at(self, log_s: float) -> dict[str, Any]:
        """run.json keys of the first fix from a log time on (the last one where all are earlier)."""
        k = min(int(np.searchsorted(self.gnss.time_s, log_s)), self.gnss.time_s.size - 1)
        first = (self.gnss.lat_rad[k] / DEG, self.gnss.lon_rad[k] / DEG, self.gnss.height_m[k])
        return {k: round(float(v), 7) for k, v in zip(("lat_deg", "lon_deg", "height_m"), first)}


def fixes(tables: Mapping[str, Table], *, label: str) -> tuple[Fixes | None, list[str]]:
    """The 3D fixes of the first receiver, and notes on those left out; None where there is none."""
    table = tables.get("GPS")
    if table is None:
        return None, [f"{label}: no GPS message: no gnss stream"]
    clock = log_clock(table, ("TimeUS", "T"))
    missing = [k for k in ("Status", "Lat", "Lng", "Alt", "Spd", "GCrs", "VZ") if k not in table]
    if clock is None or missing:
        return None, [f"{label}: GPS messages without {missing[0] if missing else 'time of the log'}: no gnss stream"]
    rows, notes = _good_rows(table, clock, label)
    if not rows.size:
        return None, [*notes, f"{label}: no 3D fix: no gnss stream"]
    course = table["GCrs"][rows] * DEG
    v_n = np.stack([table["Spd"][rows] * np.cos(course), table["Spd"][rows] * np.sin(course), table["VZ"][rows]], axis=1)
    gnss = GnssLog(
        time_s=clock[rows], lat_rad=table["Lat"][rows] * DEG, lon_rad=table["Lng"][rows] * DEG,
        height_m=table["Alt"][rows], v_n_m_s=v_n, **_sigmas(tables, clock[rows]),
    )  # fmt: skip
    return Fixes(gnss=gnss, gps_less_log_s=_gps_less_log(table, clock, rows)), [*notes, f"{label}: {GEOID_NOTE}"]


def log_clock(table: Table, names: tuple[str, ...]) -> NDArray | None:
    """Log time [s] of a message: microseconds in TimeUS, milliseconds in the others."""
    for name in names:
        if name in table:
            return table[name] * (1e-6 if name == "TimeUS" else 1e-3)
    return None


def _good_rows(table: Table, clock: NDArray, label: str) -> tuple[NDArray, list[str]]:
    """Indices of the 3D fixes that are finite, in order of time and where their neighbours are."""
    columns = np.stack([clock, *(table[k] for k in ("Lat", "Lng", "Alt", "Spd", "GCrs", "VZ"))])
    with np.errstate(invalid="ignore"):
        fixed = table["Status"] >= FIX_3D
        finite = np.isfinite(columns).all(axis=0)
        sane = (np.abs(columns[1]) <= 90) & (np.abs(columns[2]) <= 180) & (np.abs(columns[3]) < 30_000)
        sane &= (np.abs(columns[4:]) < MAX_SPEED_M_S).all(axis=0)
    rows = np.flatnonzero(fixed & finite & sane)
    near = np.all([_jump(columns[k, rows]) <= MAX_JUMP_DEG for k in (1, 2)], axis=0) & (_jump(clock[rows]) <= 10.0)
    placed = rows[near]
    later = clock[placed] > np.concatenate([[-np.inf], np.maximum.accumulate(clock[placed])[:-1]])
    left_out = {
        "no 3D fix": np.flatnonzero(~fixed),
        "not finite or beyond any aircraft": np.flatnonzero(fixed & ~(finite & sane)),
        "time or position jumps and comes back": rows[~near],
        "time repeats or goes back": placed[~later],
    }
    return placed[later], [f"{label}: GPS {row_ranges(r)} left out: {why}" for why, r in left_out.items() if r.size]


def _jump(values: NDArray) -> NDArray:
    """Distance of each value from the median of the five around it."""
    return np.abs(values - median_filter(values, size=5, mode="mirror")) if values.size else values


def _sigmas(tables: Mapping[str, Table], time_s: NDArray) -> dict[str, NDArray]:
    """The receiver's own accuracy where every fix has one, under the names of `GnssLog`."""
    for name, columns in ACCURACY:
        table = tables.get(name, {})
        clock = log_clock(table, ("TimeUS", "TimeMS"))
        if clock is None or clock.size < 2 or not set(columns) <= set(table):
            continue
        nearest = _nearest(clock, time_s)
        sigmas = np.stack([table[k][nearest] for k in columns])
        with np.errstate(invalid="ignore"):
            if np.all(np.abs(clock[nearest] - time_s) <= MATCH_S) and np.all((sigmas > 0) & (sigmas < 1e6)):
                return dict(zip(("sigma_horizontal_m", "sigma_vertical_m", "sigma_velocity_m_s"), sigmas))
    return {}


def _nearest(clock: NDArray, time_s: NDArray) -> NDArray:
    """Index of the value of an ascending clock (disorder costs a match, no more) nearest to each time."""
    after = np.clip(np.searchsorted(clock, time_s), 1, clock.size - 1)
    return after - (time_s - clock[after - 1] < clock[after] - time_s)


def _gps_less_log(table: Table, clock: NDArray, rows: NDArray) -> float | None:
    """Median over the fixes of GPS seconds (week, milliseconds) less log seconds."""
    week, tow_ms = table.get("Week", table.get("GWk")), table.get("GMS", table.get("TimeMS"))
    if week is None or tow_ms is None:
        return None
    good = rows[(week[rows] >= EARLIEST_WEEK) & (week[rows] <= LATEST_WEEK)]
    return float(np.median(gps_seconds(week[good], tow_ms[good] * 1e-3) - clock[good])) if good.size else None
