"""`recal check`: what a run holds, what is wrong with it and where."""

from recal.cli.console import Shown, say
from recal.cli.parameters.verbs import made_from


@made_from("recal.service.check", "check")
def command(shown: Shown, run, /, serial) -> None:
    """Read a run, and say what it holds, what is wrong and where. Exit code 0, or 3 where something
    is wrong.

    Example: recal check flights/2026-03-01 --json
    """
    from recal.service.check import CHECK_STEPS, check, error_lines

    with shown.progress("reading the run", CHECK_STEPS, compiles=False) as told:
        found = check(run, serial=serial, told=told)
    if shown.quiet and not shown.as_json:
        for line in error_lines(found.record):
            say(line)
    shown.end(found)
