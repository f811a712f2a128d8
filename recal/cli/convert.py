"""`recal convert`: a flight log to a run."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from recal.cli.console import JsonFlag, NoSeed, Quiet, Verbose, answer, say

if TYPE_CHECKING:
    from trajectories.readers.conversion import Conversion


def command(
    log: Annotated[Path, typer.Argument(help="A flight log.")],
    output: Annotated[Path, typer.Option("-o", "--output", help="The run directory to write.")],
    map_file: Annotated[
        Path | None, typer.Option("--map", help="TOML map: columns, units, axes, rate.")
    ] = None,
    serial: Annotated[str | None, typer.Option("--serial", help="imu_serial of the unit.")] = None,
    technology: Annotated[
        str | None, typer.Option("--technology", help="rlg, fog or mems.")
    ] = None,
    lat_deg: Annotated[
        float | None, typer.Option("--lat-deg", help="Where the run starts.")
    ] = None,
    lon_deg: Annotated[float | None, typer.Option("--lon-deg")] = None,
    height_m: Annotated[
        float | None, typer.Option("--height-m", help="Above the ellipsoid.")
    ] = None,
    tail: Annotated[str | None, typer.Option("--tail", help="Tail number.")] = None,
    start_utc: Annotated[
        str | None, typer.Option("--start-utc", help="Such as 2026-03-01T05:00:00Z.")
    ] = None,
    run_id: Annotated[
        str | None, typer.Option("--run-id", help="Default: the name of the log.")
    ] = None,
    log_format: Annotated[
        str | None, typer.Option("--format", help="Default: by the content of the log.")
    ] = None,
    imu: Annotated[
        int | None, typer.Option("--imu", min=1, help="Which IMU of a log that has several.")
    ] = None,
    gnss: Annotated[
        Path | None, typer.Option("--gnss", help="Fixes that are in a file of their own.")
    ] = None,
    from_s: Annotated[
        float | None, typer.Option("--from-s", help="Where to begin, by the log's own clock [s].")
    ] = None,
    to_s: Annotated[
        float | None, typer.Option("--to-s", help="Where to end, by the log's own clock [s].")
    ] = None,
    as_json: JsonFlag = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
    seed: NoSeed = None,
) -> None:
    """Convert a flight log of a known format, or by a column map, to a run; list all that was
    dropped or repaired.

    Example: recal convert flight.bin -o runs/flight-imu3 --imu 3
    """
    from ins.json_file import read_toml
    from trajectories.readers.conversion import convert_log
    from trajectories.runs.directory import write_run

    given = {
        "imu_serial": serial,
        "gyro_technology": technology,
        "lat_deg": lat_deg,
        "lon_deg": lon_deg,
        "height_m": height_m,
        "tail": tail,
        "start_utc": start_utc,
        "run_id": run_id,
    }
    chosen = {"imu": imu, "format": log_format, "from_s": from_s, "to_s": to_s}
    options = (read_toml(map_file) if map_file else {}) | {
        k: v for k, v in chosen.items() if v is not None
    }
    if gnss is not None:
        options = with_gnss_file(options, gnss)
    conversion = convert_log(log, options, given)
    write_run(output, conversion.run, reference=conversion.reference, conversion=conversion.record)
    result = summary(conversion, output)
    if answer(result, as_json=as_json, verbose=verbose):
        return
    for line in report_lines(result):
        say(line, quiet=quiet)


def with_gnss_file(options: dict[str, Any], gnss: Path) -> dict[str, Any]:
    """The map with the file of its [gnss] named; a key that is no table is left to the reader to
    refuse.
    """
    keys = options.get("gnss", {})
    return {
        **options,
        "gnss": {**keys, "file": str(gnss.absolute())} if isinstance(keys, dict) else keys,
    }


def summary(conversion: "Conversion", output: Path) -> dict[str, Any]:
    """The result `recal.convert/1`."""
    run, record = conversion.run, conversion.record
    return {
        "schema": "recal.convert/1",
        "run": str(output),
        "run_id": run.header.run_id,
        "sha256": run.sha256,
        "format": record.format,
        "rows": run.imu.rows,
        "rate_hz": run.imu.rate_hz,
        "duration_s": run.imu.end_s,
        "time_shift_s": record.time_shift_s,
        "notes": list(record.notes),
        "repaired": [
            {"start_s": s.start_s, "end_s": s.end_s, "reason": s.reason} for s in run.faults
        ],
        "streams": (
            [k for k in ("temperature", "gnss", "odometer") if getattr(run, k) is not None]
            + (["reference"] if conversion.reference is not None else [])
        ),
        "problems": [{"level": f.level, "text": f.text} for f in conversion.findings],
    }


def report_lines(result: dict[str, Any]) -> list[str]:
    """The same for people."""
    lines = [f"note: {note}" for note in result["notes"]]
    lines += [
        f"repaired: {s['start_s']:.3f} to {s['end_s']:.3f} s: {s['reason']}"
        for s in result["repaired"]
    ]
    lines += [f"{p['level']}: {p['text']}" for p in result["problems"]]
    beside = f" (with {', '.join(result['streams'])})" if result["streams"] else ""
    lines.append(
        f"{result['run']}: {result['rows']} rows, {result['rate_hz']:.4g} Hz,"
        f" {result['duration_s']:.3f} s{beside}; log time {result['time_shift_s']:.6f} s is run"
        " time 0"
    )
    return lines
