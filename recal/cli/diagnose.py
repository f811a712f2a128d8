"""`recal diagnose`: where simulator and logs disagree, which effect causes it, how far the gap
shrinks with it.
"""

from pathlib import Path
from typing import Annotated

import typer

from recal.cli.console import JsonFlag, OutputPath, Quiet, Seed, Verbose, answer, finish


def command(
    runs: Annotated[list[Path], typer.Argument(help="Run directories of one unit.")],
    twin: Annotated[
        Path,
        typer.Option(
            "--twin", help="Twin file: what the simulator believes; its table lies beside it."
        ),
    ],
    hold_out: Annotated[
        list[str] | None,
        typer.Option(
            "--hold-out", help="Run (id or directory) that only judges the shrink (repeatable)."
        ),
    ] = None,
    alpha: Annotated[
        float, typer.Option(min=1e-4, max=0.5, help="False alarms per diagnosis.")
    ] = 0.01,
    output: OutputPath = None,
    as_json: JsonFlag = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
    seed: Seed = None,
) -> None:
    """The gap between simulator and logs: where it lies, which effect causes it, how far it shrinks
    with the effect.

    Example: recal diagnose run-1 run-2 run-3 --twin twin.json -o diagnosis
    """
    from recal.cli.progress import Progress
    from recal.service.diagnose import diagnose

    with Progress("diagnosing", quiet=quiet) as told:
        found = diagnose(
            runs, twin, hold_out=hold_out or [], alpha=alpha, seed=seed or 0, told=told
        )
        written = found.write(output)
    answer(
        found.document,
        found.lines(),
        as_json=as_json,
        quiet=quiet,
        verbose=verbose,
        report=written / "diagnosis.html",
    )
    finish(found.verdict)
