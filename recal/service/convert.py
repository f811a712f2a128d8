"""`convert`: a flight log of a known format, or by a column map, to a run."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from ins.documents import MadeOf, made
from ins.json_file import JsonObject, read_toml
from ins.records import InputError, ReferenceLog, Run, Span
from recal.service.results.files import AnyPath
from recal.service.results.overwrite import Peeked
from recal.service.results.result import Result
from trajectories.readers.conversion import Conversion, convert_log, file_sha256
from trajectories.readers.rows.column_map import LogOptions, MapError, without_placeholders
from trajectories.readers.rows.row_cleaning import LogGapError
from trajectories.runs.checks import Finding
from trajectories.runs.directory import write_run

of = MadeOf[Conversion]()
CONVERT_STEPS = 2  # that `told` is told of
# of a stretch that becomes a run; chosen: 10 fixes of one a second are the fewest that aided replay
# takes
SHORTEST_SPLIT_S = 10.0


@dataclass(frozen=True, kw_only=True)
class ConvertReport:
    """What `recal convert --json` prints; run: where it was written."""

    schema: str = "recal.convert/1"
    run: str | None
    run_id: str = of(lambda conversion: conversion.run.header.run_id)
    sha256: str = of(lambda conversion: conversion.run.sha256)
    format: str = of(lambda conversion: conversion.record.format)
    rows: int = of(lambda conversion: conversion.run.imu.rows)
    rate_hz: float = of(lambda conversion: conversion.run.imu.rate_hz)
    duration_s: float = of(lambda conversion: conversion.run.imu.end_s)
    time_shift_s: float = of(lambda conversion: conversion.record.time_shift_s)
    notes: Sequence[str] = of(lambda conversion: conversion.record.notes)
    repaired: Sequence[Span] = of(lambda conversion: conversion.run.faults)
    streams: Sequence[str] = of(lambda conversion: _streams(conversion))
    problems: Sequence[Finding] = of(lambda conversion: conversion.findings)


@dataclass(frozen=True, repr=False, eq=False, kw_only=True)
class Converted(Result[ConvertReport]):
    """A run made from a log, and all that was dropped or repaired.

    Parameters
    ----------
    conversion : Conversion
        The run, the log's own solution as reference, the record of what was done.
    """

    conversion: Conversion

    @property
    def run(self) -> Run:
        """The run."""
        return self.conversion.run

    @property
    def reference(self) -> ReferenceLog | None:
        """The log's own solution, None where it has none."""
        return self.conversion.reference

    def lines(self, *, verbose: bool = False) -> list[str]:
        """Notes, repairs, problems, and what the run holds."""
        result = self.record
        lines = [f"note: {note}" for note in result.notes]
        lines += [
            f"repaired: {s.start_s:.3f} to {s.end_s:.3f} s: {s.reason}" for s in result.repaired
        ]
        lines += [f"{p.level}: {p.text}" for p in result.problems]
        beside = f" (with {', '.join(result.streams)})" if result.streams else ""
        start_s = round(result.time_shift_s, 6) + 0.0  # no -0
        lines.append(
            f"{result.run or result.run_id}: {result.rows} rows, {result.rate_hz:.4g} Hz,"
            f" {result.duration_s:.3f} s{beside}; log time {start_s:.6f} s is run time 0"
        )
        return lines


def convert(
    log: AnyPath,
    output: AnyPath | None = None,
    *,
    map_file: AnyPath | None = None,
    gnss: AnyPath | None = None,
    header: Mapping[str, str | float | None] | None = None,
    options: Mapping[str, str | float | None] | None = None,
    told: Callable[[str], None] = lambda words: None,
) -> Converted:
    """Convert a flight log to a run.

    Parameters
    ----------
    log : str or path
        A flight log.
    output : str or path, optional
        The run directory to write; without it, nothing is written.
    map_file : str or path, optional
        TOML map of a table: columns, units, axes, rate.
    gnss : str or path, optional
        Fixes that are in a file of their own.
    header : mapping, optional
        What the log does not say: imu_serial, gyro_technology, lat_deg, lon_deg, height_m, tail,
        start_utc, run_id.
    options : mapping, optional
        format, imu (its number), from_s and to_s (by the log's own clock).
    told : callable
        Told what is being done, in CONVERT_STEPS steps.

    Returns
    -------
    Converted
        The run, notes on what was assumed, dropped and repaired.

    Raises
    ------
    InputError
        Where the log's format is not known or a value is missing, and which.

    Examples
    --------
    >>> import recal
    >>> recal.convert("nothing.bin")
    Traceback (most recent call last):
        ...
    ins.records.InputError: nothing.bin: no such file
    """
    given = map_keys(map_file, gnss, header, options)
    told(f"reading {Path(log).name}")
    with map_errors(map_file):
        conversion = convert_log(Path(log), given, dict(header or {}))
    told("writing the run")
    if output is not None:
        write_run(
            Path(output),
            conversion.run,
            reference=conversion.reference,
            conversion=conversion.record,
        )
    return Converted(summary(conversion, output), conversion=conversion)


