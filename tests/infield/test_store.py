"""The store: revisions in a chain, conflicts told, rollback to the bit, every changed row found."""

import contextlib
import json
import os
import signal
import sqlite3
import subprocess
import sys
import textwrap
import threading
import uuid

import numpy as np
import pytest

from infield.store import MergedRun, RunAlreadyMerged, StoreConflict, TableStore, UnknownUnit, store_exists
from infield.store_database import Database
from infield.table import default_table
from infield.table_file import canonical_json, table_sha256, table_to_dict
from ins.records import GyroNoise, InputError, TwinModel

UTC = "2026-03-01T05:00:00Z"


def table(serial="SN-1", technology="rlg", mode="", high=20.0):
    return default_table(
        imu_serial=serial, gyro_technology=technology, gyro_mode=mode, created_utc=UTC, low_degC=0, high_degC=high
    )


def updated(revision, shift_deg_h=0.001):
    """An update of a stored table: every node moved."""
    return revision.table.replaced(
        parameters=revision.table.parameters + shift_deg_h,
        provenance={"parent_sha256": revision.sha256, "runs": []},
    )


def commit(store, parent, *, run="run-1", **changes):
    runs = [MergedRun(run_id=run, sha256=run)] if run else []
    return store.commit_update(parent.sha256, updated(parent, **changes), runs, '{"verdict": "committed"}')


@pytest.fixture
def url(tmp_path):
    return f"sqlite:///{tmp_path}/recal.db"


@pytest.fixture
def store(url):
    with TableStore.open(url, create=True) as opened:
        yield opened


def test_missing_store_is_refused_and_not_created(url, tmp_path):
    with pytest.raises(InputError, match="no store at sqlite:///"):
        TableStore.open(url)
    assert not store_exists(url) and not list(tmp_path.iterdir())


def test_database_without_our_tables_is_no_store(url, tmp_path):
    sqlite3.connect(tmp_path / "recal.db").close()
    (tmp_path / "text.db").write_text("not a database, but long enough to be taken for one" * 20)
    for name in ("recal.db", "text.db"):
        with pytest.raises(InputError, match="store"):
            TableStore.open(f"sqlite:///{tmp_path}/{name}")


@pytest.mark.parametrize("bad", ["recal.db", "nosuch://host/db"])
def test_bad_url_is_one_line(bad):
    with pytest.raises(InputError, match=r"^store [^\n]*$"):
        TableStore.open(bad)


def test_import_keeps_bits_and_hash(store, url):
    data = table_to_dict(table())
    data["axes"]["x"]["bias_deg_h"] = [0.1, 0, 1e-17]  # an int among them
    data["covariance"] = None
    revision = store.import_table(data)
    assert (revision.number, revision.kind, revision.parent_sha256) == (1, "factory", None)
    assert revision.sha256 == table_sha256(data)
    with TableStore.open(url) as again:
        assert again.active("SN-1").table_json == canonical_json(data)
        assert again.by_sha256(table_sha256(data)).unit.imu_serial == "SN-1"
        assert again.previous("SN-1") is None
    assert store.import_table(data).number == 1  # the active one again


def test_update_chain(store):
    first = store.import_table(table_to_dict(table()))
    second = commit(store, first)
    assert (second.number, second.kind, second.parent_sha256) == (2, "update", first.sha256)
    assert second.runs == (MergedRun(run_id="run-1", sha256="run-1"),)
    assert json.loads(second.report_json)["verdict"] == "committed"
    assert store.active() == second and store.previous() == first
    assert [r.number for r in store.history("SN-1")] == [1, 2]
    assert store.units()[0].factory_number == 1


def test_stale_parent_is_a_conflict_and_nothing_changes(store):
    first = store.import_table(table_to_dict(table()))
    second = commit(store, first)
    with pytest.raises(StoreConflict):
        commit(store, first, run="run-2")
    assert store.active() == second and not store.has_run("run-2")


