"""`recal align`: attitude and heading with sigma from the parked part of a run."""

from pathlib import Path

from recal.cli.console import Shown
from recal.cli.parameters.verbs import made_from


@made_from("recal.service.align", "align")
def command(shown: Shown, run, /, store, twin, output, force) -> None:
    """Find roll, pitch and heading of a parked unit with their sigmas, and the phases of the run.

    Example: recal align run-1 --json

    Parameters
    ----------
    run : path
        A run directory.
    """
    from recal.service.align import ALIGN_STEPS, align
    from recal.service.results.files import output_directory, write_text
    from recal.service.results.overwrite import need_free_report

    folder = output or Path("recal-align")
    need_free_report(folder, "alignment.json", "recal.alignment/1", force=force)
    with shown.progress("aligning", ALIGN_STEPS) as told:
        aligned = align(run, twin=twin, store=store, told=told)
    written = write_text(output_directory(output, "align") / "alignment.json", aligned.to_json())
    shown.end(aligned, written)
