"""The streams beside the imu: columns to records and back, and what is odd about a thermometer.

Each loader returns the record (None after an error) and the spans it dropped; lines go to
`Findings`.
"""

import csv
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ins.columns import (
    ACCEL_DEGC,
    ATTITUDE,
    FIX_SIGMA_COLUMNS,
    FIX_TYPE_COLUMN,
    GRADIENT_DEGC,
    GYRO_DEGC,
    VELOCITY,
    Stream,
)
from ins.earth import SEMI_MAJOR_AXIS_M
from ins.records import (
    FixType,
    GnssLog,
    ImuSource,
    InputError,
    LatitudeSource,
    OdometerLog,
    Phase,
    ReferenceLog,
    Run,
    RunHeader,
    Span,
    TemperatureLog,
)
from ins.thermometer_faults import HOLE_S, FaultKind, check_thermometers, of_another_run
from ins.units import DEG
from trajectories.runs.checks import (
    JITTER_WARNING,
    MAX_VALUE,
    Findings,
    Row,
    check_increasing,
    first_beyond,
)
from trajectories.runs.imu_stream import jitter
from trajectories.runs.stream_files import StreamFile

EARLIEST_S = -1.0  # of the first imu row: start_utc may have been rounded to whole seconds, by 1 s
LATEST_S = 60.0  # chosen: loggers start within 60 s of power-on; later, time_s is another clock
# of a fix that says nothing of it: single-frequency receivers under open sky, 2 to 5 m
FIX_SIGMA_M = 5.0
SITE_DEG = 1.0  # 111 km, between the site and the first fix: another place was entered
# of one power-on; one every 5 s of the longest run (text_rows.MAX_ROWS, 13.9 h)
MAX_PHASES = 10_000
Loaded = tuple[Any, list[Span]]
# what a log is told whose thermometers never change
HOW_TO_ACCEPT = "where it is a constant temperature, accepted_constant_temperature accepts it"


@dataclass(frozen=True, kw_only=True)
class RunStreams:
    """The streams of a run that could be read; None where one is absent or cannot be used."""

    imu: ImuSource | None = None
    temperature: TemperatureLog | None = None
    gnss: GnssLog | None = None
    odometer: OdometerLog | None = None
    phases: tuple[Phase, ...] | None = None


def load_temperature(stream: StreamFile, findings: Findings, *, constant: bool = False) -> Loaded:
    """Rows without a gyro temperature are dropped and listed; other temperatures may be missing.
    constant: thermometers that never change are accepted.
    """
    kept, faults = _columns(stream, ("time_s", *GYRO_DEGC), findings)
    if kept is None:
        return None, faults
    columns = kept.columns
    check_thermometer(columns, stream.label, findings, constant=constant)
    record = TemperatureLog(
        time_s=columns["time_s"],
        gyro_degC=_stack(columns, GYRO_DEGC),
        accel_degC=_stack(columns, ACCEL_DEGC) if ACCEL_DEGC[0] in columns else None,
        gradient_degC=_stack(columns, GRADIENT_DEGC) if GRADIENT_DEGC[0] in columns else None,
        block_degC=columns.get("block_degC"),
        ambient_degC=columns.get("ambient_degC"),
        constant=constant,
    )
    return record, faults


def load_gnss(stream: StreamFile, findings: Findings) -> Loaded:
    """Fixes with anything but a sigma or a type missing, and those at 0 N 0 E exactly (no fix), are
    dropped and listed.

    A sigma that is missing stays NaN (the declared one is taken then); a column of nothing else
    counts as absent.
    """
    kept, faults = _columns(
        stream,
        [name for name in stream.names if name not in (*FIX_SIGMA_COLUMNS, FIX_TYPE_COLUMN)],
        findings,
        no_fix=True,
    )
    if kept is None or not _check_position(kept, findings):
        return None, faults
    sigmas = {name: kept.columns[name] for name in FIX_SIGMA_COLUMNS if name in kept.columns}
    for name, values in list(sigmas.items()):
        wrong = np.isinf(values) | (values <= 0)
        if np.isnan(values).all():
            findings.warn(f"{stream.label}: column {name} has no value: taken as absent")
            del sigmas[name]
        elif wrong.any():
            k = int(np.argmax(wrong))
            findings.error(f"{kept.row(k)}: column {name}: got {values[k]:g}, needed more than 0")
            return None, faults
    types = kept.columns.get(FIX_TYPE_COLUMN)
    if types is not None and np.isnan(types).all():
        findings.warn(f"{stream.label}: column {FIX_TYPE_COLUMN} has no value: taken as absent")
        types = None
    if types is not None:
        wrong = np.isfinite(types) & ~np.isin(types, list(FixType))
        if wrong.any():
            k = int(np.argmax(wrong))
            known = ", ".join(f"{kind:d} ({kind.name.lower()})" for kind in FixType)
            told = f"column {FIX_TYPE_COLUMN}: got {types[k]:g}, needed {known} or none"
            findings.error(f"{kept.row(k)}: {told}")
            return None, faults
    return GnssLog(**_place_records(kept.columns), **sigmas, fix_type=types), faults


