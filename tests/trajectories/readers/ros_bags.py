"""ROS bags of a vehicle that stands nose up and right side down, then turns right; written by
rosbags, in every form.

Axes of the messages are those of REP-103 (x forward, y left, z up), so that standing level reads +g
on z, a nose that points up reads + on x, a left side that points up + on y, and a turn to the right
- about z.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

ROLL, PITCH, TURN = np.radians(2.0), np.radians(5.0), 0.3  # [rad], [rad/s] to the right
G = 9.7930  # [m/s2] at 30 deg N
RATE_HZ, PARKED_S, TURNING_S = 100, 6.0, 2.0
ROWS = round((PARKED_S + TURNING_S) * RATE_HZ)
START_NS = 1_700_000_000 * 10**9  # 2023-11-14T22:13:20Z
LAT_DEG, LON_DEG, HEIGHT_M = 30.0, 7.0, 250.0
EAST, NORTH, UP = 1.0, 2.0, 0.5  # [m/s] that the receiver reports
FORMS = ("ros1", "ros1-bz2", "ros1-lz4", "sqlite3", "sqlite3-message", "mcap", "mcap-storage")


def f_flu() -> np.ndarray:
    return G * np.array([np.sin(PITCH), np.cos(PITCH) * np.sin(ROLL), np.cos(PITCH) * np.cos(ROLL)])


@dataclass(frozen=True, kw_only=True)
class Recorded:
    """What a bag holds. stamps (rows,): other header stamps [ns]; flu: specific force (3,)."""

    imu_topics: tuple[str, ...] = ("/imu/data",)
    stamps: np.ndarray | None = None
    temperature_topics: tuple[str, ...] = ("/imu/temperature",)
    frame: str = "imu_link"
    velocity_frame: str = "gps"
    twist: str = "TwistWithCovarianceStamped"
    with_fix: bool = True
    flu: np.ndarray | None = None
    start_ns: int = START_NS
    rows: int = ROWS
    unknown_covariance: bool = False


def messages(**changes) -> list[tuple]:
    """(topic, type, receive time [ns], fields) in the order of receiving, of what `Recorded` says
    after these changes.
    """
    of = Recorded(**changes)
    out: list[tuple] = []
    w_turn = np.array([0.0, 0.0, -TURN])
    for k in range(of.rows):
        stamp = of.start_ns + k * 10**9 // RATE_HZ if of.stamps is None else int(of.stamps[k])
        received = of.start_ns + k * 10**9 // RATE_HZ + 3_000_000 + 100_000 * (k % 7)
        w = w_turn * (k >= PARKED_S * RATE_HZ)
        for i, topic in enumerate(of.imu_topics):
            out.append(
                (
                    topic,
                    "sensor_msgs/msg/Imu",
                    received + i,
                    (stamp, of.frame, w * (i + 1), f_flu() if of.flu is None else of.flu),
                )
            )
        if k % 50 == 0:
            for i, topic in enumerate(of.temperature_topics):
                out.append(
                    (
                        topic,
                        "sensor_msgs/msg/Temperature",
                        received + 10,
                        (stamp, of.frame, 30.0 + 10 * i + k / 1000),
                    )
                )
        if k % 20 == 5 and of.with_fix:
            out.append(
                (
                    "/fix",
                    "sensor_msgs/msg/NavSatFix",
                    received + 20,
                    (stamp, "gps", 2 * (not of.unknown_covariance)),
                )
            )
            out.append(
                (
                    "/vel",
                    f"geometry_msgs/msg/{of.twist}",
                    received + 30,
                    (stamp + 10**7, of.velocity_frame),
                )
            )
    return out


def write(path: Path, form: str, made: list[tuple] | None = None) -> Path:
    """A bag of the given form: a file for ROS 1, a folder for ROS 2."""
    made = messages() if made is None else made
    storage, _, packed = form.partition("-")
    return (_write_ros1 if storage == "ros1" else _write_ros2)(path, storage, packed, made)


def _write_ros1(path: Path, storage: str, packed: str, made: list[tuple]) -> Path:
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC)
    writer = Writer(path)
    writer.chunk_threshold = 20_000
    if packed:
        writer.set_compression(Writer.CompressionFormat[packed.upper()])
    with writer:
        connections = {
            (t, kind): writer.add_connection(t, kind, typestore=store)
            for t, kind in dict.fromkeys(m[:2] for m in made)
        }
        for topic, kind, received, fields in made:
            message = _message(store, kind, fields, ros1=True)
            writer.write(connections[topic, kind], received, store.serialize_ros1(message, kind))
    return path


def _write_ros2(path: Path, storage: str, packed: str, made: list[tuple]) -> Path:
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    writer = Writer(path, version=9, storage_plugin=StoragePlugin[storage.upper()])
    if packed:
        writer.set_compression(CompressionMode[packed.upper()], CompressionFormat.ZSTD)
    with writer:
        connections = {
            (t, kind): writer.add_connection(t, kind, typestore=store)
            for t, kind in dict.fromkeys(m[:2] for m in made)
        }
        for topic, kind, received, fields in made:
            writer.write(
                connections[topic, kind],
                received,
                store.serialize_cdr(_message(store, kind, fields), kind),
            )
    return path


def _message(store, kind: str, fields: tuple, *, ros1: bool = False):
    types = store.types
    stamp, frame, *values = fields
    head = {"seq": 0} if ros1 else {}
    time = types["builtin_interfaces/msg/Time"](sec=stamp // 10**9, nanosec=stamp % 10**9)
    header = types["std_msgs/msg/Header"](stamp=time, frame_id=frame, **head)
    return _MAKE[kind.rpartition("/")[2]](types, types[kind], header, *values)


def _vector(types, v):
    return types["geometry_msgs/msg/Vector3"](x=float(v[0]), y=float(v[1]), z=float(v[2]))


def _imu(types, kind, header, w, f):
    orientation = types["geometry_msgs/msg/Quaternion"](x=0.1, y=0.2, z=0.3, w=0.9)
    covariances = {
        f"{k}_covariance": np.full(9, 0.5)
        for k in ("orientation", "angular_velocity", "linear_acceleration")
    }
    if f is None:
        covariances["linear_acceleration_covariance"] = np.full(9, -1.0)
        f = np.zeros(3)
    return kind(
        header=header,
        orientation=orientation,
        angular_velocity=_vector(types, w),
        linear_acceleration=_vector(types, f),
        **covariances,
    )


def _temperature(types, kind, header, value):
    return kind(header=header, temperature=value, variance=0.01)


def _fix(types, kind, header, covariance_type):
    status = types["sensor_msgs/msg/NavSatStatus"](status=0, service=1)
    covariance = np.array([1.0, 0, 0, 0, 3.0, 0, 0, 0, 9.0])
    return kind(
        header=header,
        status=status,
        latitude=LAT_DEG,
        longitude=LON_DEG,
        altitude=HEIGHT_M,
        position_covariance=covariance,
        position_covariance_type=covariance_type,
    )


def _twist(types, kind, header):
    zero = _vector(types, (0.0, 0.0, 0.0))
    twist = types["geometry_msgs/msg/Twist"](linear=_vector(types, (EAST, NORTH, UP)), angular=zero)
    return kind(header=header, twist=twist)


def _twist_covariance(types, kind, header):
    zero = _vector(types, (0.0, 0.0, 0.0))
    twist = types["geometry_msgs/msg/Twist"](linear=_vector(types, (EAST, NORTH, UP)), angular=zero)
    full = np.diag([0.01, 0.04, 0.09, 1.0, 1.0, 1.0]).ravel()
    return kind(
        header=header,
        twist=types["geometry_msgs/msg/TwistWithCovariance"](twist=twist, covariance=full),
    )


_MAKE = {
    "Imu": _imu,
    "Temperature": _temperature,
    "NavSatFix": _fix,
    "TwistStamped": _twist,
    "TwistWithCovarianceStamped": _twist_covariance,
}
