"""`recal thermal rlg`: rate and gradient terms of a ring-laser unit from chamber or parked runs."""

from pathlib import Path
from typing import Annotated

import typer

from recal.cli.console import (
    DEFAULT_STORE,
    Force,
    JsonFlag,
    NoSeed,
    OutputPath,
    Quiet,
    StoreUrl,
    TwinPath,
    Verbose,
    answer,
    finish,
)
from recal.cli.terminal.help import INPUT


def command(
    runs: Annotated[
        list[Path], typer.Argument(help="Run directories of one unit at rest, warmed and cooled.")
    ],
    check: Annotated[
        list[Path] | None,
        typer.Option(
            "--check",
            metavar="RUN...",
            rich_help_panel=INPUT,
            help="Runs that only test the model. Default: none.",
        ),
    ] = None,
    remounted: Annotated[
        bool,
        typer.Option(
            "--remounted", help="The unit was taken off and mounted again between the runs."
        ),
    ] = False,
    store: StoreUrl = DEFAULT_STORE,
    twin: TwinPath = None,
    output: OutputPath = None,
    force: Force = False,
    as_json: JsonFlag = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
    seed: NoSeed = None,
) -> None:
    """Fit K1..K6 of a ring-laser gyro, b = K1 + K2 T + K3 T^2 + K4 dT/dt + K5 T dT/dt + K6 Tdiff,
    to runs at rest.

    Example: recal thermal rlg chamber-1 chamber-2 --check chamber-3 -o rlg
    """
    from recal.cli.terminal.progress import Progress
    from recal.service.results.overwrite import need_free_report
    from recal.service.thermal import THERMAL_STEPS, fit_rlg

    folder = output or Path("recal-thermal")
    others = ("thermal_rlg.html",)
    need_free_report(folder, "thermal_rlg.json", "recal.thermal_rlg/1", others, force=force)
    steps = len(runs) + len(check or []) + THERMAL_STEPS
    with Progress("fitting", quiet=quiet, steps=steps) as told:
        fitted = fit_rlg(runs, check or [], twin=twin, store=store, remounted=remounted, told=told)
        written = fitted.write(output)
    answer(
        fitted.document,
        fitted.lines(),
        as_json=as_json,
        quiet=quiet,
        verbose=verbose,
        report=written / "thermal_rlg.html",
    )
    finish(fitted.verdict)
