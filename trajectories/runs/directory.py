"""Read and write run directories (formats.md, section 1).

`inspect_run` reads everything and lists all that is wrong; `read_run` is the same, raising the
first error. Truth (`reference`) comes only from `read_reference`, so that no estimator can see it.
"""

import hashlib
import json
import os
import shutil
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ins.json_file import Written, read_json_object
from ins.records import ImuSource, InputError, ReferenceLog, Run, RunHeader, Span
from trajectories.runs import streams
from trajectories.runs.checks import Finding, Findings
from trajectories.runs.imu_stream import load_imu
from trajectories.runs.physics_gates import CoSensors, QuietMeans, check_physics
from trajectories.runs.schema import (
    STREAMS,
    ConversionRecord,
    SimulationRecord,
    check_columns,
    header_from_json,
    header_to_json,
)
from trajectories.runs.stream_files import HELD_ROWS, STREAM_ENDINGS, StreamFile, write_columns
from trajectories.runs.streams import RunStreams

FORMATS = ("parquet", "csv", "csv.gz")
MOST_STRANGERS = 10  # chosen: named one by one; a folder with 10 other files is hardly a run


@dataclass(frozen=True, kw_only=True, repr=False)
class Inspection:
    """What a run directory holds and what is wrong with it; `run` is None where an error makes it
    unusable.

    `header` and `streams` are what could be read even then (streams: None where `path` is no
    directory); `quiet` holds the means at rest.
    """

    path: Path
    run: Run | None = None
    findings: tuple[Finding, ...]
    header: RunHeader | None = None
    streams: RunStreams | None = None
    faults: tuple[Span, ...] = ()
    quiet: QuietMeans | None = None

    @property
    def errors(self) -> list[str]:
        return [item.text for item in self.findings if item.level == "error"]

    def __repr__(self) -> str:
        others = len(self.findings) - len(self.errors)
        said = f"{len(self.errors)} errors, {others} other findings"
        return f"Inspection of {self.path}: {said}\n{self.run!r}"


def read_run(path: Path, *, held_rows: int = HELD_ROWS, dead_columns: bool = False) -> Run:
    """The run in a directory, without its reference. InputError names the file, the row or key, and
    the trouble.

    What could be repaired or had to be dropped is in `Run.faults`. An imu stream of more than
    `held_rows` rows stays in its file, which must then outlive the run. dead_columns: imu columns
    without any value stay as NaN.
    """
    inspection = inspect_run(path, held_rows=held_rows, dead_columns=dead_columns)
    if inspection.run is None:
        first, *rest = inspection.errors
        more = f" (and {len(rest)} more: recal check lists all)" if rest else ""
        raise InputError(f"{_within(inspection.path, first)}{more}")
    return inspection.run


def read_reference(path: Path) -> ReferenceLog | None:
    """The truth in a run directory, for scoring only; None where it has none."""
    findings = Findings()
    stream = _open_stream(Path(path), "reference", findings)
    log = streams.load_reference(stream, findings) if stream else None
    if findings.errors:
        raise InputError(_within(Path(path), findings.errors[0]))
    return log


def inspect_run(
    path: Path, *, held_rows: int = HELD_ROWS, dead_columns: bool = False
) -> Inspection:
    """Reads a run directory and lists everything that is wrong; raises nothing for bad input.
    Options as `read_run`.
    """
    path, findings = Path(path), Findings()
    if not path.is_dir():
        what = f"{path}: no such run directory"
        if path.exists():
            what = f"{path}: a file, needed a run directory; recal look says how to make one of it"
        return Inspection(path=path, findings=(Finding(level="error", text=what),))
    header, by_digits = _read_header(path, findings)
    accepted = header is not None and header.accepted_constant_temperature
    held, faults = _read_streams(
        path,
        findings,
        held_rows=held_rows,
        dead_columns=dead_columns,
        constant_temperature=accepted,
    )
    _warn_of_strangers(path, findings)
    imu, quiet, run = held.imu, None, None
    if imu is not None and header is not None:
        site, technology = header.site, header.gyro_technology
        quiet = check_physics(
            imu,
            site=site,
            technology=technology,
            label=_label(path, "imu"),
            findings=findings,
            beside=CoSensors(
                gnss=held.gnss,
                odometer=held.odometer,
                accepted_scale=header.accepted_accel_scale,
                any_attitude=header.any_attitude,
            ),
        )
        streams.check_overlap(imu, held, header, findings)
        if by_digits and held.gnss is not None:
            header = streams.with_receiver(header, held.gnss)
    if imu is not None and header is not None and not findings.errors:
        run = _run_of(header, imu, held, faults)
    return Inspection(
        path=path,
        run=run,
        findings=tuple(findings.items),
        header=header,
        streams=held,
        faults=faults,
        quiet=quiet,
    )


