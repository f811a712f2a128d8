"""A flight log to a run: choose the reader, complete the header, check what came out."""

import hashlib
from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ins.records import AXES, ImuLog, InputError, ReferenceLog, Run, RunHeader, TemperatureLog
from ins.user_input import open_regular
from trajectories.readers.conversion_checks import check_rows, check_streams
from trajectories.readers.registry import ConvertedLog, read_log
from trajectories.readers.rows.column_map import (
    ACCEL_INCREMENTS,
    ACCEL_RATES,
    GYRO_INCREMENTS,
    GYRO_RATES,
    OF_LATITUDE,
    SITE_KEYS,
    LogOptions,
    MapError,
)
from trajectories.runs.checks import DROPOUT, Finding, Findings
from trajectories.runs.directory import run_sha256
from trajectories.runs.imu_scan import RateScan
from trajectories.runs.notes import About, about
from trajectories.runs.physics_gates import CoSensors, check_physics
from trajectories.runs.schema import (
    SCHEMA,
    ConversionRecord,
    SourceFile,
    header_from_json,
    unknown_keys,
)

RUN_OPTIONS = {
    "imu_serial": "--serial",
    "gyro_technology": "--technology",
    "start_utc": "--start-utc",
    "lat_deg": "--lat-deg",
    "lon_deg": "--lon-deg",
    "height_m": "--height-m",
}
# of a site: gravity and Earth rate do not depend on its longitude, 1000 m change gravity by 0.03 %
NEXT_TO_NOTHING = ("lon_deg", "height_m")
NO_OPTIONS = LogOptions()
MANY_LOST = 0.01  # of all rows; chosen: a dropout now and then costs less than 1 %
# What a note may be about that says why a key of the header is missing.
TELLING = {"": About.DAMAGE, "lat_deg": About.FIXES, "start_utc": About.DATE}


@dataclass(frozen=True, kw_only=True)
class Conversion:
    """A run made from a log; `record` goes into its run.json and says where it came from.

    `reference` is what the log says of the truth, kept beside the run for scoring only.
    """

    run: Run
    record: ConversionRecord
    findings: tuple[Finding, ...]
    reference: ReferenceLog | None = None


def convert_log(
    path: Path, options: Mapping[str, Any], given: Mapping[str, str | float | None]
) -> Conversion:
    """The run in a log file.

    `options` is the map, `given` run.json keys from the command line (flat: lat_deg, lon_deg,
    height_m for the site); they override those of the map, which override what the log itself says.
    InputError names what is missing or wrong.
    """
    path = Path(path)
    name, log = read_log(path, LogOptions(options))
    return conversion_of(path, name, log, given, options=LogOptions(options))


def _axes(given: Mapping[str, str] | None) -> tuple[str, ...]:
    """Body axes as the raw axes of the log, by the map."""
    return tuple(str(given.get(axis, axis)) if given else axis for axis in AXES)


def _units(options: LogOptions, rate_hz: float) -> dict[str, tuple[str, dict[str, float]]]:
    """As of `CoSensors.units`, of a map with units; an increment counts by the rows a second."""
    found = {}
    for name, rates, increments in (
        ("gyro", GYRO_RATES, GYRO_INCREMENTS),
        ("accel", ACCEL_RATES, ACCEL_INCREMENTS),
    ):
        part = options.keys.get(name)
        if isinstance(part, Mapping) and "unit" in part:
            per_second = {unit: factor * rate_hz for unit, factor in increments.items()}
            found[name] = (str(part["unit"]), rates | per_second)
    return found


def conversion_of(
    path: Path,
    name: str,
    log: ConvertedLog,
    given: Mapping[str, str | float | None],
    *,
    options: LogOptions = NO_OPTIONS,
) -> Conversion:
    """The run in a log that is read already; name: of its format, given: as of `convert_log`;
    options: the map that it was read by.
    """
    findings, label = Findings(), path.name
    header = run_header(log.header, given, path.name, log.notes, options=options)
    rate = RateScan(1.0 / log.imu.rate_hz, lambda k: f"{label}: row {k + 1}", label)
    rate.feed(log.imu.time_s)
    findings.error(*rate.lines)
    check_rows(log.imu, time_shift_s=log.time_shift_s, label=label, findings=findings)
    check_physics(
        log.imu,
        site=header.site,
        technology=header.gyro_technology,
        label=label,
        findings=findings,
        beside=CoSensors(
            gnss=log.gnss,
            odometer=log.odometer,
            axes=_axes(options.keys.get("axes")),
            units=_units(options, log.imu.rate_hz),
            accepted_scale=header.accepted_accel_scale,
            any_attitude=header.any_attitude,
        ),
    )
    check_streams(log.gnss, log.odometer, label=label, findings=findings)
    if findings.errors:
        raise InputError(findings.errors[0])
    findings.warn(*_lost(log.imu, label))
    run = Run(
        header=header,
        imu=log.imu,
        temperature=_accepted_temperature(log.temperature, header),
        gnss=log.gnss,
        odometer=log.odometer,
        faults=log.faults,
    )
    others = [SourceFile(source=p.name, source_sha256=file_sha256(p)) for p in log.other_files]
    record = ConversionRecord(
        source=path.name,
        source_sha256=file_sha256(path),
        format=name,
        time_shift_s=log.time_shift_s,
        notes=(*log.notes, *_taken_as_zero(log, given, label)),
        repaired=log.faults,
        other_sources=tuple(others),
    )
    return Conversion(
        run=replace(run, sha256=run_sha256(run)),
        record=record,
        findings=tuple(findings.items),
        reference=log.reference,
    )


