"""What a NovAtel log holds, as tables that are the same of lines (ASCII) and of frames (binary).

Every table has `week` and `seconds`; a raw log of the IMU its counts, and with the extended ones
`info` and `type`; positions and velocities `computed` (a solution), `inertial` (of the filter) and
`fix_type`;
solutions of the filter `good`, with the height above the ellipsoid. Source: OEM7 documentation, the
page of each log; tables "Solution Status", "Position or Velocity Type", "Inertial Solution Status";
INSCONFIG.
"""

import re
import struct
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ins.records import InputError
from ins.user_input import open_regular
from trajectories.readers.columns.fix_types import NOVATEL, NOVATEL_NAMES, fix_types
from trajectories.readers.containers.file_bytes import read_whole
from trajectories.readers.containers.novatel_frames import CONFIG, Frames, has_frame, read_frames
from trajectories.readers.containers.novatel_lines import (
    Lines,
    columns,
    lines_of,
    of_width,
    read_lines,
)
from trajectories.runs.notes import About, Note

RAW_LOGS = ("RAWIMUSX", "RAWIMUX", "RAWIMUS", "RAWIMU")
POSITION_LOGS = ("BESTGNSSPOS", "BESTPOS")
VELOCITY_LOGS = ("BESTGNSSVEL", "BESTVEL")
SOLUTION_LOGS = ("INSPVAS", "INSPVA", "INSPVAX")
GNSS_LOGS = (*POSITION_LOGS, *VELOCITY_LOGS, *SOLUTION_LOGS)
SIGHTED_BYTES = 1 << 20  # looked at for a frame: a receiver writes its settings in text first

Table = dict[str, NDArray]
Row = tuple[bytes, bytes]  # header and fields of a line

_COUNT_FIELDS = ("accel_z", "accel_-y", "accel_x", "gyro_z", "gyro_-y", "gyro_x")
RAW_FIELDS = ("week", "seconds", "", *_COUNT_FIELDS)
EXTENDED_FIELDS = ("info", "type", *RAW_FIELDS)
_PLACE_FIELDS = ("lat", "lon", "height")
POSITION_FIELDS = (
    "status",
    "type",
    *_PLACE_FIELDS,
    "undulation",
    "",
    "north",
    "east",
    "up",
    *[""] * 11,
)
VELOCITY_FIELDS = ("status", "type", "latency", "", "speed", "track", "up", "")
_MOTION = ("north", "east", "up", "roll", "pitch", "heading")
SOLUTION_FIELDS = ("week", "seconds", *_PLACE_FIELDS, *_MOTION, "status")
EXTENDED_SOLUTION = ("status", "type", *_PLACE_FIELDS, "undulation", *_MOTION, *[""] * 11)
WORD_FIELDS = ("info", "status", "type")
IMU_ERROR = 1  # bit 0 of `info`
COMPUTED = ("SOL_COMPUTED", 0)
GOOD = ("INS_SOLUTION_GOOD", 3)
INERTIAL = "INS_"
# INS_SBAS, _PSRSP, _PSRDIFF, _RTKFLOAT, _RTKFIXED, _OMNISTAR (3), _PPP (3), _PPP_BASIC, with the
# state before each
INERTIAL_TYPES = (52, 53, 54, 55, 56, 57, 58, 59, 73, 74, 76, 79, 80)
# INSCONFIG: type of the IMU, what is set (56 bytes), number of translations; then 36 bytes each,
# number of rotations, 36 bytes each: kind, frame, three angles [deg], their sigmas, source
CONFIG_BYTES, OFFSET_BYTES = 60, 36


@dataclass
class NovatelLog:
    """Tables by name; imu: the type that INSCONFIG names or numbers, empty where there is none;
    turned: its angles from IMU to vehicle [deg], None where it has none.
    """

    tables: dict[str, Table] = field(default_factory=dict)
    imu: str = ""
    turned: tuple[float, ...] | None = None
    notes: list[str] = field(default_factory=list)

    def over(self, other: "NovatelLog") -> "NovatelLog":
        """This log, and the tables of another that this one does not have."""
        tables = {**other.tables, **self.tables}
        return NovatelLog(tables, self.imu, self.turned, self.notes + other.notes)


def read_log(path: Path, wanted: Collection[str]) -> NovatelLog:
    """The wanted logs of a file of lines, of frames, or of both; of a log in both encodings, the
    one with more rows.
    """
    data = b""
    with open_regular(path) as file:
        is_binary = has_frame(file.read(SIGHTED_BYTES))
    if is_binary:
        data = read_whole(path)
        lines = lines_of(data.split(b"\n"), wanted, path.name)
    else:
        lines = read_lines(path, wanted)
        data = read_whole(path) if lines.has_frames else b""
    frames = read_frames(data, wanted) if data else Frames()
    out = NovatelLog(notes=[*lines.notes, *_told(frames, path.name)])
    for name in wanted:
        rows, bodies = lines.logs.get(name, []), frames.logs.get(name)
        if bodies is not None and bodies.size >= len(rows):
            out.tables[name] = _of_frames(name, bodies)
        elif rows and name != CONFIG:
            out.tables[name] = _of_lines(name, rows, f"{path.name}: {name}")
    _configure(out, lines, frames)
    return out