def _read_streams(
    path: Path,
    findings: Findings,
    *,
    held_rows: int,
    dead_columns: bool,
    constant_temperature: bool,
) -> tuple[RunStreams, tuple[Span, ...]]:
    """The streams that can be used, and what was dropped or repaired, in order of time."""
    loaders: dict[str, Callable] = {
        "imu": partial(load_imu, held_rows=held_rows, dead_columns=dead_columns),
        **streams.LOADERS,
        "temperature": partial(streams.load_temperature, constant=constant_temperature),
    }
    logs: dict[str, Any] = {}
    faults: list[Span] = []
    for name, load in loaders.items():
        logs[name], more = _load(path, name, load, findings, held_rows) or (None, [])
        faults += more
    faults.sort(key=lambda span: span.start_s)
    return RunStreams(**logs), tuple(faults)


def _run_of(header: RunHeader, imu: ImuSource, held: RunStreams, faults: tuple[Span, ...]) -> Run:
    run = Run(
        header=header,
        imu=imu,
        temperature=held.temperature,
        gnss=held.gnss,
        odometer=held.odometer,
        phases=held.phases or (),
        faults=faults,
    )
    return replace(run, sha256=run_sha256(run))


def run_sha256(run: Run) -> str:
    """Hash of what was measured: the serial and the float64 content of imu, temperature, gnss and
    odometer.

    Packing, column order, run_id, tail, site and phases do not change it, so that the same
    recording is known again under another name. Increments are hashed as read (rates once turned
    into increments), angles in radians.
    """
    digest = hashlib.sha256(json.dumps(["recal.run/1", run.header.imu_serial]).encode())
    for key, shape in (
        ("dtheta_rad", (run.imu.rows, 3)),
        ("dv_m_s", (run.imu.rows, 3)),
        ("time_s", (run.imu.rows,)),
    ):
        digest.update(f"imu.{key}{shape}".encode())
        for piece in run.imu.pieces():
            digest.update(np.ascontiguousarray(getattr(piece, key), dtype="<f8").data)
    for name in ("temperature", "gnss", "odometer"):
        log = getattr(run, name)
        for key, values in sorted(vars(log).items() if log else ()):
            if isinstance(values, np.ndarray):
                digest.update(f"{name}.{key}{values.shape}".encode())
                digest.update(np.ascontiguousarray(values, dtype="<f8").data)
    return digest.hexdigest()


def write_run(
    path: Path,
    run: Run,
    *,
    reference: ReferenceLog | None = None,
    fmt: str = "parquet",
    conversion: ConversionRecord | None = None,
    simulation: SimulationRecord | None = None,
) -> None:
    """Writes a run directory completely or not at all; an older run at `path` is replaced.

    conversion, simulation: where the run came from, kept in run.json.

    fmt is "parquet", "csv" or "csv.gz". InputError where `path` exists and is not a run: nothing is
    overwritten.
    """
    if fmt not in FORMATS:
        raise InputError(f"run format {fmt!r}, needed one of {', '.join(FORMATS)}")
    path = Path(path)
    _refuse_foreign(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        new = Path(tempfile.mkdtemp(dir=path.parent, prefix=f".{path.name}."))
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror or error})") from None
    try:
        text = (
            json.dumps(
                header_to_json(run.header, conversion=conversion, simulation=simulation),
                indent=1,
                allow_nan=False,
            )
            + "\n"
        )
        (new / "run.json").write_text(text, encoding="utf-8")
        for name, columns in streams.tables(run, reference).items():
            write_columns(new / f"{name}.{fmt}", columns)
        new.chmod(0o777 & ~_umask())
        _put_in_place(new, path)
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror or error})") from None
    finally:
        shutil.rmtree(new, ignore_errors=True)


