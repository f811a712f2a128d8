"""`recal thermal apply`: a fitted thermal model taken out of a run's gyro output."""

from pathlib import Path
from typing import Annotated

import typer

from recal.cli.console import Shown
from recal.cli.parameters.verbs import made_from


@made_from("recal.service.thermal", "take_out", part="all|rates")
def command(
    shown: Shown,
    model,
    run,
    /,
    output: Annotated[Path, typer.Option("-o", "--output", help="The compensated run to write.")],
    part,
    batch,
    force,
) -> None:
    """Take a fitted model out of a run's gyro output, each row from temperatures up to its own
    time.

    Example: recal thermal apply rlg/thermal_rlg.json run-1 -o run-1-compensated
    """
    from recal.service.results.overwrite import is_compensated, need_free_run
    from recal.service.thermal import TAKE_OUT_STEPS, take_out

    need_free_run(output, is_compensated, "a compensated run", force=force)
    with shown.progress("compensating", TAKE_OUT_STEPS, compiles=False) as told:
        left = take_out(model, run, output, part=part, batch=batch, told=told)
    shown.answer(left.document, left.lines())
