"""`recal thermal apply`: a fitted thermal model taken out of a run's gyro output."""

from pathlib import Path
from typing import Annotated

import typer

from recal.cli.console import Force, JsonFlag, NoSeed, Quiet, Verbose, answer


def command(
    model: Annotated[
        Path, typer.Argument(help="A thermal_rlg.json or thermal_fog.json that was fitted.")
    ],
    run: Annotated[Path, typer.Argument(help="A run directory with raw gyro output.")],
    output: Annotated[Path, typer.Option("-o", "--output", help="The compensated run to write.")],
    part: Annotated[
        str,
        typer.Option(
            "--part",
            metavar="all|rates",
            help="What to take out: all, or only rates, which leaves what a settled unit has to a"
            " thermal table.",
        ),
    ] = "all",
    batch: Annotated[
        bool,
        typer.Option(
            "--batch", help="Use smoothed temperatures. Default: only those up to each row's time."
        ),
    ] = False,
    force: Force = False,
    as_json: JsonFlag = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
    seed: NoSeed = None,
) -> None:
    """Take a fitted model out of a run's gyro output, each row from temperatures up to its own
    time.

    Example: recal thermal apply rlg/thermal_rlg.json run-1 -o run-1-compensated
    """
    from recal.cli.terminal.progress import Progress
    from recal.service.results.overwrite import is_compensated, need_free_run
    from recal.service.thermal import TAKE_OUT_STEPS, take_out

    need_free_run(output, is_compensated, "a compensated run", force=force)
    with Progress("compensating", quiet=quiet, steps=TAKE_OUT_STEPS, compiles=False) as told:
        left = take_out(model, run, output, part=part, batch=batch, told=told)
    answer(left.document, left.lines(), as_json=as_json, quiet=quiet, verbose=verbose)
