"""Logs by a column map: separated values, white space, raw binary rows, Parquet and MATLAB files.

A CSV or Parquet file whose columns already have the names of formats.md needs no map.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

from ins.columns import GYRO_DEGC, INCREMENT_COLUMNS, RATE_COLUMNS
from ins.records import InputError
from trajectories.readers.columns.imu_columns import converted
from trajectories.readers.columns.layouts import content_format, flat_names, read_columns
from trajectories.readers.columns.mat_columns import leaves, shapes
from trajectories.readers.columns.rtklib_solution import is_solution, on_clock, read_solution
from trajectories.readers.columns.side_streams import with_fixes, with_side_streams
from trajectories.readers.columns.text_columns import header_names
from trajectories.readers.containers.mat_file import is_matlab
from trajectories.readers.registry import ConvertedLog, Reader, UnknownLog
from trajectories.readers.rows.column_map import LogOptions, column_map, used_columns

OWN_UNITS = (("rad/s", "m/s2", RATE_COLUMNS), ("rad", "m/s", INCREMENT_COLUMNS))


def read(path: Path, options: LogOptions, *, name: str) -> ConvertedLog:
    """A log by its map, and the streams that the map names beside the imu."""
    if not (options.keys.get("gyro") or options.keys.get("accel")):
        options = options.over(_own_map(path, name))
    options, solution = _without_solution(options, path)
    keys = column_map(LogOptions({"format": name}).over(options))
    columns, notes = read_columns(path, keys, used_columns(keys))
    log = with_side_streams(
        converted(columns, keys, label=path.name, notes=notes), columns, keys, path
    )
    if solution is None:
        return log
    raw, notes = read_solution(solution)
    raw = on_clock(raw, keys.time.epoch if keys.time else None, solution.name)
    log = replace(log, other_files=(*log.other_files, solution), notes=(*log.notes, *notes))
    return with_fixes(log, raw, label=solution.name)


def _without_solution(options: LogOptions, path: Path) -> tuple[LogOptions, Path | None]:
    """The map without its [gnss], and the file of fixes, where that is one of RTKLIB's, which says
    itself what its columns are.
    """
    part = options.keys.get("gnss")
    if not isinstance(part, dict) or not isinstance(part.get("file"), str):
        return options, None
    other = path.parent / part["file"]
    if not (other.is_file() and is_solution(other)):
        return options, None
    return LogOptions({k: v for k, v in options.keys.items() if k != "gnss"}), other


def _detect_own(path: Path, *, name: str) -> bool:
    return content_format(path) == name and _own(_names(path, name)) is not None


def _names(path: Path, name: str) -> list[str]:
    return {"csv": header_names, "parquet": flat_names}[name](path)


def _own(names: Sequence[str]) -> LogOptions | None:
    """The map of a file that names the imu columns of formats.md; None where it does not."""
    for gyro, accel, columns in OWN_UNITS:
        if {*columns, "time_s"} <= set(names):
            own = {
                "gyro": {"columns": list(columns[:3]), "unit": gyro},
                "time": {"column": "time_s"},
                "accel": {"columns": list(columns[3:]), "unit": accel},
            }
            warm = {"temperature": {"columns": list(GYRO_DEGC)}}
            return LogOptions(own | warm if set(GYRO_DEGC) <= set(names) else own)
    return None


def _own_map(path: Path, name: str) -> LogOptions:
    """The map of a file that needs none; InputError where it needs one."""
    if name == "mat":
        values, notes = leaves(path)
        why = f" ({notes[0]})" if notes else ""
        raise UnknownLog(
            f"{path.name}: needed --map with [gyro] and [accel]; the file has {shapes(values)}{why}"
        )
    names = _names(path, name) if name in ("csv", "parquet") else []
    return own_map(names, path.name, "line 1 does" if name in ("csv", "text") else "its columns do")


def own_map(names: Sequence[str], label: str, what: str = "line 1 does") -> LogOptions:
    """The map of columns that have the names of a run's; InputError where they have not."""
    own = _own(names)
    if own is None:
        raise InputError(
            f"{label}: {what} not name the imu columns, needed [gyro] and [accel] in the map"
        )
    return own


def _never(path: Path) -> bool:
    return False


READERS = tuple(
    Reader(name=name, about=about, detect=detect, read=partial(read, name=name), gnss_file=True)
    for name, about, detect in (
        (
            "csv",
            "separated values; without a map only under the names of a run's imu stream",
            partial(_detect_own, name="csv"),
        ),
        ("text", "columns between white space, needs a map", _never),
        ("parquet", "Parquet; without a map as csv", partial(_detect_own, name="parquet")),
        ("binary", "rows of raw numbers, needs a map", _never),
        ("mat", "any other MATLAB file of version 5 or later, or HDF5, needs a map", is_matlab),
    )
)
