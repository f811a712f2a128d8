"""`recal convert`: a flight log to a run."""

from pathlib import Path
from typing import Annotated

import typer

from recal.cli.console import Force, JsonFlag, NoSeed, Quiet, Verbose, answer
from recal.cli.terminal.help import INPUT


def command(
    log: Annotated[Path, typer.Argument(help="A flight log.")],
    output: Annotated[Path, typer.Option("-o", "--output", help="The run directory to write.")],
    map_file: Annotated[
        Path | None,
        typer.Option(
            "--map",
            metavar="FILE",
            rich_help_panel=INPUT,
            help="Column map (TOML) of a table: its columns, units, axes and rate.",
        ),
    ] = None,
    serial: Annotated[
        str | None, typer.Option("--serial", help="Serial number of the unit.")
    ] = None,
    technology: Annotated[
        str | None,
        typer.Option(
            "--technology", metavar="rlg|fog|mems", help="Technology of the unit's gyros."
        ),
    ] = None,
    lat_deg: Annotated[
        float | None,
        typer.Option("--lat-deg", help="Latitude where the run starts [deg]. Default: the log's."),
    ] = None,
    lon_deg: Annotated[float | None, typer.Option("--lon-deg", help="Its longitude [deg].")] = None,
    height_m: Annotated[
        float | None, typer.Option("--height-m", help="Its height above the ellipsoid [m].")
    ] = None,
    tail: Annotated[str | None, typer.Option("--tail", help="Tail number of the aircraft.")] = None,
    start_utc: Annotated[
        str | None,
        typer.Option("--start-utc", help="When the run starts, such as 2026-03-01T05:00:00Z."),
    ] = None,
    run_id: Annotated[
        str | None, typer.Option("--run-id", help="Name of the run. Default: the name of the log.")
    ] = None,
    log_format: Annotated[
        str | None,
        typer.Option("--format", help="Format of the log. Default: known by its content."),
    ] = None,
    imu: Annotated[
        int | None,
        typer.Option(
            "--imu", min=1, rich_help_panel=INPUT, help="Which IMU of a log that has several."
        ),
    ] = None,
    gnss: Annotated[
        Path | None,
        typer.Option(
            "--gnss",
            metavar="FILE",
            rich_help_panel=INPUT,
            help="Satellite fixes that are in a file of their own.",
        ),
    ] = None,
    from_s: Annotated[
        float | None, typer.Option("--from-s", help="Where to begin, by the log's own clock [s].")
    ] = None,
    to_s: Annotated[
        float | None, typer.Option("--to-s", help="Where to end, by the log's own clock [s].")
    ] = None,
    each_stretch: Annotated[
        bool,
        typer.Option(
            "--split",
            help="Write a run for each stretch between gaps of over 1 s: run-1, run-2, ... in the"
            " folder -o.",
        ),
    ] = False,
    force: Force = False,
    as_json: JsonFlag = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
    seed: NoSeed = None,
) -> None:
    """Convert a flight log of a known format, or by a column map, to a run; list all that was
    dropped or repaired.

    Example: recal convert flight.bin -o runs/flight-imu3 --imu 3
    """
    from recal.cli.terminal.progress import Progress
    from recal.service.convert import convert, made_of, split
    from recal.service.results.overwrite import need_free_run

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
    folders = sorted(output.glob("run-*")) if each_stretch else [output]
    for folder in folders:
        need_free_run(folder, lambda run: made_of(run, log), f"made of {log.name}", force=force)
    make = split if each_stretch else convert
    with Progress("converting", quiet=quiet):
        converted = make(log, output, map_file=map_file, gnss=gnss, header=given, options=chosen)
    answer(converted.document, converted.lines(), as_json=as_json, quiet=quiet, verbose=verbose)
