"""NovAtel ASCII logs: lines of NovAtel's own documentation, and a parked unit written by hand from
it.
"""

import zlib

import numpy as np
import pytest

from ins.records import FixType, InputError
from tests.trajectories.readers.known_motion import (
    GIVEN,
    HEADING_DEG,
    HEIGHT_M,
    LAT_DEG,
    LON_DEG,
    PITCH_DEG,
    ROLL_DEG,
    Output,
    at_rest,
    check_right_turn,
    parked,
    parked_and_turned,
)
from trajectories.readers.containers.novatel_lines import crc32
from trajectories.readers.conversion import convert_log
from trajectories.readers.formats.novatel_tables import imu_type

# Examples of docs.novatel.com/OEM7, each on the page of its log.
DOCUMENTED = """\
%RAWIMUSA,2209,491612.254;2209,491612.253588,ea5afe00,329303960,-2512321,4410363,309705,607017,-1009773*1fb76c28
%RAWIMUSXA,2209,491674.014;04,41,2209,491674.013699,ea59fe00,329308016,-2706935,4508389,196192,417138,-1000837*038422a7
#RAWIMUXA,USB1,0,64.5,FINESTEERING,2209,491740.110,02000020,0dc5,16809;04,41,2209,491740.109817,ea57fe00,329394068,-2396829,4481425,321199,257329,-936077*cf9c035d
#BESTGNSSPOSA,USB1,0,65.0,FINESTEERING,2209,487877.000,02000020,c292,16809;SOL_COMPUTED,PPP,51.15043712234,-114.03067870773,1097.3556,-17.0001,WGS84,0.0176,0.0123,0.0317,"TSTR",17.000,0.000,42,38,38,37,00,00,3f,37*5fea7d4b
#BESTGNSSVELA,USB1,0,64.0,FINESTEERING,2209,488172.000,02000020,00b0,16809;SOL_COMPUTED,PPP,0.250,12.000,0.0025,23.890175,0.0021,0.0*f40aab04
%INSPVASA,2209,490712.000;2209,490712.000000000,51.15043713712,-114.03067872932,1080.3580,0.0014,-0.0007,0.0015,-0.293782412,0.302470613,157.989827209,INS_SOLUTION_GOOD*a87ab88b
#INSPVAA,USB1,0,67.5,FINESTEERING,2209,490558.000,02000020,18bc,16809;2209,490558.000000000,51.15043714042,-114.03067871718,1080.3548,0.0051,-0.0014,-0.0012,-0.296402993,0.311887972,157.992156267,INS_SOLUTION_GOOD*cc698020
#INSCONFIGA,USB1,0,66.5,FINESTEERING,2209,338183.000,02000020,bba4,16809;EPSON_G320,5,50,20,DEFAULT,7fd1bf,AUTOMATIC,ROVER,FALSE,0,0,0,17,0,0,0,0,0,0,0,1,RBV,IMUBODY,0.0000,0.0000,0.0000,3.0000,3.0000,3.0000,FROM_COMMAND*996d7655
""".splitlines()
WEEK, SECONDS = 2400, 200_000.0
OUT = parked(dt=0.005, start_s=SECONDS, seconds=50.0)
# ISA-100C; fine enough that a count is far below what is compared
LITEF_RAD, LITEF_M_S = 1.0e-9, 2.0e-8
PLACELESS = {"imu_serial": "SN-1"}


def check_sum(text: str) -> int:
    """Bit by bit, as the documentation's CalculateBlockCRC32."""
    crc = 0
    for byte in text.encode():
        crc ^= byte
        for _ in range(8):
            crc = (crc >> 1) ^ (0xEDB88320 if crc & 1 else 0)
    return crc


def line(sign: str, text: str) -> str:
    """With the check as zlib has it, held against the one above."""
    return f"{sign}{text}*{zlib.crc32(text.encode(), 0xFFFFFFFF) ^ 0xFFFFFFFF:08x}"


def counts(output: Output, gyro: float, accel: float) -> np.ndarray:
    """z, -y, x of velocity, then of angle, in axes y forward, x right, z up; remainders carried
    over as hardware does.
    """
    dtheta, dv = output.rfu()
    table = np.column_stack(
        [dv[:, 2], -dv[:, 1], dv[:, 0], dtheta[:, 2], -dtheta[:, 1], dtheta[:, 0]]
    )
    scaled = np.cumsum(table / np.array([accel] * 3 + [gyro] * 3), axis=0)
    return np.diff(np.rint(scaled), axis=0, prepend=0.0).astype(int)