def load_odometer(stream: StreamFile, findings: Findings) -> Loaded:
    """Rows without a speed are dropped and listed."""
    kept, faults = _columns(stream, stream.names, findings)
    return (None if kept is None else OdometerLog(**kept.columns)), faults


def load_reference(stream: StreamFile, findings: Findings) -> ReferenceLog | None:
    """The truth; rows with anything missing are dropped."""
    kept, _ = _columns(stream, stream.names, findings)
    if kept is None or not _check_position(kept, findings):
        return None
    angles = {name.replace("_deg", "_rad"): kept.columns[name] * DEG for name in ATTITUDE}
    return ReferenceLog(**_place_records(kept.columns), **angles)


def load_phases(stream: StreamFile, findings: Findings) -> Loaded:
    """The phases in order of time; an unknown name or an end before its start is an error naming
    the row.
    """
    phases, errors = [], len(findings.errors)
    for k, (name, start_s, end_s) in enumerate(_phase_rows(stream)):
        try:
            if not (np.isfinite(start_s) and np.isfinite(end_s)):
                raise InputError(f"start_s {start_s}, end_s {end_s}, needed finite numbers")
            phases.append(Phase(phase=name, start_s=start_s, end_s=end_s))
        except InputError as error:
            findings.error(f"{stream.row(k)}: {error}")
    phases.sort(key=lambda p: p.start_s)
    for a, b in pairwise(phases):
        if b.start_s < a.end_s:
            findings.warn(
                f"{stream.label}: {b.phase} starts at {b.start_s:g} s, {a.phase} ends at"
                f" {a.end_s:g} s"
            )
    return (None if len(findings.errors) > errors else tuple(phases)), []


LOADERS: dict[str, Callable[[StreamFile, Findings], Loaded]] = {
    "temperature": load_temperature,
    "gnss": load_gnss,
    "odometer": load_odometer,
    "phases": load_phases,
}


def tables(run: Run, reference: ReferenceLog | None) -> dict[str, Mapping[str, ArrayLike]]:
    """The streams of a run as columns of its files; reading them back gives the same records bit
    for bit.
    """
    logs: dict[str, Stream | None] = {
        "imu": run.imu.whole(),
        "temperature": run.temperature,
        "gnss": run.gnss,
        "odometer": run.odometer,
        "reference": reference,
    }
    out: dict[str, Mapping[str, ArrayLike]] = {
        name: log.columns() for name, log in logs.items() if log is not None
    }
    if run.phases:
        keys = ("phase", "start_s", "end_s")
        out["phases"] = {key: [getattr(p, key) for p in run.phases] for key in keys}
    return out


def check_overlap(imu: ImuSource, held: RunStreams, header: RunHeader, findings: Findings) -> None:
    """Streams that do not share the imu's time, a start that is late or in the future, a site far
    from the first fix.
    """
    start, end = imu.start_s, imu.end_s
    if header.starts_after(now := datetime.now(UTC)):
        findings.suspect(
            f"run.json: start_utc {header.start_utc} is in the future, the clock says"
            f" {now:%Y-%m-%dT%H:%M:%SZ}"
        )
    if not EARLIEST_S <= start <= LATEST_S:
        findings.warn(
            f"imu: time_s starts at {start:.6g} s, expected near 0 (seconds from start_utc)"
        )
    if (spread := jitter(imu)) > JITTER_WARNING:
        findings.warn(f"imu: time stamps jitter by {spread:.0%} of the interval (99th percentile)")
    logs = {"temperature": held.temperature, "gnss": held.gnss, "odometer": held.odometer}
    apart = {name for name, log in logs.items() if log is not None and _apart(log, start, end)}
    for name, log in logs.items():
        if log is not None and name in apart:
            a, b = log.time_s[0], log.time_s[-1]
            findings.suspect(
                f"{name}: time_s {a:.6g} to {b:.6g} s, imu {start:.6g} to {end:.6g} s: other time"
                " base?"
            )
        elif name == "temperature" and log is not None:
            if of_another_run(log.time_s, start, end):
                findings.suspect(
                    f"temperature: time_s goes on to {log.time_s[-1]:.6g} s, imu ends at {end:.6g}"
                    " s: the temperatures of another run?"
                )
            findings.warn(*_unread(log.time_s, start, end))
    if held.gnss is not None:
        findings.warn(*_far_off(held.gnss, header))


