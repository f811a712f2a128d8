"""`recal table proposals|approve|reject`: updates kept for review, decided without the page of
`recal serve`.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from recal.cli.console import Command, Shown, finish, login_name
from recal.cli.table.options import of_table

if TYPE_CHECKING:
    from collections.abc import Sequence

    from recal.service.store import FullProposal, Proposal

app = typer.Typer(rich_markup_mode=None)


@app.command(cls=Command)
@of_table(number="[NUMBER]", state="STATE")
def proposals(
    shown: Shown,
    number: int | None = None,
    /,
    *,
    store,
    serial,
    technology,
    mode,
    state: str | None = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--output",
            metavar="FOLDER",
            help="Where to write the proposal's update.json and update.html. Default: nowhere.",
        ),
    ] = None,
    force,
) -> None:
    """List the updates kept for review and what was decided; with NUMBER and -o, write its
    update.json and update.html.

    Example: recal table proposals 3 --serial SN-0042 -o review

    Parameters
    ----------
    number : int in [1, ]
        One of them, in full.
    state : {'open', 'out of date', 'approved', 'rejected'}
        Only proposals of this state: open, out of date, approved, rejected. Default: all.
    """
    from recal.service.store import TableStore

    if output is not None and number is None:
        raise typer.BadParameter("needs the NUMBER of the proposal to write", param_hint="-o")
    with TableStore.open(store) as opened:
        if number is not None:
            full = opened.proposal(number, serial, technology, mode)
            if output is not None:
                shown.folder(output, "recal.update/1", "update.html", force=force)
            _show(shown, full, output)
            return
        found = opened.proposals(serial, technology, mode, state=state)
    result = {"store": opened.name, "proposals": found}
    shown.answer(result, _listed(found))


@app.command(cls=Command)
@of_table(number="NUMBER")
def approve(
    shown: Shown, number: int, /, reason: str, *, by, store, serial, technology, mode
) -> None:
    """Make a proposed table the active one; refused where the active table has moved since, or
    where who approves is who put it forward.

    Example: recal table approve 3 --serial SN-0042 --reason "residuals white, 21 to 34 degC
    covered"

    Parameters
    ----------
    number : int in [1, ]
        The proposal's number.
    reason
        Why. Kept with the decision.
    """
    _decide(shown, store, (number, "approved"), (serial, technology, mode), by, reason)


@app.command(cls=Command)
@of_table(number="NUMBER")
def reject(
    shown: Shown, number: int, /, reason: str, *, by, store, serial, technology, mode
) -> None:
    """Turn a proposed table down; the active one stays, the proposal and the reason are kept.

    Example: recal table reject 3 --serial SN-0042 --reason "the aircraft was towed at minute 12"

    Parameters
    ----------
    number : int in [1, ]
        The proposal's number.
    reason
        Why. Kept with the decision.
    """
    _decide(shown, store, (number, "rejected"), (serial, technology, mode), by, reason)


def _decide(
    shown: Shown,
    store: str,
    asked: tuple[int, str],
    unit: tuple[str | None, str | None, str | None],
    by: str | None,
    reason: str,
) -> None:
    """A decision, and the exit code of what the store makes of it."""
    from recal.service.store import Decided, store_name
    from recal.service.tables import decide, export_command

    number, verdict = asked
    signed = login_name() if by is None else by
    result, decided = decide(store, asked, unit, signed, reason)
    if decided is None:
        line = f"refused: {result.reasons[0]}"
    else:
        became = (
            f", revision {decided.decision.revision_number}"
            if decided.decision and verdict == Decided.APPROVED
            else ""
        )
        line = f"{decided.unit}: proposal {number} {verdict}{became}"
    lines = [line]
    if decided is not None and verdict == Decided.APPROVED:
        export = export_command(store_name(store), decided.unit.imu_serial)
        lines.append(f"  counts once the unit has loaded it: {export}")
    shown.answer(result, lines)
    finish(result.verdict)


def _show(shown: Shown, full: FullProposal, output: Path | None) -> None:
    """One proposal with the lines of its report; the report itself where -o says."""
    from ins.documents import plain
    from recal.service.results.update_summary import stored_summary
    from recal.service.tables import proposed_document, write_proposal

    document = proposed_document(full)
    if output is not None:
        write_proposal(full, output)
    shown.answer(
        {**plain(full), "report": document},
        [str(full.unit), *_lines(full), *stored_summary(document)],
        None if output is None else output / "update.html",
    )


def _listed(found: Sequence[Proposal]) -> list[str]:
    """Proposals for people, unit by unit."""
    lines: list[str] = []
    for k, p in enumerate(found):
        if k == 0 or p.unit != found[k - 1].unit:
            lines.append(str(p.unit))
        lines += ["  " + line for line in _lines(p)]
    return lines


def _lines(p: Proposal) -> list[str]:
    """A proposal for people."""
    who = f"  by {p.proposed_by}" if p.proposed_by else ""
    lines = [
        f"proposal {p.number}  {p.state:11}  {p.proposed_utc}  {p.sha256[:12]}  {len(p.runs)}"
        f" run(s){who}"
    ]
    lines += [f"     {p.note}"] if p.note else []
    if p.decision is not None:
        became = f", revision {p.decision.revision_number}" if p.decision.revision_number else ""
        lines.append(f"     {p.decision.words()}{became}")
    return lines
