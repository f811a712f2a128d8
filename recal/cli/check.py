"""`recal check`: what a run holds, what is wrong with it and where."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from recal.cli.console import JsonFlag, NoSeed, Quiet, Verbose, answer, finish, say

if TYPE_CHECKING:
    from ins.records import TemperatureLog
    from trajectories.runs.directory import Inspection


def command(
    run: Annotated[Path, typer.Argument(help="A run directory.")],
    serial: Annotated[
        str | None, typer.Option("--serial", help="The unit that it should be from.")
    ] = None,
    as_json: JsonFlag = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
    seed: NoSeed = None,
) -> None:
    """Read a run; say what it holds, what is wrong and where. Exit code 0, or 3 where something is
    wrong.

    Example: recal check flights/2026-03-01 --json
    """
    result = check(run, serial=serial)
    if not answer(result, as_json=as_json, verbose=verbose):
        for line in report_lines(result, quiet=quiet):
            say(line)
    finish(result)


def check(path: Path, *, serial: str | None = None) -> dict[str, Any]:
    """The result `recal.check/1`: verdict (ok, warnings, bad_input), what the run holds, problems,
    repaired spans.
    """
    from ins.records import InputError
    from trajectories.runs.directory import inspect_run, read_reference

    seen = inspect_run(path)
    problems = [{"level": f.level, "text": f.text} for f in seen.findings]
    reference = None
    if path.is_dir():
        try:
            reference = read_reference(path)
        except InputError as error:
            problems.append({"level": "error", "text": str(error).removeprefix(f"{path}: ")})
    if serial is not None and seen.header is not None and seen.header.imu_serial != serial:
        text = f"run.json: imu_serial {seen.header.imu_serial!r}, needed {serial!r}"
        problems.append({"level": "error", "text": text})
    order = ("error", "suspect", "warning")
    problems.sort(key=lambda p: order.index(p["level"]))
    failed = any(p["level"] != "warning" for p in problems)
    return {
        "schema": "recal.check/1",
        "run": str(path),
        "verdict": "bad_input" if failed else "warnings" if problems else "ok",
        "run_id": seen.header.run_id if seen.header else None,
        "imu_serial": seen.header.imu_serial if seen.header else None,
        "sha256": seen.run.sha256 if seen.run else None,
        "holds": {**_holds(seen), "reference": None if reference is None else _times(reference)},
        "problems": problems,
        "repaired": [
            {"start_s": s.start_s, "end_s": s.end_s, "reason": s.reason} for s in seen.faults
        ],
    }


def _holds(seen: "Inspection") -> dict[str, Any]:
    from trajectories.runs.imu_stream import jitter

    held = seen.streams
    imu = held.imu if held else None
    out: dict[str, Any] = {
        "imu": None if imu is None else _stretch(imu.rows, imu.start_s, imu.end_s)
    }
    if held is not None:
        logs = {"temperature": held.temperature, "gnss": held.gnss, "odometer": held.odometer}
        out |= {name: None if log is None else _times(log) for name, log in logs.items()}
    if imu is not None:
        out["imu"].update(source=imu.source, rate_hz=imu.rate_hz, jitter=jitter(imu))
    if held is not None and held.temperature is not None:
        out["temperature"]["range_degC"] = _ranges(held.temperature)
    phases = (held.phases or ()) if held else ()
    out["phases"] = [{"phase": p.phase, "start_s": p.start_s, "end_s": p.end_s} for p in phases]
    out["at_rest"] = _at_rest(seen)
    return out


def _times(log: Any) -> dict[str, Any]:
    return _stretch(log.time_s.size, float(log.time_s[0]), float(log.time_s[-1]))


def _stretch(rows: int, start_s: float, end_s: float) -> dict[str, Any]:
    return {"rows": rows, "start_s": start_s, "end_s": end_s, "duration_s": end_s - start_s}


def _ranges(temperature: "TemperatureLog") -> dict[str, list[float]]:
    """Least and greatest value of each thermometer that reads anything."""
    import numpy as np

    columns: dict[str, Any] = {}
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


def _at_rest(seen: "Inspection") -> dict[str, Any] | None:
    """Means over the quiet start, beside what gravity and Earth rate should give at the site."""
    import numpy as np

    from ins.units import DEG_PER_HOUR
    from trajectories.runs.physics_gates import expected_rest

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


def report_lines(result: dict[str, Any], *, quiet: bool = False) -> list[str]:
    """The same for people: what it holds, then one line for each problem."""
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


def _held_lines(holds: dict[str, Any]) -> list[str]:
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
