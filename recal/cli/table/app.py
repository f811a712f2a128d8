"""`recal table`: the stored tables and their history.

Output is plain text, the same on a terminal and in a pipe. Libraries are imported where used, so
that `recal --help` stays fast.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from recal.cli.console import Command, Shown, finish, login_name, say
from recal.cli.parameters.verbs import made_from
from recal.cli.table.files import export, import_
from recal.cli.table.options import REVISIONS, of_table

if TYPE_CHECKING:
    from recal.service.store import Revision, UnitRecord
    from recal.service.tables import VerifyReport

app = typer.Typer(
    add_completion=False,
    rich_markup_mode=None,
    no_args_is_help=True,
    help="List, compare, import and export the stored thermal tables.",
)
HEAD_DIGITS = 16  # printed; enough to find it again


@app.command("list", cls=Command)
@of_table()
def list_(shown: Shown, /, store, serial) -> None:
    """List units and their revisions, newest last.

    Example: recal table list --store sqlite:///recal.db
    """
    from recal.service.tables import key_of, need, open_tables, policy_line

    with open_tables(store) as opened:
        units = [u for u in opened.units() if serial in (None, u.unit.imu_serial)]
        histories = [opened.history(*key_of(u.active)) for u in units]
        rule = opened.policy()
    need(units or serial is None, f"no table for serial {serial}")
    result = {
        "store": opened.name,
        "policy": rule,
        "units": [
            {
                **vars(u.unit),
                "active": u.active.number,
                "factory": u.factory_number,
                "has_twin": u.has_twin,
                "revisions": history,
            }
            for u, history in zip(units, histories)
        ],
    }
    lines = [policy_line(rule)] if rule.number else []
    lines += [line for u, history in zip(units, histories) for line in _unit_lines(u, history)]
    shown.answer(result, lines)


def _unit_lines(u: UnitRecord, history: Sequence[Revision]) -> list[str]:
    """A unit and its revisions for people."""
    from recal.service.tables import line_of

    lines = [f"{u.unit}{'' if u.has_twin else ', no twin record'}"]
    for r in history:
        tagged = (("factory", u.factory_number), ("active", u.active.number))
        tags = [name for name, number in tagged if number == r.number]
        lines.append("  " + line_of(r) + (f"  [{', '.join(tags)}]" if tags else ""))
        lines += [f"       {r.note}"] if r.note else []
    return lines


@app.command(cls=Command)
@of_table()
def show(shown: Shown, /, store, serial, technology, mode, revision) -> None:
    """Show one table with U(k=2); --json prints it as formats.md writes a table.

    Example: recal table show --serial SN-0042
    """
    from recal.service.tables import find_revision, line_of, open_tables

    with open_tables(store) as opened:
        found = find_revision(opened, revision, serial, technology, mode)
    table = found.table
    lines = [
        f"{found.unit}",
        line_of(found),
        f"sha256 {found.sha256}",
        f"created {table.created_utc}, {table.interpolation}",
        "",
        "axis  temperature       bias    U(k=2)",
        "             degC      deg/h     deg/h",
    ]
    for axis, nodes in zip("xyz", table.temperature_degC):
        rows = zip(nodes, table.bias_deg_h(axis, nodes), table.sigma_deg_h(axis, nodes))
        lines += [f"{axis:4}  {T:11.2f} {bias:+10.5f}  {2 * sigma:8.5f}" for T, bias, sigma in rows]
    shown.answer(found.table_dict, lines)


@app.command(cls=Command)
@of_table(a="[A]", b="[B]", from_=REVISIONS, to=REVISIONS)
def diff(
    shown: Shown,
    a: str | None = None,
    b: str | None = None,
    /,
    *,
    store,
    serial,
    technology,
    mode,
    from_: str = "previous",
    to: str = "active",
    output: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--output",
            metavar="FOLDER",
            help="Where to write diff.json and diff.html. Default: nowhere.",
        ),
    ] = None,
    force,
) -> None:
    """Show what changed between two tables, by default from the previous revision to the active
    one, and what that is worth in NM/h.

    Example: recal table diff factory active --serial SN-0042 -o table-diff

    Parameters
    ----------
    a
        The older table: a file (.json, .csv) or a revision (NUMBER, factory, previous, active).
        Default: --from.
    b
        The newer table, likewise. Default: --to.
    from_
        The older revision, where A is left out.
    to
        The newer revision, where B is left out.
    """
    from recal.service.results.overwrite import need_free_report
    from recal.service.results.result import write_report
    from recal.service.table_diff import table_diff

    if output is not None:
        need_free_report(output, "diff.json", "recal.diff/1", ("diff.html",), force=force)
    found = table_diff(a or from_, b or to, store, (serial, technology, mode))
    report = None if output is None else write_report(found, output, "diff") / "diff.html"
    shown.answer(found.record, found.lines(), report)


@app.command(cls=Command)
@of_table()
def policy(
    shown: Shown,
    /,
    one_person: bool = False,
    two_people: bool = False,
    *,
    by,
    reason: str = "",
    store,
) -> None:
    """Say who may approve updates in this store, or show it; what was said before is kept.

    Example: recal table policy --one-person --reason "a workshop of one"

    Parameters
    ----------
    one_person
        One person may put an update forward and approve it.
    two_people
        Somebody else than its proposer approves an update.
    reason
        Why. Kept with the rule.
    """
    from recal.service.tables import policy_line, set_policy

    if one_person and two_people:
        raise typer.BadParameter("give --one-person or --two-people, not both")
    asked = one_person if one_person or two_people else None
    found = set_policy(store, asked, by=login_name() if by is None else by, reason=reason)
    shown.answer(found, [policy_line(found)])


@app.command(cls=Command)
@of_table(to="NUMBER|factory|previous")
def rollback(
    shown: Shown,
    /,
    by: str,
    reason: str,
    store,
    serial,
    technology,
    mode,
    *,
    to: str = "previous",
    any_clock,
) -> None:
    """Make an older table active again, bit for bit, as a new revision.

    Example: recal table rollback --serial SN-0042 --to factory --by "K. Reviewer" --reason "the
    aircraft was towed"

    Parameters
    ----------
    by
        Who takes the table back.
    reason
        Why. Kept with the revision.
    to
        The revision that becomes active again.
    """
    from recal.service.tables import line_of, open_tables, revision_number

    with open_tables(store, any_clock=any_clock) as opened:
        wanted = to if to in ("factory", "previous") else revision_number(to)
        found = opened.rollback(serial, wanted, technology, mode, by=by, reason=reason)
    lines = [
        f"{found.unit}: {line_of(found)}, the table of revision {found.restored_number}",
        f"  {found.note}",
    ]
    shown.answer(found, lines)


@app.command(cls=Command)
@made_from(report="FILE")
def verify(
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
    from recal.service.tables import StoreVerdict
    from recal.service.tables import verify as verified

    result = verified(store, head, report)
    shown.answer(result, verify_lines(result))
    if shown.quiet and not shown.as_json and result.verdict is StoreVerdict.BROKEN:
        for line in verify_lines(result):
            say(line)
    finish(result.verdict)


def verify_lines(result: VerifyReport) -> list[str]:
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


app.command(cls=Command)(export)
app.command("import", cls=Command)(import_)
