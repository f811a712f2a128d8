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
    live: float = 1.0,
    to: str | None = None,
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
    live : float in [0.1, 10000]
        With --to: so many times as fast as it was recorded.
    to
        Then send the run as MAVLink, to udp:HOST:PORT or to who connects to tcp:HOST:PORT: a
        recorded flight to try recal watch on. Default: it is only written.
    """
    from recal.service import convert
    from recal.service.results.overwrite import need_free_run

    if split and to is not None:
        raise typer.BadParameter("--split makes several runs, --to sends one: needed one of both")
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
    if to is not None:
        from recal.service.watch.feed import feed

        feed(output, to, speed=live, told=shown.say)
    shown.answer(converted.document, converted.lines())
