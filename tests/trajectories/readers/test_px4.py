"""PX4 logs written by hand: a parked unit with every topic that holds an IMU, whole, cut off and
garbled.
"""

import struct
from pathlib import Path

import numpy as np
import pytest

from ins.records import FixType, InputError
from ins.units import DEG
from tests.trajectories.run_cases import F_B
from trajectories.readers.containers.ulog_file import read_ulog
from trajectories.readers.conversion import convert_log

W, DT_S, ROWS = np.array([0.01, -0.02, 0.03]), 0.01, 1000
# [rad/s] that the autopilot takes off; in the raw topic still
OFFSET = np.array([0.001, 0.002, -0.003])
FIRST_US = 7_000_000
UTC_US = 1_700_000_000_000_000  # 2023-11-14T22:13:20Z, at log time 0
FORMATS = {
    "sensor_gyro": (
        "uint64_t timestamp;uint64_t timestamp_sample;uint32_t device_id;float x;float y;float"
        " z;float temperature;uint32_t error_count;uint8_t[3] clip_counter;uint8_t"
        " samples;uint8_t[4] _padding0;"
    ),
    "sensor_accel": (
        "uint64_t timestamp;uint64_t timestamp_sample;uint32_t device_id;float x;float y;float z;"
    ),
    "vehicle_imu": (
        "uint64_t timestamp;uint64_t timestamp_sample;uint32_t accel_device_id;uint32_t"
        " gyro_device_id;float[3] delta_angle;float[3] delta_velocity;uint32_t"
        " delta_angle_dt;uint32_t delta_velocity_dt;"
    ),
    "sensor_combined": (
        "uint64_t timestamp;float[3] gyro_rad;uint32_t gyro_integral_dt;int32_t"
        " accelerometer_timestamp_relative;float[3] accelerometer_m_s2;uint32_t"
        " accelerometer_integral_dt;"
    ),
    "vehicle_gps_position": (
        "uint64_t timestamp;uint64_t time_utc_usec;double latitude_deg;double longitude_deg;double"
        " altitude_msl_m;double altitude_ellipsoid_m;float s_variance_m_s;float eph;float epv;float"
        " vel_n_m_s;float vel_e_m_s;float vel_d_m_s;uint8_t fix_type;"
    ),
    "sensor_gps": (
        "uint64_t timestamp;uint64_t time_utc_usec;int32_t lat;int32_t lon;int32_t alt;int32_t"
        " alt_ellipsoid;float s_variance_m_s;float eph;float epv;float vel_n_m_s;float"
        " vel_e_m_s;float vel_d_m_s;uint8_t fix_type;"
    ),
}
PACK = {
    "sensor_gyro": "<QQI4fI4B",
    "sensor_accel": "<QQI3f",
    "vehicle_imu": "<QQII6fII",
    "sensor_combined": "<Q3fIi3fI",
    "vehicle_gps_position": "<QQ4d6fB",
    "sensor_gps": "<QQ4i6fB",
}
IDS = [
    ("sensor_gyro", 0),
    ("sensor_gyro", 1),
    ("sensor_accel", 0),
    ("sensor_accel", 1),
    ("vehicle_imu", 0),
    ("vehicle_imu", 1),
    ("sensor_combined", 0),
    ("vehicle_gps_position", 0),
    ("sensor_gps", 0),
]


def block(kind: str, body: bytes) -> bytes:
    return struct.pack("<HB", len(body), ord(kind)) + body


def info(kind: str, key: str, packed: bytes) -> bytes:
    return block(kind, bytes([len(key)]) + key.encode() + packed)


def data(name: str, instance: int, *values) -> bytes:
    return block(
        "D", struct.pack("<H", IDS.index((name, instance))) + struct.pack(PACK[name], *values)
    )


def head(parameters: dict[str, float | int]) -> bytes:
    out = b"ULog\x01\x12\x35\x01" + struct.pack("<Q", FIRST_US) + block("B", bytes(40))
    out += b"".join(block("F", f"{name}:{fields}".encode()) for name, fields in FORMATS.items())
    out += info("I", "char[12] sys_uuid", b"0001DEADBEEF")
    for name, value in parameters.items():
        whole = isinstance(value, int)
        out += info(
            "P",
            f"{'int32_t' if whole else 'float'} {name}",
            struct.pack("<i" if whole else "<f", value),
        )
    names = enumerate(IDS)
    return out + b"".join(
        block("A", bytes([instance]) + struct.pack("<H", k) + name.encode())
        for k, (name, instance) in names
    )