def _told(frames: Frames, label: str) -> list[str]:
    notes: list[str] = []
    if frames.bad:
        told = f"{label}: {frames.bad} binary logs dropped: wrong CRC or cut off"
        notes.append(Note(told, About.DAMAGE))
    if frames.other_antenna:
        notes.append(f"{label}: {frames.other_antenna} logs of the second antenna left out")
    return notes


def _of_frames(name: str, bodies: NDArray) -> Table:
    """The table of bodies as they lie in a file."""
    names = bodies.dtype.names or ()
    out = {key: bodies[key].astype(float) for key in names if bodies.dtype[key].kind in "uif"}
    if "week" not in out:
        out["week"], out["seconds"] = out["head_week"], out["head_seconds"]
    if "info" in out:
        out["info"] = bodies["info"].astype(np.int64)
    if name in SOLUTION_LOGS:
        out["good"] = bodies["status"] == GOOD[1]
    elif "status" in out:
        out["computed"] = bodies["status"] == COMPUTED[1]
        out["inertial"] = np.isin(bodies["type"], INERTIAL_TYPES)
        out["fix_type"] = fix_types(bodies["type"], NOVATEL)
    return _above_ellipsoid(name, out)


def _of_lines(name: str, rows: Sequence[Row], label: str) -> Table:
    """The table of lines; those of another width are left out. InputError where all are."""
    fields = _fields(name)
    if name in (*POSITION_LOGS, *VELOCITY_LOGS, "INSPVAX"):
        fields = ("week", "seconds", *fields)
        rows = [row for row in rows if row[0].count(b",") >= 5]
        bodies = [b",".join([*header.split(b",")[4:6], body]) for header, body in rows]
    else:
        bodies = [body for _, body in rows]
    whole = of_width(bodies, len(fields))
    if not whole:
        got = bodies[0].count(b",") + 1 if bodies else 0
        raise InputError(f"{label} has {got} fields, needed {len(fields)}")
    text = [
        key for key in WORD_FIELDS if key in fields and not (key == "type" and name in RAW_LOGS)
    ]
    out = columns([bodies[k] for k in whole], fields, text=text, label=label)
    if "info" in out:
        out["info"] = np.array([_hexadecimal(word) for word in out["info"]])
    if name in SOLUTION_LOGS:
        out["good"] = out["status"] == GOOD[0]
    elif "status" in out:
        out["computed"] = out["status"] == COMPUTED[0]
        out["inertial"] = np.char.startswith(out["type"].astype(str), INERTIAL)
        numbers = np.array([NOVATEL_NAMES.get(word, 0) for word in out["type"].astype(str)])
        out["fix_type"] = fix_types(numbers, NOVATEL)
    return _above_ellipsoid(name, out)


def _fields(name: str) -> tuple[str, ...]:
    if name in RAW_LOGS:
        return EXTENDED_FIELDS if name.endswith("X") else RAW_FIELDS
    if name in POSITION_LOGS:
        return POSITION_FIELDS
    if name in VELOCITY_LOGS:
        return VELOCITY_FIELDS
    return EXTENDED_SOLUTION if name == "INSPVAX" else SOLUTION_FIELDS


def _above_ellipsoid(name: str, table: Table) -> Table:
    """Heights above mean sea level, which come with the undulation, become those above the
    ellipsoid; INSPVA and INSPVAS have these.
    """
    if "undulation" in table:
        table["height"] = table["height"] + table["undulation"]
    return table


def _hexadecimal(word: str) -> int:
    return int(word, 16) if re.fullmatch("[0-9a-fA-F]{1,8}", word) else IMU_ERROR


def _configure(out: NovatelLog, lines: Lines, frames: Frames) -> None:
    """What the last INSCONFIG says of the IMU, of a line or of a frame."""
    if frames.configs:
        body = frames.configs[-1]
        if len(body) >= CONFIG_BYTES:
            out.imu, out.turned = str(struct.unpack_from("<I", body)[0]), _rotation(body)
    elif CONFIG in lines.logs:
        fields = lines.logs[CONFIG][-1][1].split(b",")
        out.imu = fields[0].decode("ascii", errors="replace")
        place = fields.index(b"RBV") if b"RBV" in fields else -1
        angles = [_number(word) for word in fields[place + 2 : place + 5]]
        out.turned = tuple(angles) if place >= 0 and len(angles) == 3 else None


