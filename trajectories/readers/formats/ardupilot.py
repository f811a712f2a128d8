"""ArduPilot logs as tables of messages to a log: one of the IMUs, its temperature, the GPS, and
what run.json needs.

Axes are forward, right, down already; rates in rad/s, specific force in m/s2, both filtered samples
of an instant. The autopilot has subtracted its start-up gyro offsets (INS_GYROFFS...), a constant
of the session, from the rates.

Decision: docs/decisions/0040-known-by-gravity.md.
"""

import re
from collections.abc import Callable, Collection, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from ins.records import AXES, InputError
from ins.units import DEG
from trajectories.readers.columns.fix_types import AUTOPILOT, fix_types
from trajectories.readers.columns.fixes import MATCH_S, LoggedFixes, RawFixes, good_fixes
from trajectories.readers.columns.imu_columns import converted, plausible_degC
from trajectories.readers.containers import dataflash, dataflash_text
from trajectories.readers.containers.dataflash import Tables
from trajectories.readers.containers.mat_file import is_matlab, read_arrays, variable_names
from trajectories.readers.registry import ConvertedLog, Reader
from trajectories.readers.rows.clocks import going_on, gps_seconds, unix_seconds
from trajectories.readers.rows.column_map import LogOptions, StretchKeys, column_map, stretch_of
from trajectories.runs.notes import About, Note, about

TablesOf = Callable[[Path, Collection[str]], tuple[Tables, list[str]]]

GYRO_FIELDS = tuple(f"Gyr{a.upper()}" for a in AXES)
ACCEL_FIELDS = tuple(f"Acc{a.upper()}" for a in AXES)
TEMPERATURE_FIELDS = ("T", "Temp")  # of the IMU message, new and old
MAX_IMUS = 9  # names of messages end in one digit: IMU, IMU2 to IMU9
TEXT_MESSAGES = ("FMT", "FMTU", "UNIT", "PARM", "MSG")  # messages with a column of text
# as declared
FIELD_UNITS = {
    "GyrX": {"rad/s": "rad/s", "deg/s": "deg/s"},
    "AccX": {"m/s/s": "m/s2", "m/s2": "m/s2", "g": "g"},
}
WANTED_MESSAGES = frozenset(
    (
        "FMTU",
        "UNIT",
        "GPS",
        "GPA",
        "UBX3",
        "PARM",
        "MSG",
        "IMU",
        *(f"IMU{k}" for k in range(2, MAX_IMUS + 1)),
    )
)
# in a MSG: board and serial of its processor
BOARD_TEXT = re.compile(r"^(\S+) ([0-9A-F]{8} [0-9A-F]{8} [0-9A-F]{8})$")
INSTANCE = re.compile(r"^([A-Z][A-Z0-9]*)_(\d)$")
Table = Mapping[str, NDArray]
NEEDED = ("Status", "Lat", "Lng", "Alt", "Spd", "GCrs", "VZ")
STATUS_3D = 3  # Status; 4 and more are differential and carrier-phase fixes
GEOID_NOTE = "GPS heights are above mean sea level, as logged (the ellipsoid is up to 110 m off)"
# Message with the receiver's own accuracy, and its horizontal [m], vertical [m] and speed [m/s]
# columns.
ACCURACY = (("GPA", ("HAcc", "VAcc", "SAcc")), ("UBX3", ("hAcc", "vAcc", "sAcc")))


class ArduPilotKeys(StretchKeys):
    """Map keys of an ArduPilot log. `gyro_offsets`: add them back or not."""

    format: str | None = None
    imu: Annotated[int, Field(ge=1, le=MAX_IMUS)] = 1
    gyro_offsets: Literal["as_logged", "add_back"] = "as_logged"


def log_from_tables(
    tables: Tables, options: LogOptions, path: Path, notes: list[str]
) -> ConvertedLog:
    """The log of one IMU. InputError where the log has no such IMU or lacks its columns."""
    keys = options.parsed(ArduPilotKeys)
    tables = {
        name: table if name in TEXT_MESSAGES else _numbers(table) for name, table in tables.items()
    }
    name, table = _imu_table(tables, keys.imu, path.name, notes)
    label = f"{path.name}: {name}"
    clock = log_clock(table, ("TimeUS", "TimeMS"))
    missing = [k for k in (*GYRO_FIELDS, *ACCEL_FIELDS) if k not in table]
    if clock is None or missing:
        column = missing[0] if missing else "TimeUS or TimeMS"
        raise InputError(f"{label}: no column {column}, has {' '.join(table)}"[:300])
    columns = {"time": clock, **{k: table[k] for k in (*GYRO_FIELDS, *ACCEL_FIELDS)}}
    offsets, level_removed, offset_notes = _gyro_offsets(tables, keys, label)
    columns |= {k: columns[k] + offset for k, offset in zip(GYRO_FIELDS, offsets)}
    temperature, temperature_notes = _temperature(table, label)
    columns |= temperature
    units = _units(tables, name.split()[0], table, label)
    keys_of_columns = _map(units, "temperature" in columns, stretch_of(keys))
    log = converted(columns, column_map(keys_of_columns), label=label, notes=[])
    found, gps_notes = fixes(tables, label=path.name)
    removed = {"gyro_level_removed": True} if level_removed else {}
    header = {
        "run_id": f"{path.stem}-imu{keys.imu}",
        "gyro_technology": "mems",
        **_serial(tables, keys.imu, path),
    }
    more = (*temperature_notes, *offset_notes, *gps_notes)
    return replace(
        log,
        gnss=None if found is None else found.on_run_time(log),
        notes=(*notes, *log.notes, *more),
        header={**header, **removed, **({} if found is None else found.header(log)), **keys.run},
    )