def test_update_must_name_its_parent(store):
    first = store.import_table(table_to_dict(table()))
    with pytest.raises(ValueError, match="parent"):
        store.commit_update(first.sha256, first.table, [], "{}")


def test_first_update_of_an_unknown_unit_brings_its_default_table(store):
    first = table_to_dict(table("NEW"))
    new = table("NEW").replaced(provenance={"parent_sha256": table_sha256(first), "runs": []})
    revision = store.commit_update(table_sha256(first), new, [], "{}", first_table=first)
    assert revision.number == 2 and store.previous("NEW").kind == "factory"
    assert store.rollback("NEW", to="factory").sha256 == table_sha256(first)


def test_same_run_is_refused_until_a_rollback_takes_it_out(store):
    first = store.import_table(table_to_dict(table()))
    second = commit(store, first)
    third = commit(store, second, run="run-2")
    with pytest.raises(RunAlreadyMerged, match="run-1"):
        commit(store, third, run="run-1")
    assert store.active() == third  # zero nodes changed
    assert store.has_run("run-1", "SN-1") and not store.has_run("run-1", "SN-2")
    store.rollback("SN-1", to=2)
    assert store.has_run("run-1") and not store.has_run("run-2")
    back = store.rollback("SN-1", to=3)  # forward again: its runs count again
    assert store.has_run("run-2") and back.table_json == third.table_json
    fourth = commit(store, store.rollback("SN-1", to="factory"), run="run-2")
    assert fourth.number == 7 and store.has_run("run-2") and not store.has_run("run-1")


def test_rollback_is_bit_identical_and_appends(store):
    first = store.import_table(table_to_dict(table()))
    commit(store, first)
    back = store.rollback("SN-1", to="previous")
    assert (back.number, back.kind, back.restored_number) == (3, "rollback", 1)
    assert back.table_json == first.table_json and back.sha256 == first.sha256
    assert len(store.history()) == 3
    for wrong in (3, 0, 9, "yesterday"):
        with pytest.raises(InputError):
            store.rollback("SN-1", to=wrong)


def test_runs_in_an_imported_provenance_count_as_merged(store):
    data = table_to_dict(table())
    data["provenance"]["runs"] = ["aaa", {"run_id": "r", "sha256": "bbb"}]
    store.import_table(data)
    assert store.has_run("aaa") and store.has_run("bbb")
    with pytest.raises(RunAlreadyMerged):
        commit(store, store.active(), run="bbb")


def test_key_holds_serial_technology_and_mode(store):
    store.import_table(table_to_dict(table()))
    store.import_table(table_to_dict(table(mode="dithered", high=30)))
    store.import_table(table_to_dict(table("SN-2", "fog")))
    assert store.active("SN-1", mode="dithered").table.temperature_degC[0][-1] == 30.0
    assert store.active("SN-2", "fog").unit.gyro_technology == "fog"
    with pytest.raises(UnknownUnit, match="no table for serial SN-9"):
        store.active("SN-9")
    with pytest.raises(InputError, match="another unit"):
        store.active("SN-2", "rlg")
    with pytest.raises(InputError, match="several units"):
        store.active("SN-1")


def test_twin_record(store):
    twin = TwinModel(imu_serial="SN-1", table="not/there.json", gyro=GyroNoise(arw_deg_sqrt_h=0.0031))
    store.import_table(table_to_dict(table()), twin=twin)
    kept = store.twin("SN-1")
    assert kept.gyro == twin.gyro and kept.table == "not/there.json" and "store" in kept.source
    store.import_table(table_to_dict(table(high=30)))
    assert store.twin("SN-1").gyro == twin.gyro  # an import without a twin leaves the unit's record
    with pytest.raises(InputError, match="SN-2"):
        store.import_table(table_to_dict(table("SN-2")), twin=twin)
    assert [u.has_twin for u in store.units()] == [True]


