"""`recal diagnose`: where simulator and logs disagree, which effect causes it, how far the gap
shrinks with it.
"""

from pathlib import Path

from recal.cli.console import Shown
from recal.cli.parameters.shared import SEED_OPTION
from recal.cli.parameters.verbs import made_from


@made_from("recal.service.diagnose", "diagnose", SEED_OPTION, twin="FILE", hold_out="RUN")
def command(
    shown: Shown, runs, /, twin: Path, hold_out, simulator, alpha, output, force, *, seed=0
) -> None:
    """Say where simulator and logs disagree, which effect causes it, and how far the gap shrinks
    with that effect.

    Example: recal diagnose run-1 run-2 run-3 --twin twin.json -o diagnosis

    Parameters
    ----------
    twin
        Twin file: what the simulator believes of the unit. Its table lies beside it.
    """
    from recal.service.diagnose import DIAGNOSE_STEPS, diagnose
    from recal.service.results.overwrite import need_free_report, need_other_file

    folder = output or Path("recal-diagnose")
    others = ("diagnosis.html", "twin.json", "table.json")
    need_free_report(folder, "diagnosis.json", "recal.diagnosis/1", others, force=force)
    if folder.exists() and not force:
        need_other_file(folder / "twin.json", twin)
    steps = DIAGNOSE_STEPS
    if simulator:
        steps += len(hold_out) or len(runs)
    with shown.progress("diagnosing", steps) as told:
        found = diagnose(
            runs, twin, hold_out=hold_out, alpha=alpha, seed=seed, simulator=simulator, told=told
        )
        written = found.write(output)
    shown.end(found, written / "diagnosis.html")