def raw_lines(
    output: Output = OUT, *, kind="RAWIMUSX", number=26, gyro=LITEF_RAD, accel=LITEF_M_S, info="00"
) -> list[str]:
    out = []
    for t, row in zip(output.time_s, counts(output, gyro, accel)):
        body = f"{WEEK},{t:.9f},00000077," + ",".join(map(str, row))
        body = f"{info},{number}," + body if kind.endswith("X") else body
        short = "S" in kind.removeprefix("RAWIMU")
        head = (
            f"{WEEK},{t:.3f}"
            if short
            else f"COM1,0,60.0,FINESTEERING,{WEEK},{t:.3f},02000020,0dc5,16809"
        )
        out.append(line("%" if short else "#", f"{kind}A,{head};{body}"))
    return out


def header(t: float) -> str:
    return f"COM1,0,60.0,FINESTEERING,{WEEK},{t:.3f},02000020,c292,16809"


def position(t: float, k: int, *, name="BESTGNSSPOS", kind="SINGLE", status="SOL_COMPUTED") -> str:
    """Heights above the geoid, which lies 30 m below the ellipsoid."""
    place = f"{LAT_DEG + k * 1e-5:.11f},{LON_DEG:.11f},{HEIGHT_M + 30:.4f}"
    place += ",-30.0000,WGS84,0.3000,0.4000,0.9000"
    return line(
        "#",
        f'{name}A,{header(t)};{status},{kind},{place},"AAAA",0.000,0.000,18,18,18,0,00,02,11,01',
    )


def velocity(
    t: float, speed: float, *, latency=0.25, track=30.0, up=0.5, name="BESTGNSSVEL"
) -> str:
    return line(
        "#",
        f"{name}A,{header(t)};SOL_COMPUTED,SINGLE,{latency:.3f},0.000,{speed:.4f},{track:.6f},{up:.4f},0.0",
    )


def solution(t: float, status="INS_SOLUTION_GOOD") -> str:
    angles = f"{ROLL_DEG:.9f},{PITCH_DEG:.9f},{HEADING_DEG:.9f}"
    body = (
        f"{WEEK},{t:.9f},{LAT_DEG:.11f},{LON_DEG:.11f},{HEIGHT_M:.4f},1.0,2.0,0.5,{angles},{status}"
    )
    return line("%", f"INSPVASA,{WEEK},{t:.3f};{body}")


def config(name: str, turn="0.0000,0.0000,0.0000") -> str:
    before = f"{name},5,50,20,DEFAULT,7fd1bf,AUTOMATIC,ROVER,FALSE,0,0,0,17,0,0,0,0,0,0,0,1"
    return line(
        "#",
        f"INSCONFIGA,{header(SECONDS)};{before},RBV,IMUBODY,{turn},3.0000,3.0000,3.0000,FROM_COMMAND",
    )


def write(path, lines):
    path.write_text("\r\n".join(lines) + "\r\n")
    return path


def convert(tmp_path, lines, options=None, given=GIVEN):
    return convert_log(write(tmp_path / "span.log", lines), options or {}, given)


def check_parked_on_average(run, output=OUT):
    w, f = at_rest()
    span = run.imu.dt_s.sum()
    assert run.imu.rows == output.rows
    np.testing.assert_allclose(run.imu.dtheta_rad.sum(axis=0) / span, w, atol=2e-9)
    np.testing.assert_allclose(run.imu.dv_m_s.sum(axis=0) / span, f, atol=2e-6)


@pytest.mark.parametrize(
    "text", DOCUMENTED, ids=[text[1 : text.index("A,")] for text in DOCUMENTED]
)
def test_the_check_of_documented_lines(text):
    body, _, check = text[1:].partition("*")
    assert crc32(body.encode()) == check_sum(body) == int(check, 16)


def test_documented_rows_show_gravity_upward():
    """A G320 on NovAtel's own desk: rates and forces by its table, 1 g on z within its 0.6 %."""
    fields = DOCUMENTED[0].partition(";")[2].partition("*")[0].split(",")
    known = imu_type("EPSON_G320")
    scale, unit = known.accel
    force = np.array(fields[3:6], dtype=float) * scale * 1e-3
    assert unit == "mg"
    assert force[0] == pytest.approx(1.0, abs=0.01)
    assert np.linalg.norm(force) == pytest.approx(1.0, abs=0.01)


@pytest.mark.parametrize("kind", ["RAWIMU", "RAWIMUS", "RAWIMUX", "RAWIMUSX"])
def test_parked(tmp_path, kind):
    """Week 2400 began on 2026-01-04; 200 000 s later is Tuesday 07:33:20, GPS 18 s ahead of UTC."""
    made = convert(
        tmp_path,
        [config("ISA100C"), *raw_lines(kind=kind)],
        given={
            k: v for k, v in GIVEN.items() if k in ("imu_serial", "lat_deg", "lon_deg", "height_m")
        },
    )
    check_parked_on_average(made.run)
    assert made.record.format == "novatel"
    assert made.run.header.start_utc == "2026-01-06T07:33:02.000Z"
    assert made.run.header.gyro_technology == "fog"
    assert made.run.imu.source == "increments" and made.run.temperature is None
    notes = " ".join(made.record.notes)
    assert "gyro 1e-09 rad, accel 2e-08 m/s" in notes
    assert f"{kind} has no temperature" in notes
    assert "IMU axes taken as y forward, x right, z up" in notes


