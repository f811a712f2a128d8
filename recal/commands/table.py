"""`recal table`: the stored tables and their history.

Output is plain text, the same on a terminal and in a pipe. Libraries are imported where used, so that `recal --help`
stays fast.
"""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from recal.console import DEFAULT_STORE, Command, JsonFlag, NoSeed, OutputPath, Quiet, StoreUrl, Verbose, answer, say

if TYPE_CHECKING:
    from infield.store import Revision, TableStore

app = typer.Typer(no_args_is_help=True, help="The stored thermal tables and their history.")

SerialOption = Annotated[str | None, typer.Option("--serial", help="IMU serial; needed where the store holds several.")]
TechnologyOption = Annotated[str | None, typer.Option("--technology", help="rlg, fog or mems.")]
ModeOption = Annotated[str | None, typer.Option("--mode", help="Gyro mode, where the unit has several.")]
NoteOption = Annotated[str, typer.Option("--note", help="Kept with the revision.")]
MAX_DIGITS = 10  # of a revision number
RevisionOption = Annotated[str, typer.Option("--revision", help="A number, factory, previous or active.")]


@app.command("list", cls=Command)
def list_(
    store: StoreUrl = DEFAULT_STORE, serial: SerialOption = None, as_json: JsonFlag = False, quiet: Quiet = False,
    verbose: Verbose = False, seed: NoSeed = None,
) -> None:  # fmt: skip
    """Units and their revisions, newest last.

    Example: recal table list --store sqlite:///recal.db
    """
    with _open(store) as opened:
        units = [u for u in opened.units() if serial in (None, u.unit.imu_serial)]
        histories = [opened.history(*_key(u.active)) for u in units]
    _need(units or serial is None, f"no table for serial {serial}")
    result = {
        "store": opened.name,
        "units": [
            {**vars(u.unit), "active": u.active.number, "factory": u.factory_number, "has_twin": u.has_twin,
             "revisions": [_about(r) for r in history]}
            for u, history in zip(units, histories)
        ],
    }  # fmt: skip
    if answer(result, as_json=as_json, verbose=verbose) or quiet:
        return
    for u, history in zip(units, histories):
        print(f"{u.unit}{'' if u.has_twin else ', no twin record'}")
        for r in history:
            tags = [name for name, n in (("factory", u.factory_number), ("active", u.active.number)) if n == r.number]
            print("  " + _line(r) + (f"  [{', '.join(tags)}]" if tags else ""))
            if r.note:
                print(f"       {r.note}")


@app.command(cls=Command)
def show(
    store: StoreUrl = DEFAULT_STORE, serial: SerialOption = None, technology: TechnologyOption = None,
    mode: ModeOption = None, revision: RevisionOption = "active", as_json: JsonFlag = False,
    quiet: Quiet = False, verbose: Verbose = False, seed: NoSeed = None,
) -> None:  # fmt: skip
    """One table with U(k=2); --json prints it as formats.md writes a table.

    Example: recal table show --serial SN-0042
    """
    with _open(store) as opened:
        found = _revision(opened, revision, serial, technology, mode)
    if answer(found.table_dict, as_json=as_json, verbose=verbose) or quiet:
        return
    table = found.table
    print(f"{found.unit}\n{_line(found)}\nsha256 {found.sha256}\ncreated {table.created_utc}, {table.interpolation}")
    print("\naxis  temperature       bias    U(k=2)\n             degC      deg/h     deg/h")
    for axis, nodes in zip("xyz", table.temperature_degC):
        for T, bias, sigma in zip(nodes, table.bias_deg_h(axis, nodes), table.sigma_deg_h(axis, nodes)):
            print(f"{axis:4}  {T:11.2f} {bias:+10.5f}  {2 * sigma:8.5f}")


@app.command(cls=Command)
def diff(
    store: StoreUrl = DEFAULT_STORE, serial: SerialOption = None, technology: TechnologyOption = None,
    mode: ModeOption = None,
    from_: Annotated[str, typer.Option("--from", help="A number, factory, previous or active.")] = "previous",
    to: Annotated[str, typer.Option("--to", help="A number, factory, previous or active.")] = "active",
    as_json: JsonFlag = False, quiet: Quiet = False, verbose: Verbose = False, seed: NoSeed = None,
) -> None:  # fmt: skip
    """What changed between two revisions, by default from the previous to the active one.

    Example: recal table diff --serial SN-0042 --from factory
    """
    with _open(store) as opened:
        before = _revision(opened, from_, serial, technology, mode)
        after = _revision(opened, to, serial, technology, mode)
    axes = {axis: _change(before, after, axis) for axis in "xyz"}
    result = {"from": _about(before), "to": _about(after), "axes": axes}
    if answer(result, as_json=as_json, verbose=verbose) or quiet:
        return
    print(f"{after.unit}\nfrom {_line(before)}\nto   {_line(after)}\n")
    print("axis  temperature     before      after     change  U(k=2) before    after")
    print("             degC      deg/h      deg/h      deg/h          deg/h    deg/h")
    for axis, columns in axes.items():
        for T, old, new, change, s_old, s_new in zip(*columns.values()):
            biases = f"{old:+10.5f} {new:+10.5f} {change:+10.5f}"
            print(f"{axis:4}  {T:11.2f} {biases}       {2 * s_old:8.5f} {2 * s_new:8.5f}")


