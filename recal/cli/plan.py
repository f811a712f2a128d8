"""`recal plan`: which recordings would separate rival effects, and how large an effect must be to
be seen.
"""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from recal.cli.console import Force, JsonFlag, OutputPath, Quiet, Seed, Verbose, answer


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
        list[Path] | None, typer.Argument(help="Run directories at hand. Default: none.")
    ] = None,
    twin: Annotated[
        Path | None,
        typer.Option(
            "--twin",
            metavar="FILE",
            help="Twin file with the noise model of the unit. Default: that of its technology.",
        ),
    ] = None,
    technology: Annotated[
        Technology,
        typer.Option(help="Technology of the gyros, where there is neither twin nor run."),
    ] = Technology.rlg,
    separate: Annotated[
        list[str] | None,
        typer.Option(
            "--separate",
            metavar="A,B",
            help="Two effects to tell apart; A@gyro_y names the channel. May be repeated."
            " Default: the pairs that are usually confused.",
        ),
    ] = None,
    without: Annotated[
        list[Without] | None,
        typer.Option(
            "--without", help="What a recording here cannot have. May be repeated. Default: none."
        ),
    ] = None,
    lat_deg: Annotated[
        float | None,
        typer.Option(min=-85, max=85, help="Latitude [deg]. Default: that of the runs, else 45."),
    ] = None,
    most: Annotated[int, typer.Option(min=1, max=12, help="How many new recordings at most.")] = 6,
    flights: Annotated[
        bool,
        typer.Option(
            "--flights",
            help="Also which flight with a receiver would bring which gyro to which sigma.",
        ),
    ] = False,
    output: OutputPath = None,
    force: Force = False,
    as_json: JsonFlag = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
    seed: Seed = 0,
) -> None:
    """Say which recordings would separate rival effects, and from which size on each effect is seen
    and told from its rival.

    Example: recal plan --twin twin.json --separate gyro_thermal_linear,gyro_warmup_transient
    """
    from recal.cli.terminal.progress import Progress
    from recal.service.plan import PlanRequest, plan, plan_steps
    from recal.service.results.overwrite import need_free_report

    folder = output or Path("recal-plan")
    need_free_report(folder, "plan.json", "recal.plan/1", ("plan.html",), force=force)
    request = PlanRequest(
        twin=twin,
        technology=technology,
        separate=separate or [],
        without=[w.value for w in without or []],
        lat_deg=lat_deg,
        most=most,
        seed=seed or 0,
        flights=flights,
    )
    with Progress("planning", quiet=quiet, steps=plan_steps(request)) as told:
        planned = plan(runs or [], request, told=told, first_answer=told.say)
    written = planned.write(output)
    answer(
        planned.document,
        planned.lines(),
        as_json=as_json,
        quiet=quiet,
        verbose=verbose,
        report=written / "plan.html",
    )
