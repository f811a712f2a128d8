"""What stands in the way of the store is told by its type: by fleet, page and update.json."""

import pickle
from types import SimpleNamespace

import pytest

from infield.store.errors import (
    WORTH_ANOTHER_TRY,
    NoStore,
    RowFault,
    RunAlreadyMerged,
    StoreBusy,
    StoreError,
    TableMoved,
    UnknownTableHash,
)
from infield.store.table_store import TableStore
from ins.records import InputError
from ins.verdicts import Outcome
from recal.fleet.pools.work import _conflicted
from recal.web.app import _status


def test_a_missing_store_and_an_unknown_hash_are_types(store, tmp_path):
    with pytest.raises(NoStore, match="no store at"):
        TableStore.open(f"sqlite:///{tmp_path}/none.db")
    with pytest.raises(UnknownTableHash, match="no table with sha256"):
        store.by_sha256("0" * 64)


def test_the_page_answers_by_the_type():
    assert _status(NoStore("words")) == _status(StoreError("words")) == 503
    assert _status(StoreBusy("words")) == 503
    assert _status(InputError("store in the words")) == 400
    assert _status(TableMoved("words")) == 409


@pytest.mark.parametrize("kind", [TableMoved, StoreBusy])
def test_the_fleet_tries_again_by_the_code(kind):
    document = SimpleNamespace(verdict=Outcome.REFUSED, reason_codes=[str(kind.code)])
    assert _conflicted(document) and kind.code in WORTH_ANOTHER_TRY
    held = SimpleNamespace(verdict=Outcome.REFUSED, reason_codes=[str(RunAlreadyMerged.code)])
    assert not _conflicted(held)


def test_a_row_fault_survives_a_worker():
    fault = pickle.loads(pickle.dumps(RowFault("store x: unit revision 2: changed", "revision 2")))
    assert str(fault).startswith("store x")