@app.command(cls=Command)
def export(
    output: OutputPath = None, store: StoreUrl = DEFAULT_STORE, serial: SerialOption = None,
    technology: TechnologyOption = None, mode: ModeOption = None, revision: RevisionOption = "active",
    as_json: JsonFlag = False, quiet: Quiet = False, verbose: Verbose = False,
    seed: NoSeed = None,
) -> None:  # fmt: skip
    """A table to a file: .json keeps everything, .csv node values and sigmas.

    Example: recal table export -o table.json --serial SN-0042
    """
    from infield.table_file import csv_text, json_text
    from recal.output import output_directory, write_text

    if output is None or output.suffix not in (".json", ".csv"):
        raise typer.BadParameter("needed: a file that ends in .json or .csv", param_hint="-o")
    with _open(store) as opened:
        found = _revision(opened, revision, serial, technology, mode)
    csv = output.suffix == ".csv"
    output_directory(output.parent, "")
    write_text(output, csv_text(found.table) if csv else json_text(found.table_dict) + "\n")
    answer({"output": str(output), **_about(found)}, as_json=as_json, verbose=verbose)
    say(f"{output}: {_line(found)}{' (covariance is not in a CSV)' if csv else ''}", quiet=quiet)


@app.command("import", cls=Command)
def import_(
    table: Annotated[Path, typer.Argument(help="A table, .json or .csv.")], store: StoreUrl = DEFAULT_STORE,
    twin: Annotated[Path | None, typer.Option("--twin", help="Sets the unit's twin record.")] = None,
    serial: SerialOption = None, technology: TechnologyOption = None, mode: ModeOption = None, note: NoteOption = "",
    other_technology: Annotated[
        bool, typer.Option("--override-technology", help="Although the store knows the serial as another; noted.")
    ] = False,
    as_json: JsonFlag = False, quiet: Quiet = False, verbose: Verbose = False,
    seed: NoSeed = None,
) -> None:  # fmt: skip
    """A table from a file becomes the active one; a unit's first is its factory table.

    Example: recal table import table.json --twin twin.json
    """
    from infield.store import StoreConflict, TableStore, require_same_unit
    from infield.table_file import read_table_csv, read_table_dict
    from ins.records import InputError
    from ins.twin_file import read_twin

    if table.suffix == ".csv":
        if serial is None or technology is None:
            raise typer.BadParameter("a CSV table needs --serial and --technology", param_hint="TABLE")
        now = datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
        data = read_table_csv(
            table, imu_serial=serial, gyro_technology=technology, gyro_mode=mode or "", created_utc=now
        )
    else:
        data = read_table_dict(table)
        for name, key, given in (("--serial", "imu_serial", serial), ("--technology", "gyro_technology", technology),
                                 ("--mode", "gyro_mode", mode)):  # fmt: skip
            in_file = data.get(key, "")
            _need(given in (None, in_file), f"{table}: {key} {in_file!r}, needed {given!r} as {name} says")
    record = None if twin is None else read_twin(twin)
    require_same_unit(data, record)
    try:
        with TableStore.open(store, create=True) as opened:
            if (conflict := _other_technology(opened, data)) is not None:
                _need(other_technology, f"{table}: {conflict} (--override-technology imports it all the same)")
                note = "; ".join(filter(None, (note, f"technology overridden: {conflict}")))
            found = opened.import_table(data, twin=record, note=note)
    except StoreConflict as error:
        raise InputError(str(error)) from None
    answer(_about(found), as_json=as_json, verbose=verbose)
    say(f"{found.unit}: {_line(found)}{', twin record set' if twin else ''}", quiet=quiet)


