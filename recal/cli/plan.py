"""`recal plan`: which recordings would separate rival effects, and how large an effect must be to
be seen.
"""

from collections.abc import Sequence
from pathlib import Path

from recal.cli.console import Shown
from recal.cli.parameters.shared import SEED_OPTION
from recal.cli.parameters.verbs import made_from


@made_from("recal.service.plan", "PlanRequest", SEED_OPTION, twin="FILE", separate="A,B")
def command(
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
    from recal.service.plan import PlanRequest, plan, plan_steps
    from recal.service.results.overwrite import need_free_report

    folder = output or Path("recal-plan")
    need_free_report(folder, "plan.json", "recal.plan/1", ("plan.html",), force=force)
    request = PlanRequest(twin=twin, seed=seed, **asked)
    with shown.progress("planning", plan_steps(request)) as told:
        planned = plan(runs, request, told=told)
    shown.answer(planned.document, planned.lines(), planned.write(output) / "plan.html")
