"""GPS messages of an ArduPilot log as fixes.

Decision: docs/decisions/0040-known-by-gravity.md.
"""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from ins.units import DEG
from trajectories.readers.columns.fix_types import AUTOPILOT, fix_types
from trajectories.readers.columns.fixes import MATCH_S, LoggedFixes, RawFixes, good_fixes
from trajectories.readers.rows.clocks import going_on
from trajectories.readers.rows.gps_time import gps_seconds, unix_seconds
from trajectories.runs.notes import About, Note

Table = Mapping[str, NDArray]
NEEDED = ("Status", "Lat", "Lng", "Alt", "Spd", "GCrs", "VZ")
STATUS_3D = 3  # Status; 4 and more are differential and carrier-phase fixes
GEOID_NOTE = "GPS heights are above mean sea level, as logged (the ellipsoid is up to 110 m off)"
# Message with the receiver's own accuracy, and its horizontal [m], vertical [m] and speed [m/s]
# columns.
ACCURACY = (("GPA", ("HAcc", "VAcc", "SAcc")), ("UBX3", ("hAcc", "vAcc", "sAcc")))


def fixes(tables: Mapping[str, Table], *, label: str) -> tuple[LoggedFixes | None, list[str]]:
    """The 3D fixes of one receiver, and notes on those left out; None where there is none."""
    table = tables.get("GPS")
    if table is None:
        return None, [Note(f"{label}: no GPS message: no gnss stream", About.FIXES)]
    clock = log_clock(table, ("TimeUS", "T"))
    missing = [k for k in NEEDED if k not in table]
    if clock is None or missing:
        return None, [
            f"{label}: GPS messages without {missing[0] if missing else 'time of the log'}: no gnss"
            " stream"
        ]
    told: list[str] = []
    if "I" in table:
        number = _receiver(table)
        of_it = table["I"] == number
        table, clock = {k: v[of_it] for k, v in table.items()}, clock[of_it]
        if number:
            told = [f"{label}: GPS {number:g} taken: the first has no 3D fix"]
    clock, course = going_on(clock)[0], table["GCrs"] * DEG
    with np.errstate(invalid="ignore"):
        v_n = np.stack(
            [table["Spd"] * np.cos(course), table["Spd"] * np.sin(course), table["VZ"]], axis=1
        )
        raw = RawFixes(
            log_s=clock,
            is_3d=table["Status"] >= STATUS_3D,
            lat_deg=table["Lat"],
            lon_deg=table["Lng"],
            height_m=table["Alt"],
            v_n_m_s=v_n,
            unix_s=_unix(table),
            sigmas=_sigmas(tables, clock),
            fix_type=fix_types(table["Status"], AUTOPILOT),
        )
    found, notes = good_fixes(raw, label=label)
    notes = [*told, *notes]
    return found, notes if found is None else [*notes, f"{label}: {GEOID_NOTE}"]


def _receiver(table: Table) -> float:
    """The first receiver; where it never has a 3D fix, the one with most of them. Never two: their
    antennas lie apart.
    """
    placed = table["I"][table["Status"] >= STATUS_3D]
    if not placed.size or np.any(placed == 0):
        return 0.0
    numbers, counts = np.unique(placed, return_counts=True)
    return float(numbers[np.argmax(counts)])


def log_clock(table: Table, names: tuple[str, ...]) -> NDArray | None:
    """Log time [s] of a message: microseconds in TimeUS, milliseconds in the others."""
    for name in names:
        if name in table:
            return table[name] * (1e-6 if name == "TimeUS" else 1e-3)
    return None


def _unix(table: Table) -> NDArray:
    """UTC [s] from week and milliseconds of the week; NaN where the log has neither."""
    week, tow_ms = table.get("Week", table.get("GWk")), table.get("GMS", table.get("TimeMS"))
    if week is None or tow_ms is None:
        return np.full(table["Lat"].size, np.nan)
    return unix_seconds(gps_seconds(week, tow_ms * 1e-3))


def _sigmas(tables: Mapping[str, Table], time_s: NDArray) -> NDArray | None:
    """The receiver's own accuracy (3, n) from the message beside each fix, NaN where none is."""
    for name, columns in ACCURACY:
        table = tables.get(name, {})
        clock = log_clock(table, ("TimeUS", "TimeMS"))
        if clock is not None and clock.size >= 2 and set(columns) <= set(table):
            clock = going_on(clock)[0]
            nearest = _nearest(clock, time_s)
            sigmas = np.stack([table[k][nearest] for k in columns])
            return np.where(np.abs(clock[nearest] - time_s) <= MATCH_S, sigmas, np.nan)
    return None


def _nearest(clock: NDArray, time_s: NDArray) -> NDArray:
    """Index of the value of an ascending clock (disorder costs a match, no more) nearest to each
    time.
    """
    after = np.clip(np.searchsorted(clock, time_s), 1, clock.size - 1)
    return after - (time_s - clock[after - 1] < clock[after] - time_s)
