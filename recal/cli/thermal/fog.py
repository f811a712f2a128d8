"""`recal thermal fog`: temperature and rate coefficients of a fibre-optic unit from chamber
ramps.
"""

from __future__ import annotations

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
from recal.cli.terminal.help import INPUT, OUTPUT


def command(
    fast: Annotated[
        list[Path],
        typer.Option(
            "--fast",
            metavar="RUN...",
            rich_help_panel=INPUT,
            help="Runs with the fast ramp, up and down.",
        ),
    ],
    slow: Annotated[
        list[Path] | None,
        typer.Option(
            "--slow",
            metavar="RUN...",
            rich_help_panel=INPUT,
            help="Runs with the slow ramp. Default: none; up and down of the fast ramp are"
            " compared.",
        ),
    ] = None,
    check: Annotated[
        list[Path] | None,
        typer.Option(
            "--check",
            metavar="RUN...",
            rich_help_panel=INPUT,
            help="Runs that only test the model. Default: none.",
        ),
    ] = None,
    allowed_deg_h: Annotated[
        float | None,
        typer.Option(
            "--allowed-deg-h",
            help="Largest gradient term of a slow ramp [deg/h]. Default: the twin's bias"
            " instability.",
        ),
    ] = None,
    word_bits: Annotated[
        int,
        typer.Option(
            "--word-bits",
            min=8,
            max=32,
            rich_help_panel=OUTPUT,
            help="Bits of a word of the exported whole-number tables.",
        ),
    ] = 16,
    remounted: Annotated[
        bool,
        typer.Option(
            "--remounted", help="The unit was taken off and mounted again between the runs."
        ),
    ] = False,
    one_sided: Annotated[
        bool, typer.Option("--one-sided", help="Accept ramps of one direction, at two rates.")
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
    """Fit K_T and K_delta of a fibre-optic gyro, b = K_T(T) + K_delta(T) dT/dt, to temperature
    ramps of the resting unit.

    Example: recal thermal fog --fast chamber-fast --slow chamber-slow --check chamber-other -o fog
    """
    from recal.cli.terminal.progress import Progress
    from recal.service.results.overwrite import need_free_report
    from recal.service.thermal import THERMAL_STEPS, FogRequest, fit_fog

    folder = output or Path("recal-thermal")
    others = ("thermal_fog.html",)
    need_free_report(folder, "thermal_fog.json", "recal.thermal_fog/1", others, force=force)
    request = FogRequest(
        allowed_deg_h=allowed_deg_h, word_bits=word_bits, remounted=remounted, one_sided=one_sided
    )
    runs = [*fast, *(slow or []), *(check or [])]
    with Progress("fitting", quiet=quiet, steps=len(runs) + THERMAL_STEPS) as told:
        fitted = fit_fog(
            fast, slow or [], check or [], twin=twin, store=store, request=request, told=told
        )
        written = fitted.write(output)
    answer(
        fitted.document,
        fitted.lines(),
        as_json=as_json,
        quiet=quiet,
        verbose=verbose,
        report=written / "thermal_fog.html",
    )
    finish(fitted.verdict)
