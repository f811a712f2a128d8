"""`recal convert`: a flight log to a run."""

from pathlib import Path
from typing import Annotated

import typer

from recal.cli.console import Shown
from recal.cli.logs.options import of_log, reads_log


@reads_log()
def command(
    shown: Shown,
    log: Path,
    /,
    output: Annotated[Path, typer.Option("-o", "--output", help="The run directory to write.")],
    split: bool = False,
    *,
    force,
    **given,
) -> None:
    """Convert a flight log of a known format, or by a column map, to a run; list all that was
    dropped or repaired.

    Example: recal convert flight.bin -o runs/flight-imu3 --imu 3

    Parameters
    ----------
    log
        A flight log.
    split
        Write a run for each stretch between gaps of over 1 s: run-1, run-2, ... in the folder -o.
    """
    from recal.service import convert
    from recal.service.results.overwrite import need_free_run

    folders = sorted(output.glob("run-*")) if split else [output]
    for folder in folders:
        need_free_run(
            folder, lambda run: convert.made_of(run, log), f"made of {log.name}", force=force
        )
    make = convert.split if split else convert.convert
    steps = None if split else convert.CONVERT_STEPS
    said = of_log(**given)
    with shown.progress("converting", steps, compiles=False) as told:
        converted = make(log, output, **said, told=told)
    shown.answer(converted.document, converted.lines())