def _numbers(table: dict[str, NDArray]) -> dict[str, NDArray]:
    """The columns of numbers: a garbled format may make a text of one."""
    return {k: v for k, v in table.items() if v.dtype.kind == "f"}


def _imu_table(
    tables: Tables, number: int, label: str, notes: list[str]
) -> tuple[str, dict[str, NDArray]]:
    """Messages of the IMU of a number from 1: IMU, IMU2, IMU3 of old firmware, else IMU with its
    instance in I.
    """
    held = [k for k in range(1, MAX_IMUS + 1) if f"IMU{k if k > 1 else ''}" in tables]
    table = tables.get("IMU", {})
    if "I" in table:
        held = sorted(
            {int(i) + 1 for i in table["I"][np.isfinite(table["I"])] if 0 <= i < MAX_IMUS}
        )
    if number not in held:
        why = f" ({notes[0]})" if notes else ""
        raise InputError(
            f"{label}: no IMU {number}, has {', '.join(map(str, held)) or 'none'} (--imu){why}"
        )
    if "I" in table:
        rows = table["I"] == number - 1
        return f"IMU {number}", {k: v[rows] for k, v in table.items()}
    name = f"IMU{number if number > 1 else ''}"
    return name, tables[name]


def _units(
    tables: Tables, message: str, table: Mapping[str, NDArray], label: str
) -> dict[str, str]:
    """Unit of GyrX and AccX as the log declares it (FMTU and UNIT, since 2018), else rad/s and m/s2
    as ever.
    """
    formats, declared = tables.get("FMT", {}), tables.get("FMTU", {})
    kinds = [
        t for t, name in zip(formats.get("Type", ()), formats.get("Name", ())) if name == message
    ]
    letters = {
        t: str(text) for t, text in zip(declared.get("FmtType", ()), declared.get("UnitIds", ()))
    }
    said = {
        str(text)
        for t, text in zip(declared.get("FmtType", ()), declared.get("UnitIds", ()))
        if t in kinds[:1]
    }
    units = tables.get("UNIT", {})
    ids = _numbers(units).get("Id", np.empty(0))
    labels = {
        chr(int(k) % 256): str(v) for k, v in zip(ids, units.get("Label", ())) if np.isfinite(k)
    }
    used = {
        text[list(table).index(name)]
        for text in said
        for name in FIELD_UNITS
        if list(table).index(name) < len(text)
    }
    told = {
        (chr(int(k) % 256), str(v)) for k, v in zip(ids, units.get("Label", ())) if np.isfinite(k)
    }
    if len(said) > 1 or any(sum(k == letter for k, _ in told) > 1 for letter in used):
        raise InputError(
            f"{label}: its units are declared twice, differently (FMTU, UNIT): logs of two"
            " firmwares joined?"
        )
    found = {"GyrX": "rad/s", "AccX": "m/s2"}
    for name, known in FIELD_UNITS.items():
        text, place = letters.get(kinds[0], "") if kinds else "", list(table).index(name)
        declared_label = labels.get(text[place]) if place < len(text) else None
        if declared_label is not None and declared_label not in known:
            raise InputError(
                f"{label}: {name} is in {declared_label!r:.40}, needed {' or '.join(known)}"
            )
        found[name] = known.get(declared_label or "", found[name])
    return found


def _map(
    units: Mapping[str, str], with_temperature: bool, stretch: Mapping[str, float]
) -> LogOptions:
    """The column map of an IMU's table."""
    keys = {
        "time": {"column": "time"},
        "gyro": {"columns": list(GYRO_FIELDS), "unit": units["GyrX"]},
        "accel": {"columns": list(ACCEL_FIELDS), "unit": units["AccX"]},
    }
    warm = {"temperature": {"columns": ["temperature"]}} if with_temperature else {}
    return LogOptions({**keys, **warm, **stretch})