def test_a_right_turn_is_one(tmp_path):
    check_right_turn(convert(tmp_path, raw_lines(parked_and_turned(dt=0.005, start_s=SECONDS))).run)


# Scales typed from other sources than NovAtel's driver: Apollo's GetImuParameter (rad, m/s), the
# OEM6 SPAN manual for the rest.
SCALES = {
    "HG1700_AG58": (1.16415321826934814453e-10, 0.3048 * 7.450580596923828125e-9, 0.01),
    "HG1700-AG62": (1.16415321826934814453e-10, 0.3048 * 1.490116119384765625e-8, 0.01),
    "LN200": (1.9073486328125e-06, 6.103515625e-05, 0.005),
    "IMAR_FSAS": (1.893803441835e-9, 1.52587890625e-6, 0.005),
    "ISA100C": (1.0e-9, 2.0e-8, 0.005),
    "ADIS16488": (5.8516723170686385e-09, 9.31322574615478515625e-8, 0.005),
    "OEM-IMU-STIM300": (8.32237840649762e-09, 2.384185791015625e-07, 0.008),
    "KVH1750": (1.0850694444444445e-07, 1.52587890625e-06, 0.005),
    # Apollo: the same with 9.8015
    "EPSON_G320": (1.7044230976507124e-11, 0.2 / 65536 * 9.80665e-3 / 125, 0.008),
    "µIMU": (1.0e-9, 2.0e-8, 0.005),
    "HG4930_AN01": (2.0**-33, 2.0**-29, 0.01),
}


@pytest.mark.parametrize("name", SCALES)
def test_types(tmp_path, name):
    """In the counts of each type; the mean is right within a count of the whole stretch."""
    gyro, accel, dt = SCALES[name]
    output = parked(dt=dt, start_s=SECONDS, seconds=40.0)
    made = convert(
        tmp_path,
        raw_lines(output, kind="RAWIMUS", gyro=gyro, accel=accel),
        {"imu_type": name},
        GIVEN | {"gyro_technology": imu_type(name).technology},
    )
    w, f = at_rest()
    np.testing.assert_allclose(
        made.run.imu.dtheta_rad.sum(axis=0) / 40.0, w, atol=gyro / 40.0 + 1e-10
    )
    np.testing.assert_allclose(made.run.imu.dv_m_s.sum(axis=0) / 40.0, f, atol=accel / 40.0 + 1e-6)
    assert not any("rows missing" in note for note in made.record.notes)


@pytest.mark.parametrize(
    ("lines", "options", "line_of_error"),
    [
        (raw_lines(kind="RAWIMUS"), {}, "needed imu_type"),
        (raw_lines(number=99), {}, ("imu_type '99'")),
        (raw_lines(info="02"), {}, "encrypted"),
        (raw_lines(number=8), {}, r"span\.log: 10000 of 10000 rows are damaged"),
        (raw_lines(number=31), {}, r"45\.\d+ m/s2, needed 9\.8"),
        ([config("ISA100C", "180.0000,0.0000,90.0000"), *raw_lines()], {}, ("RBV 180 0 90 deg")),
        (raw_lines(), {"axes": {"x": "x", "y": "y", "z": "z"}}, "z points up"),
        ([position(SECONDS, 0)], {}, r"span\.log: no RAWIMU log, has BESTGNSSPOS"),
        (raw_lines(), {"imu_types": "x"}, "unknown key imu_types"),
    ],
    ids=[
        "no type",
        "unknown type",
        "encrypted",
        "wrong type, far off",
        "wrong type",
        "turned",
        "wrong axes",
        "no imu",
        "typo",
    ],
)
def test_what_cannot_be_known_is_refused(tmp_path, lines, options, line_of_error):
    with pytest.raises(InputError, match=line_of_error):
        convert(tmp_path, lines, options)


def test_a_scale_of_the_map_and_other_axes(tmp_path):
    """Mounted with x backward, y left, z down ... as forward, right, down by the map."""
    options = {"imu_scale": {"gyro_rad": LITEF_RAD, "accel_m_s": LITEF_M_S}}
    check_parked_on_average(convert(tmp_path, raw_lines(number=99), options).run)
    turned = convert(tmp_path, raw_lines(), {"axes": {"x": "-y", "y": "-x", "z": "-z"}}).run
    f = at_rest()[1]
    np.testing.assert_allclose(turned.imu.dv_m_s.sum(axis=0) / 50.0, f * [-1, -1, 1], atol=2e-6)


