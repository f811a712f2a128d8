"""VectorNav CSV: the exporter of the VectorNav SDK, and INSTINCT's logs of VectorNav units.

Axes are those marked on the unit: x forward, y right, z down. Taken are the rates and forces
without the unit's own bias estimates (uncompAccel, uncompGyro) where they are there, else those
with, else the increments deltaTheta [deg] and deltaVel [m/s]. Time is timeStartup [ns]. GNSS1 gives
the fixes, each at its own GPS time where the row has that of the row too; the height is above the
ellipsoid. The second antenna is left out; INS and attitude become the reference. Source: VectorNav
SDK 0.19, plugins/DataExport (ExporterCsv: names of columns); VN-310 User Manual, binary outputs
(units); UniStuttgart-INS/INSTINCT, test/data/VectorNav.
"""

import re
from collections.abc import Callable, Container, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ins.records import AXES, InputError
from ins.units import DEG
from trajectories.readers.columns.fix_types import VECTORNAV, fix_types
from trajectories.readers.columns.fixes import RawFixes, chosen
from trajectories.readers.columns.imu_columns import converted
from trajectories.readers.columns.layouts import read_columns, side_file
from trajectories.readers.columns.side_streams import GnssFile, with_fixes, with_reference
from trajectories.readers.columns.text_columns import heading
from trajectories.readers.registry import ConvertedLog, Reader
from trajectories.readers.rows.clocks import (
    UNIX_S,
    WEEK_S,
    gps_of_unix,
    gps_seconds,
    unix_seconds,
    utc_text,
)
from trajectories.readers.rows.column_map import (
    AxesKeys,
    LogOptions,
    StretchKeys,
    column_map,
    stretch_of,
)

NS = 1e-9
Columns = Mapping[str, NDArray]


def _three(name: str, *stems: str, ends: str = "xyz") -> dict[str, tuple[str, ...]]:
    return {f"{name}_{end}": tuple(f"{stem}{end}" for stem in stems) for end in ends}


# What each column is called, without signs, blanks, units and capitals.
VN_COLUMNS = {
    "startup": ("timetimestartup", "timestartup"),
    "gps": ("timetimegps", "timegps"),
    "tow": ("timegpstow", "timetimegpstow"),
    "week": ("timegpsweek", "timetimegpsweek"),
    **_three("raw_accel", "imuuncompaccel", "uncompaccel"),
    **_three("raw_gyro", "imuuncompgyro", "uncompgyro"),
    **_three("accel", "imuaccel", "accel"),
    **_three("gyro", "imuangularrate", "angularrate"),
    **_three("dtheta", "imudeltatheta", "deltatheta"),
    **_three("dvel", "imudeltavel", "deltavel"),
    "temperature": ("imutemp", "temperature"),
    "fix": ("gnss1fix",),
    "fix_tow": ("gnss1tow", "gps1tow"),
    "fix_week": ("gnss1week", "gps1week"),
    "fix_lat": ("gnss1posllalatitude", "gnss1poslat"),
    "fix_lon": ("gnss1posllalongitude", "gnss1poslon"),
    "fix_height": ("gnss1posllaaltitude", "gnss1posalt"),
    **_three("fix_v", "gnss1velned", ends="ned"),
    **_three("fix_w", "gnss1velned", ends="xyz"),
    **_three("fix_sigma", "gnss1posu", "gnss1posuncertainty", ends="ned"),
    "fix_sigma_v": ("gnss1velu", "gnss1veluncertainty"),
    "lat": ("insposllalatitude", "lat"),
    "lon": ("insposllalongitude", "lon"),
    "height": ("insposllaaltitude", "alt"),
    **_three("v", "insvelned", ends="ned"),
    **_three("w", "velned", ends="xyz"),
    "heading": ("attyawpitchrolly", "yaw"),
    "pitch": ("attyawpitchrollp", "pitch"),
    "roll": ("attyawpitchrollr", "roll"),
}
SENSOR_PAIRS = (("raw_gyro", "raw_accel"), ("gyro", "accel"), ("dtheta", "dvel"))
FIX_PLACE = ("lat", "lon", "height")
FIX_3D = 3  # of gnss1Fix: 0 none, 1 time alone, 2 two-dimensional, 3 and more
# of a fix behind its row: receivers answer within 0.5 s, and a wrong week is off by 604,800
MAX_FIX_AGE_S = 2.0


