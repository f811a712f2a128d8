"""`recal check`: what a run holds, what is wrong with it and where."""

from pathlib import Path
from typing import Annotated

import typer

from recal.cli.console import JsonFlag, NoSeed, Quiet, Verbose, answer, finish, say


def command(
    run: Annotated[Path, typer.Argument(help="A run directory.")],
    serial: Annotated[
        str | None,
        typer.Option("--serial", help="Serial number that the run should have. Default: any."),
    ] = None,
    as_json: JsonFlag = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
    seed: NoSeed = None,
) -> None:
    """Read a run, and say what it holds, what is wrong and where. Exit code 0, or 3 where something
    is wrong.

    Example: recal check flights/2026-03-01 --json
    """
    from recal.cli.terminal.progress import Progress
    from recal.service.check import CHECK_STEPS, check, error_lines

    with Progress("reading the run", quiet=quiet, steps=CHECK_STEPS, compiles=False) as told:
        found = check(run, serial=serial, told=told)
    answer(found.document, found.lines(), as_json=as_json, quiet=quiet, verbose=verbose)
    if quiet and not as_json:
        for line in error_lines(found.record):
            say(line)
    finish(found.verdict)
