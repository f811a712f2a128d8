"""`recal demo`: the main job on an embedded default."""

from pathlib import Path
from typing import Annotated

import typer

from recal.cli.console import Force, JsonFlag, OutputPath, Quiet, Seed, Verbose, answer, finish

DEFAULT_SEED = 42
DEMO_STEPS = 4  # three sessions, one update


def command(
    output: OutputPath = None,
    force: Force = False,
    seed: Seed = DEFAULT_SEED,
    as_json: JsonFlag = False,
    quiet: Quiet = False,
    rate_hz: Annotated[
        float, typer.Option("--rate-hz", help="IMU rate of the simulated runs [Hz].")
    ] = 50.0,
    verbose: Verbose = False,
) -> None:
    """Simulate three sessions of one aged unit, recalibrate its table from them, and report.

    Example: recal demo -o recal-demo
    """
    from recal.cli.terminal.progress import Progress
    from recal.service.demo import demo

    chosen = DEFAULT_SEED if seed is None else seed
    with Progress("simulating", quiet=quiet, steps=DEMO_STEPS) as told:
        shown = demo(output, seed=chosen, rate_hz=rate_hz, force=force, told=told)
    answer(
        shown.document,
        shown.lines(),
        as_json=as_json,
        quiet=quiet,
        verbose=verbose,
        report=Path(shown.record.report),
    )
    finish(shown.verdict)
