"""A store, or a unit in it, that an update would make without being asked to.

A mistyped store must not pass for a new one, nor a unit with an invented table for its own.

Decision: docs/decisions/0022-sqlite-journal.md.
"""

from typing import NoReturn

from infield.store.database import store_name
from infield.store.errors import StoreNotAskedFor, UnitNotInStore
from infield.store.table_store import TableStore, UnitKey

UNITS_NAMED = 8  # units of a store that one line names; chosen: 8 serials of ten characters


def refuse_store(url: str, key: UnitKey) -> NoReturn:
    """StoreNotAskedFor: there is no store, and what would make one."""
    raise StoreNotAskedFor(
        f"no store at {store_name(url)}, where the table of {key} was looked for: recal table"
        " import TABLE makes one, or --new-store with --new-unit"
    )


def require_unit(store: TableStore | None, key: UnitKey) -> None:
    """UnitNotInStore where the store (None: one that is yet to be made) holds no table of a unit;
    the line names the units that it holds.
    """
    held = [] if store is None else [u.unit for u in store.overview() if u.active_number]
    if key in held:
        return
    where = "a new store" if store is None else f"store {store.name}"
    shown = ", ".join(str(unit) for unit in held[:UNITS_NAMED])
    more = f" and {len(held) - UNITS_NAMED} more" if len(held) > UNITS_NAMED else ""
    raise UnitNotInStore(
        f"{where} holds no table of {key}, it holds {shown or 'no unit'}{more}: recal table import"
        f" TABLE, or --new-unit to begin with the default of {key.gyro_technology}"
    )
