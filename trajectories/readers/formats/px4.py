"""PX4 logs (ULog) to a log: one of the IMUs, its temperature, the GPS, and what run.json needs.

Three topics hold an IMU: `sensor_gyro` with `sensor_accel` (raw), `vehicle_imu` (increments) and
`sensor_combined` (rates of whichever IMU was in use), the last two less the autopilot's calibration
offsets. Raw comes first, if it was logged fast enough. Axes are forward, right, down; a turned
board or temperature compensation in flight is refused.
"""

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from ins.records import AXES, InputError, TemperatureLog
from trajectories.readers.columns.fix_types import AUTOPILOT, fix_types
from trajectories.readers.columns.fixes import LoggedFixes, RawFixes, good_fixes
from trajectories.readers.columns.imu_columns import converted, plausible_degC, second_means
from trajectories.readers.containers.ulog_file import Topic, UlogTables, is_ulog, read_ulog
from trajectories.readers.registry import ConvertedLog, Reader
from trajectories.readers.rows.clocks import nearest
from trajectories.readers.rows.column_map import LogOptions, StretchKeys, imu_map
from trajectories.readers.rows.row_cleaning import row_ranges
from trajectories.runs.checks import MIN_RATE_HZ, RATE_TOLERANCE
from trajectories.runs.notes import About, Note, about

RAW_TOPIC = "sensor_gyro"
INTEGRATED = "vehicle_imu"
COMBINED = "sensor_combined"
IMU_TOPICS = (RAW_TOPIC, INTEGRATED, COMBINED)
BOARD_PARAMETERS = ("SENS_BOARD_ROT", "SENS_BOARD_X_OFF", "SENS_BOARD_Y_OFF", "SENS_BOARD_Z_OFF")
GPS = ("vehicle_gps_position", "sensor_gps")
WANTED_TOPICS = [*IMU_TOPICS, "sensor_accel", *GPS]
FIX_TYPE_3D = 3  # PX4, sensor_gps.msg: 3 is a 3D fix, those above are better
# of the gyros' rate: every other row, 10 % off for two clocks; slower, and the nearest of its
# rows is that of another moment
SLOWEST_ACCEL = 0.45
US = 1e-6
W, F = ([f"{sensor}{a}" for a in AXES] for sensor in "wf")
Columns = dict[str, NDArray]


class Px4Keys(StretchKeys):
    """Map keys of a PX4 log. `topic`: where the IMU is taken from; default the first of IMU_TOPICS
    that will do.
    """

    format: str | None = None
    imu: Annotated[int, Field(ge=1, le=9)] = 1
    topic: Literal["sensor_gyro", "vehicle_imu", "sensor_combined"] | None = None


def read(path: Path, options: LogOptions) -> ConvertedLog:
    """The log of one IMU. InputError where the log has no such IMU, or its compensation cannot be
    undone.
    """
    keys = options.parsed(Px4Keys)
    tables = read_ulog(path, WANTED_TOPICS)
    topic = keys.topic or _best(tables, keys.imu, path.name)
    if (topic, keys.imu - 1) not in tables.topics:
        held = sorted(i + 1 for name, i in tables.topics if name == topic)
        raise InputError(
            f"{path.name}: no {topic} of IMU {keys.imu}, has {', '.join(map(str, held)) or 'none'}"
            " (--imu)"
        )
    label = f"{path.name}: {topic} {keys.imu}"
    if topic == RAW_TOPIC:
        _refuse_turned(tables, keys.imu - 1, label)
    notes = [] if topic == RAW_TOPIC else _compensation(tables, topic, label)
    make = {RAW_TOPIC: _raw, INTEGRATED: _integrated, COMBINED: _combined}[topic]
    columns, more = make(tables, keys.imu - 1, label)
    log = converted(columns, imu_map(keys, W, F), label=label, notes=[])
    found, gps_notes = _fixes(tables, path.name)
    gyro_degC, degC_notes = _temperature(tables, topic, keys.imu - 1, log, label)
    serial = f"{tables.information.get('sys_uuid') or path.stem}-imu{keys.imu}"
    header: dict[str, Any] = {
        "run_id": f"{path.stem}-imu{keys.imu}",
        "gyro_technology": "mems",
        "imu_serial": serial[:200],
    }
    return replace(
        log,
        gnss=None if found is None else found.on_run_time(log),
        temperature=gyro_degC,
        notes=(*tables.notes, *log.notes, *notes, *more, *degC_notes, *gps_notes),
        header={**header, **(found.header(log) if found else {}), **keys.run},
    )


