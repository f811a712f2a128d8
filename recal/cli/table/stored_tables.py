"""Stored tables as `recal table` finds, names and prints them; its options. Libraries are imported
where used.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from infield.store.table_store import Revision, TableStore

SerialOption = Annotated[
    str | None, typer.Option("--serial", help="IMU serial; needed where the store holds several.")
]
TechnologyOption = Annotated[str | None, typer.Option("--technology", help="rlg, fog or mems.")]
ModeOption = Annotated[
    str | None, typer.Option("--mode", help="Gyro mode, where the unit has several.")
]
NoteOption = Annotated[str, typer.Option("--note", help="Kept with the revision.")]
MAX_DIGITS = 10  # of a revision number
RevisionOption = Annotated[
    str, typer.Option("--revision", help="A number, factory, previous or active.")
]


def open_tables(url: str, *, any_clock: bool = False) -> TableStore:
    from infield.store.table_store import TableStore

    return TableStore.open(url, any_clock=any_clock)


def other_technology(opened: TableStore, table: dict[str, Any]) -> str | None:
    """What speaks against this table's gyro_technology: the store knows its serial as another."""
    serial, technology = table["imu_serial"], table["gyro_technology"]
    held = [u.unit for u in opened.units() if u.unit.imu_serial == serial]
    if not held or any(unit.gyro_technology == technology for unit in held):
        return None
    return (
        f"gyro_technology {technology}, the store holds {', '.join(map(str, held))}: another unit?"
    )


def find_revision(
    opened: TableStore, name: str, serial: str | None, technology: str | None, mode: str | None
) -> Revision:
    """A revision by number or tag; InputError where there is none."""
    key = key_of(opened.active(serial, technology, mode))
    if name == "previous":
        found = opened.previous(*key)
        need(found is not None, f"serial {key[0]}: revision 1 is active, there is none before it")
        return found  # type: ignore[return-value]
    if name in ("active", "factory"):
        record = next(u for u in opened.units() if key_of(u.active) == key)
        return opened.revision(
            {"active": record.active.number, "factory": record.factory_number}[name], *key
        )
    return opened.revision(revision_number(name), *key)


def revision_number(name: str) -> int:
    need(
        name.isdecimal() and len(name) < MAX_DIGITS,
        f"revision {name[:40]!r}, needed a number, factory, previous or active",
    )
    return int(name)


def change_between(before: Revision, after: Revision, axis: str) -> dict[str, Any]:
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


def key_of(revision: Revision) -> tuple[str, str, str]:
    unit = revision.unit
    return unit.imu_serial, unit.gyro_technology, unit.gyro_mode


def about(r: Revision) -> dict[str, Any]:
    """A revision without its table."""
    return {
        **vars(r.unit),
        "revision": r.number,
        "kind": r.kind,
        "created_utc": r.created_utc,
        "sha256": r.sha256,
        "parent_sha256": r.parent_sha256,
        "restored_revision": r.restored_number,
        "note": r.note,
        "runs": [vars(run) for run in r.runs],
    }


def line_of(r: Revision) -> str:
    runs = f"  {len(r.runs)} run{'s' if len(r.runs) > 1 else ''}" if r.runs else ""
    return f"revision {r.number}  {r.kind:8}  {r.created_utc}  {r.sha256[:12]}{runs}"


def need(condition: object, otherwise: str) -> None:
    from ins.records import InputError

    if not condition:
        raise InputError(otherwise)