def ulog(
    *,
    topics=(
        "sensor_gyro",
        "sensor_accel",
        "vehicle_imu",
        "sensor_combined",
        "vehicle_gps_position",
    ),
    rows=ROWS,
    parameters=None,
    gyro_every=1,
) -> list[bytes]:
    """Two IMUs at 100 Hz, the second one's accelerometer read 2 ms later; temperatures rise by 1
    degC in 10 s; the first fix is one in two dimensions.
    """
    out = [
        head({"CAL_GYRO0_XOFF": 0.001, "SENS_BOARD_ROT": 0} if parameters is None else parameters)
    ]
    for k in range(rows):
        us = FIRST_US + 10_000 * k
        made = []
        for i in (0, 1):
            w = (i + 1) * W
            if k % gyro_every == 0:
                made.append(
                    (
                        "sensor_gyro",
                        i,
                        us + 300,
                        us,
                        100 + i,
                        *(w + OFFSET),
                        30 + 10 * i + k / 1000,
                        0,
                        *bytes(4),
                    )
                )
            made.append(("sensor_accel", i, us + 300, us + 2000, 200 + i, *F_B))
            made.append(
                (
                    "vehicle_imu",
                    i,
                    us + 300,
                    us,
                    200 + i,
                    100 + i,
                    *(w * 0.01),
                    *(F_B * 0.0098),
                    10_000,
                    9800,
                )
            )
        made.append(("sensor_combined", 0, us, *W, 10_000, 0, *F_B, 10_000))
        if k % 20 == 5:
            made.append(
                (
                    "vehicle_gps_position",
                    0,
                    us,
                    UTC_US + us,
                    47.5,
                    8.5,
                    400.0,
                    447.5,
                    0.2,
                    0.8,
                    1.2,
                    1.0,
                    2.0,
                    -0.5,
                    2 if k == 5 else 3,
                )
            )
            made.append(
                (
                    "sensor_gps",
                    0,
                    us,
                    UTC_US + us,
                    475_000_000,
                    85_000_000,
                    400_000,
                    447_500,
                    0.2,
                    0.8,
                    1.2,
                    1.0,
                    2.0,
                    -0.5,
                    2 if k == 5 else 3,
                )
            )
        out += [data(*m) for m in made if m[0] in topics]
    return out


def write(path: Path, blocks: list[bytes]) -> Path:
    path.write_bytes(b"".join(blocks))
    return path


def check_parked(run, w, rows=ROWS):
    assert run.imu.rows == rows
    np.testing.assert_allclose(
        run.imu.dtheta_rad / run.imu.dt_s[:, None], np.tile(w, (rows, 1)), rtol=1e-5
    )
    np.testing.assert_allclose(
        run.imu.dv_m_s / run.imu.dt_s[:, None], np.tile(F_B, (rows, 1)), rtol=1e-5, atol=1e-6
    )


def test_raw_topics_come_first(tmp_path):
    """Offsets are still in them. UTC by hand: 1 700 000 000 s since 1970 and 6.99 s of log time."""
    made = convert_log(write(tmp_path / "flight.ulg", ulog()), {}, {})
    check_parked(made.run, W + OFFSET)
    header = made.run.header
    assert made.record.format == "ulog"
    assert header.run_id == "flight-imu1"
    assert header.imu_serial == "0001DEADBEEF-imu1"
    assert header.start_utc == "2023-11-14T22:13:26.990Z"
    assert header.site.lat_rad == pytest.approx(47.5 * DEG) and header.site.height_m == 447.5
    np.testing.assert_allclose(made.run.gnss.v_n_m_s[0], [1.0, 2.0, -0.5])
    np.testing.assert_allclose(made.run.gnss.sigma_vertical_m, 1.2, rtol=1e-6)
    np.testing.assert_array_equal(made.run.gnss.fix_type, FixType.SINGLE)
    assert made.run.gnss.time_s[0] == pytest.approx(0.26)
    assert any("nearest sensor_accel row, 2.0 ms apart" in n for n in made.record.notes)
    T = made.run.temperature
    np.testing.assert_allclose(T.gyro_degC[:, 1], 30.0 + (T.time_s - 0.01) * 0.1, atol=1e-4)


@pytest.mark.parametrize(("topic", "w"), [("sensor_gyro", 2 * W + OFFSET), ("vehicle_imu", 2 * W)])
def test_the_second_imu(tmp_path, topic, w):
    made = convert_log(write(tmp_path / "flight.ulg", ulog()), {"imu": 2, "topic": topic}, {})
    check_parked(made.run, w)
    assert made.run.header.imu_serial == "0001DEADBEEF-imu2"
    assert made.run.temperature.gyro_degC[0, 0] == pytest.approx(40.05, abs=0.01)


