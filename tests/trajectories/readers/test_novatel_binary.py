"""NovAtel binary logs: a parked unit packed byte by byte from the tables of the documentation."""

import struct

import numpy as np
import pytest

from ins.records import FixType, InputError
from tests.trajectories.readers import test_novatel as ascii_logs
from tests.trajectories.readers.known_motion import (
    GIVEN,
    HEADING_DEG,
    HEIGHT_M,
    LAT_DEG,
    LON_DEG,
    PITCH_DEG,
    PLACELESS,
    ROLL_DEG,
    at_rest,
    parked,
)
from trajectories.readers.containers.novatel_frames import BODIES
from trajectories.readers.conversion import convert_log

WEEK, SECONDS = ascii_logs.WEEK, ascii_logs.SECONDS
RAW_IDS = {"RAWIMU": 268, "RAWIMUS": 325, "RAWIMUX": 1461, "RAWIMUSX": 1462}
OUT = parked(dt=0.005, start_s=SECONDS, seconds=10.0)
TABLE = [0] * 256
for _k in range(256):
    TABLE[_k] = ascii_logs.check_sum(chr(_k)) if _k < 128 else 0
for _k in range(128, 256):
    _crc = _k
    for _ in range(8):
        _crc = (_crc >> 1) ^ (0xEDB88320 if _crc & 1 else 0)
    TABLE[_k] = _crc


def check(data: bytes) -> int:
    """The documentation's CRC, a byte at a time."""
    crc = 0
    for byte in data:
        crc = TABLE[(crc ^ byte) & 0xFF] ^ (crc >> 8)
    return crc


def frame(number: int, body: bytes, t: float, *, week=WEEK, short=False, kind=0) -> bytes:
    """A binary log with its head; kind: antenna, encoding, reply."""
    ms = round(t * 1e3)
    if short:
        head = struct.pack("<3sBHHI", b"\xaa\x44\x13", len(body), number, week, ms)
    else:
        head = struct.pack("<3sBHBBH", b"\xaa\x44\x12", 28, number, kind, 32, len(body))
        head += struct.pack("<HBBHIIHH", 0, 120, 180, week, ms, 0x02000020, 0xC292, 16809)
    return head + body + struct.pack("<I", check(head + body))


