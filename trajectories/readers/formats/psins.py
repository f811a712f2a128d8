"""PSINS logs: increments with their time behind, axes right, forward, up.

Three forms. A text file with the head "PSINS-format SIMU log file": three lines (attitude and
velocity; latitude, longitude [deg], height [m], t0 [s], interval [ms], g [m/s2]; six scales
[arcsec], [micro-g s]), then counts of increments and, as an option, a correction of the interval
[us]. Seven columns of text: wm [rad], vm [m/s], t [s]. A MATLAB file with `imu` of such rows, or
`trj.imu`; there `gps` (velocity east, north, up, latitude and longitude [rad], height, t; or
without velocity) and `avp` (pitch, roll, yaw anticlockwise from north [rad], velocity east, north,
up, position, t). An increment covers the interval that ends at its time. Source: PSINS toolbox,
imufile.m, trjsimu.m, gpssimu.m, a2mat.m.
"""

from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ins.records import AXES, InputError
from ins.units import ARCSEC, DEG
from trajectories.readers.columns.fixes import RawFixes, largest
from trajectories.readers.columns.imu_columns import converted
from trajectories.readers.columns.layouts import read_columns, side_file
from trajectories.readers.columns.mat_columns import Leaves, leaves, leaves_at_once, shapes
from trajectories.readers.columns.side_streams import GnssFile, with_fixes, with_reference
from trajectories.readers.containers.mat_file import is_matlab
from trajectories.readers.registry import ConvertedLog, Reader
from trajectories.readers.rows.column_map import LogOptions, StretchKeys, column_map, stretch_of
from trajectories.readers.rows.increment_rows import (
    are_increments,
    head_rows,
    is_file_of,
    refuse_other_width,
)
from trajectories.runs.text_rows import (
    RowLayout,
    column_rows,
    is_number,
    line_blocks,
    text_parts,
    text_size,
)

W = [f"wm_{a}" for a in AXES]
V = [f"vm_{a}" for a in AXES]
ROW = [*W, *V, "t"]
MAP = {
    "time": {"column": "t"},
    "gyro": {"columns": W, "unit": "rad"},
    "accel": {"columns": V, "unit": "m/s"},
    "axes": {"x": "y", "y": "x", "z": "-z"},
}
# ".*PSINS.*SIMU" would begin anew at every PSINS of a long line
SIMU_HEAD = rb"\A%(?:(?!PSINS).)*PSINS.*SIMU"
IMU_NAMES = ("imu", "trj.imu")
GPS_NAMES = ("gps", "gnss", "trj.gps")
AVP_NAMES = ("avp", "trj.avp")
GPS_WIDTHS = (4, 7)
AVP_WIDTHS = (10,)


class PsinsKeys(StretchKeys):
    """Map keys of a PSINS log. `gnss.file`: a text or MATLAB file with the rows of `gps`."""

    format: str | None = None
    gnss: GnssFile | None = None


def read(path: Path, options: LogOptions) -> ConvertedLog:
    """The log in body axes, with the fixes beside it and `avp` as reference."""
    keys = options.parsed(PsinsKeys)
    values: Leaves = {}
    site: dict[str, float] | None = None
    if is_file_of(path, SIMU_HEAD):
        simu = _simu_file(path)
        columns, site, notes = simu.columns, simu.site, list(simu.notes)
    elif is_matlab(path):
        values, notes = leaves(path)
        columns = dict(zip(ROW, _matrix(values, IMU_NAMES, (7,), path).T))
    else:
        columns, notes = _rows(path, (7,), "wm x y z, vm x y z, t")
    log = converted(
        columns, column_map(LogOptions(MAP | stretch_of(keys))), label=path.name, notes=notes
    )
    place = {} if site is None else {"site": site}
    log = replace(log, header={**place, **keys.run})
    if keys.gnss is not None:
        other = side_file(path, keys.gnss.file, "gnss.file (--gnss)")
        gps, notes = _gps(other)
        log = replace(log, other_files=(other,), notes=(*log.notes, *notes))
        log = with_fixes(log, _fixes(gps, other.name), label=other.name)
    elif any(name in values for name in GPS_NAMES):
        log = with_fixes(
            log, _fixes(_matrix(values, GPS_NAMES, GPS_WIDTHS, path), path.name), label=path.name
        )
    return (
        _with_avp(log, _matrix(values, AVP_NAMES, AVP_WIDTHS, path))
        if any(k in values for k in AVP_NAMES)
        else log
    )


@dataclass(frozen=True, kw_only=True)
class _SimuFile:
    """Increments by column (n,), the place in the head as run.json has it, and notes."""

    columns: dict[str, NDArray]
    site: dict[str, float]
    notes: tuple[str, ...]


