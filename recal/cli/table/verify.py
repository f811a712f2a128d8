"""`recal table verify`: is everything in the store as it was written?"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from recal.cli.console import (
    DEFAULT_STORE,
    JsonFlag,
    NoSeed,
    Quiet,
    StoreUrl,
    Verbose,
    answer,
    finish,
)

if TYPE_CHECKING:
    from infield.store.verify import StoreCheck

HEAD_DIGITS = 16  # printed; enough to find it again


def command(
    store: StoreUrl = DEFAULT_STORE,
    head: Annotated[
        list[str] | None,
        typer.Option(
            "--head", help="A head printed earlier: it must still be in a chain. Repeatable."
        ),
    ] = None,
    report: Annotated[
        list[Path] | None,
        typer.Option(
            "--report", help="An update.json: it must be as the store holds it. Repeatable."
        ),
    ] = None,
    as_json: JsonFlag = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
    seed: NoSeed = None,
) -> None:
    """Check every hash, chain, tag, merged run, twin and proposal; one line a unit, exit code 3
    where one is broken.

    Reads only. Example: recal table verify --store sqlite:///recal.db --report
    recal-update/update.json
    """
    from infield.store.table_store import TableStore
    from infield.store.verify import StoreVerdict
    from ins.json_file import read_json_object

    reports = {str(path): read_json_object(path) for path in report or ()}
    with TableStore.open(store) as opened:
        result = document(opened.verify(head or (), reports), opened.name)
    if not answer(result, as_json=as_json, verbose=verbose):
        for line in lines(result):
            if not quiet or result["verdict"] == StoreVerdict.BROKEN:
                print(line)
    finish(result)


def document(check: StoreCheck, store: str) -> dict[str, Any]:
    """The result; `faults` by unit, and those of no unit."""
    units = [
        {
            **vars(u.unit),
            "revisions": u.revisions,
            "head_sha256": u.head_sha256,
            "faults": list(u.faults),
        }
        for u in check.units
    ]
    reasons = [f"{u.unit}: {fault}" for u in check.units for fault in u.faults]
    return {
        "schema": "recal.verify/1",
        "store": store,
        "verdict": check.verdict.value,
        "reasons": [*check.faults, *reasons],
        "faults": list(check.faults),
        "units": units,
        "revisions": {str(u.unit): u.revisions for u in check.units},
    }


def lines(result: dict[str, Any]) -> list[str]:
    """A line for each unit, and for each fault that belongs to none."""
    said = [f"{result['store']}: BROKEN: {fault}" for fault in result["faults"]]
    for name, unit in zip(result["revisions"], result["units"]):
        count = f"{unit['revisions']} revision{'s' if unit['revisions'] != 1 else ''}"
        if unit["faults"]:
            said.append(f"{name}: BROKEN: {'; '.join(unit['faults'])}")
        elif unit["head_sha256"] is None:
            said.append(f"{name}: proposals only, intact")
        else:
            said.append(f"{name}: {count}, intact, head {unit['head_sha256'][:HEAD_DIGITS]}")
    return said or ["no units"]