@pytest.mark.parametrize(
    ("topics", "named"),
    [
        (("vehicle_imu", "sensor_combined"), "vehicle_imu"),
        (("sensor_combined",), "sensor_combined"),
    ],
)
def test_other_topics_where_raw_ones_are_missing_or_slow(tmp_path, topics, named):
    """sensor_gyro at 2 Hz still gives the temperature, and the calibration offsets taken off."""
    blocks = ulog(topics=(*topics, "sensor_gyro", "sensor_gps"), gyro_every=50)
    made = convert_log(write(tmp_path / "flight.ulg", blocks), {}, {})
    check_parked(made.run, W)
    notes = " ".join(made.record.notes)
    assert (
        f"{named} 1: rates are less the autopilot's calibration offsets (CAL_GYRO0_XOFF +0.001000"
        " rad/s)" in notes
    )
    assert made.run.temperature.gyro_degC[0, 0] == pytest.approx(30.025, abs=0.001)
    assert made.run.header.site.lon_rad == pytest.approx(8.5 * DEG)
    assert made.run.header.site.height_m == pytest.approx(447.5)


@pytest.mark.parametrize(
    ("parameters", "options", "line"),
    [
        ({"SENS_BOARD_ROT": 4}, {}, "SENS_BOARD_ROT is 4"),
        ({"CAL_GYRO1_ID": 101, "CAL_GYRO1_ROT": 6}, {"imu": 2}, r"CAL_GYRO1_ROT is 6"),
        ({"TC_G_ENABLE": 1}, {"topic": "vehicle_imu"}, "vehicle_imu 1: TC_G_ENABLE is on"),
        ({}, {"imu": 3}, ("no IMU 3")),
        ({}, {"imu": 2, "topic": "sensor_combined"}, "no sensor_combined of IMU 2"),
        ({}, {"topic": "vehicle_attitude"}, r"map: topic: got \"vehicle_attitude\""),
    ],
)
def test_what_cannot_be_used_is_refused(tmp_path, parameters, options, line):
    path = write(tmp_path / "flight.ulg", ulog(rows=100, parameters=parameters))
    with pytest.raises(InputError, match=line):
        convert_log(path, options, {})


def test_compensation_in_flight_leaves_the_raw_topics_usable(tmp_path):
    path = write(tmp_path / "flight.ulg", ulog(parameters={"TC_G_ENABLE": 1}))
    check_parked(convert_log(path, {}, {}).run, W + OFFSET)


def test_the_same_as_pyulog(tmp_path):
    """Every topic and field of the wanted ones, bit for bit."""
    from pyulog import ULog

    path = write(tmp_path / "flight.ulg", ulog(rows=60))
    own = read_ulog(path, [name for name, _ in IDS])
    theirs = ULog(str(path))
    assert set(own.topics) == {(d.name, d.multi_id) for d in theirs.data_list}
    for d in theirs.data_list:
        topic = own.topics[d.name, d.multi_id]
        assert {k for k in d.data if not k.startswith("_padding")} == set(topic)
        for name, values in topic.items():
            np.testing.assert_array_equal(values, d.data[name].astype(float))
    assert own.parameters == pytest.approx(theirs.initial_parameters)
    assert own.information["sys_uuid"] == theirs.msg_info_dict["sys_uuid"]


def test_cut_off_and_damaged_logs_name_the_place(tmp_path):
    blocks = ulog(topics=("sensor_combined", "vehicle_gps_position"))
    whole = b"".join(blocks)
    path = tmp_path / "cut.ulg"
    path.write_bytes(whole[:-7])
    made = convert_log(path, {}, {})
    check_parked(made.run, W, ROWS - 1)
    start, left = len(whole) - len(blocks[-1]), len(blocks[-1]) - 7
    assert (
        f"cut.ulg: ends within a message, the last {left} bytes (from byte {start}) dropped"
        in made.record.notes
    )
    at = sum(map(len, blocks[:400]))
    path.write_bytes(whole[:at] + b"\xff" * len(blocks[400]) + whole[at + len(blocks[400]) :])
    made = convert_log(path, {}, {})
    np.testing.assert_allclose(made.run.imu.dtheta_rad[:, 2] / made.run.imu.dt_s, W[2], rtol=1e-5)
    told = next(n for n in made.record.notes if "damaged, skipped: bytes " in n)
    assert at - len(blocks[399]) == int(told.split("skipped: bytes ")[1].split("-")[0])
    assert made.run.imu.rows == ROWS - 2


@pytest.mark.parametrize("content", [b"", bytes(9), bytes(90)])
def test_a_log_without_data_is_bad_input(tmp_path, content):
    (tmp_path / "a.ulg").write_bytes(b"ULog\x01\x12\x35" + content)
    with pytest.raises(InputError, match=r"a\.ulg: no IMU 1 at 10 Hz or more, has none"):
        convert_log(tmp_path / "a.ulg", {}, {})
