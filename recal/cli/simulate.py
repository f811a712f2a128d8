"""`recal simulate`: a run from a scenario file and a twin."""

from pathlib import Path
from typing import Annotated

import typer

from recal.cli.console import SEED_HELP, Force, JsonFlag, Quiet, Verbose, answer
from recal.cli.terminal.help import INPUT, OUTPUT


def command(
    scenario: Annotated[
        str | None,
        typer.Argument(
            help="A scenario file (TOML), or the name of a packaged one. Needed, except with"
            " --list."
        ),
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--output",
            metavar="FOLDER",
            help="The run directory to write. Needed, except with --list.",
        ),
    ] = None,
    listed: Annotated[
        bool, typer.Option("--list", help="List the packaged scenarios and simulate nothing.")
    ] = False,
    twin: Annotated[
        Path | None,
        typer.Option("--twin", metavar="FILE", help="Twin file. Default: the scenario's."),
    ] = None,
    table: Annotated[
        Path | None,
        typer.Option(
            "--table",
            metavar="FILE",
            rich_help_panel=INPUT,
            help="Factory table of the unit (JSON). Default: the scenario's, else one is drawn.",
        ),
    ] = None,
    truth: Annotated[
        Path | None,
        typer.Option(
            "--truth",
            metavar="FILE",
            rich_help_panel=OUTPUT,
            help="Also write the true biases to this file (CSV). Default: not written.",
        ),
    ] = None,
    table_out: Annotated[
        Path | None,
        typer.Option(
            "--table-out",
            metavar="FILE",
            rich_help_panel=OUTPUT,
            help="Also write the unit's factory table to this file (JSON). Default: not written.",
        ),
    ] = None,
    environment: Annotated[
        list[str] | None,
        typer.Option(
            "--environment",
            metavar="KIND[:STRENGTH]",
            help="What the parked vehicle goes through, such as boarding:1.5. May be repeated."
            " Default: the scenario's.",
        ),
    ] = None,
    force: Force = False,
    seed: Annotated[
        int | None, typer.Option("--seed", min=0, help=f"{SEED_HELP} Default: the scenario's.")
    ] = None,
    as_json: JsonFlag = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Simulate one power-on session from a scenario and write it as a run with its reference.

    Example: recal simulate cold_parked_taxi -o run --seed 7 --environment boarding:1.5
    """
    from recal.cli.terminal.progress import Progress
    from recal.service.results.overwrite import TRUTH, is_simulated, need_free_file, need_free_run
    from recal.service.simulate import SIMULATE_STEPS, scenarios, simulate

    if listed:
        known = scenarios()
        width = max(map(len, known))
        answer(
            {"schema": "recal.scenarios/1", "verdict": "ok", "scenarios": known},
            [f"{name:{width}}  {words}" for name, words in known.items()],
            as_json=as_json,
            quiet=quiet,
            verbose=verbose,
        )
        return
    if scenario is None or output is None:
        raise typer.BadParameter(
            "needed: a scenario and -o FOLDER; recal simulate --list names the packaged scenarios"
        )
    need_free_run(output, is_simulated, "a simulated run", force=force)
    for file, schema in ((table_out, "recal.table/1"), (truth, TRUTH)):
        if file is not None:
            need_free_file(file, schema, force=force)
    with Progress("simulating", quiet=quiet, steps=SIMULATE_STEPS + 1, compiles=False) as told:
        simulated = simulate(
            scenario, seed=seed, twin=twin, table=table, environments=environment or None, told=told
        )
        told("writing the run")
        simulated = simulated.write(output, table=table_out, truth=truth)
    answer(simulated.document, simulated.lines(), as_json=as_json, quiet=quiet, verbose=verbose)
