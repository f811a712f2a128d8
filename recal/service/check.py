"""`check`: what a run holds, what is wrong with it and where."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ins.records import ImuSource, InputError, ReferenceLog, TemperatureLog
from ins.units import DEG_PER_HOUR
from recal.service.results.paths import AnyPath
from recal.service.results.result import Result
from recal.service.results.text import Document
from trajectories.runs import directory
from trajectories.runs.checks import Finding
from trajectories.runs.directory import Inspection, read_reference
from trajectories.runs.imu_stream import jitter
from trajectories.runs.physics_gates import expected_rest
from trajectories.runs.streams import RunStreams

SEVERITIES = ("error", "suspect", "warning")  # of a problem, the worst first


@dataclass(frozen=True, repr=False, eq=False)
class Check(Result):
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
        return report_lines(self.document)


def check(run: AnyPath, *, serial: str | None = None) -> Check:
    """Read a run and say what it holds, what is wrong with it and where.

    Parameters
    ----------
    run : str or path
        A run directory.
    serial : str, optional
        The imu_serial that it should have.

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
    seen = directory.inspect_run(path)
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
) -> Document:
    """What `--json` prints."""
    return {
        "schema": "recal.check/1",
        "run": str(path),
        "verdict": _verdict(problems),
        "run_id": seen.header.run_id if seen.header else None,
        "imu_serial": seen.header.imu_serial if seen.header else None,
        "sha256": seen.run.sha256 if seen.run else None,
        "holds": {**_holds(seen), "reference": None if reference is None else _times(reference)},
        "problems": [{"level": p.level, "text": p.text} for p in problems],
        "repaired": [
            {"start_s": s.start_s, "end_s": s.end_s, "reason": s.reason} for s in seen.faults
        ],
    }


def _verdict(problems: list[Finding]) -> str:
    if any(problem.level != "warning" for problem in problems):
        return "bad_input"
    return "warnings" if problems else "ok"


def _holds(seen: Inspection) -> Document:
    streams = seen.streams
    imu = None if streams is None else streams.imu
    phases = () if streams is None else streams.phases or ()
    return {
        "imu": None if imu is None else _imu(imu),
        **({} if streams is None else _beside(streams)),
        "phases": [{"phase": p.phase, "start_s": p.start_s, "end_s": p.end_s} for p in phases],
        "at_rest": _at_rest(seen),
    }


def _beside(streams: RunStreams) -> Document:
    """The streams beside the IMU's."""
    temperature = streams.temperature
    ranges = {} if temperature is None else {"range_degC": _ranges(temperature)}
    return {
        "temperature": None if temperature is None else {**_times(temperature), **ranges},
        "gnss": None if streams.gnss is None else _times(streams.gnss),
        "odometer": None if streams.odometer is None else _times(streams.odometer),
    }


def _imu(imu: ImuSource) -> Document:
    facts = {"source": imu.source, "rate_hz": imu.rate_hz, "jitter": jitter(imu)}
    return {**_stretch(imu.rows, imu.start_s, imu.end_s), **facts}


def _times(log: Any) -> Document:
    return _stretch(log.time_s.size, float(log.time_s[0]), float(log.time_s[-1]))


def _stretch(rows: int, start_s: float, end_s: float) -> Document:
    return {"rows": rows, "start_s": start_s, "end_s": end_s, "duration_s": end_s - start_s}


def _ranges(temperature: TemperatureLog) -> dict[str, list[float]]:
    """Least and greatest value of each thermometer that reads anything."""
    columns: dict[str, NDArray] = {}
    for key, values in vars(temperature).items():
        stem = key.removesuffix("_degC")
        if values is not None and values.ndim == 2:
            columns |= {f"{stem}_{axis}": values[:, k] for k, axis in enumerate("xyz")}
        elif values is not None and key != "time_s":
            columns[stem] = values
    return {
        k: [float(np.nanmin(v)), float(np.nanmax(v))]
        for k, v in columns.items()
        if np.isfinite(v).any()
    }


def _at_rest(seen: Inspection) -> Document | None:
    """Means over the quiet start, beside what gravity and Earth rate should give at the site."""
    quiet = seen.quiet
    if quiet is None or seen.header is None:
        return None
    w = quiet.w_rad_s / DEG_PER_HOUR
    return {
        "start_s": quiet.start_s,
        "end_s": quiet.end_s,
        "mean_f_m_s2": quiet.f_m_s2,
        "mean_w_deg_h": w,
        "size_f_m_s2": float(np.linalg.norm(quiet.f_m_s2)),
        "size_w_deg_h": float(np.linalg.norm(w)),
        "w_down_deg_h": float(-w @ quiet.f_m_s2 / (np.linalg.norm(quiet.f_m_s2) or np.inf)),
        "expected": expected_rest(seen.header.site),
    }


def report_lines(result: Document, *, quiet: bool = False) -> list[str]:
    """The result for people: what the run holds, then one line for each problem."""
    lines = [] if quiet else _held_lines(result["holds"])
    lines += [
        f"{p['level']}: {p['text']}"
        for p in result["problems"]
        if not quiet or p["level"] != "warning"
    ]
    if not quiet:
        lines += [
            f"repaired: {s['start_s']:.3f} to {s['end_s']:.3f} s: {s['reason']}"
            for s in result["repaired"]
        ]
        lines.append(f"{result['run']}: {result['verdict'].replace('_', ' ')}")
    return lines


def _held_lines(holds: Document) -> list[str]:
    lines = []
    for name in ("imu", "temperature", "gnss", "odometer", "reference"):
        if held := holds.get(name):
            more = (
                f", {held['rate_hz']:.4g} Hz {held['source']}, jitter {held['jitter']:.1%}"
                if name == "imu"
                else ""
            )
            lines.append(
                f"{name}: {held['rows']} rows, {held['start_s']:.3f} to {held['end_s']:.3f} s{more}"
            )
            ranges = held.get("range_degC", {}).items()
            lines += [f"  {key}: {low:.2f} to {high:.2f} degC" for key, (low, high) in ranges]
    if holds.get("phases"):
        lines.append(
            "phases: "
            + ", ".join(f"{p['phase']} {p['start_s']:g}-{p['end_s']:g} s" for p in holds["phases"])
        )
    if rest := holds.get("at_rest"):
        want = rest["expected"]
        lines.append(
            f"at rest {rest['start_s']:.0f} to {rest['end_s']:.0f} s: |f| {rest['size_f_m_s2']:.5f}"
            f" m/s2 (site {want['f_m_s2']:.5f}), |w| {rest['size_w_deg_h']:.3f} deg/h (Earth"
            f" {want['w_deg_h']:.3f}), about the vertical {rest['w_down_deg_h']:+.3f}"
            f" ({want['w_down_deg_h']:+.3f})"
        )
    return lines
