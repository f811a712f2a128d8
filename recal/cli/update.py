"""`recal update`: recalibrate a unit's thermal table from its runs."""

from pathlib import Path
from typing import Annotated

import typer

from recal.cli.console import (
    DEFAULT_STORE,
    AnyClock,
    Force,
    JsonFlag,
    NewStore,
    NewUnit,
    NoSeed,
    OutputPath,
    PriorsChoice,
    Quiet,
    StoreUrl,
    ThermalModelPath,
    TwinPath,
    Verbose,
    answer,
    finish,
    login_name,
    say,
)
from recal.cli.terminal.help import ADVANCED


def command(
    runs: Annotated[list[Path], typer.Argument(help="Run directories of one unit.")],
    store: StoreUrl = DEFAULT_STORE,
    commit: Annotated[
        bool, typer.Option("--commit", help="Store the new table. Default: only report it.")
    ] = False,
    propose: Annotated[
        bool,
        typer.Option(
            "--propose", help="Keep the new table in the store for review; the active table stays."
        ),
    ] = False,
    by: Annotated[
        str | None,
        typer.Option(
            "--by",
            help="Who proposes. Default: the operator of your config.toml, else your login name.",
        ),
    ] = None,
    note: Annotated[str, typer.Option("--note", help="A note kept with the proposal.")] = "",
    new_unit: NewUnit = False,
    new_store: NewStore = False,
    accept_step: Annotated[
        bool,
        typer.Option(
            "--accept-step", help="Follow a step of the unit's bias that several sessions agree on."
        ),
    ] = False,
    retry: Annotated[
        int,
        typer.Option(
            "--retry",
            min=0,
            max=99,
            metavar="[N]",
            rich_help_panel=ADVANCED,
            help="With --commit: where another writer was faster, estimate again from the table"
            " that is active then, at most N times. Default: 0; 3 where N is left out.",
        ),
    ] = 0,
    any_clock: AnyClock = False,
    twin: TwinPath = None,
    config: Annotated[
        Path | None,
        typer.Option(
            "--config",
            help="Settings (TOML) with the sections session, flight and ageing. Default: none.",
        ),
    ] = None,
    priors: PriorsChoice = "approved",
    thermal_model: ThermalModelPath = None,
    output: OutputPath = None,
    force: Force = False,
    as_json: JsonFlag = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
    seed: NoSeed = None,
) -> None:
    """Measure the gyro biases in runs of a unit, merge them into its stored table, and report.

    Example: recal update run-1 run-2 --store sqlite:///recal.db --commit

    With --propose the new table waits for a second person, who decides in recal serve or by recal
    table approve.
    """
    if commit and propose:
        raise typer.BadParameter(
            "--commit stores the table at once, --propose keeps it for review: give one of them"
        )
    if retry and not commit:
        raise typer.BadParameter("nothing is stored without --commit", param_hint="--retry")
    signed = (login_name() if by is None else by, note) if propose else None
    from recal.cli.terminal.progress import Progress
    from recal.service.results.files import output_directory
    from recal.service.results.overwrite import need_free_report
    from recal.service.update import UPDATE_STEPS, UpdateRequest, update_in_store

    folder = output or Path("recal-update")
    need_free_report(folder, "update.json", "recal.update/1", ("update.html",), force=force)
    with Progress("reading", quiet=quiet, steps=UPDATE_STEPS) as step:
        result = update_in_store(
            UpdateRequest(
                runs=runs,
                store_url=store,
                store_named=store != DEFAULT_STORE,
                commit=commit,
                propose=signed,
                new_unit=new_unit,
                new_store=new_store,
                accept_step=accept_step,
                twin=twin,
                config=config,
                priors=priors,
                thermal_model=thermal_model,
                output=output,
                retries=retry,
                any_clock=any_clock,
                told=lambda line: say(line, quiet=quiet),
                step=step,
            )
        )
    answer(
        result.document,
        result.lines(verbose=verbose),
        as_json=as_json,
        quiet=quiet,
        verbose=verbose,
        report=output_directory(output, "update") / "update.html",
    )
    finish(result.verdict)
