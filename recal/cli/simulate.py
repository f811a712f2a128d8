"""`recal simulate`: a run from a scenario file and a twin."""

from pathlib import Path
from typing import Annotated

import typer

from recal.cli.console import JsonFlag, Quiet, Seed, Verbose, answer


def command(
    scenario: Annotated[
        str, typer.Argument(help="A scenario file (TOML), or the name of a packaged one.")
    ],
    output: Annotated[Path, typer.Option("-o", "--output", help="The run directory to write.")],
    twin: Annotated[
        Path | None, typer.Option("--twin", help="Twin file, instead of the scenario's.")
    ] = None,
    table: Annotated[
        Path | None, typer.Option("--table", help="Factory table of the unit (JSON).")
    ] = None,
    truth: Annotated[
        Path | None, typer.Option("--truth", help="CSV of the true biases, for scoring.")
    ] = None,
    table_out: Annotated[
        Path | None, typer.Option("--table-out", help="Where to put the unit's table.")
    ] = None,
    environment: Annotated[
        list[str] | None,
        typer.Option(
            "--environment",
            help="What the parked vehicle goes through: KIND or KIND:STRENGTH, repeatable.",
        ),
    ] = None,
    seed: Seed = None,
    as_json: JsonFlag = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Simulate one power-on session from a scenario and write it as a run with its reference.

    Example: recal simulate cold_parked_taxi -o run --seed 7 --environment boarding:1.5
    """
    from recal.service.simulate import simulate

    simulated = simulate(
        scenario, seed=seed, twin=twin, table=table, environments=environment or None
    )
    simulated = simulated.write(output, table=table_out, truth=truth)
    answer(simulated.document, simulated.lines(), as_json=as_json, quiet=quiet, verbose=verbose)