def raw_frames(output=OUT, *, kind="RAWIMUSX", number=26, week=WEEK) -> list[bytes]:
    """RAWIMU... of an ISA-100C; a time beyond the week is one of the next."""
    found = []
    short = "S" in kind.removeprefix("RAWIMU")
    rows = ascii_logs.counts(output, ascii_logs.LITEF_RAD, ascii_logs.LITEF_M_S)
    for t, row in zip(output.time_s, rows):
        w, s = week + int(t // 604_800), t % 604_800
        head = struct.pack("<BBHd", 0, number, w, s)
        if not kind.endswith("X"):
            head = struct.pack("<Id", w, s)
        body = head + struct.pack("<I6i", 0x77, *row.tolist())
        found.append(frame(RAW_IDS[kind], body, s, week=w, short=short))
    return found


def position(t: float, k: int, *, number=1429, kind=16, status=0, antenna=0) -> bytes:
    """Heights above the geoid, which lies 30 m below the ellipsoid."""
    body = struct.pack("<IIddd", status, kind, LAT_DEG + k * 1e-5, LON_DEG, HEIGHT_M + 30.0)
    body += struct.pack("<fIfff4sff", -30.0, 61, 0.3, 0.4, 0.9, b"AAAA", 0.0, 0.0)
    return frame(number, body + bytes([18, 18, 18, 0, 0, 2, 17, 1]), t, kind=antenna)


def velocity(t: float, speed: float, *, number=1430) -> bytes:
    return frame(number, struct.pack("<IIffdddf", 0, 8, 0.25, 0.0, speed, 30.0, 0.5, 0.0), t)


def solution(t: float, status: int) -> bytes:
    """INSPVAX, whose height is above mean sea level."""
    body = struct.pack("<IIdddf", status, 53, LAT_DEG, LON_DEG, HEIGHT_M + 30.0, -30.0)
    body += struct.pack("<6d", 1.0, 2.0, 0.5, ROLL_DEG, PITCH_DEG, HEADING_DEG)
    return frame(1465, body + struct.pack("<9fIH", *[0.1] * 9, 0, 0), t)


def config(imu: int, turn: tuple[float, float, float], *, translations=1) -> bytes:
    """INSCONFIG with a translation and a rotation."""
    body = struct.pack(
        "<IBBHIIIIIIBBH6I", imu, 5, 50, 20, 0, 0x7FD1BF, 2, 5, 0, 0, 0, 0, 17, *[0] * 6
    )
    offset = struct.pack("<II6fI", 1, 1, 0.1, 0.2, 0.3, 0.01, 0.01, 0.01, 4)
    body += struct.pack("<I", translations) + offset * translations
    body += struct.pack("<I", 1) + struct.pack("<II6fI", 8, 1, *turn, 3.0, 3.0, 3.0, 4)
    return frame(1945, body, SECONDS)


def convert(tmp_path, frames, options=None, given=GIVEN):
    (tmp_path / "span.gps").write_bytes(b"".join(frames))
    return convert_log(tmp_path / "span.gps", options or {}, given)


def test_bodies_have_the_documented_lengths():
    """Bytes behind the head, before the check: the offset of the CRC on the page of each log."""
    documented = {"RAWIMU": 40, "RAWIMUX": 40, "BESTPOS": 72, "BESTVEL": 44}
    documented |= {"INSPVA": 88, "INSPVAX": 126, "BESTGNSSPOS": 72, "BESTGNSSVEL": 44}
    documented |= {"RAWIMUS": 40, "RAWIMUSX": 40, "INSPVAS": 88}
    assert {name: body.itemsize for name, (_, body) in BODIES.items()} == documented


@pytest.mark.parametrize("kind", RAW_IDS)
def test_parked(tmp_path, kind):
    frames = [config(26, (0.0, 0.0, 0.0)), *raw_frames(kind=kind)]
    made = convert(tmp_path, frames, given=GIVEN | {"start_utc": None, "gyro_technology": None})
    w, f = at_rest()
    span = made.run.imu.dt_s.sum()
    assert made.run.imu.rows == OUT.rows and made.record.format == "novatel"
    np.testing.assert_allclose(made.run.imu.dtheta_rad.sum(axis=0) / span, w, atol=2e-9)
    np.testing.assert_allclose(made.run.imu.dv_m_s.sum(axis=0) / span, f, atol=1e-5)
    assert made.run.header.start_utc == "2026-01-06T07:33:02.000Z"
    assert made.run.header.gyro_technology == "fog"


def test_fixes_of_the_first_antenna(tmp_path):
    """Late in the log, with a solution of the filter beside them, which is reference alone."""
    frames = raw_frames()
    for k in range(4, 10):
        t = SECONDS + k
        frames += [
            position(t, k, kind=16 if k < 7 else 50),
            velocity(t, 2.0),
            position(t, k + 500, antenna=1),
        ]
        frames += [solution(t, 3 if k > 5 else 1), position(t, k, number=42, kind=53)]
    made = convert(tmp_path, frames, given=PLACELESS)
    gnss = made.run.gnss
    np.testing.assert_allclose(gnss.time_s, np.arange(4.0, 10.0))
    np.testing.assert_allclose(gnss.height_m, HEIGHT_M, atol=1e-5)
    np.testing.assert_allclose(np.degrees(gnss.lat_rad), LAT_DEG + 1e-5 * np.arange(4, 10))
    expected = [2.0 * np.cos(np.radians(30.0)), 2.0 * np.sin(np.radians(30.0)), -0.5]
    np.testing.assert_allclose(gnss.v_n_m_s[2], expected, atol=1e-6)
    np.testing.assert_allclose(gnss.sigma_vertical_m, 0.9, atol=1e-6)
    np.testing.assert_array_equal(gnss.fix_type, [FixType.SINGLE] * 3 + [FixType.FIXED] * 3)
    assert made.run.header.site.height_m == pytest.approx(HEIGHT_M, abs=1e-5)
    assert made.reference.time_s.size == 4
    np.testing.assert_allclose(made.reference.height_m, HEIGHT_M, atol=1e-5)
    assert any("6 logs of the second antenna left out" in note for note in made.record.notes)


# OEM7 documentation, table "Position or Velocity Type": with the filter's own position in them
INERTIAL = {53: "INS_PSRSP", 56: "INS_RTKFIXED", 74: "INS_PPP", 80: "INS_PPP_BASIC"}


@pytest.mark.parametrize("kind", INERTIAL)
def test_inertial_solutions_are_no_fixes(tmp_path, kind):
    fixes = [position(SECONDS + k, k, number=42, kind=kind if k < 4 else 16) for k in range(1, 10)]
    speeds = [velocity(SECONDS + k, 2.0, number=99) for k in range(1, 10)]
    made = convert(tmp_path, [*raw_frames(), *fixes, *speeds], given=PLACELESS)
    np.testing.assert_allclose(made.run.gnss.time_s, np.arange(4.0, 10.0))


def test_damage_costs_the_frame_that_it_hits(tmp_path):
    """A wrong bit, a frame cut off by the next, a wild length, bytes that look like a head."""
    frames = raw_frames()
    frames[100] = frames[100][:20] + bytes([frames[100][20] ^ 4]) + frames[100][21:]
    frames[200] = frames[200][:30]
    frames[300] = frames[300][:3] + b"\xff" + frames[300][4:]
    frames[400] = b"\xaa\x44\x12\x1c" + bytes(7) + b"\xaa\x44\x13" + frames[400]
    made = convert(tmp_path, [b"[COM1]#junk\r\n", *frames, frames[0][:25]])
    assert made.run.imu.rows == OUT.rows - 3
    assert any("3 binary logs dropped: wrong CRC or cut off" in n for n in made.record.notes)


def test_lines_and_frames_in_one_file(tmp_path):
    """Settings in text, rows in binary; a refusal names what there is."""
    text = ascii_logs.config("ISA100C").encode() + b"\r\n"
    made = convert(tmp_path, [text, *raw_frames(kind="RAWIMUS")])
    assert made.run.imu.rows == OUT.rows
    with pytest.raises(InputError, match=r"span\.gps: no RAWIMU log, has BESTGNSSPOS"):
        convert(tmp_path, [position(SECONDS + k, k) for k in range(5)])