@pytest.mark.parametrize("column, value", [
    ("table_json", None), ("kind", "import"), ("note", "changed"), ("report_json", "{}"), ("runs_json", "[]"),
    ("created_utc", "2020-01-01T00:00:00Z"), ("parent_sha256", "0" * 64), ("record_sha256", "0" * 64),
])  # fmt: skip
def test_changed_row_is_found(store, tmp_path, column, value):
    commit(store, store.import_table(table_to_dict(table())))
    with sqlite3.connect(tmp_path / "recal.db") as raw:
        if value is None:
            (text,) = raw.execute("SELECT table_json FROM recal_revision WHERE number = 2").fetchone()
            value = text.replace("0.001", "0.002", 1)
            assert value != text
        raw.execute(f"UPDATE recal_revision SET {column} = ? WHERE number = 2", (value,))
    raw.close()
    with pytest.raises(InputError, match="the row was changed"):
        store.active("SN-1")


def test_changed_twin_is_found(store, tmp_path):
    store.import_table(table_to_dict(table()), twin=TwinModel(imu_serial="SN-1"))
    with sqlite3.connect(tmp_path / "recal.db") as raw:
        raw.execute("UPDATE recal_unit SET twin_json = replace(twin_json, '0.002', '0.001')")
    raw.close()
    with pytest.raises(InputError, match="the row was changed"):
        store.twin("SN-1")


def test_migration_makes_the_declared_schema(store, url):
    from alembic.autogenerate import compare_metadata
    from alembic.migration import MigrationContext
    from alembic.script import ScriptDirectory

    from infield.store_database import alembic_config
    from infield.store_schema import SCHEMA_REVISION, metadata

    with Database(url, create=False).reading() as connection:
        assert compare_metadata(MigrationContext.configure(connection), metadata) == []
        assert ScriptDirectory.from_config(alembic_config(connection)).get_current_head() == SCHEMA_REVISION


def test_another_schema_version_is_refused(store, url, tmp_path):
    with sqlite3.connect(tmp_path / "recal.db") as raw:
        raw.execute("UPDATE alembic_version SET version_num = '9999'")
    raw.close()
    for create in (False, True):
        with pytest.raises(InputError, match=r"schema 9999, needed .* a newer recal made it"):
            TableStore.open(url, create=create)


