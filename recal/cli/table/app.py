"""`recal table`: the stored tables and their history.

Output is plain text, the same on a terminal and in a pipe. Libraries are imported where used, so
that `recal --help` stays fast.
"""

from __future__ import annotations

from typing import Annotated

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
    say,
)
from recal.cli.table import verify as table_verify
from recal.cli.table.files import export, import_
from recal.cli.table.options import (
    ModeOption,
    NoteOption,
    RevisionOption,
    SerialOption,
    TechnologyOption,
)

app = typer.Typer(
    rich_markup_mode=None, no_args_is_help=True, help="The stored thermal tables and their history."
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
    """Units and their revisions, newest last.

    Example: recal table list --store sqlite:///recal.db
    """
    from recal.service.tables import about, key_of, line_of, need, open_tables

    with open_tables(store) as opened:
        units = [u for u in opened.units() if serial in (None, u.unit.imu_serial)]
        histories = [opened.history(*key_of(u.active)) for u in units]
    need(units or serial is None, f"no table for serial {serial}")
    result = {
        "store": opened.name,
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
    if answer(result, as_json=as_json, verbose=verbose) or quiet:
        return
    for u, history in zip(units, histories):
        print(f"{u.unit}{'' if u.has_twin else ', no twin record'}")
        for r in history:
            tags = [
                name
                for name, n in (("factory", u.factory_number), ("active", u.active.number))
                if n == r.number
            ]
            print("  " + line_of(r) + (f"  [{', '.join(tags)}]" if tags else ""))
            if r.note:
                print(f"       {r.note}")


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
    """One table with U(k=2); --json prints it as formats.md writes a table.

    Example: recal table show --serial SN-0042
    """
    from recal.service.tables import find_revision, line_of, open_tables

    with open_tables(store) as opened:
        found = find_revision(opened, revision, serial, technology, mode)
    if answer(found.table_dict, as_json=as_json, verbose=verbose) or quiet:
        return
    table = found.table
    print(
        f"{found.unit}\n{line_of(found)}\nsha256 {found.sha256}\ncreated {table.created_utc},"
        f" {table.interpolation}"
    )
    print("\naxis  temperature       bias    U(k=2)\n             degC      deg/h     deg/h")
    for axis, nodes in zip("xyz", table.temperature_degC):
        for T, bias, sigma in zip(
            nodes, table.bias_deg_h(axis, nodes), table.sigma_deg_h(axis, nodes)
        ):
            print(f"{axis:4}  {T:11.2f} {bias:+10.5f}  {2 * sigma:8.5f}")


@app.command(cls=Command)
def diff(
    store: StoreUrl = DEFAULT_STORE,
    serial: SerialOption = None,
    technology: TechnologyOption = None,
    mode: ModeOption = None,
    from_: Annotated[
        str, typer.Option("--from", help="A number, factory, previous or active.")
    ] = "previous",
    to: Annotated[
        str, typer.Option("--to", help="A number, factory, previous or active.")
    ] = "active",
    as_json: JsonFlag = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
    seed: NoSeed = None,
) -> None:
    """What changed between two revisions, by default from the previous to the active one.

    Example: recal table diff --serial SN-0042 --from factory
    """
    from recal.service.tables import about, change_between, find_revision, line_of, open_tables

    with open_tables(store) as opened:
        before = find_revision(opened, from_, serial, technology, mode)
        after = find_revision(opened, to, serial, technology, mode)
    axes = {axis: change_between(before, after, axis) for axis in "xyz"}
    result = {"from": about(before), "to": about(after), "axes": axes}
    if answer(result, as_json=as_json, verbose=verbose) or quiet:
        return
    print(f"{after.unit}\nfrom {line_of(before)}\nto   {line_of(after)}\n")
    print("axis  temperature     before      after     change  U(k=2) before    after")
    print("             degC      deg/h      deg/h      deg/h          deg/h    deg/h")
    for axis, columns in axes.items():
        for T, old, new, change, s_old, s_new in zip(*vars(columns).values()):
            biases = f"{old:+10.5f} {new:+10.5f} {change:+10.5f}"
            print(f"{axis:4}  {T:11.2f} {biases}       {2 * s_old:8.5f} {2 * s_new:8.5f}")


@app.command(cls=Command)
def rollback(
    store: StoreUrl = DEFAULT_STORE,
    serial: SerialOption = None,
    technology: TechnologyOption = None,
    mode: ModeOption = None,
    to: Annotated[str, typer.Option("--to", help="A number, factory or previous.")] = "previous",
    note: NoteOption = "",
    any_clock: AnyClock = False,
    as_json: JsonFlag = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
    seed: NoSeed = None,
) -> None:
    """An older table becomes active again, bit for bit, as a new revision.

    Example: recal table rollback --serial SN-0042 --to factory
    """
    from ins.records import InputError
    from recal.service.store import StoreConflict
    from recal.service.tables import about, line_of, open_tables, revision_number

    try:
        with open_tables(store, any_clock=any_clock) as opened:
            found = opened.rollback(
                serial,
                to if to in ("factory", "previous") else revision_number(to),
                technology,
                mode,
                note=note,
            )
    except StoreConflict as error:
        raise InputError(str(error)) from None
    answer(about(found), as_json=as_json, verbose=verbose)
    say(
        f"{found.unit}: {line_of(found)}, the table of revision {found.restored_number}",
        quiet=quiet,
    )


app.command("verify", cls=Command)(table_verify.command)
app.command(cls=Command)(export)
app.command("import", cls=Command)(import_)