def _best(tables: UlogTables, number: int, label: str) -> str:
    """The first topic that has this IMU at a rate that a run may have."""
    for name in IMU_TOPICS:
        topics = [
            tables.topics.get((k, number - 1))
            for k in ((name, "sensor_accel") if name == RAW_TOPIC else (name,))
        ]
        rates = [0.0 if t is None else _rate_hz(t) for t in topics]
        if (
            min(rates) >= MIN_RATE_HZ * (1 - RATE_TOLERANCE)
            and rates[-1] > SLOWEST_ACCEL * rates[0]
        ):
            return name
    held = sorted(f"{name} {i + 1}" for name, i in tables.topics if name in IMU_TOPICS)
    raise InputError(
        f"{label}: no IMU {number} at {MIN_RATE_HZ:g} Hz or more, has {', '.join(held) or 'none'}"
        " (--imu)"
    )


def _rate_hz(topic: Topic) -> float:
    steps = np.diff(_clock(topic))
    steps = steps[steps > 0]  # 0: a message logged twice
    return float(1.0 / np.median(steps)) if steps.size else 0.0


def _clock(topic: Topic) -> NDArray:
    """Log time [s]: of the sample where the topic says so, else of the message."""
    sample = topic.get("timestamp_sample")
    return np.asarray(topic["timestamp"] if sample is None or not sample.any() else sample) * US


def _field(topic: Topic, name: str, label: str) -> NDArray:
    if name not in topic:
        raise InputError(f"{label}: no field {name}, has {' '.join(topic)}"[:300])
    return topic[name]


def _refuse_turned(tables: UlogTables, instance: int, label: str) -> None:
    """Raw topics are in the axes of the board (or of an external sensor): InputError where those
    are not the vehicle's.
    """
    turned = [k for k in BOARD_PARAMETERS if tables.parameters.get(k)]
    device = tables.topics[RAW_TOPIC, instance].get("device_id", np.zeros(1))
    for k in range(4):
        same = tables.parameters.get(f"CAL_GYRO{k}_ID", 0.0) % 2**32 == device[0] != 0
        turned += (
            [f"CAL_GYRO{k}_ROT"]
            if same and tables.parameters.get(f"CAL_GYRO{k}_ROT", -1.0) > 0
            else []
        )
    if turned:
        told = f"{turned[0]} is {tables.parameters[turned[0]]:g}, needed 0 for raw sensor axes"
        raise InputError(
            f"{label}: the sensor is turned in the vehicle: {told} (or another topic in the map)"
        )


def _compensation(tables: UlogTables, topic: str, label: str) -> list[str]:
    """A note on what the autopilot did to the values; InputError where it cannot be told apart from
    the sensor's own.
    """
    if tables.parameters.get("TC_G_ENABLE"):
        raise InputError(
            f"{label}: TC_G_ENABLE is on: gyros compensated for temperature in flight, needed raw"
            f" {RAW_TOPIC} in the log"
        )
    offsets = {
        k: v
        for k, v in tables.parameters.items()
        if k.startswith("CAL_GYRO") and k.endswith("OFF") and v
    }
    told = " ".join(f"{k} {v:+.6f}" for k, v in sorted(offsets.items())) or "none"
    return [
        f"{label}: rates are less the autopilot's calibration offsets ({told} rad/s), as logged"
    ]


def _raw(tables: UlogTables, instance: int, label: str) -> tuple[Columns, list[str]]:
    """Gyro rows, each with the accelerometer row nearest in time."""
    gyro, accel = tables.topics[RAW_TOPIC, instance], tables.topics.get(("sensor_accel", instance))
    if accel is None:
        raise InputError(f"{label}: no sensor_accel {instance + 1} beside it")
    time_s, accel_s = _clock(gyro), _clock(accel)
    if accel_s.size < 2:
        raise InputError(f"{label}: one row of sensor_accel, needed at least 2")
    beside = nearest(accel_s, time_s)
    apart_s = np.abs(accel_s[beside] - time_s)
    rate_hz, accel_hz = _rate_hz(gyro), _rate_hz(accel)
    if not accel_hz > SLOWEST_ACCEL * rate_hz:
        raise InputError(
            f"{label}: {rate_hz:.4g} Hz, sensor_accel {accel_hz:.4g} Hz: needed like rates (or"
            " another topic in the map)"
        )
    usable = apart_s <= 1.0 / rate_hz
    if np.count_nonzero(usable) < 2:
        raise InputError(f"{label}: no rows with sensor_accel beside them")
    columns = {"time": time_s} | {f"w{a}": _field(gyro, a, label) for a in AXES}
    columns |= {f"f{a}": _field(accel, a, label)[beside] for a in AXES}
    alone = np.flatnonzero(~usable)
    notes = (
        [f"{label}: {row_ranges(alone)} dropped: no sensor_accel beside them (lost)"]
        if alone.size
        else []
    )
    told = (
        f"{label}: each row has the nearest sensor_accel row,"
        f" {float(np.median(apart_s[usable])) * 1e3:.1f} ms apart (median)"
    )
    return {name: values[usable] for name, values in columns.items()}, [*notes, told]