def _accepted_temperature(log: TemperatureLog | None, header: RunHeader) -> TemperatureLog | None:
    """The temperatures, which may be constant where the header accepts that."""
    if log is None or not header.accepted_constant_temperature:
        return log
    return replace(log, constant=True)


def _lost(imu: ImuLog, label: str) -> list[str]:
    """A line where more than a few rows are missing: the rate is held over each hole, as a run's
    reader does.
    """
    intervals = np.round(imu.dt_s * imu.rate_hz)
    lost = int(np.sum(intervals - 1, where=imu.dt_s * imu.rate_hz > DROPOUT))
    if lost <= MANY_LOST * imu.rows:
        return []
    return [
        f"{label}: {lost} of {imu.rows + lost} rows lost ({lost / (imu.rows + lost):.0%}): each"
        " hole has the rate of the row after it; what moved meanwhile is not known (spans:"
        " repaired)"
    ]


def run_header(
    said: Mapping[str, Any],
    given: Mapping[str, str | float | None],
    name: str,
    notes: Sequence[str] = (),
    *,
    options: LogOptions = NO_OPTIONS,
) -> RunHeader:
    """The header of a run from what its log or map says and from the options, which win.

    Parameters
    ----------
    said : mapping
        Keys of run.json.
    given : mapping
        Keys of run.json, those of its site among them; None where an option was not given.
    name : str
        Of the log, which the run is called by.
    notes : sequence of str
        What the reader noticed: one may say why a key is missing.
    options : LogOptions
        The map that the log was read by.

    Raises
    ------
    InputError
        Names what is missing, unknown or wrong; a MapError where the map has a [run].
    """
    known = {k: v for k, v in given.items() if v is not None}
    position = {k: known.pop(k) for k in SITE_KEYS if k in known}
    header = {
        "schema": SCHEMA,
        "run_id": name.split(".")[0],
        "tail": "",
        "lever_arms_m": {},
        "applied_table_sha256": None,
        **said,
        **known,
    }
    site = header.get("site", {})
    if isinstance(site, dict):
        # who says where it stood says how well
        less = OF_LATITUDE if "lat_deg" in position else ()
        site = {**{k: v for k, v in site.items() if k not in less}, **position}
        if "lat_deg" in site:
            site = dict.fromkeys(NEXT_TO_NOTHING, 0.0) | site
        missing = _missing(header, site)
        if missing:
            told = ", ".join(f"{k} ({RUN_OPTIONS[k]})" for k in missing)
            reasons = [TELLING[key] for key in (*missing, "") if key in TELLING]
            why = next((f" ({n})" for r in reasons for n in notes if about(n) is r), "")
            strange = unknown_keys(header, site)
            if strange:
                why = f" (nothing is called {', '.join(strange)})"
            raise InputError(f"{name}: needed from the options or [run] in the map: {told}{why}")
    mapped = bool(options.keys.get("run"))
    said_by = ["map [run]"] if mapped else []
    said_by += ["options"] if known or position else []
    checked, errors, unknown = header_from_json(
        {**header, "site": site}, name=" and ".join(said_by) or name
    )
    if checked is None or unknown:
        line = (errors + unknown)[0]
        raise MapError(line) if mapped else InputError(line)
    return checked


def _taken_as_zero(
    log: ConvertedLog, given: Mapping[str, str | float | None], label: str
) -> list[str]:
    """A note on what is not known of the site and counts for next to nothing."""
    taken = [key for key in missing_keys(log, given) if key in NEXT_TO_NOTHING]
    words = ", ".join(f"{key} ({RUN_OPTIONS[key]})" for key in taken)
    return [f"{label}: {words} is not given and taken as 0"] if taken else []


def missing_keys(log: ConvertedLog, given: Mapping[str, str | float | None]) -> tuple[str, ...]:
    """The keys of RUN_OPTIONS that neither the log nor the options say."""
    site = log.header.get("site", {})
    known = {k for k, v in given.items() if v is not None}
    return tuple(_missing({*log.header, *known}, {*site, *known}))


def _missing(keys: Container[str], site_keys: Container[str]) -> list[str]:
    """The keys of RUN_OPTIONS that are neither in a header nor in its site."""
    return [k for k in RUN_OPTIONS if k not in (site_keys if k.endswith(("_deg", "_m")) else keys)]


def file_sha256(path: Path) -> str:
    """Of a file; of a folder, over the names and hashes of its files, and of the texts below it."""
    if path.is_dir():
        files = [p for p in path.iterdir() if p.is_file()]
        files += [p for p in path.rglob("*.txt") if p.is_file() and p.parent != path]
        parts = [f"{p.relative_to(path)} {file_sha256(p)}\n" for p in sorted(files)]
        return hashlib.sha256("".join(parts).encode()).hexdigest()
    with open_regular(path) as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