def _rotation(body: bytes) -> tuple[float, ...] | None:
    """The largest of the rotations in the body of an INSCONFIG: the documentation does not number
    the one from IMU to vehicle, and any of them may be it.
    """
    if len(body) < CONFIG_BYTES + 4:
        return None
    at = CONFIG_BYTES + 4 + OFFSET_BYTES * struct.unpack_from("<I", body, CONFIG_BYTES)[0]
    if at + 4 > len(body):
        return None
    count = min(struct.unpack_from("<I", body, at)[0], (len(body) - at - 4) // OFFSET_BYTES)
    starts = [at + 4 + OFFSET_BYTES * k + 8 for k in range(count)]
    found = [struct.unpack_from("<3f", body, start) for start in starts]
    return max(found, key=lambda angles: max(map(abs, angles)), default=None)


def _number(word: bytes) -> float:
    try:
        return float(word)
    except ValueError:
        return np.nan


@dataclass(frozen=True, kw_only=True)
class ImuType:
    """One type: its number in RAWIMUX, its names, what gyro and accelerometer are made of, counts
    to units, rate [Hz].
    """

    number: int
    names: tuple[str, ...]
    technology: str
    gyro: tuple[float, str]
    accel: tuple[float, str]
    rate_hz: float


_HG1700 = ((2.0**-33, "rad"), (2.0**-27, "ft/s"))
_KVH = ((0.1 / (3600 * 256), "rad"), (0.05 * 2.0**-15, "m/s"))
_LITEF = ((1e-9, "rad"), (2e-8, "m/s"))
_STIM = ((2.0**-21, "deg"), (2.0**-22, "m/s"))
_HG4930 = ((2.0**-33, "rad"), (2.0**-29, "m/s"))
_G320 = ((0.008 / 65536, "deg/s"), (0.2 / 65536, "mg"))
_G370 = ((0.0151515 / 65536, "deg/s"), (0.4 / 65536, "mg"))


def _type(number: int, names: str, technology: str, scales: tuple, rate_hz: float) -> ImuType:
    gyro, accel = scales
    return ImuType(
        number=number,
        names=tuple(names.split()),
        technology=technology,
        gyro=gyro,
        accel=accel,
        rate_hz=rate_hz,
    )


TYPES = (
    _type(1, "HG1700_AG11", "rlg", _HG1700, 100),
    _type(4, "HG1700_AG17", "rlg", ((2.0**-33, "rad"), (2.0**-26, "ft/s")), 100),
    _type(5, "HG1900_CA29", "mems", _HG1700, 100),
    _type(8, "LN200", "fog", ((2.0**-19, "rad"), (2.0**-14, "m/s")), 200),
    _type(11, "HG1700_AG58", "rlg", _HG1700, 100),
    _type(12, "HG1700_AG62", "rlg", ((2.0**-33, "rad"), (2.0**-26, "ft/s")), 100),
    _type(13, "IMAR_FSAS FSAS", "fog", ((0.1 / 256, "arcsec"), (0.05 * 2.0**-15, "m/s")), 200),
    _type(16, "KVH_COTS CPT", "fog", _KVH, 100),
    _type(20, "HG1930_AA99", "mems", _HG1700, 100),
    _type(26, "ISA100C ISA_100C", "fog", _LITEF, 200),
    _type(27, "HG1900_CA50", "mems", _HG1700, 100),
    _type(28, "HG1930_CA50", "mems", _HG1700, 100),
    _type(31, "ADIS16488", "mems", ((720 / 2.0**31, "deg"), (200 / 2.0**31, "m/s")), 200),
    _type(32, "STIM300", "mems", _STIM, 125),
    _type(33, "KVH_1750 KVH1750", "fog", _KVH, 200),
    _type(41, "EPSON_G320 G320 G320N EG320N", "mems", _G320, 125),
    _type(52, "LITEF_MICROIMU UIMU MICROIMU UIMU_IC", "mems", _LITEF, 200),
    _type(56, "STIM_300D STIM300D", "mems", _STIM, 125),
    _type(58, "HG4930_AN01 HG4930", "mems", _HG4930, 100),
    _type(61, "EPSON_G370 G370 G370N EG370N", "mems", _G370, 200),
    _type(62, "EPSON_G320_200HZ EG320N_200HZ", "mems", _G320, 200),
    _type(68, "HG4930_AN04", "mems", _HG4930, 100),
    _type(69, "HG4930_AN04_400HZ HG4930_400HZ", "mems", _HG4930, 400),
)


def imu_type(text: str) -> ImuType:
    """The type of a name ("ISA-100C", "OEM-IMU-STIM300") or a number. InputError lists the known
    ones.
    """
    wanted = _plain(text)
    for known in TYPES:
        if wanted in (str(known.number), *map(_plain, known.names)):
            return known
    names = ", ".join(f"{known.names[0]} ({known.number})" for known in TYPES)
    raise InputError(
        f"imu_type {text[:40]!r} has no documented scale: needed imu_scale in the map, or one of"
        f" {names}"
    )


def _plain(text: str) -> str:
    """The name of a model without what is written before it: letters and digits."""
    return re.sub(
        r"^(OEM)?(IMU)?(?=[A-Z])",
        "",
        re.sub(r"[^A-Z0-9]", "", text.upper().replace("µ", "U").replace("Μ", "U")),
    )
