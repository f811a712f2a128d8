"""Fixes of a NovAtel log: positions without the inertial unit, each with the velocity of its
moment.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ins.records import InputError
from ins.units import DEG
from trajectories.readers.columns.fixes import RawFixes
from trajectories.readers.containers.novatel_lines import Logs, columns, of_width
from trajectories.readers.rows.gps_time import gps_seconds, unix_seconds
from trajectories.runs.notes import About, Note

PAIRS = (("BESTGNSSPOS", "BESTGNSSVEL"), ("BESTPOS", "BESTVEL"))
POSITION_FIELDS = (
    "status",
    "type",
    "lat",
    "lon",
    "height",
    "undulation",
    "",
    "north",
    "east",
    "up",
    *[""] * 11,
)
VELOCITY_FIELDS = ("status", "type", "latency", "", "speed", "track", "up", "")
COMPUTED = "SOL_COMPUTED"
INERTIAL = "INS_"
# between the velocities on either side of a position; chosen: 1 s apart, and half
MAX_BRACKET_S = 1.5


def fixes(logs: Logs, week: int, *, label: str) -> tuple[RawFixes | None, list[str]]:
    """Fixes on seconds from the start of a GPS week, and notes; None where the log has no
    position.
    """
    names = next((pair for pair in PAIRS if pair[0] in logs), None)
    if names is None:
        return None, [Note(f"{label}: no BESTGNSSPOS or BESTPOS: no gnss stream", About.FIXES)]
    found = _solutions(logs[names[0]], POSITION_FIELDS, f"{label}: {names[0]}")
    inertial = np.char.startswith(found["type"].astype(str), INERTIAL)
    notes = [
        f"{label}: {names[0]}: {np.count_nonzero(inertial)} inertial solutions are no fixes,"
        " left out"
    ]
    notes = notes if inertial.any() else []
    found = {name: values[~inertial] for name, values in found.items()}
    if not found["type"].size:
        return None, [*notes, Note(f"{label}: no fix in {names[0]}: no gnss stream", About.FIXES)]
    gps_s = gps_seconds(found["week"] - week, found["seconds"])
    v_n = _velocities(logs.get(names[1], []), gps_s, week, f"{label}: {names[1]}")
    notes += [] if np.isfinite(v_n).any() else [f"{label}: no {names[1]} beside the positions"]
    return (
        RawFixes(
            log_s=gps_s,
            is_3d=found["status"] == COMPUTED,
            lat_deg=found["lat"],
            lon_deg=found["lon"],
            height_m=found["height"] + found["undulation"],
            v_n_m_s=v_n,
            unix_s=unix_seconds(gps_seconds(found["week"], found["seconds"])),
            sigmas=np.stack(
                [
                    np.hypot(found["north"], found["east"]) / np.sqrt(2),
                    found["up"],
                    np.full(gps_s.size, np.nan),
                ]
            ),
        ),
        notes,
    )


def _solutions(
    rows: Sequence[tuple[bytes, bytes]], names: Sequence[str], label: str
) -> dict[str, NDArray]:
    """Fields by name of logs with a long header, and its week and seconds; lines of another width
    are left out.
    """
    lines = [
        b",".join([*header.split(b",")[4:6], body])
        for header, body in rows
        if header.count(b",") >= 5
    ]
    whole = of_width(lines, 2 + len(names))
    if not whole:
        raise InputError(f"{label}: no line with {len(names)} fields")
    return columns(
        [lines[k] for k in whole], ["week", "seconds", *names], text=("status", "type"), label=label
    )


def _velocities(
    rows: Sequence[tuple[bytes, bytes]], time_s: NDArray, week: int, label: str
) -> NDArray:
    """North, east, down [m/s] at given times, between velocities that hold at their stamp less
    their latency.
    """
    found = _solutions(rows, VELOCITY_FIELDS, label) if rows else {}
    if found:
        good = (found["status"] == COMPUTED) & ~np.char.startswith(
            found["type"].astype(str), INERTIAL
        )
        found = {name: values[good] for name, values in found.items()}
    if not found or found["speed"].size < 2:
        return np.full((time_s.size, 3), np.nan)
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
