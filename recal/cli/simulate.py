"""`recal simulate`: a run from a scenario file and a twin."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from recal.cli.console import Shown
from recal.cli.parameters.verbs import made_from


@made_from(
    "recal.service.simulate",
    "simulate",
    twin="FILE",
    table="FILE",
    truth="FILE",
    table_out="FILE",
    environment="KIND[:STRENGTH]",
)
def command(
    shown: Shown,
    scenario: str | None = None,
    /,
    output: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--output",
            metavar="FOLDER",
            help="The run directory to write. Needed, except with --list and --to.",
        ),
    ] = None,
    listed: Annotated[
        bool, typer.Option("--list", help="List the packaged scenarios and simulate nothing.")
    ] = False,
    twin: Path | None = None,
    table: Path | None = None,
    truth: Path | None = None,
    table_out: Path | None = None,
    environment: Sequence[str] = (),
    live: float = 1.0,
    to: str | None = None,
    *,
    force,
    seed: int | None = None,
) -> None:
    """Simulate one power-on session from a scenario and write it as a run with its reference.

    Example: recal simulate cold_parked_taxi -o run --seed 7 --environment boarding:1.5

    Parameters
    ----------
    scenario
        A scenario file (TOML), or the name of a packaged one. Needed, except with --list.
    twin
        Twin file. Default: the scenario's.
    table
        Factory table of the unit (JSON). Default: the scenario's, else one is drawn.
    truth
        Also write the true biases to this file (CSV). Default: not written.
    table_out
        Also write the unit's factory table to this file (JSON). Default: not written.
    environment
        What the parked vehicle goes through, such as boarding:1.5. May be repeated. Default: the
        scenario's.
    live : float in [0.1, 10000]
        With --to: so many times as fast as it was.
    to
        Send the session as MAVLink, to udp:HOST:PORT or to who connects to tcp:HOST:PORT: a source
        to try recal watch on. Default: it is only written.
    seed : int in [0, ]
        Seed of the random generator. Default: the scenario's.
    """
    from recal.service.results.overwrite import TRUTH, is_simulated, need_free_file, need_free_run
    from recal.service.simulate import SIMULATE_STEPS, scenarios, simulate

    if listed:
        known = scenarios()
        width = max(map(len, known))
        shown.answer(
            {"schema": "recal.scenarios/1", "verdict": "ok", "scenarios": known},
            [f"{name:{width}}  {words}" for name, words in known.items()],
        )
        return
    if scenario is None or (output is None and to is None):
        raise typer.BadParameter(
            "needed: a scenario and -o FOLDER; recal simulate --list names the packaged scenarios"
        )
    if output is not None:
        need_free_run(output, is_simulated, "a simulated run", force=force)
    for file, schema in ((table_out, "recal.table/1"), (truth, TRUTH)):
        if file is not None:
            need_free_file(file, schema, force=force)
    with shown.progress("simulating", SIMULATE_STEPS + 1, compiles=False) as told:
        simulated = simulate(
            scenario, seed=seed, twin=twin, table=table, environments=environment or None, told=told
        )
        told("writing the run")
        simulated = simulated.write(output, table=table_out, truth=truth)
    if to is not None:
        from recal.service.watch.feed import feed

        feed(simulated.run, to, speed=live, told=shown.say)
    shown.answer(simulated.document, simulated.lines())
