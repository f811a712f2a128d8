"""Small ArduPilot logs written by hand: a parked unit, 50 Hz, with GPS; in DataFlash binary, text
and MATLAB form.
"""

import struct
from pathlib import Path

import numpy as np

from tests.trajectories.run_cases import F_B

HEAD = b"\xa3\x95"
LETTERS = {
    "b": "b",
    "B": "B",
    "h": "h",
    "H": "H",
    "i": "i",
    "I": "I",
    "f": "f",
    "Q": "Q",
    "q": "q",
    "d": "d",
    "n": "4s",
    "N": "16s",
    "Z": "64s",
    "c": "h",
    "C": "H",
    "e": "i",
    "E": "I",
    "L": "i",
    "M": "B",
}
ROWS, FIRST_MS = 500, 20_000
W = np.array([0.01, -0.02, 0.03])  # [rad/s] of the first IMU; IMU k reads k times that
LAT_DEG, LON_DEG, HEIGHT_M = -35.3632615, 149.1652301, 584.25
WEEK, TOW_MS = 1871, 603_900_000  # at the log's time 0

OLD = {  # firmware of 2013 to 2015: name -> (type, letters, columns)
    "IMU": (131, "IffffffIIf", "TimeMS,GyrX,GyrY,GyrZ,AccX,AccY,AccZ,ErrG,ErrA,Temp"),
    "IMU2": (132, "IffffffIIf", "TimeMS,GyrX,GyrY,GyrZ,AccX,AccY,AccZ,ErrG,ErrA,Temp"),
    "GPS": (130, "BIHBcLLeeEefI", "Status,TimeMS,Week,NSats,HDop,Lat,Lng,RelAlt,Alt,Spd,GCrs,VZ,T"),
    "PARM": (129, "Nf", "Name,Value"),
    "MSG": (134, "Z", "Message"),
    "STRT": (10, "", ""),
}
NEW = {  # 4.1 and later: TimeUS, instances
    "IMU": (131, "QBffffffIIfBBHH", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ,EG,EA,T,GH,AH,GHz,AHz"),
    "GPS": (
        130,
        "QBBIHBcLLeffffB",
        "TimeUS,I,Status,GMS,GWk,NSats,HDop,Lat,Lng,Alt,Spd,GCrs,VZ,Yaw,U",
    ),
    "GPA": (135, "QBCCCCBIHfHH", "TimeUS,I,VDop,HAcc,VAcc,SAcc,VV,SMS,Delta,Und,RTCMFU,RTCMFD"),
    "PARM": (129, "QNff", "TimeUS,Name,Value,Default"),
    "MSG": (134, "QZ", "TimeUS,Message"),
}


def fmt(kind: int, name: str, letters: str, columns: str) -> bytes:
    length = 3 + struct.calcsize("<" + "".join(LETTERS[c] for c in letters))
    body = struct.pack(
        "<BB4s16s64s", kind, length, name.encode(), letters.encode(), columns.encode()
    )
    return HEAD + b"\x80" + body


def message(form: tuple[int, str, str], *values) -> bytes:
    packed = [v.encode() if isinstance(v, str) else v for v in values]
    return (
        HEAD + bytes([form[0]]) + struct.pack("<" + "".join(LETTERS[c] for c in form[1]), *packed)
    )


def head_of(forms: dict) -> list[bytes]:
    first = fmt(128, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns")
    return [
        first,
        *(fmt(kind, name, letters, columns) for name, (kind, letters, columns) in forms.items()),
    ]


def old_messages(*, rows: int = ROWS) -> list[bytes]:
    """Two IMUs of old firmware, a temperature that rises by 1 degC in 10 s, GPS every 200 ms."""
    out = head_of(OLD)
    texts = ("APM:Copter V3.3", "PX4v2 0033003E 34314712 31373638")
    out += [message(OLD["STRT"]), *(message(OLD["MSG"], text) for text in texts)]
    out += [
        message(OLD["PARM"], f"INS_GYR2OFFS_{axis}", 0.001 * k)
        for k, axis in enumerate("XYZ", start=1)
    ]
    for k in range(rows):
        ms = FIRST_MS + 20 * k
        for number, name in ((1, "IMU"), (2, "IMU2")):
            out.append(
                message(OLD[name], ms, *(number * W), *F_B, 0, 0, 20.0 + 10 * number + k / 500)
            )
        if k % 10 == 5:
            out.append(
                message(
                    OLD["GPS"],
                    3,
                    TOW_MS + ms,
                    WEEK,
                    9,
                    150,
                    round(LAT_DEG * 1e7),
                    round(LON_DEG * 1e7),
                    12,
                    round(HEIGHT_M * 100),
                    200,
                    9000,
                    -0.5,
                    ms,
                )
            )
    return out


def new_messages(*, rows: int = ROWS) -> list[bytes]:
    """Two instances of IMU in one table, GPS with its own accuracy message, a fix only from the
    tenth row on.
    """
    out = head_of(NEW)
    for k in range(rows):
        us = 1000 * (FIRST_MS + 20 * k)
        for instance in (0, 1):
            out.append(
                message(
                    NEW["IMU"],
                    us,
                    instance,
                    *((instance + 1) * W),
                    *F_B,
                    0,
                    0,
                    30.5,
                    1,
                    1,
                    1000,
                    1000,
                )
            )
        if k % 10 == 5:
            out.append(
                message(
                    NEW["GPS"],
                    us,
                    0,
                    3 if k > 100 else 1,
                    TOW_MS + us // 1000,
                    WEEK,
                    9,
                    150,
                    round(LAT_DEG * 1e7),
                    round(LON_DEG * 1e7),
                    round(HEIGHT_M * 100),
                    2.0,
                    90.0,
                    -0.5,
                    0.0,
                    1,
                )
            )
            out.append(
                message(NEW["GPA"], us, 0, 100, 150, 250, 30, 1, us // 1000, 200, 19.5, 0, 0)
            )
    return out


def write(path: Path, messages: list[bytes]) -> Path:
    path.write_bytes(b"".join(messages))
    return path


def write_text(path: Path, *, rows: int = ROWS) -> Path:
    """The old log's first IMU and GPS as text."""
    lines = [
        f"FMT, {kind}, 89, {name}, {letters}, {columns}"
        for name, (kind, letters, columns) in OLD.items()
        if letters
    ]
    lines = [
        "FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns",
        *lines,
        "MSG, Arming, all checks",
    ]
    for k in range(rows):
        ms = FIRST_MS + 20 * k
        lines.append(
            f"IMU, {ms}, {', '.join(f'{v:.6f}' for v in [*W, *F_B])}, 0, 0, {30 + k / 500:.4f}"
        )
        if k % 10 == 5:
            lines.append(
                f"GPS, 3, {TOW_MS + ms}, {WEEK}, 9, 1.50, {LAT_DEG:.7f}, {LON_DEG:.7f}, 0.12,"
                f" {HEIGHT_M:.2f}, 2.00, 90.00, -0.50, {ms}"
            )
    path.write_text("\r\n".join(lines) + "\r\n")
    return path


def mat_variables(*, rows: int = ROWS, suffix: str = "") -> dict:
    """The old log's first IMU and GPS as Mission Planner writes them; suffix "_0": instances."""
    ms = FIRST_MS + 20 * np.arange(rows)
    imu = np.column_stack([np.arange(rows), ms, np.tile([*W, *F_B], (rows, 1))])
    fix = np.array([3, 0, WEEK, 9, 1.5, LAT_DEG, LON_DEG, 0.12, HEIGHT_M, 2.0, 90.0, -0.5, 0])
    gps = np.column_stack([np.arange(rows // 10), np.tile(fix, (rows // 10, 1))])
    gps[:, 13] = ms[5::10]
    gps[:, 2] = TOW_MS + gps[:, 13]
    return {
        f"IMU{suffix}": imu,
        "IMU_label": cells("LineNo,TimeMS,GyrX,GyrY,GyrZ,AccX,AccY,AccZ"),
        f"GPS{suffix}": gps,
        "GPS_label": cells("LineNo," + OLD["GPS"][2]),
        "Seen": cells("IMU,GPS"),
        "PARM": np.array([["INS_GYROFFS_X", 0.001]], dtype=object),
    }


def cells(names: str) -> np.ndarray:
    out = np.empty((len(names.split(",")), 1), dtype=object)
    out[:, 0] = names.split(",")
    return out
