"""`recal diagnose` and `recal plan`: where simulator and logs disagree and which effect causes it;
which recordings would separate rival effects.
"""

from collections.abc import Sequence
from pathlib import Path

from recal.cli.console import Shown
from recal.cli.parameters.shared import SEED_OPTION
from recal.cli.parameters.verbs import made_from


@made_from("recal.service.diagnose", "diagnose", SEED_OPTION, twin="FILE", hold_out="RUN")
def diagnose(
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
    from recal.service.diagnose import DIAGNOSE_STEPS
    from recal.service.diagnose import diagnose as diagnosed
    from recal.service.results.overwrite import need_other_file

    others = ("diagnosis.html", "twin.json", "table.json")
    folder = shown.folder(
        output, "recal.diagnosis/1", *others, default="recal-diagnose", force=force
    )
    if folder.exists() and not force:
        need_other_file(folder / "twin.json", twin)
    steps = DIAGNOSE_STEPS
    if simulator:
        steps += len(hold_out) or len(runs)
    with shown.progress("diagnosing", steps) as told:
        found = diagnosed(
            runs, twin, hold_out=hold_out, alpha=alpha, seed=seed, simulator=simulator, told=told
        )
        written = found.write(folder)
    shown.end(found, written / "diagnosis.html")


@made_from("recal.service.plan", "PlanRequest", SEED_OPTION, twin="FILE", separate="A,B")
def plan(
    shown: Shown,
    runs: Sequence[Path] = (),
    /,
    twin: Path | None = None,
    *,
    output,
    force,
    seed=0,
    **asked,
) -> None:
    """Say which recordings would separate rival effects, and from which size on each effect is seen
    and told from its rival.

    Example: recal plan --twin twin.json --separate gyro_thermal_linear,gyro_warmup_transient

    Parameters
    ----------
    runs
        Run directories at hand. Default: none.
    twin
        Twin file with the noise model of the unit. Default: that of its technology.
    """
    from recal.service.plan import PlanRequest, plan_steps
    from recal.service.plan import plan as planned_recordings

    folder = shown.folder(output, "recal.plan/1", "plan.html", force=force)
    request = PlanRequest(twin=twin, seed=seed, **asked)
    with shown.progress("planning", plan_steps(request)) as told:
        planned = planned_recordings(runs, request, told=told)
    shown.answer(planned.document, planned.lines(), planned.write(folder) / "plan.html")
