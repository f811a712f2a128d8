"""NovAtel SPAN logs, ASCII or binary: RAWIMU counts as increments, GNSS solutions as fixes, INSPVA
as reference.

A RAWIMU row has the GPS week and seconds of its end, a status word, and counts along z, -y, x of
accelerometers, then gyros, in the axes marked on the IMU. These are taken as y forward, x right, z
up, SPAN's frame of a vehicle (APN-065), unless the map gives `axes`. The IMU's type comes from
RAWIMUX, INSCONFIG, or `imu_type` in the map; the temperature that some types have in their status
word is not read. BESTPOS of a SPAN receiver holds inertial solutions, which are no fixes and left
out. Source: OEM7 documentation: RAWIMUS, RAWIMUSX, BESTGNSSPOS, BESTGNSSVEL, INSPVAS, INSCONFIG;
Description of Short Headers.
"""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from ins.json_file import StrictModel
from ins.records import AXES, InputError
from ins.units import DEG
from ins.user_input import open_regular
from trajectories.readers.columns.fixes import RawFixes
from trajectories.readers.columns.imu_columns import converted
from trajectories.readers.columns.layouts import side_file
from trajectories.readers.columns.side_streams import GnssFile, with_fixes, with_reference
from trajectories.readers.containers.novatel_frames import CONFIG, has_frame
from trajectories.readers.formats.novatel_tables import (
    GNSS_LOGS,
    IMU_ERROR,
    POSITION_LOGS,
    RAW_LOGS,
    SIGHTED_BYTES,
    SOLUTION_LOGS,
    VELOCITY_LOGS,
    ImuType,
    NovatelLog,
    Table,
    imu_type,
    read_log,
)
from trajectories.readers.registry import ConvertedLog, Reader
from trajectories.readers.rows.clocks import dated, gps_seconds, unix_seconds
from trajectories.readers.rows.column_map import (
    AxesKeys,
    LogOptions,
    StretchKeys,
    column_map,
    stretch_of,
)
from trajectories.readers.rows.increment_rows import is_file_of
from trajectories.readers.rows.row_cleaning import row_ranges
from trajectories.runs.notes import About, Note

WANTED_LOGS = (*RAW_LOGS, *GNSS_LOGS, CONFIG)
DETECT = rb"[#%](RAWIMU|INSPVA|BESTPOS|BESTGNSSPOS|INSCONFIG)S?X?S?A,"
VEHICLE_AXES = AxesKeys(x="y", y="x", z="-z")  # y forward, x right, z up
# Bits of the first field of RAWIMUX.
ENCRYPTED = 2
# from the median time: a log lasts hours, and stamps before the receiver knew the week are off by
# weeks, 7 days and more
MAX_FAR_S = 3 * 86_400.0
RATE_OFF = 0.1  # half of what lies between the rates of the types, 100 and 125 Hz
PAIRS = tuple(zip(POSITION_LOGS, VELOCITY_LOGS))
# between the velocities on either side of a position; chosen: 1 s apart, and half
MAX_BRACKET_S = 1.5


class ScaleKeys(StrictModel):
    """What a count is worth where the type has no documented scale: increments."""

    gyro_rad: Annotated[float, Field(gt=0)]
    accel_m_s: Annotated[float, Field(gt=0)]


class NovatelKeys(StretchKeys):
    """Map keys of a NovAtel log. `imu_type`: name or number, where the log does not say; `axes` as
    in a column map.
    """

    format: str | None = None
    imu_type: str | int | None = None
    imu_scale: ScaleKeys | None = None
    axes: AxesKeys | None = None
    gnss: GnssFile | None = None


