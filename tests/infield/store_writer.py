"""What a writer process of the concurrency tests does."""

from infield.store.table_store import MergedRun, StoreConflict, TableStore
from infield.table.file import table_to_dict
from tests.infield.stores import commit, table, updated

STEP_DEG_H = 1e-6


def work(url: str, name: str, updates: int, serial: str = "SN-1") -> None:
    """Commit updates until they are done, each conflict on top of the table that won."""
    conflicts = 0
    with TableStore.open(url) as store:
        for k in range(updates):
            parent = store.active(serial)
            while True:
                try:
                    commit(store, parent, run=f"{name}-{k}", shift_deg_h=STEP_DEG_H)
                    break
                except StoreConflict:
                    conflicts += 1
                    parent = store.active(serial)
    print(conflicts)


def create(url: str, serial: str) -> None:
    """Make the store, if nobody else was faster, and a unit in it."""
    from tests.infield.stores import factory

    with TableStore.open(url, create=True) as store:
        factory(store, serial)


def put(url: str, name: str) -> None:
    """Import the same table as everybody else, propose the same update, each with a note."""
    with TableStore.open(url, create=True) as store:
        active = store.import_table(table_to_dict(table()), note=f"import {name}")
        runs = [MergedRun(run_id="run", sha256="run")]
        store.propose(active.sha256, updated(active), runs, "{}", by=name, note=f"update {name}")