def _integrated(tables: UlogTables, instance: int, label: str) -> tuple[Columns, list[str]]:
    """Increments over their own interval, as mean rates: the log's intervals are not exactly those
    of its stamps.
    """
    topic = tables.topics[INTEGRATED, instance]
    columns = {"time": _clock(topic)}
    angle_s, velocity_s = (
        _field(topic, f"delta_{k}_dt", label) * US for k in ("angle", "velocity")
    )
    with np.errstate(divide="ignore", invalid="ignore"):
        for i, axis in enumerate(AXES):
            columns[f"w{axis}"] = _field(topic, f"delta_angle[{i}]", label) / angle_s
            columns[f"f{axis}"] = _field(topic, f"delta_velocity[{i}]", label) / velocity_s
    return columns, []


def _combined(tables: UlogTables, instance: int, label: str) -> tuple[Columns, list[str]]:
    topic = tables.topics[COMBINED, instance]
    columns = {"time": _clock(topic)} | {
        f"w{a}": _field(topic, f"gyro_rad[{i}]", label) for i, a in enumerate(AXES)
    }
    columns |= {
        f"f{a}": _field(topic, f"accelerometer_m_s2[{i}]", label) for i, a in enumerate(AXES)
    }
    return columns, [f"{label}: of whichever IMU the autopilot used, which may change in flight"]


def _temperature(
    tables: UlogTables, topic: str, instance: int, log: ConvertedLog, label: str
) -> tuple[TemperatureLog | None, list[str]]:
    """Of the gyro of the same device where the topic names it, else of the same instance, and
    notes; None where not logged.
    """
    device = tables.topics[topic, instance].get("gyro_device_id")
    for (name, number), sensor in sorted(tables.topics.items()):
        same = (
            number == instance
            if device is None
            else np.array_equal(sensor.get("device_id", np.empty(0))[:1], device[:1])
        )
        if name == RAW_TOPIC and same and "temperature" in sensor:
            time_s, values = _clock(sensor) - log.time_shift_s, sensor["temperature"]
            rows = np.flatnonzero((values != 0.0) & (time_s >= 0) & (time_s <= log.imu.end_s))
            rows = rows[np.argsort(time_s[rows], kind="stable")]
            sane, notes = plausible_degC(values[rows], label, asked_for=False)
            return second_means(time_s[rows], np.repeat(sane[:, None], 3, axis=1)), [
                n for n in notes if about(n) is About.TEMPERATURE
            ]
    return None, []


def _fixes(tables: UlogTables, label: str) -> tuple[LoggedFixes | None, list[str]]:
    """Fixes of the first receiver; old firmware has degrees in 1e-7 and millimetres."""
    gps = next((tables.topics[name, 0] for name in GPS if (name, 0) in tables.topics), None)
    if gps is None:
        return None, [Note(f"{label}: no {GPS[0]}: no gnss stream", About.FIXES)]
    new = "latitude_deg" in gps
    lat, lon, height = (
        ("latitude_deg", "longitude_deg", "altitude_ellipsoid_m")
        if new
        else ("lat", "lon", "alt_ellipsoid")
    )
    missing = [
        k
        for k in (lat, lon, height, "fix_type", "vel_n_m_s", "vel_e_m_s", "vel_d_m_s")
        if k not in gps
    ]
    if missing:
        told = f"{label}: {GPS[0]} without {missing[0]}: no gnss stream"
        return None, [Note(told, About.FIXES)]
    sigmas = [gps.get(k) for k in ("eph", "epv", "s_variance_m_s")]
    utc = gps.get("time_utc_usec", np.zeros(gps[lat].size))
    return good_fixes(
        RawFixes(
            log_s=gps["timestamp"] * US,
            is_3d=gps["fix_type"] >= FIX_TYPE_3D,
            lat_deg=gps[lat] * (1.0 if new else 1e-7),
            lon_deg=gps[lon] * (1.0 if new else 1e-7),
            height_m=gps[height] * (1.0 if new else 1e-3),
            v_n_m_s=np.stack([gps[f"vel_{a}_m_s"] for a in "ned"], axis=1),
            unix_s=np.where(utc > 0, utc * US, np.nan),
            sigmas=None if any(s is None for s in sigmas) else np.stack(sigmas),  # type: ignore[arg-type]
            fix_type=fix_types(gps["fix_type"], AUTOPILOT),
        ),
        label=label,
    )


READERS = (Reader(name="ulog", about="PX4 .ulg", detect=is_ulog, read=read),)
