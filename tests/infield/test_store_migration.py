"""Stores of older schemas, with data in them: `store_0001.json` holds the rows that the first
release (daaf26f) wrote.
"""

import json
from pathlib import Path

import pytest
from alembic import command
from sqlalchemy import create_engine, insert
from sqlalchemy.pool import NullPool

from infield.store.database import alembic_config
from infield.store.schema import SCHEMA_REVISION, metadata
from infield.store.table_store import TableStore
from ins.records import InputError
from tests.infield.stores import SIGNED, commit, rows, tamper

FIRST = json.loads((Path(__file__).parent / "store_0001.json").read_text())


@pytest.fixture
def old(url):
    """A store as the first release left it."""
    engine = create_engine(url, poolclass=NullPool)
    with engine.begin() as c:
        command.upgrade(alembic_config(c), "0001")
        for name, lines in FIRST.items():
            c.execute(insert(metadata.tables[name]), lines)
    if url.startswith("postgresql"):
        tamper(url, "SELECT setval('recal_unit_id_seq', 2)")
    return url


def kept(url):
    """The rows of the first release's tables."""
    return {
        name: sorted(map(str, rows(url, f"SELECT {', '.join(lines[0])} FROM {name}")))
        for name, lines in FIRST.items()
    }


def test_reading_leaves_an_old_store_as_it_is(old):
    before = kept(old)
    with TableStore.open(old) as store:
        found = [r.kind for r in store.history("SN-1")]
        assert found == ["factory", "update", "update", "rollback"]
        assert store.verify().intact
        assert store.twin("SN-1") is not None
        assert store.contradictions("SN-1", "rlg", "") == ()
        assert store.proposals() == []
        assert store.overview()[0].undecided == 0
    assert kept(old) == before
    assert rows(old, "SELECT version_num FROM alembic_version") == [("0001",)]


def test_writing_upgrades_it_and_keeps_every_row(old):
    before = kept(old)
    with TableStore.open(old, create=True) as store:
        assert kept(old) == before
        assert rows(old, "SELECT version_num FROM alembic_version") == [(SCHEMA_REVISION,)]
        assert store.verify().intact
        active = store.active("SN-1")
        assert (active.number, active.note, active.restored_number) == (4, "run-2 was bumped", 2)
        assert store.has_run("run-1") and not store.has_run("run-2")
        assert commit(store, active, run="run-2").number == 5
        found = store.rollback("SN-1", to="factory", **SIGNED).table_json
        assert found == store.revision(1, "SN-1").table_json
        found = store.import_table({**store.active("SN-2").table_dict, "imu_serial": "SN-3"}).number
        assert found == 1
        assert store.verify().intact


def test_an_upgrade_that_fails_leaves_the_old_schema(old, monkeypatch):
    """All of it in one transaction, on both databases."""
    before = kept(old)
    monkeypatch.setattr("infield.store.database.SCHEMA_REVISION", "0005")  # never reached
    tamper(old, "CREATE TABLE recal_proposal (in_the_way INTEGER)")
    with pytest.raises(InputError, match=r"not written: .*recal_proposal"):
        TableStore.open(old, create=True)
    assert rows(old, "SELECT version_num FROM alembic_version") == [("0001",)]
    assert kept(old) == before
    with pytest.raises(Exception, match="recal_contradiction"):
        rows(old, "SELECT * FROM recal_contradiction")