def _apart(log: Stream, start_s: float, end_s: float) -> bool:
    return bool(log.time_s[0] > end_s or log.time_s[-1] < start_s)


def _unread(time_s: NDArray, start_s: float, end_s: float) -> list[str]:
    """A line for each end of the log that a thermometer leaves without a reading for long."""
    beyond = [(start_s, time_s[0]), (time_s[-1], end_s)]
    return [
        f"temperature: no reading from {a:.1f} to {b:.1f} s ({b - a:.0f} s)"
        for a, b in beyond
        if b - a > HOLE_S
    ]


def latitude_sigma_rad(gnss: GnssLog, k: int) -> float:
    """Of the latitude of a fix, by its receiver."""
    sigma_m = FIX_SIGMA_M
    if gnss.sigma_horizontal_m is not None and gnss.sigma_horizontal_m[k] > 0.0:
        sigma_m = float(gnss.sigma_horizontal_m[k])
    return sigma_m / SEMI_MAJOR_AXIS_M


def with_receiver(header: RunHeader, gnss: GnssLog) -> RunHeader:
    """The header, its latitude as well known as its receiver says: by the first fix's sigma and by
    how far it is from the site.
    """
    off_rad = float(gnss.lat_rad[0]) - header.site.lat_rad
    sigma_rad = float(np.hypot(latitude_sigma_rad(gnss, 0), off_rad))
    if sigma_rad >= header.site.sigma_lat_rad:
        return header
    source = LatitudeSource.RECEIVER
    return replace(header, site=replace(header.site, sigma_lat_rad=sigma_rad, lat_source=source))


def _far_off(gnss: GnssLog, header: RunHeader) -> list[str]:
    """A line where the first fix is far from the site."""
    lat_deg = np.degrees(abs(gnss.lat_rad[0] - header.site.lat_rad))
    lon_deg = np.degrees(abs(gnss.lon_rad[0] - header.site.lon_rad))
    east_deg = lon_deg * np.cos(header.site.lat_rad)
    near = lat_deg <= SITE_DEG and not SITE_DEG < east_deg < 360.0 - SITE_DEG
    if near:
        return []
    return [
        f"gnss: first fix is {lat_deg:.3f} deg in latitude, {lon_deg:.3f} in longitude off the site"
    ]


@dataclass(frozen=True)
class _Rows:
    """The rows kept, column by column, and how a message names one of them as it was in the
    file.
    """

    columns: dict[str, NDArray]
    row: Row


def _columns(
    stream: StreamFile, required: Sequence[str], findings: Findings, *, no_fix: bool = False
) -> tuple[_Rows | None, list[Span]]:
    """All columns without the rows that lack a required value; None after an error."""
    columns = stream.columns()
    if wild := _wild(columns):
        name, k = wild
        findings.error(
            f"{stream.row(k)}: column {name}: got {columns[name][k]:g}, needed within"
            f" +-{MAX_VALUE:g}"
        )
        return None, []
    empty = [name for name in required if not np.isfinite(columns[name]).any()]
    if empty:
        findings.error(f"{stream.label}: column {empty[0]} has no finite value")
        return None, []
    kept = np.all([np.isfinite(columns[name]) for name in required], axis=0)
    why = "missing values"
    if no_fix and np.any(zero := (columns["lat_deg"] == 0) & (columns["lon_deg"] == 0)):
        kept, why = kept & ~zero, "missing values or position 0, 0"
    rows = np.flatnonzero(kept)
    if not rows.size:
        findings.error(f"{stream.label}: no row is complete")
        return None, []
    faults = _dropped(stream.label, columns["time_s"], kept, why)
    findings.warn(
        *(f"{stream.label}: {s.reason} ({s.start_s:.3f} to {s.end_s:.3f} s)" for s in faults)
    )
    part = _Rows(
        columns
        if kept.all()
        else {name: np.ascontiguousarray(values[rows]) for name, values in columns.items()},
        lambda k: stream.row(int(rows[k])),
    )
    wrong = check_increasing(part.columns["time_s"], part.row)
    findings.error(*wrong)
    return (None if wrong else part), faults