def read(path: Path, options: LogOptions) -> ConvertedLog:
    """The log of the raw IMU, with fixes and reference. InputError where the scale of its counts is
    not known.
    """
    keys = options.parsed(NovatelKeys)
    held = read_log(path, WANTED_LOGS)
    tables = held.tables
    name = max(RAW_LOGS, key=lambda k: tables[k]["week"].size if k in tables else 0)
    if name not in tables:
        raise InputError(
            f"{path.name}: no RAWIMU log, has {', '.join(tables) or 'no log with a right CRC'}"
        )
    raw, notes = _counts(tables, name, path.name)
    week = int(np.median(raw["week"]))
    raw["time"] = gps_seconds(raw["week"] - week, raw["seconds"])
    known = _type(held, keys, raw, path.name)
    counts, units, more = _columns(raw, known, keys)
    notes = [f"{path.name}: {n}" for n in (*notes, *more, *_turned(held, keys, path.name))]
    shape = {
        "time": {"column": "time"},
        **units.keys,
        "axes": (keys.axes or VEHICLE_AXES).model_dump(),
        **stretch_of(keys),
    }
    log = converted(
        counts, column_map(LogOptions(shape)), label=path.name, notes=[*held.notes, *notes]
    )
    start, told = dated(float(unix_seconds(gps_seconds(week, log.time_shift_s))), path.name)
    technology = {"gyro_technology": known.technology} if known else {}
    log = replace(
        log,
        header={**start, **technology, **keys.run},
        notes=(*log.notes, *told, *_rate(log, known, path.name)),
    )
    if keys.gnss is None:
        return _with_solutions(log, tables, week, path.name)
    other = side_file(path, keys.gnss.file, "gnss.file (--gnss)")
    found = read_log(other, GNSS_LOGS)
    log = replace(log, notes=(*log.notes, *found.notes), other_files=(other,))
    return _with_solutions(log, tables | found.tables, week, other.name)


def _with_solutions(
    log: ConvertedLog, tables: Mapping[str, Table], week: int, label: str
) -> ConvertedLog:
    """The log with the fixes of the receiver alone, and what its filter says as reference."""
    raw, told = fixes(tables, week, label=label)
    log = replace(log, notes=(*log.notes, *told))
    return _with_reference(
        log if raw is None else with_fixes(log, raw, label=label), tables, week, label
    )


def _counts(
    tables: Mapping[str, Table], name: str, label: str
) -> tuple[dict[str, NDArray], list[str]]:
    """The columns of the raw log, and notes on rows left out."""
    raw = tables[name]
    seconds = gps_seconds(raw["week"], raw["seconds"])
    if not np.isfinite(seconds).any():
        raise InputError(f"{label}: {name} rows without GPS week and seconds")
    near = np.abs(seconds - np.nanmedian(seconds)) <= MAX_FAR_S
    failed = near & _failed(raw, f"{label}: {name}")
    notes = [
        f"{name} {row_ranges(np.flatnonzero(out))} dropped: {why}"
        for out, why in ((~near, "time far from all others"), (failed, "the IMU reports an error"))
        if out.any()
    ]
    others = [k for k in RAW_LOGS if k in tables and k != name]
    notes += [f"{name} used, not {', '.join(others)} of the same IMU"] if others else []
    kept = near & ~failed
    if np.count_nonzero(kept) < 2:
        raise InputError(
            f"{label}: {np.count_nonzero(kept)} usable rows of {name}, needed at least 2"
        )
    return {key: values[kept] for key, values in raw.items()}, [
        *notes,
        f"{name} has no temperature: none in the run",
    ]


def _failed(raw: Mapping[str, NDArray], label: str) -> NDArray:
    """Which rows of RAWIMUX say that the IMU reported an error. InputError where they are
    encrypted.
    """
    if "info" not in raw:
        return np.zeros(raw["week"].size, dtype=bool)
    info = raw["info"]
    if np.any(info & ENCRYPTED):
        raise InputError(f"{label}: the IMU data are encrypted, needed raw ones")
    return (info & IMU_ERROR) > 0


def _type(
    held: NovatelLog, keys: NovatelKeys, raw: Mapping[str, NDArray], label: str
) -> ImuType | None:
    """The type that the map, the rows or INSCONFIG name; None where the map gives the scale
    itself.
    """
    if keys.imu_scale is not None:
        return None
    named = keys.imu_type
    if named is None and "type" in raw:
        named = int(np.nanmedian(raw["type"]))
    if named is None and held.imu:
        named = held.imu
    if named is None:
        raise InputError(
            f'{label}: the log does not say its IMU\'s type: needed imu_type (such as "ISA100C") in'
            " the map, or imu_scale; RAWIMUX and INSCONFIG have it"
        )
    try:
        return imu_type(str(named))
    except InputError as error:
        raise InputError(f"{label}: {error}"[:1000]) from None


