"""`recal convert`: a flight log to a run."""

from pathlib import Path
from typing import Annotated

import typer

from recal.cli.console import Force, JsonFlag, NoSeed, Quiet, Verbose, answer
from recal.cli.logs.options import LogGiven, with_log_options


@with_log_options
def command(
    log: Annotated[Path, typer.Argument(help="A flight log.")],
    output: Annotated[Path, typer.Option("-o", "--output", help="The run directory to write.")],
    *,
    given: LogGiven,
    tail: Annotated[
        str | None, typer.Option("--tail", help="Tail number of the aircraft. Default: none.")
    ] = None,
    start_utc: Annotated[
        str | None,
        typer.Option(
            "--start-utc",
            help="When the run starts, such as 2026-03-01T05:00:00Z. Default: the log's.",
        ),
    ] = None,
    run_id: Annotated[
        str | None, typer.Option("--run-id", help="Name of the run. Default: the name of the log.")
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
    from recal.service.convert import CONVERT_STEPS, convert, made_of, split
    from recal.service.results.overwrite import need_free_run

    header = {**given.header, "tail": tail, "start_utc": start_utc, "run_id": run_id}
    folders = sorted(output.glob("run-*")) if each_stretch else [output]
    for folder in folders:
        need_free_run(folder, lambda run: made_of(run, log), f"made of {log.name}", force=force)
    make = split if each_stretch else convert
    steps = None if each_stretch else CONVERT_STEPS
    with Progress("converting", quiet=quiet, steps=steps, compiles=False) as told:
        converted = make(
            log,
            output,
            map_file=given.map_file,
            gnss=given.gnss,
            header=header,
            options=given.options,
            told=told,
        )
    answer(converted.document, converted.lines(), as_json=as_json, quiet=quiet, verbose=verbose)
