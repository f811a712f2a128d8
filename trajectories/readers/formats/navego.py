"""NaveGo logs: MATLAB structs of an IMU (t, fb, wb) and a GNSS receiver (t, lat, lon, h, vel), SI
units and radians.

Axes are forward, right, down; velocity is north, east, down. fb [m/s2] and wb [rad/s] are samples
of an instant, taken as means over the interval before. `stdm` and `stdv` are the receiver's sigmas,
`larm` its lever arm. A struct `ref` (with roll, pitch, yaw) becomes the reference; a computed
solution, which has attitude too, is not used. Source: rodralez/NaveGo,
examples/synthetic-data/navego_example_synth.m (data structures), release 1.2.
"""

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from ins.records import AXES, InputError
from ins.units import DEG
from trajectories.readers.columns.fixes import RawFixes, largest
from trajectories.readers.columns.imu_columns import converted
from trajectories.readers.columns.layouts import side_file
from trajectories.readers.columns.mat_columns import Leaves, leaves, leaves_at_once, shapes
from trajectories.readers.columns.side_streams import GnssFile, with_fixes, with_reference
from trajectories.readers.containers.mat_file import is_matlab
from trajectories.readers.registry import ConvertedLog, Reader
from trajectories.readers.rows.column_map import LogOptions, StretchKeys, imu_map
from trajectories.runs.notes import About, Note

W = [f"wb_{a}" for a in AXES]
F = [f"fb_{a}" for a in AXES]
IMU_FIELDS = ("t", "fb", "wb")
GNSS_FIELDS = ("t", "lat", "lon", "h")
ATTITUDE_FIELDS = ("roll", "pitch", "yaw")
REFERENCE = "ref"


class NavegoKeys(StretchKeys):
    """Map keys of a NaveGo log. `imu`: which of several; `gnss.file`: NaveGo saves the receiver in
    a file of its own.
    """

    format: str | None = None
    imu: Annotated[int, Field(ge=1, le=99)] = 1
    gnss: GnssFile | None = None


def read(path: Path, options: LogOptions) -> ConvertedLog:
    """The log of one IMU, with the receiver and the reference of the same or another file."""
    keys = options.parsed(NavegoKeys)
    values, notes = leaves(path)
    imus = _structs(values, IMU_FIELDS)
    if len(imus) < keys.imu:
        raise InputError(
            f"{path.name}: no IMU {keys.imu} (--imu), has {', '.join(imus) or shapes(values)}"
        )
    name = imus[keys.imu - 1]
    w, f = (_wide(values, f"{name}.{field}", path) for field in ("wb", "fb"))
    columns = {"t": values[f"{name}.t"].ravel(), **dict(zip(W, w.T)), **dict(zip(F, f.T))}
    if not len(w) == len(f) == columns["t"].size:
        raise InputError(
            f"{path.name}: {name}: t has {columns['t'].size} rows, wb {len(w)}, fb {len(f)}, needed"
            " as many"
        )
    keys_of_columns = imu_map(keys, W, F, time="t")
    log = converted(columns, keys_of_columns, label=f"{path.name}: {name}", notes=notes)
    several = {"run_id": f"{path.stem}-{name}"} if len(imus) > 1 else {}
    log = replace(log, header={**several, **keys.run})
    log = _with_reference(log, values)
    other = path if keys.gnss is None else side_file(path, keys.gnss.file, "gnss.file (--gnss)")
    if keys.gnss is not None:
        values, more = leaves(other)
        log = replace(log, other_files=(other,), notes=(*log.notes, *more))
    return _with_receiver(log, values, other, wanted=keys.gnss is not None)


def _structs(values: Leaves, fields: tuple[str, ...]) -> list[str]:
    """Names of the structs that have all of some fields."""
    owners = dict.fromkeys(name.rpartition(".")[0] for name in values)
    return [
        name for name in owners if name and all(f"{name}.{field}" in values for field in fields)
    ]


def _wide(values: Leaves, name: str, path: Path) -> NDArray:
    matrix = values[name]
    if matrix.shape[1] != 3:
        raise InputError(f"{path.name}: {shapes({name: matrix})}, needed 3 columns")
    return matrix