class VectornavKeys(StretchKeys):
    """Map keys of a VectorNav CSV; `gnss.file`: a CSV of the same unit with its receiver."""

    format: str | None = None
    gnss: GnssFile | None = None
    axes: AxesKeys = AxesKeys()


def _plain(name: str) -> str:
    """A name without its unit, signs and capitals."""
    return re.sub(r"[^a-z0-9]", "", re.sub(r"\[[^\]]*\]", "", name).lower())


def _known(names: Sequence[str]) -> dict[str, str]:
    """The names in a file of the columns that are known, by ours."""
    plain = {_plain(name): name for name in reversed(names)}
    found = {
        ours: next((plain[n] for n in theirs if n in plain), "")
        for ours, theirs in VN_COLUMNS.items()
    }
    return {ours: name for ours, name in found.items() if name}


def _has(names: Container[str], stem: str, ends: Iterable[str] = "xyz") -> bool:
    return all(f"{stem}_{end}" in names for end in ends)


def _are_of_imu(names: Sequence[str]) -> bool:
    if len(names) < 7:  # a time and six values
        return False
    found = _known(names)
    named = any(_has(found, gyro) and _has(found, accel) for gyro, accel in SENSOR_PAIRS)
    return named and "startup" in found


def _are_of_unit(names: Sequence[str]) -> bool:
    found = _known(names)
    return "startup" in found and _has(found, "fix", FIX_PLACE)


def read(path: Path, options: LogOptions) -> ConvertedLog:
    """The log of the unit, with its receiver and its own solution beside it."""
    keys = options.parsed(VectornavKeys)
    columns, notes = _columns(path, _are_of_imu, "timeStartup and rates, forces or increments")
    gyro, accel = next((g, a) for g, a in SENSOR_PAIRS if _has(columns, g) and _has(columns, a))
    notes.append(f"{path.name}: {gyro} and {accel} taken: {_told(gyro)}")
    shape = {
        "time": {"column": "startup", "unit": "ns"},
        "gyro": _sensor(gyro, "deg" if gyro == "dtheta" else "rad/s"),
        "accel": _sensor(accel, "m/s" if accel == "dvel" else "m/s2"),
        "axes": keys.axes.model_dump(),
        **stretch_of(keys),
    }
    if np.isfinite(columns.get("temperature", np.empty(0))).any():
        shape["temperature"] = {"columns": ["temperature"]}
    beside = dict(columns)
    log = converted(dict(columns), column_map(LogOptions(shape)), label=path.name, notes=notes)
    label = path.name
    if keys.gnss is not None:
        other = side_file(path, keys.gnss.file, "gnss.file (--gnss)")
        beside, more = _columns(other, _are_of_unit, "timeStartup and the columns of GNSS1")
        label = other.name
        log = replace(log, notes=(*log.notes, *more), other_files=(other,))
    header = {"gyro_technology": "mems", **_start(columns, log.time_shift_s), **keys.run}
    log = replace(log, header=header)
    if _has(beside, "fix", FIX_PLACE):
        log = with_fixes(log, _fixes(beside), label=label)
    return _with_reference(log, beside, label)


def _columns(
    path: Path, are_names: Callable[[Sequence[str]], bool], what: str
) -> tuple[dict[str, NDArray], list[str]]:
    """The columns of a file under our names."""
    found = heading(path, are_names)
    if found is None:
        raise InputError(f"{path.name}: no line that names {what}")
    names = _known(found.names)
    columns, notes = read_columns(path, found.layout, list(dict.fromkeys(names.values())))
    return {ours: columns[name] for ours, name in names.items()}, notes


def _told(gyro: str) -> str:
    if gyro == "raw_gyro":
        return "without the unit's own bias estimates"
    if gyro == "gyro":
        return "less the unit's own bias estimates, which change on the way"
    return "increments over the interval before their row"


def _sensor(stem: str, unit: str) -> dict[str, list[str] | str]:
    return {"columns": [f"{stem}_{a}" for a in AXES], "unit": unit}