@app.command(cls=Command)
def rollback(
    store: StoreUrl = DEFAULT_STORE, serial: SerialOption = None, technology: TechnologyOption = None,
    mode: ModeOption = None,
    to: Annotated[str, typer.Option("--to", help="A number, factory or previous.")] = "previous",
    note: NoteOption = "", as_json: JsonFlag = False, quiet: Quiet = False, verbose: Verbose = False,
    seed: NoSeed = None,
) -> None:  # fmt: skip
    """An older table becomes active again, bit for bit, as a new revision.

    Example: recal table rollback --serial SN-0042 --to factory
    """
    from infield.store import StoreConflict
    from ins.records import InputError

    try:
        with _open(store) as opened:
            found = opened.rollback(
                serial, to if to in ("factory", "previous") else _number(to), technology, mode, note=note
            )
    except StoreConflict as error:
        raise InputError(str(error)) from None
    answer(_about(found), as_json=as_json, verbose=verbose)
    say(f"{found.unit}: {_line(found)}, the table of revision {found.restored_number}", quiet=quiet)


@app.command(cls=Command)
def verify(
    store: StoreUrl = DEFAULT_STORE, as_json: JsonFlag = False, quiet: Quiet = False, verbose: Verbose = False,
    seed: NoSeed = None,
) -> None:  # fmt: skip
    """Read every revision and check every hash and the chain.

    Example: recal table verify --store sqlite:///recal.db
    """
    with _open(store) as opened:
        counts = {str(u.unit): len(opened.history(*_key(u.active))) for u in opened.units()}
        twins = sum(opened.twin(*_key(u.active)) is not None for u in opened.units())
    answer({"store": opened.name, "revisions": counts, "twins": twins}, as_json=as_json, verbose=verbose)
    for unit, count in counts.items():
        say(f"{unit}: {count} revisions, all hashes right", quiet=quiet)


def _open(url: str) -> TableStore:
    from infield.store import TableStore

    return TableStore.open(url)


def _other_technology(opened: TableStore, table: dict[str, Any]) -> str | None:
    """What speaks against this table's gyro_technology: the store knows its serial as another."""
    serial, technology = table["imu_serial"], table["gyro_technology"]
    held = [u.unit for u in opened.units() if u.unit.imu_serial == serial]
    if not held or any(unit.gyro_technology == technology for unit in held):
        return None
    return f"gyro_technology {technology}, the store holds {', '.join(map(str, held))}: another unit?"


def _revision(opened: TableStore, name: str, serial: str | None, technology: str | None, mode: str | None) -> Revision:
    """A revision by number or tag; InputError where there is none."""
    key = _key(opened.active(serial, technology, mode))
    if name == "previous":
        found = opened.previous(*key)
        _need(found is not None, f"serial {key[0]}: revision 1 is active, there is none before it")
        return found  # type: ignore[return-value]
    if name in ("active", "factory"):
        record = next(u for u in opened.units() if _key(u.active) == key)
        return opened.revision({"active": record.active.number, "factory": record.factory_number}[name], *key)
    return opened.revision(_number(name), *key)


def _number(name: str) -> int:
    _need(name.isdecimal() and len(name) < MAX_DIGITS, f"revision {name[:40]!r}, needed a number, factory, previous or active")
    return int(name)


def _change(before: Revision, after: Revision, axis: str) -> dict[str, Any]:
    """Both tables at the nodes of either, one axis."""
    import numpy as np

    old, new, k = before.table, after.table, "xyz".index(axis)
    T = np.union1d(old.temperature_degC[k], new.temperature_degC[k])
    return {
        "temperature_degC": T,
        "before_deg_h": old.bias_deg_h(axis, T),
        "after_deg_h": new.bias_deg_h(axis, T),
        "change_deg_h": new.bias_deg_h(axis, T) - old.bias_deg_h(axis, T),
        "sigma_before_deg_h": old.sigma_deg_h(axis, T),
        "sigma_after_deg_h": new.sigma_deg_h(axis, T),
    }


def _key(revision: Revision) -> tuple[str, str, str]:
    unit = revision.unit
    return unit.imu_serial, unit.gyro_technology, unit.gyro_mode


def _about(r: Revision) -> dict[str, Any]:
    """A revision without its table."""
    return {
        **vars(r.unit), "revision": r.number, "kind": r.kind, "created_utc": r.created_utc, "sha256": r.sha256,
        "parent_sha256": r.parent_sha256, "restored_revision": r.restored_number, "note": r.note,
        "runs": [vars(run) for run in r.runs],
    }  # fmt: skip


def _line(r: Revision) -> str:
    runs = f"  {len(r.runs)} run{'s' if len(r.runs) > 1 else ''}" if r.runs else ""
    return f"revision {r.number}  {r.kind:8}  {r.created_utc}  {r.sha256[:12]}{runs}"


def _need(condition: object, otherwise: str) -> None:
    from ins.records import InputError

    if not condition:
        raise InputError(otherwise)
