"""`recal look`: any log, recognised, checked, drawn, and what it can be used for."""

from pathlib import Path
from typing import Annotated

import typer

from recal.cli.console import Force, JsonFlag, NoSeed, OutputPath, Quiet, Verbose, answer, finish
from recal.cli.logs.options import LogGiven, with_log_options


@with_log_options
def command(
    log: Annotated[
        Path, typer.Argument(help="A flight log of any known format, or a run directory.")
    ],
    output: OutputPath = None,
    *,
    given: LogGiven,
    force: Force = False,
    as_json: JsonFlag = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
    seed: NoSeed = None,
) -> None:
    """Say what a log of any known format holds, how its sensors behave, and what it can be used
    for, each use with the next command. Exit code 0, 3 where something is wrong, 4 where it is fit
    for nothing.

    Example: recal look flight.bin -o flight-look
    """
    from recal.cli.terminal.progress import Progress
    from recal.service.look.look import LOOK_STEPS, look
    from recal.service.results.files import output_directory
    from recal.service.results.overwrite import need_free_report

    folder = output_directory(output, "look")
    need_free_report(folder, "look.json", "recal.look/1", ("look.html",), force=force)
    with Progress("reading", quiet=quiet, steps=LOOK_STEPS) as told:
        looked = look(
            log,
            map_file=given.map_file,
            gnss=given.gnss,
            header=given.header,
            options=given.options,
            told=told,
        )
        report = looked.write(folder) / "look.html"
    answer(
        looked.document,
        looked.lines(verbose=verbose),
        as_json=as_json,
        quiet=quiet,
        verbose=verbose,
        report=report,
    )
    finish(looked.verdict)