def _within(path: Path, text: str) -> str:
    named = text.startswith((f"{path}:", f"{path}{os.sep}")) or text.endswith(f" in {path}")
    return text if named else f"{path}: {text}"


def _read_header(path: Path, findings: Findings) -> tuple[RunHeader | None, bool]:
    """The header, and whether the digits of its latitude alone say how well that is known."""
    try:
        data = read_json_object(_confined(path, "run.json"), number=Written)
    except InputError as error:
        findings.error(str(error).removeprefix(f"{path}{os.sep}"))
        return None, False
    header, errors, warnings = header_from_json(data, name="run.json")
    findings.error(*errors)
    findings.warn(*warnings)
    site = data.get("site")
    return header, isinstance(site, dict) and "sigma_lat_deg" not in site


def _load(path: Path, name: str, load: Callable, findings: Findings, held_rows: int) -> Any:
    """What `load` makes of a stream; None where it is absent or cannot be used (then findings say
    why).
    """
    stream = _open_stream(path, name, findings, held_rows)
    try:
        return load(stream, findings) if stream else None
    except InputError as error:
        findings.error(str(error))
        return None
    finally:
        findings.warn(*(stream.notes if stream else ()))


def _open_stream(
    path: Path, name: str, findings: Findings, held_rows: int = HELD_ROWS
) -> StreamFile | None:
    found = [f"{name}{end}" for end in STREAM_ENDINGS if os.path.lexists(path / f"{name}{end}")]
    if len(found) > 1:
        findings.error(f"{' and '.join(found)}: needed one of them")
    elif not found and name == "imu":
        findings.error(f"imu.parquet is missing (or imu.csv, imu.csv.gz) in {path}")
    if len(found) != 1:
        return None
    try:
        stream = StreamFile(_confined(path, found[0]), held_rows=held_rows)
    except InputError as error:
        findings.error(str(error).removeprefix(f"{path}{os.sep}"))
        return None
    wrong = check_columns(name, stream.names, where=stream.label)
    findings.error(*wrong)
    return None if wrong else stream


def _confined(path: Path, name: str) -> Path:
    file = path / name
    try:
        inside = file.resolve().is_relative_to(path.resolve())
    except (OSError, RuntimeError):  # before and since Python 3.13
        raise InputError(f"{name}: a link to itself") from None
    if not inside:
        raise InputError(f"{name}: a link that leaves the run directory")
    if file.exists() and not file.is_file():  # a pipe would never end
        raise InputError(f"{name}: not a file")
    return file


def _label(path: Path, name: str) -> str:
    return next(
        (f"{name}{end}" for end in STREAM_ENDINGS if (path / f"{name}{end}").exists()), name
    )


def _run_files() -> set[str]:
    return {"run.json", *(f"{name}{end}" for name in STREAMS for end in STREAM_ENDINGS)}


def _warn_of_strangers(path: Path, findings: Findings) -> None:
    strangers = sorted(p.name for p in path.iterdir() if p.name not in _run_files())
    findings.warn(*(f"{name}: not part of a run, not read" for name in strangers[:MOST_STRANGERS]))
    if len(strangers) > MOST_STRANGERS:
        findings.warn(f"{len(strangers) - MOST_STRANGERS} more files are not part of a run")


def _refuse_foreign(path: Path) -> None:
    if path.is_dir():
        names = {p.name for p in path.iterdir()}
        foreign = sorted(names - _run_files())
        if foreign or (names and "run.json" not in names):
            held = foreign[0] if foreign else "no run.json"
            raise InputError(f"{path}: exists and is not a run (holds {held}), not overwritten")
    elif path.exists() or path.is_symlink():
        raise InputError(f"{path}: exists and is not a run directory, not overwritten")


def _put_in_place(new: Path, path: Path) -> None:
    """Rename a complete directory to its name; an older one steps aside first and is then
    removed.
    """
    if not path.exists():
        new.rename(path)
        return
    aside = Path(tempfile.mkdtemp(dir=path.parent, prefix=f".{path.name}.old."))
    path.rename(aside / path.name)
    try:
        new.rename(path)
    except OSError:
        (aside / path.name).rename(path)
        raise
    finally:
        shutil.rmtree(aside, ignore_errors=True)


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
