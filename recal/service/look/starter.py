"""A table that nobody described: a column map to begin with, and what is left to fill in."""

import shlex
from pathlib import Path

from ins.records import InputError
from recal.service.results.files import write_text
from recal.service.results.overwrite import need_free_file
from trajectories.readers.columns.starter_map import starter_map
from trajectories.readers.registry import UnknownLog

__all__ = ["UnknownLog", "write_starter"]


def write_starter(log: Path, output: Path, unknown: UnknownLog, *, force: bool = False) -> None:
    """Write the map of a table.

    Parameters
    ----------
    log : Path
        The table.
    output : Path
        The map; never written over without `force`, for somebody may have completed it.
    unknown : UnknownLog
        What the readers said of the log.

    Raises
    ------
    InputError
        Always: it says what was guessed and why, what is left to fill in, and the next command;
        where no map could be begun, nothing and the caller goes on.
    """
    found = starter_map(log)
    if found is None:
        return
    need_free_file(output, None, force=force)
    write_text(output, found.text)
    run = shlex.quote(f"{log.name.split('.')[0]}-run")
    command = f"recal convert {shlex.quote(str(log))} --map {shlex.quote(str(output))} -o {run}"
    raise InputError(
        f"{log}: a table of unknown columns; {output} is a column map to begin with",
        [
            *(f"  {key:12s} {words}" for key, words in found.guesses),
            f'  to be filled in where it says "?": {", ".join(found.missing)}',
            f"  next: {command}",
        ],
    ) from unknown
