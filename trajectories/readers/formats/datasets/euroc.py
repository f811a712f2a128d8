"""EuRoC MAV data sets in the ASL layout: `mav0/imu0/data.csv` with `sensor.yaml` beside it.

A row is the time [ns since 1970], rates about x, y, z [rad/s], specific force [m/s2] in the axes of
the sensor. Those of the VI-Sensor's ADIS16448 (EuRoC) are x up, y right, z forward, as its cameras'
T_BS and gravity show; others are taken as x forward, y left, z up unless the map gives `axes`. No
position on the Earth is in it: site and serial number have to be given; the ground truth is in a
frame of the room and is not taken. Source: Burri and others (2016), The EuRoC micro aerial vehicle
datasets; sensor.yaml of its imu0 and cam0.
"""

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from ins.records import AXES, InputError
from ins.user_input import open_regular
from trajectories.readers.columns.imu_columns import converted
from trajectories.readers.columns.layouts import read_columns
from trajectories.readers.columns.text_columns import heading
from trajectories.readers.containers.file_bytes import is_own_file
from trajectories.readers.registry import ConvertedLog, Reader
from trajectories.readers.rows.column_map import (
    AxesKeys,
    LogOptions,
    StretchKeys,
    column_map,
    stretch_of,
)

TIME_NAME = "#timestamp [ns]"
PLACES = ("mav0/imu0/data.csv", "imu0/data.csv", "data.csv")
VI_SENSOR = AxesKeys(x="z", y="y", z="-x")  # x up, y right, z forward
FLU_SENSOR = AxesKeys(x="x", y="-y", z="-z")
COLUMN = re.compile(r"^\s*(w|a)_RS_S_(x|y|z)\b")
IDENTITY = tuple(float(i == j) for i in range(3) for j in range(3))
MAX_YAML = 100_000  # bytes; that of EuRoC has 900
TURN_LEAST = 1e-3  # of an element of T_BS: 0.06 deg, what calibrations are good to


class EurocKeys(StretchKeys):
    """Map keys of an ASL folder."""

    format: str | None = None
    axes: AxesKeys | None = None


def _column(name: str) -> str:
    """ "w_x" of "w_RS_S_x [rad s^-1]"; empty for another."""
    found = COLUMN.match(name)
    return "" if found is None else f"{found[1]}_{found[2]}"


def _are_names(names: Sequence[str]) -> bool:
    wanted = {f"{kind}_{a}" for kind in "wa" for a in AXES}
    return names[0].startswith("#timestamp") and wanted <= set(map(_column, names))


def _data_file(path: Path) -> Path | None:
    if path.is_file():
        return path
    return next((path / place for place in PLACES if is_own_file(path / place, path)), None)


def read(path: Path, options: LogOptions) -> ConvertedLog:
    """The log of imu0."""
    keys = options.parsed(EurocKeys)
    file = _data_file(path)
    found = None if file is None else heading(file, _are_names)
    if file is None or found is None:
        raise InputError(f"{path.name}: no imu0/data.csv with {TIME_NAME}, w_RS_S_x, a_RS_S_x")
    ours = {_column(name) or "time": name for name in found.names}
    ours["time"] = found.names[0]
    columns, notes = read_columns(file, found.layout, list(ours.values()))
    label = file.name if file == path else str(file.relative_to(path))
    yaml = file.with_name("sensor.yaml")
    text = ""
    if is_own_file(yaml, file.parent):
        with open_regular(yaml) as stream:
            text = stream.read(MAX_YAML).decode("utf-8", "replace")
    is_vi = "ADIS16448" in text
    axes = keys.axes or (VI_SENSOR if is_vi else FLU_SENSOR)
    shape = {
        "time": {"column": "time", "unit": "ns", "epoch": "unix"},
        "gyro": {"columns": [f"w_{a}" for a in AXES], "unit": "rad/s"},
        "accel": {"columns": [f"a_{a}" for a in AXES], "unit": "m/s2"},
        "axes": axes.model_dump(),
        **stretch_of(keys),
    }
    named = {name: columns[theirs] for name, theirs in ours.items()}
    log = converted(named, column_map(LogOptions(shape)), label=label, notes=notes)
    known = {"gyro_technology": "mems"} if is_vi else {}
    header = {**known, **log.header, **keys.run}
    others = tuple(p for p in (file, yaml) if p.is_file() and p != path)
    told = _notes(text, label, axes, is_given=keys.axes is not None)
    return replace(log, header=header, notes=(*log.notes, *told), other_files=others)


def _notes(text: str, label: str, axes: AxesKeys, *, is_given: bool) -> list[str]:
    notes = [f"{label}: no position on the Earth: its truth is in a frame of the room, not taken"]
    if not is_given:
        told = "x up, y right, z forward" if axes == VI_SENSOR else "x forward, y left, z up"
        notes.append(f"{label}: axes of the sensor taken as {told}; otherwise: axes in the map")
    found = re.search(r"T_BS:.{0,100}?data:\s*\[([^\]]{1,2000})\]", text, re.DOTALL)
    words = found[1].replace(",", " ").split() if found else []
    try:
        numbers = [float(word) for word in words]
    except ValueError:
        numbers = []
    turn = [numbers[4 * i + j] for i in range(3) for j in range(3)] if len(numbers) == 16 else None
    if turn is not None and np.max(np.abs(np.subtract(turn, IDENTITY))) > TURN_LEAST:
        notes.append(f"{label}: sensor.yaml turns the sensor in its body (T_BS): not applied")
    return notes


def detect(path: Path) -> bool:
    """An imu0/data.csv, or the file itself, with the names of ASL."""
    file = _data_file(path)
    return file is not None and heading(file, _are_names) is not None


READERS = (
    Reader(
        name="euroc",
        about="EuRoC (ASL) folder with mav0/imu0/data.csv, or that file",
        detect=detect,
        read=read,
        folder=True,
    ),
)