def _temperature(table: Mapping[str, NDArray], label: str) -> tuple[dict[str, NDArray], list[str]]:
    """The IMU's temperature, NaN where no sensor shows such a value, and notes; empty where it is
    not logged (absent or 0).
    """
    name = next((k for k in TEMPERATURE_FIELDS if k in table), None)
    if name is None:
        return {}, [f"{label}: no temperature in its messages: none in the run"]
    values, notes = plausible_degC(table[name], label, asked_for=False)
    if not np.any(np.nan_to_num(values)):
        return {}, [f"{label}: {name} is 0 or no temperature in all messages: none in the run"]
    return {"temperature": values}, [n for n in notes if about(n) is About.TEMPERATURE]


def _gyro_offsets(
    tables: Tables, keys: ArduPilotKeys, label: str
) -> tuple[NDArray, bool, list[str]]:
    """What to add to the rates [rad/s], shape (3,), whether a level stays removed, a note on what
    was subtracted.

    InputError where the autopilot compensated for temperature: what it took out would be learnt as
    if the unit had none.
    """
    parameters = tables.get("PARM", {})
    values = dict(zip(parameters.get("Name", ()), _numbers(parameters).get("Value", ())))
    if values.get(switch := f"INS_TCAL{keys.imu}_ENABLE") == 1.0 and not keys.run.get(
        "applied_table_sha256"
    ):
        raise InputError(
            f"{label}: {switch} is 1: gyros compensated for temperature in flight, needed a log"
            " with it off (or applied_table_sha256 in the map's [run], the table of those"
            " parameters)"
        )
    stem = f"INS_GYR{keys.imu if keys.imu > 1 else ''}OFFS_"
    offsets = np.array([values.get(stem + axis.upper(), np.nan) for axis in AXES], dtype=float)
    shown = f"{stem}X Y Z = {' '.join(f'{v:+.6f}' for v in offsets)} rad/s"
    if keys.gyro_offsets == "add_back":
        if not np.isfinite(offsets).all():
            raise InputError(
                f"{label}: gyro_offsets: the log has no parameters {stem}X Y Z to add back"
            )
        return offsets, False, [f"{label}: added back the autopilot's gyro offsets {shown}"]
    known = bool(np.isfinite(offsets).all())
    note = f"{label}: rates are less the autopilot's gyro offsets {shown} (as logged)"
    return np.zeros(3), known and bool(np.any(offsets)), [note] if known else []


def _serial(tables: Tables, number: int, path: Path) -> dict[str, str]:
    """imu_serial: board, its processor's serial, and the IMU's number; the file's name where the
    log has none.
    """
    for text in tables.get("MSG", {}).get("Message", ()):
        if found := BOARD_TEXT.match(str(text)):
            return {"imu_serial": f"{found[1]}-{found[2].replace(' ', '')}-imu{number}"}
    return {"imu_serial": f"{path.stem}-imu{number}"}


def _reader(name: str, about: str, detect: Callable[[Path], bool], tables: TablesOf) -> Reader:
    def read(path: Path, options: LogOptions) -> ConvertedLog:
        found, notes = tables(path, WANTED_MESSAGES)
        return log_from_tables(found, options, path, notes)

    return Reader(name=name, about=about, detect=detect, read=read)


def is_ardupilot_mat(path: Path) -> bool:
    """Whether a MATLAB file holds IMU messages with their labels."""
    return is_matlab(path) and {"IMU_label", "IMU_0_label"} & variable_names(path) != set()


def mat_tables(path: Path, wanted: Collection[str]) -> tuple[Tables, list[str]]:
    """The wanted messages of a log, and notes on what was skipped. InputError where none of them
    can be read.
    """
    arrays, notes = read_arrays(path, _variables(wanted))
    tables: Tables = {}
    for name, values in arrays.items():
        message = _message(name)
        if message not in wanted or values.dtype.kind != "f":
            continue
        labels = arrays.get(f"{name}_label", arrays.get(f"{name.split('_')[0]}_label"))
        columns = [] if labels is None else [str(label) for label in labels]
        if values.shape[1] != len(columns):
            notes.append(
                f"{path.name}: {name} has shape {values.shape} and {len(columns)} labels, not read"
            )
            continue
        tables[message] = dict(zip(columns, values.T.copy()))
    if not tables:
        raise InputError(
            f"{path.name}: holds none of the messages {' '.join(sorted(wanted))}{_told(notes)}"
        )
    return tables, notes


def _message(name: str) -> str:
    """IMU_0 -> IMU, IMU_1 -> IMU2; GPS_0 -> GPS; other names as they are."""
    found = INSTANCE.match(name)
    return name if found is None else f"{found[1]}{int(found[2]) + 1 if found[2] != '0' else ''}"


