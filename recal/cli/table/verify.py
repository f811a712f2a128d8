"""`recal table verify`: is everything in the store as it was written?"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from recal.cli.console import Shown, finish, say
from recal.cli.parameters.verbs import made_from

if TYPE_CHECKING:
    from recal.service.tables import VerifyReport

HEAD_DIGITS = 16  # printed; enough to find it again


@made_from(report="FILE")
def command(
    shown: Shown, /, store, *, head: Sequence[str] = (), report: Sequence[Path] = ()
) -> None:
    """Check every hash, chain, tag, merged run, twin and proposal; one line a unit, exit code 3
    where one is broken.

    Reads only. Example: recal table verify --store sqlite:///recal.db --report
    recal-update/update.json

    Parameters
    ----------
    head
        A head printed earlier. It must still be in a chain. May be repeated.
    report
        An update.json. It must be as the store holds it. May be repeated.
    """
    from recal.service.tables import StoreVerdict, verify

    result = verify(store, head, report)
    shown.answer(result, lines(result))
    if shown.quiet and not shown.as_json and result.verdict is StoreVerdict.BROKEN:
        for line in lines(result):
            say(line)
    finish(result.verdict)


def lines(result: VerifyReport) -> list[str]:
    """A line for each unit, and for each fault that belongs to none."""
    said = [f"{result.store}: BROKEN: {fault}" for fault in result.faults]
    for name, unit in zip(result.revisions, result.units):
        count = f"{unit.revisions} revision{'s' if unit.revisions != 1 else ''}"
        if unit.faults:
            said.append(f"{name}: BROKEN: {'; '.join(unit.faults)}")
        elif unit.head_sha256 is None:
            said.append(f"{name}: proposals only, intact")
        else:
            said.append(f"{name}: {count}, intact, head {unit.head_sha256[:HEAD_DIGITS]}")
    return said or ["no units"]
