"""`recal align`: attitude and heading with sigma from the parked part of a run."""

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


def command(
    run: Annotated[Path, typer.Argument(help="A run directory.")],
    store: StoreUrl = DEFAULT_STORE,
    twin: TwinPath = None,
    output: OutputPath = None,
    force: Force = False,
    as_json: JsonFlag = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
    seed: NoSeed = None,
) -> None:
    """Find roll, pitch and heading of a parked unit with their sigmas, and the phases of the run.

    Example: recal align run-1 --json
    """
    from recal.cli.terminal.progress import Progress
    from recal.service.align import ALIGN_STEPS, align
    from recal.service.results.files import output_directory, write_text
    from recal.service.results.overwrite import need_free_report

    folder = output or Path("recal-align")
    need_free_report(folder, "alignment.json", "recal.alignment/1", force=force)
    with Progress("aligning", quiet=quiet, steps=ALIGN_STEPS) as told:
        aligned = align(run, twin=twin, store=store, told=told)
    written = write_text(output_directory(output, "align") / "alignment.json", aligned.to_json())
    answer(
        aligned.document,
        aligned.lines(),
        as_json=as_json,
        quiet=quiet,
        verbose=verbose,
        report=written,
    )
    finish(aligned.verdict)
