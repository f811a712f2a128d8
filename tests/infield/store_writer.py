"""What a writer process of the concurrency tests does."""

from infield.store.table_store import StoreConflict, TableStore
from tests.infield.stores import commit

STEP_DEG_H = 1e-6


def work(url: str, name: str, updates: int, serial: str = "SN-1") -> None:
    """Commit updates until they are done, told of every conflict and then made again from the table
    that won.
    """
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
