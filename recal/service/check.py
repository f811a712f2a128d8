"""`check`: what a run holds, what is wrong with it and where."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ins.documents import INLINE, OMIT_NONE
from ins.records import ImuSource, InputError, Phase, ReferenceLog, Span, TemperatureLog
from ins.units import DEG_PER_HOUR
from recal.service.results.files import AnyPath
from recal.service.results.result import Result
from trajectories.runs import directory
from trajectories.runs.checks import Finding
from trajectories.runs.directory import Inspection, read_reference
from trajectories.runs.imu_stream import jitter
from trajectories.runs.physics_gates import ExpectedRest, expected_rest
from trajectories.runs.streams import RunStreams

CHECK_STEPS = 2  # that `told` is told of
SEVERITIES = ("error", "suspect", "warning")  # of a problem, the worst first


class CheckVerdict(StrEnum):
    """Whether a run can be used."""

    OK = "ok"
    WARNINGS = "warnings"
    BAD_INPUT = "bad_input"


@dataclass(frozen=True, kw_only=True)
class Held:
    """The rows of a stream."""

    rows: int
    start_s: float
    end_s: float
    duration_s: float


@dataclass(frozen=True, kw_only=True)
class ImuHeld(Held):
    """Those of the IMU; jitter: of its intervals, relative."""

    source: str
    rate_hz: float
    jitter: float


@dataclass(frozen=True, kw_only=True)
class TemperatureHeld(Held):
    """Those of the thermometers; least and greatest value of each that reads anything."""

    range_degC: Mapping[str, tuple[float, float]]


@dataclass(frozen=True, kw_only=True)
class StreamsHeld:
    """The streams beside the IMU's."""

    temperature: TemperatureHeld | None = None
    gnss: Held | None = None
    odometer: Held | None = None


@dataclass(frozen=True, kw_only=True)
class RestHeld:
    """Means over the quiet start, beside what the site should give; w_down: about the vertical."""

    start_s: float
    end_s: float
    mean_f_m_s2: NDArray
    mean_w_deg_h: NDArray
    size_f_m_s2: float
    size_w_deg_h: float
    w_down_deg_h: float
    expected: ExpectedRest
    speed_m_s: float | None = field(default=None, metadata=OMIT_NONE)


@dataclass(frozen=True, kw_only=True)
class RunHolds:
    """What a run holds; beside: None where there is no run directory."""

    imu: ImuHeld | None
    beside: StreamsHeld | None = field(metadata=INLINE)
    phases: Sequence[Phase]
    at_rest: RestHeld | None
    reference: Held | None


@dataclass(frozen=True, kw_only=True)
class CheckReport:
    """What `recal check --json` prints."""

    schema: str = "recal.check/1"
    run: str
    verdict: CheckVerdict
    run_id: str | None
    imu_serial: str | None
    sha256: str | None
    holds: RunHolds
    problems: Sequence[Finding]
    repaired: Sequence[Span]


@dataclass(frozen=True, repr=False, eq=False)
class Check(Result[CheckReport]):
    """What `check` found; `problems` by their level, the worst first.

    Parameters
    ----------
    problems : tuple of Finding
        Level ("error", "suspect" or "warning") and text of each.
    """

    problems: tuple[Finding, ...] = ()

    @property
    def ok(self) -> bool:
        """Whether the run can be used."""
        return all(problem.level == "warning" for problem in self.problems)

    def lines(self, *, verbose: bool = False) -> list[str]:
        """What the run holds, then one line for each problem."""
        return report_lines(self.record)


def check(
    run: AnyPath, *, serial: str | None = None, told: Callable[[str], None] = lambda words: None
) -> Check:
    """Read a run and say what it holds, what is wrong with it and where.

    Parameters
    ----------
    run : str or path
        A run directory.
    serial : str, optional
        Serial number that the run should have. Default: any.
    told : callable
        Told what is being done, in CHECK_STEPS steps.

    Returns
    -------
    Check
        Verdict `ok`, `warnings` or `bad_input`, the problems, what each stream holds (rows, times
        in s, temperatures in degC, means at rest). A run that cannot be read is a result, not an
        exception.

    Raises
    ------
    InputError
        Where the operating system refuses the directory.

    Examples
    --------
    >>> import recal
    >>> recal.check("nowhere").verdict
    'bad_input'
    """
    path = Path(run)
    told("reading the streams")
    seen = directory.inspect_run(path)
    told("reading the reference")
    problems = list(seen.findings)
    reference = None
    if path.is_dir():
        try:
            reference = read_reference(path)
        except InputError as error:
            text = str(error).removeprefix(f"{path}: ")
            problems.append(Finding(level="error", text=text))
    if serial is not None and seen.header is not None and seen.header.imu_serial != serial:
        text = f"run.json: imu_serial {seen.header.imu_serial!r}, needed {serial!r}"
        problems.append(Finding(level="error", text=text))
    problems.sort(key=lambda problem: SEVERITIES.index(problem.level))
    return Check(_document(path, seen, reference, problems), problems=tuple(problems))


def _document(
    path: Path, seen: Inspection, reference: ReferenceLog | None, problems: list[Finding]
) -> CheckReport:
    """What `--json` prints."""
    return CheckReport(
        run=str(path),
        verdict=_verdict(problems),
        run_id=seen.header.run_id if seen.header else None,
        imu_serial=seen.header.imu_serial if seen.header else None,
        sha256=seen.run.sha256 if seen.run else None,
        holds=_holds(seen, reference),
        problems=problems,
        repaired=seen.faults,
    )


def _verdict(problems: list[Finding]) -> CheckVerdict:
    if any(problem.level != "warning" for problem in problems):
        return CheckVerdict.BAD_INPUT
    return CheckVerdict.WARNINGS if problems else CheckVerdict.OK


