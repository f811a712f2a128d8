"""What may happen to a disk, a lock or a clock: the old table stands, and one line says why."""

import json
import sqlite3

import pytest
from sqlalchemy import create_engine, make_url, text

from infield.store import database as store_database
from infield.store.table_store import StoreConflict, TableStore
from ins.records import InputError
from tests.infield.stores import SIGNED, commit, factory, read_only, small_disk, updated

LONG_REPORT = json.dumps({"words": "x" * 80_000})


@pytest.fixture
def file_url(tmp_path):
    return f"sqlite:///{tmp_path}/recal.db"


def one_line(raised):
    assert "\n" not in str(raised.value)
    return str(raised.value)


def test_store_that_cannot_be_written_still_reads(store, url):
    first = factory(store)
    if url.startswith("postgresql"):  # a standby, or a role that may not write
        search = make_url(url).query["options"]
        url = make_url(url).update_query_dict(
            {"options": f"{search} -c default_transaction_read_only=on"}
        )
        store = TableStore.open(url.render_as_string(hide_password=False))
    else:
        with store._database._engine.connect() as c:
            c.exec_driver_sql("PRAGMA query_only=ON")
    with pytest.raises(InputError, match=r"not written: .*(read-only|readonly)"):
        commit(store, first)
    assert store.active() == first
    store.close()


def test_read_only_folder(tmp_path):
    (tmp_path / "stores").mkdir()
    url = f"sqlite:///{tmp_path}/stores/recal.db"
    with TableStore.open(url, create=True) as store:
        first = factory(store)
    with read_only(tmp_path / "stores"):
        with TableStore.open(url) as store:
            with pytest.raises(InputError, match=r"not written: .*readonly") as raised:
                commit(store, first)
            assert store.active() == first and len(store.history()) == 1 and one_line(raised)
        with pytest.raises(InputError, match="unable to open database file"):
            TableStore.open(f"sqlite:///{tmp_path}/stores/other.db", create=True)


def test_full_disk_leaves_the_old_table(tmp_path):
    with (
        small_disk(tmp_path / "disk") as disk,
        TableStore.open(f"sqlite:///{disk}/recal.db", create=True) as store,
    ):
        first = factory(store)
        with pytest.raises(InputError, match="not written: database or disk is full") as raised:
            for k in range(20):
                store.commit_update(
                    store.active().sha256, updated(store.active(), 1e-3 * k), [], LONG_REPORT
                )
        assert one_line(raised) and 1 <= len(store.history()) < 10
        assert store.history()[0] == first
        with pytest.raises(InputError, match="full"):
            store.import_table({**first.table_dict, "imu_serial": "SN-2"}, note="SN-2" * 40_000)


def test_a_lock_that_others_hold_is_waited_for_and_then_told(store, url, monkeypatch):
    monkeypatch.setattr(store_database, "LOCK_WAIT_S", 0.2)
    first = factory(store)
    with TableStore.open(url) as other:
        engine = create_engine(url)
        with engine.begin() as c:
            if url.startswith("postgresql"):
                c.execute(text("SELECT * FROM recal_unit FOR UPDATE"))
            else:
                c.exec_driver_sql("BEGIN IMMEDIATE")
            with pytest.raises(
                StoreConflict, match="busy with other writers, nothing written"
            ) as raised:
                commit(other, first)
            assert other.active() == first and one_line(raised)
        engine.dispose()
        assert commit(other, first).number == 2


def test_a_file_that_is_locked_altogether_is_named(file_url, tmp_path, monkeypatch):
    monkeypatch.setattr(store_database, "LOCK_WAIT_S", 0.2)
    with TableStore.open(file_url, create=True) as store:
        factory(store)
    lock = sqlite3.connect(tmp_path / "recal.db")
    lock.execute("BEGIN EXCLUSIVE")
    with pytest.raises(StoreConflict, match=r"store sqlite:.*: busy with other writers"):
        TableStore.open(file_url)
    lock.close()


def test_a_clock_that_jumped_backwards_writes_nothing(store, url):
    first = factory(store)
    with TableStore.open(url, clock=lambda: "2031-01-01T00:00:00Z") as ahead:
        second = ahead.commit_update(first.sha256, updated(first), [], "{}")
    for write in (
        lambda: commit(store, second),
        lambda: store.rollback(**SIGNED),
        lambda: store.import_table({**first.table_dict, "created_utc": "2026-05-01T00:00:00Z"}),
    ):
        with pytest.raises(InputError, match="revision 2 was written at 2031-01-01") as raised:
            write()
        assert one_line(raised) and store.active() == second
    # clocks of two machines
    with TableStore.open(url, clock=lambda: "2030-12-31T23:56:00Z") as behind:
        behind.commit_update(second.sha256, updated(second), [], "{}")
    with TableStore.open(url, any_clock=True) as trusting:
        assert commit(trusting, trusting.active()).number == 4