def _simu_file(path: Path) -> _SimuFile:
    """What a file of counts holds. InputError where the head is not as the format says."""
    packed: list[str] = []
    size = text_size(path, len(ROW))
    blocks = line_blocks(text_parts(path, packed), label=path.name)
    text, last = next(blocks)
    head: list[list[float]] = []
    line_number = 0
    while len(head) < 3 and text:
        line, _, text = text.partition(b"\n")
        line_number += 1
        words = line.decode("utf-8", errors="replace").partition("%")[0].split()
        head += [_head_line(words, f"{path.name}: line {line_number}")] if words else []
    if len(head) < 3:
        raise InputError(f"{path.name}: {len(head)} lines in the head, needed 3")
    lat_deg, lon_deg, height_m, t0_s, interval_ms, g = head[1][:6]
    scales = head[2][:6]
    if not (0 < interval_ms <= 110 and 9.7 < g < 9.9 and min(scales) > 0):
        raise InputError(
            f"{path.name}: head: interval {interval_ms:g} ms, g {g:g}, scales {min(scales):g} and"
            " more: damaged?"
        )
    blank = len(text) - len(text.lstrip())
    line_number, text = line_number + text[:blank].count(b"\n"), text[blank:]
    width = len(text.split(b"\n", 1)[0].split())
    names = [*ROW[:6], *(["late"] if width == 7 else [])]
    layout = RowLayout(names=names, label=path.name, delimiter=" ", first_line=line_number + 1)
    counts, notes = column_rows(chain([(text, last)], blocks), layout, size.lines)
    factors = [*(s * ARCSEC for s in scales[:3]), *(s * 1e-6 * g for s in scales[3:])]
    scaled = ((name, counts[name] * factor) for name, factor in zip(ROW, factors))
    columns: dict[str, NDArray] = dict(scaled)
    late_s = np.cumsum(counts["late"]) * 1e-6 if width == 7 else 0.0
    columns["t"] = t0_s + np.arange(1, counts[names[0]].size + 1) * (interval_ms * 1e-3) + late_s
    attitude = f"pitch {head[0][0]:g}, roll {head[0][1]:g}, heading {-head[0][2] % 360:g} deg"
    told = (
        f"{path.name}: head gives the place, and {attitude} (inaccurate, says the format; not used)"
    )
    first = [f"{path.name}: {note}" for note in packed]
    return _SimuFile(
        columns=columns,
        site={"lat_deg": lat_deg, "lon_deg": lon_deg, "height_m": height_m},
        notes=(*first, *notes, told),
    )


def _head_line(words: list[str], where: str) -> list[float]:
    """Six numbers of the head; old files end the line in an f."""
    values = [word.rstrip("f") for word in words]
    if len(values) < 6 or not all(map(is_number, values)):
        raise InputError(f"{where}: got {' '.join(words)[:60]!r}, needed six numbers of the head")
    return [float(v) for v in values]


def _rows(path: Path, widths: tuple[int, ...], what: str) -> tuple[dict[str, NDArray], list[str]]:
    text = head_rows(path)
    if text is None:
        raise InputError(f"{path.name}: not rows of numbers, needed {what}")
    refuse_other_width(text[0], widths, path.name, what)
    names = ROW[-text[0].shape[1] :]
    return read_columns(path, text[1].model_copy(update={"columns": names}), names)


def _gps(path: Path) -> tuple[NDArray, list[str]]:
    """Rows of `gps` in a text or MATLAB file, and notes."""
    if is_matlab(path):
        values, notes = leaves(path)
        return _matrix(values, GPS_NAMES, GPS_WIDTHS, path), notes
    columns, notes = _rows(
        path, GPS_WIDTHS, "[velocity east, north, up,] latitude, longitude [rad], height, t"
    )
    return np.column_stack(list(columns.values())), notes


def _matrix(values: Leaves, names: tuple[str, ...], widths: tuple[int, ...], path: Path) -> NDArray:
    """The first of some matrices that a MATLAB file has; InputError where it has none, or of
    another width.
    """
    name = next((k for k in names if k in values), None)
    if name is None:
        raise InputError(f"{path.name}: no matrix {' or '.join(names)}, has {shapes(values)}")
    refuse_other_width(values[name], widths, path.name, name)
    return values[name]


def _fixes(gps: NDArray, label: str) -> RawFixes:
    lat, lon, height, time_s = gps[:, -4:].T
    if largest(lat) > np.pi / 2:
        raise InputError(
            f"{label}: latitude of a fix {largest(lat):g} rad, needed radians within pi / 2:"
            " degrees?"
        )
    v_n = (
        np.column_stack([gps[:, 1], gps[:, 0], -gps[:, 2]])
        if gps.shape[1] == 7
        else np.full((time_s.size, 3), np.nan)
    )
    return RawFixes(
        log_s=time_s,
        is_3d=np.ones(time_s.size, dtype=bool),
        lat_deg=lat / DEG,
        lon_deg=lon / DEG,
        height_m=height,
        v_n_m_s=v_n,
        unix_s=np.full(time_s.size, np.nan),
    )


def _with_avp(log: ConvertedLog, avp: NDArray) -> ConvertedLog:
    """The log with `avp` as reference, for scoring only; its first row is the place where nothing
    else gives one.
    """
    pitch, roll, yaw, v_e, v_n, v_u, lat, lon, height, time_s = avp.T
    log = with_reference(
        log,
        {
            "time_s": time_s,
            "lat_rad": lat,
            "lon_rad": lon,
            "height_m": height,
            "v_n_m_s": np.column_stack([v_n, v_e, -v_u]),
            "roll_rad": roll,
            "pitch_rad": pitch,
            "heading_rad": np.mod(-yaw, 2 * np.pi),
        },
        label="avp",
    )
    if log.reference is None:
        return log
    place = {
        "lat_deg": float(lat[0] / DEG),
        "lon_deg": float(lon[0] / DEG),
        "height_m": float(height[0]),
    }
    return replace(log, header={"site": place, **log.header})


def detect(path: Path) -> bool:
    """The head of a SIMU file; else seven numbers a row with the time behind and gravity in the
    velocity increments.
    """
    if is_matlab(path):
        return any(
            are_increments(v, time=6, accel=3)
            for k, v in leaves_at_once(path).items()
            if k in IMU_NAMES
        )
    text = head_rows(path)
    return is_file_of(path, SIMU_HEAD) or are_increments(text[0] if text else None, time=6, accel=3)


READERS = (
    Reader(
        name="psins",
        about="PSINS .imu, text or .mat: wm, vm, t",
        detect=detect,
        read=read,
        gnss_file=True,
    ),
)