def writers_race(url, *, serial="SN-1", writers, updates):
    """Threads that each commit until done, told of every conflict; returns how many conflicts there were."""
    conflicts, faults = [], []

    def work(name):
        try:
            with TableStore.open(url) as store:
                done = 0
                while done < updates:
                    try:
                        commit(store, store.active(serial), run=f"{name}-{done}", shift_deg_h=1e-6)
                        done += 1
                    except StoreConflict as conflict:
                        conflicts.append(conflict)
        except BaseException as fault:
            faults.append(fault)

    threads = [threading.Thread(target=work, args=(k,)) for k in range(writers)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not faults, faults
    return len(conflicts)


def test_no_update_is_lost_between_writers(store, url):
    store.import_table(table_to_dict(table()))
    writers_race(url, writers=3, updates=4)
    history = store.history()
    assert len(history) == 13
    assert history[-1].table.parameters[0] == pytest.approx(12e-6, rel=1e-9)


def test_several_may_create_the_store_at_once(url):
    faults = []

    def work(serial):
        try:
            with TableStore.open(url, create=True) as store:
                store.import_table(table_to_dict(table(serial)))
        except BaseException as fault:
            faults.append(fault)

    threads = [threading.Thread(target=work, args=(f"SN-{k}",)) for k in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not faults
    with TableStore.open(url) as store:
        assert len(store.units()) == 4


def test_store_that_cannot_be_written_still_reads(store):
    first = store.import_table(table_to_dict(table()))
    with store._database._engine.connect() as c:  # root ignores file modes, so the fault is put into the connection
        c.exec_driver_sql("PRAGMA query_only=ON")
    with pytest.raises(InputError, match="not written"):
        commit(store, first)
    assert store.active() == first


def test_full_disk_leaves_the_old_table(store):
    first = store.import_table(table_to_dict(table()))
    with store._database._engine.connect() as c:
        pages = c.exec_driver_sql("PRAGMA page_count").scalar()
        c.exec_driver_sql(f"PRAGMA max_page_count={pages}")
    wide = first.table.extended_to(-90.0, 190.0).replaced(provenance={"parent_sha256": first.sha256})
    with pytest.raises(InputError, match="full"):
        store.commit_update(first.sha256, wide, [], "{}" * 10000)
    assert store.active() == first and len(store.history()) == 1


KILLED_WRITER = """
import sys
sys.path.insert(0, {root!r})
from infield.store import TableStore, MergedRun
store = TableStore.open(sys.argv[1])
for k in range(10_000):
    parent, run = store.active(), sys.argv[2] + str(k)
    table = parent.table.replaced(
        parameters=parent.table.parameters + 1e-6, provenance={{"parent_sha256": parent.sha256, "runs": []}})
    done = store.commit_update(parent.sha256, table, [MergedRun(run_id=run, sha256=run)], "{{}}")
    print(done.number, flush=True)
"""


def kill_writers(url, tmp_path, *, kills, rng):
    """Start a writer, kill it at a random moment, look; again and again. Then check the whole chain."""
    script = tmp_path / "writer.py"
    root = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
    script.write_text(textwrap.dedent(KILLED_WRITER.format(root=root)))
    for k in range(kills):
        writer = subprocess.Popen([sys.executable, str(script), url, f"w{k}-"], stdout=subprocess.PIPE, text=True)
        told = [writer.stdout.readline()]
        with contextlib.suppress(subprocess.TimeoutExpired):
            writer.wait(timeout=float(rng.uniform(0.0, 0.06)))
        writer.send_signal(signal.SIGKILL)
        told += writer.stdout.read().splitlines()
        writer.wait()
        writer.stdout.close()
        complete = [int(line) for line in told if line.strip()]
        with TableStore.open(url) as store:
            assert complete and store.active().number >= complete[-1]  # what was told to be committed is there
    with TableStore.open(url) as store:
        values = [revision.table.parameters[0] for revision in store.history()]
    assert np.diff(values) == pytest.approx(1e-6, rel=1e-6)  # each update once, none lost
    return len(values)


def test_killed_writers_lose_and_break_nothing(store, url, tmp_path):
    store.import_table(table_to_dict(table()))
    assert kill_writers(url, tmp_path, kills=2, rng=np.random.default_rng(1)) > 2


@pytest.mark.slow
@pytest.mark.parametrize("batch", range(10))
def test_many_killed_writers_lose_and_break_nothing(store, url, tmp_path, batch):
    store.import_table(table_to_dict(table()))
    assert kill_writers(url, tmp_path, kills=100, rng=np.random.default_rng(100 + batch)) > 100


@pytest.fixture(scope="module")
def postgres_url():
    url = os.environ.get("RECAL_TEST_POSTGRES_URL")
    if not url:
        pytest.skip("RECAL_TEST_POSTGRES_URL names no empty PostgreSQL database")
    return url


def test_postgres_behaves_the_same(postgres_url):
    serial = f"PG-{uuid.uuid4()}"
    with TableStore.open(postgres_url, create=True) as store:
        data = table_to_dict(table(serial))
        first = store.import_table(data)
        assert first.table_json == canonical_json(data)
        second = commit(store, first)
        with pytest.raises(StoreConflict):
            commit(store, first, run="run-2")
        with pytest.raises(RunAlreadyMerged):
            commit(store, second)
        assert store.active(serial) == second
        writers_race(postgres_url, serial=serial, writers=4, updates=5)
        assert len(store.history(serial)) == 22
        assert store.rollback(serial, to="factory").table_json == first.table_json
