"""`recal plan`: which recordings would separate rival effects, and how large an effect must be to
be seen.
"""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from recal.cli.console import JsonFlag, OutputPath, Quiet, Seed, Verbose, answer


class Without(StrEnum):
    """What a recording cannot have."""

    gnss = "gnss"
    odometer = "odometer"
    taxi = "taxi"
    gradient = "gradient"


class Technology(StrEnum):
    rlg = "rlg"
    fog = "fog"
    mems = "mems"


def command(
    runs: Annotated[
        list[Path] | None, typer.Argument(help="Run directories at hand; none: plan from nothing.")
    ] = None,
    twin: Annotated[
        Path | None, typer.Option("--twin", help="Twin file: noise model of the unit.")
    ] = None,
    technology: Annotated[
        Technology, typer.Option(help="Defaults of this technology, without --twin or runs.")
    ] = Technology.rlg,
    separate: Annotated[
        list[str] | None,
        typer.Option("--separate", help="Two effects A,B (repeatable); A@gyro_y sets the channel."),
    ] = None,
    without: Annotated[
        list[Without] | None, typer.Option("--without", help="What there is not (repeatable).")
    ] = None,
    lat_deg: Annotated[
        float | None,
        typer.Option(min=-85, max=85, help="Latitude; default that of the runs, or 45."),
    ] = None,
    most: Annotated[int, typer.Option(min=1, max=12, help="At most so many new recordings.")] = 6,
    output: OutputPath = None,
    as_json: JsonFlag = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
    seed: Seed = None,
) -> None:
    """Which recordings would separate rival effects, and from which size each effect is seen and
    told from its rival.

    Example: recal plan --twin twin.json --separate gyro_thermal_linear,gyro_warmup_transient
    """
    from recal.cli.progress import Progress
    from recal.service.plan import PlanRequest, plan

    request = PlanRequest(
        twin=twin,
        technology=technology,
        separate=separate or [],
        without=[w.value for w in without or []],
        lat_deg=lat_deg,
        most=most,
        seed=seed or 0,
    )
    with Progress("planning", quiet=quiet) as told:
        planned = plan(runs or [], request, told=told)
    written = planned.write(output)
    answer(
        planned.document,
        planned.lines(),
        as_json=as_json,
        quiet=quiet,
        verbose=verbose,
        report=written / "plan.html",
    )
