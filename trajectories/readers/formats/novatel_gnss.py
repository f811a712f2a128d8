"""Fixes of a NovAtel log: positions without the inertial unit, each with the velocity of its
moment.
"""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from ins.units import DEG
from trajectories.readers.columns.fixes import RawFixes
from trajectories.readers.formats.novatel_tables import POSITION_LOGS, VELOCITY_LOGS, Table
from trajectories.readers.rows.gps_time import gps_seconds, unix_seconds
from trajectories.runs.notes import About, Note

PAIRS = tuple(zip(POSITION_LOGS, VELOCITY_LOGS))
# between the velocities on either side of a position; chosen: 1 s apart, and half
MAX_BRACKET_S = 1.5


def fixes(
    tables: Mapping[str, Table], week: int, *, label: str
) -> tuple[RawFixes | None, list[str]]:
    """Fixes on seconds from the start of a GPS week, and notes; None where the log has no
    position.
    """
    names = next((pair for pair in PAIRS if pair[0] in tables), None)
    if names is None:
        return None, [Note(f"{label}: no BESTGNSSPOS or BESTPOS: no gnss stream", About.FIXES)]
    found = tables[names[0]]
    inertial = found["inertial"]
    notes = [
        f"{label}: {names[0]}: {np.count_nonzero(inertial)} inertial solutions are no fixes,"
        " left out"
    ]
    notes = notes if inertial.any() else []
    found = {name: values[~inertial] for name, values in found.items()}
    if not found["week"].size:
        return None, [*notes, Note(f"{label}: no fix in {names[0]}: no gnss stream", About.FIXES)]
    gps_s = gps_seconds(found["week"] - week, found["seconds"])
    v_n = _velocities(tables.get(names[1]), gps_s, week)
    notes += [] if np.isfinite(v_n).any() else [f"{label}: no {names[1]} beside the positions"]
    return (
        RawFixes(
            log_s=gps_s,
            is_3d=found["computed"],
            lat_deg=found["lat"],
            lon_deg=found["lon"],
            height_m=found["height"],
            v_n_m_s=v_n,
            unix_s=unix_seconds(gps_seconds(found["week"], found["seconds"])),
            sigmas=np.stack(
                [
                    np.hypot(found["north"], found["east"]) / np.sqrt(2),
                    found["up"],
                    np.full(gps_s.size, np.nan),
                ]
            ),
            fix_type=found["fix_type"],
        ),
        notes,
    )


def _velocities(table: Table | None, time_s: NDArray, week: int) -> NDArray:
    """North, east, down [m/s] at given times, between velocities that hold at their stamp less
    their latency.
    """
    good = np.zeros(0, dtype=bool) if table is None else table["computed"] & ~table["inertial"]
    if table is None or np.count_nonzero(good) < 2:
        return np.full((time_s.size, 3), np.nan)
    found = {name: values[good] for name, values in table.items()}
    at_s = gps_seconds(found["week"] - week, found["seconds"]) - found["latency"]
    order, track = np.argsort(at_s, kind="stable"), found["track"] * DEG
    v_n = np.column_stack(
        [found["speed"] * np.cos(track), found["speed"] * np.sin(track), -found["up"]]
    )[order]
    at_s = at_s[order]
    k = np.clip(np.searchsorted(at_s, time_s), 1, at_s.size - 1)
    between = (
        (at_s[k - 1] <= time_s) & (time_s <= at_s[k]) & (at_s[k] - at_s[k - 1] <= MAX_BRACKET_S)
    )
    beside = (
        np.minimum(np.abs(time_s - at_s[k - 1]), np.abs(at_s[k] - time_s)) <= MAX_BRACKET_S / 3
    )  # before the first, after the last
    out = np.column_stack([np.interp(time_s, at_s, v_n[:, axis]) for axis in range(3)])
    out[~(between | beside)] = np.nan
    return out
