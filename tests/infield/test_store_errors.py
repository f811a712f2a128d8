"""What stands in the way of the store is told by its type: by fleet, page and update.json."""

import pickle

import pytest

from infield.store.errors import NoStore, RowFault, UnknownTableHash
from infield.store.table_store import TableStore


def test_a_missing_store_and_an_unknown_hash_are_types(store, tmp_path):
    with pytest.raises(NoStore, match="no store at"):
        TableStore.open(f"sqlite:///{tmp_path}/none.db")
    with pytest.raises(UnknownTableHash, match="no table with sha256"):
        store.by_sha256("0" * 64)


def test_a_row_fault_survives_a_worker():
    fault = pickle.loads(pickle.dumps(RowFault("store x: unit revision 2: changed", "revision 2")))
    assert str(fault).startswith("store x")