def _holds(seen: Inspection, reference: ReferenceLog | None) -> RunHolds:
    streams = seen.streams
    phases = () if streams is None else streams.phases or ()
    return RunHolds(
        imu=None if streams is None or streams.imu is None else _imu(streams.imu),
        beside=None if streams is None else _beside(streams),
        phases=phases,
        at_rest=_at_rest(seen),
        reference=None if reference is None else _times(reference.time_s),
    )


def _beside(streams: RunStreams) -> StreamsHeld:
    """The streams beside the IMU's."""
    temperature, gnss, odometer = streams.temperature, streams.gnss, streams.odometer
    warmth = None
    if temperature is not None:
        times = vars(_times(temperature.time_s))
        warmth = TemperatureHeld(**times, range_degC=_ranges(temperature))
    return StreamsHeld(
        temperature=warmth,
        gnss=None if gnss is None else _times(gnss.time_s),
        odometer=None if odometer is None else _times(odometer.time_s),
    )


def _imu(imu: ImuSource) -> ImuHeld:
    stretch = vars(_stretch(imu.rows, imu.start_s, imu.end_s))
    return ImuHeld(**stretch, source=imu.source, rate_hz=imu.rate_hz, jitter=jitter(imu))


def _times(time_s: NDArray) -> Held:
    return _stretch(time_s.size, float(time_s[0]), float(time_s[-1]))


def _stretch(rows: int, start_s: float, end_s: float) -> Held:
    return Held(rows=rows, start_s=start_s, end_s=end_s, duration_s=end_s - start_s)


def _ranges(temperature: TemperatureLog) -> dict[str, tuple[float, float]]:
    """Least and greatest value of each thermometer that reads anything."""
    columns: dict[str, NDArray] = {}
    for key, values in vars(temperature).items():
        stem = key.removesuffix("_degC")
        if isinstance(values, np.ndarray) and values.ndim == 2:
            columns |= {f"{stem}_{axis}": values[:, k] for k, axis in enumerate("xyz")}
        elif isinstance(values, np.ndarray) and key != "time_s":
            columns[stem] = values
    return {
        k: (float(np.nanmin(v)), float(np.nanmax(v)))
        for k, v in columns.items()
        if np.isfinite(v).any()
    }


def _at_rest(seen: Inspection) -> RestHeld | None:
    """Means over the quiet start, beside what gravity and Earth rate should give at the site."""
    quiet = seen.quiet
    if quiet is None or seen.header is None:
        return None
    w = quiet.w_rad_s / DEG_PER_HOUR
    return RestHeld(
        start_s=quiet.start_s,
        end_s=quiet.end_s,
        mean_f_m_s2=quiet.f_m_s2,
        mean_w_deg_h=w,
        size_f_m_s2=float(np.linalg.norm(quiet.f_m_s2)),
        size_w_deg_h=float(np.linalg.norm(w)),
        w_down_deg_h=float(-w @ quiet.f_m_s2 / (np.linalg.norm(quiet.f_m_s2) or np.inf)),
        expected=expected_rest(seen.header.site),
        speed_m_s=quiet.speed_m_s,
    )


def report_lines(result: CheckReport) -> list[str]:
    """The result for people: what the run holds, then one line for each problem."""
    lines = _held_lines(result.holds)
    lines += [f"{p.level}: {p.text}" for p in result.problems]
    lines += [f"repaired: {s.start_s:.3f} to {s.end_s:.3f} s: {s.reason}" for s in result.repaired]
    return [*lines, f"{result.run}: {result.verdict.replace('_', ' ')}"]


def error_lines(result: CheckReport) -> list[str]:
    """What keeps the run from being used, a line each."""
    return [f"{p.level}: {p.text}" for p in result.problems if p.level != "warning"]


def _held_lines(holds: RunHolds) -> list[str]:
    lines = []
    beside = holds.beside or StreamsHeld()
    if imu := holds.imu:
        lines.append(
            f"{_held_line('imu', imu)}, {imu.rate_hz:.4g} Hz {imu.source}, jitter {imu.jitter:.1%}"
        )
    if beside.temperature:
        lines.append(_held_line("temperature", beside.temperature))
        ranges = beside.temperature.range_degC.items()
        lines += [f"  {key}: {low:.2f} to {high:.2f} degC" for key, (low, high) in ranges]
    others = (("gnss", beside.gnss), ("odometer", beside.odometer), ("reference", holds.reference))
    lines += [_held_line(name, held) for name, held in others if held]
    if holds.phases:
        said = [f"{p.phase} {p.start_s:g}-{p.end_s:g} s" for p in holds.phases]
        lines.append("phases: " + ", ".join(said))
    if rest := holds.at_rest:
        want = rest.expected
        lines.append(
            f"{_where(rest)} {rest.start_s:.0f} to {rest.end_s:.0f} s: |f| {rest.size_f_m_s2:.5f}"
            f" m/s2 (site {want.f_m_s2:.5f}), |w| {rest.size_w_deg_h:.3f} deg/h (Earth"
            f" {want.w_deg_h:.3f}), about the vertical {rest.w_down_deg_h:+.3f}"
            f" ({want.w_down_deg_h:+.3f})"
        )
    return lines


def _where(rest: RestHeld) -> str:
    """At rest, or how fast."""
    return "at rest" if rest.speed_m_s is None else f"in steady motion at {rest.speed_m_s:.1f} m/s,"


def _held_line(name: str, held: Held) -> str:
    return f"{name}: {held.rows} rows, {held.start_s:.3f} to {held.end_s:.3f} s"
