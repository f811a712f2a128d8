"""`recal demo` and `recal simulate`: sessions of a simulated unit."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from recal.cli.console import Shown, finish
from recal.cli.parameters.shared import SEED_OPTION
from recal.cli.parameters.verbs import made_from

DEFAULT_SEED = 42
DEMO_STEPS = 4  # three sessions, one update


@made_from("recal.service.demo", "demo", SEED_OPTION)
def demo(shown: Shown, /, output, force, *, rate_hz: float = 50.0, seed=DEFAULT_SEED) -> None:
    """Simulate three sessions of one aged unit, recalibrate its table from them, and report.

    Example: recal demo -o recal-demo
    """
    from recal.service.demo import demo as demonstrated

    with shown.progress("simulating", DEMO_STEPS) as told:
        found = demonstrated(output, seed=seed, rate_hz=rate_hz, force=force, told=told)
    shown.answer(found.document, found.lines(), Path(found.record.report))
    finish(found.verdict)


@made_from(
    "recal.service.simulate",
    "simulate",
    twin="FILE",
    table="FILE",
    truth="FILE",
    table_out="FILE",
    environment="KIND[:STRENGTH]",
)
def simulate(
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
    from recal.service.simulate import SIMULATE_STEPS, scenarios
    from recal.service.simulate import simulate as simulated_session

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
        simulated = simulated_session(
            scenario, seed=seed, twin=twin, table=table, environments=environment or None, told=told
        )
        told("writing the run")
        simulated = simulated.write(output, table=table_out, truth=truth)
    if to is not None:
        from recal.service.watch.feed import feed

        feed(simulated.run, to, speed=live, told=shown.say)
    shown.answer(simulated.document, simulated.lines())