def _start(columns: Columns, shift_s: float) -> dict[str, str]:
    """start_utc by the median of the rows whose GPS time is known, wherever in the log."""
    gps_s = _gps_seconds(columns, "tow", "week")
    if gps_s is None and "gps" in columns:
        gps_s = columns["gps"] * NS
    if gps_s is None:
        return {}
    with np.errstate(invalid="ignore"):
        ahead_s = gps_s - columns["startup"] * NS
        known = np.isfinite(ahead_s) & (gps_s > gps_of_unix(UNIX_S[0]))
    if not known.any():
        return {}
    start_s = float(unix_seconds(np.median(ahead_s[known]) + shift_s))
    return {"start_utc": utc_text(start_s)} if UNIX_S[0] < start_s < UNIX_S[1] else {}


def _gps_seconds(columns: Columns, tow: str, week: str) -> NDArray | None:
    if tow not in columns or week not in columns:
        return None
    return gps_seconds(columns[week], columns[tow] * NS)


def _fixes(columns: Columns) -> RawFixes:
    """The fixes of the first receiver, each once, at their own time where the row tells its age."""
    log_s = columns["startup"] * NS
    fix_s = _gps_seconds(columns, "fix_tow", "fix_week")
    unix_s = np.full(log_s.size, np.nan) if fix_s is None else np.asarray(unix_seconds(fix_s))
    if {"tow", "fix_tow"} <= set(columns):
        # of the week alone: a unit knows the seconds before it knows which week it is
        age_s = np.mod((columns["tow"] - columns["fix_tow"]) * NS, WEEK_S)
        log_s = np.where(age_s < MAX_FIX_AGE_S, log_s - age_s, log_s)
    v_n = np.full((log_s.size, 3), np.nan)
    for stem, ends in (("fix_v", "ned"), ("fix_w", "xyz")):  # of INSTINCT, of the SDK
        if _has(columns, stem, ends):
            v_n = np.column_stack([columns[f"{stem}_{end}"] for end in ends])
    raw = RawFixes(
        log_s=log_s,
        is_3d=columns["fix"] >= FIX_3D if "fix" in columns else np.isfinite(columns["fix_lat"]),
        lat_deg=columns["fix_lat"],
        lon_deg=columns["fix_lon"],
        height_m=columns["fix_height"],
        v_n_m_s=v_n,
        unix_s=unix_s,
        sigmas=_sigmas(columns, log_s.size),
        fix_type=fix_types(columns["fix"], VECTORNAV) if "fix" in columns else None,
    )
    same = np.column_stack([raw.lat_deg, raw.lon_deg, raw.height_m, np.nan_to_num(v_n)])
    new = np.concatenate([[True], np.any(same[1:] != same[:-1], axis=1)])[: log_s.size]
    return chosen(raw, new & np.isfinite(raw.lat_deg))


def _sigmas(columns: Columns, rows: int) -> NDArray:
    """Horizontal, of one axis, vertical [m], velocity [m/s]; NaN where there is none."""
    none = np.full(rows, np.nan)
    north, east, down = (columns.get(f"fix_sigma_{end}", none) for end in "ned")
    level = np.sqrt((north**2 + east**2) / 2)
    return np.stack([level, down, columns.get("fix_sigma_v", none)])


def _with_reference(log: ConvertedLog, columns: Columns, label: str) -> ConvertedLog:
    """The unit's own solution as reference, for scoring only."""
    v = "v" if _has(columns, "v", "ned") else "w"
    speeds = [f"{v}_{end}" for end in ("ned" if v == "v" else "xyz")]
    if not {"lat", "lon", "height", "heading", "pitch", "roll", *speeds} <= set(columns):
        return log
    with np.errstate(invalid="ignore"):
        rows = (columns["lat"] != 0.0) | (columns["lon"] != 0.0)
    found = {name: values[rows] for name, values in columns.items()}
    return with_reference(
        log,
        {
            "time_s": found["startup"] * NS,
            "lat_rad": found["lat"] * DEG,
            "lon_rad": found["lon"] * DEG,
            "height_m": found["height"],
            "v_n_m_s": np.column_stack([found[name] for name in speeds]),
            "roll_rad": found["roll"] * DEG,
            "pitch_rad": found["pitch"] * DEG,
            "heading_rad": np.mod(found["heading"] * DEG, 2 * np.pi),
        },
        label=label,
        rows_of="rows of the unit's own solution",
    )


def detect(path: Path) -> bool:
    """A line that names timeStartup beside rates and forces, or increments."""
    return heading(path, _are_of_imu) is not None


READERS = (
    Reader(
        name="vectornav",
        about="VectorNav CSV of its SDK or of INSTINCT",
        detect=detect,
        read=read,
        gnss_file=True,
    ),
)
