"""`recal look`: any log, recognised, checked, drawn, and what it can be used for."""

from pathlib import Path

from recal.cli.console import Shown
from recal.cli.logs.options import of_log, reads_log


@reads_log()
def command(shown: Shown, log: Path, /, output, *, force, **given) -> None:
    """Say what a log of any known format holds, how its sensors behave, and what it can be used
    for, each use with the next command. Of a table that it does not know it writes a column map to
    begin with. Exit code 0, 3 where something is wrong, 4 where it is fit for nothing.

    Example: recal look flight.bin -o flight-look

    Parameters
    ----------
    log
        A flight log of any known format, or a run directory.
    """
    from recal.service.look.look import LOOK_STEPS, UnknownLog, look, write_starter
    from recal.service.results.files import output_directory
    from recal.service.results.overwrite import need_free_report

    folder = output_directory(output, "look")
    need_free_report(folder, "look.json", "recal.look/1", ("look.html",), force=force)
    said = of_log(**given)
    with shown.progress("reading", LOOK_STEPS) as told:
        try:
            looked = look(log, **said, told=told)
        except UnknownLog as unknown:
            write_starter(log, folder / f"{log.name.split('.')[0]}.toml", unknown, force=force)
            raise
        report = looked.write(folder) / "look.html"
    shown.end(looked, report)
