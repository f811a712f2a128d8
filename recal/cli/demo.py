"""`recal demo`: the main job on an embedded default."""

from pathlib import Path

from recal.cli.console import Shown, finish
from recal.cli.parameters.shared import SEED_OPTION
from recal.cli.parameters.verbs import made_from

DEFAULT_SEED = 42
DEMO_STEPS = 4  # three sessions, one update


@made_from("recal.service.demo", "demo", SEED_OPTION)
def command(shown: Shown, /, output, force, *, rate_hz: float = 50.0, seed=DEFAULT_SEED) -> None:
    """Simulate three sessions of one aged unit, recalibrate its table from them, and report.

    Example: recal demo -o recal-demo
    """
    from recal.service.demo import demo

    with shown.progress("simulating", DEMO_STEPS) as told:
        found = demo(output, seed=seed, rate_hz=rate_hz, force=force, told=told)
    shown.answer(found.document, found.lines(), Path(found.record.report))
    finish(found.verdict)