def map_keys(
    map_file: AnyPath | None,
    gnss: AnyPath | None,
    header: Mapping[str, str | float | None] | None,
    options: Mapping[str, str | float | None] | None,
) -> JsonObject:
    """The keys of a map file and the options over them; InputError where a placeholder is left."""
    given = {} if map_file is None else read_toml(Path(map_file))
    given |= {key: value for key, value in (options or {}).items() if value is not None}
    with map_errors(map_file):
        given = dict(without_placeholders(LogOptions(given), header or {}).keys)
    return given if gnss is None else with_gnss_file(given, Path(gnss))


@contextmanager
def map_errors(map_file: AnyPath | None) -> Iterator[None]:
    """A fault of the map names the map's file."""
    try:
        yield
    except MapError as error:
        if map_file is None:
            raise
        raise InputError(f"{Path(map_file).name}: {error}") from None


@dataclass(frozen=True, kw_only=True)
class StretchLeftOut:
    """A stretch of a log that became no run, and why; times by the log's own clock."""

    from_s: float
    to_s: float
    why: str


@dataclass(frozen=True, kw_only=True)
class SplitReport:
    """What `recal convert --split --json` prints."""

    schema: str = "recal.convert_split/1"
    runs: Sequence[ConvertReport]
    left_out: Sequence[StretchLeftOut]


@dataclass(frozen=True, repr=False, eq=False, kw_only=True)
class Split(Result[SplitReport]):
    """The runs of a log with gaps.

    Parameters
    ----------
    parts : tuple of Converted
        In order of time.
    """

    parts: tuple[Converted, ...]

    def lines(self, *, verbose: bool = False) -> list[str]:
        """Each run, and what became none."""
        told = [line for part in self.parts for line in part.lines(verbose=verbose)]
        return told + [
            f"left out: log time {s.from_s:.3f} to {s.to_s:.3f} s: {s.why}"
            for s in self.record.left_out
        ]


def split(
    log: AnyPath,
    output: AnyPath,
    *,
    map_file: AnyPath | None = None,
    gnss: AnyPath | None = None,
    header: Mapping[str, str | float | None] | None = None,
    options: Mapping[str, str | float | None] | None = None,
    told: Callable[[str], None] = lambda words: None,
) -> Split:
    """Convert a flight log to a run for each stretch without a gap: run-1, run-2, ... in a folder.

    Parameters
    ----------
    log, map_file, gnss, header, options
        As of `convert`; the name of a run is that of the log, or run_id, with its number.
    output : str or path
        The folder to write to, made if need be.
    told : callable
        Told what is being done, in CONVERT_STEPS steps for each run.

    Returns
    -------
    Split
        The runs, and the stretches that became none.

    Raises
    ------
    InputError
        Where no stretch becomes a run: what the longest one lacks.
    """
    name = str((header or {}).get("run_id") or Path(log).name.split(".")[0])

    def made(number: int, more: Mapping[str, str | float | None]) -> Converted:
        return convert(
            log,
            Path(output) / f"run-{number}",
            map_file=map_file,
            gnss=gnss,
            header={**(header or {}), "run_id": f"{name}-{number}"},
            options={**(options or {}), **more},
            told=lambda words: told(f"run {number}: {words}"),
        )

    try:
        parts, left = [made(1, {})], list[StretchLeftOut]()
    except LogGapError as gaps:
        parts, left = _each(gaps, made)
    document = SplitReport(runs=[part.record for part in parts], left_out=left)
    return Split(document, parts=tuple(parts))


def _each(
    gaps: LogGapError, made: Callable[[int, Mapping[str, float]], Converted]
) -> tuple[list[Converted], list[StretchLeftOut]]:
    """A run of each stretch that can be one, and the stretches that became none."""
    parts: list[Converted] = []
    left: list[StretchLeftOut] = []
    for from_s, to_s in gaps.stretches:
        why = f"{to_s - from_s:.1f} s, needed {SHORTEST_SPLIT_S:g} s"
        if to_s - from_s >= SHORTEST_SPLIT_S:
            try:
                parts.append(made(len(parts) + 1, {"from_s": from_s, "to_s": to_s}))
                continue
            except InputError as error:
                why = str(error)
        left.append(StretchLeftOut(from_s=from_s, to_s=to_s, why=why))
    if not parts:
        longest = max(left, key=lambda s: s.to_s - s.from_s)
        raise InputError(
            f"no stretch becomes a run; the longest one, --from-s {longest.from_s:.3f} --to-s"
            f" {longest.to_s:.3f}: {longest.why}"
        ) from gaps
    return parts, left


def made_of(found: Peeked, log: Path) -> bool:
    """Whether a run.json says that the run was converted from this very log."""
    if found.source != log.name or not log.exists():
        return False
    return found.source_sha256 == file_sha256(log)


def with_gnss_file(options: JsonObject, gnss: Path) -> JsonObject:
    """The map with the file of its [gnss] named; a key that is no table is left to the reader to
    refuse.
    """
    keys = options.get("gnss", {})
    file = str(gnss.absolute())
    return {**options, "gnss": {**keys, "file": file} if isinstance(keys, dict) else keys}


def summary(conversion: Conversion, output: AnyPath | None) -> ConvertReport:
    """The result `recal.convert/1`."""
    return made(ConvertReport, conversion, run=None if output is None else str(output))


def _streams(conversion: Conversion) -> list[str]:
    """What stands beside the IMU."""
    logged = ("temperature", "gnss", "odometer")
    found = [name for name in logged if getattr(conversion.run, name) is not None]
    return found + ["reference"] * (conversion.reference is not None)