def _with_receiver(log: ConvertedLog, values: Leaves, path: Path, *, wanted: bool) -> ConvertedLog:
    """The log with the fixes of the first receiver; what has an attitude is a computed solution and
    no receiver.
    """
    found = _structs(values, GNSS_FIELDS)
    receivers = [name for name in found if name != REFERENCE and f"{name}.roll" not in values]
    if not receivers and wanted:
        raise InputError(
            f"{path.name}: no struct with {', '.join(GNSS_FIELDS)}, has {shapes(values)}"
        )
    if not receivers:
        return replace(
            log,
            notes=(
                *log.notes,
                Note(
                    f"{path.name}: no gnss struct: no gnss stream (--gnss for another file)",
                    About.FIXES,
                ),
            ),
        )
    name = receivers[0]
    lat, lon, height, time_s = (values[f"{name}.{k}"].ravel() for k in ("lat", "lon", "h", "t"))
    if largest(lat) > np.pi / 2:
        raise InputError(
            f"{path.name}: {name}.lat up to {largest(lat):g}, needed radians: degrees?"
        )
    n = time_s.size
    v_n = _wide(values, f"{name}.vel", path) if f"{name}.vel" in values else np.full((n, 3), np.nan)
    if not lat.size == lon.size == height.size == len(v_n) == n:
        raise InputError(f"{path.name}: {name}: t, lat, lon, h and vel differ in length")
    raw = RawFixes(
        log_s=time_s,
        is_3d=np.ones(n, dtype=bool),
        lat_deg=lat / DEG,
        lon_deg=lon / DEG,
        height_m=height,
        v_n_m_s=v_n,
        unix_s=np.full(n, np.nan),
        sigmas=_sigmas(values, name, n),
    )
    arm = values.get(f"{name}.larm", np.empty(0)).ravel()
    if arm.size == 3 and "lever_arms_m" not in log.header:
        log = replace(log, header={**log.header, "lever_arms_m": {"gnss": arm.tolist()}})
    return with_fixes(log, raw, label=f"{path.name}: {name}")


def _sigmas(values: Leaves, name: str, n: int) -> NDArray | None:
    """Horizontal, vertical [m], velocity [m/s], shape (3, n), of sigmas [lat, lon, h] in metres and
    [N, E, D]: of all fixes.
    """
    place, speed = (values.get(f"{name}.{k}", np.empty(0)).ravel() for k in ("stdm", "stdv"))
    if place.size != 3:
        return None
    level = np.sqrt((place[0] ** 2 + place[1] ** 2) / 2)
    moving = np.sqrt(np.mean(speed**2)) if speed.size == 3 else np.nan
    return np.repeat(np.array([[level], [place[2]], [moving]]), n, axis=1)


def _with_reference(log: ConvertedLog, values: Leaves) -> ConvertedLog:
    fields = [f"{REFERENCE}.{k}" for k in (*GNSS_FIELDS, *ATTITUDE_FIELDS, "vel")]
    if not all(name in values for name in fields) or values[f"{REFERENCE}.vel"].shape[1] != 3:
        return log
    lengths = {values[name].size for name in fields[:-1]} | {len(values[fields[-1]])}
    if len(lengths) > 1:
        return replace(
            log, notes=(*log.notes, f"{REFERENCE}: fields differ in length: no reference stream")
        )
    time_s, lat, lon, height, roll, pitch, yaw = (values[name].ravel() for name in fields[:-1])
    return with_reference(
        log,
        {
            "time_s": time_s,
            "lat_rad": lat,
            "lon_rad": lon,
            "height_m": height,
            "v_n_m_s": values[fields[-1]],
            "roll_rad": roll,
            "pitch_rad": pitch,
            "heading_rad": np.mod(yaw, 2 * np.pi),
        },
        label=REFERENCE,
    )


def detect(path: Path) -> bool:
    """A MATLAB file with a struct that has t, fb and wb."""
    return is_matlab(path) and bool(_structs(leaves_at_once(path), IMU_FIELDS))


READERS = (
    Reader(
        name="navego",
        about="NaveGo .mat with an imu struct",
        detect=detect,
        read=read,
        gnss_file=True,
    ),
)