def _columns(
    raw: Mapping[str, NDArray], known: ImuType | None, keys: NovatelKeys
) -> tuple[dict[str, NDArray], LogOptions, list[str]]:
    """Counts by sensor and axis, the unit of each sensor as in a map, and a note on the scale."""
    out, units, told = {"time": raw["time"]}, {}, []
    for sensor in ("gyro", "accel"):
        out |= {
            f"{sensor}_x": raw[f"{sensor}_x"],
            f"{sensor}_y": -raw[f"{sensor}_-y"],
            f"{sensor}_z": raw[f"{sensor}_z"],
        }
        if known is None:
            assert keys.imu_scale is not None  # _type has refused a log with neither
            scale, unit = (
                (keys.imu_scale.gyro_rad, "rad")
                if sensor == "gyro"
                else (keys.imu_scale.accel_m_s, "m/s")
            )
        else:
            scale, unit = known.gyro if sensor == "gyro" else known.accel
        units[sensor] = {"columns": [f"{sensor}_{a}" for a in AXES], "unit": unit, "scale": scale}
        told.append(f"{sensor} {scale:.6g} {unit}")
    name = f"{known.names[0]} ({known.number})" if known else "by imu_scale"
    return out, LogOptions(units), [f"IMU {name}: a count is {', '.join(told)}"]


def _turned(held: NovatelLog, keys: NovatelKeys, label: str) -> list[str]:
    """A note on the axes; InputError where INSCONFIG turns the IMU in the vehicle and the map does
    not say how.
    """
    if keys.axes is not None:
        return []
    if held.turned is not None and not all(abs(a) <= 1.0 for a in held.turned):
        told = " ".join(f"{a:g}" for a in held.turned)
        raise InputError(
            f"{label}: INSCONFIG turns the IMU in the vehicle (RBV {told} deg): needed axes in the"
            " map"
        )
    return [
        "IMU axes taken as y forward, x right, z up (SPAN's vehicle); where mounted otherwise: axes"
        " in the map"
    ]


def _rate(log: ConvertedLog, known: ImuType | None, label: str) -> list[str]:
    """A note where rows come slower than the type makes them: increments in between are then
    missing.
    """
    if known is None or abs(log.imu.rate_hz / known.rate_hz - 1) <= RATE_OFF:
        return []
    return [
        f"{label}: rows at {log.imu.rate_hz:.4g} Hz, {known.names[0]} makes {known.rate_hz:g}: rows"
        " missing, or another type?"
    ]


def _with_reference(
    log: ConvertedLog, tables: Mapping[str, Table], week: int, label: str
) -> ConvertedLog:
    """The log with the receiver's own inertial solution as reference, for scoring only, where it
    calls it good.
    """
    name = next((k for k in SOLUTION_LOGS if k in tables and tables[k]["good"].any()), "")
    if not name:
        return log
    table = tables[name]
    found = {key: values[table["good"]] for key, values in table.items()}
    return with_reference(
        log,
        {
            "time_s": gps_seconds(found["week"] - week, found["seconds"]),
            "lat_rad": found["lat"] * DEG,
            "lon_rad": found["lon"] * DEG,
            "height_m": found["height"],
            "v_n_m_s": np.column_stack([found["north"], found["east"], -found["up"]]),
            **{f"{angle}_rad": found[angle] * DEG for angle in ("roll", "pitch", "heading")},
        },
        label=f"{label}: {name}",
        rows_of="rows of the receiver's filter",
    )


def detect(path: Path) -> bool:
    """A line of a raw IMU, inertial or position log near the start, or a frame with a right
    check.
    """
    if is_file_of(path, DETECT):
        return True
    with open_regular(path) as file:
        return has_frame(file.read(SIGHTED_BYTES))


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


READERS = (
    Reader(
        name="novatel",
        about="NovAtel ASCII or binary with RAWIMU",
        detect=detect,
        read=read,
        gnss_file=True,
    ),
)
