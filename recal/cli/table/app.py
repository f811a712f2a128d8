"""`recal table`: the stored tables and their history.

Output is plain text, the same on a terminal and in a pipe. Libraries are imported where used, so
that `recal --help` stays fast.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from recal.cli.console import (
    DEFAULT_STORE,
    AnyClock,
    Command,
    JsonFlag,
    NoSeed,
    Quiet,
    StoreUrl,
    Verbose,
    answer,
    login_name,
)
from recal.cli.table import verify as table_verify
from recal.cli.table.files import export, import_
from recal.cli.table.options import (
    ByOption,
    ModeOption,
    RevisionOption,
    SerialOption,
    TechnologyOption,
)
from recal.cli.terminal.help import INPUT

if TYPE_CHECKING:
    from collections.abc import Sequence

    from recal.service.store import Revision, UnitRecord

app = typer.Typer(
    rich_markup_mode=None,
    no_args_is_help=True,
    help="List, compare, import and export the stored thermal tables.",
)


@app.command("list", cls=Command)
def list_(
    store: StoreUrl = DEFAULT_STORE,
    serial: SerialOption = None,
    as_json: JsonFlag = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
    seed: NoSeed = None,
) -> None:
    """List units and their revisions, newest last.

    Example: recal table list --store sqlite:///recal.db
    """
    from recal.service.tables import about, key_of, need, open_tables, policy_line

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
                "revisions": [about(r) for r in history],
            }
            for u, history in zip(units, histories)
        ],
    }
    lines = [policy_line(rule)] if rule.number else []
    lines += [line for u, history in zip(units, histories) for line in _unit_lines(u, history)]
    answer(result, lines, as_json=as_json, quiet=quiet, verbose=verbose)


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
def show(
    store: StoreUrl = DEFAULT_STORE,
    serial: SerialOption = None,
    technology: TechnologyOption = None,
    mode: ModeOption = None,
    revision: RevisionOption = "active",
    as_json: JsonFlag = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
    seed: NoSeed = None,
) -> None:
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
    answer(found.table_dict, lines, as_json=as_json, quiet=quiet, verbose=verbose)


@app.command(cls=Command)
def diff(
    store: StoreUrl = DEFAULT_STORE,
    serial: SerialOption = None,
    technology: TechnologyOption = None,
    mode: ModeOption = None,
    from_: Annotated[
        str,
        typer.Option(
            "--from",
            metavar="NUMBER|factory|previous|active",
            rich_help_panel=INPUT,
            help="The older revision.",
        ),
    ] = "previous",
    to: Annotated[
        str,
        typer.Option(
            "--to",
            metavar="NUMBER|factory|previous|active",
            rich_help_panel=INPUT,
            help="The newer revision.",
        ),
    ] = "active",
    as_json: JsonFlag = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
    seed: NoSeed = None,
) -> None:
    """Show what changed between two revisions, by default from the previous to the active one.

    Example: recal table diff --serial SN-0042 --from factory
    """
    from recal.service.tables import about, change_between, find_revision, line_of, open_tables

    with open_tables(store) as opened:
        before = find_revision(opened, from_, serial, technology, mode)
        after = find_revision(opened, to, serial, technology, mode)
    axes = {axis: change_between(before, after, axis) for axis in "xyz"}
    result = {"from": about(before), "to": about(after), "axes": axes}
    lines = [
        f"{after.unit}",
        f"from {line_of(before)}",
        f"to   {line_of(after)}",
        "",
        "axis  temperature     before      after     change  U(k=2) before    after",
        "             degC      deg/h      deg/h      deg/h          deg/h    deg/h",
    ]
    for axis, columns in axes.items():
        for T, old, new, change, s_old, s_new in zip(*vars(columns).values()):
            biases = f"{old:+10.5f} {new:+10.5f} {change:+10.5f}"
            lines.append(f"{axis:4}  {T:11.2f} {biases}       {2 * s_old:8.5f} {2 * s_new:8.5f}")
    answer(result, lines, as_json=as_json, quiet=quiet, verbose=verbose)


@app.command(cls=Command)
def policy(
    one_person: Annotated[
        bool,
        typer.Option("--one-person", help="One person may put an update forward and approve it."),
    ] = False,
    two_people: Annotated[
        bool,
        typer.Option("--two-people", help="Somebody else than its proposer approves an update."),
    ] = False,
    by: ByOption = None,
    reason: Annotated[str, typer.Option("--reason", help="Why. Kept with the rule.")] = "",
    store: StoreUrl = DEFAULT_STORE,
    as_json: JsonFlag = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
    seed: NoSeed = None,
) -> None:
    """Say who may approve updates in this store, or show it; what was said before is kept.

    Example: recal table policy --one-person --reason "a workshop of one"
    """
    from recal.service.tables import policy_line, set_policy

    if one_person and two_people:
        raise typer.BadParameter("give --one-person or --two-people, not both")
    asked = one_person if one_person or two_people else None
    found = set_policy(store, asked, by=login_name() if by is None else by, reason=reason)
    answer(found, [policy_line(found)], as_json=as_json, quiet=quiet, verbose=verbose)


@app.command(cls=Command)
def rollback(
    by: Annotated[str, typer.Option("--by", help="Who takes the table back.")],
    reason: Annotated[str, typer.Option("--reason", help="Why. Kept with the revision.")],
    store: StoreUrl = DEFAULT_STORE,
    serial: SerialOption = None,
    technology: TechnologyOption = None,
    mode: ModeOption = None,
    to: Annotated[
        str,
        typer.Option(
            "--to",
            metavar="NUMBER|factory|previous",
            rich_help_panel=INPUT,
            help="The revision that becomes active again.",
        ),
    ] = "previous",
    any_clock: AnyClock = False,
    as_json: JsonFlag = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
    seed: NoSeed = None,
) -> None:
    """Make an older table active again, bit for bit, as a new revision.

    Example: recal table rollback --serial SN-0042 --to factory --by "K. Reviewer" --reason "the
    aircraft was towed"
    """
    from recal.service.tables import about, line_of, open_tables, revision_number

    with open_tables(store, any_clock=any_clock) as opened:
        wanted = to if to in ("factory", "previous") else revision_number(to)
        found = opened.rollback(serial, wanted, technology, mode, by=by, reason=reason)
    lines = [
        f"{found.unit}: {line_of(found)}, the table of revision {found.restored_number}",
        f"  {found.note}",
    ]
    answer(about(found), lines, as_json=as_json, quiet=quiet, verbose=verbose)


app.command("verify", cls=Command)(table_verify.command)
app.command(cls=Command)(export)
app.command("import", cls=Command)(import_)