def _variables(wanted: Collection[str]) -> set[str]:
    """Names that the variables of some messages may have, with those of their labels."""
    numbers = ("", *(f"_{k}" for k in range(10)))
    names = {f"{message}{number}" for message in wanted for number in numbers}
    return names | {f"{name}_label" for name in names}


def _told(notes: list[str]) -> str:
    return f" ({notes[0]})" if notes else ""


def fixes(tables: Mapping[str, Table], *, label: str) -> tuple[LoggedFixes | None, list[str]]:
    """The 3D fixes of one receiver, and notes on those left out; None where there is none."""
    table = tables.get("GPS")
    if table is None:
        return None, [Note(f"{label}: no GPS message: no gnss stream", About.FIXES)]
    clock = log_clock(table, ("TimeUS", "T"))
    missing = [k for k in NEEDED if k not in table]
    if clock is None or missing:
        return None, [
            f"{label}: GPS messages without {missing[0] if missing else 'time of the log'}: no gnss"
            " stream"
        ]
    told: list[str] = []
    if "I" in table:
        number = _receiver(table)
        of_it = table["I"] == number
        table, clock = {k: v[of_it] for k, v in table.items()}, clock[of_it]
        if number:
            told = [f"{label}: GPS {number:g} taken: the first has no 3D fix"]
    clock, course = going_on(clock)[0], table["GCrs"] * DEG
    with np.errstate(invalid="ignore"):
        v_n = np.stack(
            [table["Spd"] * np.cos(course), table["Spd"] * np.sin(course), table["VZ"]], axis=1
        )
        raw = RawFixes(
            log_s=clock,
            is_3d=table["Status"] >= STATUS_3D,
            lat_deg=table["Lat"],
            lon_deg=table["Lng"],
            height_m=table["Alt"],
            v_n_m_s=v_n,
            unix_s=_unix(table),
            sigmas=_sigmas(tables, clock),
            fix_type=fix_types(table["Status"], AUTOPILOT),
        )
    found, notes = good_fixes(raw, label=label)
    notes = [*told, *notes]
    return found, notes if found is None else [*notes, f"{label}: {GEOID_NOTE}"]


def _receiver(table: Table) -> float:
    """The first receiver; where it never has a 3D fix, the one with most of them. Never two: their
    antennas lie apart.
    """
    placed = table["I"][table["Status"] >= STATUS_3D]
    if not placed.size or np.any(placed == 0):
        return 0.0
    numbers, counts = np.unique(placed, return_counts=True)
    return float(numbers[np.argmax(counts)])


def log_clock(table: Table, names: tuple[str, ...]) -> NDArray | None:
    """Log time [s] of a message: microseconds in TimeUS, milliseconds in the others."""
    for name in names:
        if name in table:
            return table[name] * (1e-6 if name == "TimeUS" else 1e-3)
    return None


def _unix(table: Table) -> NDArray:
    """UTC [s] from week and milliseconds of the week; NaN where the log has neither."""
    week, tow_ms = table.get("Week", table.get("GWk")), table.get("GMS", table.get("TimeMS"))
    if week is None or tow_ms is None:
        return np.full(table["Lat"].size, np.nan)
    return unix_seconds(gps_seconds(week, tow_ms * 1e-3))


def _sigmas(tables: Mapping[str, Table], time_s: NDArray) -> NDArray | None:
    """The receiver's own accuracy (3, n) from the message beside each fix, NaN where none is."""
    for name, columns in ACCURACY:
        table = tables.get(name, {})
        clock = log_clock(table, ("TimeUS", "TimeMS"))
        if clock is not None and clock.size >= 2 and set(columns) <= set(table):
            clock = going_on(clock)[0]
            nearest = _nearest(clock, time_s)
            sigmas = np.stack([table[k][nearest] for k in columns])
            return np.where(np.abs(clock[nearest] - time_s) <= MATCH_S, sigmas, np.nan)
    return None


def _nearest(clock: NDArray, time_s: NDArray) -> NDArray:
    """Index of the value of an ascending clock (disorder costs a match, no more) nearest to each
    time.
    """
    after = np.clip(np.searchsorted(clock, time_s), 1, clock.size - 1)
    return after - (time_s - clock[after - 1] < clock[after] - time_s)


READERS = (
    _reader("dataflash", "ArduPilot .bin", dataflash.is_dataflash, dataflash.read_tables),
    _reader(
        "dataflash_text",
        "ArduPilot .log",
        dataflash_text.is_dataflash_text,
        dataflash_text.read_tables,
    ),
    _reader("ardupilot_mat", "ArduPilot .mat of Mission Planner", is_ardupilot_mat, mat_tables),
)
