"""`recal diagnose`: where simulator and logs disagree, which effect causes it, how far the gap
shrinks with it.
"""

from pathlib import Path
from typing import Annotated

import typer

from recal.cli.console import Force, JsonFlag, OutputPath, Quiet, Seed, Verbose, answer, finish
from recal.cli.terminal.help import INPUT


def command(
    runs: Annotated[list[Path], typer.Argument(help="Run directories of one unit.")],
    twin: Annotated[
        Path,
        typer.Option(
            "--twin",
            metavar="FILE",
            help="Twin file: what the simulator believes of the unit. Its table lies beside it.",
        ),
    ],
    hold_out: Annotated[
        list[str] | None,
        typer.Option(
            "--hold-out",
            metavar="RUN",
            rich_help_panel=INPUT,
            help="A run, by name or folder, that only judges how far the gap shrinks. May be"
            " repeated. Default: none.",
        ),
    ] = None,
    simulator: Annotated[
        bool,
        typer.Option(
            "--simulator",
            help="Also predict the update of each run by a twin fitted to the others: drift,"
            " heading and NIS with what was found and without. Takes a diagnosis more for each"
            " run; with --hold-out, only those runs are predicted.",
        ),
    ] = False,
    alpha: Annotated[
        float,
        typer.Option(min=1e-4, max=0.5, help="Share of diagnoses that may raise a false alarm."),
    ] = 0.01,
    output: OutputPath = None,
    force: Force = False,
    as_json: JsonFlag = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
    seed: Seed = 0,
) -> None:
    """Say where simulator and logs disagree, which effect causes it, and how far the gap shrinks
    with that effect.

    Example: recal diagnose run-1 run-2 run-3 --twin twin.json -o diagnosis
    """
    from recal.cli.terminal.progress import Progress
    from recal.service.diagnose import DIAGNOSE_STEPS, diagnose
    from recal.service.results.overwrite import need_free_report, need_other_file

    folder = output or Path("recal-diagnose")
    others = ("diagnosis.html", "twin.json", "table.json")
    need_free_report(folder, "diagnosis.json", "recal.diagnosis/1", others, force=force)
    if folder.exists() and not force:
        need_other_file(folder / "twin.json", twin)
    apart = hold_out or []
    steps = DIAGNOSE_STEPS
    if simulator:
        steps += len(apart) or len(runs)
    with Progress("diagnosing", quiet=quiet, steps=steps) as told:
        found = diagnose(
            runs, twin, hold_out=apart, alpha=alpha, seed=seed or 0, simulator=simulator, told=told
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