def _wild(columns: dict[str, NDArray]) -> tuple[str, int] | None:
    """Column and index of the first finite number beyond MAX_VALUE; None where there is none."""
    for name, values in columns.items():
        if (k := first_beyond(values)) is not None:
            return name, k
    return None


def _dropped(label: str, time_s: NDArray, kept: NDArray, why: str) -> list[Span]:
    """Each run of dropped rows as a span of time, of rows without any between their neighbours."""
    rows = np.arange(time_s.size)
    stamped = np.isfinite(time_s)
    known_s = np.interp(rows, rows[stamped], time_s[stamped])
    edges = np.flatnonzero(np.diff(np.concatenate([[True], kept, [True]]).astype(int)))
    spans = []
    for a, b in zip(edges[::2], edges[1::2]):
        lacks = why if stamped[a:b].any() else "no time_s"
        named = f"row {a + 1}" if b == a + 1 else f"rows {a + 1} to {b}"
        reason = f"{label.split('.')[0]}: {named} dropped, {lacks}"
        spans.append(Span(start_s=float(known_s[a]), end_s=float(known_s[b - 1]), reason=reason))
    return spans


def _check_position(kept: "_Rows", findings: Findings) -> bool:
    wrong: list[str] = []
    for name, low, high in (
        ("lat_deg", -90, 90),
        ("lon_deg", -360, 360),
        ("height_m", -1000, 30000),
    ):
        values = kept.columns[name]
        bad = np.flatnonzero((values < low) | (values > high))
        wrong += [
            f"{kept.row(k)}: column {name}: got {values[k]:g}, needed {low} to {high}"
            for k in bad[:1]
        ]
    findings.error(*wrong)
    return not wrong


def _phase_rows(stream: StreamFile) -> list[tuple[str, float, float]]:
    if not stream.is_text:
        columns = [
            stream.text_column("phase", MAX_PHASES),
            stream.column("start_s").tolist(),
            stream.column("end_s").tolist(),
        ]
        return list(zip(*columns))
    order = [stream.names.index(name) for name in ("phase", "start_s", "end_s")]
    try:
        rows = [r for r in csv.reader(stream.text_lines(MAX_PHASES)) if r]
    except csv.Error as error:
        raise InputError(f"{stream.label}: not rows of separated values ({error})") from None
    out = []
    for k, row in enumerate(rows):
        try:
            name, start, end = (row[i].strip() for i in order)
            out.append((name, float(start), float(end)))
        except (IndexError, ValueError):
            raise InputError(
                f"{stream.row(k)}: got {','.join(row)[:60]!r}, needed phase, start_s, end_s"
            ) from None
    return out


def _stack(columns: dict[str, NDArray], names: Sequence[str]) -> NDArray:
    return np.stack([columns[n] for n in names], axis=1)


def _place_records(columns: dict[str, NDArray]) -> dict[str, NDArray]:
    return {
        "time_s": columns["time_s"],
        "lat_rad": columns["lat_deg"] * DEG,
        "lon_rad": columns["lon_deg"] * DEG,
        "height_m": columns["height_m"],
        "v_n_m_s": _stack(columns, VELOCITY),
    }


def check_thermometer(
    columns: dict[str, NDArray], label: str, findings: Findings, *, constant: bool = False
) -> None:
    """Warnings on thermometers and holes; kelvin, which no reader should pass on, is a suspect.
    constant: readings that never change are accepted.
    """
    time_s = columns["time_s"]
    thermometers = {
        name: values
        for name, values in columns.items()
        if name != "time_s" and not name.startswith("gradient") and np.isfinite(values).any()
    }
    never_change = all(np.ptp(v[np.isfinite(v)]) == 0.0 for v in thermometers.values())
    for fault in check_thermometers(time_s, thermometers, constant=constant).faults:
        name = "" if fault.column == "temperature" else f"{fault.column} "
        say = findings.suspect if fault.kind is FaultKind.IMPLAUSIBLE else findings.warn
        hint = f" ({HOW_TO_ACCEPT})" if fault.kind is FaultKind.STUCK and never_change else ""
        say(f"{label}: {name}{fault.text}{hint}")