def test_bad_lines_are_dropped_and_listed(tmp_path):
    lines = raw_lines()
    lines[100] = lines[100].replace(",00000077,", ",00000076,")
    lines[200] = lines[200][:40]
    lines[300] = "\x01\x02garbage" + lines[300]
    lines[400] = "nothing of ours"
    lines[500] = lines[500].replace(";00,26", ";01,26")
    text = lines[500][1:].partition("*")[0]
    lines[500] = line("%", text)
    made = convert(tmp_path, lines)
    notes = made.record.notes
    assert "span.log: line 101 dropped: wrong CRC" in notes
    assert "line 201 dropped" in str(notes)
    assert any("RAWIMUSX row 498 dropped" in note for note in notes)
    assert made.run.imu.rows == OUT.rows - 4
    assert (
        sum("1 imu rows lost" in s.reason or "imu rows lost" in s.reason for s in made.run.faults)
        >= 1
    )


def test_fixes_with_ellipsoid_heights_and_late_velocities(tmp_path):
    """Speed grows by 0.1 m/s each second and is a quarter of a second old: at a position's time it
    is 0.025 m/s more.
    """
    t = SECONDS + np.arange(1, 50.0)
    pairs = [text for k, s in enumerate(t) for text in (position(s, k), velocity(s, 2.0 + 0.1 * k))]
    made = convert(tmp_path, [*raw_lines(), *pairs], given=PLACELESS)
    gnss = made.run.gnss
    assert gnss.time_s.size == 49 and gnss.time_s[0] == pytest.approx(1.0)
    np.testing.assert_allclose(gnss.height_m, HEIGHT_M)
    np.testing.assert_allclose(np.degrees(gnss.lat_rad), LAT_DEG + 1e-5 * np.arange(49), atol=1e-10)
    speed = 2.0 + 0.1 * np.arange(49)[:-1] + 0.025
    angle = np.radians(30.0)
    expected = np.column_stack([speed * np.cos(angle), speed * np.sin(angle), np.full(48, -0.5)])
    np.testing.assert_allclose(gnss.v_n_m_s[:-1], expected, atol=1e-4)
    np.testing.assert_allclose(gnss.sigma_horizontal_m, 0.5 / np.sqrt(2))
    np.testing.assert_allclose(gnss.sigma_vertical_m, 0.9)
    assert gnss.sigma_velocity_m_s is None
    np.testing.assert_array_equal(gnss.fix_type, FixType.SINGLE)
    assert made.run.header.site.height_m == pytest.approx(HEIGHT_M)


def test_inertial_solutions_are_no_fixes(tmp_path):
    """BESTPOS of a SPAN receiver; a position that was not computed is left out too."""
    lines = [
        position(SECONDS + k, k, name="BESTPOS", kind="INS_PSRSP" if k < 20 else "SINGLE")
        for k in range(1, 40)
    ]
    lines += [
        position(SECONDS + k, k, name="BESTPOS", status="INSUFFICIENT_OBS") for k in range(40, 45)
    ]
    lines += [velocity(SECONDS + k, 1.0, name="BESTVEL") for k in range(1, 50)]
    made = convert(tmp_path, [*raw_lines(), *lines], given=PLACELESS)
    assert made.run.gnss.time_s.size == 20
    notes = " ".join(made.record.notes)
    assert "19 inertial solutions" in notes and "left out: no 3D fix" in notes


def test_the_filters_solution_is_reference_only(tmp_path):
    lines = [
        solution(SECONDS + 0.5 * k, "INS_ALIGNING" if k < 10 else "INS_SOLUTION_GOOD")
        for k in range(1, 60)
    ]
    made = convert(tmp_path, [*raw_lines(), *lines])
    assert made.run.gnss is None
    reference = made.reference
    assert reference.time_s[[0, -1]] == pytest.approx([5.0, 29.5])
    angles = np.degrees([reference.roll_rad[3], reference.pitch_rad[3], reference.heading_rad[3]])
    np.testing.assert_allclose(angles, [ROLL_DEG, PITCH_DEG, HEADING_DEG])
    np.testing.assert_allclose(reference.v_n_m_s[3], [1.0, 2.0, -0.5])
    assert any("50 rows" in note for note in made.record.notes)


def test_fixes_of_a_log_of_their_own(tmp_path):
    pairs = [
        text
        for k in range(1, 50)
        for text in (position(SECONDS + k, k), velocity(SECONDS + k, 2.0))
    ]
    write(tmp_path / "gnss.log", pairs)
    made = convert(tmp_path, raw_lines(), {"gnss": {"file": "gnss.log"}}, PLACELESS)
    assert made.run.gnss.time_s.size == 49 and made.record.other_sources[0].source == "gnss.log"
