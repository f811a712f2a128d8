"""The store on both databases: revisions in a chain, conflicts told, rollback to the bit, every
changed row found.
"""

import json

import pytest

from infield.store.database import Database
from infield.store.table_store import (
    MergedRun,
    RunAlreadyMerged,
    StoreConflict,
    TableStore,
    UnknownUnit,
    store_exists,
)
from infield.table.file import canonical_json, table_sha256, table_to_dict
from ins.records import GyroNoise, InputError, TwinModel
from tests.infield.stores import SIGNED, commit, rows, table, tamper


def test_missing_store_is_refused_and_not_created(url, tmp_path):
    with pytest.raises(InputError, match=f"no store at {url.partition('+')[0].partition(':')[0]}"):
        TableStore.open(url)
    assert store_exists(url) == url.startswith("postgresql") and not list(tmp_path.iterdir())


def test_database_without_our_tables_is_no_store(tmp_path):
    (tmp_path / "recal.db").touch()
    (tmp_path / "text.db").write_text("not a database, but long enough to be taken for one" * 20)
    for name in ("recal.db", "text.db"):
        with pytest.raises(InputError, match="store"):
            TableStore.open(f"sqlite:///{tmp_path}/{name}")


@pytest.mark.parametrize("bad", ["recal.db", "nosuch://host/db"])
def test_bad_url_is_one_line(bad):
    with pytest.raises(InputError, match=r"^store [^\n]*$"):
        TableStore.open(bad)


@pytest.mark.parametrize("memory", ["sqlite://", "sqlite:///:memory:", "sqlite+pysqlite://"])
def test_a_store_in_memory_is_refused(memory):
    for look in (store_exists, TableStore.open, lambda url: TableStore.open(url, create=True)):
        with pytest.raises(InputError, match="in memory"):
            look(memory)


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
    assert store.rollback("NEW", to="factory", **SIGNED).sha256 == table_sha256(first)


def test_same_run_is_refused_until_a_rollback_takes_it_out(store):
    first = store.import_table(table_to_dict(table()))
    second = commit(store, first)
    third = commit(store, second, run="run-2")
    with pytest.raises(RunAlreadyMerged, match="run-1"):
        commit(store, third, run="run-1")
    assert store.active() == third  # zero nodes changed
    assert store.has_run("run-1", "SN-1") and not store.has_run("run-1", "SN-2")
    store.rollback("SN-1", to=2, **SIGNED)
    assert store.has_run("run-1") and not store.has_run("run-2")
    back = store.rollback("SN-1", to=3, **SIGNED)  # forward again: its runs count again
    assert store.has_run("run-2") and back.table_json == third.table_json
    fourth = commit(store, store.rollback("SN-1", to="factory", **SIGNED), run="run-2")
    assert fourth.number == 7 and store.has_run("run-2") and not store.has_run("run-1")


def test_rollback_is_bit_identical_and_appends(store):
    first = store.import_table(table_to_dict(table()))
    commit(store, first)
    back = store.rollback("SN-1", to="previous", **SIGNED)
    assert (back.number, back.kind, back.restored_number) == (3, "rollback", 1)
    assert back.table_json == first.table_json and back.sha256 == first.sha256
    assert len(store.history()) == 3
    for wrong in (3, 0, 9, "yesterday"):
        with pytest.raises(InputError):
            store.rollback("SN-1", to=wrong, **SIGNED)


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
    with pytest.raises(UnknownUnit, match="SN-9"):
        store.active("SN-9")
    with pytest.raises(InputError, match="another unit"):
        store.active("SN-2", "rlg")
    with pytest.raises(InputError, match="several units"):
        store.active("SN-1")


def test_twin_record(store):
    twin = TwinModel(
        imu_serial="SN-1", table="not/there.json", gyro=GyroNoise(arw_deg_sqrt_h=0.0031)
    )
    store.import_table(table_to_dict(table()), twin=twin)
    kept = store.twin("SN-1")
    assert kept.gyro == twin.gyro and kept.table == "not/there.json" and "store" in kept.source
    store.import_table(table_to_dict(table(high=30)))
    assert store.twin("SN-1").gyro == twin.gyro  # an import without a twin leaves the unit's record
    with pytest.raises(InputError, match="SN-2"):
        store.import_table(table_to_dict(table("SN-2")), twin=twin)
    assert [u.has_twin for u in store.units()] == [True]


@pytest.mark.parametrize(
    "column, value",
    [
        ("table_json", None),
        ("kind", "import"),
        ("note", "changed"),
        ("report_json", "{}"),
        ("runs_json", "[]"),
        ("created_utc", "2020-01-01T00:00:00Z"),
        ("parent_sha256", "0" * 64),
        ("record_sha256", "0" * 64),
    ],
)
def test_changed_row_is_found(store, url, column, value):
    commit(store, store.import_table(table_to_dict(table())))
    if value is None:
        ((text,),) = rows(url, "SELECT table_json FROM recal_revision WHERE number = 2")
        value = text.replace("0.001", "0.002", 1)
        assert value != text
    tamper(url, (f"UPDATE recal_revision SET {column} = :value WHERE number = 2", {"value": value}))
    with pytest.raises(InputError, match="the row was changed"):
        store.active("SN-1")


def test_changed_twin_is_found(store, url):
    store.import_table(table_to_dict(table()), twin=TwinModel(imu_serial="SN-1"))
    tamper(url, "UPDATE recal_unit SET twin_json = replace(twin_json, '0.002', '0.001')")
    with pytest.raises(InputError, match="the row was changed"):
        store.twin("SN-1")


def test_migration_makes_the_declared_schema(store, url):
    from alembic.autogenerate import compare_metadata
    from alembic.migration import MigrationContext
    from alembic.script import ScriptDirectory

    from infield.store.database import alembic_config
    from infield.store.schema import SCHEMA_REVISION, metadata

    with Database(url, create=False).reading() as connection:
        assert compare_metadata(MigrationContext.configure(connection), metadata) == []
        found = ScriptDirectory.from_config(alembic_config(connection)).get_current_head()
        assert found == SCHEMA_REVISION


def test_another_schema_version_is_refused(store, url):
    tamper(url, "UPDATE alembic_version SET version_num = '9999'")
    for create in (False, True):
        with pytest.raises(InputError, match=r"schema 9999, needed .* a newer recal made it"):
            TableStore.open(url, create=create)
